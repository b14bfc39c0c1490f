"""The rule: gait, form and next place by the geometry of the next gate."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.course.gates import CEILING, Course, Gate
from spidar_gym.control.course.target import Target

FLOWN, CRAWLED = 1.5, 1.35
"""A flight begins to pass a gate so far before it, and is past it so far behind; a crawl is, so far behind it [m]."""
PASSED = 1.25
"""A gate counts as passed so far behind it [m]; from the air a beam does at its end, for nobody flies back under it."""
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


@dataclass(frozen=True, slots=True)
class RuleNumbers:
    """The rule's numbers by obstacle; environment and core go by those that are given here."""

    wall_before: float = FLOWN
    """So far before a wall it waits until it is high enough [m]."""
    wall_passed: float = PASSED
    """A wall counts as passed so far behind it [m]."""
    wall_beyond: float = FLOWN - PASSED
    """A flight over a wall leads so far beyond that [m]: 0 or less never gets there."""
    wall_over: float = OVER
    """Height over a wall [m]."""
    wall_beneath: float = BENEATH
    """So far below that it is high enough [m]."""
    wall_speed: float = FAST
    """Speed over a wall [m/s]."""
    slot_before: float = FLOWN
    """So far before a slot it takes its form [m]."""
    slot_passed: float = PASSED
    """A slot counts as passed so far behind it [m]."""
    slot_beyond: float = FLOWN - PASSED
    """A flight through a slot leads so far beyond that [m]."""
    slot_height: float = THROUGH
    """Height in a slot [m]."""
    slot_speed: float = SLOW
    """Speed in a slot [m/s]."""
    slot_aligned: float = ALIGNED
    """It is in line with a slot up to this [m]."""
    beam_before: float = FLOWN
    """It lands so far before a beam [m]."""
    beam_crawls: float = CRAWLS
    """On the floor it crawls to a beam that begins so near [m]; less than it lands before it never goes there."""
    beam_passed: float = PASSED
    """A beam counts as passed so far behind it [m]."""
    beam_beyond: float = CRAWLED - PASSED
    """A crawl leads so far beyond that [m]."""
    goal_crawls: float = CRAWLS / 3.0
    """A goal so near is crawled to [m]."""
    above: float = ABOVE
    """Height over where it lands [m]."""
    speed: float = FAST
    """Speed to where it lands, and to where it waits or takes a form [m/s]."""
    near: float = NEAR
    """It is at a place so near to it [m]."""
    formed: float = FORMED
    """A form is taken when every joint is this close [rad]."""


PRESENT = RuleNumbers()
"""Those that it has."""


def course_rule(
    course: Course, position_w: Vector3, joint_position: JointVector, phase: str, *, flies: bool = True,
    crawls: bool = True, numbers: RuleNumbers = PRESENT,
) -> Target:  # fmt: skip
    """Where to go from here: over walls and through slots in the air, under beams on the floor, to the goal by both.

    Args:
        course: The map.
        position_w: Of the torso (3,), world [m].
        joint_position: q (16,) [rad].
        phase: What the manager of both gaits is doing, one of `PHASES`.
        flies: Whether it may fly; else it crawls straight to the goal.
        crawls: Whether it may crawl; else it waits before a beam, and rests where it lands.
        numbers: Distances, heights, speeds and bounds.
    """
    x, y, z = position_w.tolist()
    goal, n = course.goal, numbers
    on_floor, lands = phase in ("lie", "crawl"), phase in ("descend", "unload")
    here, to_goal = Target(x=x, y=y), Target(x=goal.x, y=goal.y, yaw=goal.yaw)
    if not flies:
        return to_goal
    # Where a crawl ends a take-off may drift back by some centimetres: that is no reason to fly into the beam.
    passed = {"wall": n.wall_passed, "slot": n.slot_passed, "beam": n.beam_passed if on_floor else 0.0}
    gate = next((g for g in course.gates if g.is_passed and x < g.end + passed[g.kind]), None)
    if gate is None or gate.begin > goal.x:
        if lands or (on_floor and not crawls):
            return here
        if on_floor and math.hypot(goal.x - x, goal.y - y) < n.goal_crawls:
            return to_goal
        return _above(goal.x, goal.y, course.floor_at(goal.x), x, y, on_floor, n)
    if gate.kind == "wall":
        return _over(gate, x, z, joint_position, n)
    if gate.kind == "slot":
        return _through(gate, x, y, joint_position, n)
    if lands:
        return here
    if on_floor and crawls and gate.begin - x < n.beam_crawls:
        return Target(x=gate.end + (n.beam_passed + n.beam_beyond), y=0.0)
    return _above(gate.begin - n.beam_before, 0.0, 0.0, x, y, on_floor or not crawls, n)


def _above(to_x: float, to_y: float, floor: float, x: float, y: float, stays: bool, n: RuleNumbers) -> Target:
    """Over where it is to land, and down once it is there unless it `stays`."""
    if not stays and math.hypot(to_x - x, to_y - y) < n.near:
        return Target(x=x, y=y)
    return Target(flies=True, x=to_x, y=to_y, z=floor + n.above, speed=n.speed)


def _over(gate: Gate, x: float, z: float, q: JointVector, n: RuleNumbers) -> Target:
    """First high enough and stretched out, then across."""
    behind, height = gate.end + (n.wall_passed + n.wall_beyond), min(gate.size + n.wall_over, CEILING)
    over = Target(flies=True, x=behind, z=height, speed=n.wall_speed)
    if z > over.z - n.wall_beneath and _has_form(q, over, n):
        return over
    return Target(flies=True, x=min(x, gate.begin - n.wall_before), z=over.z, speed=n.speed)


def _through(gate: Gate, x: float, y: float, q: JointVector, n: RuleNumbers) -> Target:
    """First in line and narrow, then through."""
    before, behind = gate.begin - n.slot_before, gate.end + (n.slot_passed + n.slot_beyond)
    through = Target(flies=True, x=behind, y=gate.middle, z=n.slot_height, speed=n.slot_speed, narrow=1.0)
    is_in_line = abs(x - before) < n.near and abs(y - gate.middle) < n.slot_aligned
    if _has_form(q, through, n) and (x >= before + n.near or is_in_line):
        return through
    return Target(flies=True, x=before, y=gate.middle, z=n.slot_height, speed=n.speed, narrow=1.0)


def _has_form(q: JointVector, target: Target, n: RuleNumbers) -> bool:
    return float(np.abs(q - target.form).max()) < n.formed
