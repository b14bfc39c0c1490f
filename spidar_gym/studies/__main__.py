"""`python -m spidar_gym.studies`: the studies beyond the paper, one subcommand each."""

from pathlib import Path

import tyro

from spidar_gym import viz
from spidar_gym.arguments import FlightPresetArg, JsonArg
from spidar_gym.benchmark.track import SCENARIOS
from spidar_gym.console import drawn, progress, published, run_cli, studied
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.files import output_folder
from spidar_gym.processes import cpu_count
from spidar_gym.robot import FORMS, N_ROTORS
from spidar_gym.sim.disturbances import FAULTS, Disturbances
from spidar_gym.sim.randomize import check_strength
from spidar_gym.studies import ablations as ablation_study
from spidar_gym.studies import gates as gate_study
from spidar_gym.studies import hops as hop_study
from spidar_gym.studies import lost as lost_study
from spidar_gym.studies import steps as step_study
from spidar_gym.text import format_table

app = tyro.extras.SubcommandApp()


@app.command
def lost(preset: FlightPresetArg = "paper", out: Path = Path("out/lost"), json: JsonArg = False) -> None:
    """Lose each rotor in each form, its thrust or its vectoring: what statics allows and what flight shows.

    Args:
        preset: Controller.
        out: Folder for lost.json.
    """
    controller_config(preset)  # refuses an unknown name
    folder = output_folder(out)
    with progress(total=len(FAULTS) * len(FORMS) * N_ROTORS, unit="flight", desc="lost") as bar:
        rows = lost_study.lost_rotors(preset, on_flight=bar.update)
    print(published(folder, "lost", {"lost_rotors": rows}, format_table(lost_study.lost_lines(rows)), json))


@app.command
def hops(
    robots: int = 100,
    strength: float = hop_study.STRENGTH,
    wind: float = hop_study.WIND,
    out: Path = Path("out/hops"),
    workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Take off to 1 m and land again: nominal robots with sensor noise, and randomised robots in wind. Resumes.

    Args:
        robots: Robots of either kind; a hop takes 11 s of simulated time, about half a second of processor time.
        strength: Strength of the randomisation, 0 … 1.
        wind: Mean wind of the randomised robots [m/s].
        out: Folder for hops.json.
        workers: Processes.
    """
    require_least(1, robots=robots, workers=workers)
    check_strength(strength)
    Disturbances(wind=wind)  # refuses a wind out of range
    studied(
        output_folder(out), "hops", "hop", 2 * robots, json=json,
        play=lambda unfinished, on_hop: hop_study.hop_study(
            robots, strength=strength, wind=wind, workers=workers, folder=unfinished, on_hop=on_hop
        ),
        table=lambda rows: format_table(hop_study.hop_lines(rows)),
    )  # fmt: skip


@app.command
def gates(out: Path = Path("out/gates"), seeds: int = 4, workers: int = cpu_count(), json: JsonArg = False) -> None:
    """Sweep the size of every kind of gate of Course-v0 until each gait fails. Resumes.

    Heights of walls, platforms and tiles [m], clearance under beams [m], width of slots [m], angle of slopes [rad].
    At each gate: the rule, flying alone in form 1 and in form 3, and crawling alone. Robots are randomised.

    Args:
        out: Folder for gates.json and gates.png.
        seeds: Randomised robots at each gate; 4 take about 35 minutes on two cores.
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


@app.command
def steps(
    gaits: tuple[str, ...] = step_study.GAITS, out: Path = Path("out/steps"), seeds: int = 4,
    workers: int = cpu_count(), json: JsonArg = False,
) -> None:  # fmt: skip
    """Sweep the height of tiles and stairs until each gait fails, with its own foot lift and a higher one. Resumes.

    The goal is 0.8 m ahead; robots are randomised at strength 0.3 and have sensors; success is that of Crawl-v0.

    Args:
        gaits: Presets of the crawl, or MODULE:CLASS of policies that are a controller.
        out: Folder for steps.json and steps.png.
        seeds: Randomised robots on each floor; 4 take about 20 minutes on two cores.
        workers: Processes.
    """
    require_least(1, seeds=seeds, workers=workers)
    chosen = tuple(dict.fromkeys(gaits))
    for gait in chosen:
        step_study.controller_of(gait)  # refuses an unknown one before anything is written
    folder = output_folder(out)
    rows = studied(
        folder, "steps", "run", len(step_study.cells(chosen)) * seeds, json=json,
        play=lambda unfinished, on_run: step_study.sweep(
            chosen, seeds=seeds, workers=workers, folder=unfinished, on_run=on_run
        ),
        table=lambda found: format_table(step_study.step_lines(found)),
    )  # fmt: skip
    drawn("figure", lambda: viz.step_figure(rows, folder / "steps.png"))


@app.command
def ablations(
    out: Path = Path("out/ablations"), scenarios: int = SCENARIOS, workers: int = cpu_count(), json: JsonArg = False
) -> None:
    """Remove each part from the best controllers of flight and ground, one at a time. Resumes.

    All tracks of both, in pairs with the whole controller: the ratio of the errors.

    Args:
        out: Folder for ablations.json and ablations.png.
        scenarios: Test scenarios of each track; all 50 take about half an hour on two cores.
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


def main(arguments: list[str] | None = None) -> None:
    """Entry point: an error is one line on stderr and exit status 2; Ctrl-C is 130."""
    name = "python -m spidar_gym.studies"
    run_cli(name, lambda: app.cli(prog=name, description="Studies beyond the paper.", args=arguments))


if __name__ == "__main__":
    main()
