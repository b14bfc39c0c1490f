"""`python -m spidar_gym.studies`: the studies beyond the paper, with one subcommand per study."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from spidar_gym import margins as legs
from spidar_gym import viz
from spidar_gym.arguments import CrawlPresetArg, Flag, FlightPresetArg, JsonArg, choice
from spidar_gym.benchmark.track import SCENARIOS, SPLITS
from spidar_gym.console import drawn, goes_on, kept, named_steps, progress, published, run_cli, studied
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError, require_least, require_within
from spidar_gym.files import output_folder, write_text
from spidar_gym.paper.calibration import require_world
from spidar_gym.processes import cpu_count
from spidar_gym.robot import FORMS, N_ROTORS
from spidar_gym.sim.disturbances import FAULTS, Disturbances
from spidar_gym.sim.randomize import check_strength
from spidar_gym.studies import ablations as ablation_study
from spidar_gym.studies import calibrate as calibration
from spidar_gym.studies import drift as drifts
from spidar_gym.studies import energy as energies
from spidar_gym.studies import flights as flight_study
from spidar_gym.studies import frontier as frontier_study
from spidar_gym.studies import gates as gate_study
from spidar_gym.studies import hidden as hidden_study
from spidar_gym.studies import hops as hop_study
from spidar_gym.studies import lost as lost_study
from spidar_gym.studies import margins as margin_study
from spidar_gym.studies import reality as reality_study
from spidar_gym.studies import sagging as sagging_study
from spidar_gym.studies import searches as search_study
from spidar_gym.studies import steps as step_study
from spidar_gym.tasks.hover import RANGES
from spidar_gym.text import format_table

app = tyro.extras.SubcommandApp()
T = TypeVar("T")
SLOWEST, FASTEST = 0.01, 100.0
"""Range of the factors on the bandwidth in the study frontier."""


def _distinct(name: str, values: tuple[T, ...]) -> tuple[T, ...]:
    """Return the values of an option without repetitions, in order (`InvalidValueError` if there are none)."""
    if not values:
        raise InvalidValueError(name, [], "at least one value")
    return tuple(dict.fromkeys(values))


def _require_scenarios(scenarios: int) -> None:
    """Raise `InvalidValueError` for a number of scenarios that a track does not have."""
    if not 1 <= scenarios <= SCENARIOS:
        raise InvalidValueError("scenarios", scenarios, f"1 … {SCENARIOS}")


@app.command
def lost(preset: FlightPresetArg = "paper", out: Path = Path("out/lost"), json: JsonArg = False) -> None:
    """Fail each rotor in each form, in thrust or in vectoring: static feasibility of a hover, and a simulated flight.

    Args:
        preset: Controller preset.
        out: Folder for lost.json.
    """
    controller_config(preset)  # raises for an unknown name
    folder = output_folder(out)
    with progress(total=len(FAULTS) * len(FORMS) * N_ROTORS, unit="flight", desc="lost") as bar:
        rows = lost_study.lost_rotors(preset, on_flight=bar.update)
    print(published(folder, "lost", {"lost_rotors": rows}, format_table(lost_study.lost_lines(rows)), json))


@app.command
def hops(
    robots: int = 100,
    strength: float = hop_study.STRENGTH,
    wind: float = hop_study.WIND,
    world: str = "",
    preset: FlightPresetArg = hop_study.PRESET,
    out: Path = Path("out/hops"),
    workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Take off to 1 m and land: nominal robots with noisy sensors, and randomised robots in wind; resumable.

    Args:
        robots: Number of robots of each kind; one takes 11 s of simulated time, about 0.5 s of CPU time.
        strength: Strength of the randomisation, 0 … 1.
        wind: Mean wind speed for the randomised robots [m/s].
        world: Calibrated world, calibrated_1, whose robots hop as well, each variant of the hardware in a column.
        preset: Preset of the flight controller.
        out: Folder for hops.json.
        workers: Number of processes.
    """
    require_least(1, robots=robots, workers=workers)
    check_strength(strength)
    Disturbances(wind=wind)  # raises for a wind out of range
    studied(
        output_folder(out), "hops", "hop", hop_study.hop_count(robots, world), json=json,
        play=lambda unfinished, on_hop: hop_study.hop_study(
            robots, strength=strength, wind=wind, world=world, preset=preset, workers=workers, folder=unfinished,
            on_hop=on_hop,
        ),
        table=lambda rows: format_table(hop_study.hop_lines(rows)),
    )  # fmt: skip


