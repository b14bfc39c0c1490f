"""`spidar paper`: the paper's experiments and further comparisons."""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from spidar_gym import viz
from spidar_gym.arguments import CameraArg, CrawlPresetArg, Flag, FlightPresetArg, JsonArg
from spidar_gym.console import drawn, progress, published, studied
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.errors import InvalidValueError, require_least, require_name, require_within
from spidar_gym.files import output_folder
from spidar_gym.paper import crawl as crawl_experiment
from spidar_gym.paper import crawl_study
from spidar_gym.paper import flight as experiments
from spidar_gym.paper import flight_studies as studies
from spidar_gym.paper.calibration import CRAWL, FLIGHT, calibrated_figures
from spidar_gym.paper.trial import CONDITIONS
from spidar_gym.processes import cpu_count
from spidar_gym.sim.renderer import require_pictures
from spidar_gym.sim.stage import FIXED, VIEWS
from spidar_gym.tasks.crawl import RANGES
from spidar_gym.text import format_table

CALIBRATED = "calibrated_1"
"""World of the calibrated robots."""
paper_app = tyro.extras.SubcommandApp()


@dataclass(frozen=True)
class Options:
    """Options of both experiments."""

    camera: CameraArg = FIXED
    json: JsonArg = False
    video: bool = True
    """Record a video, which takes about two minutes."""
    noise: Flag = False
    """Simulate noisy sensors, unequal rotors and a delay of 20 ms, in the crawl 25 ms and offsets of joint zeros."""
    seed: int = 0
    """Seed of --noise."""
    robots: int = 24
    """Number of robots of the calibrated world for a column of medians; 0 for none."""

    def __post_init__(self) -> None:
        require_least(0, seed=self.seed, robots=self.robots)
        require_name("camera", self.camera, VIEWS)


OptionsArg = Annotated[Options, tyro.conf.arg(name="")]


@paper_app.command(name="both", is_default=True)
def both(out: Path = Path("out"), video: bool = True, noise: Flag = False) -> None:
    """Simulate the paper's flight and crawl, and print our figures beside the paper's.

    Args:
        out: Output folder, with the folders flight and crawl.
        video: Record a video of each, which takes about two minutes.
        noise: Simulate noisy sensors, delay and unequal rotors.
    """
    options = Options(video=video, noise=noise)
    flight(out=out / "flight", options=options)
    print()
    crawl(out=out / "crawl", options=options)


@paper_app.command
def flight(
    preset: FlightPresetArg = "as_flown",
    out: Path = Path("out/flight"),
    options: OptionsArg = Options(),
    speeds: Flag = False,
    ablation: Flag = False,
    scenarios: int = 24,
    workers: int = cpu_count(),
) -> None:
    """Simulate the paper's flight experiment (40 s, forms 1, 2, 3) and print our figures beside the paper's.

    Args:
        preset: as_flown is the controller of the real flight, paper has the paper's cost and constraints.
            as_flown_quasi computes the CoG's velocity without the joints, as the lab's estimator does.
            tuned and retuned extend paper.
        out: Folder for flight.json, flight.png and flight.mp4; with --speeds, for speeds.json and speeds.png.
        speeds: Instead, compare preset tuned with paper in random asymmetric forms at joint speeds 0.2 … 1.0 rad/s.
        ablation: Instead, compare them at 0.2, 0.6 and 1.0 rad/s, also with each option of tuned switched off.
        scenarios: Number of flights per cell of --speeds or --ablation.
        workers: Number of processes for the calibrated robots, --speeds or --ablation.
    """
    require_least(1, scenarios=scenarios, workers=workers)
    if speeds or ablation:
        _speeds(output_folder(out), options.json, ablation, scenarios, workers)
        return
    controller_config(preset)  # raises for an unknown name
    folder = output_folder(out)
    video = options.video and drawn("video", require_pictures)
    with progress(total=experiments.FLIGHT_TICKS, unit="tick", desc=f"flight, {preset}") as bar:
        log = experiments.fly_paper(preset, noise=options.noise, seed=options.seed, on_tick=bar.update)
    figures = experiments.flight_figures(log)
    noisy = None
    if not options.noise:
        with progress(total=experiments.FLIGHT_TICKS, unit="tick", desc="with noise") as bar:
            other = experiments.fly_paper(preset, noise=True, seed=options.seed, on_tick=bar.update)
        noisy = experiments.flight_figures(other)
    calibrated = _calibrated(FLIGHT, preset, options.robots, workers)
    result = {
        "flight": figures, "noisy": noisy, "calibrated": calibrated, "paper": {"flight": experiments.PAPER_FLIGHT}
    }  # fmt: skip
    lines = experiments.flight_lines(figures, noisy, calibrated)
    text = published(folder, "flight", result, format_table(lines), options.json)
    # After the flight, so that drawing does not affect the measured solve times.
    drawn("figure", lambda: viz.flight_figure(log, folder / "flight.png"))
    if video:
        drawn("video", lambda: _film(viz.flight_take(log), folder / "flight.mp4", options.camera))
    _report(text, folder, "flight.*", options.json)


