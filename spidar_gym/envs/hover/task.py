"""The hover task on a page: constants with units, initial state, reference, reward terms, failure, success."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector, Vector3, Wrench, constant
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.path import Path
from spidar_gym.envs.rewards import norm, tolerance
from spidar_gym.errors import InvalidValueError, require_array, require_flag, require_keys, require_name, require_within
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import FORMS, N_JOINTS, N_LEGS, N_ROTORS, ROBOT, RobotSpec

CLEARANCE = 0.5
"""Height of the feet of form ③ over the floor [m]: the CoG hovers where that leaves them."""
MAX_TILT = 1.0
"""More tilt than this ends the flight [rad] [JSK]."""
MAX_DISTANCE = 1.0
"""Farther than this from the reference ends the flight [m]."""
SUCCESS_POSITION, SUCCESS_ATTITUDE = 0.05, 0.05
"""RMS errors of a success stay below these [m], [rad]."""
ARRIVAL_GRACE = 0.5
"""A form may be reached this much after its deadline [s]."""
ARRIVAL_TOLERANCE = 0.05
"""A form is reached when every joint is this close [rad]."""
MARGINS = 0.02, 0.03, 0.1
"""Errors at which the terms of the reward for position [m], attitude and joints [rad] are ½."""
RANGES = {
    "joint_speed": (1e-6, 1e3, "rad/s"),
    # All forms are drawn before the episode begins, a day's in a second.
    "horizon_s": (1e-3, 86400.0, "s"),
    "perturbation": (0.0, 1e3, "1"),
    "altitude": (0.0, 1e3, "m"),
}
"""Least and largest number of each argument, and its unit."""
START = {
    "goals": math.pi, "position": 10.0, "rotation": 2.0 * math.pi, "trim": 1e3, "path": 1e4, "velocity": 20.0,
    "omega": 50.0,
}  # fmt: skip
"""Keys of a given start: no number in it is larger [rad, m, rad, N or Nm, whatever, m/s, rad/s]."""


@lru_cache(maxsize=64)
def hover_height(robot: RobotSpec = ROBOT) -> float:
    """Height of the CoG that leaves the feet of form ③ `CLEARANCE` above the floor [m]."""
    model, q, level = Model(robot), FORMS["form3"], np.zeros((N_ROTORS, 2))
    com_z = model.snapshot(q, np.eye(3), level).com_b[2]
    feet_z = model.contacts(q)[0][:N_LEGS, 2].min()
    return float(CLEARANCE + robot.foot_radius + com_z - feet_z)


@dataclass(frozen=True)
class FormGoal:
    """A form to take, from when on, and by when it should be reached."""

    start: float
    """When it becomes the target [s]."""
    deadline: float
    """When the slowest joint arrives at the joint speed [s]."""
    joint_target: JointVector
    """q [rad]."""


@dataclass(frozen=True)
class FlightStart:
    """All that an episode begins with and goes through, given instead of drawn."""

    goals: tuple[FormGoal, ...]
    """Forms in order; the first is the initial one, reached at time 0."""
    position: Vector3
    """Offset of the torso from its place over the reference [m]."""
    rotation: Vector3
    """Offset of its attitude, a rotation vector [rad]."""
    trim: Wrench | None = None
    """What a hover takes beyond the description, with which the integrals begin [N, Nm]; computed if None."""
    path: Path | None = None
    """Where the CoG goes; it stays if None."""
    velocity: Vector3 = field(default_factory=lambda: constant(0.0, 3))
    """Velocity of the CoG, world [m/s]."""
    omega: Vector3 = field(default_factory=lambda: constant(0.0, 3))
    """Angular velocity of the torso, its axes [rad/s]; legs and rotors are at rest."""

    def __post_init__(self) -> None:
        """Refuse what is no episode."""
        if not self.goals or not self.goals[0].deadline <= 0.0:
            raise InvalidValueError("goals", len(self.goals), "at least one goal, the first with deadline 0")
        numbers = [(name, getattr(self, name)) for name in ("position", "rotation", "trim", "velocity", "omega")]
        if self.path is not None:
            numbers += [("path", np.ravel(values)) for values in vars(self.path).values()]
        for name, values in numbers + [("goals", goal.joint_target) for goal in self.goals]:
            if values is not None and not (np.abs(values) <= START[name]).all():
                raise InvalidValueError(name, values.tolist(), f"finite numbers within ± {START[name]:.4g}")
        times = [goal.start for goal in self.goals]
        if not all(a <= b for a, b in pairwise(times)) or not all(g.start <= g.deadline < math.inf for g in self.goals):
            raise InvalidValueError("goals", times, "goals in order of time, no deadline before its start")

    @classmethod
    def parse(cls, values: "Mapping[str, Any] | FlightStart") -> "FlightStart":
        """From a dictionary of lists, as scenario files have it."""
        if isinstance(values, FlightStart):
            return values
        if not isinstance(values, Mapping):
            raise InvalidValueError("start", values, _START)
        require_keys("start", "key of start", values, START)
        rows, trim = values.get("goals"), values.get("trim")
        if not isinstance(rows, Sequence) or not all(isinstance(row, Sequence) and len(row) == 3 for row in rows):
            raise InvalidValueError("goals", rows, _START)
        goals = []
        for *times, q in rows:
            start, deadline = _numbers("goals", times, 2).tolist()
            goals.append(FormGoal(start, deadline, _numbers("goals", q, N_JOINTS)))
        return cls(
            tuple(goals),
            _numbers("position", values.get("position"), 3),
            _numbers("rotation", values.get("rotation"), 3),
            None if trim is None else _numbers("trim", trim, 6),
            _path(values.get("path")),
            *(_numbers(name, values.get(name, [0.0] * 3), 3) for name in ("velocity", "omega")),
        )


_START = (
    "{'goals': [[start s, deadline s, 16 angles], …], 'position': 3 m, 'rotation': 3 rad, 'trim': 6 or None, "
    "'path': [[s, x, y, z, yaw, their 4 rates, the rates' 4 rates], …] or None, 'velocity': 3 m/s or none, "
    "'omega': 3 rad/s or none}"
)


def _path(rows: object) -> Path | None:
    """From a list of knots."""
    if rows is None:
        return None
    array = require_array("path", rows, _START)
    if array.ndim != 2 or array.shape[1] != 13:
        raise InvalidValueError("path", rows, _START)
    return Path(array[:, 0], array[:, 1:5], array[:, 5:9], array[:, 9:])


def _numbers(name: str, value: object, size: int) -> np.ndarray:
    array = require_array(name, value, _START)
    if array.shape != (size,):
        raise InvalidValueError(name, value, _START)
    return array


WIDE = (-0.5, -0.2, -0.5, 0.0), (0.5, 0.8, 0.5, 1.4)
"""Least and largest angles of a leg's joints in drawn forms: yaw, pitch, yaw, pitch from the torso on [rad]."""
NARROW = (-0.25, 0.65, -0.15, 1.35), (0.25, 0.9, 0.15, 1.57)
"""The same near form ③, outer rotor under the inner one: every inner rotor blows on another."""
DRAWN_FORMS = {"equal": (WIDE, 1), "independent": (WIDE, N_LEGS), "narrow": (NARROW, N_LEGS)}
"""Angles, and how many legs are drawn: of one, all legs are alike, with a common twist of the yaw joints."""
SEQUENCES = ("paper", *FORMS, *DRAWN_FORMS, "mixed")
"""Valid form sequences."""


