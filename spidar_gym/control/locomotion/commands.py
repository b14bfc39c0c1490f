"""What the manager of both gaits is told to do, and what of it cannot be done."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError, require_within
from spidar_gym.robot import N_JOINTS, ROBOT

FIELD = 100.0
"""No way leads farther from the world's origin than this [m]."""
SPEEDS = 0.05, 1.5
"""Least and largest speed of a flight [m/s]."""
STEEPEST = math.radians(12.0)
"""Steepest floor that is landed on [rad]: on the track's 10° everything holds."""
HEIGHTS = 0.1, 10.0
"""Least and largest height that a take-off rises to [m]."""


@dataclass(frozen=True)
class CrawlTo:
    """Crawl to a pose on the floor, straight or on an arc."""

    pose: Pose2
    """Where the torso comes to lie, world."""

    def __post_init__(self) -> None:
        """Refuse what is no place."""
        require_within(-FIELD, FIELD, "m", x=self.pose.x, y=self.pose.y)
        require_within(-1e3, 1e3, "rad", yaw=self.pose.yaw)


@dataclass(frozen=True)
class TakeOff:
    """Rise from the floor, straight up."""

    height: float = 1.0
    """How far the centre of mass rises [m]."""

    def __post_init__(self) -> None:
        """Refuse a height that is none."""
        require_within(*HEIGHTS, "m", height=self.height)


@dataclass(frozen=True)
class FlyTo:
    """Fly straight to a place, in a form that is taken before."""

    position_w: tuple[float, float, float]
    """Where the centre of mass goes [m]."""
    form: JointVector | None = None
    """Joint angles on the way [rad]; those it has if not given."""
    speed: float = 0.5
    """Speed on the way [m/s]."""
    along: bool = False
    """Whether it turns to where it flies first."""
    at_once: bool = False
    """Whether it turns to there from however it moves now, and takes the form on the way."""
    room: float | None = None
    """Width of what it flies through, if that is known [m]."""

    def __post_init__(self) -> None:
        """Refuse what is no place, no form or no speed."""
        x, y, z = self.position_w
        require_within(-FIELD, FIELD, "m", x=x, y=y, z=z)
        require_within(*SPEEDS, "m/s", speed=self.speed)
        if self.room is not None:
            require_within(0.0, FIELD, "m", room=self.room)
        q = self.form
        if q is not None and not (np.shape(q) == (N_JOINTS,) and (np.abs(q) <= ROBOT.joint_limit + 1e-9).all()):
            raise InvalidValueError(
                "form", np.asarray(q).tolist(), f"{N_JOINTS} angles within ± {ROBOT.joint_limit:.4g} rad"
            )


@dataclass(frozen=True)
class Land:
    """Come down where it is, in the pose in which it lies, until the floor carries it."""

    floor: float = 0.0
    """Height at which the floor is expected, under the pegs [m]; where it is not, the descent goes on."""
    slope: float = 0.0
    """How steep it is, as far as that is known [rad]."""

    def __post_init__(self) -> None:
        """Refuse what is no height, and what is too steep."""
        require_within(-FIELD, FIELD, "m", floor=self.floor)
        if not 0.0 <= self.slope <= STEEPEST:
            raise InvalidValueError("slope", self.slope, f"a floor within 0 … {STEEPEST:.3f} rad, where a robot stays")


LocomotionCommand = CrawlTo | TakeOff | FlyTo | Land


KINDS = ("crawl_to", "take_off", "fly_to", "land")
"""They in the core's order."""


def airborne_after(command: LocomotionCommand) -> bool:
    """Whether the robot is in the air when it is done."""
    return isinstance(command, TakeOff | FlyTo)


def require_order(commands: tuple[LocomotionCommand, ...], airborne: bool) -> None:
    """Raise `InvalidValueError` for the first command that cannot follow on those before it.

    Args:
        commands: In order.
        airborne: Whether the robot flies before the first.
    """
    for command in commands:
        flies = isinstance(command, FlyTo | Land)
        if flies and not airborne:
            raise InvalidValueError("command", type(command).__name__, "TakeOff first: the robot is on the floor there")
        if not flies and airborne:
            raise InvalidValueError("command", type(command).__name__, "Land first: the robot is in the air there")
        airborne = airborne_after(command)


def heading(yaw: float) -> np.ndarray:
    """The level attitude with a heading, w, x, y, z."""
    return np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)])