def _calibrated(experiment: str, preset: str, robots: int, workers: int) -> dict[str, Any] | None:
    """Simulate an experiment with calibrated robots."""
    if not robots:
        return None
    with progress(total=robots, unit="robot", desc="calibrated robots") as bar:
        return calibrated_figures(experiment, preset, CALIBRATED, robots=robots, workers=workers, on_run=bar.update)


def _report(text: str, folder: Path, pattern: str, json: bool) -> None:
    """Print the text and, unless it is JSON, the names of the written files."""
    print(text)
    if not json:
        print(f"\nwritten to {folder}: {', '.join(sorted(p.name for p in folder.glob(pattern)))}")


def _speeds(folder: Path, json: bool, ablation: bool, scenarios: int, workers: int) -> None:
    """Compare controllers over joint speeds; writes JSON and a figure, and prints the table."""
    name = "ablation" if ablation else "speeds"
    joint_speeds = studies.SPEEDS if ablation else studies.MANY_SPEEDS
    rows = studied(
        folder, name, "flight",
        len(CONDITIONS) * len(joint_speeds) * len(studies.controllers(ablation)) * scenarios,
        json=json,
        play=lambda unfinished, on_flight: studies.speed_study(
            speeds=joint_speeds, count=scenarios, ablation=ablation, workers=workers, folder=unfinished,
            on_flight=on_flight,
        ),
        table=lambda rows: format_table(studies.speed_lines(rows), left=3),
    )  # fmt: skip
    if not ablation:
        drawn("figure", lambda: viz.speed_figure(rows, folder / "speeds.png"))


def _film(take: viz.Take, path: Path, camera: str) -> None:
    viz.film_take(take, path, camera=camera, frames=partial(progress, unit="frame", desc="video"))


def _crawl_study(folder: Path, json: bool, draws: int, seeds: int, workers: int) -> None:
    """Run the crawl study; writes JSON, and prints the table."""
    cases = crawl_study.RANDOM_CASES if draws else crawl_study.CASES
    numbers = range(1000, 1000 + draws) if draws else range(seeds)
    studied(
        folder, "draws" if draws else "study", "crawl", len(cases) * len(numbers), json=json,
        play=lambda unfinished, on_run: crawl_study.run_cases(
            cases, numbers, workers=workers, folder=unfinished, on_run=on_run
        ),
        table=crawl_study.study_table,
    )  # fmt: skip


def _crawled(preset: str, options: dict[str, Any]) -> crawl_experiment.CrawlLog:
    """Run the crawl experiment with a progress bar of the planned length, extended tick by tick when it is slower."""
    with progress(unit="tick", desc=f"crawl, {preset}") as bar:

        def on_tick(planned: int) -> None:
            bar.total = max(planned, bar.n + 1)
            bar.update()

        return crawl_experiment.crawl_paper(preset, **options, on_tick=on_tick)


