"""The stack on the ground: (state, residual) → command. Gait, snapshot, allocation, hand-over, vectoring, joints."""

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
"""How much of their change the weights of the power cost take over in a tick."""
_ROTOR_LEG = np.arange(N_ROTORS) // 2


@dataclass(frozen=True)
class CrawlerConfig:
    """Everything that can be chosen about the crawl."""

    gait: GaitConfig = field(default_factory=GaitConfig)
    """Footsteps and phases."""
    joint_speed: float = ROBOT.joint_speed
    """Speed of the planned joint motion [rad/s]; the servos are told the same limit."""
    rate_hz: float = CONTROL_RATE
    """Control rate [Hz]."""
    torque_limit: float = 5.0
    """τ̄_q of the allocation: what it leaves below the servo's limit moves the legs [Nm]."""
    joint_torque_limit: float = ROBOT.max_joint_torque
    """Torque that each joint servo may use [Nm]."""
    torque_weight: float = 1.0
    """w₂ of [Zhao2025, Eq. 9] [1/(Nm)²]."""
    power: bool = False
    """Minimise Σ λ^1.5, electrical power, instead of the paper's Σ ‖f‖²."""
    foot_friction: float = 0.6 * ROBOT.foot_friction
    """Planned friction of the feet."""
    peg_friction: float = 0.5 * ROBOT.peg_friction
    """Planned friction of the pegs."""
    min_normal: float = 10.0
    """Least normal force of all pegs together [N]."""
    blend_time: float = 0.5
    """Time in which the forces of one mode give way to those of the next [s]."""
    feed_forward: float = 1.0
    """Share of the allocated joint torque that shifts the servos' setpoints, τ_q / k_{j,p}."""
    setpoint_filter: float = 0.0
    """Time constant of a filter on the servos' setpoints, which takes jolts out of starts and stops [s]; 0 is off."""
    leg_stiffness: float = 0.0
    """Thrust answers a lifted leg's error with this much joint torque [Nm/rad]: the paper's future work; 0 is off."""
    leg_damping: float = 0.0
    """Thrust answers the rate of that error with this much joint torque [Nm s/rad]."""
    allocator: AllocatorConfig = field(default_factory=AllocatorConfig)
    """Solver settings."""
    lock: LockConfig = field(default_factory=LockConfig)
    """φ lock near vertical links."""

    def __post_init__(self) -> None:
        """Refuse limits that are not positive."""
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
    """The crawl's controller for one robot; owns the gait, the model, the solver's work space and the memory.

    A law of one's own overrides `modes`, what the allocation is asked for, or has a gait of its own.
    """

    gait_type: ClassVar[type[Gait]] = Gait
    """The phase machine."""

    def __init__(self, config: CrawlerConfig | None = None, model: Model | None = None) -> None:
        """Build gait and allocation (`InvalidValueError` for a gait of another robot's legs than the model's)."""
        self.config = c = config or CrawlerConfig()
        check_legs(c.gait, model)
        super().__init__(model or Model(c.gait.robot), rate_hz=c.rate_hz, joint_torque_limit=c.joint_torque_limit)
        self.allocator = Allocator(self.modes(), c.allocator)
        self.gait = self.gait_type(c.gait, joint_speed=c.joint_speed, dt=self.dt)
        self.memory = fresh_crawl_memory(np.zeros((N_ROTORS, 2)), np.zeros(N_JOINTS))

    def modes(self) -> dict[str, Mode]:
        """The allocation's modes by the names that the gait gives them."""
        return self.config.modes

    def reset(self, state: RobotState, commands: Iterable[GaitCommand] = ()) -> None:
        """Forget everything: the robot lies on the floor, rotors off, and has these commands before it."""
        self.last_step = None
        q = state.joint_position
        self.gait.reset(state.position_w, quat_to_matrix(state.quat_wb), q)
        self.gait.command(commands)
        self.memory = fresh_crawl_memory(state.vectoring.copy(), q.copy())

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL) -> Command:
        """One control tick.

        Args:
            state: What is known of the robot.
            residual: What a policy adds; `NO_RESIDUAL` is the crawler alone. Its wrench is asked for beside the weight.

        Returns:
            The command for the next control period. A state that is not finite is answered with the last command, a
            residual that is not finite is left out.
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
        if thrust.max() > robot.max_thrust:
            forces = forces * np.minimum(1.0, robot.max_thrust / np.maximum(thrust, LEAST_NORM))[:, None]
            thrust = np.minimum(thrust, robot.max_thrust)
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
        """Whether every command is carried out and the forces of the last mode have faded."""
        return self.gait.done and self.memory.gap == 0.0

    def observe(self, observables: CrawlObservables, *, bound: np.ndarray) -> np.ndarray:
        """What a policy sees; see `observation.observe_crawl`."""
        return observe_crawl(observables, self.gait.memory, self.memory, bound=bound)

    def _more(self, demand: Demand, snapshot: Snapshot, allocation: Allocation, residual: Residual) -> Allocation:
        """The allocation with a policy's forces, moved to the nearest valid point; the floor's forces as they were."""
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
        """What the allocation is asked, and the rotors whose φ is held."""
        memory, config = self.memory, self.config
        nominal = nominal_vectoring(snapshot.R_bl, memory.vectoring)
        lock = update_lock(memory.lock, ALL_FREE, nominal, snapshot, memory.vectoring[:, 0], config=config.lock)
        gravity = snapshot.gravity_torque
        if mode in ("leg", "legs") and (config.leg_stiffness or config.leg_damping):
            wish = config.leg_stiffness * (plan - state.joint_position) - config.leg_damping * state.joint_velocity
            # It comes in as the mode does.
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
            effort=memory.effort, robot=snapshot.robot,
        )  # fmt: skip
        return demand, lock


def check_legs(gait: GaitConfig, model: Model | None) -> None:
    """Refuse a gait whose legs are not those of the model (`InvalidValueError`)."""
    if model is not None and model.robot != gait.robot:
        raise InvalidValueError(
            "gait.robot", f"{gait.robot.total_mass:.4g} kg", "the robot of the model: presets.for_robot(config, robot)"
        )


def with_feet(
    Q: np.ndarray, T: np.ndarray, snapshot: Snapshot, feet: Feet, R_bf: Matrix3
) -> tuple[np.ndarray, np.ndarray]:
    """Maps of rotor and foot forces to the wrench in {CoG} (6, 36) and to joint torque (16, 36).

    The quasi-static joint torque with contact is τ_q = g − Σ J_rᵀ f − Σ J_cᵀ f_c: [Zhao2025, Eq. 5] with the floor's
    forces on the feet, which act where the ball touches, straight below its centre.

    Args:
        Q: Rotor forces in link axes → wrench (6, 24).
        T: Rotor forces in link axes → joint torque (16, 24).
        snapshot: Model quantities.
        feet: Where the feet are.
        R_bf: Axes of the floor, in which foot forces are given, seen from the torso.
    """
    wide_Q, wide_T = np.empty((6, N_UNKNOWNS)), np.empty((N_JOINTS, N_UNKNOWNS))
    wide_Q[:, :N_FORCES], wide_T[:, :N_FORCES] = Q, T
    radius = snapshot.robot.foot_radius
    lever = (feet.position_b - snapshot.com_b - radius * R_bf[:, 2]) @ CROSS
    wide_Q[:3, N_FORCES:] = np.tile(R_bf, N_LEGS)
    wide_Q[3:, N_FORCES:] = (lever.reshape(N_LEGS, 3, 3) @ R_bf).transpose(1, 0, 2).reshape(3, 3 * N_LEGS)
    # The ball turns with its link: ∂(touching point)/∂q = J_c − r [axis × n].
    turn = np.cross(snapshot.joint_axes.T, -radius * R_bf[:, 2]).T
    J = feet.J + turn * (np.abs(feet.J).sum(axis=1, keepdims=True) > 0.0)
    wide_T[:, N_FORCES:] = np.einsum("lij,ik->jlk", J, R_bf).reshape(N_JOINTS, 3 * N_LEGS)
    return wide_Q, wide_T
