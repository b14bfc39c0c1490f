"""`spidar steps`: tiles and stairs of swept heights, until each gait fails."""

from pathlib import Path

from spidar_gym import viz
from spidar_gym.cli.arguments import JsonArg
from spidar_gym.cli.console import drawn, studied
from spidar_gym.errors import require_least
from spidar_gym.files import output_folder
from spidar_gym.paper import step_study
from spidar_gym.processes import cpu_count
from spidar_gym.text import format_table


def steps(
    gaits: tuple[str, ...] = step_study.GAITS, out: Path = Path("out/steps"), seeds: int = 4,
    workers: int = cpu_count(), json: JsonArg = False,
) -> None:  # fmt: skip
    """Sweep the height of tiles and stairs until each gait fails, with feet lifted as it does, and higher.

    0.8 m ahead, robots drawn at strength 0.3, sensors; a success is that of Crawl-v0. Goes on where it stopped.

    Args:
        gaits: Presets of the crawl, or module:CLASS of policies that are a controller.
        out: Folder for steps.json, steps.png and steps.pdf.
        seeds: Drawn robots on each floor; 4 take some 20 minutes on two cores.
        workers: Processes.
    """
    require_least(1, seeds=seeds, workers=workers)
    chosen = tuple(dict.fromkeys(gaits))
    for gait in chosen:
        step_study.controller_of(gait)  # or it says what would be one
    folder = output_folder(out)
    rows = studied(
        folder, "steps", "run", len(step_study.cells(chosen)) * seeds, json=json,
        play=lambda unfinished, on_run: step_study.sweep(
            chosen, seeds=seeds, workers=workers, folder=unfinished, on_run=on_run
        ),
        table=lambda found: format_table(step_study.step_lines(found)),
    )  # fmt: skip
    drawn("figure", lambda: viz.step_figure(rows, folder / "steps.png"))
