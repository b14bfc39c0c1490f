"""The flight controller of the onboard core, a `FlightControl`."""

import numpy as np

from spidar_gym.arrays import JointVector, Vectoring, Wrench
from spidar_gym.control.flight.centroidal import Integrals, MotionError
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.memory import ControlState, FlightRecord
from spidar_gym.control.flight.observation import FlightObservables
from spidar_gym.control.grasp.grip import Grip
from spidar_gym.model.dynamics import Model, Snapshot
from spidar_gym.model.interference import Interference
from spidar_gym.native.library import Core, LastCommand, Room, Struct, pointer, read_allocation
from spidar_gym.native.structs import fill
from spidar_gym.robot import N_ROTORS, ROBOT, RobotSpec
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState


class ControlStateView:
    """A control state in the core's memory, and a `ControlState` whose arrays are views of it."""

    def __init__(self, record: np.ndarray | None = None, robot: RobotSpec = ROBOT) -> None:
        """Make a control state of a robot, or view one inside another struct."""
        self.struct = Struct("control_state", record)
        s, e = self.struct.inner("snapshot", "snapshot"), self.struct.inner("error", "motion_error")
        shapes = {"inertia_c": (3, 3), "R_bl": (8, 3, 3), "J_rotor": (8, 3, 16), "joint_axes": (3, 16),
                  "momentum_map": (6, 16)}  # fmt: skip
        names = [name for name in Snapshot.__dataclass_fields__ if name not in ("mass", "robot")]
        arrays = {name: s[name].reshape(shapes.get(name, s[name].shape)) for name in names}
        self.control_state = ControlState(
            self.struct["R_wb"].reshape(3, 3), Snapshot(mass=robot.total_mass, robot=robot, **arrays),
            MotionError(**e.views),
        )  # fmt: skip
        self._mass = s["mass"]

    def load(self, given: ControlState) -> None:
        """Copy another control state into this one."""
        shown = self.control_state
        shown.R_wb[:], self._mass[...] = given.R_wb, given.snapshot.mass
        for own, other in ((shown.snapshot, given.snapshot), (shown.error, given.error)):
            for name in own.__dataclass_fields__:
                if name not in ("mass", "robot"):
                    getattr(own, name)[...] = getattr(other, name)


class CoreMemory(LastCommand):
    """State of the core's flight controller; the arrays are views of it."""

    def __init__(self, struct: Struct) -> None:
        """View an `sp_flight_memory`."""
        super().__init__(struct)
        self._bounds = struct.inner("interference", "interference")
        self.integrals = Integrals(struct["position_integral_w"], struct["attitude_integral"])
        self.joint_velocity = struct["joint_velocity"]

    @property
    def interference(self) -> Interference:
        """Restricted rotors and bounds."""
        b = self._bounds
        return Interference(b["restricted"] != 0, b["lower"], b["upper"], b["side"])


