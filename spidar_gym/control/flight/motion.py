"""Motion that the flight controller feeds back: of the torso, or of the whole robot with legs that bend, observed."""

import math
from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3, RotorVector, Vector3, Wrench
from spidar_gym.control.flight.centroidal import MotionError
from spidar_gym.control.flight.compensation import external_bound
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.model.rotor import vectoring_to_force
from spidar_gym.robot import GRAVITY, N_JOINTS, N_ROTORS
from spidar_gym.state import RobotState

MOTIONS = ("complete", "quasi_static", "observed")
"""Motions that can be fed back, see `ControllerConfig.motion`."""
BEND_TIME = 0.1
"""Time constant of the high-pass behind which a joint's deviation from its plan counts as bending [s]: slower ones are
sag, and servos that differ from their model."""
MOMENTUM_TIME = 0.05
"""Time constant of both poles of the momentum's observer [s]."""
RINGING, RINGING_TIME, LEAST_SHARE = 0.15, 0.5, 0.15
"""Rate of bending above which the feedback of the attitude is reduced, by its square [rad/s], time constant with which
the largest rate fades [s], and the least share of the feedback; chosen. In forms of unequal legs, single legs of badly
damped robots ring at 35 … 75 rad/s, in the lying form all legs against the torso at 84 rad/s, until the vectoring
servos reach their speed. Joints bend by at most 0.25 rad/s in flights without ringing, and by more than 1 rad/s before
a fall."""
ROTOR_LAG, COMMAND_DELAY = 0.04, 0.03
"""Lag of the thrust, and delay of the commands, in the observer's model [s]: the largest published lag, and the delay
of the simulated robot."""
COMMANDS = 4
"""Number of remembered commands: delays are modelled up to two control periods and a part of the third."""


@dataclass(frozen=True, slots=True)
class MotionMemory:
    """State of the observer of the motion between ticks."""

    sag: JointVector | None
    """Slow part of the joints' deviation from their plan [rad]; None before the first tick."""
    plan: JointVector
    """q_s of the last tick [rad]."""
    thrust: RotorVector
    """λ̂: thrusts according to the model of the rotors [N]."""
    commands: np.ndarray
    """Thrusts [N], and wrench less the weight, world axes [N, Nm], of the last commands (4, 14), the latest first."""
    momentum_w: np.ndarray
    """p̂: linear and angular momentum of the robot, world axes [Ns, Nms]."""
    external_w: Wrench
    """ŵ: wrench that explains what the rotors and the weight leave of the momentum's rate, world axes [N, Nm]."""
    legs: Vector3
    """Angular momentum of the planned joint motion in the last tick, torso axes [Nms]."""
    ringing: float
    """Largest rate at which a joint bent, fading with `RINGING_TIME` [rad/s]."""


def fresh_motion() -> MotionMemory:
    """Return the state before the first tick."""
    return MotionMemory(
        None,
        np.zeros(N_JOINTS),
        np.zeros(N_ROTORS),
        np.zeros((COMMANDS, N_ROTORS + 6)),
        np.zeros(6),
        np.zeros(6),
        np.zeros(3),
        0.0,
    )


@dataclass(frozen=True, slots=True)
class Bending:
    """Deviation of the joints from where they would be if they did not bend."""

    angle: JointVector
    """δ [rad]."""
    rate: JointVector
    """δ̇ [rad/s]."""
    planned: JointVector
    """Joint velocities of the plan [rad/s]."""


