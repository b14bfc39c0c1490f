"""The hover task for many robots at once, in NumPy: derive from it for a task of your own that a vector flies.

`HoverTask` is the same page for one robot, `native/engine/hover.c` in C; a test holds the three to each other.
"""

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import NO_NEXT_FORM
from spidar_gym.envs.hover.task import (
    ARRIVAL_GRACE,
    ARRIVAL_TOLERANCE,
    FAILURES,
    MARGINS,
    MAX_DISTANCE,
    MAX_TILT,
    REWARD_TERMS,
    SUCCESS_ATTITUDE,
    SUCCESS_POSITION,
    HoverTask,
)
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.structs import WORDS
from spidar_gym.robot import N_ROTORS
from spidar_gym.sim.disturbances import FAULTS

_MODES = WORDS["reference", "mode"]
_NUMBERS = np.arange(1, N_ROTORS + 1)


class Flights:
    """What a task is told of N robots; its arrays have an entry for every robot, and are not to be written."""

    def __init__(
        self, robots: np.ndarray, goals: np.ndarray, memory: np.ndarray, hover: HoverTask, horizon: int, size: int
    ) -> None:
        """Look at them.

        Args:
            robots: Records of `sp_hover`.
            goals: Their forms, (N, most that an episode has).
            memory: What the task keeps of them.
            hover: Options of the environment.
            horizon: Ticks of an episode.
            size: Numbers of an action.
        """
        self.robots, self.goals, self.memory = robots, goals, memory
        self.hover, self.horizon, self._size = hover, horizon, size
        self._everybody = np.arange(len(robots))

    def __len__(self) -> int:
        """How many."""
        return len(self.robots)

    @property
    def ticks(self) -> np.ndarray:
        """Ticks flown (N,)."""
        return self.robots["flown"]

    @property
    def time(self) -> np.ndarray:
        """Time flown (N,) [s]."""
        return self.robots["flown"] / CONTROL_RATE

    @cached_property
    def state(self) -> np.ndarray:
        """True states, records of `RobotState`'s fields, arrays in it flat: `state["position_w"]` is (N, 3) [m]."""
        return self.robots["plant"]["state"]

    @cached_property
    def error(self) -> np.ndarray:
        """True errors against the reference: `position_w`, `velocity_w`, `attitude`, `omega_b`, each (N, 3)."""
        return self.robots["truth"]["error"]

    @cached_property
    def position_error(self) -> np.ndarray:
        """Position error of the CoG, world (N, 3) [m]."""
        return self.robots["position_error"]

    @cached_property
    def attitude_error(self) -> np.ndarray:
        """Attitude error against level, torso axes (N, 3) [rad]."""
        return self.robots["attitude_error"]

    @property
    def tilt(self) -> np.ndarray:
        """Angle between the torso's z axis and the vertical (N,) [rad]."""
        return np.arccos(np.clip(self.robots["truth"]["R_wb"][:, 8], -1.0, 1.0))

    @property
    def in_contact(self) -> np.ndarray:
        """Whether a part of the robot touches the floor (N,)."""
        return self.robots["plant"]["in_contact"] != 0

    @property
    def action(self) -> np.ndarray:
        """Last actions, in [−1, 1], (N, size of an action)."""
        return self.robots["episode"]["action"][:, : self._size]

    @property
    def goal(self) -> np.ndarray:
        """Forms to take now: records of `start`, `deadline` [s], `joint_target` (N, 16) [rad]."""
        return self.goals[self._everybody, self.robots["current"]]

    @property
    def has_next(self) -> np.ndarray:
        """Whether a form comes after it (N,)."""
        return self.robots["current"] + 1 < self.robots["goals"]

    @property
    def next_goal(self) -> np.ndarray:
        """Forms after it, the same where there is none."""
        return self.goals[self._everybody, self.robots["current"] + self.has_next]

    def plan(self) -> np.ndarray:
        """Joint angles of the schedule now: straight lines from form to form (N, 16) [rad]."""
        goal, time = self.goal, self.time
        q = goal["joint_target"].copy()
        moving = np.flatnonzero((self.robots["current"] > 0) & (time < goal["deadline"]))
        if moving.size:
            goal = goal[moving]
            start = self.goals[moving, self.robots["current"][moving] - 1]["joint_target"]
            share = (time[moving] - goal["start"]) / (goal["deadline"] - goal["start"])
            q[moving] = start + share[:, None] * (goal["joint_target"] - start)
        return q


