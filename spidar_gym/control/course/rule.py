"""The rule: gait, form and next place by the geometry of the next gate."""

import math

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.course.gates import Course, Gate
from spidar_gym.control.course.target import Target

FLOWN, CRAWLED = 1.5, 1.35
"""A flight begins to pass a gate so far before it, and is past it so far behind; a crawl is, so far behind it [m]."""
PASSED = 1.25
"""A gate counts as passed so far behind it [m]; in the air a beam does at its end: no other way leads there."""
OVER, ABOVE, THROUGH = 1.0, 1.0, 1.4
"""Heights of the torso over a wall, over where it lands, and in a slot [m]."""
SLOW, FAST = 0.5, 0.8
"""Speeds in a slot and elsewhere [m/s]."""
CRAWLS = 2.8
"""A beam so near is crawled to, a goal nearer than a third of that [m]."""
NEAR, BENEATH, ALIGNED = 0.08, 0.15, 0.03
"""It is at a place so near to it; high enough at most so far below; in line with a slot up to this [m]."""
FORMED = 0.06
"""A form is taken when every joint is this close [rad]."""


def course_rule(
    course: Course, position_w: Vector3, joint_position: JointVector, phase: str, *, flies: bool = True,
    crawls: bool = True,
) -> Target:  # fmt: skip
    """Where to go from here: over walls and through slots in the air, under beams on the floor, to the goal by both.

    Args:
        course: The map.
        position_w: Of the torso (3,), world [m].
        joint_position: q (16,) [rad].
        phase: What the manager of both gaits is doing, one of `PHASES`.
        flies: Whether it may fly; else it crawls straight to the goal.
        crawls: Whether it may crawl; else it waits before a beam, and rests where it lands.
    """
    x, y, z = position_w.tolist()
    goal = course.goal
    on_floor, lands = phase in ("lie", "crawl"), phase in ("descend", "unload")
    here, to_goal = Target(x=x, y=y), Target(x=goal.x, y=goal.y, yaw=goal.yaw)
    if not flies:
        return to_goal
    gate = next((g for g in course.gates if g.is_passed and x < g.end + _behind(g, on_floor)), None)
    if gate is None or gate.begin > goal.x:
        if lands or (on_floor and not crawls):
            return here
        if on_floor and math.hypot(goal.x - x, goal.y - y) < CRAWLS / 3.0:
            return to_goal
        return _above(goal.x, goal.y, course.floor_at(goal.x), x, y, on_floor)
    if gate.kind == "wall":
        return _over(gate, x, z, joint_position)
    if gate.kind == "slot":
        return _through(gate, x, y, joint_position)
    if lands:
        return here
    if on_floor and crawls and gate.begin - x < CRAWLS:
        return Target(x=gate.end + CRAWLED, y=0.0)
    return _above(gate.begin - FLOWN, 0.0, 0.0, x, y, on_floor or not crawls)


def _behind(gate: Gate, on_floor: bool) -> float:
    """From how far behind it a gate is passed: who drifts back while taking off is not sent back through a beam [m]."""
    return PASSED if on_floor or gate.kind != "beam" else 0.0


def _above(to_x: float, to_y: float, floor: float, x: float, y: float, stays: bool) -> Target:
    """Over where it is to land, and down once it is there unless it `stays`."""
    if not stays and math.hypot(to_x - x, to_y - y) < NEAR:
        return Target(x=x, y=y)
    return Target(flies=True, x=to_x, y=to_y, z=floor + ABOVE, speed=FAST)


def _over(gate: Gate, x: float, z: float, q: JointVector) -> Target:
    """First high enough and stretched out, then across."""
    over = Target(flies=True, x=gate.end + FLOWN, z=gate.size + OVER, speed=FAST)
    if z > over.z - BENEATH and _has_form(q, over):
        return over
    return Target(flies=True, x=min(x, gate.begin - FLOWN), z=over.z, speed=FAST)


def _through(gate: Gate, x: float, y: float, q: JointVector) -> Target:
    """First in line and narrow, then through."""
    before = gate.begin - FLOWN
    through = Target(flies=True, x=gate.end + FLOWN, y=gate.middle, z=THROUGH, speed=SLOW, narrow=1.0)
    is_in_line = abs(x - before) < NEAR and abs(y - gate.middle) < ALIGNED
    if _has_form(q, through) and (x >= before + NEAR or is_in_line):
        return through
    return Target(flies=True, x=before, y=gate.middle, z=THROUGH, speed=FAST, narrow=1.0)


def _has_form(q: JointVector, target: Target) -> bool:
    return float(np.abs(q - target.form).max()) < FORMED
