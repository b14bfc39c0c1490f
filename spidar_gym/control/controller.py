"""The stack: (state, reference, residual) → command. Snapshot, wrench, allocation, vectoring, joint targets."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3, RotorForces, Vector3, Vectoring, Wrench
from spidar_gym.control.allocator import Allocation, AllocationStatus, Allocator, AllocatorConfig
from spidar_gym.control.blocks import torque_map
from spidar_gym.control.centroidal import (
    CentroidalConfig,
    Integrals,
    MotionError,
    clip,
    desired_wrench,
    integrate,
)
from spidar_gym.control.modes import preset
from spidar_gym.control.qp import Demand
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.dynamics import Model, Snapshot
from spidar_gym.model.interference import Interference, InterferenceConfig, interference, no_interference
from spidar_gym.model.rotor import (
    Lock,
    LockConfig,
    nominal_vectoring,
    point,
    thrust_map,
    update_lock,
    vectoring_to_force,
)
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.so3 import quat_to_matrix, vee
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState

CONTROL_RATE = 40.0
"""Control rate [Hz] [Zhao2025, Sec. Robot Platform]."""
_ALL_FREE = np.zeros(N_ROTORS, bool)


@dataclass(frozen=True)
class ControllerConfig:
    """Everything that can be chosen about the controller."""

    preset: str = "paper"
    """Name of the allocation's blocks, see `spidar_gym.control.modes.PRESETS`."""
    joint_speed: float = ROBOT.joint_speed
    """Speed of the planned joint motion [rad/s]; the servos are told the same limit."""
    joint_torque_limit: float = ROBOT.max_joint_torque
    """Torque that each joint servo may use [Nm]."""
    rate_hz: float = CONTROL_RATE
    """Control rate [Hz]."""
    centroidal: CentroidalConfig = field(default_factory=CentroidalConfig)
    """Gains."""
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

    def __init__(self, config: ControllerConfig | None = None, model: Model | None = None) -> None:
        """Build the allocation named by the preset (`UnknownNameError` lists the valid ones)."""
        self.config = config or ControllerConfig()
        self.model = model or Model()
        self.allocator = Allocator(preset(self.config.preset), self.config.allocator)
        self.dt = 1.0 / self.config.rate_hz
        self._torque_limit = np.full(N_JOINTS, self.config.joint_torque_limit)
        self.memory: Memory
        self.tick: Tick | None = None

    def reset(self, state: RobotState, joint_position: JointVector | None = None) -> None:
        """Forget everything; start from the vectoring angles of `state` and from its joints or `joint_position`."""
        self.tick = None
        joints = state.joint_position if joint_position is None else joint_position
        forces = vectoring_to_force(state.thrust, state.vectoring)
        self.memory = _fresh_memory(state.vectoring.copy(), forces, joints.copy())

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
        if not (_valid_state(state) and _valid_reference(reference)):
            return self._hold()
        if residual is not NO_RESIDUAL and not _finite_residual(residual):
            residual = NO_RESIDUAL
        memory = self.memory
        percept = percept or self.perceive(state, reference)
        R_wb, snapshot, error = percept.R_wb, percept.snapshot, percept.error
        integrals = integrate(memory.integrals, error, memory.unallocated_w, memory.unallocated_torque, dt=self.dt)
        wrench = desired_wrench(snapshot, R_wb, state.omega_b, error, integrals, config=self.config.centroidal)
        wrench += residual.wrench
        demand, lock, bounds = self._demand(memory, snapshot, reference.mode, wrench)
        allocation = self.allocator.allocate(demand, reference.mode, memory.forces_l)
        if residual.forces_l is not None and residual.forces_l.any():
            allocation = self.allocator.project(demand, allocation.forces_l + residual.forces_l, memory.forces_l)
        vectoring = self._vectoring(allocation.forces_l, lock)
        joints = self._joints(reference.joint_target + residual.joint_offset, residual.joint_speed_scale)
        self.tick = Tick(percept, wrench, demand, allocation, (joints - memory.joint_position) / self.dt)
        unallocated = allocation.unallocated_wrench
        self.memory = Memory(
            integrals, lock, bounds, vectoring, allocation.forces_l, joints, R_wb @ unallocated[:3], unallocated[3:]
        )
        return Command(allocation.thrust, vectoring, joints, self._torque_limit)

    def _hold(self) -> Command:
        """The last command once more, its status `held`."""
        memory = self.memory
        if self.tick is not None:
            allocation = replace(self.tick.allocation, status=AllocationStatus.HELD)
            self.tick = replace(self.tick, allocation=allocation, joint_velocity=np.zeros(N_JOINTS))
        thrust = np.linalg.norm(memory.forces_l, axis=1)
        return Command(thrust, memory.vectoring, memory.joint_position, self._torque_limit)

    def demand_at(self, q: JointVector, R_wb: Matrix3, vectoring: Vectoring, wrench: Wrench) -> Demand:
        """The demand of a first tick in a configuration, for benchmarks and tests: no history, interference avoided."""
        snapshot = self.model.snapshot(q, R_wb, vectoring)
        memory = _fresh_memory(vectoring, np.zeros((N_ROTORS, 3)), q)
        return self._demand(memory, snapshot, "flight", wrench)[0]

    def _demand(
        self, memory: Memory, snapshot: Snapshot, mode: str, wrench: Wrench
    ) -> tuple[Demand, Lock, Interference]:
        """What the allocation is asked: the wrench, the maps, and the rotors that are locked or restricted."""
        config = self.config
        nominal = nominal_vectoring(snapshot.R_bl, memory.vectoring)
        bounds = interference(snapshot, nominal, memory.interference, config=config.interference)
        if not self.allocator.mode(mode).avoid_interference:
            bounds = replace(bounds, restricted=_ALL_FREE)
        lock = update_lock(
            memory.lock, bounds.restricted, nominal, snapshot, memory.vectoring[:, 0], config=config.lock
        )
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
        )
        return demand, lock, bounds

    def _vectoring(self, forces_l: RotorForces, lock: Lock) -> Vectoring:
        """Angles for the allocated forces, φ held where it is locked, nothing faster than the servos."""
        step = ROBOT.max_vectoring_speed * self.dt
        active, held = lock.active.tolist(), lock.phi.tolist()
        angles = []
        for i, (force, (phi0, theta0)) in enumerate(
            zip(forces_l.tolist(), self.memory.vectoring.tolist(), strict=True)
        ):
            phi, theta = point(force, phi0, theta0, held[i] if active[i] else None)
            angles.append((phi0 + clip(phi - phi0, step), theta0 + clip(theta - theta0, step)))
        return np.array(angles)

    def _joints(self, target: JointVector, speed_scale: float) -> JointVector:
        """Next joint command on the straight line to `target`: all joints arrive together [Zhao2025, Tab. 1].

        The slowest joint moves at the joint speed; `speed_scale` scales all, and no joint exceeds the joint speed,
        which is also what the servos allow.
        """
        command = self.memory.joint_position
        way = np.minimum(np.maximum(target, -ROBOT.joint_limit), ROBOT.joint_limit) - command
        longest = float(np.abs(way).max())
        reach = self.config.joint_speed * self.dt
        if longest == 0.0:
            return command
        step = way * min(1.0, speed_scale * reach / longest)
        return command + np.minimum(np.maximum(step, -reach), reach)


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
    )