def unbend(
    memory: MotionMemory, state: RobotState, plan: JointVector, *, dt: float
) -> tuple[MotionMemory, RobotState, Bending]:
    """Take the joints' fast deviation δ from their plan out of a state.

    Args:
        memory: State after the last tick.
        state: State of the robot.
        plan: q_s, joint angles of the model of the servos, which follows the commands [rad].
        dt: Length of the tick [s].

    Returns:
        The memory with the new sag, the state with the joints as they are without δ, and δ.
    """
    away = state.joint_position - plan
    before, last = (away, plan) if memory.sag is None else (memory.sag, memory.plan)
    sag = before + (1.0 - math.exp(-dt / BEND_TIME)) * (away - before)
    # Commands are steps, so the model's velocity at the end of a tick is not its mean.
    planned = (plan - last) / dt
    rate = planned + (sag - before) / dt
    unbent = replace(state, joint_position=plan + sag, joint_velocity=rate)
    bending = Bending(away - sag, state.joint_velocity - rate, planned)
    ringing = max(float(np.abs(bending.rate).max()), memory.ringing * math.exp(-dt / RINGING_TIME))
    return replace(memory, sag=sag, plan=plan, ringing=ringing), unbent, bending


def observe_motion(
    memory: MotionMemory,
    state: RobotState,
    bending: Bending,
    snapshot: Snapshot,
    R_wb: Matrix3,
    *,
    velocity_w: Vector3,
    thrust_map: np.ndarray,
    thrust: RotorVector,
    allocated: Wrench | None,
    dt: float,
) -> tuple[MotionMemory, np.ndarray]:
    """Observe the momentum of the whole robot, and predict it to when the next command acts.

    A thrust first bends the leg that carries the rotor, and turns the torso against the rest of the robot only then.
    Feedback of the torso's angular velocity excites this mode where the joints' damping is low, and feedback of the
    angular momentum p = IΣ ω + H (q̇ + δ̇) does not. The linear momentum is that of unbent legs: a leg that swings from
    side to side makes the encoders' late velocities appear as motion of the robot.

    p̂ ← p̂ + dt (w_λ + w_g + ŵ), then p̂ ← p̂ + (1 − a²) e and ŵ ← ŵ + (1 − a)²/dt e with e = p − p̂ and a = e^(−dt/T).
    w_λ has the measured directions of links and rotors, and the commanded thrusts behind delay and lag. From now to the
    time when the next command acts, p̂ changes by the commands that are under way [Smith1957].

    Args:
        memory: State after the last tick; its sag is not None.
        state: State of the robot, unbent.
        bending: Deviation of the joints.
        snapshot: Model quantities of the unbent robot.
        R_wb: Attitude of the torso.
        velocity_w: Velocity of the CoG of the unbent robot, world axes [m/s].
        thrust_map: Forces in the axes of the measured links → wrench in {CoG} (6, 24).
        thrust: Thrusts last commanded [N].
        allocated: Wrench of the last tick's allocation, {CoG} [N, Nm]; None in the first tick.
        dt: Length of the tick [s].

    Returns:
        The new memory, and the predicted momentum without that of the planned joint motion, world axes [Ns, Nms].
    """
    H = snapshot.momentum_map[3:]
    legs, sinking = H @ bending.planned, H @ (state.joint_velocity - bending.planned)
    angular = snapshot.inertia_c @ state.omega_b + legs + sinking + H @ bending.rate
    measured = np.concatenate((snapshot.mass * velocity_w, R_wb @ angular))
    Q, down = thrust_map, snapshot.mass * GRAVITY
    (ticks, part), bound = _late(dt), external_bound(snapshot)
    before = legs if allocated is None else memory.legs
    if allocated is None:
        delivered = _to_world(Q @ vectoring_to_force(state.thrust, state.vectoring).reshape(-1), R_wb, down)
        # The robot is taken to be in balance, so ŵ is what the rotors leave of the weight.
        commands = np.tile(np.concatenate((state.thrust, delivered)), (COMMANDS, 1))
        balance = np.minimum(np.maximum(-delivered, -bound), bound)
        memory = replace(
            memory, thrust=state.thrust.copy(), commands=commands, momentum_w=measured, external_w=balance, legs=legs
        )
    else:
        asked = np.concatenate((thrust, _to_world(allocated, R_wb, down)))
        commands = np.vstack((asked, memory.commands[:-1]))
        reached = (1.0 - part) * commands[ticks, :N_ROTORS] + part * commands[ticks + 1, :N_ROTORS]
        modelled = memory.thrust + (1.0 - math.exp(-dt / ROTOR_LAG)) * (reached - memory.thrust)
        delivered = _to_world(Q @ vectoring_to_force(modelled, state.vectoring).reshape(-1), R_wb, down)
        momentum = memory.momentum_w + dt * (delivered + memory.external_w)
        miss = measured - momentum
        decay = math.exp(-dt / MOMENTUM_TIME)
        external = memory.external_w + (1.0 - decay) ** 2 / dt * miss
        external = np.minimum(np.maximum(external, -bound), bound)
        momentum = momentum + (1.0 - decay * decay) * miss
        memory = replace(
            memory, thrust=modelled, commands=commands, momentum_w=momentum, external_w=external, legs=legs
        )
    # The planned joint motion has its share of the momentum, now and then.
    coming_legs = legs + sinking + COMMAND_DELAY / dt * (legs - before)
    predicted, wrench = memory.momentum_w - np.concatenate((np.zeros(3), R_wb @ coming_legs)), delivered
    for k in range(ticks, -1, -1):
        span = part * dt if k == ticks else dt
        coming, share = commands[k, N_ROTORS:], 1.0 - math.exp(-span / ROTOR_LAG)
        predicted = predicted + span * (coming + memory.external_w) + ROTOR_LAG * share * (wrench - coming)
        wrench = wrench + share * (coming - wrench)
    return memory, predicted