@app.command
def hidden(
    robots: int = 20, world: str = hidden_study.WORLD, again: Path | None = None, out: Path = Path("out/hidden"),
    threads: int = cpu_count(), json: JsonArg = False,
) -> None:  # fmt: skip
    """Identify robots whose parameters are sealed, from the logs of their tests, and compare afterwards; resumable.

    Args:
        robots: Number of robots, sampled with a seed of the operating system; one takes about 4 minutes of one core.
        world: Calibrated world, or one kind of its robots.
        again: File hidden.json of a former result, whose robots are identified once more.
        out: Folder for logs, reports, their hashes, the sealed parameters, and hidden.json.
        threads: Threads of an identification.
    """
    require_least(1, robots=robots, threads=threads)
    require_world(world.partition(":")[0])
    folder = output_folder(out)
    with progress(total=2 * robots, unit="step", desc="hidden") as bar, kept(goes_on(bar, folder)):
        rows = hidden_study.hidden(folder, robots, world=world, again=again, threads=threads, on_step=named_steps(bar))
    print(published(folder, "hidden", {"hidden": rows}, format_table(hidden_study.hidden_lines(rows)), json))


@app.command
def searches(
    hidden: Path = Path("out/hidden"), robots: int = 3, generations: int = 12, scenarios: int = 1,
    workers: int = cpu_count(), out: Path = Path("out/searches"), json: JsonArg = False,
) -> None:  # fmt: skip
    """Tune a controller on identified robots of the study hidden and twice on the true ones, and compare; resumable.

    Args:
        hidden: Folder of the study hidden, with its reports; it keeps the searches.
        robots: Number of its robots, from the first.
        generations: Generations of each of three searches per robot; one takes half a minute of one core.
        scenarios: Scenarios per track of the searches; the comparison has twice as many.
        workers: Number of processes.
        out: Folder for searches.json.
    """
    require_least(1, robots=robots, generations=generations, scenarios=scenarios, workers=workers)
    folder, total = output_folder(out), search_study.steps_of(robots, generations)
    with progress(total=total, unit="play", desc="searches") as bar, kept(goes_on(bar, hidden)):
        rows = search_study.searches(
            hidden, robots, generations=generations, scenarios=scenarios, workers=workers, on_step=bar.update
        )
    print(published(folder, "searches", {"searches": rows}, format_table(search_study.search_lines(rows)), json))


