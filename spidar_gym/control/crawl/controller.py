"""Crawl controller: (state, residual) → command, by gait, snapshot, allocation, hand-over, vectoring and joints."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3
from spidar_gym.control.allocation.allocator import LEAST_NORM, Allocation, AllocationStatus, Allocator, AllocatorConfig
from spidar_gym.control.allocation.blocks import torque_map
from spidar_gym.control.allocation.contact import effort_weights, most_peg_friction
from spidar_gym.control.allocation.modes import ground_modes
from spidar_gym.control.allocation.problem import N_FORCES, N_UNKNOWNS, Demand, Mode
from spidar_gym.control.crawl.footsteps import GaitCommand, GaitConfig
from spidar_gym.control.crawl.gait import Gait
from spidar_gym.control.crawl.memory import CrawlMemory, CrawlRecord, fresh_crawl_memory
from spidar_gym.control.crawl.observation import CrawlObservables, observe_crawl
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.readable import ReadableController
from spidar_gym.control.rotors import ALL_FREE
from spidar_gym.errors import InvalidValueError, require_not_negative
from spidar_gym.model.dynamics import Feet, Model, Snapshot
from spidar_gym.model.rotor import (
    Lock,
    LockConfig,
    nominal_vectoring,
    rate_limit_vectoring,
    thrust_map,
    update_lock,
)
from spidar_gym.robot import GRAVITY, N_JOINTS, N_LEGS, N_ROTORS, ROBOT
from spidar_gym.so3 import CROSS, quat_to_matrix
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState, valid_residual, valid_state

EFFORT_SHARE = 0.1
"""Share of their change by which the weights of the power cost are updated per tick."""
_ROTOR_LEG = np.arange(N_ROTORS) // 2


@dataclass(frozen=True)
class CrawlerConfig:
    """Configuration of the crawler."""

    gait: GaitConfig = field(default_factory=GaitConfig)
    """Footsteps and phases."""
    joint_speed: float = ROBOT.joint_speed
    """Speed of the planned joint motion [rad/s]; the servos have the same limit."""
    rate_hz: float = CONTROL_RATE
    """Control rate [Hz]."""
    torque_limit: float = 5.0
    """τ̄_q of the allocation [Nm]; the margin to the servo's limit moves the legs."""
    joint_torque_limit: float = ROBOT.max_joint_torque
    """Torque that each joint servo may use [Nm]."""
    torque_weight: float = 1.0
    """w₂ of [Zhao2025, Eq. 9] [1/(Nm)²]."""
    power: bool = False
    """Whether to minimise Σ λ^1.5, electrical power, instead of the paper's Σ ‖f‖²."""
    foot_friction: float = 0.6 * ROBOT.foot_friction
    """Planned friction of the feet."""
    peg_friction: float = 0.5 * ROBOT.peg_friction
    """Planned friction of the pegs."""
    min_normal: float = 10.0
    """Smallest normal force of all pegs together [N]."""
    blend_time: float = 0.5
    """Time in which the forces fade from one mode to the next [s]."""
    feed_forward: float = 1.0
    """Share of the allocated joint torque that shifts the servos' setpoints, τ_q / k_{j,p}."""
    setpoint_filter: float = 0.0
    """Time constant of a filter on the servos' setpoints, which smooths starts and stops [s]; 0 is off."""
    leg_stiffness: float = 0.0
    """Joint torque by thrust per position error of a lifted leg [Nm/rad]: the paper's future work; 0 is off."""
    leg_damping: float = 0.0
    """Joint torque by thrust per joint velocity of a lifted leg, opposed to it [Nm s/rad]."""
    allocator: AllocatorConfig = field(default_factory=AllocatorConfig)
    """Solver settings."""
    lock: LockConfig = field(default_factory=LockConfig)
    """φ lock near vertical links."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for limits out of range."""
        numbers = {
            name: value for name, value in vars(self).items() if isinstance(value, int | float) and name != "power"
        }
        require_not_negative(**numbers)
        for name in ("joint_speed", "rate_hz", "torque_limit", "joint_torque_limit", "foot_friction", "peg_friction"):
            if numbers[name] == 0.0:
                raise InvalidValueError(name, 0.0, "a number above 0")
        if self.peg_friction >= (most := most_peg_friction(self.gait.robot)):
            raise InvalidValueError("peg_friction", self.peg_friction, f"a number below {most:.2f}")

    @property
    def modes(self) -> dict[str, Mode]:
        """The allocation's modes on the ground by name."""
        return ground_modes(
            power=self.power, torque_weight=self.torque_weight, torque_limit=self.torque_limit,
            foot_friction=self.foot_friction, peg_friction=self.peg_friction, min_normal=self.min_normal,
        )  # fmt: skip


