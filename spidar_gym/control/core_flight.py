"""The flight controller of the onboard core, with the interface of `Controller`."""

import ctypes
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector, RotorVector, Vectoring, Wrench
from spidar_gym.control.allocator import Allocation
from spidar_gym.control.centroidal import Integrals, MotionError
from spidar_gym.control.controller import ControllerConfig, Percept
from spidar_gym.control.core import Core, Struct, allocation_of, pointer
from spidar_gym.control.observation import LegMomentum, Preview
from spidar_gym.control.structs import fill
from spidar_gym.model.dynamics import Model, Snapshot
from spidar_gym.model.interference import Interference
from spidar_gym.robot import N_ROTORS, ROBOT
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState


class Sight:
    """A percept in the core's memory, and the controller's dataclass whose arrays show it."""

    def __init__(self, record: Any = None) -> None:  # noqa: ANN401 - a numpy record
        """Make one, or look at one inside another struct."""
        self.struct = Struct("percept", record)
        s, e = self.struct.inner("snapshot", "snapshot"), self.struct.inner("error", "motion_error")
        shapes = {"inertia_c": (3, 3), "R_bl": (8, 3, 3), "J_rotor": (8, 3, 16), "joint_axes": (3, 16),
                  "momentum_map": (6, 16)}  # fmt: skip
        names = [name for name in Snapshot.__dataclass_fields__ if name != "mass"]
        arrays = {name: s[name].reshape(shapes.get(name, s[name].shape)) for name in names}
        self.percept = Percept(
            self.struct["R_wb"].reshape(3, 3), Snapshot(mass=ROBOT.total_mass, **arrays), MotionError(**e.views)
        )  # fmt: skip


class CoreMemory:
    """What the core's flight controller remembers; the arrays show what is there now."""

    def __init__(self, struct: Struct) -> None:
        """Look at it."""
        self._bounds = struct.inner("interference", "interference")
        self.integrals = Integrals(struct["position_integral_w"], struct["attitude_integral"])
        self.vectoring = struct["vectoring"].reshape(N_ROTORS, 2)
        self.forces_l = struct["forces_l"].reshape(N_ROTORS, 3)
        self.joint_position, self.joint_velocity = struct["joint_position"], struct["joint_velocity"]

    @property
    def interference(self) -> Interference:
        """Restricted rotors and bounds."""
        b = self._bounds
        return Interference(b["restricted"] != 0, b["lower"], b["upper"], b["side"])


@dataclass(frozen=True, slots=True)
class CoreTick:
    """What one tick did; the arrays are overwritten by the next."""

    percept: Percept
    """Model quantities and errors."""
    wrench_desired: Wrench
    """w^d, residual included [N, Nm]."""
    allocation: Allocation
    """What the allocation answered."""
    joint_velocity: JointVector
    """Commanded joint velocity [rad/s]."""


class CoreController(Core):
    """The flight controller of the onboard core; the interface of `Controller`."""

    def __init__(self, config: ControllerConfig | None = None, model: Model | None = None) -> None:
        """Load the core and give it a configuration (`MissingDependencyError` when it is not compiled)."""
        super().__init__(model)
        self.config = config or ControllerConfig()
        self._flight, self._reference, self._given = Struct("flight"), Struct("reference"), None
        self._settings = Struct("controller_config")
        fill(self._settings.record, self.config)
        self.library.sp_flight_init(self._flight.pointer, self._settings.pointer)
        self._sights = Sight(), Sight()
        self._own = Sight(self._flight.views["percept"])
        self._turn = 0
        self.memory = CoreMemory(self._flight.inner("memory", "flight_memory"))
        self._answered = self._flight.inner("allocation", "allocation")
        self._solve_time, self._tick = 0.0, None

    @property
    def tick(self) -> CoreTick | None:
        """What the last tick did; None before the first."""
        if self._tick is None and self._flight["ticked"]:
            allocation = allocation_of(self._answered, self._solve_time)
            f = self._flight
            self._tick = CoreTick(self._own.percept, f["wrench_desired"], allocation, f["joint_velocity"])
        return self._tick

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Forget everything; as `Controller.reset`."""
        self.see(state)
        self._tick = None
        given = [None if x is None else np.ascontiguousarray(x, float) for x in (joint_position, trim)]
        pointers = [None if x is None else pointer(x) for x in given]
        self.library.sp_flight_reset(self._flight.pointer, self._state.pointer, *pointers)

    def rest_vectoring(self, q: JointVector) -> Vectoring:
        """(φ, θ) that a hover in the form q comes to rest near [rad]."""
        vectoring = np.zeros((N_ROTORS, 2))
        self.library.sp_rest_vectoring(
            self._settings.pointer, pointer(np.ascontiguousarray(q, float)), pointer(vectoring)
        )
        return vectoring

    def _refer(self, reference: Reference) -> None:
        if reference is not self._given:
            fill(self._reference.record, reference)
            self._given = reference

    def perceive(self, state: RobotState, reference: Reference) -> Percept:
        """What the controller makes of a state; its arrays are overwritten by the next call but one."""
        self.see(state)
        self._refer(reference)
        sight = self._sights[self._turn]
        self._turn = 1 - self._turn
        self.library.sp_perceive(self._state.pointer, self._reference.pointer, sight.struct.pointer)
        return sight.percept

    def step(
        self,
        state: RobotState,
        reference: Reference,
        residual: Residual = NO_RESIDUAL,
        percept: Percept | None = None,
    ) -> Command:
        """One control tick; as `Controller.step`."""
        self.see(state)
        self._refer(reference)
        known = next((sight.struct.pointer for sight in self._sights if sight.percept is percept), None)
        start = time.perf_counter()
        self.library.sp_flight_step(
            self._flight.pointer, self._state.pointer, self._reference.pointer, self.residual_pointer(residual), known,
            self._command.pointer,
        )  # fmt: skip
        self._solve_time = time.perf_counter() - start
        self._tick = None
        return self._answer()

    def observe(
        self,
        state: RobotState,
        percept: Percept,
        thrust: RotorVector,
        joint_velocity: JointVector,
        legs: LegMomentum,
        preview: Preview,
        previous_action: np.ndarray,
        *,
        bound: np.ndarray,
    ) -> np.ndarray:
        """The observation; as `control.observation.observe`."""
        self.see(state)
        sight = next(sight for sight in self._sights if sight.percept is percept)
        arrays = (thrust, joint_velocity, legs.value, legs.rate, preview.joint_target, preview.next_form)
        size = self.library.sp_observe(
            self._flight.pointer, self._state.pointer, sight.struct.pointer, *map(pointer, arrays),
            ctypes.c_double(preview.time_to_next), pointer(previous_action), len(previous_action), pointer(bound),
            pointer(self._observation),
        )  # fmt: skip
        return self._observation[:size].copy()
