"""Footsteps of the crawl: start pose, commands, reach, number of cycles of a move [Zhao2025, Sec. Crawling Gait]."""

import math
from dataclasses import dataclass

from spidar_gym.arrays import FootForces, JointVector
from spidar_gym.control.crawl.kinematics import foot_positions, leg_angles
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError, require_name, require_not_negative
from spidar_gym.robot import ROBOT, RobotSpec

STRIDES = ("centred", "home")
"""`centred`: feet move between home ± ½ stride; `home`: feet move from home to home + stride, as in the lab's code."""
MOST_STRIDE = 20.0
"""Upper limit of the search for the largest stride, as a multiple of the displacement."""
BISECTIONS = 24
"""Number of bisections in that search."""
MOST_CORRECTIONS = 10
"""Largest number of corrections."""


@dataclass(frozen=True)
class GaitConfig:
    """Configuration of the gait."""

    inner: float = -0.55
    """Inner pitch of the start pose, which defines the feet's home on the floor [rad]."""
    outer: float = 1.32
    """Outer pitch of the start pose [rad]."""
    stride: str = "centred"
    """Stride scheme, one of `STRIDES`."""
    # In C this fills the padding after `stride`: size and offsets of logs and missions stay.
    corrections: int = 0
    """Largest number of corrections that are added to a move that has missed its goal: the torso is lifted and moved
    once more, after a step of all legs where it is farther from its goal than `trim_limit`. With them, a torso that is
    out of its goal's reach moves as far as it can, and one that is still short of it does not wait for the time-out."""
    max_distance: float = 0.2
    """Longest displacement of a cycle [m]; the reach may allow less."""
    max_turn: float = 0.5
    """Largest turn of a cycle [rad]."""
    raise_angle: float = 0.1
    """The inner pitch rises this far above the higher of start and end of the step [rad] [JSK]."""
    lift_height: float = 0.1
    """The torso moves at this height above its lying position [m] [Zhao2025, Sec. Crawling Motion]."""
    press: float = 0.004
    """Targets of feet and torso are this far below the floor to ensure contact [m]."""
    swing_at: float = 1.0
    """The swing begins at this share of the raise."""
    lower_at: float = 0.05
    """Legs are lowered when yaw and outer pitch are this close to their targets [rad]."""
    forward_at: float = 1.0
    """The torso moves forward from this share of its lift on."""
    down_at: float = 1.0
    """The torso is lowered from this share of its displacement on."""
    start_time: float = 0.5
    """Time in which thrust builds up from rest before the first motion [s]."""
    spool_time: float = 0.5
    """Time in which thrust changes from the previous mode before a motion [s]."""
    settle_time: float = 0.5
    """Time in which thrust fades after the torso has been lowered [s]; with 0 the next cycle follows without a rest."""
    leg_touch_time: float = 0.3
    """Feet have touched down when the inner pitches are near their targets and still for this time [s]."""
    torso_touch_time: float = 0.2
    """The torso has touched down when it is near its height and still for this time [s]."""
    arrival: float = 0.003
    """The torso has arrived when its filtered error is below this [m]; until then it waits for its trim."""
    stall_time: float = 0.5
    """A phase with a completed plan also ends once legs short of their targets have been still for this time [s]."""
    trim_gain: float = 2.0
    """Integral gain from the torso's error to the trim of its target [1/s]; 0 is off."""
    trim_limit: float = 0.03
    """Largest trim [m]."""
    rolling: bool = False
    """Whether the kinematics include that the feet are balls, which roll as their legs turn."""
    timeout: float = 10.0
    """Longest duration of a phase without a fixed time [s]."""
    robot: RobotSpec = ROBOT
    """The robot."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for a start pose out of reach and for negative lengths or times."""
        require_name("stride scheme", self.stride, STRIDES)
        positive = {
            k: v
            for k, v in vars(self).items()
            if k not in ("inner", "outer", "stride", "corrections", "rolling", "robot")
        }
        require_not_negative(**positive)
        if type(self.corrections) is not int or not 0 <= self.corrections <= MOST_CORRECTIONS:
            raise InvalidValueError("corrections", self.corrections, f"a whole number within 0 … {MOST_CORRECTIONS}")
        for name in ("max_distance", "max_turn", "lift_height", "timeout"):
            if getattr(self, name) == 0.0:
                raise InvalidValueError(name, 0.0, "a number above 0")
        home = self.home_b
        if any(leg_angles(home - (0.0, 0.0, z), self.robot) is None for z in (0.0, self.lift_height)):
            raise InvalidValueError("inner, outer", (self.inner, self.outer), "a pose whose feet reach the floor")

    @property
    def home_b(self) -> FootForces:
        """Home positions of the feet while the torso lies on its pegs, torso axes [m]."""
        home = foot_positions(self.inner, self.outer, self.robot)
        home[:, 2] = -self.robot.peg_depth + self.robot.foot_radius
        return home