@paper_app.command
def crawl(
    preset: CrawlPresetArg = "published",
    out: Path = Path("out/crawl"),
    options: OptionsArg = Options(),
    overlapped: Flag = False,
    speed: float | None = None,
    distance: float = crawl_experiment.CRAWL_DISTANCE,
    direction: float = 0.0,
    turn: float = 0.0,
    power: Flag = False,
    study: Flag = False,
    draws: int = 0,
    seeds: int = 6,
    workers: int = cpu_count(),
) -> None:
    """Simulate the paper's crawl experiment (0.6 m, 3 cycles of 0.2 m) and print our figures beside the paper's.

    Args:
        preset: published is the paper's gait, overlapped the same gait with overlapping phases.
            robust has margins for other robots and floors, steady_crawl is the recommended crawler.
        out: Folder for crawl.json, crawl.png, cycle.png and crawl.mp4.
        overlapped: The same as --preset overlapped.
        speed: Joint speed [rad/s]; the preset's 0.2 if not given.
        distance: Distance to the goal [m].
        direction: Direction of the goal, 0 ahead, 90 to the left [degrees; radians in gymnasium.make].
        turn: Change of heading from start to goal [degrees; radians in gymnasium.make].
        power: Minimise electrical power instead of the sum of squared forces.
        study: Instead, run a study of directions, speeds, floors and weak actuators, each with --seeds noisy robots.
        draws: Instead, compare published and robust on this number of robots and goals sampled at strength 1.
        seeds: Number of crawls per case of --study.
        workers: Number of processes for the calibrated robots, --study and --draws.
    """
    require_least(0, draws=draws)
    require_least(1, seeds=seeds, workers=workers)
    crawler_config(preset)  # raises for an unknown name
    if not (math.isfinite(direction) and math.isfinite(turn)):
        raise InvalidValueError("direction, turn", (direction, turn), "finite numbers [degrees]")
    for name, angle in (("direction", direction), ("turn", turn)):
        low, high, _ = RANGES[name]
        require_within(math.degrees(low), math.degrees(high), "degrees", **{name: angle})
    if overlapped:
        preset = "overlapped"
    where: dict[str, Any] = dict(
        distance=distance, direction=math.radians(direction), turn=math.radians(turn), joint_speed=speed
    )
    # Refuses infeasible goals before anything is written.
    crawl_experiment.check_way(preset, **where)
    folder = output_folder(out)
    if study or draws:
        _crawl_study(folder, options.json, draws, seeds, workers)
        return
    video = options.video and drawn("video", require_pictures)
    how: dict[str, Any] = dict(**where, power=power, noise=options.noise, seed=options.seed)
    log = _crawled(preset, how)
    fast = log if preset == "overlapped" else _crawled("overlapped", how)
    figures = crawl_experiment.crawl_figures(log, fast)
    is_paper = where == {
        "distance": crawl_experiment.CRAWL_DISTANCE,
        "direction": 0.0,
        "turn": 0.0,
        "joint_speed": None,
    }
    noisy = calibrated = None
    if is_paper and not power:
        if not options.noise:
            noisy = crawl_experiment.crawl_figures(_crawled(preset, {**how, "noise": True}))
        calibrated = _calibrated(CRAWL, preset, options.robots, workers)
    result = {
        "crawl": figures, "noisy": noisy, "calibrated": calibrated, "paper": {"crawl": crawl_experiment.PAPER_CRAWL}
    }  # fmt: skip
    lines = crawl_experiment.crawl_lines(figures, noisy, calibrated)
    text = published(folder, "crawl", result, format_table(lines), options.json)
    drawn("figure", lambda: viz.crawl_figure(log, folder / "crawl.png"))
    drawn("strip", lambda: viz.crawl_strip(log, folder / "cycle.png"))
    if video:
        drawn("video", lambda: _film(viz.crawl_take(log), folder / "crawl.mp4", options.camera))
    _report(text, folder, "c*.*", options.json)
