"""Scenarios: what an episode of a track begins with and goes through; drawn once, kept in files, pinned by hash."""

import hashlib
import json
import zlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from spidar_gym.benchmark.track import BOTH, GROUND, SCENARIOS, SPLITS, TRACKS, Track, find_track
from spidar_gym.border import BorderError, parse_json, read_file, require_form
from spidar_gym.control.course.gates import parse_course, plain_course
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import PATH
from spidar_gym.errors import SpidarError, StaleAssetError, require_name
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot.description import assets_dir
from spidar_gym.so3 import exp
from spidar_gym.tasks.course import CourseTask
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.path import PathTask
from spidar_gym.tasks.start import FlightStart, draw_start

PINS = "scenarios/SHA256SUMS"
"""File with the hash of every scenario file, relative to assets/."""
WRITER = "spidar scenarios"
"""Command that writes the files."""
OFFSET = 0.33
"""Scale of a flight's initial offset: ± 1 cm and ± 0.017 rad per axis."""

MOST_BYTES = 2**23
"""No file of scenarios is larger."""
FORM = {
    "of": {"track": str, "split": str},
    "scenarios": [
        {
            "index": int, "seed": int, "options": {str: float}, "start": (dict, None),
            "disturbances": {str: float}, "robot": str,
        }
    ],
}  # fmt: skip
"""What stands in a file."""
START = {
    "goals": [[float, float, [float]]], "position": [float], "rotation": [float], "trim": ([float], None),
    "path": ([[float]], None),
}  # fmt: skip
"""What stands in the start of a flight."""
COURSE_START = {"gates": [list], "goal": [float], "tiles": [float], "dares": bool}
"""What stands in that of a course."""
HOVER_TICKS = 200
"""A robot has hovered in its wind for so long before the episode [ticks]."""


@dataclass(frozen=True)
class Scenario:
    """One episode: initial state, preload, goals with deadlines, floor, weather, robot."""

    index: int
    """Which one of its track and split."""
    seed: int
    """Seed of the drawn robot, the sensors' noise, the weather, the tiles."""
    options: Mapping[str, Any]
    """Arguments of the environment beside the track's."""
    start: Mapping[str, Any] | None
    """A flight's offset, goals with start and deadline, wrench with which the integrals begin, knots of its path; the
    gates, goal and tiles of a course."""
    disturbances: Mapping[str, Any]
    """What happens to the robot."""
    robot: str
    """Digest of the drawn robot, so that another generator's robot is not taken for it; empty if none is drawn."""


def scenario_rng(track: str, split: str, index: int) -> np.random.Generator:
    """The generator that draws a scenario, from nothing but its name."""
    entropy = [zlib.crc32(track.encode()), SPLITS.index(split), index]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(entropy)))


def draw_scenario(name: str, split: str, index: int) -> Scenario:
    """Draw a scenario of a track and split, always the same one."""
    find_track(name)
    require_name("split", split, SPLITS)
    return draw_scenario_from(TRACKS[name], scenario_rng(name, split, index), index)


def draw_scenario_from(track: Track, rng: np.random.Generator, index: int) -> Scenario:
    """Draw a scenario of a track from any generator, for flights that are of no split."""
    seed = int(rng.integers(2**31))
    options = {key: _draw(rng, bounds) for key, bounds in track.ranges.items()}
    disturbances = {key: _draw(rng, bounds) for key, bounds in track.disturbances.items()}
    if track.calm and rng.random() < track.calm:
        disturbances = {}
    start = None
    if track.world == BOTH:
        start = _rounded(plain_course(CourseTask(**_own(CourseTask, track)).draw_course(rng)))
    elif track.flies:
        kind = PathTask if track.env_id == PATH else HoverTask
        task = kind(horizon_s=track.seconds, perturbation=OFFSET, **_own(kind, track))
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
    # Robot and wind are drawn by the environment; a flight's preload is what that robot needs at rest in that wind.
    env = make_env(track, scenario, {})
    env.reset(seed=seed, options=reset_options(scenario))
    if isinstance(env, HoverEnv):
        assert start is not None
        trim = env.compute_trim()
        if disturbances:
            trim[:3] -= _mean_air_force(track, scenario)
        start["trim"] = trim.round(3).tolist()
    env.close()
    return Scenario(index, seed, options, start, disturbances, robot_digest(env.sampled_parameters))


def _mean_air_force(track: Track, scenario: Scenario) -> np.ndarray:
    """Force of the wind on a robot that hovers in the initial form where its path begins, mean over `HOVER_TICKS` [N].

    Axes are the world's, turned by the heading.
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


def _own(kind: type[Any], track: Track) -> dict[str, Any]:
    """The track's arguments that are those of its task."""
    return {field.name: track.options[field.name] for field in fields(kind) if field.name in track.options}


