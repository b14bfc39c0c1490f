"""The course task on a page: constants with units, what is drawn, reward terms, failure, success."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spidar_gym.arrays import Matrix3, Vector3
from spidar_gym.control.course.gates import (
    FLOORS,
    GATES,
    HALF_WIDTH,
    MAX_GATES,
    TILE_COLUMNS,
    TILE_ROWS,
    Course,
    Gate,
)
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.rewards import tolerance
from spidar_gym.errors import InvalidValueError, SpidarError, require_name, require_within
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.energy import CAPACITY_WH, USABLE
from spidar_gym.state import RobotState

PLAIN = "plain"
"""The floor on which there is nothing."""
SIZES = {
    "wall": (0.4, 1.0),
    "beam": (0.55, 0.7),
    "slot": (1.3, 2.2),
    "platform": (0.1, 0.4),
    "tiles": (0.005, 0.02),
    "slope": (math.radians(3.0), math.radians(10.0)),
}
"""Between these the size of each kind is drawn: height, clearance, width, highest tile [m], angle [rad]."""
DEPTHS = {"wall": 0.2, "beam": 0.4, "slot": 0.3}
"""How long each gate is along the course [m]."""
FIRST_GAP, GAP, FLOOR_GAP, FLOOR_LENGTH = (2.2, 2.6), (3.0, 3.4), 2.6, 3.5
"""From the start to the first gate, from each to the next, from the last to the floor of the goal; its length [m]."""
MIDDLE = 0.8
"""The middle of a slot lies up to so far to a side [m]."""
GOAL_WAY, GOAL_SIDE, GOAL_YAW = (1.5, 1.9), 0.4, 0.4
"""The goal lies so far behind its floor's begin, up to so far to a side [m], and turned by up to so much [rad]."""
CHARGE = (0.6, 1.0)
"""Between these the battery's charge at the start is drawn."""
DECIDE = 20
"""Ticks from one decision about the target to the next: 0.5 s."""
MAX_HIT = 20.0
"""A larger force on anything but feet and pegs ends the episode [N]."""
MAX_TILT = 1.2
"""So does more tilt than this [rad]."""
LIES, AT_REST, CARRIED = 0.06, 0.05, 0.1
"""The robot lies where its torso is so little higher than on its pegs [m], moves no faster than this [m/s], and its
rotors carry no more than this share of its weight."""
TURN_LENGTH = 0.5
"""A radian of heading counts as this many metres where both are one number."""
GOAL_MARGIN, HIT_MARGIN = 0.03, 5.0
"""Rest of the way [m] and force [N] at which these terms of the reward are ½."""
MOST_POWER = 3000.0
"""Electrical power at which its term of the reward is 0 [W]."""
SUCCESS_POSITION, SUCCESS_YAW = 0.03, 0.05
"""A success lies this close to the goal [m], [rad]."""
RANGES = {
    "charge": (1e-3, 1.0, "1"),
    "joint_speed": (0.1, 2.0, "rad/s"),
    "crawl_speed": (0.05, 2.0, "rad/s"),
    "horizon_s": (1.0 / CONTROL_RATE, 1e9, "s"),
}
"""Least and largest number of each argument, and its unit."""


