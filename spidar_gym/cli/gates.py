"""`spidar gates`: single gates of swept sizes, until each gait fails."""

from pathlib import Path

from spidar_gym import viz
from spidar_gym.cli.arguments import JsonArg
from spidar_gym.cli.console import drawn, studied
from spidar_gym.errors import require_least
from spidar_gym.files import output_folder
from spidar_gym.paper import gate_study
from spidar_gym.processes import cpu_count
from spidar_gym.text import format_table


def gates(out: Path = Path("out/gates"), seeds: int = 4, workers: int = cpu_count(), json: JsonArg = False) -> None:
    """Sweep the size of every kind of gate of Course-v0 until each gait fails; goes on where it stopped.

    Heights of walls, platforms and tiles [m], clearance under beams [m], width of slots [m], angle of slopes [rad].
    Before each gate the rule, flying alone in form 1 and in form 3, and crawling alone, with drawn robots and sensors.

    Args:
        out: Folder for gates.json, gates.png and gates.pdf.
        seeds: Drawn robots before each gate; 4 take some 35 minutes on two busy cores.
        workers: Processes.
    """
    require_least(1, seeds=seeds, workers=workers)
    folder = output_folder(out)
    rows = studied(
        folder, "gates", "run", len(gate_study.cells()) * seeds, json=json,
        play=lambda unfinished, on_run: gate_study.sweep(
            seeds=seeds, workers=workers, folder=unfinished, on_run=on_run
        ),
        table=lambda found: format_table(gate_study.gate_lines(found)),
    )  # fmt: skip
    drawn("figure", lambda: viz.gate_figure(rows, folder / "gates.png"))
