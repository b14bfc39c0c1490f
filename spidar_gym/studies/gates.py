"""Limits of each gait: single gates whose sizes are swept far beyond those of a course, until the gait fails."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.benchmark.resume import finish
from spidar_gym.control.course.gates import CEILING, GATES, POSSIBLE, Course, Gate
from spidar_gym.control.course.pilot import FLY_LOWEST
from spidar_gym.control.course.rule import (
    ABOVE,
    ALIGNED,
    BENEATH,
    FAST,
    FLOWN,
    FORMED,
    NEAR,
    OVER,
    PASSED,
    SLOW,
    THROUGH,
    course_rule,
)
from spidar_gym.control.course.target import Target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.envs.course_env import CourseEnv
from spidar_gym.tasks.course import DEPTHS, FLOOR_LENGTH, GOAL_WAY, SIZES

SWEPT = {
    "wall": (0.01, 0.02, 0.05, 0.1, 0.4, 1.0, 1.5, 1.8, 2.1, 2.3, 2.5, 2.6, 2.7),
    "beam": (0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.8, 1.0, 1.1, 1.2, 1.4, 1.6, 1.8),
    "slot": (0.9, 1.0, 1.1, 1.2, 1.3, 1.6, 1.9, 2.2, 2.4, 2.6, 2.8, 3.0, 3.4),
    "platform": (0.01, 0.02, 0.05, 0.1, 0.4, 0.8, 1.2, 1.6, 2.0),
    "tiles": (0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3, 0.5),
    "slope": (0.02, 0.05, 0.1, 0.15, 0.175, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8),
}
"""Swept sizes of each kind of gate: heights, clearances, widths, heights of the highest tile [m], angles [rad]."""
CLIMBS = {"wall": 0.1, "platform": 0.1, "tiles": 0.2, "slope": 0.4}
"""Largest sizes that are tried with crawl only; all robots already fail at half of these sizes."""
GAITS = ("rule", "fly wide", "fly narrow", "crawl")
"""Gaits: the rule with both gaits; flight only, in form ① and in form ③; crawl only."""
BEGIN, BEHIND = 1.8, 1.8
"""Distance from the start to the gate, and from the end of a passed gate to the goal [m]."""
SECONDS, PATIENCE, STEP = 150.0, 25.0, 0.05
"""Length of an episode [s]; a robot is stuck if its distance to the goal falls by less than `STEP` [m] in `PATIENCE`
[s]."""
STRENGTH = 0.5
"""Strength of the randomisation of the robots, which have noisy sensors."""
HIGHEST = CEILING - 0.3
"""Largest height of flight only, for walls of any height [m]."""
LANDED = 0.3
"""Distance from the goal within which flight only has arrived [m]; with crawls the task's success is required."""


@dataclass(frozen=True)
class Case:
    """One robot at one gate."""

    kind: str
    """Kind of the gate."""
    size: float
    """Size of the gate [m or rad]."""
    gait: str
    """One of `GAITS`."""
    seed: int
    """Seed of robot, noise and tiles."""


def course_of(kind: str, size: float, seed: int) -> Course:
    """Build the course of a single gate or floor, with the goal behind or on it; the size may be impassable."""
    gate = Gate(kind, BEGIN, BEGIN + DEPTHS.get(kind, FLOOR_LENGTH), size)
    goal = Pose2(gate.end + BEHIND if gate.is_passed else gate.begin + sum(GOAL_WAY) / 2.0)
    rng = np.random.Generator(np.random.PCG64(seed))
    return Course((gate,), goal, tuple(rng.uniform(0.0, size, gate.tile_count).tolist()), dares=True)


def fly_alone(course: Course, position_w: Vector3, joint_position: JointVector, phase: str, narrow: float) -> Target:
    """Return the target of flight only: pass the gate in one form, land at the goal, and stay there.

    Args:
        course: Course with a single gate.
        position_w: Position of the torso, world, (3,) [m].
        joint_position: q, (16,) [rad].
        phase: Phase of the locomotion manager.
        narrow: Form, from 0, stretched out, to 1, legs below the torso.
    """
    x, y, z = position_w.tolist()
    gate, goal = course.gates[0], course.goal
    off = math.hypot(goal.x - x, goal.y - y)
    lies = phase in ("lie", "crawl")
    if phase in ("descend", "unload") or (lies and off < LANDED):
        return Target(x=x, y=y)
    if not gate.is_passed or x >= gate.end + PASSED:
        if off < NEAR and not lies:
            return Target(x=x, y=y)
        return Target(flies=True, x=goal.x, y=goal.y, z=course.floor_at(goal.x) + ABOVE, speed=FAST)
    height = {"wall": min(gate.size + OVER, HIGHEST), "beam": FLY_LOWEST, "slot": THROUGH}[gate.kind]
    past = Target(flies=True, x=gate.end + FLOWN, y=gate.middle, z=height, speed=SLOW, narrow=narrow)
    before = gate.begin - FLOWN
    has_form = float(np.abs(joint_position - past.form).max()) < FORMED
    is_in_line = abs(x - before) < NEAR and abs(y - gate.middle) < ALIGNED and z > height - BENEATH
    if has_form and (is_in_line or x >= before + NEAR):
        return past
    return Target(flies=True, x=before, y=gate.middle, z=height, speed=SLOW, narrow=narrow)


