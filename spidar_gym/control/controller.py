"""The stack: (state, reference, residual) → command. Snapshot, wrench, allocation, vectoring, joint targets."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3, RotorForces, Vector3, Vectoring, Wrench
from spidar_gym.control.allocator import Allocation, AllocationStatus, Allocator, AllocatorConfig
from spidar_gym.control.blocks import torque_map
from spidar_gym.control.centroidal import (
    CentroidalConfig,
    Integrals,
    MotionError,
    desired_wrench,
    integrate,
    motion_error,
    preload,
)
from spidar_gym.control.compensation import (
    CompensationConfig,
    CompensationMemory,
    fresh_compensation,
    lead_forces,
    momentum_torque,
    observe_wrench,
    ramp_joints,
    servo_response,
)
from spidar_gym.control.modes import find_allocation
from spidar_gym.control.qp import Demand
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.dynamics import Model, Snapshot
from spidar_gym.model.interference import Interference, InterferenceConfig, interference, no_interference
from spidar_gym.model.rotor import (
    Lock,
    LockConfig,
    follow,
    nominal_vectoring,
    point,
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
_ALL_FREE = np.zeros(N_ROTORS, bool)


@dataclass(frozen=True)
class ControllerConfig:
    """Everything that can be chosen about the controller."""

    allocation: str = "paper"
    """Name of the allocation's blocks, see `spidar_gym.control.modes.ALLOCATIONS`."""
    joint_speed: float = ROBOT.joint_speed
    """Speed of the planned joint motion [rad/s]; the servos are told the same limit."""
    joint_torque_limit: float = ROBOT.max_joint_torque
    """Torque that each joint servo may use [Nm]."""
    rate_hz: float = CONTROL_RATE
    """Control rate [Hz]."""
    centroidal: CentroidalConfig = field(default_factory=CentroidalConfig)
    """Gains."""
    compensation: CompensationConfig = field(default_factory=CompensationConfig)
    """What goes beyond the paper's quasi-static control."""
    allocator: AllocatorConfig = field(default_factory=AllocatorConfig)
    """Solver settings."""
    interference: InterferenceConfig = field(default_factory=InterferenceConfig)
    """Interference thresholds."""
    lock: LockConfig = field(default_factory=LockConfig)
    """φ lock."""

    def __post_init__(self) -> None:
        """Refuse speeds and limits that are not positive."""
        for name in ("joint_speed", "joint_torque_limit", "rate_hz"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and math.isfinite(value) and value > 0.0):
                raise InvalidValueError(name, value, "a number above 0")


@dataclass(frozen=True, slots=True)
class Memory:
    """All that the controller remembers from one tick to the next; a new one is a reset."""

    integrals: Integrals
    """Integrals of the errors."""
    lock: Lock
    """Held φ."""
    interference: Interference
    """Restricted rotors and chosen sides."""
    vectoring: Vectoring
    """(φ, θ) last commanded [rad]."""
    forces_l: RotorForces
    """Forces last allocated, link axes [N]."""
    joint_position: JointVector
    """q^d last commanded [rad]."""
    unallocated_w: Vector3
    """Force that the last tick could not allocate, world axes [N]."""
    unallocated_torque: Vector3
    """Torque that it could not allocate, torso axes [Nm]."""
    joint_velocity: JointVector
    """Rate of q^d in the last tick [rad/s]."""
    compensation: CompensationMemory
    """What the compensations remember."""


@dataclass(frozen=True, slots=True)
class Percept:
    """What the controller makes of a state."""

    R_wb: Matrix3
    """Attitude of the torso."""
    snapshot: Snapshot
    """Model quantities."""
    error: MotionError
    """Errors of the centroidal motion."""


@dataclass(frozen=True, slots=True)
class Tick:
    """What one tick did, for observations, plots and tests."""

    percept: Percept
    """Model quantities and errors."""
    wrench_desired: Wrench
    """w^d, residual included [N, Nm]."""
    demand: Demand
    """What the allocation was asked."""
    allocation: Allocation
    """What it answered."""
    joint_velocity: JointVector
    """Commanded joint velocity [rad/s]."""