@dataclass(frozen=True)
class CourseTask:
    """Reach a pose on the floor behind walls, beams and slots: fly over, crawl under, fly through in a narrow form."""

    gates: tuple[str, ...] = GATES
    """Kinds of gates that are drawn: of `wall`, `beam`, `slot`."""
    floors: tuple[str, ...] = (PLAIN, *FLOORS)
    """What the goal may lie on: of `plain`, `platform`, `tiles`, `slope`."""
    count: tuple[int, int] = (2, 3)
    """Least and largest number of gates."""
    course: Course | None = None
    """One's own, the same in every episode: a `Course`, or `{"gates": [[kind, begin, end, size, middle], …], "goal":
    [x, y, yaw], "tiles": […]}`; drawn if not given."""
    charge: float | None = None
    """The charge of the battery at the start, 0 … 1; drawn from 0.6 … 1 if not given."""
    joint_speed: float = 0.6
    """Speed of the joints in flight [rad/s]."""
    crawl_speed: float = 0.4
    """Speed of the joints on the floor [rad/s]."""
    horizon_s: float = 300.0
    """Length of an episode [s]."""

    def __post_init__(self) -> None:
        """Refuse what is no course."""
        for name, bounds in RANGES.items():
            value: float | None = getattr(self, name)
            if value is not None or name != "charge":
                require_within(*bounds, **{name: value})
                object.__setattr__(self, name, float(value or 0.0))
        for name, kind, valid in (("gates", "gate", GATES), ("floors", "floor", (PLAIN, *FLOORS))):
            given = getattr(self, name)
            if not isinstance(given, str | tuple | list):
                raise InvalidValueError(name, given, f"any of {', '.join(valid)}")
            chosen = (given,) if isinstance(given, str) else tuple(given)
            for each in chosen:
                require_name(kind, each, valid)
            object.__setattr__(self, name, chosen)
        count = self.count
        whole = isinstance(count, tuple | list) and len(count) == 2 and all(isinstance(n, int) for n in count)
        if not (whole and 0 <= count[0] <= count[1] < MAX_GATES):
            raise InvalidValueError("count", count, f"two whole numbers within 0 … {MAX_GATES - 1}, the least first")
        if not self.floors or (count[1] and not self.gates):
            raise InvalidValueError("gates", self.gates, "at least one kind of gate, and one of floors")
        object.__setattr__(self, "count", tuple(count))

    def draw(self, rng: np.random.Generator) -> Course:
        """The course of an episode."""
        if self.course is not None:
            return self.course
        gates, x, has_beam = list[Gate](), 0.0, False
        for k in range(int(rng.integers(self.count[0], self.count[1] + 1))):
            which = int(rng.integers(0, len(self.gates)))
            if has_beam and self.gates[which] == "beam":  # two of them would take longer than there is time
                which = (which + 1) % len(self.gates)
            kind = self.gates[which]
            has_beam = has_beam or kind == "beam"
            begin, size = x + rng.uniform(*(GAP if k else FIRST_GAP)), rng.uniform(*SIZES[kind])
            side = rng.uniform(-MIDDLE, MIDDLE)
            x = begin + DEPTHS[kind]
            gates.append(Gate(kind, begin, x, size, side if kind == "slot" else 0.0))
        floor, begin = self.floors[int(rng.integers(0, len(self.floors)))], x + FLOOR_GAP
        size = 0.0
        if floor != PLAIN:
            size = rng.uniform(*SIZES[floor])
            gates.append(Gate(floor, begin, begin + FLOOR_LENGTH, size))
        goal = Pose2(
            begin + rng.uniform(*GOAL_WAY), rng.uniform(-GOAL_SIDE, GOAL_SIDE), rng.uniform(-GOAL_YAW, GOAL_YAW)
        )
        tiles = rng.uniform(0.0, size, TILE_ROWS * TILE_COLUMNS).tolist() if floor == "tiles" else ()
        return Course(tuple(gates), goal, tuple(tiles))

    def draw_charge(self, rng: np.random.Generator) -> float:
        """The battery's charge at the start."""
        return rng.uniform(*CHARGE) if self.charge is None else self.charge

    def reward_terms(self, progress: "CourseProgress", power: float) -> dict[str, float]:
        """Terms in [0, 1]; the reward is their sum weighted with `COURSE_REWARD_TERMS`.

        Args:
            progress: The episode.
            power: Electrical [W].
        """
        return {
            "progress": max(0.0, 1.0 - progress.distance / progress.initial_distance),
            "goal": tolerance(progress.distance, GOAL_MARGIN) if progress.lies else 0.0,
            "power": max(0.0, 1.0 - power / MOST_POWER),
            "safety": tolerance(progress.hit, HIT_MARGIN),
        }

    def failed(self, progress: "CourseProgress", course: Course, position_w: Vector3, tilt: float, phase: str) -> str:
        """Why the episode is over, empty while it goes on."""
        if progress.hit > MAX_HIT:
            return "hit"
        if not course.is_inside(*position_w.tolist()):
            return "out"
        if tilt > MAX_TILT or phase == "cut":
            return "tilt"
        return "" if progress.charge > 0.0 else "empty"


def parse_course(value: Any) -> Course | None:  # noqa: ANN401 - whatever a user gives
    """A course, or one of a dictionary of lists, as scenario files have it."""
    if value is None or isinstance(value, Course):
        return value
    valid = "a Course, or {'gates': [[kind, begin, end, size, middle], …], 'goal': [x, y, yaw], 'tiles': […]}"
    if not (isinstance(value, Mapping) and {"gates", "goal"} <= value.keys() <= {"gates", "goal", "tiles", "dares"}):
        raise InvalidValueError("course", value, valid)
    try:
        gates = tuple(Gate(kind, *map(float, rest)) for kind, *rest in value["gates"])
        goal, tiles = Pose2(*map(float, value["goal"])), tuple(map(float, value.get("tiles", ())))
    except SpidarError:
        raise
    except (TypeError, ValueError):
        raise InvalidValueError("course", value, valid) from None
    return Course(gates, goal, tiles, value.get("dares", False))


def plain_course(course: Course) -> dict[str, Any]:
    """A course as a dictionary of lists: what `parse_course` reads."""
    gates = [[g.kind, g.begin, g.end, g.size, g.middle] for g in course.gates]
    goal = [course.goal.x, course.goal.y, course.goal.yaw]
    return {"gates": gates, "goal": goal, "tiles": list(course.tiles), "dares": course.dares}


