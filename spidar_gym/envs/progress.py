"""Progress of a single robot's episode: the engine's counters as dataclasses."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.tasks.hover import ARRIVAL_GRACE
from spidar_gym.tasks.start import FormGoal, read_goals


@dataclass(frozen=True)
class FlightProgress:
    """Progress of a flight."""

    goals: tuple[FormGoal, ...]
    """Scheduled forms."""
    ticks: int = 0
    """Ticks flown."""
    current: int = 0
    """Index of the current target form."""
    position_sum: float = 0.0
    """Sum of squared position errors [m²]."""
    attitude_sum: float = 0.0
    """Sum of squared attitude errors [rad²]."""
    reached: frozenset[int] = frozenset()
    """Indices of forms reached in time."""

    @classmethod
    def read(cls, record: Any, rows: np.ndarray) -> "FlightProgress":  # noqa: ANN401 - an entry of a structured array
        """Read the progress of a robot in the engine.

        Args:
            record: The robot's `sp_hover_robot`.
            rows: The robot's `sp_goal` records.
        """
        rows = rows[: int(record["goals"])]
        return cls(
            read_goals(rows), int(record["flown"]), int(record["current"]), float(record["position_sum"]),
            float(record["attitude_sum"]), frozenset(np.flatnonzero(rows["reached"]).tolist()),
        )  # fmt: skip

    @property
    def time(self) -> float:
        """Time flown [s]."""
        return self.ticks / CONTROL_RATE

    @property
    def goal(self) -> FormGoal:
        """The current target form."""
        return self.goals[self.current]

    @property
    def next_goal(self) -> FormGoal | None:
        """The next target form, or None."""
        return self.goals[self.current + 1] if self.current + 1 < len(self.goals) else None

    def plan(self) -> JointVector:
        """Return the joint angles planned for now, interpolated linearly between forms [rad]."""
        goal = self.goal
        if self.current == 0 or self.time >= goal.deadline or goal.deadline <= goal.start:
            return goal.joint_target
        start = self.goals[self.current - 1].joint_target
        return start + (self.time - goal.start) / (goal.deadline - goal.start) * (goal.joint_target - start)

    def overdue(self) -> set[int]:
        """Return the indices of forms that were due and not reached in time."""
        due = {i for i, goal in enumerate(self.goals) if i > 0 and goal.deadline + ARRIVAL_GRACE <= self.time}
        return due - self.reached


@dataclass(frozen=True)
class CrawlProgress:
    """Progress of a crawl, and its slip, saturation and thrust."""

    goal: Pose2
    """Goal of the torso, world."""
    nominal_time: float
    """Time that the preset's gait takes with ideal servos [s]."""
    error: Vector3
    """Goal − torso: x, y [m], world, and yaw [rad]."""
    initial_distance: float
    """Distance to the goal at the start, a radian counting `TURN_LENGTH` [m]."""
    distance: float
    """Distance to the goal now [m]."""
    crawled: int
    """Control periods since the start."""
    finished: float
    """Time at which the gait was complete or, without a gait, the robot had rested at the goal [s]; 0 before."""
    rested: int
    """Consecutive ticks of rest at the goal; counted only without a gait."""
    swing_ticks: np.ndarray
    """Ticks in which each leg swings (4,)."""
    airborne_ticks: np.ndarray
    """Ticks of each leg's swing in which its foot was in the air (4,)."""
    foot_slip: np.ndarray
    """Distance that each foot has slid along the floor (4,) [m]."""
    peg_slip: np.ndarray
    """Distance that each of the torso's pegs has slid along the floor (4,) [m]."""
    duct_clearance: float
    """Least height of a duct over the floor so far [m]."""
    duct_contact: bool
    """Whether a duct has touched the floor."""
    saturation: float
    """Sum over ticks of the share of saturated joints."""
    thrust: float
    """Sum over ticks of the commanded thrust over the weight."""
    thrust_peak: float
    """Largest commanded thrust over the weight."""
    timeouts: int
    """Phases that ended by time-out."""
    tilt_legs: float
    """Largest tilt while the legs are lifted [rad]."""
    tilt_torso: float
    """Largest tilt while the torso moves [rad]."""

    @classmethod
    def read(cls, record: Any) -> "CrawlProgress":  # noqa: ANN401 - a NumPy record
        """Read the progress of a robot in the engine, an `sp_crawl_robot`."""
        values: dict[str, Any] = {}
        for each in fields(cls):
            value = record[each.name]
            values[each.name] = value.copy() if value.ndim else value.item()
        own = {"goal": Pose2(*record["goal"].tolist()), "duct_contact": bool(record["duct_contact"])}
        return cls(**values | own)

    @property
    def ticks(self) -> int:
        """Control periods since the start."""
        return self.crawled

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.crawled / CONTROL_RATE

    @property
    def airborne(self) -> float:
        """Share of its swing that the worst foot was in the air; 1 before the first swing."""
        swung = self.swing_ticks > 0.0
        return float((self.airborne_ticks[swung] / self.swing_ticks[swung]).min(initial=1.0))


