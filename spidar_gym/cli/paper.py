"""`spidar paper`: the paper's experiments and the comparisons that go beyond them."""

import math
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import tyro
from tqdm import tqdm

from spidar_gym import viz
from spidar_gym.cli.arguments import CameraArg, CrawlPresetArg, FlightPresetArg
from spidar_gym.cli.console import goes_on, kept
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.envs.crawl.task import RANGES
from spidar_gym.errors import InvalidValueError, MissingDependencyError, require_least, require_name, require_within
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.paper import crawl as crawl_experiment
from spidar_gym.paper import crawl_study
from spidar_gym.paper import flight as experiments
from spidar_gym.paper import flight_studies as studies
from spidar_gym.paper.trial import CONDITIONS
from spidar_gym.processes import cpu_count
from spidar_gym.sim.stage import FIXED, VIEWS
from spidar_gym.text import format_table

paper_app = tyro.extras.SubcommandApp()


@paper_app.command(name="both", is_default=True)
def both(out: Path = Path("out"), video: bool = True, noise: tyro.conf.FlagCreatePairsOff[bool] = False) -> None:
    """Fly and crawl the paper's experiments, one after the other, and print our figures beside the paper's.

    Args:
        out: Folder for the folders flight and crawl.
        video: Film them.
        noise: With real sensors, delay and unequal rotors.
    """
    flight(out=out / "flight", video=video, noise=noise)
    print()
    crawl(out=out / "crawl", video=video, noise=noise)


@paper_app.command
def flight(
    preset: FlightPresetArg = "as_flown",
    out: Path = Path("out/flight"),
    camera: CameraArg = FIXED,
    json: tyro.conf.FlagCreatePairsOff[bool] = False,
    video: bool = True,
    noise: tyro.conf.FlagCreatePairsOff[bool] = False,
    seed: int = 0,
    speeds: tyro.conf.FlagCreatePairsOff[bool] = False,
    ablation: tyro.conf.FlagCreatePairsOff[bool] = False,
    scenarios: int = 24,
    workers: int = cpu_count(),
) -> None:
    """Fly the paper's flight experiment (40 s, forms 1 to 2 to 3) and print our figures beside the paper's.

    Args:
        preset: Controller that flies: as_flown is what the robot flew, paper is the paper's cost and rows, tuned goes
            beyond it.
        out: Folder for flight.json, flight.png, flight.pdf and flight.mp4; of --speeds: speeds.json, speeds.png and
            speeds.pdf.
        camera: Camera of the video; fixed stands where it sees everything, the others follow and take longer.
        json: Print one JSON object on stdout and nothing else there.
        video: Film the flight (about two minutes).
        noise: Fly with real sensors, 20 ms of delay and unequal rotors: the flight to compare with the paper's RMSE.
        seed: Seed of that noise.
        speeds: Instead, compare preset tuned with paper in random asymmetric forms at joint speeds 0.2 … 1.0 rad/s.
        ablation: Instead, the same at 0.2, 0.6, 1.0 rad/s, and with each option of tuned switched off.
        scenarios: Flights of a cell of --speeds and --ablation.
        workers: Processes for them.
    """
    require_least(1, scenarios=scenarios, workers=workers)
    require_least(0, seed=seed)
    if speeds or ablation:
        _speeds(output_folder(out), json, ablation, scenarios, workers)
        return
    require_name("preset", preset, PRESETS)
    require_name("camera", camera, VIEWS)
    folder = output_folder(out)
    with tqdm(total=experiments.FLIGHT_TICKS, unit="tick", desc=f"flight, {preset}", file=sys.__stderr__) as bar:
        log = experiments.fly_paper(preset, noise=noise, seed=seed, on_tick=bar.update)
    figures = experiments.flight_figures(log)
    text = json_text({"flight": figures, "paper": {"flight": experiments.PAPER_FLIGHT}})
    write_text(folder / "flight.json", text)
    # After the flight, so that drawing does not disturb the times that it reports.
    drawings: dict[str, Callable[[], object]] = {
        "figure": lambda: viz.flight_figure(log, folder / "flight.png"),
        "video": lambda: _film(viz.flight_take(log), folder / "flight.mp4", camera) if video else None,
    }
    shown = text if json else format_table(experiments.flight_lines(figures))
    _report(drawings, shown, None if json else folder, "flight.*")


def _report(drawings: dict[str, Callable[[], object]], text: str, folder: Path | None, pattern: str) -> None:
    """Draw what can be drawn, print the text and which files of a folder are new, then what could not be drawn."""
    remarks = []
    for name, draw in drawings.items():
        try:
            draw()
        except MissingDependencyError as error:
            remarks.append(f"no {name}: {error}")
    print(text)
    if folder is not None:
        print(f"\nwritten to {folder}: {', '.join(sorted(p.name for p in folder.glob(pattern)))}")
    for remark in remarks:
        print(remark, file=sys.__stderr__)


