"""The start of a flight: initial state, forms and path of an episode, from a user or sampled by the engine."""

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector, Vector3, Wrench, constant
from spidar_gym.control.flight.path import Path
from spidar_gym.errors import InvalidValueError, require_array, require_keys
from spidar_gym.native.draws import from_numpy, take_back
from spidar_gym.native.engine_structs import SEQUENCES, engine_layouts
from spidar_gym.native.library import load_core, pointer
from spidar_gym.robot import N_JOINTS

START = {
    "goals": math.pi, "position": 10.0, "rotation": 2.0 * math.pi, "trim": 1e3, "path": 1e4, "velocity": 20.0,
    "omega": 50.0,
}  # fmt: skip
"""Allowed keys of `start` and the limit of each [rad, m, rad, N or Nm, -, m/s, rad/s]."""


@dataclass(frozen=True)
class FormGoal:
    """A target form with its start and its deadline."""

    start: float
    """Time at which it becomes the target [s]."""
    deadline: float
    """Time at which the last joint arrives, moving at the joint speed [s]."""
    joint_target: JointVector
    """Joint angles q [rad]."""


@dataclass(frozen=True)
class FlightStart:
    """Initial state, forms and path of an episode, in place of sampled ones."""

    goals: tuple[FormGoal, ...]
    """Forms in order; the first is the initial form, reached at time 0."""
    position: Vector3
    """Offset of the torso from its reference position [m]."""
    rotation: Vector3
    """Offset of the torso's attitude, a rotation vector [rad]."""
    trim: Wrench | None = None
    """Initial integrals: the wrench that a hover needs beyond the nominal one [N, Nm]; computed if None."""
    path: Path | None = None
    """Path of the CoG; none if None."""
    velocity: Vector3 = field(default_factory=lambda: constant(0.0, 3))
    """Initial velocity of the CoG, world [m/s]."""
    omega: Vector3 = field(default_factory=lambda: constant(0.0, 3))
    """Initial angular velocity of the torso, torso axes [rad/s]; legs and rotors are at rest."""

    def __post_init__(self) -> None:
        """Validate the fields."""
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
        """Read a start from a dictionary of lists, the format of scenario files."""
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
    """Read a path from a list of knots."""
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


def draw_start(task: Any, rng: np.random.Generator) -> FlightStart:  # noqa: ANN401 - a `HoverTask` or one derived from it
    """Sample the forms, offset and path of an episode as the engine does, advancing `rng` as the engine does."""
    layouts, generator = engine_layouts(), from_numpy(rng)
    rules, start = np.zeros((), layouts["hover_rules"]), np.zeros((), layouts["flight_start"])
    task.write(rules)
    goals, knots = np.zeros(task.most_goals, layouts["goal"]), np.zeros(task.most_knots, layouts["knot"])
    load_core().sp_draw_flight(
        pointer(rules), ctypes.c_int32(SEQUENCES.index(task.forms)), pointer(generator),
        pointer(goals), ctypes.c_int64(len(goals)), pointer(knots), ctypes.c_int64(len(knots)), pointer(start),
    )  # fmt: skip
    take_back(rng, generator)
    return FlightStart(
        read_goals(goals[: start["goals"]]), start["position"].copy(), start["rotation"].copy(),
        path=read_path(knots[: start["knots"]]),
    )  # fmt: skip


def read_goals(records: np.ndarray) -> tuple[FormGoal, ...]:
    """Read forms from records of `sp_goal`."""
    return tuple(FormGoal(float(row["start"]), float(row["deadline"]), row["joint_target"].copy()) for row in records)


def read_path(knots: np.ndarray) -> Path | None:
    """Read a path from records of `sp_knot`; None if there are none."""
    if not len(knots):
        return None
    return Path(*(knots[name].copy() for name in ("time", "pose_w", "rate_w", "acceleration_w")))