@dataclass(frozen=True)
class Move:
    """Command to crawl along an arc to a pose relative to the start of the command."""

    way: Pose2
    """Displacement."""
    cycles: int = 0
    """Number of cycles; 0 uses as few as reach and configuration allow."""


@dataclass(frozen=True)
class Lift:
    """Command to raise legs in place, hold and lower them."""

    legs: tuple[int, ...] = (0,)
    """Indices of the legs, 0 … 3 from the front left counter-clockwise."""
    angle: float = 0.2
    """Angle by which the inner pitch rises [rad]."""
    seconds: float = 2.0
    """Time for which the legs are held [s]."""


@dataclass(frozen=True)
class Stand:
    """Command to lift the torso, hold and lower it."""

    height: float = 0.1
    """Height to which the torso is lifted [m]."""
    seconds: float = 2.0
    """Time for which the torso is held [s]."""


GaitCommand = Move | Lift | Stand


def stride_fits(config: GaitConfig, way: Pose2, lift_height: float | None = None) -> bool:
    """Whether one cycle can have this displacement: every foot in reach at start and end, torso down and lifted."""
    home, height = config.home_b, config.lift_height if lift_height is None else lift_height
    ends = (way.arc(0.5), way.arc(-0.5)) if config.stride == "centred" else (way, Pose2())
    for end in ends:
        feet = end.move(home)
        for z in (-config.press, height):
            if leg_angles(feet - (0.0, 0.0, z), config.robot) is None:
                return False
    return True


def largest_stride(config: GaitConfig, way: Pose2) -> float:
    """Compute the largest share of the displacement `way` within reach of one cycle, up to `MOST_STRIDE`."""
    low, high = 0.0, 1.0
    while high < MOST_STRIDE and stride_fits(config, way.arc(high)):
        low, high = high, 2.0 * high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stride_fits(config, way.arc(middle)) else (low, middle)
    return low


def plan_cycles(config: GaitConfig, move: Move) -> int:
    """Compute the number of cycles of a move; feet step as far as the torso moves [Zhao2025, Sec. Crawling Gait].

    Raises:
        InvalidValueError: For too few cycles, with the largest stride; for a displacement out of reach.
    """
    way = move.way
    if not all(math.isfinite(v) for v in (way.x, way.y, way.yaw)):
        raise InvalidValueError("way", way, "finite numbers")
    share = largest_stride(config, way)
    if share <= 0.0:
        raise InvalidValueError("way", way, "a displacement whose first step is in reach")
    if move.cycles:
        if move.cycles < 0 or not isinstance(move.cycles, int):
            raise InvalidValueError("cycles", move.cycles, "a whole number of at least 1, or 0 for as many as needed")
        if share * move.cycles < 1.0 - 1e-9:
            stride, most = way.distance / move.cycles, share * way.distance
            turn = f" with {share * abs(way.yaw):.3f} rad" if way.yaw else ""
            raise InvalidValueError("stride", f"{stride:.3f} m", f"up to {most:.3f} m{turn} a cycle in this direction")
        return move.cycles
    wanted = max(way.distance / config.max_distance, abs(way.yaw) / config.max_turn, 1.0 / share)
    return max(1, math.ceil(wanted - 1e-6))


def lying_pose(config: GaitConfig) -> JointVector:
    """Compute the joint angles of the lying robot: torso on its pegs, feet at home on the floor [rad]."""
    angles = leg_angles(config.home_b, config.robot)
    assert angles is not None
    return angles
