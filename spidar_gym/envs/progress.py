"""How far the episode of a single robot has come: the engine's counts as dataclasses."""

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
    """How far a flight has come."""

    goals: tuple[FormGoal, ...]
    """The schedule."""
    ticks: int = 0
    """Ticks flown."""
    current: int = 0
    """Index of the goal that is the target now."""
    position_sum: float = 0.0
    """Sum of squared position errors [m²]."""
    attitude_sum: float = 0.0
    """Sum of squared attitude errors [rad²]."""
    reached: frozenset[int] = frozenset()
    """Goals reached in time."""

    @classmethod
    def read(cls, record: Any, rows: np.ndarray) -> "FlightProgress":  # noqa: ANN401 - an entry of a structured array
        """That of a robot in the engine.

        Args:
            record: `sp_hover_robot`.
            rows: Its `sp_goal`.
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
        """The form to reach now."""
        return self.goals[self.current]

    @property
    def next_goal(self) -> FormGoal | None:
        """The form after it."""
        return self.goals[self.current + 1] if self.current + 1 < len(self.goals) else None

    def plan(self) -> JointVector:
        """Joint angles of the schedule now: straight lines from form to form [rad]."""
        goal = self.goal
        if self.current == 0 or self.time >= goal.deadline or goal.deadline <= goal.start:
            return goal.joint_target
        start = self.goals[self.current - 1].joint_target
        return start + (self.time - goal.start) / (goal.deadline - goal.start) * (goal.joint_target - start)

    def overdue(self) -> set[int]:
        """Goals that were due by now and not reached in time."""
        due = {i for i, goal in enumerate(self.goals) if i > 0 and goal.deadline + ARRIVAL_GRACE <= self.time}
        return due - self.reached


@dataclass(frozen=True)
class CrawlProgress:
    """How far a crawl has come, and what it has cost."""

    goal: Pose2
    """Where to, world."""
    nominal_time: float
    """How long the preset's gait takes, servos perfect [s]."""
    error: Vector3
    """Goal − torso: x, y [m], world, and yaw [rad]."""
    initial_distance: float
    """Distance to the goal at the start, a radian counting `TURN_LENGTH` [m]."""
    distance: float
    """Distance to the goal now [m]."""
    crawled: int
    """Control periods."""
    finished: float
    """When the gait was done, or without one the robot had rested at the goal [s]; 0 before."""
    rested: int
    """Ticks, up to now, of resting at the goal; counted where there is no gait."""
    swing_ticks: np.ndarray
    """Ticks in which each leg swings (4,)."""
    airborne_ticks: np.ndarray
    """Ticks of these in which its foot was in the air (4,)."""
    foot_slip: np.ndarray
    """Way of each foot's touching point along the floor (4,) [m]."""
    peg_slip: np.ndarray
    """Way of the touching point of each of the torso's pegs along the floor (4,) [m]."""
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
    def read(cls, record: Any) -> "CrawlProgress":  # noqa: ANN401 - numpy's row
        """That of a robot in the engine, an `sp_crawl_robot`."""
        values: dict[str, Any] = {}
        for each in fields(cls):
            value = record[each.name]
            values[each.name] = value.copy() if value.ndim else value.item()
        own = {"goal": Pose2(*record["goal"].tolist()), "duct_contact": bool(record["duct_contact"])}
        return cls(**values | own)

    @property
    def ticks(self) -> int:
        """Control periods."""
        return self.crawled

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.crawled / CONTROL_RATE

    @property
    def airborne(self) -> float:
        """Share of its swing in which the worst foot was in the air; 1 before the first swing."""
        swung = self.swing_ticks > 0.0
        return float((self.airborne_ticks[swung] / self.swing_ticks[swung]).min(initial=1.0))


@dataclass(frozen=True)
class CourseProgress:
    """How far a course has come, and what it has cost."""

    goal: Pose2
    """Where to, world."""
    spent_wh: float
    """Energy that the battery lacks at the start [Wh]."""
    initial_distance: float
    """Distance to the goal at the start, a radian counting `TURN_LENGTH` [m]."""
    error: Vector3
    """Goal − torso: x, y [m], world, and yaw [rad]."""
    distance: float
    """Distance to the goal now [m]."""
    controls: int
    """Control periods."""
    arrived: float
    """Since when the robot lies at the goal [s]; 0 if it does not."""
    flown: int
    """Control periods with the weight on the rotors or on its way there: all but lying and crawling."""
    crawled: int
    """Control periods of crawling."""
    lies: bool
    """Whether it lies on the floor at rest."""
    hit: float
    """Largest force of the last step on anything but feet and pegs [N]."""
    most_hit: float
    """The same of the episode."""
    charge: float
    """What is left of the battery's usable energy, 0 … 1."""

    @classmethod
    def read(cls, record: Any) -> "CourseProgress":  # noqa: ANN401 - numpy's row
        """That of a robot in the engine, an `sp_course_robot`."""
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
