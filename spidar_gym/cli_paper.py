"""`spidar paper`: the paper's experiments and the comparisons that go beyond them."""

import math
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm

from spidar_gym import crawl_experiment, crawl_study, experiments, studies, viz
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.description import CAMERAS
from spidar_gym.envs.crawl_task import CrawlTask
from spidar_gym.errors import InvalidValueError, MissingDependencyError, require_least, require_name
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.trial import CONDITIONS

paper_app = tyro.extras.SubcommandApp()

PresetArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(PRESETS) + "}")]
CrawlPresetArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(CRAWL_PRESETS) + "}")]
CameraArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(CAMERAS) + "}")]


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
    preset: PresetArg = "as_flown",
    out: Path = Path("out/flight"),
    camera: CameraArg = "chase",
    json: tyro.conf.FlagCreatePairsOff[bool] = False,
    video: bool = True,
    noise: tyro.conf.FlagCreatePairsOff[bool] = False,
    seed: int = 0,
    speeds: tyro.conf.FlagCreatePairsOff[bool] = False,
    ablation: tyro.conf.FlagCreatePairsOff[bool] = False,
    scenarios: int = 24,
    workers: int = os.cpu_count() or 1,
) -> None:
    """Fly the paper's flight experiment (40 s, forms 1 to 2 to 3) and print our figures beside the paper's.

    Args:
        preset: Controller that flies: as_flown is what the robot flew, paper is the paper's cost and rows, tuned goes
            beyond it.
        out: Folder for flight.json, flight.png and flight.mp4; of --speeds: speeds.json and speeds.png.
        camera: Camera of the video.
        json: Print one JSON object on stdout and nothing else there.
        video: Film the flight (about as long as the flight itself).
        noise: Fly with real sensors, 20 ms of delay and unequal rotors: the flight to compare with the paper's RMSE.
        seed: Of that noise.
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
    require_name("camera", camera, CAMERAS)
    folder = output_folder(out)
    with tqdm(total=experiments.FLIGHT_TICKS, unit="tick", desc=f"flight, {preset}", file=sys.__stderr__) as bar:
        log = experiments.fly_paper(preset, noise=noise, seed=seed, on_tick=bar.update)
    figures = experiments.flight_figures(log)
    text = json_text({"flight": figures, "paper": {"flight": experiments.PAPER_FLIGHT}})
    write_text(folder / "flight.json", text)
    # After the flight, so that drawing does not disturb the times that it reports.
    drawings: dict[str, Callable[[], object]] = {
        "figure": lambda: viz.flight_figure(log, folder / "flight.png"),
        "video": lambda: viz.film_flight(log, folder / "flight.mp4", camera=camera, ticks=_bar) if video else None,
    }
    _report(drawings, text if json else experiments.flight_table(figures), None if json else folder, "flight.*")


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
    with tqdm(total=flights, unit="flight", desc=name, file=sys.__stderr__) as bar:
        rows = studies.speed_study(
            speeds=joint_speeds, count=scenarios, ablation=ablation, workers=workers, on_flight=bar.update
        )
    text = json_text({name: rows})
    write_text(folder / f"{name}.json", text)
    print(text if json else studies.speed_table(rows))
    if not ablation:
        try:
            viz.speed_figure(rows, folder / "speeds.png")
        except MissingDependencyError as error:
            print(f"no figure: {error}", file=sys.__stderr__)


def _bar(ticks: Iterable[int]) -> Iterable[int]:
    return tqdm(ticks, unit="tick", desc="video", file=sys.__stderr__)


def _crawl_study(folder: Path, json: bool, draws: int, seeds: int, workers: int) -> None:
    """Crawl many cases: table and JSON."""
    name = "draws" if draws else "study"
    cases = crawl_study.RANDOM_CASES if draws else crawl_study.CASES
    numbers = range(1000, 1000 + draws) if draws else range(seeds)
    with tqdm(total=len(cases) * len(numbers), unit="crawl", desc=name, file=sys.__stderr__) as bar:
        rows = crawl_study.run_cases(cases, numbers, workers=workers, on_run=bar.update)
    text = json_text({name: rows})
    write_text(folder / f"{name}.json", text)
    print(text if json else crawl_study.study_table(rows))


@paper_app.command
def crawl(
    preset: CrawlPresetArg = "published",
    out: Path = Path("out/crawl"),
    camera: CameraArg = "chase",
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
    workers: int = os.cpu_count() or 1,
) -> None:
    """Crawl the paper's experiment (0.6 m in 3 cycles of 0.2 m) and print our figures beside the paper's.

    Args:
        preset: Crawler: published is the paper's gait, overlapped the same without waiting, robust our best defaults.
        out: Folder for crawl.json, crawl.png, cycle.png and crawl.mp4.
        camera: Camera of the video.
        json: Print one JSON object on stdout and nothing else there.
        video: Film the crawl.
        noise: Crawl with real sensors, 25 ms of delay, unequal rotors and joint zeros that are off.
        seed: Of that noise.
        overlapped: The same as --preset overlapped.
        speed: Joint speed [rad/s]; the preset's own, 0.2, if not given.
        distance: How far [m].
        direction: Where to, 0 straight ahead, 90 to the left [degrees].
        turn: How far the heading turns on the way [degrees].
        power: Minimise electrical power instead of the sum of squared forces.
        study: Instead, directions, speeds, floors and weak actuators, each with --seeds noisy robots.
        draws: Instead, so many robots and goals drawn at strength 1, presets published and robust.
        seeds: Crawls a case of --study.
        workers: Processes for --study and --draws.
    """
    require_least(0, seed=seed, draws=draws)
    require_least(1, seeds=seeds, workers=workers)
    require_name("preset", preset, CRAWL_PRESETS)
    require_name("camera", camera, CAMERAS)
    if not (math.isfinite(direction) and math.isfinite(turn)):
        raise InvalidValueError("direction, turn", (direction, turn), "finite numbers [degrees]")
    # What cannot be crawled is refused before anything is written.
    CrawlTask(distance=distance, direction=math.radians(direction), turn=math.radians(turn), joint_speed=speed)
    folder = output_folder(out)
    if study or draws:
        _crawl_study(folder, json, draws, seeds, workers)
        return
    if overlapped:
        preset = "overlapped"
    options: dict[str, Any] = dict(
        distance=distance, direction=math.radians(direction), turn=math.radians(turn), joint_speed=speed, power=power,
        noise=noise, seed=seed,
    )  # fmt: skip
    with tqdm(unit="tick", desc=f"crawl, {preset}", file=sys.__stderr__) as bar:
        log = crawl_experiment.crawl_paper(preset, **options, on_tick=bar.update)
        fast = log if preset == "overlapped" else crawl_experiment.crawl_paper(
            "overlapped", **options, on_tick=bar.update
        )  # fmt: skip
    figures = crawl_experiment.crawl_figures(log, fast)
    text = json_text({"crawl": figures, "paper": {"crawl": crawl_experiment.PAPER_CRAWL}})
    write_text(folder / "crawl.json", text)
    drawings: dict[str, Callable[[], object]] = {
        "figure": lambda: viz.crawl_figure(log, folder / "crawl.png"),
        "strip": lambda: viz.crawl_strip(log, folder / "cycle.png"),
        "video": lambda: viz.film_crawl(log, folder / "crawl.mp4", camera=camera, ticks=_bar) if video else None,
    }
    _report(drawings, text if json else crawl_experiment.crawl_table(figures), None if json else folder, "c*.*")
