"""Commands of the manager of both gaits, and checks of their validity."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError, require_within
from spidar_gym.robot import N_JOINTS, ROBOT

FIELD = 100.0
"""Largest distance of a target from the world's origin along each axis [m]."""
SPEEDS = 0.05, 1.5
"""Smallest and largest speed of a flight [m/s]."""
STEEPEST = math.radians(12.0)
"""Steepest floor for a landing [rad]; on the track's slope of 10° all requirements are met."""
HEIGHTS = 0.1, 10.0
"""Smallest and largest height of a take-off [m]."""


@dataclass(frozen=True)
class CrawlTo:
    """Crawl to a pose on the floor, straight or on an arc."""

    pose: Pose2
    """Goal pose of the torso, world."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for a pose out of range."""
        require_within(-FIELD, FIELD, "m", x=self.pose.x, y=self.pose.y)
        require_within(-1e3, 1e3, "rad", yaw=self.pose.yaw)


@dataclass(frozen=True)
class TakeOff:
    """Rise from the floor, straight up."""

    height: float = 1.0
    """Height by which the centre of mass rises [m]."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for a height out of range."""
        require_within(*HEIGHTS, "m", height=self.height)


@dataclass(frozen=True)
class FlyTo:
    """Take a form, then fly straight to a position."""

    position_w: tuple[float, float, float]
    """Goal position of the centre of mass [m]."""
    form: JointVector | None = None
    """Joint angles in flight [rad]; None keeps the present target."""
    speed: float = 0.5
    """Speed of the flight [m/s]."""
    along: bool = False
    """Whether the robot turns to the direction of flight first."""
    at_once: bool = False
    """Whether the flight starts immediately from the present motion, and the form is taken in flight."""
    room: float | None = None
    """Width of the passage to fly through [m], if it is known."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for a position, a form or a speed out of range."""
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
    """Descend vertically in the lying pose until the floor carries the robot."""

    floor: float = 0.0
    """Expected height of the floor under the pegs [m]; if it is lower, the descent continues."""
    slope: float = 0.0
    """Slope of the floor, if it is known [rad]."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for a height out of range or a slope that is too steep."""
        require_within(-FIELD, FIELD, "m", floor=self.floor)
        if not 0.0 <= self.slope <= STEEPEST:
            raise InvalidValueError("slope", self.slope, f"a floor within 0 … {STEEPEST:.3f} rad, where a robot stays")


LocomotionCommand = CrawlTo | TakeOff | FlyTo | Land


KINDS = ("crawl_to", "take_off", "fly_to", "land")
"""Names of the commands, in the core's order."""


def airborne_after(command: LocomotionCommand) -> bool:
    """Whether the robot is in the air after the command."""
    return isinstance(command, TakeOff | FlyTo)


def require_order(commands: tuple[LocomotionCommand, ...], airborne: bool) -> None:
    """Raise `InvalidValueError` for the first command that cannot follow those before it.

    Args:
        commands: Commands in order.
        airborne: Whether the robot is in the air before the first command.
    """
    for command in commands:
        flies = isinstance(command, FlyTo | Land)
        if flies and not airborne:
            raise InvalidValueError("command", type(command).__name__, "TakeOff first: the robot is on the floor there")
        if not flies and airborne:
            raise InvalidValueError("command", type(command).__name__, "Land first: the robot is in the air there")
        airborne = airborne_after(command)


def heading(yaw: float) -> np.ndarray:
    """Compute the level attitude with a heading [rad], as a quaternion w, x, y, z."""
    return np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)])