class Controller:
    """The paper's controller for one robot; owns the model, the solver's work space and the memory."""

    def __init__(
        self,
        config: ControllerConfig | None = None,
        model: Model | None = None,
        allocator: type[Allocator] = Allocator,
    ) -> None:
        """Build the allocation (`UnknownNameError` lists the valid ones), solved by a class of one's own if given."""
        self.config = config or ControllerConfig()
        self.model = model or Model()
        self.allocator = allocator(find_allocation(self.config.allocation), self.config.allocator)
        self.dt = 1.0 / self.config.rate_hz
        self._torque_limit = np.full(N_JOINTS, self.config.joint_torque_limit)
        self.memory: Memory
        self.tick: Tick | None = None

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Forget everything.

        Args:
            state: Where the robot is; its vectoring angles are those last commanded.
            joint_position: q^d to start from [rad]; the joints of `state` by default.
            trim: Wrench in {CoG} that a hover is known to take beyond the model's [N, Nm]; the integrals start with it.
        """
        self.tick = None
        joints = state.joint_position if joint_position is None else joint_position
        forces = vectoring_to_force(state.thrust, state.vectoring)
        self.memory = _fresh_memory(state.vectoring.copy(), forces, joints.copy())
        if trim is not None:
            R_wb = quat_to_matrix(state.quat_wb)
            snapshot = self.model.snapshot(joints, R_wb, state.vectoring)
            # What the observer is going to cancel, the integrals need not hold.
            share = self.config.compensation.observer_gain
            integrals = preload(snapshot, R_wb, (1.0 - share) * trim, config=self.config.centroidal)
            external = -np.concatenate((R_wb @ trim[:3], R_wb @ trim[3:]))
            compensation = fresh_compensation(joints, external)
            self.memory = replace(self.memory, integrals=integrals, compensation=compensation)

    def rest_vectoring(self, q: JointVector) -> Vectoring:
        """(φ, θ) that a hover in the form q comes to rest near: upright, φ locked as the controller will lock it [rad].

        θ is on the branch that goes on from the flat form: −135° for the inverted outer links of form ③.
        """
        pitch = np.cumsum(q.reshape(-1, 2, 2)[:, :, 1], axis=1).reshape(-1)
        guess = np.stack([np.zeros(N_ROTORS), -pitch], axis=1)
        snapshot = self.model.snapshot(q, np.eye(3), guess)
        nominal = nominal_vectoring(snapshot.R_bl, guess)
        bounds = interference(snapshot, nominal, no_interference(), config=self.config.interference)
        lock = update_lock(
            Lock(_ALL_FREE, _ALL_FREE, nominal[:, 0]), bounds.restricted, nominal, snapshot, nominal[:, 0],
            config=replace(self.config.lock, slew=math.inf),
        )  # fmt: skip
        angles = zip(
            snapshot.R_bl[:, 2].tolist(), nominal.tolist(), lock.active.tolist(), lock.phi.tolist(), strict=True
        )
        return np.array(
            [point(up, *hat, held=phi if active else None, min_force=0.0) for up, hat, active, phi in angles]
        )

    def perceive(self, state: RobotState, reference: Reference) -> Percept:
        """What the controller makes of a state: model quantities and errors. Pure, but for the model's work space."""
        R_wb = quat_to_matrix(state.quat_wb)
        snapshot = self.model.snapshot(state.joint_position, R_wb, state.vectoring)
        return Percept(R_wb, snapshot, motion_error(state, reference, snapshot, R_wb))

    def step(
        self,
        state: RobotState,
        reference: Reference,
        residual: Residual = NO_RESIDUAL,
        percept: Percept | None = None,
    ) -> Command:
        """One control tick.

        Args:
            state: What is known of the robot.
            reference: What it should do.
            residual: What a policy adds; `NO_RESIDUAL` is the paper's controller.
            percept: `perceive(state, reference)`, where the caller has it already.

        Returns:
            The command for the next control period. `self.tick` keeps what led to it. A state or reference that is
            not finite is answered with the last command, a residual that is not finite is left out.
        """
        if not (valid_state(state) and valid_reference(reference)):
            return self._hold()
        if residual is not NO_RESIDUAL and not valid_residual(residual):
            residual = NO_RESIDUAL
        memory, options = self.memory, self.config.compensation
        percept = percept or self.perceive(state, reference)
        R_wb, snapshot, error = percept.R_wb, percept.snapshot, percept.error
        joints, speed = self._joints(reference.joint_target + residual.joint_offset, residual.joint_speed_scale)
        gains = self.config.centroidal
        integrals = integrate(
            memory.integrals, error, memory.unallocated_w, memory.unallocated_torque,
            dt=self.dt, max_speed=gains.max_integration_speed,
        )  # fmt: skip
        wrench = desired_wrench(snapshot, R_wb, state.omega_b, error, integrals, config=gains)
        compensation, more = self._compensate(state, reference, percept, joints)
        wrench += more
        wrench += residual.wrench
        demand, lock, bounds = self._demand(memory, snapshot, reference, state.vectoring, wrench)
        allocation = self.allocator.allocate(demand, reference.mode, memory.forces_l)
        if residual.forces_l is not None and residual.forces_l.any():
            allocation = self.allocator.project(demand, allocation.forces_l + residual.forces_l, memory.forces_l)
        forces = allocation.forces_l
        if options.vectoring_lead > 0.0:
            forces = lead_forces(
                forces, snapshot, state.omega_b, compensation.servo_velocity, lead=options.vectoring_lead
            )
        vectoring = follow(forces, lock, memory.vectoring, ROBOT.max_vectoring_speed * self.dt)
        self.tick = Tick(percept, wrench, demand, allocation, speed)
        unallocated = allocation.unallocated_wrench
        self.memory = Memory(
            integrals, lock, bounds, vectoring, allocation.forces_l, joints, R_wb @ unallocated[:3], unallocated[3:],
            speed, compensation,
        )  # fmt: skip
        return Command(allocation.thrust, vectoring, joints, self._torque_limit)

    def _compensate(
        self, state: RobotState, reference: Reference, percept: Percept, joints: JointVector
    ) -> tuple[CompensationMemory, Wrench]:
        """What the compensations add to the desired wrench, and what they remember; `joints` is the new q^d."""
        memory, options, dt = self.memory.compensation, self.config.compensation, self.dt
        more = np.zeros(6)
        if not (options.momentum_gain or options.vectoring_lead or options.observer_gain):
            return memory, more
        R_wb, snapshot, omega = percept.R_wb, percept.snapshot, state.omega_b
        if options.observer_gain and self.tick is not None:
            external, delivered, momentum = observe_wrench(
                snapshot, memory, R_wb, omega, reference.velocity_w - percept.error.velocity_w,
                self.tick.allocation.wrench, config=options, dt=dt,
            )  # fmt: skip
            memory = replace(memory, external_w=external, delivered_w=delivered, observed_momentum=momentum)
        if options.observer_gain:
            more[:3] = -options.observer_gain * (memory.external_w[:3] @ R_wb)
            more[3:] = -options.observer_gain * (memory.external_w[3:] @ R_wb)
        position, velocity = servo_response(
            memory.servo_position, memory.servo_velocity, joints, bandwidth=options.servo_bandwidth, dt=dt
        )
        memory = replace(memory, servo_position=position, servo_velocity=velocity)
        if options.momentum_gain:
            torque, h = momentum_torque(snapshot, memory, omega, config=options, dt=dt)
            memory = replace(memory, torque=torque, momentum=h)
            more[3:] += options.momentum_gain * torque
        return memory, more

    def _hold(self) -> Command:
        """The last command once more, its status `held`."""
        memory = self.memory
        if self.tick is not None:
            allocation = replace(self.tick.allocation, status=AllocationStatus.HELD)
            self.tick = replace(self.tick, allocation=allocation, joint_velocity=np.zeros(N_JOINTS))
        thrust = np.linalg.norm(memory.forces_l, axis=1)
        return Command(thrust, memory.vectoring, memory.joint_position, self._torque_limit)

    def note(self, command: Command) -> None:
        """Remember a command that somebody else gave."""
        forces = vectoring_to_force(command.thrust, command.vectoring)
        self.memory = replace(
            self.memory, vectoring=command.vectoring, forces_l=forces, joint_position=command.joint_position
        )

    def demand_at(
        self, q: JointVector, R_wb: Matrix3, vectoring: Vectoring, wrench: Wrench, reference: Reference | None = None
    ) -> Demand:
        """The demand of a first tick in a configuration, for benchmarks and tests: no history, interference avoided."""
        snapshot = self.model.snapshot(q, R_wb, vectoring)
        memory = _fresh_memory(vectoring, np.zeros((N_ROTORS, 3)), q)
        level = Reference(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3), q)
        return self._demand(memory, snapshot, reference or level, vectoring, wrench)[0]

    def _demand(
        self, memory: Memory, snapshot: Snapshot, reference: Reference, vectoring: Vectoring, wrench: Wrench
    ) -> tuple[Demand, Lock, Interference]:
        """What the allocation is asked: the wrench, the maps, and the rotors that are locked or restricted."""
        config = self.config
        nominal = nominal_vectoring(snapshot.R_bl, memory.vectoring)
        bounds = interference(snapshot, nominal, memory.interference, config=config.interference)
        if not self.allocator.mode(reference.mode).avoid_interference:
            bounds = replace(bounds, restricted=_ALL_FREE)
        lock = update_lock(
            memory.lock, bounds.restricted, nominal, snapshot, memory.vectoring[:, 0], config=config.lock
        )
        if reference.lost_thrust.any() or reference.lost_vectoring.any():
            lock, bounds = _without(reference, lock, bounds, vectoring)
        demand = Demand(
            wrench=wrench,
            thrust_map=thrust_map(snapshot.R_bl, snapshot.rotor_c),
            torque_map=torque_map(snapshot),
            gravity_torque=snapshot.gravity_torque,
            locked=lock.active,
            phi=lock.phi,
            restricted=bounds.restricted,
            lower=bounds.lower,
            upper=bounds.upper,
            lost=reference.lost_thrust,
        )
        return demand, lock, bounds

    def _joints(self, target: JointVector, speed_scale: float) -> tuple[JointVector, JointVector]:
        """Next joint command on the straight line to `target`, and its rate: all joints arrive together.

        The slowest joint moves at the joint speed [Zhao2025, Tab. 1]; `speed_scale` scales all, and no joint exceeds
        the joint speed, which is also what the servos allow.
        """
        config, command, dt = self.config, self.memory.joint_position, self.dt
        target = np.minimum(np.maximum(target, -ROBOT.joint_limit), ROBOT.joint_limit)
        if config.compensation.joint_ramp > 0.0:
            speed = config.joint_speed * min(1.0, max(0.0, speed_scale))
            return ramp_joints(
                command, self.memory.joint_velocity, target,
                speed=max(speed, 1e-6), ramp=config.compensation.joint_ramp, dt=dt,
            )  # fmt: skip
        way = target - command
        longest = float(np.abs(way).max())
        reach = config.joint_speed * dt
        if longest == 0.0:
            return command, np.zeros(N_JOINTS)
        step = way * min(1.0, speed_scale * reach / longest)
        following = command + np.minimum(np.maximum(step, -reach), reach)
        return following, (following - command) / dt