def choose(gait: str, course: Course, position_w: Vector3, joint_position: JointVector, phase: str) -> Target:
    """Return the next target of a gait."""
    if gait.startswith("fly"):
        return fly_alone(course, position_w, joint_position, phase, float(gait == "fly narrow"))
    target = course_rule(course, position_w, joint_position, phase, flies=gait == "rule")
    return replace(target, z=min(target.z, CEILING))


def play(case: Case) -> dict[str, Any]:
    """Run one episode of a case.

    Returns:
        `arrived`; `failure`, a word of `info["failure"]`, or `stuck`; `time_s` [s]; `off_m`, distance from the goal.
    """
    course = course_of(case.kind, case.size, case.seed)
    env = CourseEnv(course=course, charge=1.0, sensors=True, randomization=STRENGTH, horizon_s=SECONDS)
    env.reset(seed=case.seed)
    flies_only = case.gait.startswith("fly")
    arrived, off, nearest, since, info = False, math.inf, math.inf, 0.0, dict[str, Any]()
    for _ in range(env.horizon):
        seen = env.seen
        target = choose(case.gait, course, seen.position_w, seen.joint_position, env.controller.phase)
        _, _, terminated, _, info = env.step(target.action(course, seen.position_w))
        off = math.hypot(*info["goal_error"][:2].tolist())
        arrived = bool(info["is_success"]) or (flies_only and bool(info["lies"]) and not terminated and off < LANDED)
        if off < nearest - STEP:
            nearest, since = off, info["time_s"]
        if terminated or arrived or info["time_s"] > since + PATIENCE:
            break
    env.close()
    failure = "" if arrived else info["failure"] or "stuck"
    return {"arrived": arrived, "failure": failure, "time_s": info["time_s"], "off_m": off}


def gaits_at(kind: str, size: float) -> tuple[str, ...]:
    """Return the gaits that are tried at a gate.

    On a floor there is no narrow flight, since every flight lands in the start pose of a crawl.
    """
    climbs = size > CLIMBS.get(kind, size)
    return tuple(
        gait for gait in GAITS
        if not (gait == "crawl" and climbs) and not (gait == "fly narrow" and kind not in GATES)
    )  # fmt: skip


def cells() -> list[tuple[str, float, str]]:
    """Return kind, size and gait of every cell of the sweep."""
    return [(kind, size, gait) for kind, sizes in SWEPT.items() for size in sizes for gait in gaits_at(kind, size)]


def sweep(
    *, seeds: int = 6, workers: int = 1, folder: Path | None = None, on_run: Callable[[], object] = lambda: None
) -> list[dict[str, Any]]:
    """Run every gait at every gate, with `seeds` randomised robots each.

    Finished runs are stored in `folder`, and an interrupted call resumes from them.


    Returns:
        One row per cell: kind, size, gait, number of runs and arrivals, failures, median time of arrival [s].
    """
    cases = [Case(*cell, seed) for cell in cells() for seed in range(seeds)]
    found = finish(play, cases, workers=workers, folder=folder, on_done=lambda *_: on_run())
    rows = []
    for k, (kind, size, gait) in enumerate(cells()):
        own = found[k * seeds : (k + 1) * seeds]
        times = [run["time_s"] for run in own if run["arrived"]]
        failures = Counter(run["failure"] for run in own if not run["arrived"])
        rows.append({
            "kind": kind, "size": size, "gait": gait, "runs": seeds, "arrived": len(times),
            "failures": dict(sorted(failures.items())), "time_s": float(np.median(times)) if times else None,
        })  # fmt: skip
    return rows


def gate_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the rows as a table of the sizes at which all robots of a gait arrive, some, and none."""
    lines = [["gate", "sizes of Course-v0", "gait", "all arrive", "some", "none", "failures"]]
    for (kind, gait), found in groupby(sorted(rows, key=_place), key=lambda row: (row["kind"], row["gait"])):
        own = list(found)
        unit, swept = POSSIBLE[kind][2], [row["size"] for row in own]
        low, high = SIZES[kind]
        shares = [row["arrived"] / row["runs"] for row in own]
        which = [
            [share == 1.0 for share in shares],
            [0.0 < share < 1.0 for share in shares],
            [s == 0.0 for s in shares],
        ]
        failures = Counter[str]()
        for row in own:
            failures.update(row["failures"])
        lines.append([
            kind, f"{low:.3g} … {high:.3g} {unit}", gait, *(_sizes(swept, chosen) for chosen in which),
            ", ".join(f"{word} {count}" for word, count in failures.most_common()),
        ])  # fmt: skip
    return lines


def _place(row: dict[str, Any]) -> tuple[int, int, float]:
    """Return the sort key of a row in the table."""
    return list(SWEPT).index(row["kind"]), GAITS.index(row["gait"]), row["size"]


def _sizes(swept: list[float], chosen: list[bool]) -> str:
    """Format the chosen sizes, with neighbours as one range."""
    runs = [
        list(own) for is_chosen, own in groupby(zip(swept, chosen, strict=True), key=lambda each: each[1]) if is_chosen
    ]
    ends = [(run[0][0], run[-1][0]) for run in runs]
    return ", ".join(f"{low:g}" if low == high else f"{low:g} … {high:g}" for low, high in ends)
