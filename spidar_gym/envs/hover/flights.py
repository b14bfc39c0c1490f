"""The hover task for many robots at once, in NumPy: derive from it for a task of your own that a vector flies.

`HoverTask` is the same page for one robot, `native/engine/hover.c` in C; a test holds the three to each other.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from spidar_gym.control.flight.observation import NO_NEXT_FORM
from spidar_gym.envs.batch import Robots, VectorTask, length, square, tolerance
from spidar_gym.envs.fleet import Fleet
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


class Flights(Robots):
    """What a task is told of N flights; its arrays have an entry for every robot, and are not to be written."""

    kind, counter = "hover", "flown"

    def __init__(self, fleet: Fleet, memory: np.ndarray, hover: HoverTask) -> None:
        """Look at them; `hover` has the options of the environment."""
        super().__init__(fleet, memory)
        self.hover, self.goals = hover, fleet.goals
        self._everybody = np.arange(len(self))

    def begin(self, task: "FlightTask", ids: np.ndarray) -> None:
        """Nothing is counted yet; the references are the task's."""
        for name in ("flown", "current", "position_sum", "attitude_sum"):
            self.robots[name][ids] = 0
        self.goals["reached"][ids] = 0
        self.robots["reference"][ids] = task.reference(self)[ids]
        self.robots["preview"][ids] = task.preview(self)[ids]
        self.fleet.regard(ids)

    def aim(self, task: "FlightTask") -> None:
        """The references of the next tick."""
        self.robots["reference"], self.robots["preview"] = task.reference(self), task.preview(self)

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


class FlightTask(VectorTask[Flights]):
    """Hold the CoG and a level attitude while the joints go through a sequence of forms: what a robot is to do."""

    robots = Flights
    reward_terms: Mapping[str, tuple[float, str]] = REWARD_TERMS
    """Weight and formula of each term; the weights add up to 1."""
    failures: Mapping[str, str] = FAILURES
    """Why an episode may be over, and what the words mean; `diverged` is the engine's own."""

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
        robots["position_sum"] += square(flights.position_error)
        robots["attitude_sum"] += square(flights.attitude_error)
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
            "action": 1.0 - square(action) / action.shape[1],
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