@app.command
def gates(out: Path = Path("out/gates"), seeds: int = 4, workers: int = cpu_count(), json: JsonArg = False) -> None:
    """Sweep the size of every kind of gate of Course-v0 until each gait fails; resumable.

    The sizes are heights of walls, platforms and tiles [m], clearances under beams [m], widths of slots [m], and angles
    of slopes [rad]. The gaits are the rule with both gaits, flight only, in form 1 and in form 3, and crawl only.
    Robots are randomised.

    Args:
        out: Folder for gates.json and gates.png.
        seeds: Number of randomised robots per gate and gait; 4 take about 35 minutes on two cores.
        workers: Number of processes.
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
    """Sweep the height of tiles and stairs until each gait fails, with default and higher foot lift; resumable.

    The goal is 0.8 m ahead. Robots are randomised at strength 0.3 and have noisy sensors. Success is that of Crawl-v0.

    Args:
        gaits: Crawler presets, or MODULE:CLASS of policies that only select a controller.
        out: Folder for steps.json and steps.png.
        seeds: Number of randomised robots per floor and gait; 4 take about 20 minutes on two cores.
        workers: Number of processes.
    """
    require_least(1, seeds=seeds, workers=workers)
    chosen = _distinct("gaits", gaits)
    for gait in chosen:
        step_study.controller_of(gait)  # raises for an unknown gait before anything is written
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
    """Remove each part of the best controllers of flight and crawl, one at a time; resumable.

    The result is the ratio of the errors to those of the complete controller, on all tracks of flight and ground.

    Args:
        out: Folder for ablations.json and ablations.png.
        scenarios: Number of test scenarios per track; all 50 take about half an hour on two cores.
        workers: Number of processes.
    """
    require_least(1, workers=workers)
    _require_scenarios(scenarios)
    folder = output_folder(out)
    rows = studied(
        folder, "ablations", "track", len(ablation_study.jobs(scenarios)), json=json,
        play=lambda unfinished, on_job: ablation_study.study(
            scenarios=scenarios, workers=workers, folder=unfinished, on_job=on_job
        ),
        table=lambda found: format_table(ablation_study.ablation_lines(found)),
    )  # fmt: skip
    drawn("figure", lambda: viz.ablation_figure(rows, folder / "ablations.png"))


@app.command
def calibrate(
    name: str = "calibrated_1", robots: int = calibration.ROBOTS, blind: Flag = False, profile: Flag = False,
    write: Flag = False, out: Path = Path("out/calibrate"), workers: int = cpu_count(), json: JsonArg = False,
) -> None:  # fmt: skip
    """Fit the mixtures of a calibrated world to the errors of the paper's flight; resumable.

    Args:
        name: Name of the world.
        robots: Number of robots per mixture and round; one takes 60 s of simulated time, about 0.4 s of CPU time.
        blind: Instead, fit without the error in z and without the figures of the crawl; predict them with the study
            reality and the file that this writes.
        profile: Instead, fit one mixture at several values of the parameters that trade off with its levers.
        write: Copy the file to assets/worlds and pin its hash; refused where the name exists with other ranges.
        out: Folder for NAME.toml and calibrate.json.
        workers: Number of processes.
    """
    require_least(2, robots=robots)
    require_least(1, workers=workers)
    if write and (blind or profile):
        raise InvalidValueError("write", write, "False with blind or profile: these fits are no worlds")
    folder = output_folder(out)
    how: dict[str, Any] = {"robots": robots, "workers": workers}

    def play(unfinished: Path, on_flight: Callable[[], object]) -> list[dict[str, Any]]:
        if profile:
            return calibration.profile(unfinished, **how, on_flight=on_flight)
        if blind:
            rows = calibration.blind_fit(unfinished, **how, on_flight=on_flight)
        else:
            rows = calibration.fit(name, unfinished, **how, on_flight=on_flight)
        found = "blind" if blind else name
        write_text(folder / f"{found}.toml", (unfinished / f"{found}.toml").read_text(encoding="utf-8"))
        return rows

    lines = calibration.profile_lines if profile else calibration.fit_lines
    title = "profiles" if profile else "blind" if blind else "calibrate"
    studied(folder, title, "flight", 0, json=json, play=play, table=lambda rows: format_table(lines(rows)))
    if write:
        print(f"written: {calibration.write_world(folder / f'{name}.toml', name)}")


@app.command
def reality(
    world: str = "calibrated_1", robots: int = 200, out: Path = Path("out/reality"), workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:  # fmt: skip
    """Simulate the paper's flight and crawl with robots of a calibrated world, beside the published figures; resumable.

    Args:
        world: Name or file of a calibrated world.
        robots: Number of robots of each mixture and experiment; 200 take about 10 minutes on two cores.
        out: Folder for reality.json.
        workers: Number of processes.
    """
    require_least(8, robots=robots)
    require_least(1, workers=workers)
    mixtures = len(require_world(world).mixtures)
    studied(
        output_folder(out), "reality", "run", len(reality_study.EXPERIMENTS) * mixtures * robots, json=json,
        play=lambda unfinished, on_run: reality_study.measure(
            world, robots=robots, workers=workers, folder=unfinished, on_run=on_run
        ),
        table=lambda rows: format_table(reality_study.reality_lines(rows)),
    )  # fmt: skip


@app.command
def margins(
    controllers: tuple[str, ...] = margin_study.CONTROLLERS,
    check: Flag = False,
    store: Flag = False,
    world: str = legs.WORLD,
    robots: int = legs.ROBOTS,
    out: Path = Path("out/margins"),
    workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Compute margins of flight controllers with legs that bend, worst over calibrated robots and forms; resumable.

    Args:
        controllers: Presets, or policies module:Class that have a flight controller; one takes about a minute.
        check: Instead, compare the gains at which the linear model has growing modes with those at which the simulated
            robot swings and falls: 72 cases, about 15 minutes on two cores; without controllers, world and robots.
        store: Instead, compute the margins of all presets, and write those that an export reads, in a checkout; without
            check, controllers, world and robots.
        world: Name or file of a calibrated world.
        robots: Number of its robots, its kinds in turn.
        out: Folder for leg_margins.json, or leg_falls.json.
        workers: Number of processes.
    """
    require_least(1, robots=robots, workers=workers)
    require_world(world)
    chosen = _distinct("controllers", controllers)
    if store and check:
        raise InvalidValueError("store", store, "False with check")
    if store or check:
        defaults = {"controllers": margin_study.CONTROLLERS, "world": legs.WORLD, "robots": legs.ROBOTS}
        for name, value in {"controllers": controllers, "world": world, "robots": robots}.items():
            if value != defaults[name]:
                raise InvalidValueError(
                    name, value, f"no value with {'store' if store else 'check'}, which has its own"
                )
    else:
        for name in chosen:
            legs.law_of(name)  # raises for an unknown controller before anything is written
    if store:
        write_text(legs.MARGINS, legs.margins_text())
        print(f"{legs.MARGINS} written")
        return
    folder = output_folder(out)
    if check:
        studied(
            folder, "leg_falls", "case", len(margin_study.cases()), json=json,
            play=lambda unfinished, on_done: margin_study.check_study(
                workers=workers, folder=unfinished, on_done=on_done
            ),
            table=lambda rows: f"{format_table(margin_study.check_lines(rows))}\n{margin_study.summary(rows)}",
        )  # fmt: skip
        return
    studied(
        folder, "leg_margins", "controller", len(chosen), json=json,
        play=lambda unfinished, on_done: margin_study.margin_study(
            chosen, world, robots, workers=workers, folder=unfinished, on_done=on_done
        ),
        table=lambda rows: format_table(legs.leg_lines(rows)),
    )  # fmt: skip


