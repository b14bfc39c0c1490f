"""Flights of many calibrated robots: falls and errors of flight controllers, the same flights for each."""

import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play as play_track
from spidar_gym.benchmark.resume import finish
from spidar_gym.benchmark.scenario import Scenario, draw_scenario_from
from spidar_gym.benchmark.statistics import named_generator
from spidar_gym.benchmark.track import TRACKS, WORLD
from spidar_gym.control.presets import controller_config
from spidar_gym.envs.registry import HOVER
from spidar_gym.errors import InvalidValueError
from spidar_gym.paper.calibration import require_world
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import Policy, policy_arguments
from spidar_gym.policies.presets import OwnController

TRACK = "flight-calibrated"
"""Track whose flights are drawn anew."""
CONTROLLERS = ("steady", "baselines.adrc:Adrc", "tuned")
"""Default controllers; ratios are those of the first one to the others."""
JOINT_SPEEDS = (0.2, 0.6)
"""Default joint speeds [rad/s]."""
SEED = 12
"""Number in the flights' seeds that no split of the benchmark and no search has."""
RESAMPLES = 2000
"""Number of resamples of the intervals."""


@dataclass(frozen=True)
class Flight:
    """One flight of one robot."""

    controller: str
    """Preset, or policy `module:Class`."""
    joint_speed: float
    """Joint speed [rad/s]."""
    robot: int
    """Number of the robot; kinds of the world come in turn."""


def draw(joint_speed: float, robot: int) -> Scenario:
    """Sample a flight: forms, start, robot and noise, which do not depend on the controller."""
    seed = [zlib.crc32(TRACK.encode()), SEED, round(1e3 * joint_speed), robot]
    scenario = draw_scenario_from(TRACKS[TRACK], np.random.Generator(np.random.PCG64(seed)), robot)
    return replace(scenario, options={**scenario.options, "joint_speed": joint_speed})


def policy_of(controller: str) -> Policy:
    """Return the policy of a preset, or the one `module:Class`.

    Raises:
        UnknownNameError: For an unknown preset.
        PolicyError: For an unknown policy.
        InvalidValueError: For a policy that is not defined in flights.
    """
    if ":" not in controller:
        controller_config(controller)
        return OwnController({"preset": controller})
    policy = load_policy(controller)
    if policy_arguments(policy, HOVER) is None:
        raise InvalidValueError("controllers", controller, "presets, or policies of flights")
    return policy


def play(flight: Flight) -> dict[str, Any]:
    """Fly once: the `error` of the track, and whether the robot `fell`."""
    (played,) = play_track(policy_of(flight.controller), TRACK, [draw(flight.joint_speed, flight.robot)])
    metrics = played["metrics"]
    return {"error": metrics["error"], "fell": bool(metrics["failed"])}


def flight_study(
    controllers: Sequence[str], joint_speeds: Sequence[float], robots: int, *, workers: int = 1,
    folder: Path | None = None, on_flight: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Fly the same robots with every controller; resumes from `folder`.

    Args:
        controllers: Presets, or policies `module:Class`.
        joint_speeds: Joint speeds [rad/s].
        robots: Number of flights at each speed.
        workers: Number of processes.
        folder: Folder for finished flights.
        on_flight: Called after each flight.

    Returns:
        One row for each controller, speed and variant of the hardware, `all` included, and one over all speeds: falls,
        mean error, and the ratio of the first controller's mean error to this one's with its 95 % interval.
    """
    for controller in controllers:
        policy_of(controller)
    flights = [Flight(c, speed, k) for c in controllers for speed in joint_speeds for k in range(robots)]
    found = finish(play, flights, workers=workers, folder=folder, on_done=lambda *_: on_flight())
    shape = len(controllers), len(joint_speeds), robots
    errors = np.array([one["error"] for one in found]).reshape(shape)
    fell = np.array([one["fell"] for one in found]).reshape(shape)
    variants = [name for name, _ in require_world(WORLD).variants]
    of = [TRACKS[TRACK].robots(k).name.rpartition("-")[2] for k in range(robots)]
    rows = []
    for c, controller in enumerate(controllers):
        for speed, at in [*((speed, [k]) for k, speed in enumerate(joint_speeds)), (None, list(range(shape[1])))]:
            for variant in (*variants, "all"):
                own = [k for k in range(robots) if variant in ("all", of[k])]
                if not own:
                    continue
                first, mine = (errors[i][np.ix_(at, own)] for i in (0, c))
                low, high = ratio_interval(first, mine, f"{controller} {speed} {variant}")
                rows.append({
                    "controller": controller, "joint_speed": speed, "variant": variant, "flights": mine.size,
                    "falls": int(fell[c][np.ix_(at, own)].sum()), "error": float(mine.mean()),
                    "ratio": float(first.mean() / mine.mean()), "low": low, "high": high,
                })  # fmt: skip
    return rows


def ratio_interval(first: np.ndarray, other: np.ndarray, name: str) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of the ratio of two mean errors over the same flights.

    Args:
        first: Errors (speeds, robots).
        other: Errors of the other controller, same shape; flights are resampled in pairs within each speed.
        name: Name that seeds the resampling.
    """
    rng = named_generator(name)
    speeds, robots = first.shape
    picks = rng.integers(robots, size=(RESAMPLES, speeds, robots))
    rows = np.arange(speeds)[None, :, None]
    ratios = first[rows, picks].mean(axis=(1, 2)) / other[rows, picks].mean(axis=(1, 2))
    low, high = np.quantile(ratios, [0.025, 0.975]).tolist()
    return low, high


def flight_lines(rows: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return the table: one line for each controller, speed and variant."""
    rows = list(rows)
    first = rows[0]["controller"] if rows else ""
    lines = [["controller", "joint speed", "robots", "flights", "falls", "error", f"error of {_name(first)} to it"]]
    for row in rows:
        ratio = "–" if row["controller"] == first else f"{row['ratio']:.3f} ({row['low']:.3f} … {row['high']:.3f})"
        speed = "all" if row["joint_speed"] is None else f"{row['joint_speed']:g} rad/s"
        numbers = [str(row["flights"]), str(row["falls"]), f"{row['error']:.3f}"]
        lines.append([_name(row["controller"]), speed, row["variant"], *numbers, ratio])
    return lines


def _name(controller: str) -> str:
    return f"`{controller.rpartition(':')[2].lower()}`"