def _windows(value: object) -> tuple[tuple[float, float], ...]:
    """Windows of time as a tuple of pairs, whether they come as tuples or, from JSON, as lists."""
    windows = require_array("unrestricted", value, _WINDOWS)
    if windows.size == 0:
        return ()
    paired = windows.ndim == 2 and windows.shape[1] == 2
    if not (paired and np.isfinite(windows).all() and ((windows[:, 0] >= 0.0) & (windows[:, 0] < windows[:, 1])).all()):
        raise InvalidValueError("unrestricted", value, _WINDOWS)
    return tuple((start, end) for start, end in windows.tolist())


_WINDOWS = "pairs (start, end) of times [s], 0 ≤ start < end"


@dataclass(frozen=True)
class HoverTask:
    """Hold the CoG and a level attitude while the joints go through a sequence of forms."""

    forms: str = "mixed"
    """`paper` (① at once, ② from 4 s on, ③ without a stop), one of the forms held, `equal` legs with a common twist,
    `independent` legs with yaw, `narrow` ones near ③, or `mixed` (25 % paper forms, 30 % equal, 45 % independent)."""
    joint_speed: float = ROBOT.joint_speed
    """Speed of the joint motion [rad/s]."""
    horizon_s: float = 20.0
    """Length of an episode [s]; forms are drawn until then."""
    perturbation: float = 1.0
    """Scale of the initial offset: 1 is ± 3 cm and ± 0.05 rad per axis, at rest; 0 starts on the reference."""
    avoid_interference: bool = True
    """Whether rotors are restricted; False is the paper's baseline method."""
    unrestricted: Sequence[Sequence[float]] = ()
    """Windows of time `(start, end)` in which no rotor is restricted [s], as in the paper's flight."""
    altitude: float | None = None
    """Height of the CoG [m]; if not given, that which leaves the feet of form ③ half a metre above the floor."""

    def __post_init__(self) -> None:
        """Refuse what cannot be flown."""
        require_name("form sequence", self.forms, SEQUENCES)
        for name, bounds in RANGES.items():
            if name == "altitude" and self.altitude is None:
                continue
            require_within(*bounds, **{name: getattr(self, name)})
            object.__setattr__(self, name, float(getattr(self, name)))
        require_flag(avoid_interference=self.avoid_interference)
        object.__setattr__(self, "unrestricted", _windows(self.unrestricted))

    def mode(self, time: float) -> str:
        """Allocation mode at a time of the episode [s]."""
        restricted = self.avoid_interference and not any(start <= time < end for start, end in self.unrestricted)
        return "flight" if restricted else "flight_unrestricted"

    @cached_property
    def position_w(self) -> Vector3:
        """Desired position of the CoG [m]."""
        return np.array([0.0, 0.0, hover_height() if self.altitude is None else self.altitude])

    def schedule(self, rng: np.random.Generator) -> list[FormGoal]:
        """The episode's forms in order; the first one is the initial form, reached at time 0."""
        if self.forms in FORMS:
            return [FormGoal(0.0, 0.0, FORMS[self.forms])]
        if self.forms == "paper":
            goals = [FormGoal(0.0, 0.0, FORMS["form1"])]
            self._append(goals, 4.0, FORMS["form2"])
            self._append(goals, goals[-1].deadline, FORMS["form3"])
            return goals
        goals = [FormGoal(0.0, 0.0, self._sample(rng))]
        while (start := goals[-1].deadline + rng.uniform(1.0, 2.5)) < self.horizon_s:
            self._append(goals, start, self._sample(rng))
        return goals

    @property
    def most_knots(self) -> int:
        """How many knots a path of an episode can have."""
        return 0

    def draw_path(self, rng: np.random.Generator) -> Path | None:
        """Where the CoG goes in an episode; None where it stays."""
        del rng
        return None

    def _append(self, goals: list[FormGoal], start: float, target: JointVector) -> None:
        """Add a goal at the first tick from `start` on."""
        start = math.ceil(start * CONTROL_RATE - 1e-9) / CONTROL_RATE
        travel = float(np.abs(target - goals[-1].joint_target).max())
        goals.append(FormGoal(start, start + travel / self.joint_speed, target))

    def _sample(self, rng: np.random.Generator) -> JointVector:
        forms = self.forms
        if forms == "mixed":
            kind = rng.random()
            if kind < 0.25:
                return FORMS[f"form{rng.integers(1, 4)}"]
            forms = "equal" if kind < 0.55 else "independent"
        (least, most), legs = DRAWN_FORMS[forms]
        return np.tile(rng.uniform(np.tile(least, legs), np.tile(most, legs)), N_LEGS // legs)

    def offset(self, rng: np.random.Generator) -> tuple[Vector3, Vector3]:
        """Initial offset of the torso: position [m] and rotation vector [rad]."""
        unit = rng.uniform(-1.0, 1.0, 6) * self.perturbation
        return 0.03 * unit[:3], 0.05 * unit[3:]

    def reward_terms(
        self, position: Vector3, attitude: Vector3, joints: JointVector, action: np.ndarray
    ) -> dict[str, float]:
        """Terms in [0, 1]; the reward is their sum weighted with `REWARD_TERMS`.

        Args:
            position: CoG error [m].
            attitude: Attitude error [rad].
            joints: The schedule's plan − measured joint angles [rad].
            action: The action, in [−1, 1].
        """
        return {
            "position": tolerance(norm(position), MARGINS[0]),
            "attitude": tolerance(norm(attitude), MARGINS[1]),
            "joints": tolerance(float(np.abs(joints).max()), MARGINS[2]),
            "action": 1.0 - float(action @ action) / len(action),
        }

    def failed(self, position: Vector3, tilt: float, in_contact: bool) -> str:
        """Why the flight is over, empty while it goes on.

        Args:
            position: CoG error [m].
            tilt: Angle between the torso's z axis and the vertical [rad].
            in_contact: Whether the robot touches the floor.
        """
        if in_contact:
            return "contact"
        if tilt > MAX_TILT:
            return "tilt"
        return "position" if norm(position) > MAX_DISTANCE else ""


REWARD_TERMS = {
    "position": (0.4, "1 / (1 + (‖position error‖ / 0.02 m)²)"),
    "attitude": (0.4, "1 / (1 + (‖attitude error‖ / 0.03 rad)²)"),
    "joints": (0.1, "1 / (1 + (max |planned − measured joint angle| / 0.1 rad)²)"),
    "action": (0.1, "1 − mean a²"),
}
"""Weight and formula of the reward's terms; the weights add up to 1, so the reward lies in [0, 1] too."""
FAILURES = {
    "contact": "a part of the robot touches the floor",
    "tilt": f"the torso tilts by more than {MAX_TILT:g} rad",
    "position": f"the CoG is more than {MAX_DISTANCE:g} m from its reference",
    "diverged": "the simulation's state is no longer finite",
}
"""Words of `info["failure"]` and what they mean."""


@dataclass
class Progress:
    """How far an episode has come: RMS errors and arrivals; what `is_success` is made of."""

    goals: list[FormGoal]
    """The schedule."""
    ticks: int = 0
    """Ticks flown."""
    current: int = 0
    """Index of the goal that is the target now."""
    position_sum: float = 0.0
    """Sum of squared position errors [m²]."""
    attitude_sum: float = 0.0
    """Sum of squared attitude errors [rad²]."""
    reached: set[int] = field(default_factory=set)
    """Goals reached in time."""

    @classmethod
    def read(cls, record: Any, rows: np.ndarray, goals: list[FormGoal] | None = None) -> "Progress":  # noqa: ANN401 - an entry of a structured array
        """That of a robot in the engine.

        Args:
            record: `sp_hover`.
            rows: Its `sp_goal`.
            goals: They, if they are read already.
        """
        rows = rows[: int(record["goals"])]
        if goals is None:
            goals = [FormGoal(float(row["start"]), float(row["deadline"]), row["joint_target"].copy()) for row in rows]
        return cls(
            goals, int(record["flown"]), int(record["current"]), float(record["position_sum"]),
            float(record["attitude_sum"]), set(np.flatnonzero(rows["reached"]).tolist()),
        )  # fmt: skip

    @property
    def time(self) -> float:
        """Time flown [s]."""
        return self.ticks / CONTROL_RATE

    @property
    def goal(self) -> FormGoal:
        """The form to reach now."""
        return self.goals[self.current]

    @property
    def next_goal(self) -> FormGoal | None:
        """The form after it."""
        return self.goals[self.current + 1] if self.current + 1 < len(self.goals) else None

    def plan(self) -> JointVector:
        """Joint angles of the schedule now: straight lines from form to form [rad]."""
        goal = self.goal
        if self.current == 0 or self.time >= goal.deadline:
            return goal.joint_target
        start = self.goals[self.current - 1].joint_target
        return start + (self.time - goal.start) / (goal.deadline - goal.start) * (goal.joint_target - start)

    def advance(self, position: Vector3, attitude: Vector3, joints: JointVector) -> None:
        """Judge the tick that was counted last: its errors [m], [rad] and measured joint angles [rad]."""
        self.position_sum += float(position @ position)
        self.attitude_sum += float(attitude @ attitude)
        for i in range(max(0, self.current - 1), self.current + 1):
            goal = self.goals[i]
            in_time = goal.deadline <= self.time + 1e-9 <= goal.deadline + ARRIVAL_GRACE
            if in_time and np.abs(joints - goal.joint_target).max() <= ARRIVAL_TOLERANCE:
                self.reached.add(i)
        if (upcoming := self.next_goal) is not None and self.time >= upcoming.start - 1e-9:
            self.current += 1

    def overdue(self) -> set[int]:
        """Goals that were due by now and not reached in time."""
        due = {i for i, goal in enumerate(self.goals) if i > 0 and goal.deadline + ARRIVAL_GRACE <= self.time}
        return due - self.reached

    def succeeded(self, horizon: int) -> bool:
        """Whether the whole horizon [ticks] was flown, within the errors, with every due form reached in time."""
        if self.ticks < horizon:
            return False
        position, attitude = math.sqrt(self.position_sum / self.ticks), math.sqrt(self.attitude_sum / self.ticks)
        return position < SUCCESS_POSITION and attitude < SUCCESS_ATTITUDE and not self.overdue()
