"""Scenarios of tracks: initial state, goals, floor, disturbances; sampled once, stored in files, pinned by hash."""

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from spidar_gym.benchmark.track import BOTH, GRASPING, GROUND, SCENARIOS, SPLITS, TRACKS, Track, find_track
from spidar_gym.border import BorderError, parse_json, read_file, require_form
from spidar_gym.control.course.gates import parse_course, plain_course
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.grasp.scene import parse_scene, plain_scene
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import PATH
from spidar_gym.errors import InvalidValueError, SpidarError, StaleAssetError, require_name
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot.description import assets_dir
from spidar_gym.sim.randomize import Randomization
from spidar_gym.so3 import exp
from spidar_gym.tasks.course import CourseTask
from spidar_gym.tasks.grasp import GraspTask
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.path import PathTask
from spidar_gym.tasks.start import FlightStart, draw_start

PINS = "scenarios/SHA256SUMS"
"""File with the hash of every scenario file, relative to assets/."""
WRITER = "spidar scenarios"
"""Command that writes the files."""
OFFSET = 0.33
"""Scale of the initial offset in flights: ± 1 cm and ± 0.017 rad per axis."""

MOST_BYTES = 2**23
"""Largest size of a scenario file [bytes]."""
FORM = {
    "of": {"track": str, "split": str},
    "scenarios": [
        {
            "index": int, "seed": int, "options": {str: float}, "start": (dict, None),
            "disturbances": {str: float}, "robot": str,
        }
    ],
}  # fmt: skip
"""Form of a scenario file."""
START = {
    "goals": [[float, float, [float]]], "position": [float], "rotation": [float], "trim": ([float], None),
    "path": ([[float]], None),
}  # fmt: skip
"""Form of a flight's start."""
COURSE_START = {"gates": [list], "goal": [float], "tiles": [float], "dares": bool}
"""Form of a course's start."""
SCENE = {
    "shape": str, "half_size": [float], "com": [float], "bias": [float], "start": [float], "goal": [float],
    **dict.fromkeys(("mass", "friction", "most_force", "stand", "floor"), float),
}  # fmt: skip
"""Form of a grasp's scene."""
HOVER_TICKS = 200
"""Duration of the hover that determines the mean force of the wind [ticks]."""


@dataclass(frozen=True)
class Scenario:
    """One episode: initial state, preload, goals with deadlines, floor, disturbances, robot."""

    index: int
    """Index in its track and split."""
    seed: int
    """Seed of the randomised robot, sensor noise, wind and tiles."""
    options: Mapping[str, Any]
    """Arguments of the environment in addition to the track's options."""
    start: Mapping[str, Any] | None
    """Start of the episode. Flight: offset, goals with start and deadline, initial wrench of the integrals, path knots.
    Course: gates, goal and tiles. Grasp: the scene."""
    disturbances: Mapping[str, Any]
    """Disturbances during the episode."""
    robot: str
    """Digest of the randomised robot, which detects a different random generator; empty without randomisation."""


def scenario_rng(track: str, split: str, index: int) -> np.random.Generator:
    """Return the generator that samples a scenario, seeded by track, split and index."""
    entropy = [zlib.crc32(track.encode()), SPLITS[split], index]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(entropy)))


def draw_scenario(name: str, split: str, index: int) -> Scenario:
    """Sample a scenario of a track and split; the same arguments always yield the same scenario."""
    require_name("split", split, find_track(name).splits)
    return draw_scenario_from(TRACKS[name], scenario_rng(name, split, index), index)


def draw_scenario_from(track: Track, rng: np.random.Generator, index: int) -> Scenario:
    """Sample a scenario of a track from any generator, for scenarios outside the splits."""
    seed = int(rng.integers(2**31))
    options = {key: _draw(rng, bounds) for key, bounds in track.ranges.items()}
    disturbances = {key: _draw(rng, bounds) for key, bounds in track.disturbances.items()}
    if track.calm and rng.random() < track.calm:
        disturbances = {}
    start = None
    if track.world == BOTH:
        start = _rounded(plain_course(CourseTask(**_own(CourseTask, track, options)).draw_course(rng)))
    elif track.world == GRASPING:
        start = _rounded(plain_scene(GraspTask(**_own(GraspTask, track, options)).draw_scene(rng)))
    elif track.flies:
        kind = PathTask if track.env_id == PATH else HoverTask
        task = kind(horizon_s=track.seconds, perturbation=OFFSET, **_own(kind, track, options))
        drawn = draw_start(task, rng)
        goals = [[goal.start, round(goal.deadline, 6), np.round(goal.joint_target, 4).tolist()] for goal in drawn.goals]
        position, rotation, path = drawn.position, drawn.rotation, drawn.path
        start = {"goals": goals, "position": position.round(6).tolist(), "rotation": rotation.round(6).tolist()}
        if path is not None:
            knots = np.column_stack((path.times, path.pose_w, path.rate_w, path.acceleration_w))
            start["path"] = (knots.round(6) + 0.0).tolist()  # no zero is negative
    scenario = Scenario(index, seed, options, start, disturbances, "")
    if not (track.options.get("randomization") or disturbances):
        return scenario
    # The environment samples robot and wind; a flight's preload is the wrench that the robot needs at rest in the wind.
    env = make_env(track, scenario, {})
    env.reset(seed=seed, options=reset_options(scenario))
    world = env.randomization.world
    if isinstance(env, HoverEnv) and (world is None or world.trimmed):
        assert start is not None
        trim = env.compute_trim()
        if disturbances:
            trim[:3] -= _mean_air_force(track, scenario)
        start["trim"] = trim.round(3).tolist()
    env.close()
    return Scenario(index, seed, options, start, disturbances, robot_digest(env.sampled_parameters))


