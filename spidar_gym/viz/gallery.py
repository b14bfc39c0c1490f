"""Pictures of the guide: environments, tracks, presets, studies, and the paper's experiments."""

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from spidar_gym.benchmark.scenario import load_scenarios, make_env, reset_options
from spidar_gym.benchmark.suite_results import RESULTS, read_results
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.control.course.gates import Course, Gate
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.envs.course_env import CourseEnv
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.grasp_env import GraspEnv
from spidar_gym.envs.registry import COURSE, ENVIRONMENTS, GRASP
from spidar_gym.paper.crawl import crawl_paper
from spidar_gym.paper.flight import fly_paper
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot.description import CAMERAS
from spidar_gym.sim.stage import Stage, cog, extent, standing
from spidar_gym.tasks.course import DECIDE
from spidar_gym.viz.courses import gate_figure, way_figure, way_of
from spidar_gym.viz.figures import (
    ablation_figure,
    crawl_figure,
    energy_figure,
    flight_figure,
    frontier_figure,
    speed_figure,
    step_figure,
)
from spidar_gym.viz.film import Take, crawl_take, flight_take
from spidar_gym.viz.reel import Cut, write_reel
from spidar_gym.viz.stills import Shot, crawl_strip, forms_picture, strip, write_strip
from spidar_gym.viz.suite import suite_figure

SIZE = 480, 340
"""Size of one shot of a strip [px]."""
COLORS, LARGEST = (96, 64, 48, 32, 24), 100_000
"""Numbers of colours of a picture; the first that keeps the file within `LARGEST` [bytes] is used."""
SHOWN = Course(
    (Gate("wall", 2.3, 2.5, 0.7), Gate("beam", 5.7, 6.1, 0.6), Gate("slot", 9.3, 9.6, 1.5, 0.3),
     Gate("platform", 11.4, 14.9, 0.3)), Pose2(13.1, 0.2, 0.2),
)  # fmt: skip
"""Course of the picture of Course-v0."""
COURSE_SEED = 2
"""Seed of the course of the figure and of the animation: a wall, a beam, a slot, a platform."""
AROUND = 0.2, 0.8, 0.15, 0.75
"""Left, right, bottom, top of the region that contains the robot, as shares of a picture of a course."""
REEL = "spidar"
"""Name of the animated picture."""
GRASP_SEED = 1
"""Seed of the grasp of the animation: a box."""
GRASP_SHOTS = {
    "over": ("comes over it", 1.0),
    "grip": ("presses", 1.0),
    "carry": ("carries", 0.5),
    "open": ("lets go", 1.0),
}
"""Moments of a grasp: phase → caption, and share of the phase."""
FLIGHT_SHOTS = {"form ①": 3.0, "form ③": 26.0, "constraint dropped": 30.0}
"""Moments of the paper's flight [s]."""


BY_RULE: dict[str, Any] = {"action_mode": "residual", "hold": DECIDE}
"""Arguments of Course-v0 with which zero actions follow the rule."""


def gallery() -> dict[str, Callable[[Path], object]]:
    """Return the pictures of the guide: name → function that draws the picture to a path."""
    drawings: dict[str, Callable[[Path], object]] = {
        "forms": forms_picture,
        "flight": lambda path: flight_figure(fly_paper("as_flown"), path),
        "crawl": lambda path: crawl_figure(crawl_paper(noise=True), path),
        "speeds": lambda path: speed_figure(_rows(path, "speeds"), path),
        "gates": lambda path: gate_figure(_rows(path, "gates"), path),
        "ablations": lambda path: ablation_figure(_rows(path, "ablations"), path),
        "steps": lambda path: step_figure(_rows(path, "steps"), path),
        "energy": lambda path: energy_figure(_rows(path, "energy"), path),
        "frontier": lambda path: frontier_figure(_rows(path, "frontier"), path),
        "course": course_way,
        "suite": lambda path: suite_figure(read_results(RESULTS), path),
    }
    drawings |= {f"environment-{name.split('/')[1]}": partial(cameras, name) for name in ENVIRONMENTS}
    drawings["environment-Course-v0"] = course_strip
    drawings["environment-Grasp-v0"] = grasp_strip
    drawings[REEL] = reel
    drawings |= {f"track-{name}": partial(track_strip, name) for name in TRACKS}
    drawings |= {f"preset-{name}": partial(flight_strip, name) for name in PRESETS}
    drawings |= {
        f"preset-{name}": lambda path, name=name: crawl_strip(crawl_paper(name, noise=True), path, size=SIZE)
        for name in CRAWL_PRESETS
    }
    return drawings


def _rows(path: Path, name: str) -> list[dict[str, Any]]:
    """Read the rows of a committed study; the folder of results is beside that of the picture."""
    file = path.parent.parent / "results" / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8"))["result"][name]