class Crawler(ReadableController[CrawlMemory, CrawlRecord]):
    """The crawl controller for one robot; owns the gait, the model, the solver's workspace and the memory.

    A custom control law overrides `modes`, which defines the allocation, or `gait_type`.
    """

    gait_type: ClassVar[type[Gait]] = Gait
    """The phase machine."""

    def __init__(self, config: CrawlerConfig | None = None, model: Model | None = None) -> None:
        """Build gait and allocation (`InvalidValueError` if the gait's robot is not the model's)."""
        self.config = c = config or CrawlerConfig()
        check_legs(c.gait, model)
        super().__init__(model or Model(c.gait.robot), rate_hz=c.rate_hz, joint_torque_limit=c.joint_torque_limit)
        self.allocator = Allocator(self.modes(), c.allocator)
        self.gait = self.gait_type(c.gait, joint_speed=c.joint_speed, dt=self.dt)
        self.memory = fresh_crawl_memory(np.zeros((N_ROTORS, 2)), np.zeros(N_JOINTS))

    def modes(self) -> dict[str, Mode]:
        """Return the allocation's modes by the names that the gait uses."""
        return self.config.modes

    def reset(self, state: RobotState, commands: Iterable[GaitCommand] = ()) -> None:
        """Clear the memory and queue these commands; the robot lies on the floor with its rotors off."""
        self.last_step = None
        q = state.joint_position
        self.gait.reset(state.position_w, quat_to_matrix(state.quat_wb), q)
        self.gait.command(commands)
        self.memory = fresh_crawl_memory(state.vectoring.copy(), q.copy())

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL) -> Command:
        """Compute the command of one control tick.

        Args:
            state: State of the robot.
            residual: Additions of a policy; `NO_RESIDUAL` is the crawler alone. Its wrench is added to the weight's.

        Returns:
            The command for the next control period. If the state is not finite, the last command is repeated. A
            residual that is not finite is ignored.
        """
        memory, config = self.memory, self.config
        if not valid_state(state):
            return self._hold()
        if residual is not NO_RESIDUAL and not valid_residual(residual):
            residual = NO_RESIDUAL
        R_wb = quat_to_matrix(state.quat_wb)
        plan = self.gait.step(state.position_w, R_wb, state.joint_position, residual)
        mode, lifted = self.gait.mode, self.gait.lifted
        snapshot, feet = self.model.stance(state.joint_position, R_wb, state.vectoring)
        demand, lock = self._demand(state, plan, R_wb, snapshot, feet, mode, lifted, residual)
        allocation = self.allocator.allocate(demand, mode, memory.forces_l, memory.active)
        active = allocation.active
        if residual.forces_l is not None or residual.leg_forces_b is not None:
            allocation = self._more(demand, snapshot, allocation, residual)
        torque = np.where(np.repeat(lifted, 4), allocation.joint_torques, 0.0)
        force_gap, torque_gap, gap = memory.force_gap, memory.torque_gap, memory.gap
        if mode != memory.mode:
            force_gap, torque_gap = memory.forces_l - allocation.forces_l, memory.joint_torque - torque
            gap = 1.0
        gap = max(0.0, gap - self.dt / config.blend_time) if config.blend_time > 0.0 else 0.0
        forces, torque = allocation.forces_l, torque + gap * torque_gap
        if gap > 0.0:
            forces = forces + gap * force_gap
        thrust = np.sqrt(np.einsum("ij,ij->i", forces, forces))
        robot = self.model.robot
        if thrust.max() > demand.max_thrust:
            forces = forces * np.minimum(1.0, demand.max_thrust / np.maximum(thrust, LEAST_NORM))[:, None]
            thrust = np.minimum(thrust, demand.max_thrust)
        vectoring = rate_limit_vectoring(forces, lock, memory.vectoring, robot.max_vectoring_speed * self.dt)
        joints = plan + config.feed_forward / robot.joint_kp * torque + residual.joint_offset
        if config.setpoint_filter > 0.0:
            joints = memory.joint_position + (1.0 - math.exp(-self.dt / config.setpoint_filter)) * (
                joints - memory.joint_position
            )
        joints = np.minimum(np.maximum(joints, -robot.joint_limit), robot.joint_limit)
        effort = memory.effort
        if config.power:
            effort = effort_weights(allocation.thrust, effort, EFFORT_SHARE, robot.hover_thrust)
        self.last_step = CrawlRecord(allocation, forces, mode, self.gait.phase, demand)
        self.memory = CrawlMemory(
            lock, vectoring, forces, torque, joints, mode, force_gap, torque_gap, gap, effort, active
        )
        return Command(thrust, vectoring, joints, self._torque_limit)

    @property
    def done(self) -> bool:
        """Whether every command is executed and the forces of the last mode have faded."""
        return self.gait.done and self.memory.gap == 0.0

    def observe(self, observables: CrawlObservables, *, bound: np.ndarray) -> np.ndarray:
        """Compute the observation of a policy; see `observation.observe_crawl`."""
        return observe_crawl(observables, self.gait.memory, self.memory, bound=bound)

    def _more(self, demand: Demand, snapshot: Snapshot, allocation: Allocation, residual: Residual) -> Allocation:
        """Add a policy's forces to the allocation and move them to the nearest valid point; foot forces stay fixed."""
        wish = np.zeros((N_ROTORS, 3)) if residual.forces_l is None else residual.forces_l
        if residual.leg_forces_b is not None:
            shares = 0.5 * np.repeat(residual.leg_forces_b, 2, axis=0)
            wish = wish + np.einsum("ij,ijk->ik", shares, snapshot.R_bl)
        if not wish.any():
            return allocation
        feet = allocation.foot_forces_f.reshape(-1)[: demand.thrust_map.shape[1] - N_FORCES]
        fixed = replace(
            demand,
            wrench=demand.wrench - demand.thrust_map[:, N_FORCES:] @ feet,
            thrust_map=demand.thrust_map[:, :N_FORCES],
            torque_map=demand.torque_map[:, :N_FORCES],
            gravity_torque=demand.gravity_torque - demand.torque_map[:, N_FORCES:] @ feet,
        )
        more = self.allocator.project(fixed, allocation.forces_l + wish, self.memory.forces_l)
        if allocation.status in (AllocationStatus.SOFTENED, AllocationStatus.HELD):
            more = replace(more, status=allocation.status, slack=allocation.slack)
        wrench = more.wrench + demand.wrench - fixed.wrench
        return replace(more, foot_forces_f=allocation.foot_forces_f, wrench=wrench)

    def _demand(
        self, state: RobotState, plan: JointVector, R_wb: Matrix3, snapshot: Snapshot, feet: Feet, mode: str,
        lifted: np.ndarray, residual: Residual,
    ) -> tuple[Demand, Lock]:  # fmt: skip
        """Build the allocation's demand and update the φ lock."""
        memory, config = self.memory, self.config
        nominal = nominal_vectoring(snapshot.R_bl, memory.vectoring)
        lock = update_lock(memory.lock, ALL_FREE, nominal, snapshot, memory.vectoring[:, 0], config=config.lock)
        gravity = snapshot.gravity_torque
        if mode in ("leg", "legs") and (config.leg_stiffness or config.leg_damping):
            wish = config.leg_stiffness * (plan - state.joint_position) - config.leg_damping * state.joint_velocity
            # The feedback fades in with the mode.
            arrived = 1.0 - memory.gap if mode == memory.mode else 0.0
            gravity = gravity + np.where(np.repeat(lifted, 4), arrived * wish, 0.0)
        Q, T = thrust_map(snapshot.R_bl, snapshot.rotor_c), torque_map(snapshot)
        R_bf = R_wb.T @ self.gait.memory.floor_R
        if self.allocator.mode(mode).feet_carry:
            Q, T = with_feet(Q, T, snapshot, feet, R_bf)
        wrench = np.zeros(6)
        wrench[:3] = snapshot.mass * GRAVITY * R_wb[2]
        if mode != "rest":
            wrench += residual.wrench
        demand = Demand(
            wrench=wrench, thrust_map=Q, torque_map=T, gravity_torque=gravity, locked=lock.active, phi=lock.phi,
            restricted=ALL_FREE, lower=np.zeros(N_ROTORS), upper=np.zeros(N_ROTORS),
            lost=~lifted[_ROTOR_LEG] if mode == "leg" else ALL_FREE, lifted=lifted, com_b=snapshot.com_b, R_bf=R_bf,
            effort=memory.effort, thrust_limit=self.thrust_limit, robot=snapshot.robot,
        )  # fmt: skip
        return demand, lock


