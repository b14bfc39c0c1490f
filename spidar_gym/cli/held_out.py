"""`spidar leaderboard held-out`: evaluate policies under conditions never used for training or tuning."""

from pathlib import Path
from typing import Annotated

import tyro

from spidar_gym.arguments import Flag, JsonArg
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
from spidar_gym.cli.tables import with_tables
from spidar_gym.console import goes_on, kept, progress
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.files import json_text, write_text
from spidar_gym.processes import cpu_count
from spidar_gym.text import format_table

PAGE = "docs/benchmark/held_out.md"
"""Page of the guide that shows the committed table."""


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
    """Evaluate policies under the held-out conditions, never used for training or tuning; resumable.

    All runs of every row with an underlying controller are evaluated, and each learned residual is compared with its
    controller alone. With --out baselines/held_out.json, the guide's page of held-out conditions is updated too.

    Args:
        names: Names of the rows, evaluated with the rows of their underlying controllers; all if none is given.
        policy: Candidate: module:Class, or artifacts, one per run.
            Of the rows, only those in --names and the one for comparison are evaluated.
        against: Row or preset to compare the candidate with; its underlying controller if not given.
        scenarios: Number of scenarios per condition, from the first.
        out: JSON file for the table.
        cache: Folder for finished episodes, from which an interrupted command resumes.
        workers: Number of processes.
        trust: Also run policies of rows from outside the package and the committed baselines.
            The authors of the rows wrote their code, so read it first.
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
