"""Drift of the motion capture in a crawl: what it takes from the successes, and whether the legs could replace it."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.arrays import FootForces, JointVector
from spidar_gym.benchmark.resume import finish
from spidar_gym.benchmark.scenario import load_scenarios, make_env
from spidar_gym.benchmark.track import CALIBRATED, GROUND, TRACKS, WORLD
from spidar_gym.control.crawl.gait import ON_FEET
from spidar_gym.control.crawl.kinematics import feet_at
from spidar_gym.control.crawl.pose2 import torso_pose2
from spidar_gym.control.presets import crawler_config
from spidar_gym.paper.calibration import require_world
from spidar_gym.robot import N_LEGS, ROBOT
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import RobotState
from spidar_gym.tasks.crawl import SUCCESS_POSITION, SUCCESS_YAW

TRACK = next(name for name, track in TRACKS.items() if track.group == CALIBRATED[GROUND])
"""Track whose crawls are studied."""


@dataclass(frozen=True)
class Case:
    """One crawl."""

    preset: str
    """Preset of the crawler."""
    split: str
    """Split of the scenario."""
    index: int
    """Number of the scenario."""


def moved(before: RobotState, after: RobotState) -> np.ndarray:
    """Return how far feet that stand say that the torso has moved between two states, world axes (2,) [m].

    A leg that turns down by an angle rolls the ball of its foot outwards by its radius times the angle.
    """
    R0, R1 = quat_to_matrix(before.quat_wb), quat_to_matrix(after.quat_wb)
    feet = _feet(after) @ R1.T - _feet(before) @ R0.T
    turned = after.joint_position - before.joint_position
    out = np.zeros(3)
    for leg in range(N_LEGS):
        heading = ROBOT.leg_azimuth(leg) + after.joint_position[4 * leg]
        along = np.array([math.cos(heading), math.sin(heading), 0.0])
        out += ROBOT.foot_radius * (turned[4 * leg + 1] + turned[4 * leg + 3]) / N_LEGS * (R1 @ along)
    return (out - feet.mean(axis=0))[:2]


def _feet(state: RobotState) -> FootForces:
    q: JointVector = state.joint_position
    return feet_at(q, ROBOT)


def play(case: Case) -> dict[str, Any]:
    """Crawl once: misses of the goal in truth and as the robot sees it, error of odometry by the legs."""
    scenario = load_scenarios(TRACK, case.split)[0][case.index]
    env: Any = make_env(TRACKS[TRACK], scenario, {"preset": case.preset, "control": "python"})
    env.reset(seed=scenario.seed)
    inner, still = env.unwrapped, np.zeros(env.action_space.shape)
    start, before, walked = inner.state, inner.seen, np.zeros(2)
    while True:
        *_, terminated, truncated, info = env.step(still)
        if inner.controller.gait.phase in ON_FEET:
            walked = walked + moved(before, inner.seen)
        before = inner.seen
        if terminated or truncated or info["finished"]:
            break
    here = torso_pose2(before.position_w, quat_to_matrix(before.quat_wb))
    goal = inner.controller.gait.memory.planned
    error, way = np.asarray(info["goal_error"], float), (inner.state.position_w - start.position_w)[:2]
    missed = [word for word in str(info["shortfalls"]).split(", ") if word]
    env.close()
    return {
        "failure": str(info["failure"]),
        "missed": missed,
        "true_m": float(np.hypot(*error[:2])),
        "true_yaw": abs(float(error[2])),
        "seen_m": math.hypot(goal.x - here.x, goal.y - here.y),
        "seen_yaw": abs(math.remainder(goal.yaw - here.yaw, 2.0 * math.pi)),
        "legs_m": float(np.linalg.norm(walked - way)),
        "seconds": float(info["time_s"]),
    }


def drift_study(
    preset: str, split: str, count: int, *, workers: int = 1, folder: Path | None = None,
    on_crawl: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run the crawls of the calibrated ground track, and compare the misses of their goals; resumes from `folder`.

    Args:
        preset: Preset of the crawler.
        split: Split of the scenarios.
        count: Number of scenarios, from the first.
        workers: Number of processes.
        folder: Folder for finished crawls.
        on_crawl: Called after each crawl.

    Returns:
        One row for each mixture of the world, then one for all.

    Raises:
        UnknownNameError: For an unknown preset.
    """
    crawler_config(preset)
    cases = [Case(preset, split, k) for k in range(count)]
    found = finish(play, cases, workers=workers, folder=folder, on_done=lambda *_: on_crawl())
    kinds = [TRACKS[TRACK].robots(k).name.partition(":")[2].partition("-")[0] for k in range(count)]
    rows = []
    for mixture in (*(name for name, _ in require_world(WORLD).mixtures), ""):
        own = [one for one, kind in zip(found, kinds, strict=True) if mixture in ("", kind)]
        if own:
            rows.append({"preset": preset, "split": split, "mixture": mixture, **_row(own)})
    return rows


def _row(crawls: list[dict[str, Any]]) -> dict[str, Any]:
    def without_drift(one: dict[str, Any]) -> bool:
        others = [word for word in one["missed"] if word not in ("position", "yaw")]
        near = one["seen_m"] <= SUCCESS_POSITION and one["seen_yaw"] <= SUCCESS_YAW
        return near and not others and not one["failure"]

    keys = ("true_m", "true_yaw", "seen_m", "seen_yaw", "legs_m")
    return {
        "crawls": len(crawls),
        "succeeded": sum(not one["missed"] and not one["failure"] for one in crawls),
        "without_drift": sum(map(without_drift, crawls)),
        "beyond_by_legs": sum(one["legs_m"] > SUCCESS_POSITION for one in crawls),
        **{key: [float(np.quantile([one[key] for one in crawls], q)) for q in (0.5, 0.9)] for key in keys},
    }


def drift_lines(rows: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return the table: one line for each mixture; medians and 90 % quantiles."""
    lines = [[
        "robots", "crawls", "succeeded", "as the robot sees it", "miss [mm]", "as it sees it [mm]", "miss [mrad]",
        "as it sees it [mrad]", "error of the legs' odometry [mm]", "of them beyond 10 mm",
    ]]  # fmt: skip
    for row in rows:
        keys = ("true_m", "seen_m", "true_yaw", "seen_yaw", "legs_m")
        cells = [" … ".join(f"{1e3 * value:.1f}" for value in row[key]) for key in keys]
        counts = [str(row[key]) for key in ("crawls", "succeeded", "without_drift")]
        lines.append([row["mixture"] or "all", *counts, *cells, str(row["beyond_by_legs"])])
    return lines
