"""Commands of the manager of gaits and grasp, and checks of their validity."""

import math
from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError, require_name, require_within
from spidar_gym.robot import N_JOINTS, ROBOT

FIELD = 100.0
"""Largest distance of a target from the world's origin along each axis [m]."""
SPEEDS = 0.05, 1.5
"""Smallest and largest speed of a flight [m/s]."""
STEEPEST = math.radians(12.0)
"""Steepest floor for a landing [rad]; on the track's slope of 10° all requirements are met."""
HEIGHTS = 0.1, 10.0
"""Smallest and largest height of a take-off, and of a lift [m]."""
SIZES, FORCES, MOST_MASS, MOST_FRICTION = (0.05, 2.0), (1.0, 1000.0), 20.0, 10.0
"""Ranges of half sizes of an object [m] and of the force that it bears [N], and its largest mass [kg]."""


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


@dataclass(frozen=True)
class Grasp:
    """Close the legs around an object below, test the grip and lift it."""

    shape: str = "box"
    """`box`, `cylinder` or `ball`."""
    half_size: Vector3 = field(default_factory=lambda: np.array([0.3, 0.3, 0.25]))
    """Half of length, width, height; of cylinder and ball the first is the radius, of a cylinder the last one half the
    height [m]."""
    most_force: float = 33.0
    """Largest force of a foot that the object bears [N]; legs and thrust make at most 33 N."""
    mass: float = 0.5
    """Mass that is assumed until the test lift has measured it [kg]."""
    height: float = 0.7
    """Height of the lift [m]."""
    force: float = 0.0
    """Force of each foot [N]; 0 where the test lift is to find it."""
    friction: float = 0.0
    """Friction between feet and object where it is known, for the force then found; 0 where it is not."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for numbers out of range."""
        require_name("shape", self.shape, OBJECTS)
        if np.shape(self.half_size) != (3,) or not all(
            SIZES[0] <= each <= SIZES[1] for each in np.asarray(self.half_size)
        ):
            raise InvalidValueError("half_size", np.asarray(self.half_size).tolist(), "three lengths within 0.05 … 2 m")
        require_within(*FORCES, "N", most_force=self.most_force)
        require_within(0.0, MOST_MASS, "kg", mass=self.mass)
        require_within(*HEIGHTS, "m", height=self.height)
        require_within(0.0, FORCES[1], "N", force=self.force)
        require_within(0.0, MOST_FRICTION, "1", friction=self.friction)

    @property
    def radius(self) -> float:
        """Half of its width [m]."""
        return float(self.half_size[0])

    @property
    def top(self) -> float:
        """Height of its top over its origin [m]."""
        return float(self.half_size[0] if self.shape == "ball" else self.half_size[2])


@dataclass(frozen=True)
class CarryTo:
    """Carry the held object straight to a place in the air."""

    position_w: tuple[float, float, float]
    """Goal of the object's origin [m]."""
    yaw: float | None = None
    """Heading of the object there [rad]; None keeps it."""
    speed: float = 0.5
    """Largest speed [m/s]."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for a goal or a speed out of range."""
        x, y, z = self.position_w
        require_within(-FIELD, FIELD, "m", x=x, y=y, z=z)
        require_within(*SPEEDS, "m/s", speed=self.speed)
        if self.yaw is not None:
            require_within(-1e3, 1e3, "rad", yaw=self.yaw)


@dataclass(frozen=True)
class Place:
    """Lower the held object until it stands."""

    floor: float = 0.0
    """Expected height of the surface below it [m]."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for a height out of range."""
        require_within(-FIELD, FIELD, "m", floor=self.floor)


@dataclass(frozen=True)
class Release:
    """Let go of the object, open the legs and leave upwards; an object that hangs falls."""


LocomotionCommand = CrawlTo | TakeOff | FlyTo | Land | Grasp | CarryTo | Place | Release
OBJECTS = ("box", "cylinder", "ball")
"""Shapes of objects that can be grasped."""
KINDS = ("crawl_to", "take_off", "fly_to", "land", "grasp", "carry_to", "place", "release")
"""Names of the commands, in the core's order."""
SITUATIONS = ("floor", "air", "grip", "placed")
"""Where the robot is: on the floor, in the air, holding an object, or holding one that stands."""
_BEFORE: dict[type, tuple[str, ...]] = {
    CrawlTo: ("floor",), TakeOff: ("floor",), FlyTo: ("air",), Land: ("air",), Grasp: ("air",), CarryTo: ("grip",),
    Place: ("grip",), Release: ("grip", "placed"),
}  # fmt: skip
_AFTER = {CrawlTo: "floor", TakeOff: "air", FlyTo: "air", Land: "floor", Grasp: "grip", CarryTo: "grip",
          Place: "placed", Release: "air"}  # fmt: skip
_FIRST = {
    "floor": "TakeOff first: the robot is on the floor there", "air": "Land first: the robot is in the air there",
    "grip": "Release first: the legs hold an object there", "placed": "Release first: the legs hold an object there",
}  # fmt: skip


def situation_after(command: LocomotionCommand) -> str:
    """Return where the robot is after the command, one of `SITUATIONS`."""
    return _AFTER[type(command)]


def require_order(commands: tuple[LocomotionCommand, ...], situation: str) -> None:
    """Raise `InvalidValueError` for the first command that cannot follow those before it.

    Args:
        commands: Commands in order.
        situation: Where the robot is before the first command, one of `SITUATIONS`.
    """
    for command in commands:
        kind, before = type(command), _BEFORE[type(command)]
        if situation not in before:
            holds = kind in (CarryTo, Place, Release) and situation == "air"
            raise InvalidValueError(
                "command", kind.__name__, "Grasp first: the legs hold nothing there" if holds else _FIRST[situation]
            )
        situation = situation_after(command)


def heading(yaw: float) -> np.ndarray:
    """Compute the level attitude with a heading [rad], as a quaternion w, x, y, z."""
    return np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)])
