"""A target: where to, by which gait, in which form; a few numbers, which an action of a policy stands for."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.course.gates import BEFORE, CEILING, HALF_WIDTH, Course
from spidar_gym.control.locomotion.commands import SPEEDS
from spidar_gym.errors import InvalidValueError, require_flag, require_within
from spidar_gym.robot import FORMS, N_JOINTS, N_LEGS

STRETCHED, BELOW = (tuple(FORMS[form][: N_JOINTS // N_LEGS].tolist()) for form in ("form1", "form3"))
"""Joint angles of every leg in the forms between which a target chooses [rad]."""
SWEEP = 0.4
"""Legs sweep forward and back by up to this much [rad]."""
TURNS = (-1.0, 1.0, -1.0, 1.0)
"""Which way a leg's first joint turns it to front or back: left front, left hind, right hind, right front."""
WAY, MARGIN = 5.5, 0.3
"""An action of 1 is so far from the torso [m]; what it stands for stays so far inside the field [m]."""


@dataclass(frozen=True, slots=True)
class Target:
    """Where to, and how."""

    flies: bool = False
    """Whether in the air; else on the floor, after a landing if need be."""
    x: float = 0.0
    """World; of the centre of mass in the air, of the torso on the floor [m]."""
    y: float = 0.0
    """To the left [m]."""
    z: float = 0.0
    """Height of the centre of mass in the air [m]."""
    yaw: float = 0.0
    """Heading on the floor [rad]; in the air it stays what it was there."""
    speed: float = 0.5
    """Speed of the flight [m/s]."""
    narrow: float = 0.0
    """From 0, form ① with its legs stretched out, to 1, form ③ with its legs below."""
    sweep: float = 0.0
    """How far the front legs turn to the front, and the hind legs to the back [rad]."""

    def __post_init__(self) -> None:
        """Refuse what is no target."""
        require_flag(flies=self.flies)
        require_within(-1e3, 1e3, "m", x=self.x, y=self.y, z=self.z)
        require_within(-1e3, 1e3, "rad", yaw=self.yaw)
        require_within(*SPEEDS, "m/s", speed=self.speed)
        require_within(0.0, 1.0, "1", narrow=self.narrow)
        require_within(-SWEEP, SWEEP, "rad", sweep=self.sweep)

    @property
    def form(self) -> JointVector:
        """Joint angles on the way [rad]."""
        q = np.array(STRETCHED) + self.narrow * (np.array(BELOW) - np.array(STRETCHED))
        legs = np.tile(q, (N_LEGS, 1))
        legs[:, 0] += self.sweep * np.array(TURNS)
        return legs.reshape(-1)

    def require_inside(self, course: Course) -> None:
        """Raise `InvalidValueError` where it lies outside the field of a course."""
        z = self.z if self.flies else 0.0
        if z < 0.0 or not course.is_inside(self.x, self.y, z):
            valid = f"within x = {-BEFORE:g} … {course.end:.4g} m, y = ± {HALF_WIDTH:g} m, z = 0 … {CEILING:g} m"
            raise InvalidValueError("target", (self.x, self.y, self.z), valid)

    def action(self, course: Course, position_w: Vector3) -> np.ndarray:
        """The action (8,) within ± 1 that stands for it where the torso is at `position_w`; too long a way is cut.

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
"""Entries of an action that is a target."""


def take_target(action: np.ndarray, course: Course, position_w: Vector3) -> Target:
    """The target that an action stands for, inside the field.

    Args:
        action: Of `ACTION`, within ± 1: on the floor up to 0, above it in the air; the way from the torso in world axes
            by `WAY`; the height from 0 to the ceiling; heading by π; speed, form and sweep between their bounds.
        course: The map.
        position_w: Of the torso (3,) [m].
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
