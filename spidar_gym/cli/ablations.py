"""`spidar ablations`: what each part of the best controllers is worth."""

from pathlib import Path

from spidar_gym import viz
from spidar_gym.benchmark.track import SCENARIOS
from spidar_gym.cli.arguments import JsonArg
from spidar_gym.cli.console import drawn, studied
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.files import output_folder
from spidar_gym.paper import ablation_study
from spidar_gym.processes import cpu_count
from spidar_gym.text import format_table


def ablations(
    out: Path = Path("out/ablations"), scenarios: int = SCENARIOS, workers: int = cpu_count(), json: JsonArg = False
) -> None:
    """Take each part from the best controllers of flight and ground, one at a time; goes on where it stopped.

    All tracks of both, in pairs with the whole controller: how many times its error.

    Args:
        out: Folder for ablations.json, ablations.png and ablations.pdf.
        scenarios: Test scenarios of each track; all 50 take some half an hour on two cores.
        workers: Processes.
    """
    require_least(1, workers=workers)
    if not 1 <= scenarios <= SCENARIOS:
        raise InvalidValueError("scenarios", scenarios, f"1 … {SCENARIOS}")
    folder = output_folder(out)
    rows = studied(
        folder, "ablations", "track", len(ablation_study.jobs(scenarios)), json=json,
        play=lambda unfinished, on_job: ablation_study.study(
            scenarios=scenarios, workers=workers, folder=unfinished, on_job=on_job
        ),
        table=lambda found: format_table(ablation_study.ablation_lines(found)),
    )  # fmt: skip
    drawn("figure", lambda: viz.ablation_figure(rows, folder / "ablations.png"))