class CoreFlightController(Core[CoreMemory]):
    """The flight controller of the onboard core, a `FlightControl`."""

    def __init__(
        self,
        config: ControllerConfig | None = None,
        model: Model | None = None,
        *,
        record: np.ndarray | None = None,
        room: Room | None = None,
    ) -> None:
        """Make a controller in the core, or view one of the engine.

        Args:
            config: Allocation, gains, limits.
            model: Model of the described robot.
            record: `sp_flight` of a robot in the engine, which already has this configuration.
            room: Workspace; a new one if not given.

        Raises:
            MissingDependencyError: When the core is not compiled.
        """
        super().__init__(model, room)
        self.config = config or ControllerConfig()
        self._flight, self._reference, self._given = Struct("flight", record), Struct("reference"), None
        self.whole = self._flight
        self._settings, self._preview, self._grip = Struct("controller_config"), Struct("preview"), Struct("grip")
        fill(self._settings.record, self.config)
        if record is None:
            self.library.sp_flight_init(self._flight.pointer, self._settings.pointer)
        spec = self.model.robot
        self._views, self._foreign = tuple(ControlStateView(robot=spec) for _ in range(2)), ControlStateView(robot=spec)
        self._own = ControlStateView(self._flight.views["control"], spec)
        self._turn = 0
        self.memory = CoreMemory(self._flight.inner("memory", "flight_memory"))
        self._answered = self._flight.inner("allocation", "allocation")

    @property
    def last_step(self) -> FlightRecord | None:
        """Record of the last tick; None before the first."""
        f = self._flight
        if self._last_step is None and f["ticked"]:
            allocation = read_allocation(self._answered, self._solve_time)
            restricted = self.memory.interference.restricted
            self._last_step = FlightRecord(
                self._own.control_state, f["wrench_desired"], allocation, f["joint_velocity"], restricted
            )
        return self._last_step

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Reset the controller; as `FlightController.reset`."""
        self.write_state(state)
        self._last_step = None
        given = [None if x is None else np.ascontiguousarray(x, float) for x in (joint_position, trim)]
        pointers = [None if x is None else pointer(x) for x in given]
        self.library.sp_flight_reset(self.room.robot, self._flight.pointer, self._state.pointer, *pointers)

    def rest_vectoring(self, q: JointVector) -> Vectoring:
        """Return the (φ, θ) near which a hover in the form q settles, shape (8, 2) [rad]."""
        vectoring = np.zeros((N_ROTORS, 2))
        self.library.sp_rest_vectoring(
            self.room.robot, self._settings.pointer, pointer(np.ascontiguousarray(q, float)), pointer(vectoring)
        )
        return vectoring

    def _write_reference(self, reference: Reference) -> None:
        if reference is not self._given:
            fill(self._reference.record, reference)
            self._given = reference

    def compute_state(self, state: RobotState, reference: Reference) -> ControlState:
        """Compute the control state of a robot state; its arrays are overwritten by the next call but one."""
        self.write_state(state)
        self._write_reference(reference)
        view = self._views[self._turn]
        self._turn = 1 - self._turn
        self.library.sp_compute_state(
            self.room.robot, self._state.pointer, self._reference.pointer, view.struct.pointer
        )
        return view.control_state

    def _view(self, control_state: ControlState) -> ControlStateView:
        """Return the view from which the core reads a control state; one from elsewhere is copied into `_foreign`."""
        for view in self._views:
            if view.control_state is control_state:
                return view
        self._foreign.load(control_state)
        return self._foreign

    def step(
        self,
        state: RobotState,
        reference: Reference,
        residual: Residual = NO_RESIDUAL,
        control_state: ControlState | None = None,
        grip: Grip | None = None,
    ) -> Command:
        """Compute the command of one control tick; as `FlightController.step`."""
        self.write_state(state)
        self._write_reference(reference)
        held = None
        if grip is not None:
            fill(self._grip.record, grip)
            held = self._grip.pointer
        known = None if control_state is None else self._view(control_state).struct.pointer
        return self._tick(
            self.library.sp_flight_step, self._flight.pointer, self._state.pointer, self._reference.pointer,
            self.residual_pointer(residual), known, held, self.room.pointer,
        )  # fmt: skip

    def observe(self, observables: FlightObservables, *, bound: np.ndarray) -> np.ndarray:
        """Compute the observation; as `control.flight.observation.observe`."""
        seen = observables
        self.write_state(seen.state)
        view = self._view(seen.control_state)
        arrays = seen.thrust_command, seen.joint_command_velocity, seen.leg_momentum, seen.leg_momentum_rate
        preview = self._preview
        preview["joint_target"][:], preview["next_form"][:] = seen.joint_target, seen.next_form
        preview["time_to_next"][...] = seen.time_to_next_form
        if seen.path is not None:
            for name in ("ahead_w", "turn", "velocity_w", "acceleration_w"):
                preview[name][:] = getattr(seen.path, name).reshape(-1)
        size = self.library.sp_observe(
            self._flight.pointer, self._state.pointer, view.struct.pointer, *map(pointer, arrays),
            preview.pointer, int(seen.path is not None), pointer(seen.previous_action), len(seen.previous_action),
            pointer(bound), pointer(self._observation),
        )  # fmt: skip
        return self._observation[:size].copy()