_NARROW = 0.01
"""Half of the wedge that stands for the one direction of a module whose vectoring is stuck [rad]."""


def _without(reference: Reference, lock: Lock, bounds: Interference, vectoring: Vectoring) -> tuple[Lock, Interference]:
    """Lock and bounds where modules are lost: no rows for those without thrust, one direction for those stuck."""
    gone, stuck = reference.lost_thrust, reference.lost_vectoring
    lock = replace(lock, active=(lock.active | stuck) & ~gone, phi=np.where(stuck, vectoring[:, 0], lock.phi))
    bounds = replace(
        bounds,
        restricted=(bounds.restricted | stuck) & ~gone,
        lower=np.where(stuck, vectoring[:, 1] - _NARROW, bounds.lower),
        upper=np.where(stuck, vectoring[:, 1] + _NARROW, bounds.upper),
    )
    return lock, bounds


def _fresh_memory(vectoring: Vectoring, forces_l: RotorForces, joint_position: JointVector) -> Memory:
    """What the controller remembers before its first tick."""
    zero = np.zeros(3)
    return Memory(
        integrals=Integrals(zero, zero),
        lock=Lock(_ALL_FREE, _ALL_FREE, vectoring[:, 0]),
        interference=no_interference(),
        vectoring=vectoring,
        forces_l=forces_l,
        joint_position=joint_position,
        unallocated_w=zero,
        unallocated_torque=zero,
        joint_velocity=np.zeros(N_JOINTS),
        compensation=fresh_compensation(joint_position, np.zeros(6)),
    )