def _late(dt: float) -> tuple[int, float]:
    """Return the commands' delay in whole ticks, and the part of a tick beyond them."""
    late = min(COMMAND_DELAY / dt, COMMANDS - 1.0 - 1e-9)
    return int(late), late - int(late)


def _to_world(wrench: Wrench, R_wb: Matrix3, down: float) -> Wrench:
    """Return a wrench in {CoG} in world axes, less the weight `down` [N]."""
    turned = np.concatenate((R_wb @ wrench[:3], R_wb @ wrench[3:]))
    turned[2] -= down
    return turned


def whole_motion(
    memory: MotionMemory,
    error: MotionError,
    predicted_w: np.ndarray,
    state: RobotState,
    bending: Bending,
    snapshot: Snapshot,
    R_wb: Matrix3,
    *,
    velocity_w: Vector3,
) -> tuple[MotionError, Vector3]:
    """Compute the errors of the whole robot and its angular velocity, torso axes [rad/s], when the next command acts.

    Its attitude is the torso's, turned by IΣ⁻¹ H δ. While legs ring, the errors of attitude and angular velocity are
    reduced, so that the vectoring servos can follow.

    Args:
        memory: State of the observer, of this tick.
        error: Errors of the unbent robot and of the torso's attitude.
        predicted_w: Predicted momentum, without that of the planned joint motion, world axes [Ns, Nms].
        state: State of the robot, unbent.
        bending: Deviation of the joints.
        snapshot: Model quantities of the unbent robot.
        R_wb: Attitude of the torso.
        velocity_w: Velocity of the CoG of the unbent robot, world axes [m/s].
    """
    H = snapshot.momentum_map[3:]
    right = np.column_stack((predicted_w[3:] @ R_wb, H @ bending.angle))
    turning, turned = np.linalg.solve(snapshot.inertia_c, right).T
    velocity = error.velocity_w + velocity_w - predicted_w[:3] / snapshot.mass
    omega = error.omega_b + state.omega_b - turning
    share = max(LEAST_SHARE, (RINGING / max(memory.ringing, RINGING)) ** 2)
    return MotionError(
        position_w=error.position_w + COMMAND_DELAY * velocity, velocity_w=velocity,
        attitude=share * (error.attitude - turned + COMMAND_DELAY * omega), omega_b=share * omega,
    ), turning  # fmt: skip
