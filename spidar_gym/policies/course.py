"""Policies on a course that choose targets: conversion of observations to a map and of targets to actions."""

import math
from dataclasses import replace
from functools import cache

import numpy as np

from spidar_gym.control.course.gates import FARTHEST, HALF_WIDTH, KINDS, Course, Gate
from spidar_gym.control.course.observation import AHEAD, FAR, course_layout
from spidar_gym.control.course.rule import PRESENT, RuleNumbers, course_rule
from spidar_gym.control.course.target import ACTION, Target, take_target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.path import wrap
from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.robot import ROBOT

HERE = 0.5 * FARTHEST
"""Position x of the torso on the map of an observation, which contains only the course ahead [m]."""

RANGES = {
    "wall_before": (0.9, 2.2), "wall_passed": (0.8, 1.8), "wall_beyond": (0.1, 0.8), "wall_over": (0.6, 1.3),
    "wall_beneath": (0.05, 0.4), "wall_speed": (0.4, 1.5), "slot_before": (1.1, 2.0), "slot_passed": (0.8, 1.8),
    "slot_beyond": (0.1, 0.8), "slot_height": (1.1, 1.8), "slot_speed": (0.2, 1.2), "slot_aligned": (0.01, 0.12),
    "beam_before": (1.2, 1.6), "beam_crawls": (1.9, 3.2), "beam_passed": (1.1, 1.8), "beam_beyond": (0.03, 0.4),
    "goal_crawls": (0.4, 1.5), "above": (0.8, 1.3), "speed": (0.4, 1.5), "near": (0.04, 0.2), "formed": (0.03, 0.2),
}  # fmt: skip
"""Values of the rule's numbers at −1 and 1 of a learned policy; 0 is the present value."""


@cache
def _fields() -> dict[str, slice]:
    """Return the slice of each field of the observation."""
    found, at = {}, 0
    for field in course_layout(len(ACTION)):
        found[field.name] = slice(at, at + field.size)
        at += field.size
    return found


class Sight:
    """State and map from an observation, as inputs of the rule; x is relative to the torso."""

    def __init__(self, observation: np.ndarray) -> None:
        """Decode an observation of the action mode `waypoint`."""
        seen = {name: observation[where].astype(float) for name, where in _fields().items()}
        way, side, rise, sine, cosine = seen["goal"].tolist()
        y, z = seen["place"].tolist()
        yaw = float(np.arctan2(*seen["heading"]))
        self.yaw = yaw
        """Heading of the torso [rad]."""
        gates = [gate for k in range(AHEAD) if (gate := _gate(seen[f"gate{k + 1}"], y)) is not None]
        tiles = (0.0,) * sum(gate.tile_count for gate in gates)
        goal = Pose2(HERE + way, y + side, wrap(float(np.arctan2(sine, cosine)) + yaw))
        self.course = Course(tuple(gates), goal, tiles, dares=True)
        """Map, on which the torso is at x = `HERE`."""
        self.position_w = np.array([HERE, y, z])
        """Position of the torso on the map (3,) [m]."""
        self.joint_position = seen["joint_position"]
        """Joint angles q (16,) [rad]."""
        self.phase = PHASES[int(np.argmax(seen["phase"]))]
        """Phase of the manager."""
        self.floor = z + rise - ROBOT.peg_depth
        """Height of the goal's floor [m]."""
        self.charge = float(seen["charge"][0])
        """Charge of the battery, 0 … 1."""
        self.target = _target(seen["target"], seen["previous_action"], self.position_w)
        """Current target, or None."""


def _gate(row: np.ndarray, y: float) -> Gate | None:
    begin, end, size, middle = row[len(KINDS) :].tolist()
    if not row[: len(KINDS)].any() or end >= FAR:
        return None
    kind = KINDS[int(np.argmax(row[: len(KINDS)]))]
    return Gate(kind, HERE + begin, HERE + end, size, min(max(middle + y, -HALF_WIDTH), HALF_WIDTH))


def _target(row: np.ndarray, action: np.ndarray, position_w: np.ndarray) -> Target | None:
    """Return the current target: position from the observation, other values from the last action."""
    is_there, flies, *way = row.tolist()
    if not is_there:
        return None
    said = take_target(action, Course(goal=Pose2(HERE)), position_w)
    x, y, z = (position_w + way).tolist()
    return replace(said, flies=flies > 0.5, x=x, y=y, z=z)


DONE, DONE_TURN = 0.02, 0.035
"""A robot that lies within this of the goal to which it has crawled or on which it has landed has arrived [m], [rad];
the limits of a success are half as wide again."""


def has_arrived(sight: Sight) -> bool:
    """Whether the robot lies at the goal for which it set out, and only the capture's drift moves it from there."""
    goal, target = sight.course.goal, sight.target
    if sight.phase != "lie" or target is None or target.flies:
        return False
    x, y, _ = sight.position_w.tolist()
    off = math.hypot(goal.x - x, goal.y - y)
    meant = math.hypot(goal.x - target.x, goal.y - target.y)
    return max(off, meant) < DONE and abs(wrap(goal.yaw - sight.yaw)) < DONE_TURN


class CoursePolicy(PresetPolicy):
    """Chooses a target every half second: by the rule, or as a subclass defines."""

    def choose(self, sight: Sight) -> Target:
        """Return the target for the current state."""
        return course_rule(sight.course, sight.position_w, sight.joint_position, sight.phase)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the action of the chosen target; computed on the decoded map, it may differ by rounding."""
        sight = Sight(observation)
        return self.choose(sight).action(sight.course, sight.position_w)

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Return the action for each observation."""
        return np.array([self.act(observation) for observation in observations])


class Arriving(CoursePolicy):
    """Stays where it has arrived; a subclass of this and of another course policy chooses like the other one before."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the action of the chosen target, or of the present pose once the robot has arrived."""
        sight = Sight(observation)
        x, y, _ = sight.position_w.tolist()
        target = Target(x=x, y=y, yaw=sight.yaw) if has_arrived(sight) else self.choose(sight)
        return target.action(sight.course, sight.position_w)


def rule_numbers(answer: np.ndarray) -> RuleNumbers:
    """Convert a network's output, entries within ± 1 in the order of `RANGES`, to the rule's numbers."""
    found = {}
    for (name, (low, high)), share in zip(RANGES.items(), answer.tolist(), strict=True):
        present = getattr(PRESENT, name)
        found[name] = present + share * (high - present if share > 0.0 else present - low)
    return RuleNumbers(**found)


def command(answers: np.ndarray, observations: np.ndarray) -> np.ndarray:
    """Return the actions of the rule with the numbers of a network's output.

    Args:
        answers: Outputs within ± 1 (…, numbers).
        observations: Observations of the action mode `waypoint` (…, size).

    Returns:
        Actions (…, 8) in double precision; for zeros bit for bit the rule's.
    """
    found = []
    for answer, observation in zip(np.atleast_2d(answers), np.atleast_2d(observations), strict=True):
        sight = Sight(observation)
        own = rule_numbers(answer)
        target = course_rule(sight.course, sight.position_w, sight.joint_position, sight.phase, numbers=own)
        found.append(target.action(sight.course, sight.position_w))
    return np.array(found).reshape(*observations.shape[:-1], len(ACTION))
