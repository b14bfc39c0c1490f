"""Observations: a flat vector, a dictionary with goals, or one with privileged values; the goal's reward."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from spidar_gym.control.flight.observation import Field
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.goals import REWARDS, Goal
from spidar_gym.envs.locking import in_turn
from spidar_gym.envs.view import View
from spidar_gym.errors import InvalidValueError, NoGoalError, closed, require_name
from spidar_gym.native.engine_structs import N_DUCTS, engine_layouts
from spidar_gym.native.plant import Plant
from spidar_gym.robot import N_JOINTS, N_ROTORS, RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import FAULTS
from spidar_gym.sim.energy import CAPACITY_WH, USABLE
from spidar_gym.sim.rows import TABLE, Row

OBSERVATIONS = {
    "vector": "one vector of values available on the real robot",
    "scaled": "the vector, each field divided by the usual size of its values",
    "goal": "the vector without the goal, and the achieved and desired goals, for hindsight experience replay (HER)",
    "asymmetric": "the vector, and privileged values for a critic or a teacher",
}
"""Kinds of observations by name, with their contents."""
MOST = 5.0
"""Limit to which privileged values are clipped; most are within ± 1."""
_READ: tuple[tuple[str, Field], ...] = (
    ("state.position_w", Field("position", 3, 10.0, "m", "of the torso, world")),
    ("state.omega_b", Field("angular_velocity", 3, 10.0, "rad/s", "torso axes")),
    ("state.joint_position", Field("joint_position", N_JOINTS, 2.0, "rad", "q")),
    ("state.joint_velocity", Field("joint_velocity", N_JOINTS, 5.0, "rad/s", "q̇")),
    ("state.joint_torque", Field("joint_torque", N_JOINTS, 10.0, "Nm", "of the joint servos")),
    ("state.thrust", Field("thrust", N_ROTORS, RobotSpec.max_thrust, "N", "λ₁ … λ₈ delivered")),
    ("air_factor", Field("duct_thrust", N_DUCTS, 1.0, "", "thrust of each duct over its thrust in still air")),
    ("air_force_w", Field("air_force", 3, 50.0, "N", "of the air besides the thrust in still air, world")),
    ("weather.mean_w", Field("wind", 3, 10.0, "m/s", "mean, world")),
    ("weather.gust_w", Field("gust", 3, 5.0, "m/s", "turbulence, world")),
    ("weather.push_w", Field("push", 3, 50.0, "N", "current push, world")),
    ("clearance", Field("clearance", 1, 2.0, "m", "least height of everything over the highest tile; 0 on a course")),
)
"""Privileged values that are read from the simulated robot: member of `sp_plant` and field."""
_COMPUTED = (
    Field("up", 3, 1.0, "", "vertical, torso axes"),
    Field("heading", 2, 1.0, "", "sine and cosine of the torso's yaw"),
    Field("velocity", 3, 5.0, "m/s", "of the torso, torso axes"),
    Field("vectoring_sine", 2 * N_ROTORS, 1.0, "", "sine of φ₁, θ₁, φ₂, θ₂ …"),
    Field("vectoring_cosine", 2 * N_ROTORS, 1.0, "", "cosine of φ₁, θ₁, φ₂, θ₂ …"),
    Field("charge", 1, 1.0, "", "of the battery's usable energy"),
    Field("in_contact", 1, 1.0, "", "1 where a part of the robot touches something"),
    Field("lost_thrust", N_ROTORS, 1.0, "", "1 for a module that has lost its thrust"),
    Field("lost_vectoring", N_ROTORS, 1.0, "", "1 for a module whose vectoring servos are stuck"),
)
"""Privileged values that are computed."""
_MODULES = np.arange(1, N_ROTORS + 1)


def privileged_layout(told: Sequence[Field]) -> tuple[Field, ...]:
    """Return the layout of `privileged`; each number is the value over its scale, which is the field's `bound`.

    Args:
        told: Fields that are read from `info`, by name.
    """
    return (*(f for _, f in _READ), *_COMPUTED, *told, *(_drawn_field(row) for row in TABLE))


def _drawn_field(row: Row) -> Field:
    """Return the field of a parameter that can be randomised: its deviation from the middle of its range."""
    what = {"set": "", "scale": " over nominal", "add": " less nominal"}[row.operation]
    middle, half = 0.5 * (row.low + row.high), 0.5 * (row.high - row.low)
    less = f" less {middle:.4g}" if middle else ""
    return Field(row.field, math.prod(row.shape), half, row.unit, f"as simulated{what}{less}")


@dataclass(frozen=True)
class ShownRobots:
    """Data of robots from which observations are built."""

    records: np.ndarray
    """Records of the robots (N,); each begins with an `sp_plant`."""
    told: Callable[[str], np.ndarray]
    """The robots' `info` by name."""
    wanted: np.ndarray | None = None
    """Desired goals (N, size), or None."""

    @property
    def plants(self) -> np.ndarray:
        """Records of `sp_plant`."""
        return self.records["plant"] if "plant" in (self.records.dtype.names or ()) else self.records


