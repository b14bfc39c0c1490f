"""The crawl task on a page: constants with units, goals, reward terms, failure, metrics, success."""

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from spidar_gym.arrays import Matrix3, Vector3
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import SCHEDULES
from spidar_gym.envs.rewards import tolerance
from spidar_gym.errors import InvalidValueError, require_array, require_name, require_within
from spidar_gym.robot import N_LEGS, ROBOT
from spidar_gym.sim.ground import HIGHEST, MAX_SLOPE, STAIRS, TERRAINS, GroundConfig, Touch, uneven, with_blocks
from spidar_gym.state import RobotState

PAPER_WAY = Pose2(0.6, 0.0, 0.0)
"""The paper's way, 0.6 m straight ahead [Zhao2025, Sec. Crawling Motion]."""
PAPER_SHARE = 0.25
"""How often the default draw is exactly the paper's way."""
DISTANCES, TURN = (0.2, 0.6), 0.5
"""The other default draws go so far [m] in any direction and turn by at most so much [rad]."""
TURN_LENGTH = 0.5
"""A radian of heading counts as this many metres where both are one number."""
OBSTACLE_HEIGHT = 0.15
"""Height of an obstacle [m]."""
GOAL_CLEARANCE = 0.3
"""A goal is at least this far from an obstacle [m]."""
MAX_TILT = 0.5
"""More tilt of the torso against the floor than this ends the episode [rad]."""
MAX_ASTRAY = 0.5
"""Being this much farther from the goal than at the start ends the episode [m]."""
GOAL_MARGIN, LEVEL_MARGIN, SLIP_MARGIN = 0.01, 0.03, 0.02
"""What is left of the way [m], tilt [rad] and slip [m/s] at which these terms of the reward are ½."""
MOST_POWER = 3000.0
"""Electrical power at which its term of the reward is 0 [W]."""
RANGES = {
    "distance": (0.0, 10.0, "m"),
    "direction": (-2.0 * math.pi, 2.0 * math.pi, "rad"),
    # A turn on the spot by more than π leaves the goal's heading behind before it comes near it.
    "turn": (-math.pi - MAX_ASTRAY / TURN_LENGTH, math.pi + MAX_ASTRAY / TURN_LENGTH, "rad"),
    "joint_speed": (1e-3, 2.0, "rad/s"),
    "friction": (1e-3, 5.0, "1"),
    "slope": (-MAX_SLOPE, MAX_SLOPE, "rad"),
    "slope_direction": (-2.0 * math.pi, 2.0 * math.pi, "rad"),
    "steps": (0.0, 0.2, "m"),
    "horizon_s": (1.0 / CONTROL_RATE, 1e9, "s"),
}
"""Least and largest number of each argument, and its unit."""
SEARCHED = 1000
"""Goals drawn in search of one that no obstacle covers."""
SUCCESS_POSITION, SUCCESS_YAW = 0.010, 0.02
"""A success ends this close to the goal [m], [rad]."""
SUCCESS_AIRBORNE = 0.95
"""In a success every foot is off the ground for this share of its swing."""
SUCCESS_SLIP = 0.05
"""In a success no foot slides this far [m]."""
SUCCESS_TIME = 1.25
"""A success takes at most this many times the preset's nominal time."""
REST_TIME = 0.25
"""Without a gait, in `direct`, a crawl is finished that has rested at the goal, within the miss of a success, for so
long [s]: a torso that nothing carries falls by 0.3 m in it."""
REST_SPEED, REST_TURN, REST_JOINT_SPEED = 0.01, 0.05, 0.05
"""A robot at rest moves slower than this [m/s], [rad/s], and so does every joint [rad/s]; what slides on at that speed
goes a quarter of the miss of a success in that time, and the joints of a swing are ten times as fast."""
REST_THRUST = 0.1
"""Its thrust is off: all commands together are below this share of the weight; idle motors are at 6 %."""
SATURATED = 0.01
"""A joint servo this close to its largest torque is saturated [Nm]."""


