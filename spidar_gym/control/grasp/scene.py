"""A scene of grasping: the object, where it stands, and where it is to be put down."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from spidar_gym.arrays import Vector3
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.grasp.claw import require_holdable
from spidar_gym.control.locomotion.commands import FIELD, OBJECTS
from spidar_gym.errors import InvalidValueError, require_keys, require_name, require_within
from spidar_gym.robot import GRAVITY

STAND_MARGIN = 0.05
"""Width by which the stand at the goal is wider than the object on each side [m]; that at the start is narrower."""
STAND_SHARE = 0.7
"""Half width of the stand at the start, less the margin, over that of the object: no corner is beyond a turned side."""
CHOCK, LEAN = 0.02, 0.5
"""Half width of the blocks around a ball [m], and how far from below they touch it [rad]."""
LESS_PER_KG = 1.5
"""By how much a kilogram that is carried lowers the largest grip of legs and thrust, by a linear program [N/kg]."""
HEIGHTS = 0.0, 1.0
"""Least and greatest height of a stand [m]."""


@dataclass(frozen=True)
class GraspScene:
    """An object, its stand, and its goal."""

    shape: str = "box"
    """`box`, `cylinder` or `ball`."""
    half_size: Vector3 = field(default_factory=lambda: np.array([0.25, 0.25, 0.2]))
    """Half of length, width, height; of cylinder and ball the first is the radius, of a cylinder the last one half the
    height [m]."""
    mass: float = 1.0
    """Mass [kg], hidden."""
    com: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Its centre of mass from its middle [m], hidden."""
    friction: float = 0.7
    """Sliding friction of its surface, hidden."""
    most_force: float = 33.0
    """Largest force that a foot may press it with [N], known."""
    start: Pose2 = field(default_factory=lambda: Pose2(1.5))
    """Where it stands: its middle, and its heading."""
    stand: float = 0.0
    """Height of the stand below it there [m]; 0 is the floor."""
    goal: Pose2 = field(default_factory=lambda: Pose2(4.0))
    """Where it is to stand."""
    floor: float = 0.0
    """Height of the stand there [m]; 0 is the floor."""
    bias: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Error of the object's position as motion capture sees it [m], hidden."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for a scene that cannot be."""
        require_name("shape", self.shape, OBJECTS)
        for name in ("half_size", "com", "bias"):
            object.__setattr__(self, name, _three(name, getattr(self, name)))
        require_holdable(self.shape, self.half_size)
        require_within(0.05, 20.0, "kg", mass=self.mass)
        require_within(0.0, 10.0, "1", friction=self.friction)
        require_within(1.0, 1000.0, "N", most_force=self.most_force)
        require_within(*HEIGHTS, "m", stand=self.stand, floor=self.floor)
        for name in ("start", "goal"):
            pose = getattr(self, name)
            require_within(-FIELD, FIELD, "m", **{f"{name}.x": pose.x, f"{name}.y": pose.y})
        if math.hypot(self.goal.x - self.start.x, self.goal.y - self.start.y) < 2.5 * self.half_size[0]:
            raise InvalidValueError("goal", (self.goal.x, self.goal.y), "a place apart from the start")

    @property
    def top(self) -> float:
        """Height of the object's top over its middle [m]."""
        return float(self.half_size[0] if self.shape == "ball" else self.half_size[2])

    @property
    def turns_alike(self) -> float:
        """Angle after a turn by which it looks the same: 90° for a box, 0 for round ones [rad]."""
        return 0.5 * math.pi if self.shape == "box" else 0.0


def _three(name: str, given: Any) -> Vector3:  # noqa: ANN401 - user input
    """Return three finite numbers as an array (`InvalidValueError` for anything else)."""
    try:
        found = np.asarray(given, float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise InvalidValueError(name, given, "three finite numbers [m]")
    return found


def needed_force(mass: float, com: Vector3, half_width: float, friction: float) -> float:
    """Return the least equal force of four feet that holds an object [N].

    Feet in the middles of the sides carry the weight by friction. An off-centre mass loads one of two opposite feet
    more; the other pair takes as much weight off the first as makes the largest loads equal: (1 + (|x| + |y|)/a)/4.

    Args:
        mass: Mass [kg].
        com: Centre of mass from the middle [m].
        half_width: a, distance of the feet from the middle [m].
        friction: Coefficient.
    """
    off = (abs(float(com[0])) + abs(float(com[1]))) / half_width
    return mass * GRAVITY * (1.0 + off) / (4.0 * friction)


def plain_scene(scene: GraspScene) -> dict[str, Any]:
    """Return the numbers of a scene as `parse_scene` reads them, from JSON too."""
    found = {each.name: getattr(scene, each.name) for each in fields(scene)}
    poses = {name: [found[name].x, found[name].y, found[name].yaw] for name in ("start", "goal")}
    return found | {name: found[name].tolist() for name in ("half_size", "com", "bias")} | poses


def parse_scene(given: Any) -> GraspScene | None:  # noqa: ANN401 - user input
    """Return a scene from a `GraspScene`, its numbers by name, or None (`InvalidValueError` for anything else)."""
    if given is None or isinstance(given, GraspScene):
        return given
    numbers = dict(require_keys("scene", "number", given, [each.name for each in fields(GraspScene)]))
    for name in ("start", "goal"):
        if isinstance(numbers.get(name), list | tuple | Mapping):
            pose = numbers[name]
            numbers[name] = Pose2(**pose) if isinstance(pose, Mapping) else Pose2(*(float(each) for each in pose))
    for name in {"half_size", "com", "bias"} & numbers.keys():
        numbers[name] = _three(name, numbers[name])
    return GraspScene(**numbers)