def _speeds(folder: Path, json: bool, ablation: bool, scenarios: int, workers: int) -> None:
    """Compare controllers over joint speeds: table, JSON and figure."""
    name = "ablation" if ablation else "speeds"
    joint_speeds = studies.SPEEDS if ablation else studies.MANY_SPEEDS
    flights = len(CONDITIONS) * len(joint_speeds) * len(studies.controllers(ablation)) * scenarios
    unfinished = folder / "unfinished"
    with tqdm(total=flights, unit="flight", desc=name, file=sys.__stderr__) as bar, kept(goes_on(bar, unfinished)):
        rows = studies.speed_study(
            speeds=joint_speeds, count=scenarios, ablation=ablation, workers=workers, folder=unfinished,
            on_flight=bar.update,
        )  # fmt: skip
    text = json_text({name: rows})
    write_text(folder / f"{name}.json", text)
    shutil.rmtree(unfinished, ignore_errors=True)
    print(text if json else format_table(studies.speed_lines(rows), left=3))
    if not ablation:
        try:
            viz.speed_figure(rows, folder / "speeds.png")
        except MissingDependencyError as error:
            print(f"no figure: {error}", file=sys.__stderr__)


def _film(take: viz.Take, path: Path, camera: str) -> None:
    viz.film_take(take, path, camera=camera, frames=partial(tqdm, unit="frame", desc="video", file=sys.__stderr__))


def _crawl_study(folder: Path, json: bool, draws: int, seeds: int, workers: int) -> None:
    """Crawl many cases: table and JSON."""
    name = "draws" if draws else "study"
    cases = crawl_study.RANDOM_CASES if draws else crawl_study.CASES
    numbers = range(1000, 1000 + draws) if draws else range(seeds)
    total, unfinished = len(cases) * len(numbers), folder / "unfinished"
    with tqdm(total=total, unit="crawl", desc=name, file=sys.__stderr__) as bar, kept(goes_on(bar, unfinished)):
        rows = crawl_study.run_cases(cases, numbers, workers=workers, folder=unfinished, on_run=bar.update)
    text = json_text({name: rows})
    write_text(folder / f"{name}.json", text)
    shutil.rmtree(unfinished, ignore_errors=True)
    print(text if json else crawl_study.study_table(rows))


def _crawled(preset: str, options: dict[str, Any]) -> crawl_experiment.CrawlLog:
    """Crawl with a bar, as long as the plan; who is slower than planned has always one tick left."""
    with tqdm(unit="tick", desc=f"crawl, {preset}", file=sys.__stderr__) as bar:

        def on_tick(planned: int) -> None:
            bar.total = max(planned, bar.n + 1)
            bar.update()

        return crawl_experiment.crawl_paper(preset, **options, on_tick=on_tick)


@paper_app.command
def crawl(
    preset: CrawlPresetArg = "published",
    out: Path = Path("out/crawl"),
    camera: CameraArg = FIXED,
    json: tyro.conf.FlagCreatePairsOff[bool] = False,
    video: bool = True,
    noise: tyro.conf.FlagCreatePairsOff[bool] = False,
    seed: int = 0,
    overlapped: tyro.conf.FlagCreatePairsOff[bool] = False,
    speed: float | None = None,
    distance: float = crawl_experiment.CRAWL_DISTANCE,
    direction: float = 0.0,
    turn: float = 0.0,
    power: tyro.conf.FlagCreatePairsOff[bool] = False,
    study: tyro.conf.FlagCreatePairsOff[bool] = False,
    draws: int = 0,
    seeds: int = 6,
    workers: int = cpu_count(),
) -> None:
    """Crawl the paper's experiment (0.6 m in 3 cycles of 0.2 m) and print our figures beside the paper's.

    Args:
        preset: Crawler: published is the paper's gait, overlapped the same without waiting, robust our best defaults.
        out: Folder for crawl.json, crawl.png, crawl.pdf, cycle.png and crawl.mp4.
        camera: Camera of the video; fixed stands where it sees everything, the others follow and take longer.
        json: Print one JSON object on stdout and nothing else there.
        video: Film the crawl.
        noise: Crawl with real sensors, 25 ms of delay, unequal rotors and joint zeros that are off.
        seed: Seed of that noise.
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
    require_least(0, seed=seed, draws=draws)
    require_least(1, seeds=seeds, workers=workers)
    require_name("preset", preset, CRAWL_PRESETS)
    require_name("camera", camera, VIEWS)
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
        _crawl_study(folder, json, draws, seeds, workers)
        return
    options: dict[str, Any] = dict(**where, power=power, noise=noise, seed=seed)
    log = _crawled(preset, options)
    fast = log if preset == "overlapped" else _crawled("overlapped", options)
    figures = crawl_experiment.crawl_figures(log, fast)
    text = json_text({"crawl": figures, "paper": {"crawl": crawl_experiment.PAPER_CRAWL}})
    write_text(folder / "crawl.json", text)
    drawings: dict[str, Callable[[], object]] = {
        "figure": lambda: viz.crawl_figure(log, folder / "crawl.png"),
        "strip": lambda: viz.crawl_strip(log, folder / "cycle.png"),
        "video": lambda: _film(viz.crawl_take(log), folder / "crawl.mp4", camera) if video else None,
    }
    shown = text if json else format_table(crawl_experiment.crawl_lines(figures))
    _report(drawings, shown, None if json else folder, "c*.*")