@dataclass(frozen=True)
class CrawlTask:
    """Crawl to a pose on the floor: lift the legs, set them forward, carry the torso after them."""

    distance: float | None = None
    """How far the goal is [m]; drawn if None."""
    direction: float | None = None
    """In which direction, 0 straight ahead, π/2 to the left [rad]; drawn if None."""
    turn: float | None = None
    """How far the heading turns [rad], where the arc leads less than 0.5 m away from its goal; drawn if None."""
    joint_speed: float | None = None
    """Speed of the joint motion [rad/s]; the preset's own if None."""
    schedule: str | None = None
    """`sequential` or `overlapped` phases; the preset's own if None."""
    friction: float | None = None
    """Sliding friction of the feet; the robot's own if None."""
    slope: float = 0.0
    """Angle of the floor to the horizontal [rad]."""
    slope_direction: float = 0.0
    """Direction in which it rises [rad]."""
    steps: float = 0.0
    """The floor is of 25 cm tiles with steps of this height [m]; 0 is a plane."""
    terrain: str = "tiles"
    """What has them: `tiles` whose heights are drawn up to `steps`, `stairs` of that height across the way ahead, 0.5
    and 1.25 m from the start, at most 0.1 m, or `mixed`, one as often as the other."""
    obstacles: tuple[tuple[float, float, float], ...] = ()
    """Blocks on the floor: (x, y, radius) [m] from the start; the tiles within are 15 cm high."""
    horizon_s: float = 75.0
    """Length of an episode [s]."""

    def __post_init__(self) -> None:
        """Refuse what cannot be crawled."""
        for name, bounds in RANGES.items():
            value: float | None = getattr(self, name)
            if value is None and getattr(CrawlTask, name) is None:
                continue
            require_within(*bounds, **{name: value})
            object.__setattr__(self, name, float(value or 0.0))
        if self.schedule is not None:
            require_name("schedule", self.schedule, SCHEDULES)
        require_name("terrain", self.terrain, TERRAINS)
        if self.terrain != "tiles" and self.steps > HIGHEST / STAIRS:
            raise InvalidValueError("steps", self.steps, f"stairs of at most {HIGHEST / STAIRS:g} m")
        self._check_obstacles()
        if self.distance == 0.0 and self.turn == 0.0:
            raise InvalidValueError("distance", 0.0, "a way or a turn above 0")
        if self.turn is not None:
            astray = arc_astray(DISTANCES[1] if self.distance is None else self.distance, self.turn)
            if astray >= MAX_ASTRAY:
                raise InvalidValueError(
                    "turn", self.turn,
                    f"a smaller turn [rad] or a shorter way: the arc leads {astray:.2f} m away from the goal, below "
                    f"{MAX_ASTRAY:g} m is valid",
                )  # fmt: skip

    def _check_obstacles(self) -> None:
        """Refuse what is no block, and blocks that leave no goal."""
        expected = "some (x, y, radius) in metres, within ± 100 m, radius within 0 … 2"
        blocks = require_array("obstacles", self.obstacles, expected)
        if blocks.shape == (0,):
            return
        if blocks.ndim != 2 or blocks.shape[1] != 3:
            raise InvalidValueError("obstacles", self.obstacles, expected)
        for x, y, radius in blocks.tolist():
            if not (abs(x) <= 100.0 and abs(y) <= 100.0 and 0.0 < radius <= 2.0):
                raise InvalidValueError("obstacles", (x, y, radius), expected)
        object.__setattr__(self, "obstacles", tuple(map(tuple, blocks.tolist())))
        rng = np.random.Generator(np.random.PCG64(0))
        if any(self._blocked(self._draw(rng)) is None for _ in range(SEARCHED)):
            return
        goal = self._draw(rng)
        where = f"a pose farther than {GOAL_CLEARANCE:g} m from obstacle {self._blocked(goal)}"
        raise InvalidValueError("goal", (goal.x, goal.y), where)

    def way(self, rng: np.random.Generator) -> Pose2:
        """Where the goal is, seen from the start; the paper's 0.6 m ahead in a quarter of the draws.

        A goal in an obstacle is drawn again.
        """
        while True:
            way = self._draw(rng)
            if self._blocked(way) is None:
                return way

    def _blocked(self, way: Pose2) -> tuple[float, float, float] | None:
        """The obstacle in which the torso would come to lie."""
        for x, y, r in self.obstacles:
            if math.hypot(way.x - x, way.y - y) < r + GOAL_CLEARANCE:
                return x, y, r
        return None

    def _draw(self, rng: np.random.Generator) -> Pose2:
        paper = rng.random() < PAPER_SHARE
        distance, direction, turn = rng.uniform((DISTANCES[0], -math.pi, -TURN), (DISTANCES[1], math.pi, TURN)).tolist()
        drawn = (PAPER_WAY.x, 0.0, 0.0) if paper else (distance, direction, turn)
        distance, direction, turn = (
            own if given is None else float(given)
            for own, given in zip(drawn, (self.distance, self.direction, self.turn), strict=True)
        )
        # On an arc the chord points in the given direction.
        return Pose2(distance * math.cos(direction), distance * math.sin(direction), turn)

    def ground(self, rng: np.random.Generator, base: GroundConfig) -> GroundConfig:
        """The floor of an episode: the robot's configuration says, but for the task's slope and steps."""
        ground = base
        if self.slope:
            ground = GroundConfig(self.slope, self.slope_direction, base.tiles)
        if self.steps:
            ground = uneven(ground, rng, self.steps, self.terrain)
        return with_blocks(ground, self.obstacles, OBSTACLE_HEIGHT) if self.obstacles else ground

    def reward_terms(
        self, progress: "CrawlProgress", tilt: float, slip: float, power: float, action: np.ndarray
    ) -> dict[str, float]:
        """Terms in [0, 1]; the reward is their sum weighted with `CRAWL_REWARD_TERMS`.

        Args:
            progress: The episode.
            tilt: Of the torso against the floor [rad].
            slip: Largest speed of a touching point [m/s].
            power: Electrical [W].
            action: In [−1, 1].
        """
        return {
            "progress": max(0.0, 1.0 - progress.distance / progress.initial_distance),
            "goal": tolerance(progress.distance, GOAL_MARGIN),
            "level": tolerance(tilt, LEVEL_MARGIN),
            "slip": tolerance(slip, SLIP_MARGIN),
            "power": max(0.0, 1.0 - power / MOST_POWER),
            "action": 1.0 - float(action @ action) / len(action),
        }

    def failed(self, progress: "CrawlProgress", tilt: float, touch: Touch) -> str:
        """Why the crawl is over, empty while it goes on."""
        if touch.ducts:
            return "duct"
        if tilt > MAX_TILT:
            return "tilt"
        return "astray" if progress.distance > progress.initial_distance + MAX_ASTRAY else ""


