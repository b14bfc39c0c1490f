"""Policies on a course that say where to go: what they see, as a map, and the action of what they answer."""

from dataclasses import replace
from functools import cache

import numpy as np

from spidar_gym.control.course.gates import FARTHEST, HALF_WIDTH, KINDS, Course, Gate
from spidar_gym.control.course.observation import AHEAD, FAR, course_layout
from spidar_gym.control.course.rule import course_rule
from spidar_gym.control.course.target import ACTION, Target, take_target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.path import wrap
from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.robot import ROBOT

HERE = 0.5 * FARTHEST
"""Where the torso is on the map that a policy makes of an observation: only what lies ahead of it counts [m]."""


@cache
def _fields() -> dict[str, slice]:
    """Where each piece of the observation is."""
    found, at = {}, 0
    for field in course_layout(len(ACTION)):
        found[field.name] = slice(at, at + field.size)
        at += field.size
    return found


class Sight:
    """What a policy sees on a course, as the rule needs it; along the course everything is told from the torso."""

    def __init__(self, observation: np.ndarray) -> None:
        """Take an observation of the action mode `waypoint`."""
        seen = {name: observation[where].astype(float) for name, where in _fields().items()}
        way, side, rise, sine, cosine = seen["goal"].tolist()
        y, z = seen["place"].tolist()
        yaw = float(np.arctan2(*seen["heading"]))
        gates = [gate for k in range(AHEAD) if (gate := _gate(seen[f"gate{k + 1}"], y)) is not None]
        tiles = (0.0,) * sum(gate.tile_count for gate in gates)
        goal = Pose2(HERE + way, y + side, wrap(float(np.arctan2(sine, cosine)) + yaw))
        self.course = Course(tuple(gates), goal, tiles, dares=True)
        """The map, on which the torso is at x = `HERE`."""
        self.position_w = np.array([HERE, y, z])
        """Where the torso is (3,) [m]."""
        self.joint_position = seen["joint_position"]
        """q (16,) [rad]."""
        self.phase = PHASES[int(np.argmax(seen["phase"]))]
        """What the manager is doing."""
        self.floor = z + rise - ROBOT.peg_depth
        """Height of the goal's floor [m]."""
        self.charge = float(seen["charge"][0])
        """What is left of the battery."""
        self.target = _target(seen["target"], seen["previous_action"], self.position_w)
        """Where it was told to go last, if anywhere."""


def _gate(row: np.ndarray, y: float) -> Gate | None:
    begin, end, size, middle = row[len(KINDS) :].tolist()
    if not row[: len(KINDS)].any() or end >= FAR:
        return None
    kind = KINDS[int(np.argmax(row[: len(KINDS)]))]
    return Gate(kind, HERE + begin, HERE + end, size, min(max(middle + y, -HALF_WIDTH), HALF_WIDTH))


def _target(row: np.ndarray, action: np.ndarray, position_w: np.ndarray) -> Target | None:
    """What is followed now: places as they are told, the rest as the last action said."""
    is_there, flies, *way = row.tolist()
    if not is_there:
        return None
    said = take_target(action, Course(goal=Pose2(HERE)), position_w)
    x, y, z = (position_w + way).tolist()
    return replace(said, flies=flies > 0.5, x=x, y=y, z=z)


class CoursePolicy(PresetPolicy):
    """Says every half second where to go: by the rule, or whatever a subclass chooses."""

    def choose(self, sight: Sight) -> Target:
        """Where to go from here."""
        return course_rule(sight.course, sight.position_w, sight.joint_position, sight.phase)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The action that stands for what it chooses; on its map, so that what is told may be off by a rounding."""
        sight = Sight(observation)
        return self.choose(sight).action(sight.course, sight.position_w)

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """The same for each."""
        return np.array([self.act(observation) for observation in observations])