COURSE_REWARD_TERMS = {
    "progress": (0.6, "1 − rest / whole way; a radian counts as 0.5 m"),
    "goal": (0.2, "1 / (1 + (rest / 0.03 m)²) while the robot lies, 0 else"),
    "power": (0.1, "1 − electrical power / 3000 W"),
    "safety": (0.1, "1 / (1 + (largest force on ducts and links / 5 N)²)"),
}
"""Weight and formula of the reward's terms."""
COURSE_FAILURES = {
    "hit": f"something but feet and pegs is hit with more than {MAX_HIT:g} N",
    "out": f"it leaves the field, ± {HALF_WIDTH:g} m wide, up to the ceiling, from behind the start to past the goal",
    "tilt": f"the torso tilts by more than {MAX_TILT:g} rad, or the rotors are cut in the air",
    "empty": "the battery's usable charge is used up",
    "diverged": "the simulation's state is no longer finite",
}
"""Words of `info["failure"]` and what they mean."""


@dataclass
class CourseProgress:
    """How far an episode has come, and what it has cost."""

    goal: Pose2
    """Where to, world."""
    spent_wh: float
    """Energy that the battery lacks at the start [Wh]."""
    initial_distance: float = 1.0
    """Distance to the goal at the start, a radian counting `TURN_LENGTH` [m]."""
    error: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Goal − torso: x, y [m], world, and yaw [rad]."""
    distance: float = 1.0
    """Distance to the goal now [m]."""
    ticks: int = 0
    """Steps of the environment."""
    controls: int = 0
    """Control periods."""
    arrived: float = 0.0
    """Since when the robot lies at the goal [s]; 0 if it does not."""
    flown: int = 0
    """Control periods with the weight on the rotors or on its way there: all but lying and crawling."""
    crawled: int = 0
    """Control periods of crawling."""
    lies: bool = False
    """Whether it lies on the floor at rest."""
    hit: float = 0.0
    """Largest force of the last step on anything but feet and pegs [N]."""
    most_hit: float = 0.0
    """The same of the episode."""
    charge: float = 1.0
    """What is left of the battery's usable energy, 0 … 1."""

    def update(
        self, course: Course, state: RobotState, R_wb: Matrix3, energy_wh: float, robot: RobotSpec = ROBOT
    ) -> None:
        """Measure how far the goal is, whether the robot lies, and what is left of the battery."""
        position_w, velocity_w = state.position_w, state.velocity_w
        yaw = math.remainder(self.goal.yaw - math.atan2(R_wb[1, 0], R_wb[0, 0]), 2.0 * math.pi)
        self.error = np.array([self.goal.x - position_w[0], self.goal.y - position_w[1], yaw])
        self.distance = math.sqrt(self.error[0] ** 2 + self.error[1] ** 2) + TURN_LENGTH * abs(yaw)
        height = float(position_w[2]) - course.floor_at(float(position_w[0])) - robot.peg_depth
        is_still = math.sqrt(float(velocity_w @ velocity_w)) < AT_REST
        self.lies = height < LIES and is_still and float(state.thrust.sum()) < CARRIED * robot.weight
        self.charge = 1.0 - (self.spent_wh + energy_wh) / (USABLE * CAPACITY_WH)

    def advance(self, phase: str, hit: float) -> None:
        """Count a control period."""
        self.controls += 1
        self.crawled += phase == "crawl"
        self.flown += phase not in ("lie", "crawl", "cut")
        self.hit = max(self.hit, hit)
        self.most_hit = max(self.most_hit, hit)
        if not self.is_there:
            self.arrived = 0.0
        elif not self.arrived:
            self.arrived = self.controls / CONTROL_RATE

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.controls / CONTROL_RATE

    @property
    def flown_s(self) -> float:
        """Time in the air [s]."""
        return self.flown / CONTROL_RATE

    @property
    def crawled_s(self) -> float:
        """Time of crawling [s]."""
        return self.crawled / CONTROL_RATE

    @property
    def is_there(self) -> bool:
        """Whether the robot lies at the goal."""
        off = math.sqrt(self.error[0] ** 2 + self.error[1] ** 2)
        return self.lies and off <= SUCCESS_POSITION and abs(float(self.error[2])) <= SUCCESS_YAW

    @classmethod
    def read(cls, record: Any) -> "CourseProgress":  # noqa: ANN401 - numpy's row
        """That of a robot in the engine, an `sp_coursing`."""
        names = ("initial_distance", "distance", "controls", "arrived", "flown", "crawled", "hit", "most_hit", "charge")
        values = {name: record[name].item() for name in names}
        goal, spent = Pose2(*record["course"]["goal"].tolist()), record["plant"]["spent_wh"].item()
        return cls(goal, spent, **values, error=record["error"].copy(), lies=bool(record["lies"]))
