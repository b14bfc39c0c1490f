"""Flight controller: (state, reference, residual) → command, by snapshot, wrench, allocation, vectoring and joints."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3, Vectoring, Wrench
from spidar_gym.control.allocation.allocator import Allocation, Allocator, AllocatorConfig
from spidar_gym.control.allocation.modes import find_allocation
from spidar_gym.control.allocation.problem import Demand
from spidar_gym.control.flight.centroidal import (
    CentroidalConfig,
    Integrals,
    desired_wrench,
    integrate,
    motion_error,
    quasi_static_error,
    warm_start_integrals,
)
from spidar_gym.control.flight.compensation import (
    CompensationConfig,
    CompensationMemory,
    fresh_compensation,
    lead_feedback,
    lead_forces,
    momentum_torque,
    observe_wrench,
    ramp_joints,
    reference_wrench,
    servo_response,
    weight_wrench,
)
from spidar_gym.control.flight.memory import ControlState, FlightMemory, FlightRecord, fresh_memory
from spidar_gym.control.flight.motion import MOTIONS, MotionMemory, fresh_motion, observe_motion, unbend, whole_motion
from spidar_gym.control.flight.observation import FlightObservables, observe
from spidar_gym.control.grasp.grip import LEAD_TIME, Grip, grip_torque
from spidar_gym.control.readable import ReadableController
from spidar_gym.control.rotors import ALL_FREE, flight_demand
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.model.dynamics import Model, Snapshot
from spidar_gym.model.interference import Disc, Interference, InterferenceConfig, find_interference, no_interference
from spidar_gym.model.rotor import (
    Lock,
    LockConfig,
    force_to_angles,
    nominal_vectoring,
    rate_limit_vectoring,
    thrust_map,
    update_lock,
    vectoring_to_force,
)
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import (
    NO_RESIDUAL,
    Command,
    Reference,
    Residual,
    RobotState,
    valid_reference,
    valid_residual,
    valid_state,
)

CONTROL_RATE = 40.0
"""Control rate [Hz] [Zhao2025, Sec. Robot Platform]."""


@dataclass(frozen=True)
class ControllerConfig:
    """Configuration of the flight controller."""

    allocation: str = "paper"
    """Name of the allocation's blocks, see `spidar_gym.control.allocation.modes.ALLOCATIONS`."""
    # In C this fills the padding after `allocation`: size and offsets of logs and missions stay.
    motion: str = "complete"
    """Motion that is fed back: `complete`; `quasi_static`, the velocity of {CoG} without the share of the moving joints
    [JSK]; `observed`, that of the whole robot with legs that bend, see `spidar_gym.control.flight.motion`."""
    joint_speed: float = ROBOT.joint_speed
    """Speed of the planned joint motion [rad/s]; the servos have the same limit."""
    joint_torque_limit: float = ROBOT.max_joint_torque
    """Torque that each joint servo may use [Nm]."""
    rate_hz: float = CONTROL_RATE
    """Control rate [Hz]."""
    centroidal: CentroidalConfig = field(default_factory=CentroidalConfig)
    """Gains and limits of the centroidal control."""
    compensation: CompensationConfig = field(default_factory=CompensationConfig)
    """Compensations beyond the paper's quasi-static control."""
    allocator: AllocatorConfig = field(default_factory=AllocatorConfig)
    """Solver settings."""
    interference: InterferenceConfig = field(default_factory=InterferenceConfig)
    """Thresholds of the interference test."""
    lock: LockConfig = field(default_factory=LockConfig)
    """Thresholds and rates of the φ lock."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for speeds and limits that are not positive (`UnknownNameError` for a motion)."""
        require_name("motion", self.motion, MOTIONS)
        for name in ("joint_speed", "joint_torque_limit", "rate_hz"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and math.isfinite(value) and value > 0.0):
                raise InvalidValueError(name, value, "a number above 0")


