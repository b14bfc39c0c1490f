"""The crawl task on a page: constants with units, goals, reward terms, failure, metrics, success."""

import math
from dataclasses import dataclass, field, fields

import numpy as np

from spidar_gym.arrays import Matrix3, Vector3
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.planar import Planar
from spidar_gym.control.presets import SCHEDULES
from spidar_gym.envs.rewards import tolerance
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.robot import N_LEGS, ROBOT
from spidar_gym.sim.ground import MAX_SLOPE, GroundConfig, Touch, uneven, with_blocks

PAPER_WAY = Planar(0.6, 0.0, 0.0)
"""The paper's way, 0.6 m straight ahead [Zhao2025, Sec. Crawling Motion]."""
PAPER_SHARE = 0.25
"""How often the default draw is exactly that."""
DISTANCES, TURN = (0.2, 0.6), 0.5
"""Otherwise it goes so far [m] in any direction and turns by at most so much [rad]."""
TURN_LENGTH = 0.5
"""A radian of heading counts as this many metres where both are one number."""
OBSTACLE_HEIGHT = 0.15
"""Of an obstacle [m]."""
GOAL_CLEARANCE = 0.3
"""A goal is at least this far from an obstacle [m]."""
MAX_TILT = 0.5
"""More tilt of the torso against the floor than this ends the episode [rad]."""
MAX_ASTRAY = 0.5
"""… and being this much farther from the goal than at the start [m]."""
SUCCESS_POSITION, SUCCESS_YAW = 0.010, 0.02
"""A success ends this close to the goal [m], [rad]."""
SUCCESS_AIRBORNE = 0.95
"""… with every foot off the ground for this share of its swing,"""
SUCCESS_SLIP = 0.05
"""… with no foot sliding farther than this [m],"""
SUCCESS_TIME = 1.25
"""… within this many times the preset's nominal time."""
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
    """How far the heading turns on the way [rad]; drawn if None."""
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
    """The floor is of 25 cm tiles whose heights are drawn up to this [m]; 0 is a plane."""
    obstacles: tuple[tuple[float, float, float], ...] = ()
    """Blocks on the floor: (x, y, radius) [m] from the start; the tiles within are 15 cm high."""
    horizon_s: float = 75.0
    """Length of an episode [s]; give `gym.make` the matching `max_episode_steps` too (40 a second)."""

    def __post_init__(self) -> None:
        """Refuse what cannot be crawled."""
        for name, low, high, unit in (
            ("distance", 0.0, 10.0, "m"), ("direction", -2 * math.pi, 2 * math.pi, "rad"),
            ("turn", -2 * math.pi, 2 * math.pi, "rad"), ("joint_speed", 1e-3, 2.0, "rad/s"),
            ("friction", 1e-3, 5.0, "1"), ("slope", -MAX_SLOPE, MAX_SLOPE, "rad"),
            ("slope_direction", -2 * math.pi, 2 * math.pi, "rad"), ("steps", 0.0, 0.2, "m"),
            ("horizon_s", 1.0 / CONTROL_RATE, math.inf, "s"),
        ):  # fmt: skip
            value = getattr(self, name)
            if value is None:
                continue
            if not (isinstance(value, int | float) and math.isfinite(value) and low <= value <= high):
                raise InvalidValueError(name, value, f"a number within {low:g} … {high:.4g} [{unit}]")
        if self.schedule is not None:
            require_name("schedule", self.schedule, SCHEDULES)
        for block in self.obstacles:
            if len(block) != 3 or not all(math.isfinite(v) for v in block) or not 0.0 < block[2] <= 2.0:
                raise InvalidValueError("obstacles", block, "(x, y, radius) in metres, radius within 0 … 2")
        if self.distance == 0.0 and self.turn == 0.0:
            raise InvalidValueError("distance", 0.0, "a way or a turn above 0")

    @classmethod
    def option_names(cls) -> list[str]:
        """Names of the arguments."""
        return [f.name for f in fields(cls)]

    def way(self, rng: np.random.Generator) -> Planar:
        """Where the goal is, seen from the start; the paper's 0.6 m ahead in a quarter of the draws.

        A goal in an obstacle is drawn again; `InvalidValueError` where it is given, or none of 100 draws is free.
        """
        way = self._draw(rng)
        given = None not in (self.distance, self.direction)
        for _ in range(0 if given else 100):
            if self._blocked(way) is None:
                break
            way = self._draw(rng)
        if self._blocked(way) is None:
            return way
        raise InvalidValueError("goal", (way.x, way.y), f"a pose farther than 0.3 m from obstacle {self._blocked(way)}")

    def _blocked(self, way: Planar) -> tuple[float, float, float] | None:
        """The obstacle in which the torso would come to lie."""
        for x, y, r in self.obstacles:
            if math.hypot(way.x - x, way.y - y) < r + GOAL_CLEARANCE:
                return x, y, r
        return None

    def _draw(self, rng: np.random.Generator) -> Planar:
        paper = rng.random() < PAPER_SHARE
        distance, direction, turn = rng.uniform((DISTANCES[0], -math.pi, -TURN), (DISTANCES[1], math.pi, TURN)).tolist()
        drawn = (PAPER_WAY.x, 0.0, 0.0) if paper else (distance, direction, turn)
        distance, direction, turn = (
            own if given is None else float(given)
            for own, given in zip(drawn, (self.distance, self.direction, self.turn), strict=True)
        )
        # On an arc the chord points in the given direction.
        return Planar(distance * math.cos(direction), distance * math.sin(direction), turn)

    def ground(self, rng: np.random.Generator, base: GroundConfig) -> GroundConfig:
        """The floor of an episode: the robot's configuration says, but for the task's slope and steps."""
        ground = base
        if self.slope:
            ground = GroundConfig(self.slope, self.slope_direction, base.tiles)
        if self.steps:
            ground = uneven(ground, rng, self.steps)
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
            "progress": max(0.0, 1.0 - progress.rest / progress.whole),
            "goal": tolerance(progress.rest, 0.01),
            "level": tolerance(tilt, 0.03),
            "slip": tolerance(slip, 0.02),
            "power": max(0.0, 1.0 - power / 3000.0),
            "action": 1.0 - float(action @ action) / len(action),
        }

    def failed(self, progress: "CrawlProgress", tilt: float, touch: Touch) -> str:
        """Why the crawl is over, empty while it goes on."""
        if touch.ducts:
            return "duct"
        if tilt > MAX_TILT:
            return "tilt"
        return "astray" if progress.rest > progress.whole + MAX_ASTRAY else ""


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

    goal: Planar
    """Where to, world."""
    nominal_time: float
    """How long the preset's gait takes, servos perfect [s]."""
    error: Vector3
    """Goal − torso: x, y [m], world, and yaw [rad]."""
    whole: float = 1.0
    """Way at the start [m]."""
    rest: float = 1.0
    """Way now [m]."""
    ticks: int = 0
    """Control periods."""
    finished: float = 0.0
    """When the gait was done [s]; 0 before."""
    swing_ticks: int = 0
    """Ticks in which the legs swing."""
    airborne_ticks: np.ndarray = field(default_factory=lambda: np.zeros(N_LEGS))
    """… of which each foot was in the air."""
    foot_slip: np.ndarray = field(default_factory=lambda: np.zeros(N_LEGS))
    """Way of each foot's touching point along the floor [m]."""
    peg_slip: np.ndarray = field(default_factory=lambda: np.zeros(N_LEGS))
    """… of each of the torso's pegs [m]."""
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

    def look(self, position_w: Vector3, R_wb: Matrix3) -> None:
        """Measure the way to the goal."""
        yaw = math.remainder(self.goal.yaw - math.atan2(R_wb[1, 0], R_wb[0, 0]), 2.0 * math.pi)
        self.error = np.array([self.goal.x - position_w[0], self.goal.y - position_w[1], yaw])
        self.rest = math.hypot(self.error[0], self.error[1]) + TURN_LENGTH * abs(yaw)

    def advance(
        self, touch: Touch, phase: str, thrust: float, joint_torque: np.ndarray, torque_limit: float, tilt: float
    ) -> None:
        """Count one tick."""
        self.ticks += 1
        dt = 1.0 / CONTROL_RATE
        if phase == "swing":
            self.swing_ticks += 1
            self.airborne_ticks = self.airborne_ticks + ~touch.feet
        self.foot_slip = self.foot_slip + dt * touch.foot_slip
        self.peg_slip = self.peg_slip + dt * touch.peg_slip
        self.duct_clearance = min(self.duct_clearance, touch.duct_clearance)
        self.duct_contact = self.duct_contact or touch.ducts
        if not self.finished:
            self.saturation += float((np.abs(joint_torque) >= torque_limit - SATURATED).mean())
            share = thrust / ROBOT.weight
            self.thrust += share
            self.thrust_peak = max(self.thrust_peak, share)
        if phase in ("spool", "raise", "swing", "lower"):
            self.tilt_legs = max(self.tilt_legs, tilt)
        elif phase != "done":
            self.tilt_torso = max(self.tilt_torso, tilt)

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
        return float(self.airborne_ticks.min()) / self.swing_ticks if self.swing_ticks else 1.0

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
