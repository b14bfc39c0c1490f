"""The tasks in the air for many robots at once, in NumPy: derive from it for a task of your own that a vector flies.

`HoverTask` is the same page for one robot, `native/engine/hover.c` in C; a test holds the three to each other.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from spidar_gym.control.flight.observation import NO_NEXT_FORM
from spidar_gym.control.flight.path import AHEAD, AHEAD_STEP
from spidar_gym.envs.batch import Robots, VectorTask, checked_records, length, square, tolerance
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
    FlightStart,
    HoverTask,
)
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.structs import WORDS
from spidar_gym.robot import N_ROTORS
from spidar_gym.sim.disturbances import FAULTS

_MODES = WORDS["reference", "mode"]
UNIT = 1e-3
"""Within which the squared length of a quaternion has to be 1."""
_NUMBERS = np.arange(1, N_ROTORS + 1)


class Flights(Robots):
    """What a task is told of N flights; its arrays have an entry for every robot, and are not to be written."""

    kind, counter = "hover", "flown"

    def __init__(self, fleet: Fleet, memory: np.ndarray, hover: HoverTask) -> None:
        """Look at them; `hover` has the options of the environment."""
        super().__init__(fleet, memory)
        self.hover, self.goals, self.knots = hover, fleet.goals, fleet.knots
        self._everybody = np.arange(len(self))

    def begin(self, task: "FlightTask", ids: np.ndarray) -> None:
        """Nothing is counted yet; the references are the task's."""
        for name in ("flown", "current", "position_sum", "attitude_sum"):
            self.robots[name][ids] = 0
        self.goals["reached"][ids] = 0
        self.robots["reference"][ids] = self._reference(task)[ids]
        self.robots["preview"][ids] = self._preview(task)[ids]
        self.fleet.regard(ids)

    def look(self, task: "FlightTask") -> None:
        """The errors of now, where references move: against what the robots are to do now, not a tick ago."""
        if not (self.knots.shape[1] or type(task).reference is not FlightTask.reference):
            return
        self.robots["reference"] = self._reference(task)
        now = np.flatnonzero((self.robots["plant"]["diverged"] == 0) & ~self.fleet.begun)
        if now.size:
            self.fleet.regard(now)

    def aim(self, task: "FlightTask") -> None:
        """The references of the next tick."""
        self.robots["reference"], self.robots["preview"] = self._reference(task), self._preview(task)

    def _reference(self, task: "FlightTask") -> np.ndarray:
        name, robots = f"{type(task).__name__}.reference", self.robots
        wanted = checked_records(name, task.reference(self), robots["reference"], robots)
        if not ((wanted["mode"] >= 0) & (wanted["mode"] < len(_MODES))).all():
            raise InvalidValueError(f"{name}: mode", wanted["mode"].tolist(), f"numbers within 0 … {len(_MODES) - 1}")
        lengths = square(wanted["quat_wb"])
        off = ~(np.abs(lengths - 1.0) < UNIT) & (robots["plant"]["diverged"] == 0)
        if off.any():
            k = int(np.flatnonzero(off)[0])
            raise InvalidValueError(
                f"{name}: quat_wb", wanted["quat_wb"][k].tolist(), f"a unit quaternion for robot {k}"
            )
        return wanted

    def _preview(self, task: "FlightTask") -> np.ndarray:
        given = task.preview(self)
        return checked_records(f"{type(task).__name__}.preview", given, self.robots["preview"], self.robots)

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
        """Attitude error against the reference, torso axes (N, 3) [rad]."""
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

    def path_at(self, later: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pose (x, y, z, heading), rate and acceleration of the paths so much later than now, (N, 4) each [m], [rad].

        Where there is no path they are 0.
        """
        knots, count, time = self.knots, self.robots["knots"], self.time + later
        if not knots.shape[1]:
            zero = np.zeros((len(self), 4))
            return zero, zero, zero
        is_one = np.arange(knots.shape[1]) < count[:, None]
        first = (is_one & (knots["time"] <= time[:, None])).sum(axis=1) - 1
        moves = (first >= 0) & (first + 1 < count)
        a = knots[self._everybody, np.clip(first, 0, np.maximum(count - 1, 0))]
        b = knots[self._everybody, np.clip(first + 1, 0, knots.shape[1] - 1)]
        T = np.where(moves, b["time"] - a["time"], 1.0)[:, None]
        u = np.where(moves, time - a["time"], 0.0)[:, None] / T
        c0, c1, c2 = a["pose_w"], T * a["rate_w"], 0.5 * T * T * a["acceleration_w"]
        d = b["pose_w"] - (c0 + c1 + c2)
        e = T * b["rate_w"] - (c1 + 2.0 * c2)
        f = T * T * b["acceleration_w"] - 2.0 * c2
        c3, c4, c5 = 10.0 * d - 4.0 * e + 0.5 * f, -15.0 * d + 7.0 * e - f, 6.0 * d - 3.0 * e + 0.5 * f
        pose = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        rate = (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / T
        acceleration = (2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (T * T)
        still = ~moves[:, None]
        pose = np.where(still, np.where(count[:, None] > 0, c0, 0.0), pose)
        return pose, np.where(still, 0.0, rate), np.where(still, 0.0, acceleration)

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
    """Hold the CoG, or follow a path, level, while the joints go through a sequence of forms: what a robot is to do."""

    robots = Flights
    reward_terms: Mapping[str, tuple[float, str]] = REWARD_TERMS
    """Weight and formula of each term; the weights add up to 1."""
    failures: Mapping[str, str] = FAILURES
    """Why an episode may be over, and what the words mean; `diverged` is the engine's own."""

    def start(self, rng: np.random.Generator, hover: HoverTask) -> FlightStart | None:
        """What an episode of one robot begins with and goes through; None has the environment draw it.

        Args:
            rng: The episode's generator.
            hover: The environment's own task, which draws forms (`schedule`), offsets (`offset`) and paths.
        """
        del rng, hover
        return None

    def reference(self, flights: Flights) -> np.ndarray:
        """What the controllers are to do in the next tick: records of `Reference`'s fields, the modes by number.

        It is the level hover, or the path, with the schedule's form, and the fault that the controller is told; change
        what differs.
        """
        hover, time = flights.hover, flights.time
        wanted = np.zeros(len(flights), core_layouts()["reference"])
        wanted["position_w"], wanted["quat_wb"][:, 0] = hover.position_w, 1.0
        moved = flights.robots["knots"] > 0
        if moved.any():
            pose, rate, acceleration = (values[moved] for values in flights.path_at())
            for name, values in (("position_w", pose), ("velocity_w", rate), ("acceleration_w", acceleration)):
                wanted[name][moved] = values[:, :3]
            half = 0.5 * pose[:, 3]
            wanted["quat_wb"][moved] = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=1)
            wanted["omega_b"][moved, 2], wanted["alpha_b"][moved, 2] = rate[:, 3], acceleration[:, 3]
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
        if flights.knots.shape[1]:
            pose, rate, acceleration = flights.path_at()
            ahead = [flights.path_at(AHEAD_STEP * (k + 1))[0] - pose for k in range(AHEAD)]
            told["ahead_w"] = np.concatenate([each[:, :3] for each in ahead], axis=1)
            told["turn"] = np.stack([each[:, 3] for each in ahead], axis=1)
            told["velocity_w"], told["acceleration_w"] = rate[:, :3], acceleration[:, :3]
        return told

    def advance(self, flights: Flights) -> None:
        """Judge a tick; a task with a memory of its own writes it here, after `super().advance(flights)`."""
        robots, goals, angles = flights.robots, flights.goals, flights.state["joint_position"]
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