def arc_astray(distance: float, turn: float) -> float:
    """How much farther from its goal than at its start an arc leads [m], a radian counting `TURN_LENGTH`.

    Args:
        distance: Length of its chord [m].
        turn: How far the heading turns on it [rad].
    """
    turn = abs(turn)
    if turn <= math.pi:
        return 0.0
    # Farthest where it is still to turn by π: there the rest of the way is the circle's diameter.
    diameter = distance / math.sin(0.5 * turn) if turn < 2.0 * math.pi else math.inf
    return diameter - distance + TURN_LENGTH * (turn - math.pi)


CRAWL_REWARD_TERMS = {
    "progress": (0.5, "1 − rest / whole way; a radian counts as 0.5 m; 1 at the goal, where the robot rests on"),
    "goal": (0.1, "1 / (1 + (rest / 0.01 m)²)"),
    "level": (0.1, "1 / (1 + (tilt against the floor / 0.03 rad)²)"),
    "slip": (0.1, "1 / (1 + (fastest touching point / 0.02 m/s)²)"),
    "power": (0.1, "1 − electrical power / 3000 W"),
    "action": (0.1, "1 − mean a²"),
}
"""Weight and formula of the reward's terms."""
CRAWL_FAILURES = {
    "duct": "a duct touches the floor",
    "tilt": f"the torso tilts by more than {MAX_TILT:g} rad against the floor",
    "astray": f"the robot is {MAX_ASTRAY:g} m farther from the goal than at the start",
    "diverged": "the simulation's state is no longer finite",
}
"""Words of `info["failure"]` and what they mean."""


