"""Compensations for moving legs, slow servos, external wrenches and accelerating references; all off by default.

The paper's controller is quasi-static: it treats the legs' motion and everything unmodelled as disturbances for its
integrals. These are the classical alternatives. All are pure functions of a small memory.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3, RotorForces, Vector3, Wrench
from spidar_gym.errors import InvalidValueError, require_not_negative
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.robot import GRAVITY, N_JOINTS, N_ROTORS
from spidar_gym.so3 import exp, quat_to_matrix
from spidar_gym.state import Reference

MAX_EXTERNAL_SHARE, MAX_EXTERNAL_TORQUE = 0.5, 10.0
"""Limits ± of the observed external force (share of the weight) and torque [Nm], in case the observer is wrong."""


@dataclass(frozen=True)
class CompensationConfig:
    """Gains and time constants of the compensations; all zero is the paper's controller, bit for bit."""

    momentum_gain: float = 0.0
    """Share of the legs' angular momentum rate that is fed forward as a torque; 0 is off [Orin2013]."""
    momentum_filter: float = 0.02
    """Time constant of the first-order filter of that torque [s]."""
    servo_bandwidth: float = 40.0
    """Natural frequency of the joint servo model that predicts the legs' momentum [rad/s]."""
    vectoring_lead: float = 0.0
    """Forces are expressed in the link axes predicted for this much later [s]; 0 is off."""
    observer_gain: float = 0.0
    """Share of the observed external wrench that is cancelled; 0 is off [DeLuca2006] [Zhao2020]."""
    observer_time: float = 0.25
    """Time constant of the observer [s]."""
    observer_beyond: bool = False
    """Whether the observer uses the momentum of the error and excludes the feed-forward wrench, so that errors of its
    rotor model do not make feed-forward torques appear as a disturbance."""
    observer_order: int = 1
    """Order of the observer's low-pass: 1, or 2 for two equal ones in series, with less noise and more lag."""
    observer_lag: float = 0.05
    """Time constant of the observer's model of the rotors [s]."""
    torque_observer_gain: float = 0.0
    """Share of the observed torque that is cancelled; 0: as for the force."""
    torque_observer_time: float = 0.0
    """Time constant of the observer of the torque [s]; 0: as for the force."""
    torque_observer_lag: float = 0.0
    """Time constant of the rotor model for the torque [s]; 0: as for the force."""
    lead_gain: float = 0.0
    """ρ of the lead compensator 1 + ρ (1 − 1/(1 + T s)) on the feedback, which adds phase; 0 is off [Franklin2019]."""
    lead_time: float = 0.1
    """T of the lead compensator [s]."""
    joint_ramp: float = 0.0
    """Time in which the commanded joints reach their speed [s], which limits their acceleration; 0 is off."""
    reference_gain: float = 0.0
    """Share of the reference's acceleration that is fed forward; 0 is off [Lee2010]."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for gains and time constants out of range."""
        if type(self.observer_order) is not int or self.observer_order not in (1, 2):
            raise InvalidValueError("observer_order", self.observer_order, "1 or 2")
        require_not_negative(**vars(self))
        for name in ("servo_bandwidth", "observer_time", "lead_time"):
            if getattr(self, name) <= 0.0:
                raise InvalidValueError(name, getattr(self, name), "a number above 0")

    @property
    def observers(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Gain, time constant [s] and rotor model's time constant [s] of the observers of force and of torque."""
        force = (self.observer_gain, self.observer_time, self.observer_lag)
        torque = (self.torque_observer_gain, self.torque_observer_time, self.torque_observer_lag)
        gain, time, lag = (own or other for own, other in zip(torque, force, strict=True))
        return force, (gain, time, lag)


@dataclass(frozen=True, slots=True)
class CompensationMemory:
    """State of the compensations between ticks."""

    servo_position: JointVector
    """Joint angles of the servo model [rad]."""
    servo_velocity: JointVector
    """Joint velocities of the servo model [rad/s]."""
    momentum: Vector3 | None
    """Angular momentum of the legs at the last tick, torso axes [Nms]; None before the first."""
    torque: Vector3
    """Filtered feed-forward torque [Nm]."""
    observed_momentum: np.ndarray | None
    """Linear and angular momentum of the robot at the last tick, world axes [Ns, Nms]; None before the first."""
    delivered_w: Wrench
    """Wrench of the rotors according to the observer's model, world axes [N, Nm]."""
    external_w: Wrench
    """Observed external wrench, world axes [N, Nm]."""
    residual_w: Wrench
    """Output of the first of two low-passes of the observer, world axes [N, Nm]."""
    fed_w: Wrench
    """Wrench that was fed forward in the last tick, including the weight, world axes [N, Nm]."""
    slow_w: Wrench | None
    """Feedback behind the low-pass of the lead compensator, world axes [N, Nm]; None before the first tick."""


def fresh_compensation(joint_position: JointVector, external_w: np.ndarray) -> CompensationMemory:
    """Return the state at rest, with a known external wrench, world axes [N, Nm]."""
    rest, zero = np.zeros(N_JOINTS), np.zeros(6)
    return CompensationMemory(joint_position, rest, None, np.zeros(3), None, zero, external_w, external_w, zero, None)


def servo_response(
    position: JointVector, velocity: JointVector, command: JointVector, *, bandwidth: float, dt: float
) -> tuple[JointVector, JointVector]:
    """Advance a critically damped second-order servo by one tick, exactly, for a constant command.

    Args:
        position: q of the model [rad].
        velocity: q̇ of the model [rad/s].
        command: q^d [rad].
        bandwidth: Natural frequency ω [rad/s]; q̈ = ω² (q^d − q) − 2 ω q̇.
        dt: Length of the tick [s].
    """
    decay = math.exp(-bandwidth * dt)
    e = position - command
    slope = velocity + bandwidth * e
    return command + decay * (e + dt * slope), decay * (velocity - bandwidth * dt * slope)


def momentum_torque(
    snapshot: Snapshot, memory: CompensationMemory, omega_b: Vector3, *, config: CompensationConfig, dt: float
) -> CompensationMemory:
    """Update the torque that changes the legs' angular momentum, and that momentum, for the next tick.

    Full centroidal dynamics: L = IΣ ω + h(q, q̇), so τ = ḣ + ω × h beyond [Zhao2025, Eq. 4], which omits h. The servo
    model, driven by the commanded joints, yields h, so no measurement is differentiated.
    """
    h = snapshot.momentum_map[3:] @ memory.servo_velocity
    rate = np.zeros(3) if memory.momentum is None else (h - memory.momentum) / dt
    x, y, z = omega_b.tolist()
    hx, hy, hz = h.tolist()
    wanted = rate + np.array([y * hz - z * hy, z * hx - x * hz, x * hy - y * hx])
    smoothing = 1.0 - math.exp(-dt / config.momentum_filter) if config.momentum_filter > 0.0 else 1.0
    return replace(memory, torque=memory.torque + smoothing * (wanted - memory.torque), momentum=h)


def reference_wrench(snapshot: Snapshot, R_wb: Matrix3, reference: Reference) -> Wrench:
    """Compute the wrench in {CoG} of the reference's acceleration: m r̈ᵈ and I ω̇ᵈ [N, Nm].

    Args:
        snapshot: Mass and centroidal inertia.
        R_wb: Attitude of the torso.
        reference: Reference with the accelerations.
    """
    alpha_w = quat_to_matrix(reference.quat_wb) @ reference.alpha_b
    force_b = snapshot.mass * (reference.acceleration_w @ R_wb)
    return np.concatenate((force_b, snapshot.inertia_c @ (alpha_w @ R_wb)))


def weight_wrench(snapshot: Snapshot, R_wb: Matrix3, omega_b: Vector3, turning_b: Vector3) -> Wrench:
    """Compute the wrench in {CoG} that balances the weight and the gyroscopic torque ω × IΣ ω′ [N, Nm].

    Args:
        snapshot: Mass and centroidal inertia.
        R_wb: Attitude of the torso.
        omega_b: ω, angular velocity of the torso, torso axes [rad/s].
        turning_b: ω′, angular velocity of the momentum, torso axes [rad/s].
    """
    x, y, z = omega_b.tolist()
    hx, hy, hz = (snapshot.inertia_c @ turning_b).tolist()
    weight = snapshot.mass * GRAVITY * R_wb[2]
    return np.concatenate((weight, (y * hz - z * hy, z * hx - x * hz, x * hy - y * hx)))


def lead_feedback(
    memory: CompensationMemory, feedback: Wrench, R_wb: Matrix3, *, config: CompensationConfig, dt: float
) -> tuple[CompensationMemory, Wrench]:
    """Compute the addition of the lead compensator: ρ times the high-passed feedback [Franklin2019].

    Args:
        memory: State after the last tick.
        feedback: Wrench of the PIDs, {CoG} [N, Nm].
        R_wb: Attitude of the torso.
        config: ρ and the time constant.
        dt: Length of the tick [s].
    """
    asked = np.concatenate((R_wb @ feedback[:3], R_wb @ feedback[3:]))
    last = asked if memory.slow_w is None else memory.slow_w  # the initial feedback passes without lead
    slow = last + (1.0 - math.exp(-dt / config.lead_time)) * (asked - last)
    more = config.lead_gain * (asked - slow)
    return replace(memory, slow_w=slow), np.concatenate((more[:3] @ R_wb, more[3:] @ R_wb))


def lead_forces(
    forces_l: RotorForces, snapshot: Snapshot, omega_b: Vector3, joint_velocity: JointVector, *, lead: float
) -> RotorForces:
    """Express the forces in the axes that the links will have `lead` [s] later, as setpoints for slow servos.

    Args:
        forces_l: Forces in the present link axes [N].
        snapshot: Joint axes and attitudes of the links.
        omega_b: Angular velocity of the torso, torso axes [rad/s].
        joint_velocity: q̇ of the servo model [rad/s].
        lead: Prediction time [s].
    """
    rates = (snapshot.joint_axes * joint_velocity).reshape(3, -1, 4)
    inner = rates[:, :, 0] + rates[:, :, 1]
    outer = inner + rates[:, :, 2] + rates[:, :, 3]
    omega = np.stack([inner, outer], axis=2).reshape(3, N_ROTORS).T + omega_b
    turn_l = -lead * (omega[:, None] @ snapshot.R_bl)[:, 0]
    return np.array([exp(turn) @ force for turn, force in zip(turn_l, forces_l, strict=True)])


def observe_wrench(
    snapshot: Snapshot,
    memory: CompensationMemory,
    R_wb: Matrix3,
    omega_b: Vector3,
    velocity_w: Vector3,
    allocated: Wrench,
    *,
    config: CompensationConfig,
    dt: float,
) -> CompensationMemory:
    """Update the momentum observer: ŵ ← ŵ + dt/T (ṗ − w_λ − w_g − ŵ), the residual of the momentum [DeLuca2006].

    With a gain of 1 and no integral gains this is incremental inversion of the centroidal dynamics [Smeur2016]: the new
    command is the last one, filtered like the momentum's rate, plus the missing acceleration. With a low-pass of order
    2 it is the extended state observer of a velocity, at bandwidth 1/T [Gao2003]. Tests compare it with both.

    With `observer_beyond` the feed-forward wrench, w_g and the legs' h are excluded on both sides, and the momentum is
    that of the error. A rotor time constant above the real one increases the stability margin. Without
    `observer_beyond` it would also make the observer expect feed-forward wrenches too late.

    Args:
        snapshot: Mass, inertia, momentum map.
        memory: State after the last tick.
        R_wb: Attitude of the torso.
        omega_b: Angular velocity, or with `observer_beyond` its excess over the reference, torso axes [rad/s].
        velocity_w: Velocity of the CoG, or with `observer_beyond` its excess over the reference, world [m/s]; with
            the motion `quasi_static` without the share of the joints, whose momentum then appears as a force.
        allocated: Wrench of the last tick's allocation, {CoG} [N, Nm].
        config: Time constants.
        dt: Length of the tick [s].

    Returns:
        The memory with the observed wrench, the modelled wrench of the rotors, and the momentum.
    """
    L = snapshot.inertia_c @ omega_b
    if not config.observer_beyond:
        L = L + snapshot.momentum_map[3:] @ memory.servo_velocity
    momentum = np.concatenate((snapshot.mass * velocity_w, R_wb @ L))
    asked = np.concatenate((R_wb @ allocated[:3], R_wb @ allocated[3:]))
    if config.observer_beyond:
        asked = asked - memory.fed_w
    if memory.observed_momentum is None:
        return replace(memory, delivered_w=asked, observed_momentum=momentum)
    smoothings = [1.0 - math.exp(-dt / lag) if lag > 0.0 else 1.0 for _, _, lag in config.observers]
    delivered = memory.delivered_w + np.repeat(smoothings, 3) * (asked - memory.delivered_w)
    residual = (momentum - memory.observed_momentum) / dt - delivered
    if not config.observer_beyond:
        residual[2] += snapshot.mass * GRAVITY
    share = np.repeat([1.0 - math.exp(-dt / time) for _, time, _ in config.observers], 3)
    passed = residual
    if config.observer_order == 2:
        passed = memory.residual_w + share * (residual - memory.residual_w)
    external = memory.external_w + share * (passed - memory.external_w)
    bound = external_bound(snapshot)
    external = np.minimum(np.maximum(external, -bound), bound)
    return replace(memory, external_w=external, residual_w=passed, delivered_w=delivered, observed_momentum=momentum)


def external_bound(snapshot: Snapshot) -> Wrench:
    """Return the limits ± of an observed external wrench [N, Nm]."""
    return np.repeat([MAX_EXTERNAL_SHARE * snapshot.robot.weight, MAX_EXTERNAL_TORQUE], 3)


def ramp_joints(
    command: np.ndarray, velocity: np.ndarray, target: np.ndarray,
    *, speed: float | np.ndarray, ramp: float | np.ndarray, dt: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Compute the next joint command towards `target` and its velocity, with accelerations up to speed/ramp.

    All joints arrive together.

    Args:
        command: q^d (…, 16) [rad].
        velocity: Rate of q^d in the last tick (…, 16) [rad/s].
        target: Target joint angles (…, 16) [rad].
        speed: Speed of the joint with the longest way, a scalar or (…, 1) [rad/s].
        ramp: Time from rest to that speed, a scalar or (…, 1) [s].
        dt: Length of the tick [s].
    """
    ahead = target - command
    longest = np.abs(ahead).max(axis=-1, keepdims=True)
    step = speed / ramp * dt
    # Speed, (n + f) steps, from which the command comes to rest on the target if it loses one step per tick. The
    # distance is (n + f) + (n − 1 + f) + … + f = (n + 1) (n/2 + f) steps times dt.
    far = longest / (step * dt)
    n = np.floor(np.sqrt(0.25 + 2.0 * far) - 0.5 + 1e-9)
    reach = step * (n + (far - 0.5 * n * (n + 1.0)) / (n + 1.0))
    change = ahead * (np.minimum(speed, reach) / np.where(longest > 0.0, longest, 1.0)) - velocity
    most = np.abs(change).max(axis=-1, keepdims=True)
    change = np.where(most > step * (1.0 + 1e-9), change * (step / np.where(most > 0.0, most, 1.0)), change)
    velocity = velocity + change
    following = command + dt * velocity
    there = np.abs(target - following).max(axis=-1, keepdims=True) < 1e-9
    return np.where(there, target, following), velocity
