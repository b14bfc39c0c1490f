"""`spidar paper`: the paper's experiments and the comparisons that go beyond them."""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from spidar_gym import viz
from spidar_gym.cli.arguments import CameraArg, CrawlPresetArg, Flag, FlightPresetArg, JsonArg
from spidar_gym.cli.console import drawn, progress, published, studied
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.errors import InvalidValueError, require_least, require_name, require_within
from spidar_gym.files import output_folder
from spidar_gym.paper import crawl as crawl_experiment
from spidar_gym.paper import crawl_study
from spidar_gym.paper import flight as experiments
from spidar_gym.paper import flight_studies as studies
from spidar_gym.paper.trial import CONDITIONS
from spidar_gym.processes import cpu_count
from spidar_gym.sim.renderer import require_pictures
from spidar_gym.sim.stage import FIXED, VIEWS
from spidar_gym.tasks.crawl import RANGES
from spidar_gym.text import format_table

paper_app = tyro.extras.SubcommandApp()


@dataclass(frozen=True)
class Options:
    """How either experiment is made and shown."""

    camera: CameraArg = FIXED
    json: JsonArg = False
    video: bool = True
    """Film it (about two minutes)."""
    noise: Flag = False
    """With real sensors, unequal rotors and 20 ms of delay; in the crawl 25 ms, and joint zeros that are off."""
    seed: int = 0
    """Seed of that noise."""

    def __post_init__(self) -> None:
        require_least(0, seed=self.seed)
        require_name("camera", self.camera, VIEWS)


OptionsArg = Annotated[Options, tyro.conf.arg(name="")]


@paper_app.command(name="both", is_default=True)
def both(out: Path = Path("out"), video: bool = True, noise: Flag = False) -> None:
    """Fly and crawl the paper's experiments, one after the other, and print our figures beside the paper's.

    Args:
        out: Folder for the folders flight and crawl.
        video: Film them.
        noise: With real sensors, delay and unequal rotors.
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
    """Fly the paper's flight experiment (40 s, forms 1 to 2 to 3) and print our figures beside the paper's.

    Args:
        preset: Controller that flies: as_flown is what the robot flew, paper is the paper's cost and rows, tuned goes
            beyond it.
        out: Folder for flight.json, flight.png and flight.mp4; with --speeds, for speeds.json and speeds.png.
        speeds: Instead, compare preset tuned with paper in random asymmetric forms at joint speeds 0.2 … 1.0 rad/s.
        ablation: Instead, the same at 0.2, 0.6, 1.0 rad/s, and with each option of tuned switched off.
        scenarios: Flights of a cell of --speeds and --ablation.
        workers: Processes for them.
    """
    require_least(1, scenarios=scenarios, workers=workers)
    if speeds or ablation:
        _speeds(output_folder(out), options.json, ablation, scenarios, workers)
        return
    controller_config(preset)  # refuses an unknown name
    folder = output_folder(out)
    video = options.video and drawn("video", require_pictures)
    with progress(total=experiments.FLIGHT_TICKS, unit="tick", desc=f"flight, {preset}") as bar:
        log = experiments.fly_paper(preset, noise=options.noise, seed=options.seed, on_tick=bar.update)
    figures = experiments.flight_figures(log)
    result = {"flight": figures, "paper": {"flight": experiments.PAPER_FLIGHT}}
    text = published(folder, "flight", result, format_table(experiments.flight_lines(figures)), options.json)
    # After the flight, so that drawing does not disturb the times that it reports.
    drawn("figure", lambda: viz.flight_figure(log, folder / "flight.png"))
    if video:
        drawn("video", lambda: _film(viz.flight_take(log), folder / "flight.mp4", options.camera))
    _report(text, folder, "flight.*", options.json)


def _report(text: str, folder: Path, pattern: str, json: bool) -> None:
    """Print the text and, unless it is JSON, which files of a folder belong to it."""
    print(text)
    if not json:
        print(f"\nwritten to {folder}: {', '.join(sorted(p.name for p in folder.glob(pattern)))}")


def _speeds(folder: Path, json: bool, ablation: bool, scenarios: int, workers: int) -> None:
    """Compare controllers over joint speeds: table, JSON and figure."""
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
    """Crawl many cases: table and JSON."""
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
    """Crawl with a bar, as long as the plan; who is slower than planned has always one tick left."""
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
    """Crawl the paper's experiment (0.6 m in 3 cycles of 0.2 m) and print our figures beside the paper's.

    Args:
        preset: Crawler: published is the paper's gait, overlapped the same without waiting, robust our best defaults.
        out: Folder for crawl.json, crawl.png, cycle.png and crawl.mp4.
        overlapped: The same as --preset overlapped.
        speed: Joint speed [rad/s]; the preset's own, 0.2, if not given.
        distance: How far [m].
        direction: Where to, 0 straight ahead, 90 to the left [degrees; radians in gymnasium.make].
        turn: How far the heading turns on the way [degrees; radians in gymnasium.make].
        power: Minimise electrical power instead of the sum of squared forces.
        study: Instead, directions, speeds, floors and weak actuators, each with --seeds noisy robots.
        draws: Instead, so many robots and goals drawn at strength 1, presets published and robust.
        seeds: Crawls a case of --study.
        workers: Processes for --study and --draws.
    """
    require_least(0, draws=draws)
    require_least(1, seeds=seeds, workers=workers)
    crawler_config(preset)  # refuses an unknown name
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
    # What cannot be crawled is refused before anything is written.
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
    result = {"crawl": figures, "paper": {"crawl": crawl_experiment.PAPER_CRAWL}}
    text = published(folder, "crawl", result, format_table(crawl_experiment.crawl_lines(figures)), options.json)
    drawn("figure", lambda: viz.crawl_figure(log, folder / "crawl.png"))
    drawn("strip", lambda: viz.crawl_strip(log, folder / "cycle.png"))
    if video:
        drawn("video", lambda: _film(viz.crawl_take(log), folder / "crawl.mp4", options.camera))
    _report(text, folder, "c*.*", options.json)