@dataclass
class CrawlProgress:
    """How far an episode has come, and what it has cost; what `is_success` is made of."""

    goal: Pose2
    """Where to, world."""
    nominal_time: float
    """How long the preset's gait takes, servos perfect [s]."""
    error: Vector3
    """Goal − torso: x, y [m], world, and yaw [rad]."""
    initial_distance: float = 1.0
    """Distance to the goal at the start, a radian counting `TURN_LENGTH` [m]."""
    distance: float = 1.0
    """Distance to the goal now [m]."""
    ticks: int = 0
    """Control periods."""
    finished: float = 0.0
    """When the gait was done, or without one the robot had rested at the goal [s]; 0 before."""
    rested: int = 0
    """Ticks, up to now, of resting at the goal; counted where there is no gait."""
    swing_ticks: np.ndarray = field(default_factory=lambda: np.zeros(N_LEGS))
    """Ticks in which each leg swings."""
    airborne_ticks: np.ndarray = field(default_factory=lambda: np.zeros(N_LEGS))
    """Ticks of these in which its foot was in the air."""
    foot_slip: np.ndarray = field(default_factory=lambda: np.zeros(N_LEGS))
    """Way of each foot's touching point along the floor [m]."""
    peg_slip: np.ndarray = field(default_factory=lambda: np.zeros(N_LEGS))
    """Way of the touching point of each of the torso's pegs along the floor [m]."""
    duct_clearance: float = math.inf
    """Least height of a duct over the floor so far [m]."""
    duct_contact: bool = False
    """Whether a duct has touched the floor."""
    saturation: float = 0.0
    """Sum over ticks of the share of saturated joints."""
    thrust: float = 0.0
    """Sum over ticks of the commanded thrust over the weight."""
    thrust_peak: float = 0.0
    """Largest commanded thrust over the weight."""
    timeouts: int = 0
    """Phases that ended by time-out."""
    tilt_legs: float = 0.0
    """Largest tilt while the legs are lifted [rad]."""
    tilt_torso: float = 0.0
    """Largest tilt while the torso moves [rad]."""

    @classmethod
    def read(cls, record: Any) -> "CrawlProgress":  # noqa: ANN401 - numpy's row
        """That of a robot in the engine, an `sp_crawling`."""
        values: dict[str, Any] = {}
        for each in fields(cls):
            value = record[{"ticks": "crawled"}.get(each.name, each.name)]
            values[each.name] = value.copy() if value.ndim else value.item()
        own = {
            "goal": Pose2(*record["goal"].tolist()),
            "duct_contact": bool(record["duct_contact"]),
            "swing_ticks": np.full(N_LEGS, float(record["swing_ticks"])),  # there all legs swing together
        }
        return cls(**values | own)

    def update_errors(self, position_w: Vector3, R_wb: Matrix3) -> None:
        """Measure how far the goal is."""
        yaw = math.remainder(self.goal.yaw - math.atan2(R_wb[1, 0], R_wb[0, 0]), 2.0 * math.pi)
        self.error = np.array([self.goal.x - position_w[0], self.goal.y - position_w[1], yaw])
        self.distance = math.hypot(self.error[0], self.error[1]) + TURN_LENGTH * abs(yaw)

    def advance(
        self, touch: Touch, phase: str, swinging: np.ndarray, thrust: float, joint_torque: np.ndarray,
        torque_limit: float, tilt: float, weight: float = ROBOT.weight,
    ) -> None:  # fmt: skip
        """Count one tick; `swinging` are the legs (4,) whose feet are on their way, `weight` is the robot's [N]."""
        self.ticks += 1
        dt = 1.0 / CONTROL_RATE
        self.swing_ticks = self.swing_ticks + swinging
        self.airborne_ticks = self.airborne_ticks + (swinging & ~touch.feet)
        self.foot_slip = self.foot_slip + dt * touch.foot_slip
        self.peg_slip = self.peg_slip + dt * touch.peg_slip
        self.duct_clearance = min(self.duct_clearance, touch.duct_clearance)
        self.duct_contact = self.duct_contact or touch.ducts
        if not self.finished:
            self.saturation += float((np.abs(joint_torque) >= torque_limit - SATURATED).mean())
            share = thrust / weight
            self.thrust += share
            self.thrust_peak = max(self.thrust_peak, share)
        if phase in ("spool", "raise", "swing", "lower"):
            self.tilt_legs = max(self.tilt_legs, tilt)
        elif phase != "done":
            self.tilt_torso = max(self.tilt_torso, tilt)

    def rest(self, state: RobotState, touch: Touch, thrust: float, weight: float = ROBOT.weight) -> None:
        """Count a tick without a gait, which is finished when the robot has rested at the goal for `REST_TIME`.

        Args:
            state: The true one.
            touch: What touches the floor.
            thrust: Commanded, of all rotors [N].
            weight: The robot's [N].
        """
        rests = (
            bool(touch.pegs[:N_LEGS].any())
            and bool((np.abs(state.joint_velocity) < REST_JOINT_SPEED).all())
            and math.sqrt(float(state.velocity_w @ state.velocity_w)) < REST_SPEED
            and math.sqrt(float(state.omega_b @ state.omega_b)) < REST_TURN
            and thrust < REST_THRUST * weight
            and math.hypot(self.error[0], self.error[1]) <= SUCCESS_POSITION
            and abs(self.error[2]) <= SUCCESS_YAW
        )
        self.rested = self.rested + 1 if rests else 0
        if self.rested / CONTROL_RATE >= REST_TIME and not self.finished:
            self.finished = self.time

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.ticks / CONTROL_RATE

    @property
    def counted(self) -> int:
        """Ticks of the crawl itself."""
        return max(1, round(self.finished * CONTROL_RATE) if self.finished else self.ticks)

    @property
    def airborne(self) -> float:
        """Share of its swing in which the worst foot was in the air; 1 before the first swing."""
        swung = self.swing_ticks > 0.0
        return float((self.airborne_ticks[swung] / self.swing_ticks[swung]).min(initial=1.0))

    def shortfalls(self) -> list[str]:
        """What keeps a finished crawl from being a success."""
        checks = {
            "unfinished": not self.finished,
            "position": math.hypot(self.error[0], self.error[1]) > SUCCESS_POSITION,
            "yaw": abs(self.error[2]) > SUCCESS_YAW,
            "airborne": self.airborne < SUCCESS_AIRBORNE,
            "timeout": self.timeouts > 0,
            "slip": float(self.foot_slip.max()) >= SUCCESS_SLIP,
            "duct": self.duct_contact,
            "time": self.finished > SUCCESS_TIME * self.nominal_time,
        }
        return [name for name, missed in checks.items() if missed]
