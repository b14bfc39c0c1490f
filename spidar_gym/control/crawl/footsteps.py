"""Footsteps of the crawl: start pose, commands, reach, how many cycles a way takes [Zhao2025, Sec. Crawling Gait]."""

import math
from dataclasses import dataclass

from spidar_gym.arrays import FootForces, JointVector
from spidar_gym.control.crawl.kinematics import foot_positions, leg_angles
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError, require_name, require_not_negative
from spidar_gym.robot import ROBOT, RobotSpec

STRIDES = ("centred", "home")
"""`centred`: feet go to home ± ½ stride round the torso; `home`: from home to home + stride, as in the lab's code."""
MOST_STRIDE = 20.0
"""The largest stride is looked for up to this share of a way."""
BISECTIONS = 24
"""How often its interval is halved."""


@dataclass(frozen=True)
class GaitConfig:
    """What the gait is made of."""

    inner: float = -0.55
    """Start pose, inner pitch: the feet's home is where this pose has them, on the floor [rad]."""
    outer: float = 1.32
    """Start pose, outer pitch [rad]."""
    stride: str = "centred"
    """Where feet go: one of `STRIDES`."""
    max_distance: float = 0.2
    """Longest way of a cycle [m]; the reach may allow less."""
    max_turn: float = 0.5
    """Largest turn of a cycle [rad]."""
    raise_angle: float = 0.1
    """The inner pitch rises this far above the higher of start and end of the step [rad] [JSK]."""
    lift_height: float = 0.1
    """The torso moves at this height above where it lay [m] [Zhao2025, Sec. Crawling Motion]."""
    press: float = 0.004
    """Feet and torso are sent this far below the floor, so that they arrive [m]."""
    swing_at: float = 1.0
    """The swing begins at this share of the raise."""
    lower_at: float = 0.05
    """Legs are lowered when yaw and outer pitch are this close to their targets [rad]."""
    forward_at: float = 1.0
    """The torso moves on at this share of its lift."""
    down_at: float = 1.0
    """The torso goes down at this share of its way."""
    start_time: float = 0.5
    """Time in which thrust takes over from rest before anything moves [s]."""
    spool_time: float = 0.5
    """Time in which thrust takes over from the mode before it, before anything moves [s]."""
    settle_time: float = 0.5
    """Time in which thrust fades after the torso has come down [s]; 0 goes on to the next cycle without a rest."""
    leg_touch_time: float = 0.3
    """Feet have touched down when the inner pitches are near their targets and still for so long [s]."""
    torso_touch_time: float = 0.2
    """The torso has touched down when it is near its height and still for so long [s]."""
    arrival: float = 0.003
    """The torso is down its way when it is this close, filtered [m]; it waits for its trim until then."""
    stall_time: float = 0.5
    """A phase whose plan is at its end goes on where the legs have come to rest for so long, short of it [s]."""
    trim_gain: float = 2.0
    """Integral gain from the torso's error to where the legs push it [1/s]; 0 is off."""
    trim_limit: float = 0.03
    """Largest trim [m]."""
    rolling: bool = False
    """Whether the kinematics know that the feet are balls, which roll as their legs turn."""
    timeout: float = 10.0
    """A phase that has not ended by then ends [s]."""
    robot: RobotSpec = ROBOT
    """Whose legs they are."""

    def __post_init__(self) -> None:
        """Refuse a start pose out of reach and what is no length or time."""
        require_name("stride scheme", self.stride, STRIDES)
        positive = {k: v for k, v in vars(self).items() if k not in ("inner", "outer", "stride", "rolling", "robot")}
        require_not_negative(**positive)
        for name in ("max_distance", "max_turn", "lift_height", "timeout"):
            if getattr(self, name) == 0.0:
                raise InvalidValueError(name, 0.0, "a number above 0")
        home = self.home_b
        if any(leg_angles(home - (0.0, 0.0, z), self.robot) is None for z in (0.0, self.lift_height)):
            raise InvalidValueError("inner, outer", (self.inner, self.outer), "a pose whose feet reach the floor")

    @property
    def home_b(self) -> FootForces:
        """Where the feet stand under a torso on its pegs, torso axes [m]."""
        home = foot_positions(self.inner, self.outer, self.robot)
        home[:, 2] = -self.robot.peg_depth + self.robot.foot_radius
        return home


@dataclass(frozen=True)
class Move:
    """Go to a pose seen from where the command begins, on an arc."""

    way: Pose2
    """Where to."""
    cycles: int = 0
    """In how many cycles; 0 takes as few as reach and configuration allow."""


@dataclass(frozen=True)
class Lift:
    """Raise legs where they stand, hold, lower them."""

    legs: tuple[int, ...] = (0,)
    """Which, 0 … 3 from the front left counter-clockwise."""
    angle: float = 0.2
    """How far the inner pitch rises [rad]."""
    seconds: float = 2.0
    """How long they are held [s]."""


@dataclass(frozen=True)
class Stand:
    """Lift the torso, hold, put it down."""

    height: float = 0.1
    """How far the torso is lifted [m]."""
    seconds: float = 2.0
    """How long it is held [s]."""


GaitCommand = Move | Lift | Stand


def stride_fits(config: GaitConfig, way: Pose2, lift_height: float | None = None) -> bool:
    """Whether one cycle can go this way: every foot in reach at start and end, torso down and lifted."""
    home, height = config.home_b, config.lift_height if lift_height is None else lift_height
    ends = (way.arc(0.5), way.arc(-0.5)) if config.stride == "centred" else (way, Pose2())
    for end in ends:
        feet = end.move(home)
        for z in (-config.press, height):
            if leg_angles(feet - (0.0, 0.0, z), config.robot) is None:
                return False
    return True


def largest_stride(config: GaitConfig, way: Pose2) -> float:
    """Largest share of `way` that one cycle can go by the legs' reach, up to `MOST_STRIDE`."""
    low, high = 0.0, 1.0
    while high < MOST_STRIDE and stride_fits(config, way.arc(high)):
        low, high = high, 2.0 * high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stride_fits(config, way.arc(middle)) else (low, middle)
    return low


def plan_cycles(config: GaitConfig, move: Move) -> int:
    """How many cycles a move takes; feet step as far as the torso moves in each [Zhao2025, Sec. Crawling Gait].

    `InvalidValueError` names the largest stride where too few cycles are given.
    """
    way = move.way
    if not all(math.isfinite(v) for v in (way.x, way.y, way.yaw)):
        raise InvalidValueError("way", way, "finite numbers")
    share = largest_stride(config, way)
    if share <= 0.0:
        raise InvalidValueError("way", way, "a way whose first step is in reach")
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
    """Joint angles of the robot at rest: torso on its pegs, feet at home on the floor [rad]."""
    angles = leg_angles(config.home_b, config.robot)
    assert angles is not None
    return angles