@app.command
def frontier(
    controllers: tuple[str, ...] = frontier_study.CONTROLLERS,
    scales: tuple[float, ...] = frontier_study.SCALES,
    out: Path = Path("out/frontier"),
    workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Measure errors and worst margins of flight controllers on calibrated robots, slower and faster; resumable.

    Args:
        controllers: Presets, or policies module:Class that only have gains.
        scales: Factors on the bandwidth, 0.01 … 100; a controller at one scale takes about a minute of CPU time.
        out: Folder for frontier.json and frontier.png.
        workers: Number of processes.
    """
    require_least(1, workers=workers)
    chosen = _distinct("controllers", controllers)
    factors = _distinct("scales", scales)
    for factor in factors:
        require_within(SLOWEST, FASTEST, scales=factor)
    for name in chosen:
        frontier_study.scalable(name)  # raises for an unknown controller before anything is written
    folder = output_folder(out)
    rows = studied(
        folder, "frontier", "point", len(chosen) * len(factors), json=json,
        play=lambda unfinished, on_done: frontier_study.frontier_study(
            chosen, factors, workers=workers, folder=unfinished, on_done=on_done
        ),
        table=lambda found: format_table(frontier_study.frontier_lines(found)),
    )  # fmt: skip
    drawn("figure", lambda: viz.frontier_figure(rows, folder / "frontier.png"))


@app.command
def flights(
    controllers: tuple[str, ...] = flight_study.CONTROLLERS,
    joint_speeds: tuple[float, ...] = flight_study.JOINT_SPEEDS,
    robots: int = 200,
    out: Path = Path("out/flights"),
    workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Count falls of calibrated robots with flight controllers, and compare errors in the same flights; resumable.

    Args:
        controllers: Presets, or policies module:Class; the first one is compared with the others.
        joint_speeds: Joint speeds [rad/s].
        robots: Number of flights of each controller at each speed; one takes a second of CPU time.
        out: Folder for flights.json.
        workers: Number of processes.
    """
    require_least(1, robots=robots, workers=workers)
    chosen = _distinct("controllers", controllers)
    speeds = _distinct("joint_speeds", joint_speeds)
    low, high, unit = RANGES["joint_speed"]
    for speed in speeds:
        require_within(low, high, unit, joint_speeds=speed)
    for name in chosen:
        flight_study.policy_of(name)  # raises for an unknown controller before anything is written
    studied(
        output_folder(out), "flights", "flight", len(chosen) * len(speeds) * robots, json=json,
        play=lambda unfinished, on_flight: flight_study.flight_study(
            chosen, speeds, robots, workers=workers, folder=unfinished, on_flight=on_flight
        ),
        table=lambda found: format_table(flight_study.flight_lines(found)),
    )  # fmt: skip


@app.command
def drift(
    preset: CrawlPresetArg = "steady_crawl",
    split: Annotated[str, choice(SPLITS)] = "test",
    scenarios: int = SCENARIOS,
    out: Path = Path("out/drift"),
    workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Compare where crawls of calibrated robots end with where the robot sees itself, and with its legs; resumable.

    Args:
        preset: Preset of the crawler.
        split: Scenarios of the calibrated ground track to use.
        scenarios: Number of scenarios, from the first; one takes about four seconds of CPU time.
        out: Folder for drift.json.
        workers: Number of processes.
    """
    require_least(1, workers=workers)
    _require_scenarios(scenarios)
    studied(
        output_folder(out), "drift", "crawl", scenarios, json=json,
        play=lambda unfinished, on_crawl: drifts.drift_study(
            preset, split, scenarios, workers=workers, folder=unfinished, on_crawl=on_crawl
        ),
        table=lambda found: format_table(drifts.drift_lines(found)),
    )  # fmt: skip


@app.command
def energy(
    crawlers: tuple[str, ...] = energies.CRAWLERS,
    preset: FlightPresetArg = energies.FLIGHT,
    robots: int = 6,
    out: Path = Path("out/energy"),
    workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Measure the energy a metre of flight and crawl, and of take-off and landing; resumable.

    Args:
        crawlers: Presets on the ground, each at three joint speeds.
        preset: Preset in the air, along a path at four speeds.
        robots: Number of robots, randomised at strength 0.3, of each; 6 take about two minutes of CPU time.
        out: Folder for energy.json and energy.png.
        workers: Number of processes.
    """
    require_least(1, robots=robots, workers=workers)
    chosen = _distinct("crawlers", crawlers)
    folder = output_folder(out)
    rows = studied(
        folder, "energy", "run", len(energies.runs(chosen, preset, robots)) * robots, json=json,
        play=lambda unfinished, on_run: energies.energy_study(
            chosen, preset, robots, workers=workers, folder=unfinished, on_run=on_run
        ),
        table=lambda found: format_table(energies.energy_lines(found)),
    )  # fmt: skip
    drawn("figure", lambda: viz.energy_figure(rows, folder / "energy.png"))


@app.command
def sagging(
    payloads: tuple[float, ...] = sagging_study.PAYLOADS,
    robots: int = 4,
    out: Path = Path("out/sagging"),
    workers: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Fly fast with a nearly empty battery, with λ̄ that follows the voltage and without; resumable.

    Args:
        payloads: Masses that the torso carries [kg].
        robots: Number of robots for each; a course takes about ten seconds of CPU time.
        out: Folder for sagging.json.
        workers: Number of processes.
    """
    require_least(1, robots=robots, workers=workers)
    chosen = _distinct("payloads", payloads)
    for payload in chosen:
        require_within(0.0, 10.0, "kg", payloads=payload)
    studied(
        output_folder(out), "sagging", "course", len(sagging_study.sagging_courses(chosen, robots)), json=json,
        play=lambda unfinished, on_course: sagging_study.sagging_study(
            chosen, robots, workers=workers, folder=unfinished, on_course=on_course
        ),
        table=lambda rows: format_table(sagging_study.sagging_lines(rows)),
    )  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; an error prints one line on stderr and exits with status 2, Ctrl-C with 130."""
    name = "python -m spidar_gym.studies"
    run_cli(name, lambda: app.cli(prog=name, description="Studies beyond the paper.", args=arguments))


if __name__ == "__main__":
    main()