def _valid_state(state: RobotState) -> bool:
    """Whether every number that the controller reads of the state is finite, and the attitude is one."""
    numbers = np.concatenate(
        (
            state.position_w, state.quat_wb, state.velocity_w, state.omega_b, state.joint_position,
            state.joint_velocity, state.vectoring.reshape(-1),
        )
    )  # fmt: skip
    # A tracking system that has lost the robot may send a quaternion of zeros.
    return math.isfinite(float(numbers @ numbers)) and float(state.quat_wb @ state.quat_wb) > 0.25


def _valid_reference(reference: Reference) -> bool:
    numbers = np.concatenate(
        (
            reference.position_w, reference.quat_wb, reference.velocity_w, reference.omega_b, reference.joint_target,
        )
    )  # fmt: skip
    return math.isfinite(float(numbers @ numbers)) and float(reference.quat_wb @ reference.quat_wb) > 0.25


def _finite_residual(residual: Residual) -> bool:
    square = float(residual.wrench @ residual.wrench) + float(residual.joint_offset @ residual.joint_offset)
    if residual.forces_l is not None:
        square += float(np.vdot(residual.forces_l, residual.forces_l))
    return math.isfinite(square + residual.joint_speed_scale)


def motion_error(state: RobotState, reference: Reference, snapshot: Snapshot, R_wb: np.ndarray) -> MotionError:
    """e_r, ė_r, e_R, e_ω of the CoG's motion, desired − actual [Zhao2025, Eq. 6, 7]."""
    rows = R_wb.tolist()
    com = snapshot.com_b.tolist()
    # Velocity of the CoG against the torso's origin, torso axes: the turning torso's share and the moving joints'.
    x, y, z = state.omega_b.tolist()
    vx, vy, vz = (snapshot.momentum_map[:3] @ state.joint_velocity).tolist()
    m, (cx, cy, cz) = snapshot.mass, com
    relative = (vx / m + y * cz - z * cy, vy / m + z * cx - x * cz, vz / m + x * cy - y * cx)
    R_error = R_wb.T @ quat_to_matrix(reference.quat_wb)
    return MotionError(
        position_w=_offset(reference.position_w, state.position_w, rows, com),
        velocity_w=_offset(reference.velocity_w, state.velocity_w, rows, relative),
        attitude=vee(R_error),
        omega_b=R_error @ reference.omega_b - state.omega_b,
    )


def _offset(desired: np.ndarray, actual: np.ndarray, rows: list[list[float]], shift: Sequence[float]) -> np.ndarray:
    """Desired − (actual + R shift), in plain numbers: arrays of three cost more than their arithmetic."""
    x, y, z = shift
    return np.array(
        [
            d - a - (r[0] * x + r[1] * y + r[2] * z)
            for d, a, r in zip(desired.tolist(), actual.tolist(), rows, strict=True)
        ]
    )