class FlightController(ReadableController[FlightMemory, FlightRecord]):
    """The paper's controller for one robot; owns the model, the solver's workspace and the memory.

    A custom control law overrides `compute_wrench`, which computes the wrench to allocate, or `compute_joints`.
    """

    preview: Callable[[float], Reference] | None = None
    """Returns the reference a given time ahead [s], or None if it is not known; for predictive control laws."""

    def __init__(
        self,
        config: ControllerConfig | None = None,
        model: Model | None = None,
        allocator: type[Allocator] = Allocator,
    ) -> None:
        """Build the allocation (`UnknownNameError` lists the valid ones), with a custom allocator class if given."""
        self.config = c = config or ControllerConfig()
        super().__init__(model, rate_hz=c.rate_hz, joint_torque_limit=c.joint_torque_limit)
        self.allocator = allocator(find_allocation(c.allocation), c.allocator)
        self.memory = fresh_memory(np.zeros((N_ROTORS, 2)), np.zeros((N_ROTORS, 3)), np.zeros(N_JOINTS))

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Clear the memory.

        Args:
            state: State of the robot; its vectoring angles become the last commanded ones.
            joint_position: q^d to start from [rad]; the joints of `state` by default.
            trim: Known wrench in {CoG} that a hover needs beyond the model's [N, Nm]; the integrals start with it.
        """
        self.last_step = None
        joints = state.joint_position if joint_position is None else joint_position
        forces = vectoring_to_force(state.thrust, state.vectoring)
        self.memory = fresh_memory(state.vectoring.copy(), forces, joints.copy())
        if trim is not None:
            R_wb = quat_to_matrix(state.quat_wb)
            snapshot = self.model.snapshot(joints, R_wb, state.vectoring)
            # The integrals provide only the share of the trim that the observer will not cancel.
            kept = 1.0 - np.repeat([gain for gain, _, _ in self.config.compensation.observers], 3)
            integrals = warm_start_integrals(snapshot, R_wb, kept * trim, config=self.config.centroidal)
            external = -np.concatenate((R_wb @ trim[:3], R_wb @ trim[3:]))
            compensation = fresh_compensation(joints, external)
            self.memory = replace(self.memory, integrals=integrals, compensation=compensation)

    def resume(self, state: RobotState, command: Command) -> None:
        """Take over from another controller, keeping the integrals and the observed external wrench.

        Args:
            state: State of the robot.
            command: Last command of the other controller.
        """
        before = self.memory
        self.reset(state, command.joint_position)
        self.set_last_command(command)
        vectoring = command.vectoring
        self.memory = replace(
            self.memory, integrals=before.integrals, lock=replace(self.memory.lock, phi=vectoring[:, 0].copy()),
            compensation=fresh_compensation(command.joint_position, before.compensation.external_w),
        )  # fmt: skip

    def rest_vectoring(self, q: JointVector) -> Vectoring:
        """Compute (φ, θ) near which a hover in the form q settles: upright, φ locked as the controller locks it [rad].

        θ is on the branch that continues from the flat form: −135° for the inverted outer links of form ③.
        """
        pitch = np.cumsum(q.reshape(-1, 2, 2)[:, :, 1], axis=1).reshape(-1)
        guess = np.stack([np.zeros(N_ROTORS), -pitch], axis=1)
        snapshot = self.model.snapshot(q, np.eye(3), guess)
        nominal = nominal_vectoring(snapshot.R_bl, guess)
        bounds = find_interference(snapshot, nominal, no_interference(), config=self.config.interference)
        lock = update_lock(
            Lock(ALL_FREE, ALL_FREE, nominal[:, 0]), bounds.restricted, nominal, snapshot, nominal[:, 0],
            config=replace(self.config.lock, slew=math.inf),
        )  # fmt: skip
        angles = zip(
            snapshot.R_bl[:, 2].tolist(), nominal.tolist(), lock.active.tolist(), lock.phi.tolist(), strict=True
        )
        return np.array(
            [force_to_angles(up, *hat, held=phi if active else None, min_force=0.0) for up, hat, active, phi in angles]
        )

    def compute_state(self, state: RobotState, reference: Reference) -> ControlState:
        """Compute model quantities and errors of a state. Pure, except for the model's workspace.

        The errors are those of the complete velocity for every `motion`: environments and policies read them.
        """
        R_wb = quat_to_matrix(state.quat_wb)
        snapshot = self.model.snapshot(state.joint_position, R_wb, state.vectoring)
        return ControlState(R_wb, snapshot, motion_error(state, reference, snapshot, R_wb))

    def step(
        self,
        state: RobotState,
        reference: Reference,
        residual: Residual = NO_RESIDUAL,
        control_state: ControlState | None = None,
        grip: Grip | None = None,
    ) -> Command:
        """Compute the command of one control tick.

        Args:
            state: State of the robot.
            reference: Desired motion.
            residual: Additions of a policy; `NO_RESIDUAL` is the paper's controller.
            control_state: `compute_state(state, reference)`, if the caller has already computed it.
            grip: An object below, and what the legs do with it.

        Returns:
            The command for the next control period; `self.last_step` records how it was computed. If the state or the
            reference is not finite, the last command is repeated. A residual that is not finite is ignored.
        """
        if not (valid_state(state) and valid_reference(reference)):
            return self._hold()
        if residual is not NO_RESIDUAL and not valid_residual(residual):
            residual = NO_RESIDUAL
        memory, options = self.memory, self.config.compensation
        control_state = control_state or self.compute_state(state, reference)
        seen, control_state, motion = self._fed_back(state, reference, control_state)
        R_wb, snapshot = control_state.R_wb, control_state.snapshot
        target = reference.joint_target + residual.joint_offset
        joints, speed = self.compute_joints(target, residual.joint_speed_scale)
        wrench, integrals, compensation = self.compute_wrench(seen, reference, control_state, joints)
        wrench += residual.wrench
        if grip is not None:
            wrench += grip.carried(snapshot, R_wb, state.position_w)
        disc = None if grip is None or grip.radius == 0.0 else grip.disc(snapshot, R_wb, state.position_w)
        demand, lock, bounds = self._demand(memory, snapshot, reference, state.vectoring, wrench, disc)
        if grip is not None:
            feet = self.model.stance(seen.joint_position, R_wb, seen.vectoring)[1]
            forces_b = grip.foot_forces(feet, R_wb, state.position_w)
            if residual.leg_forces_b is not None and grip.force > 0.0:
                forces_b = forces_b + residual.leg_forces_b
            torque = grip_torque(forces_b, feet.J)
            demand = replace(demand, gravity_torque=demand.gravity_torque + torque)
        allocation = self.allocator.allocate(demand, reference.mode, memory.forces_l)
        if residual.forces_l is not None and residual.forces_l.any():
            allocation = self.allocator.project(demand, allocation.forces_l + residual.forces_l, memory.forces_l)
        if reference.support > 0.0:
            share = max(0.0, 1.0 - reference.support)
            allocation = replace(allocation, forces_l=share * allocation.forces_l, thrust=share * allocation.thrust)
        forces = allocation.forces_l
        if options.vectoring_lead > 0.0:
            forces = lead_forces(
                forces, snapshot, state.omega_b, compensation.servo_velocity, lead=options.vectoring_lead
            )
        vectoring = rate_limit_vectoring(forces, lock, memory.vectoring, self.model.robot.max_vectoring_speed * self.dt)
        self.last_step = FlightRecord(control_state, wrench, allocation, speed, bounds.restricted, demand)
        unallocated = allocation.unallocated_wrench
        self.memory = FlightMemory(
            lock, bounds, vectoring, allocation.forces_l, integrals, joints, R_wb @ unallocated[:3], unallocated[3:],
            speed, compensation, motion, self._lead(grip, allocation),
        )  # fmt: skip
        return self._led(Command(allocation.thrust, vectoring, joints, self._torque_limit))

    def _led(self, command: Command) -> Command:
        """Return a command whose joint setpoints lead."""
        lead = self.memory.joint_lead
        return replace(command, joint_position=command.joint_position + lead) if lead.any() else command

    def _lead(self, grip: Grip | None, allocation: Allocation) -> JointVector:
        """Return by how much the joint setpoints lead q^d: the springs of the servos exert their share of a grip [rad].

        The legs' momentum follows from q^d alone: feet that press do not move.
        """
        before, robot = self.memory.joint_lead, self.model.robot
        if grip is None and not before.any():
            return before
        presses = grip is not None and grip.force > 0.0
        wanted = allocation.joint_torques / robot.joint_kp if presses else np.zeros(N_JOINTS)
        most = self.config.joint_speed * self.dt
        step = (1.0 - math.exp(-self.dt / LEAD_TIME)) * (wanted - before)
        return before + np.minimum(np.maximum(step, -most), most)

    def _fed_back(
        self, state: RobotState, reference: Reference, control_state: ControlState
    ) -> tuple[RobotState, ControlState, MotionMemory]:
        """Return state and errors that are fed back, and the new memory of the observer, according to `motion`."""
        motion, error, snapshot = self.memory.motion, control_state.error, control_state.snapshot
        if self.config.motion == "quasi_static":
            error = quasi_static_error(error, state, snapshot, control_state.R_wb)
        elif self.config.motion == "observed" and reference.support > 0.0:
            motion = fresh_motion()  # the floor's force is no disturbance
        elif self.config.motion == "observed":
            R_wb = control_state.R_wb
            Q = thrust_map(snapshot.R_bl, snapshot.rotor_c)
            begun = motion.sag is not None and self.last_step is not None
            motion, state, bending = unbend(motion, state, self.memory.compensation.servo_position, dt=self.dt)
            control_state = self.compute_state(state, reference)
            snapshot, error = control_state.snapshot, control_state.error
            velocity_w = reference.velocity_w - error.velocity_w
            motion, predicted = observe_motion(
                motion, state, bending, snapshot, R_wb, velocity_w=velocity_w, thrust_map=Q,
                thrust=np.linalg.norm(self.memory.forces_l, axis=1),
                allocated=self.last_step.allocation.wrench if begun and self.last_step else None, dt=self.dt,
            )  # fmt: skip
            error, turning = whole_motion(
                motion, error, predicted, state, bending, snapshot, R_wb, velocity_w=velocity_w
            )
            state = replace(state, omega_b=turning)
        return state, replace(control_state, error=error), motion

    def note_scaled(self, share: float) -> None:
        """Note that all thrusts of the last command were multiplied by `share` before they reached the rotors.

        Only the observer of the whole robot's motion takes note; the commands of all other presets are frozen.
        """
        if self.config.motion == "observed" and self.last_step is not None:
            allocation = self.last_step.allocation
            self.memory = replace(self.memory, forces_l=share * self.memory.forces_l)
            self.last_step = replace(self.last_step, allocation=replace(allocation, wrench=share * allocation.wrench))

    def observe(self, observables: FlightObservables, *, bound: np.ndarray) -> np.ndarray:
        """Compute the observation of a policy; see `observation.observe`."""
        return observe(observables, self.memory, bound=bound)

    def compute_wrench(
        self, state: RobotState, reference: Reference, control_state: ControlState, joints: JointVector
    ) -> tuple[Wrench, Integrals, CompensationMemory]:
        """Compute w^d in {CoG} without residual, and the new memory; override this for a custom control law.

        Args:
            state: State of the robot; its angular velocity is the one that is fed back.
            reference: Desired motion.
            control_state: Model quantities, and the errors that are fed back according to `motion`.
            joints: The new q^d [rad].
        """
        memory, gains, error = self.memory, self.config.centroidal, control_state.error
        integrals = memory.integrals if reference.support > 0.0 else integrate(
            memory.integrals, error, memory.unallocated_w, memory.unallocated_torque,
            dt=self.dt, max_speed=gains.max_integration_speed,
        )  # fmt: skip
        wrench = desired_wrench(
            control_state.snapshot, control_state.R_wb, state.omega_b, error, integrals, config=gains
        )
        compensation, more = self.compensate(state, reference, control_state, joints)
        options, R_wb = self.config.compensation, control_state.R_wb
        if options.lead_gain:
            omega = state.omega_b
            feedback = wrench - weight_wrench(control_state.snapshot, R_wb, omega, omega)
            compensation, lead = lead_feedback(compensation, feedback, R_wb, config=options, dt=self.dt)
            wrench += lead
        wrench += more
        return wrench, integrals, compensation

    def compensate(
        self, state: RobotState, reference: Reference, control_state: ControlState, joints: JointVector
    ) -> tuple[CompensationMemory, Wrench]:
        """Compute the compensations' new memory and their addition to the desired wrench; `joints` is the new q^d."""
        memory, options, dt = self.memory.compensation, self.config.compensation, self.dt
        more = np.zeros(6)
        R_wb, snapshot, omega = control_state.R_wb, control_state.snapshot, state.omega_b
        # With a reference at rest the result is bit for bit that without this compensation.
        if options.reference_gain and (reference.acceleration_w.any() or reference.alpha_b.any()):
            more += options.reference_gain * reference_wrench(snapshot, R_wb, reference)
        observed = self.config.motion == "observed"
        if not (options.momentum_gain or options.vectoring_lead or options.observer_gain or observed):
            return memory, more
        fed = more.copy()
        if options.observer_gain and self.last_step is not None and reference.support > 0.0:
            memory = replace(memory, observed_momentum=None)
        elif options.observer_gain and self.last_step is not None:
            error = control_state.error
            velocity, turning = reference.velocity_w - error.velocity_w, omega
            if options.observer_beyond:
                velocity, turning = -error.velocity_w, -error.omega_b
            memory = observe_wrench(
                snapshot, memory, R_wb, turning, velocity, self.last_step.allocation.wrench, config=options, dt=dt
            )
        if options.observer_gain:
            (of_force, _, _), (of_torque, _, _) = options.observers
            more[:3] -= of_force * (memory.external_w[:3] @ R_wb)
            more[3:] -= of_torque * (memory.external_w[3:] @ R_wb)
        position, velocity = servo_response(
            memory.servo_position, memory.servo_velocity, joints, bandwidth=options.servo_bandwidth, dt=dt
        )
        memory = replace(memory, servo_position=position, servo_velocity=velocity)
        if options.momentum_gain:
            memory = momentum_torque(snapshot, memory, omega, config=options, dt=dt)
            more[3:] += options.momentum_gain * memory.torque
            fed[3:] += options.momentum_gain * memory.torque
        if options.observer_beyond:
            fed += weight_wrench(snapshot, R_wb, omega, omega + control_state.error.omega_b)
            memory = replace(memory, fed_w=np.concatenate((R_wb @ fed[:3], R_wb @ fed[3:])))
        return memory, more

    def _hold(self) -> Command:
        command = self._led(super()._hold())
        if self.last_step is not None:
            self.last_step = replace(self.last_step, joint_velocity=np.zeros(N_JOINTS))
        return command

    def demand_at(
        self, q: JointVector, R_wb: Matrix3, vectoring: Vectoring, wrench: Wrench, reference: Reference | None = None
    ) -> Demand:
        """Build the demand of a first tick, without history, for benchmarks and tests; interference is avoided."""
        snapshot = self.model.snapshot(q, R_wb, vectoring)
        memory = fresh_memory(vectoring, np.zeros((N_ROTORS, 3)), q)
        level = Reference(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3), q)
        return self._demand(memory, snapshot, reference or level, vectoring, wrench)[0]

    def _demand(
        self,
        memory: FlightMemory,
        snapshot: Snapshot,
        reference: Reference,
        vectoring: Vectoring,
        wrench: Wrench,
        disc: Disc | None = None,
    ) -> tuple[Demand, Lock, Interference]:
        """Build the allocation's demand in the mode and with the lost modules of the `reference`."""
        return flight_demand(
            memory, self.allocator.mode(reference.mode), snapshot, vectoring, wrench,
            lost_thrust=reference.lost_thrust, lost_vectoring=reference.lost_vectoring,
            interference_config=self.config.interference, lock_config=self.config.lock, thrust_limit=self.thrust_limit,
            disc=disc,
        )  # fmt: skip

    def compute_joints(self, target: JointVector, speed_scale: float) -> tuple[JointVector, JointVector]:
        """Compute the next joint command on the straight line to `target`, and its rate: all joints arrive together.

        The joint with the longest way moves at the joint speed [Zhao2025, Tab. 1]. `speed_scale` scales all rates, but
        no joint exceeds the joint speed, which is also the servos' limit.
        """
        config, command, dt = self.config, self.memory.joint_position, self.dt
        limit = self.model.robot.joint_limit
        target = np.minimum(np.maximum(target, -limit), limit)
        if config.compensation.joint_ramp > 0.0:
            speed = config.joint_speed * min(1.0, max(0.0, speed_scale))
            return ramp_joints(
                command, self.memory.joint_velocity, target,
                speed=max(speed, 1e-6), ramp=config.compensation.joint_ramp, dt=dt,
            )  # fmt: skip
        ahead = target - command
        longest = float(np.abs(ahead).max())
        reach = config.joint_speed * dt
        if longest == 0.0:
            return command, np.zeros(N_JOINTS)
        step = ahead * min(1.0, speed_scale * reach / longest)
        following = command + np.minimum(np.maximum(step, -reach), reach)
        return following, (following - command) / dt