class Sight(ABC):
    """Observation that replaces the flat vector."""

    space: spaces.Dict
    """Space of one robot's observation."""

    @abstractmethod
    def look(self, flat: np.ndarray, robots: ShownRobots) -> dict[str, np.ndarray]:
        """Return the parts of the observation, with a row for every robot.

        Args:
            flat: Flat observations (N, size).
            robots: Data of the robots.
        """


class GoalSight(Sight):
    """Observation with goals as in `gymnasium_robotics`: `observation`, `achieved_goal`, `desired_goal`."""

    def __init__(self, flat: spaces.Box, layout: Sequence[Field], goal: Goal) -> None:
        """Build the space from the flat vector's space and layout and the goal."""
        shown = np.concatenate([np.full(f.size, f.name not in goal.left_out) for f in layout])
        self._shown = np.flatnonzero(shown)
        high = np.concatenate([np.full(f.size, f.bound, np.float32) for f in goal.fields])
        self._high = high
        low, most = flat.low[self._shown], flat.high[self._shown]
        self.space = spaces.Dict(
            {
                "observation": spaces.Box(low, most, dtype=np.float32),
                "achieved_goal": spaces.Box(-high, high, dtype=np.float32),
                "desired_goal": spaces.Box(-high, high, dtype=np.float32),
            }
        )
        self.goal = goal
        """Goal of the task."""

    def look(self, flat: np.ndarray, robots: ShownRobots) -> dict[str, np.ndarray]:
        """Return the parts of the observation, with a row for every robot."""
        wanted = robots.wanted
        assert wanted is not None
        achieved = self.goal.achieved(robots.plants["state"], robots.told, wanted)
        pair = {"achieved_goal": achieved, "desired_goal": wanted}
        high = self._high
        goals = {k: np.minimum(np.maximum(v, -high), high).astype(np.float32) for k, v in pair.items()}
        return {"observation": flat[:, self._shown], **goals}


class AsymmetricSight(Sight):
    """Observation for asymmetric learning: the actor's `observation`, and `privileged` for a critic or a teacher."""

    def __init__(self, flat: spaces.Box, told: Sequence[Field]) -> None:
        """Build the space from the flat vector's space and the privileged fields of `info`."""
        size = sum(f.size for f in privileged_layout(told))
        high = np.full(size, MOST, np.float32)
        self.space = spaces.Dict({"observation": flat, "privileged": spaces.Box(-high, high, dtype=np.float32)})
        self._told = tuple(told)

    def look(self, flat: np.ndarray, robots: ShownRobots) -> dict[str, np.ndarray]:
        """Return the parts of the observation, with a row for every robot."""
        at, gain, offset = _places()
        count = len(flat)
        numbers = robots.records.view(np.float64).reshape(count, -1)[:, at] * gain + offset
        read = sum(f.size for _, f in _READ)
        told = [robots.told(f.name).reshape(count, -1) / f.bound for f in self._told]
        values = np.concatenate((numbers[:, :read], *_compute(robots.plants), *told, numbers[:, read:]), axis=1)
        # The clearance of a robot that has diverged may be NaN.
        return {"observation": flat, "privileged": np.fmin(np.fmax(values, -MOST), MOST).astype(np.float32)}