@dataclass(frozen=True)
class CourseProgress:
    """Progress of a course, and its energy and contact forces."""

    goal: Pose2
    """Goal of the torso, world."""
    spent_wh: float
    """Energy missing from a full battery at the start [Wh]."""
    initial_distance: float
    """Distance to the goal at the start, a radian counting `TURN_LENGTH` [m]."""
    error: Vector3
    """Goal − torso: x, y [m], world, and yaw [rad]."""
    distance: float
    """Distance to the goal now [m]."""
    controls: int
    """Control periods since the start."""
    arrived: float
    """Time since which the robot lies at the goal [s]; 0 if it does not."""
    flown: int
    """Control periods in all phases but lying and crawling."""
    crawled: int
    """Control periods of crawling."""
    lies: bool
    """Whether the robot lies on the floor at rest."""
    hit: float
    """Largest force of the last step on parts other than feet and pegs [N]."""
    most_hit: float
    """Largest force of the episode on parts other than feet and pegs [N]."""
    charge: float
    """Share of the battery's usable energy that is left, 0 … 1."""

    @classmethod
    def read(cls, record: Any) -> "CourseProgress":  # noqa: ANN401 - a NumPy record
        """Read the progress of a robot in the engine, an `sp_course_robot`."""
        names = ("initial_distance", "distance", "controls", "arrived", "flown", "crawled", "hit", "most_hit", "charge")
        values = {name: record[name].item() for name in names}
        goal, spent = Pose2(*record["course"]["goal"].tolist()), record["plant"]["spent_wh"].item()
        return cls(goal, spent, **values, error=record["error"].copy(), lies=bool(record["lies"]))

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


@dataclass(frozen=True)
class GraspProgress:
    """Progress of a grasp."""

    controls: int
    """Control periods since the start."""
    initial_way: float
    """Distance of the object to its place at the goal at the start, a radian counting 0.5 m [m]."""
    arrived: float
    """Time since which the object is delivered [s]; 0 if it is not."""
    most_force: float
    """Largest force of a foot, a mean over a tenth of a second [N]."""
    bears: float
    """Force that a foot may press the object with [N]."""
    most_lifted: float
    """Largest height of the object over its stand at the start [m]."""
    fall: float
    """Largest speed at which it has fallen [m/s]."""
    charge: float
    """Share of the battery's usable energy that is left, 0 … 1."""
    tries: int
    """Number of times that the rule has begun to grasp."""

    @classmethod
    def read(cls, record: Any) -> "GraspProgress":  # noqa: ANN401 - a NumPy record
        """Read the progress of a robot in the engine, an `sp_grasp_robot`."""
        names = ("controls", "initial_way", "arrived", "most_force", "most_lifted", "fall", "charge")
        bears, tries = record["scene"]["most_force"].item(), int(record["rule"]["tries"])
        return cls(**{name: record[name].item() for name in names}, bears=bears, tries=tries)

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.controls / CONTROL_RATE


AnyProgress = FlightProgress | CrawlProgress | CourseProgress | GraspProgress
PROGRESS: dict[str, type[CrawlProgress] | type[CourseProgress] | type[GraspProgress]] = {
    "crawl": CrawlProgress, "course": CourseProgress, "grasp": GraspProgress,
}  # fmt: skip
"""Progress by the kind of robots in the engine, for those without a schedule of forms."""
