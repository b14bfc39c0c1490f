"""The robots as a task sees them: quantities, states and memory of N robots, as arrays with an entry for each."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.native.quantities import (
    CourseQuantities,
    CrawlQuantities,
    GraspQuantities,
    HoverQuantities,
    Quantities,
)
from spidar_gym.robot import N_LEGS


@runtime_checkable
class Simulated(Protocol):
    """The part of the engine's robots that a task may use."""

    robots: np.ndarray
    quantities: np.ndarray
    goals: np.ndarray
    knots: np.ndarray
    has_own_copies: bool

    @property
    def scheduled(self) -> Mapping[str, np.ndarray]:
        """Current `reference` and `preview` of the schedule, records (N,) each."""
        ...

    @property
    def horizon(self) -> np.ndarray:
        """Steps after which an episode is truncated (N,)."""
        ...

    @property
    def action_size(self) -> int:
        """Number of entries of an action."""
        ...

    def load(self, ids: np.ndarray, mass: np.ndarray, position_b: np.ndarray) -> None:
        """Attach point masses to torsos."""
        ...


class Robots(Quantities):
    """N robots, as arrays with an entry for every robot; do not write to them.

    Every quantity that the engine computes for the task is an attribute, a view of a block that each tick overwrites.
    """

    kind: ClassVar[str]
    """Struct of a robot in the engine."""
    quantities: ClassVar[type[Quantities]]
    """Table of the quantities."""

    def __init__(self, simulated: Simulated, memory: np.ndarray) -> None:
        """Store views of the engine's robots and of the task's memory."""
        self._simulated, self.memory, self.records = simulated, memory, simulated.robots
        common, block = simulated.quantities["common"], simulated.quantities
        for name in block.dtype.names or ():
            if name != "common":
                setattr(self, name, block[name])
        for name in common.dtype.names or ():
            setattr(self, name, common[name])

    def __len__(self) -> int:
        """Return the number of robots."""
        return len(self.records)

    @property
    def horizon(self) -> np.ndarray:
        """Steps after which an episode is truncated (N,)."""
        return self._simulated.horizon

    @cached_property
    def state(self) -> np.ndarray:
        """True states, records of `RobotState`'s fields with flat arrays: `state["position_w"]` is (N, 3) [m]."""
        return self.records["plant"]["state"]

    @cached_property
    def action(self) -> np.ndarray:
        """Last actions in [−1, 1], (N, size of an action)."""
        return self.records["episode"]["action"][:, : self._simulated.action_size]

    @property
    def payload(self) -> np.ndarray:
        """Mass of the torso's load (N,) [kg]."""
        return self.records["plant"]["config"]["body"]["payload_mass"]

    def load(self, ids: np.ndarray, mass: Any, position_b: Any = (0.0, 0.0, 0.0)) -> None:  # noqa: ANN401 - numbers or arrays
        """Attach point masses to torsos, from the next tick to the end of the episode; 0 kg removes them.

        Args:
            ids: Indices of the robots, or flags (N,).
            mass: Mass [kg], one for all or one for each.
            position_b: Position in torso axes, (3,) or (…, 3) [m].

        Raises:
            SpidarError: For a task without `loads = True`.
            InvalidValueError: For a mass below 0, or a value that is not finite.
        """
        if not self._simulated.has_own_copies:
            raise SpidarError("these robots share one model; valid: a task with loads = True")
        ids = np.flatnonzero(ids) if np.asarray(ids).dtype == bool else np.asarray(ids, int)
        mass, position = np.broadcast_to(mass, ids.shape), np.broadcast_to(position_b, (*ids.shape, 3))
        if not (np.isfinite(mass).all() and (mass >= 0.0).all() and np.isfinite(position).all()):
            raise InvalidValueError("load", (mass.tolist(), position.tolist()), "masses ≥ 0 kg, finite positions in m")
        if ids.size:
            self._simulated.load(ids, mass, position)


class HoverRobots(HoverQuantities, Robots):
    """Robots in flight."""

    kind, quantities = "hover", HoverQuantities

    @cached_property
    def error(self) -> np.ndarray:
        """True errors, reference less state: `position_w`, `velocity_w`, `attitude`, `omega_b`, each (N, 3)."""
        return self.records["truth"]["error"]

    @cached_property
    def position_error(self) -> np.ndarray:
        """Position error of the CoG, desired less actual, world (N, 3) [m]."""
        return self.records["position_error"]

    @cached_property
    def attitude_error(self) -> np.ndarray:
        """Attitude error log(RᵀR_d), torso axes (N, 3) [rad]."""
        return self.records["attitude_error"]

    @property
    def goal(self) -> np.ndarray:
        """Current target forms: records of `start`, `deadline` [s], `joint_target` (N, 16) [rad]."""
        return self._simulated.goals[np.arange(len(self)), self.records["current"]]

    @property
    def scheduled(self) -> Mapping[str, np.ndarray]:
        """Copies of the current `reference` and `preview` of the environment's schedule and path, records (N,) each."""
        return {name: records.copy() for name, records in self._simulated.scheduled.items()}


class CrawlRobots(CrawlQuantities, Robots):
    """Robots on the ground."""

    kind, quantities = "crawl", CrawlQuantities

    @cached_property
    def error(self) -> np.ndarray:
        """Goal − torso (N, 3): x, y in the world [m], and yaw [rad]."""
        return self.records["error"]

    @property
    def phase(self) -> np.ndarray:
        """Phase of the gait as an index of `PHASES` (N,)."""
        return self.records["phase"]

    @property
    def feet_touch(self) -> np.ndarray:
        """Whether each foot touches the floor (N, 4)."""
        return self.records["touch"]["balls"][:, :N_LEGS] != 0


class CourseRobots(CourseQuantities, Robots):
    """Robots on a course."""

    kind, quantities = "course", CourseQuantities


class GraspRobots(GraspQuantities, Robots):
    """Robots that grasp."""

    kind, quantities = "grasp", GraspQuantities

    @cached_property
    def objects(self) -> np.ndarray:
        """True states of the objects, records of `ObjectState`'s fields with flat arrays."""
        return self.records["plant"]["object"]

    @cached_property
    def scene(self) -> np.ndarray:
        """Scenes, records of `GraspScene`'s fields."""
        return self.records["scene"]