@cache
def _places() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the indices of the read values in a record, in doubles, and the factors and offsets that scale them."""
    at, gain, offset = [], [], []
    for path, field in _READ:
        at.append(_place(path, field.size))
        gain.append(np.full(field.size, 1.0 / field.bound))
        offset.append(np.zeros(field.size))
    nominal = PlantConfig()
    for row in TABLE:
        field, (part, name) = _drawn_field(row), row.field.split(".")
        own = np.broadcast_to(np.asarray(getattr(getattr(nominal, part), name), float), row.shape).reshape(-1)
        middle = 0.5 * (row.low + row.high)
        at.append(_place(f"config.{row.field}", field.size))
        gain.append(1.0 / (field.bound * own) if row.operation == "scale" else np.full(field.size, 1.0 / field.bound))
        offset.append(-(middle + own * (row.operation == "add")) / field.bound + np.zeros(field.size))
    return np.concatenate(at), np.concatenate(gain), np.concatenate(offset)


def _place(path: str, size: int) -> np.ndarray:
    """Return the indices of a member of `sp_plant`, in doubles from its beginning."""
    dtype: Any = engine_layouts()["plant"]
    begin = 0
    for name in path.split("."):
        dtype, where = dtype.fields[name][:2]
        begin += where
    assert dtype.base == np.float64
    assert dtype.itemsize == 8 * size
    return begin // 8 + np.arange(size)


def _compute(plants: np.ndarray) -> list[np.ndarray]:
    """Return the fields of `_COMPUTED`, scaled."""
    state, disturbances = plants["state"], plants["disturbances"]
    w, x, y, z = state["quat_wb"].T
    R = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    yaw = np.arctan2(R[1][0], R[0][0])
    vx, vy, vz = state["velocity_w"].T
    own = [(R[0][k] * vx + R[1][k] * vy + R[2][k] * vz) / 5.0 for k in range(3)]
    angles = np.ascontiguousarray(state["vectoring"])
    charge = 1.0 - (plants["spent_wh"] + plants["energy_wh"]) / (USABLE * CAPACITY_WH)
    is_lost = (state["time"] >= disturbances["fault_time"] - 1e-9)[:, None] & (
        disturbances["lost_rotor"][:, None] == _MODULES
    )
    kind = disturbances["fault"][:, None]
    columns = (*R[2], np.sin(yaw), np.cos(yaw), *own)
    return [
        np.stack(columns, axis=1),
        np.sin(angles),
        np.cos(angles),
        charge[:, None],
        (plants["in_contact"] != 0)[:, None],
        *(is_lost & (kind == FAULTS.index(name)) for name in ("thrust", "vectoring")),
    ]


class Rewarding:
    """Public functions of an environment with a goal, as in `gymnasium_robotics`; others raise `NoGoalError`."""

    sight: Sight | None
    """Observation that replaces the flat vector, or None."""
    is_closed: bool
    """Whether `close` was called."""

    @property
    def compute_reward(self) -> Callable[[Any, Any, Any], Any]:
        """`Goal.compute_reward` (`NoGoalError` without a goal)."""
        return self._goal("compute_reward").compute_reward

    @property
    def compute_terminated(self) -> Callable[[Any, Any, Any], Any]:
        """`Goal.compute_terminated` (`NoGoalError` without a goal)."""
        return self._goal("compute_terminated").compute_terminated

    @property
    def compute_truncated(self) -> Callable[[Any, Any, Any], Any]:
        """`Goal.compute_truncated` (`NoGoalError` without a goal)."""
        return self._goal("compute_truncated").compute_truncated

    def _goal(self, name: str) -> Goal:
        if self.is_closed:
            raise closed()
        if not isinstance(self.sight, GoalSight):
            raise NoGoalError(f"there is no {name} without a goal; valid: observation='goal'")
        return self.sight.goal


class Observed(Rewarding):
    """Observations and pictures of an environment of one robot."""

    goal_type: ClassVar[type[Goal] | None] = None
    """Class of the goal; None without one."""
    no_goal: ClassVar[str] = ""
    """Reason why the environment has no goal."""
    true_fields: ClassVar[tuple[Field, ...]] = ()
    """Privileged fields of `info`, with their scales."""
    fleet: Fleet
    plant: Plant
    view: View
    task: Any

    def _choose_sight(
        self, observation: str, goal_reward: str, flat: spaces.Box, layout: Sequence[Field]
    ) -> Sight | None:
        """Return the observation that replaces the flat vector, or None."""
        require_name("observation", observation, OBSERVATIONS)
        require_name("goal_reward", goal_reward, REWARDS)
        if observation == "goal":
            if self.goal_type is None:
                raise InvalidValueError("observation", observation, f"vector or asymmetric: {self.no_goal}")
            if self.task.is_own:
                raise InvalidValueError("observation", observation, "vector or asymmetric with a custom reward")
            return GoalSight(flat, layout, self.goal_type(goal_reward))
        if goal_reward != "sparse":
            raise InvalidValueError("goal_reward", goal_reward, "none, or observation='goal', which has a goal")
        return AsymmetricSight(flat, self.true_fields) if observation == "asymmetric" else None

    def _show(self, flat: np.ndarray) -> Any:  # noqa: ANN401 - an array, or a dictionary of them
        """Return the observation built from the flat vector (size,); without a `sight`, the vector itself."""
        if self.sight is None:
            return flat
        shown = self.sight.look(flat[None], robots_of(self.sight, self.fleet))
        return {name: rows[0].copy() for name, rows in shown.items()}

    @in_turn
    def render(self) -> Any:  # noqa: ANN401 - an array or None, as Gymnasium has it
        """Return a picture (height, width, 3) uint8, distances (height, width) [m], or None in the mode `human`."""
        config = self.plant.config
        return self.view.draw(self.plant.data.qpos, config.ground, self.plant.period, config.object)

    def _rewarded(self, shown: Any, reward: float) -> float:  # noqa: ANN401 - as above
        """Return the reward: the goal's if there is a goal, else the task's."""
        if not isinstance(self.sight, GoalSight):
            return reward
        return float(self.sight.goal.reward(shown["achieved_goal"], shown["desired_goal"]))


def robots_of(sight: Sight, fleet: Fleet) -> ShownRobots:
    """Collect the data of a fleet's robots for observations."""
    wanted = sight.goal.wanted(fleet) if isinstance(sight, GoalSight) else None
    return ShownRobots(fleet.robots, lambda name: fleet.infos[name], wanted)