def _rounded(value: Any) -> Any:  # noqa: ANN401 - numbers, and lists and dictionaries of them
    """All of its numbers to six digits."""
    if isinstance(value, Mapping):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return round(value, 6) + 0.0 if isinstance(value, float) else value


def _draw(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return round(float(rng.uniform(*bounds)), 6)


def robot_digest(draws: Mapping[str, np.ndarray]) -> str:
    """Digest of the numbers of a drawn robot, to four digits; empty where none is drawn."""
    if not draws:
        return ""
    text = " ".join(f"{x:.4g}" for name in sorted(draws) for x in np.ravel(draws[name]))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def make_env(track: Track, scenario: Scenario, arguments: Mapping[str, Any]) -> SpidarEnv:
    """The environment of a scenario with a policy's arguments, without wrappers."""
    env = gymnasium.make(
        track.env_id, **{**track.options, **scenario.options, **arguments}, horizon_s=track.seconds,
        max_episode_steps=round(track.seconds * CONTROL_RATE), disable_env_checker=True,
    ).unwrapped  # fmt: skip
    assert isinstance(env, SpidarEnv)
    return env


def reset_options(scenario: Scenario) -> dict[str, Any]:
    """Options of `reset`."""
    options: dict[str, Any] = {"disturbances": dict(scenario.disturbances)}
    if scenario.start is None:
        return options
    return {"course" if "gates" in scenario.start else "start": scenario.start, **options}


def scenario_text(name: str, split: str, *, on_scenario: Callable[[], object] = lambda: None) -> str:
    """The file of a track's scenarios: one line each."""
    lines = []
    for index in range(SCENARIOS):
        lines.append(json.dumps(asdict(draw_scenario(name, split, index)), ensure_ascii=False))
        on_scenario()
    head = json.dumps({"track": name, "split": split})
    return f'{{"of": {head}, "scenarios": [\n' + ",\n".join(lines) + "\n]}\n"


def scenario_files(*, on_scenario: Callable[[], object] = lambda: None) -> dict[str, str]:
    """Every scenario file and their hashes: path relative to assets/ → text."""
    files = {}
    for split in SPLITS:
        for name in TRACKS:
            path = f"scenarios/{split}/{name}.json"
            files[path] = _unless_equal(assets_dir() / path, scenario_text(name, split, on_scenario=on_scenario))
    files[PINS] = "".join(f"{_sha256(text)}  {path.split('/', 1)[1]}\n" for path, text in files.items())
    return files


def _unless_equal(path: Path, text: str) -> str:
    """A file's new text, or its present one where the numbers are equal: rounding gives some zeros another sign."""
    try:
        present = path.read_text(encoding="utf-8")
        return present if json.loads(present) == json.loads(text) else text
    except (OSError, ValueError):
        return text


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def load_scenarios(name: str, split: str = "test") -> tuple[tuple[Scenario, ...], str]:
    """A track's committed scenarios, and the hash of their file.

    Raises:
        UnknownNameError: For a track or split that does not exist.
        StaleAssetError: When the file is missing or is not the one that was pinned.
    """
    find_track(name)
    require_name("split", split, SPLITS)
    path, pins = assets_dir() / "scenarios" / split / f"{name}.json", assets_dir() / PINS
    try:
        data = read_file(path, MOST_BYTES).replace(b"\r\n", b"\n")  # as git checks it out elsewhere
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
    """The scenario of an entry that has the form, where its numbers are some that the track can have."""
    start, drawn = entry["start"], ((entry["options"], track.ranges), (entry["disturbances"], track.disturbances))
    fits = entry["index"] == index and 0 <= entry["seed"] < 2**31 and (start is not None) == (track.world != GROUND)
    for values, ranges in drawn:
        none = values is entry["disturbances"] and track.calm > 0.0 and not values
        fits = fits and (none or values.keys() == ranges.keys())
        # They are kept to six digits.
        fits = fits and all(low - 1e-6 <= values.get(key, low) <= high + 1e-6 for key, (low, high) in ranges.items())
    if not fits:
        raise BorderError(f"scenario {index} is none of its track")
    if track.world == BOTH:
        require_form({**start}, COURSE_START, "start")
        parse_course(start)
    elif start is not None:
        require_form({"trim": None, "path": None, **start}, START, "start")
        if (FlightStart.parse(start).path is None) != (track.env_id != PATH):
            raise BorderError(f"scenario {index} is none of its track")
    return Scenario(**entry)


def check_drawn(draws: Mapping[str, np.ndarray], scenario: Scenario, place: str) -> None:
    """Refuse to compare on another robot than the scenario's, as another version of numpy might draw it."""
    if robot_digest(draws) != scenario.robot:
        raise SpidarError(
            f"{place}: the drawn robot is not the scenario's; valid: a numpy whose generators draw as they did, "
            f"or scenarios of one's own by `spidar scenarios`"
        )
