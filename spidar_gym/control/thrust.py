"""The allocator as a library: computes thrusts and vectoring angles from a state and a wrench, tick after tick."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from spidar_gym.arrays import RotorMask, RotorVector, Vectoring, Wrench
from spidar_gym.control.allocation.allocator import Allocation, AllocationStatus, Allocator
from spidar_gym.control.allocation.modes import find_allocation
from spidar_gym.control.allocation.problem import Mode
from spidar_gym.control.flight.controller import CONTROL_RATE, ControllerConfig
from spidar_gym.control.presets import controller_config
from spidar_gym.control.rotors import ALL_FREE, RotorMemory, flight_demand, fresh_rotors
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import rate_limit_vectoring, vectoring_to_force
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import RobotState, valid_state


class ThrustAllocator:
    """Allocates a wrench to the eight rotors as the flight controller does: the same QP, locks and interference.

    It owns the model, the solver's workspace and the last commands. One object therefore serves one robot, from one
    thread, with one call per control period.
    """

    def __init__(
        self,
        preset: str = "paper",
        *,
        period: float = 1.0 / CONTROL_RATE,
        config: ControllerConfig | None = None,
        modes: Mapping[str, Mode] | None = None,
        robot: RobotSpec = ROBOT,
    ) -> None:
        """Build the model and the solver.

        Args:
            preset: Preset whose allocation is used: `paper` or `as_flown`; that of `tuned` is the paper's.
            period: Time between two calls [s]; no angle turns farther per call than its servo can in this time.
                With infinity the angles are the final ones, as if the servos had arrived.
            config: Custom configuration that replaces the preset's; only its allocation, allocator, interference and
                lock are used.
            modes: Custom modes `flight` and `flight_unrestricted` that replace those of the allocation, with other
                weights, limits or blocks (`spidar_gym.control.allocation.modes.find_allocation` returns built-in ones).
            robot: The robot.

        Raises:
            UnknownNameError: There is no such preset or allocation.
            InvalidValueError: The period is not above 0, or one of the modes is missing.
        """
        if not period > 0.0:
            raise InvalidValueError("period", period, "a time above 0 [s]")
        self._config = config or controller_config(preset, robot)
        self._model = Model(robot)
        own = dict(find_allocation(self._config.allocation) if modes is None else modes)
        if not {"flight", "flight_unrestricted"} <= own.keys():
            raise InvalidValueError("modes", sorted(own), "flight and flight_unrestricted among them")
        self._allocator = Allocator(own, self._config.allocator)
        self._turn = robot.max_vectoring_speed * period
        # The lock's slew is per control period of the controller.
        self._lock_config = replace(self._config.lock, slew=self._config.lock.slew * (period * CONTROL_RATE))
        self._memory: RotorMemory | None = None
        self._last: tuple[RotorVector, Vectoring, Allocation] | None = None

    def reset(self) -> None:
        """Clear the last commands; the next call starts from the angles of its state."""
        self._memory = self._last = None

    def allocate(
        self,
        state: RobotState,
        wrench: ArrayLike,
        *,
        avoid_interference: bool = True,
        lost_thrust: RotorMask = ALL_FREE,
        lost_vectoring: RotorMask = ALL_FREE,
    ) -> tuple[RotorVector, Vectoring, Allocation]:
        """Compute thrusts and vectoring angles for a wrench.

        Args:
            state: State of the robot, which must be finite; joint angles, attitude and vectoring angles are used.
            wrench: Force [N] and torque about the CoG [Nm], in the torso's axes, shape (6,); a level hover is
                (0, 0, m g, 0, 0, 0).
            avoid_interference: Whether jets must not meet other rotors; False is the paper's baseline.
            lost_thrust: Modules without thrust, shape (8,).
            lost_vectoring: Modules whose angles no longer move, shape (8,).

        Returns:
            Thrusts λ [N], shape (8,); angles (φ, θ) [rad], shape (8, 2), unwrapped, on the branch of the last ones;
            and the allocation. `allocation.status` states whether it is the optimum (see `AllocationStatus`),
            `allocation.unallocated_wrench` is the part of the wrench that is not produced, and
            `allocation.joint_torques` are the torques of the joints. Thrusts and angles produce `allocation.forces_l`
            once the servos have arrived. If the state or the wrench is not finite, the last result is returned with
            the status `held`.

        Raises:
            InvalidValueError: The wrench is not six numbers, or there is no last result when an input is not finite.
        """
        wanted = _wrench(wrench)
        if not (valid_state(state) and math.isfinite(float(wanted @ wanted))):
            if self._last is None:
                raise InvalidValueError("state, wrench", (state, wrench), "finite numbers and a unit quaternion")
            thrust, vectoring, allocation = self._last
            return thrust, vectoring, replace(allocation, status=AllocationStatus.HELD)
        memory = self._memory or fresh_rotors(state.vectoring, vectoring_to_force(state.thrust, state.vectoring))
        snapshot = self._model.snapshot(state.joint_position, quat_to_matrix(state.quat_wb), state.vectoring)
        mode = self._allocator.mode("flight" if avoid_interference else "flight_unrestricted")
        demand, lock, bounds = flight_demand(
            memory, mode, snapshot, state.vectoring, wanted, lost_thrust=lost_thrust, lost_vectoring=lost_vectoring,
            interference_config=self._config.interference, lock_config=self._lock_config,
        )  # fmt: skip
        allocation = self._allocator.allocate(demand, mode.name, memory.forces_l)
        vectoring = rate_limit_vectoring(allocation.forces_l, lock, memory.vectoring, self._turn)
        self._memory = RotorMemory(lock, bounds, vectoring, allocation.forces_l)
        self._last = allocation.thrust, vectoring, allocation
        return self._last


def _wrench(numbers: ArrayLike) -> Wrench:
    try:
        wrench = np.asarray(numbers, float)
    except (TypeError, ValueError):
        wrench = np.zeros(0)
    if wrench.shape != (6,):
        raise InvalidValueError("wrench", numbers, "force [N] and torque [Nm], 6 numbers")
    return wrench
