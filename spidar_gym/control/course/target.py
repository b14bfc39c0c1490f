"""Targets: position, gait and form as a few numbers, and their conversion to and from actions of a policy."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.course.gates import BEFORE, CEILING, HALF_WIDTH, Course
from spidar_gym.control.locomotion.commands import SPEEDS
from spidar_gym.errors import InvalidValueError, require_flag, require_within
from spidar_gym.robot import FORMS, N_JOINTS, N_LEGS

STRETCHED, BELOW = (tuple(FORMS[form][: N_JOINTS // N_LEGS].tolist()) for form in ("form1", "form3"))
"""Joint angles of every leg in the two forms between which a target interpolates [rad]."""
SWEEP = 0.4
"""Largest sweep of the legs forward and back [rad]."""
TURNS = (-1.0, 1.0, -1.0, 1.0)
"""Signs of the legs' first joints for a sweep: left front, left hind, right hind, right front."""
WAY, MARGIN = 5.5, 0.3
"""Distance from the torso of an action of 1, and margin of its target to the sides of the field [m]."""


@dataclass(frozen=True, slots=True)
class Target:
    """Target of a movement: gait, position, speed and form."""

    flies: bool = False
    """Whether the target is in the air; otherwise the robot lands if necessary and crawls to it."""
    x: float = 0.0
    """x of the centre of mass in the air, of the torso on the floor, world [m]."""
    y: float = 0.0
    """y, to the left [m]."""
    z: float = 0.0
    """Height of the centre of mass in the air [m]."""
    yaw: float = 0.0
    """Heading on the floor [rad]; a flight does not change the heading."""
    speed: float = 0.5
    """Speed of the flight [m/s]."""
    narrow: float = 0.0
    """From 0, form ① with its legs stretched out, to 1, form ③ with its legs below."""
    sweep: float = 0.0
    """Angle by which the front legs turn to the front, and the hind legs to the back [rad]."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for numbers out of range."""
        require_flag(flies=self.flies)
        require_within(-1e3, 1e3, "m", x=self.x, y=self.y, z=self.z)
        require_within(-1e3, 1e3, "rad", yaw=self.yaw)
        require_within(*SPEEDS, "m/s", speed=self.speed)
        require_within(0.0, 1.0, "1", narrow=self.narrow)
        require_within(-SWEEP, SWEEP, "rad", sweep=self.sweep)

    @property
    def form(self) -> JointVector:
        """Joint angles in flight [rad]."""
        q = np.array(STRETCHED) + self.narrow * (np.array(BELOW) - np.array(STRETCHED))
        legs = np.tile(q, (N_LEGS, 1))
        legs[:, 0] += self.sweep * np.array(TURNS)
        return legs.reshape(-1)

    def require_inside(self, course: Course) -> None:
        """Raise `InvalidValueError` if the target lies outside the field of a course."""
        z = self.z if self.flies else 0.0
        if z < 0.0 or not course.is_inside(self.x, self.y, z):
            valid = f"within x = {-BEFORE:g} … {course.end:.4g} m, y = ± {HALF_WIDTH:g} m, z = 0 … {CEILING:g} m"
            raise InvalidValueError("target", (self.x, self.y, self.z), valid)

    def action(self, course: Course, position_w: Vector3) -> np.ndarray:
        """Convert the target to an action (8,) within ± 1 for a torso at `position_w`; longer ways are shortened.

        Raises:
            InvalidValueError: For a target outside the field.
        """
        self.require_inside(course)
        low, high = SPEEDS
        way = np.array([self.x - position_w[0], self.y - position_w[1]]) / WAY
        rest = (
            2.0 * self.z / CEILING - 1.0, math.remainder(self.yaw, 2.0 * math.pi) / math.pi,
            (2.0 * self.speed - low - high) / (high - low), 2.0 * self.narrow - 1.0, self.sweep / SWEEP,
        )  # fmt: skip
        return np.clip([1.0 if self.flies else -1.0, *(way / max(1.0, float(np.abs(way).max()))), *rest], -1.0, 1.0)


ACTION = (
    "flies", "way_x", "way_y", "height", "heading", "speed", "narrow", "sweep",
)  # fmt: skip
"""Entries of an action that encodes a target."""


def take_target(action: np.ndarray, course: Course, position_w: Vector3) -> Target:
    """Convert an action to a target inside the field.

    Args:
        action: Entries of `ACTION`, within ± 1: `flies` above 0 is in the air; displacement from the torso in world
            axes in units of `WAY`; height from 0 to the ceiling; heading in units of π; speed, form and sweep between
            their bounds.
        course: The map.
        position_w: Position of the torso (3,) [m].
    """
    flies, way_x, way_y, height, heading, speed, narrow, sweep = action.tolist()
    low, high = SPEEDS
    far = HALF_WIDTH - MARGIN
    x, y = float(position_w[0]) + WAY * way_x, float(position_w[1]) + WAY * way_y
    return Target(
        flies > 0.0, min(max(x, MARGIN - BEFORE), course.end - MARGIN), min(max(y, -far), far),
        0.5 * CEILING * (1.0 + height), math.pi * heading, 0.5 * (low + high + (high - low) * speed),
        0.5 * (1.0 + narrow), SWEEP * sweep,
    )  # fmt: skip