def robot_scenarios(name: str, robots: str, rngs: Iterable[np.random.Generator]) -> tuple[Scenario, ...]:
    """Sample scenarios of a calibrated track with the robots of another world, as that of an identified robot.

    Args:
        name: Track (`UnknownNameError` if it does not exist).
        robots: File or name of a calibrated world, whose kinds the scenarios have in turn.
        rngs: Generator of each scenario.

    Raises:
        InvalidValueError: For a track without calibrated robots, or anything else than a calibrated world.
    """
    track, found = find_track(name), Randomization.parse(robots)
    if not track.is_calibrated:
        valid = [own for own, each in TRACKS.items() if each.is_calibrated]
        raise InvalidValueError("tracks", name, f"with other robots, a calibrated track: {', '.join(valid)}")
    if found.world is None:
        raise InvalidValueError("robots", robots, "the name or file of a calibrated world")
    drawn = []
    for index, rng in enumerate(rngs):
        kind = found.in_turn(index).name.partition(":")[2]
        own = {"randomization": f"{robots}:{kind}"}
        scenario = draw_scenario_from(replace(track, options={**track.options, **own}), rng, index)
        drawn.append(replace(scenario, options={**scenario.options, **own}))
    return tuple(drawn)


def _mean_air_force(track: Track, scenario: Scenario) -> np.ndarray:
    """Return the mean force of the wind on a robot hovering in the initial form at the start of its path [N].

    The mean is over `HOVER_TICKS`; the axes are the world's, rotated by the heading.
    """
    start = scenario.start
    assert start is not None
    env = make_env(track, scenario, {"preset": "tuned_v1"})
    held = {**start, "goals": start["goals"][:1], **({"path": start["path"][:1]} if "path" in start else {})}
    steps = rollout(
        env, seed=scenario.seed, options={**reset_options(scenario), "start": held}, ticks=HOVER_TICKS
    )  # fmt: skip
    force = np.mean([step.info["air_force"] for step in steps], axis=0)
    yaw = start["path"][0][4] if "path" in start else 0.0
    return force @ exp(np.array([0.0, 0.0, yaw])) if yaw else force