def check_legs(gait: GaitConfig, model: Model | None) -> None:
    """Raise `InvalidValueError` if the gait's robot is not the model's."""
    if model is not None and model.robot != gait.robot:
        raise InvalidValueError(
            "gait.robot", f"{gait.robot.total_mass:.4g} kg", "the robot of the model: presets.for_robot(config, robot)"
        )


def with_feet(
    Q: np.ndarray, T: np.ndarray, snapshot: Snapshot, feet: Feet, R_bf: Matrix3
) -> tuple[np.ndarray, np.ndarray]:
    """Build the maps of rotor and foot forces to the wrench in {CoG} (6, 36) and to joint torque (16, 36).

    The quasi-static joint torque with contact is τ_q = g − Σ J_rᵀ f − Σ J_cᵀ f_c: [Zhao2025, Eq. 5] with the floor's
    forces on the feet, which act at the contact point straight below the centre of the ball.

    Args:
        Q: Rotor forces in link axes → wrench (6, 24).
        T: Rotor forces in link axes → joint torque (16, 24).
        snapshot: Model quantities.
        feet: Positions and Jacobians of the feet.
        R_bf: Rotation from floor axes, in which foot forces are expressed, to torso axes.
    """
    wide_Q, wide_T = np.empty((6, N_UNKNOWNS)), np.empty((N_JOINTS, N_UNKNOWNS))
    wide_Q[:, :N_FORCES], wide_T[:, :N_FORCES] = Q, T
    radius = snapshot.robot.foot_radius
    lever = (feet.position_b - snapshot.com_b - radius * R_bf[:, 2]) @ CROSS
    wide_Q[:3, N_FORCES:] = np.tile(R_bf, N_LEGS)
    wide_Q[3:, N_FORCES:] = (lever.reshape(N_LEGS, 3, 3) @ R_bf).transpose(1, 0, 2).reshape(3, 3 * N_LEGS)
    # The ball turns with its link: ∂(contact point)/∂q = J_c − r [axis × n].
    turn = np.cross(snapshot.joint_axes.T, -radius * R_bf[:, 2]).T
    J = feet.J + turn * (np.abs(feet.J).sum(axis=1, keepdims=True) > 0.0)
    wide_T[:, N_FORCES:] = np.einsum("lij,ik->jlk", J, R_bf).reshape(N_JOINTS, 3 * N_LEGS)
    return wide_Q, wide_T