class Shown:
    """Observations of a vector's robots, in arrays that each tick overwrites."""

    def __init__(self, sight: Sight, robots: int, *, same_step: bool) -> None:
        """Allocate the arrays.

        Args:
            sight: Observation to build.
            robots: Number of robots.
            same_step: Whether an episode begins in the step in which the last one ends. This class then resets the
                robots in place of the engine, after it has read their final observations.
        """
        self._sight, self._same_step = sight, same_step
        self.now, self.final = (
            {name: np.zeros((robots, *(space.shape or ())), np.float32) for name, space in sight.space.items()}
            for _ in range(2)
        )

    def look(self, fleet: Fleet, flat: np.ndarray) -> None:
        """Write the current observations."""
        for name, rows in self._sight.look(flat, robots_of(self._sight, fleet)).items():
            self.now[name][...] = rows

    def conclude(self, fleet: Fleet, ids: np.ndarray | None) -> None:
        """Process a step: write observations and goal rewards, and reset robots at an end in the same step.

        Args:
            fleet: The robots.
            ids: Robots that have moved, all if None.
        """
        self.look(fleet, fleet.observations)
        if isinstance(self._sight, GoalSight):
            rewards = self._sight.goal.reward(self.now["achieved_goal"], self.now["desired_goal"])
            fleet.rewards[:] = np.where(fleet.begun, 0.0, rewards)
        over = fleet.terminated | fleet.truncated
        if ids is not None:
            over[np.setdiff1d(np.arange(len(over)), ids)] = False
        if not (self._same_step and over.any()):
            return
        ended = np.flatnonzero(over)
        for name, rows in self.now.items():
            self.final[name][ended] = rows[ended]
        fleet.final_infos[ended], fleet.final_terms[ended] = fleet.infos[ended], fleet.terms[ended]
        kept = {name: getattr(fleet, name)[ended] for name in ("rewards", "terminated", "truncated")}
        fleet.reset(ended)
        for name, values in kept.items():
            getattr(fleet, name)[ended] = values
        self.look(fleet, fleet.observations)