def _own(kind: type[Any], track: Track, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of the track and of a scenario that are fields of the track's task."""
    every = {**track.options, **options}
    return {field.name: every[field.name] for field in fields(kind) if field.name in every}


def _rounded(value: Any) -> Any:  # noqa: ANN401 - numbers, and lists and dictionaries of them
    """Round all numbers to six decimal places."""
    if isinstance(value, Mapping):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return round(value, 6) + 0.0 if isinstance(value, float) else value


def _draw(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return round(float(rng.uniform(*bounds)), 6)


def robot_digest(draws: Mapping[str, np.ndarray]) -> str:
    """Return the digest of a randomised robot's parameters to four digits; empty without randomisation."""
    if not draws:
        return ""
    text = " ".join(f"{x:.4g}" for name in sorted(draws) for x in np.ravel(draws[name]))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def make_env(track: Track, scenario: Scenario, arguments: Mapping[str, Any]) -> SpidarEnv:
    """Create the environment of a scenario with a policy's arguments, without wrappers."""
    options = {**track.options, "randomization": track.robots(scenario.index), **scenario.options, **arguments}
    env = gymnasium.make(
        track.env_id,
        **options,
        horizon_s=track.seconds,
        max_episode_steps=round(track.seconds * CONTROL_RATE),
        disable_env_checker=True,
    ).unwrapped
    assert isinstance(env, SpidarEnv)
    return env


def reset_options(scenario: Scenario) -> dict[str, Any]:
    """Return the options of `reset` for a scenario."""
    options: dict[str, Any] = {"disturbances": dict(scenario.disturbances)}
    if scenario.start is None:
        return options
    name = "course" if "gates" in scenario.start else "scene" if "friction" in scenario.start else "start"
    return {name: scenario.start, **options}


def scenario_text(name: str, split: str, *, on_scenario: Callable[[], object] = lambda: None) -> str:
    """Return the text of a track's scenario file, one line per scenario."""
    lines = []
    for index in range(SCENARIOS):
        lines.append(json.dumps(asdict(draw_scenario(name, split, index)), ensure_ascii=False))
        on_scenario()
    head = json.dumps({"track": name, "split": split})
    return f'{{"of": {head}, "scenarios": [\n' + ",\n".join(lines) + "\n]}\n"


def scenario_files(*, on_scenario: Callable[[], object] = lambda: None) -> dict[str, str]:
    """Return all scenario files and the file of their hashes: path relative to assets/ → text."""
    files = {}
    for split in SPLITS:
        for name in (name for name, track in TRACKS.items() if split in track.splits):
            path = f"scenarios/{split}/{name}.json"
            files[path] = _unless_equal(assets_dir() / path, scenario_text(name, split, on_scenario=on_scenario))
    files[PINS] = "".join(f"{_sha256(text)}  {path.split('/', 1)[1]}\n" for path, text in files.items())
    return files


def _unless_equal(path: Path, text: str) -> str:
    """Return the new text of a file, or the present text if the numbers are equal; signs of zeros may differ."""
    try:
        present = path.read_text(encoding="utf-8")
        return present if json.loads(present) == json.loads(text) else text
    except (OSError, ValueError):
        return text


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def load_scenarios(name: str, split: str = "test") -> tuple[tuple[Scenario, ...], str]:
    """Load a track's committed scenarios and the hash of their file.

    Raises:
        UnknownNameError: For a track or split that does not exist.
        StaleAssetError: When the file is missing, invalid or does not match its pinned hash.
    """
    require_name("split", split, find_track(name).splits)
    path, pins = assets_dir() / "scenarios" / split / f"{name}.json", assets_dir() / PINS
    try:
        data = read_file(path, MOST_BYTES).replace(b"\r\n", b"\n")  # Git may check out CRLF
        digest = hashlib.sha256(data).hexdigest()
        if f"{digest}  {split}/{name}.json\n".encode() not in read_file(pins, MOST_BYTES).replace(b"\r\n", b"\n"):
            raise BorderError("not the pinned one")
        content = parse_json(data)
        require_form(content, FORM, path.name)
        if content["of"] != {"track": name, "split": split}:
            raise BorderError("of another track or split")
        return tuple(_scenario(TRACKS[name], k, entry) for k, entry in enumerate(content["scenarios"])), digest
    except SpidarError as error:
        raise StaleAssetError(path, WRITER) from error


def _scenario(track: Track, index: int, entry: Mapping[str, Any]) -> Scenario:
    """Create the scenario of an entry; raises if its values are outside the track's ranges."""
    start, drawn = entry["start"], ((entry["options"], track.ranges), (entry["disturbances"], track.disturbances))
    fits = entry["index"] == index and 0 <= entry["seed"] < 2**31 and (start is not None) == (track.world != GROUND)
    for values, ranges in drawn:
        none = values is entry["disturbances"] and track.calm > 0.0 and not values
        fits = fits and (none or values.keys() == ranges.keys())
        # Values are stored with six decimal places.
        fits = fits and all(low - 1e-6 <= values.get(key, low) <= high + 1e-6 for key, (low, high) in ranges.items())
    if not fits:
        raise BorderError(f"scenario {index} is none of its track")
    if track.world == BOTH:
        require_form({**start}, COURSE_START, "start")
        parse_course(start)
    elif track.world == GRASPING:
        require_form({**start}, SCENE, "start")
        parse_scene(start)
    elif start is not None:
        require_form({"trim": None, "path": None, **start}, START, "start")
        if (FlightStart.parse(start).path is None) != (track.env_id != PATH):
            raise BorderError(f"scenario {index} is none of its track")
    return Scenario(**entry)


def check_drawn(draws: Mapping[str, np.ndarray], scenario: Scenario, place: str) -> None:
    """Refuse a robot that differs from the scenario's, as another version of NumPy might sample it."""
    if robot_digest(draws) != scenario.robot:
        raise SpidarError(
            f"{place}: the sampled robot is not the scenario's; valid: a NumPy version with the same random numbers, "
            "or new scenarios by `spidar scenarios`"
        )