class FlightTask:
    """Hold the CoG and a level attitude while the joints go through a sequence of forms: what a robot is to do.

    Each method is called once a tick for all robots. What one robot gets may not depend on the others: no products of
    matrices over robots, no draws but those of `draw`.
    """

    reward_terms: Mapping[str, tuple[float, str]] = REWARD_TERMS
    """Weight and formula of each term; the weights add up to 1."""
    failures: Mapping[str, str] = FAILURES
    """Why an episode may be over, and what the words mean; `diverged` is the engine's own."""
    memory: tuple[tuple[Any, ...], ...] = ()
    """What the task keeps of a robot, as numpy has it: name, kind, shape; zero when an episode begins."""

    def draw(self, rng: np.random.Generator) -> Mapping[str, Any]:
        """Numbers of the memory that an episode begins with, drawn after all that the environment draws."""
        del rng
        return {}

    def reference(self, flights: Flights) -> np.ndarray:
        """What the controllers are to do in the next tick: records of `Reference`'s fields, the modes by number.

        It is the level hover with the schedule's form, and the fault that the controller is told; change what differs.
        """
        hover, time = flights.hover, flights.time
        wanted = np.zeros(len(flights), core_layouts()["reference"])
        wanted["position_w"], wanted["quat_wb"][:, 0] = hover.position_w, 1.0
        wanted["joint_target"] = flights.goal["joint_target"]
        free = np.full(len(flights), not hover.avoid_interference)
        for start, end in hover.unrestricted:
            free |= (start <= time) & (time < end)
        wanted["mode"] = np.where(free, _MODES.index("flight_unrestricted"), _MODES.index("flight"))
        fault = flights.robots["episode"]["disturbances"]
        rotor = np.where(time >= fault["fault_time"] - 1e-9, fault["lost_rotor"], 0)
        if rotor.any():
            for name in FAULTS:
                lost = np.where(fault["fault"] == FAULTS.index(name), rotor, 0)
                wanted[f"lost_{name}"] = lost[:, None] == _NUMBERS
        return wanted

    def preview(self, flights: Flights) -> np.ndarray:
        """What a policy is told of the schedule: records of `joint_target`, `next_form` [rad], `time_to_next` [s]."""
        told = np.zeros(len(flights), core_layouts()["preview"])
        told["joint_target"], upcoming = flights.goal["joint_target"], flights.next_goal
        told["next_form"] = upcoming["joint_target"]
        told["time_to_next"] = np.where(flights.has_next, upcoming["start"] - flights.time, NO_NEXT_FORM)
        return told

    def advance(self, flights: Flights) -> None:
        """Count a tick; a task with a memory of its own writes it here, after `super().advance(flights)`."""
        robots, goals, angles = flights.robots, flights.goals, flights.state["joint_position"]
        robots["flown"] += 1
        robots["position_sum"] += _square(flights.position_error)
        robots["attitude_sum"] += _square(flights.attitude_error)
        time, current, everybody = flights.time, robots["current"], np.arange(len(flights))
        for i in (np.maximum(current - 1, 0), current):
            goal = goals[everybody, i]
            due = (goal["deadline"] <= time + 1e-9) & (time + 1e-9 <= goal["deadline"] + ARRIVAL_GRACE)
            if due.any():
                reached = due & (np.abs(angles - goal["joint_target"]).max(axis=1) <= ARRIVAL_TOLERANCE)
                goals["reached"][everybody, i] |= reached
        robots["current"] += flights.has_next & (time >= flights.next_goal["start"] - 1e-9)

    def terms(self, flights: Flights) -> Mapping[str, np.ndarray]:
        """Terms of the reward (N,) in [0, 1]; the reward is their sum weighted with `reward_terms`."""
        joints = np.abs(flights.plan() - flights.state["joint_position"]).max(axis=1)
        action = flights.action
        return {
            "position": tolerance(length(flights.position_error), MARGINS[0]),
            "attitude": tolerance(length(flights.attitude_error), MARGINS[1]),
            "joints": tolerance(joints, MARGINS[2]),
            "action": 1.0 - _square(action) / action.shape[1],
        }

    def failed(self, flights: Flights) -> Mapping[str, np.ndarray]:
        """Whose episode is over why (N,), by word; the first that holds counts."""
        return {
            "contact": flights.in_contact,
            "tilt": flights.tilt > MAX_TILT,
            "position": length(flights.position_error) > MAX_DISTANCE,
        }

    def succeeded(self, flights: Flights) -> np.ndarray:
        """Who has flown the horizon within the errors, with every due form reached in time (N,)."""
        robots, goals = flights.robots, flights.goals
        ticks = np.maximum(flights.ticks, 1)
        done = flights.ticks >= flights.horizon
        if not done.any():
            return done
        is_one = np.arange(goals.shape[1]) < robots["goals"][:, None]
        overdue = is_one & (goals["deadline"] + ARRIVAL_GRACE <= flights.time[:, None]) & (goals["reached"] == 0)
        within = np.sqrt(robots["position_sum"] / ticks) < SUCCESS_POSITION
        within &= np.sqrt(robots["attitude_sum"] / ticks) < SUCCESS_ATTITUDE
        return done & within & ~overdue[:, 1:].any(axis=1)


def length(v: np.ndarray) -> np.ndarray:
    """Euclidean lengths of vectors (N, …): (N,)."""
    return np.sqrt(_square(v))


def tolerance(error: np.ndarray, margin: float) -> np.ndarray:
    """1 at no error, ½ at `margin`, falling towards 0: 1 / (1 + (error / margin)²)."""
    ratio = error / margin
    return 1.0 / (1.0 + ratio * ratio)


def _square(v: np.ndarray) -> np.ndarray:
    """Squared lengths, each summed in the same order however many there are."""
    return np.square(v, order="C").sum(axis=1)


def weighted(terms: np.ndarray, weights: list[float]) -> np.ndarray:
    """Sum of terms (N, k) with their weights, in order: (N,)."""
    return sum((weight * terms[:, k] for k, weight in enumerate(weights)), start=np.zeros(len(terms)))


def check_weights(task: FlightTask) -> bool:
    """Whether the weights add up to 1."""
    return math.isclose(sum(weight for weight, _ in task.reward_terms.values()), 1.0)
