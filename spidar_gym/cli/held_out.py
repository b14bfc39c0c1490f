"""`spidar leaderboard held-out`: policies on conditions that nobody trains or chooses by, in a table of their own."""

from pathlib import Path
from typing import Annotated

import tyro

from spidar_gym.benchmark.held_out import COUNT, HELD_OUT
from spidar_gym.benchmark.held_out_play import choose, plan, play_all
from spidar_gym.benchmark.held_out_table import (
    WRITER,
    held_out_lines,
    make_content,
    worst_lines,
    write_content,
)
from spidar_gym.benchmark.row import ROWS, read_rows
from spidar_gym.cli.arguments import Flag, JsonArg
from spidar_gym.cli.console import goes_on, kept, progress
from spidar_gym.cli.tables import with_tables
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.files import json_text, write_text
from spidar_gym.processes import cpu_count
from spidar_gym.text import format_table

PAGE = "docs/benchmark/held_out.md"
"""The page of a checkout that shows the committed table."""


def held_out(
    rows: Annotated[Path, tyro.conf.arg(help="Folder of the rows.")] = Path(ROWS),
    names: tuple[str, ...] = (),
    policy: tuple[str, ...] = (),
    against: str = "",
    scenarios: int = COUNT,
    out: Path = Path("out/held_out.json"),
    cache: Path = Path("out/held_out"),
    workers: int = cpu_count(),
    trust: Flag = False,
    json: JsonArg = False,
) -> None:
    """Play the held-out conditions, which nobody trains or chooses by; goes on where an interrupted table was.

    Every row with a controller below it is played, with all its runs, and each learned residual compared with the
    controller that it adds to. Written to baselines/held_out.json, the table is shown on its page of the guide too.

    Args:
        names: Only these rows, with those that they add to.
        policy: A candidate of one's own, module:Class or artifacts, one a run; of the rows only those that are named
            and the one that it is compared with.
        against: Row or preset that the candidate is compared with; the one that it adds to by default.
        scenarios: How many scenarios of each condition, from the first on.
        out: File of the table.
        cache: Folder in which finished episodes are kept.
        workers: Processes.
        trust: Run policies of rows from outside the package and the committed baselines too: their code is whoever's
            the rows are, so read it first.
    """
    require_least(1, scenarios=scenarios, workers=workers)
    entrants = choose(read_rows(rows), names, policy, against, trust=trust)
    episodes = plan(entrants, scenarios)
    if not episodes:
        raise InvalidValueError("rows", str(rows), "a folder with rows that are defined on a condition")
    with progress(total=len(episodes), unit="episode", desc="held out") as bar, kept(goes_on(bar, cache)):
        metrics = play_all(episodes, workers=workers, folder=cache, on_episode=bar.update)
    words = [
        *(("--names", *names) if names else ()), *(("--policy", *policy) if policy else ()),
        *(("--against", against) if against else ()),
        *(("--scenarios", str(scenarios)) if scenarios != COUNT else ()),
    ]  # fmt: skip
    content = make_content(entrants, episodes, metrics, command=" ".join([WRITER, *words]))
    write_content(out, content)
    page = Path(PAGE)
    shown = out == Path(HELD_OUT) and page.is_file()
    if shown:
        write_text(page, with_tables(Path(), page.read_text(encoding="utf-8")))
    worst = worst_lines(content)
    if json:
        print(json_text({"held_out": content}))
        return
    for group in ("flight", "ground"):
        lines = held_out_lines(content, group)
        if len(lines) > 1:
            print(format_table(lines) + "\n")
    if len(worst) > 1:
        print(format_table(worst) + "\n")
    print(f"written to {out}" + (f" and {page}" if shown else ""))
