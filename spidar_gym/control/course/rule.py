"""The rule: chooses gait, form and next position from the geometry of the next gate."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.course.gates import CEILING, Course, Gate
from spidar_gym.control.course.target import Target

FLOWN, CRAWLED = 1.5, 1.35
"""Distances from a gate at which a flight past it begins and ends; distance behind a beam where a crawl ends [m]."""
PASSED = 1.25
"""A gate counts as passed this far behind its end [m]; in the air a beam does at its end."""
OVER, ABOVE, THROUGH = 1.0, 1.0, 1.4
"""Heights of the centre of mass over a wall, above a landing place, and in a slot [m]."""
SLOW, FAST = 0.5, 0.8
"""Speeds in a slot and elsewhere [m/s]."""
CRAWLS = 2.8
"""Distance of a beam below which the robot crawls to it [m]; for the goal a third of this."""
NEAR, BENEATH, ALIGNED = 0.08, 0.15, 0.03
"""Tolerances of a position, of the height over a wall (below), and of the alignment with a slot [m]."""
FORMED = 0.06
"""A form is taken when every joint is this close [rad]."""


@dataclass(frozen=True, slots=True)
class RuleNumbers:
    """Parameters of the rule by obstacle, used by the environment and by the core."""

    wall_before: float = FLOWN
    """Distance before a wall at which the robot waits until it is high enough [m]."""
    wall_passed: float = PASSED
    """A wall counts as passed this far behind its end [m]."""
    wall_beyond: float = FLOWN - PASSED
    """A flight over a wall ends this far beyond `wall_passed` [m]; with 0 or less the wall is never passed."""
    wall_over: float = OVER
    """Height over a wall [m]."""
    wall_beneath: float = BENEATH
    """Distance below that height at which the robot is high enough [m]."""
    wall_speed: float = FAST
    """Speed over a wall [m/s]."""
    slot_before: float = FLOWN
    """Distance before a slot at which the robot takes its form [m]."""
    slot_passed: float = PASSED
    """A slot counts as passed this far behind its end [m]."""
    slot_beyond: float = FLOWN - PASSED
    """A flight through a slot ends this far beyond `slot_passed` [m]."""
    slot_height: float = THROUGH
    """Height in a slot [m]."""
    slot_speed: float = SLOW
    """Speed in a slot [m/s]."""
    slot_aligned: float = ALIGNED
    """Largest lateral error at which the robot is aligned with a slot [m]."""
    beam_before: float = FLOWN
    """Distance before a beam at which the robot lands [m]."""
    beam_crawls: float = CRAWLS
    """Distance of a beam below which a robot on the floor crawls to it [m]; below `beam_before` it never does."""
    beam_passed: float = PASSED
    """A beam counts as passed this far behind its end [m]."""
    beam_beyond: float = CRAWLED - PASSED
    """A crawl under a beam ends this far beyond `beam_passed` [m]."""
    goal_crawls: float = CRAWLS / 3.0
    """Distance of the goal below which a robot on the floor crawls to it [m]."""
    above: float = ABOVE
    """Height above a landing place before the descent [m]."""
    speed: float = FAST
    """Speed to a landing place and to a waiting position before a gate [m/s]."""
    near: float = NEAR
    """The robot has reached a position within this distance [m]."""
    formed: float = FORMED
    """A form is taken when every joint is this close [rad]."""


PRESENT = RuleNumbers()
"""The default parameters."""


def course_rule(
    course: Course, position_w: Vector3, joint_position: JointVector, phase: str, *, flies: bool = True,
    crawls: bool = True, numbers: RuleNumbers = PRESENT,
) -> Target:  # fmt: skip
    """Compute the next target: over walls and through slots in the air, under beams on the floor, to the goal by both.

    Args:
        course: The map.
        position_w: Position of the torso (3,), world [m].
        joint_position: q (16,) [rad].
        phase: Phase of the manager of both gaits, one of `PHASES`.
        flies: Whether the robot may fly; otherwise it crawls straight to the goal.
        crawls: Whether the robot may crawl; otherwise it hovers before a beam, and stays where it lands.
        numbers: Distances, heights, speeds and tolerances.
    """
    x, y, z = position_w.tolist()
    goal, n = course.goal, numbers
    on_floor, lands = phase in ("lie", "crawl"), phase in ("descend", "unload")
    here, to_goal = Target(x=x, y=y), Target(x=goal.x, y=goal.y, yaw=goal.yaw)
    if not flies:
        return to_goal
    # In the air a beam is passed at its end: a take-off after the crawl may drift back by some centimetres, and the
    # robot must not fly into the beam then.
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
    """Compute the target above a landing place, or a landing once the robot is there, unless it `stays`."""
    if not stays and math.hypot(to_x - x, to_y - y) < n.near:
        return Target(x=x, y=y)
    return Target(flies=True, x=to_x, y=to_y, z=floor + n.above, speed=n.speed)


def _over(gate: Gate, x: float, z: float, q: JointVector, n: RuleNumbers) -> Target:
    """Compute the target at a wall: before it until the robot is high enough and stretched out, then behind it."""
    behind, height = gate.end + (n.wall_passed + n.wall_beyond), min(gate.size + n.wall_over, CEILING)
    over = Target(flies=True, x=behind, z=height, speed=n.wall_speed)
    if z > over.z - n.wall_beneath and _has_form(q, over, n):
        return over
    return Target(flies=True, x=min(x, gate.begin - n.wall_before), z=over.z, speed=n.speed)


def _through(gate: Gate, x: float, y: float, q: JointVector, n: RuleNumbers) -> Target:
    """Compute the target at a slot: before it until the robot is aligned and narrow, then behind it."""
    before, behind = gate.begin - n.slot_before, gate.end + (n.slot_passed + n.slot_beyond)
    through = Target(flies=True, x=behind, y=gate.middle, z=n.slot_height, speed=n.slot_speed, narrow=1.0)
    is_in_line = abs(x - before) < n.near and abs(y - gate.middle) < n.slot_aligned
    if _has_form(q, through, n) and (x >= before + n.near or is_in_line):
        return through
    return Target(flies=True, x=before, y=gate.middle, z=n.slot_height, speed=n.speed, narrow=1.0)


def _has_form(q: JointVector, target: Target, n: RuleNumbers) -> bool:
    return float(np.abs(q - target.form).max()) < n.formed