def draw(name: str, folder: Path) -> Path:
    """Draw one picture of the gallery, small enough for a page (`MissingDependencyError` without OpenGL)."""
    from PIL import Image

    if name == REEL:
        reel(folder / f"{name}.gif")
        return folder / f"{name}.gif"
    path = folder / f"{name}.png"
    gallery()[name](path)
    with Image.open(path) as image:
        whole = image.convert("RGB")
    for colors in COLORS:
        whole.quantize(colors, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= LARGEST:
            break
    return path


def cameras(env_id: str, path: Path) -> None:
    """Draw an environment two seconds after its reset, from each camera."""
    pictures = []
    for camera in CAMERAS:
        env = gymnasium.make(env_id, render_mode="rgb_array", camera=camera, width=SIZE[0], height=SIZE[1])
        for _ in rollout(env, seed=0, ticks=round(2.0 * CONTROL_RATE)):
            pass
        pictures.append(np.asarray(env.render()))
        env.close()
    write_strip(path, pictures, list(CAMERAS), columns=2)


def _on_course(hold: int, **options: Any) -> CourseEnv:  # noqa: ANN401 - of the environment
    """Make a course on which zero actions follow the rule."""
    env = gymnasium.make(COURSE, **{**BY_RULE, "hold": hold}, **options).unwrapped
    assert isinstance(env, CourseEnv)
    return env


def _go(env: CourseEnv, seed: int, options: dict[str, Any] | None = None) -> list[tuple[Any, dict[str, Any], float]]:
    """Run the rule to the goal; return configuration, `info` and the target's `narrow` of each step."""
    rows = []
    for step in rollout(env, seed=seed, options=options, ticks=env.horizon):
        target = env.target
        rows.append((env.plant.data.qpos.copy(), step.info, 0.0 if target is None else target.narrow))
    return rows


def course_way(path: Path) -> None:
    """Draw the path of a randomised robot with noisy sensors on a sampled course, from above and from the side."""
    env = _on_course(4, sensors=True, randomization=0.5)
    rows = _go(env, COURSE_SEED)
    way_figure(
        env.course, cog(np.array([qpos for qpos, *_ in rows])), [way_of(i["phase"], n) for _, i, n in rows], path
    )
    env.close()


def course_strip(path: Path) -> None:
    """Draw the rule on a course: over a wall, under a beam, through a slot, at the goal on a platform."""
    _passages(_on_course(DECIDE, course=SHOWN, charge=1.0), path, seed=0)


def _passages(env: CourseEnv, path: Path, *, seed: int, options: dict[str, Any] | None = None) -> None:
    """Draw an episode of the rule, with a picture at each passed gate and one at the goal."""
    rows = [(qpos, info["thrust"]) for qpos, info, _ in _go(env, seed, options)]
    places = np.array([qpos[0] for qpos, _ in rows])
    words = {"wall": "over", "beam": "under", "slot": "through"}
    moments = [
        (words[gate.kind], int(np.abs(places - 0.5 * (gate.begin + gate.end)).argmin()))
        for gate in env.course.gates
        if gate.is_passed
    ]
    shots = [
        Shot(f"{word}, {tick * DECIDE / CONTROL_RATE:.0f} s", *rows[tick])
        for word, tick in (*moments, ("at the goal", len(rows) - 1))
    ]
    _near(env, shots, path)


def _near(env: CourseEnv | GraspEnv, shots: Sequence[Shot], path: Path) -> None:
    """Draw shots two per row, each with a camera near the robot, and close the environment."""
    pictures, world = [], env.plant.config
    for shot in shots:
        camera = standing(extent(shot.qpos[None]), SIZE[0] / SIZE[1], AROUND)
        stage = Stage(camera, *SIZE, world.ground, thing=world.object)
        pictures.append(stage.render(shot.qpos, thrust=shot.thrust))
        stage.close()
    write_strip(path, pictures, [shot.words for shot in shots], columns=2)
    env.close()


def grasp_strip(path: Path) -> None:
    """Draw the rule in a grasp: over the object, pressing, carrying, letting go."""
    env = _with_object()
    _moments(env, list(_held(env, GRASP_SEED)), path)


def _with_object() -> GraspEnv:
    env = gymnasium.make(GRASP).unwrapped
    assert isinstance(env, GraspEnv)
    return env


def _moments(env: GraspEnv, rows: list[tuple[Any, dict[str, Any]]], path: Path) -> None:
    """Draw the steps of a completed episode at `GRASP_SHOTS`."""
    shots = []
    for phase, (words, share) in GRASP_SHOTS.items():
        ticks = [k for k, (_, info) in enumerate(rows) if info["grasp_phase"] == phase]
        tick = ticks[round(share * (len(ticks) - 1))]
        shots.append(Shot(f"{words}, {tick / CONTROL_RATE:.0f} s", rows[tick][0], rows[tick][1]["thrust"]))
    _near(env, shots, path)


def _held(env: GraspEnv, seed: int, options: dict[str, Any] | None = None) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield configuration and `info` of each step of the rule."""
    for step in rollout(env, seed=seed, options=options, ticks=env.horizon):
        yield env.plant.data.qpos.copy(), step.info


def _grasp_track(track: str, path: Path) -> None:
    for scenario in load_scenarios(track)[0]:
        env = make_env(TRACKS[track], scenario, {})
        assert isinstance(env, GraspEnv)
        rows = list(_held(env, scenario.seed, reset_options(scenario)))
        if rows[-1][1]["is_success"]:
            _moments(env, rows, path)
            return
        env.close()


def track_strip(track: str, path: Path) -> None:
    """Draw a track's first test scenario at three times, with the default controller; courses and grasps by rules.

    Of grasps the first one that the rule completes is drawn.
    """
    if TRACKS[track].env_id == GRASP:
        _grasp_track(track, path)
        return
    scenario = load_scenarios(track)[0][0]
    env = make_env(TRACKS[track], scenario, BY_RULE if TRACKS[track].env_id == COURSE else {})
    if isinstance(env, CourseEnv):
        _passages(env, path, seed=scenario.seed, options=reset_options(scenario))
        return
    steps = rollout(
        env, seed=scenario.seed, options=reset_options(scenario), ticks=round(TRACKS[track].seconds * CONTROL_RATE)
    )
    rows = [(env.plant.data.qpos.copy(), step.info["thrust"]) for step in steps]
    # A crawl begins and ends on the floor; a swing shows more.
    shares = (0.0, 0.3, 0.75) if isinstance(env, CrawlEnv) else (0.0, 0.5, 1.0)
    ticks = [round(share * (len(rows) - 1)) for share in shares]
    shots = [Shot(f"{tick / CONTROL_RATE:.0f} s", *rows[tick]) for tick in ticks]
    strip(shots, path, size=SIZE, ground=env.plant.config.ground)
    env.close()


def reel(path: Path) -> None:
    """Write the animation of README: the paper's flight, a crawl, a course and a grasp with their rules."""
    flight, crawl = flight_take(fly_paper("as_flown", noise=True)), crawl_take(crawl_paper("overlapped", noise=True))
    env = _on_course(1, sensors=True, randomization=0.5)
    rows = _go(env, COURSE_SEED)
    qpos, time = np.array([q for q, *_ in rows]), np.arange(1, len(rows) + 1) / CONTROL_RATE
    thrust = np.array([info["thrust"] for _, info, _ in rows])
    phases, ground = [info["phase"] for _, info, _ in rows], env.plant.config.ground
    course = Take("course", time, qpos, thrust, phases, {}, ground=ground)
    cuts = [
        Cut("flies, and changes its form", flight, 3.5, 14.0, 4.0),
        Cut("crawls, partly carried by its rotors", crawl, 1.0, 12.0, 4.0),
    ]
    words = {"wall": "over a wall", "beam": "under a beam", "slot": "through a slot", "platform": "onto a platform"}
    for gate in env.course.gates:
        if gate.kind in words:
            middle = float(time[int(np.abs(qpos[:, 0] - 0.5 * (gate.begin + gate.end)).argmin())])
            start, end = max(0.1, middle - 6.0), min(middle + 4.0, float(time[-1]))
            cuts.append(Cut(words[gate.kind], course, start, end, 6.0, "chase"))
    env.close()
    grasp = _with_object()
    held = list(_held(grasp, GRASP_SEED))
    qpos, time = np.array([q for q, _ in held]), np.arange(1, len(held) + 1) / CONTROL_RATE
    thrust, world = np.array([info["thrust"] for _, info in held]), grasp.plant.config
    take = Take("grasp", time, qpos, thrust, [info["phase"] for _, info in held], {}, thing=world.object)
    phases = [info["grasp_phase"] for _, info in held]
    begin = float(time[phases.index("close")])
    cuts.append(Cut("grasps a box and carries it", take, begin, float(time[-1]), 6.0))
    grasp.close()
    write_reel(cuts, path)


def flight_strip(preset: str, path: Path) -> None:
    """Draw the paper's flight with a preset."""
    log = fly_paper(preset)
    ticks = {words: int(np.argmin(np.abs(log.time - time))) for words, time in FLIGHT_SHOTS.items()}
    shots = [Shot(f"{words}, {log.time[t]:.0f} s", log.qpos[t], log.thrust[t]) for words, t in ticks.items()]
    strip(shots, path, size=SIZE)
