"""Centroidal motion control: position PID and SO(3) attitude control → desired wrench, with anti-windup."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.arrays import Matrix3, Vector3, Wrench
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.robot import GRAVITY
from spidar_gym.so3 import quat_to_matrix, vee
from spidar_gym.state import Reference, RobotState

MISSED_FORCE, MISSED_TORQUE = 1.0, 0.1
"""An axis whose unallocated demand exceeds this does not integrate further in that direction [N], [Nm]."""
Gains = tuple[float, float, float]
"""P, I and D of one axis."""


@dataclass(frozen=True)
class CentroidalConfig:
    """Gains as flown [JSK]; every gain yields an acceleration, so none depends on mass or form."""

    position_gains: tuple[Gains, Gains, Gains] = ((3.6, 0.03, 4.0), (3.6, 0.03, 4.0), (2.8, 1.2, 2.8))
    """k_{f,p} [1/s²], k_{f,i} [1/s³], k_{f,d} [1/s] of x, y and z."""
    attitude_gains: tuple[Gains, Gains, Gains] = ((15.0, 0.3, 5.0), (15.0, 0.3, 5.0), (10.0, 0.1, 5.0))
    """k_{τ,p} [1/s²], k_{τ,i} [1/s³], k_{τ,d} [1/s] about x, y and z."""
    max_position_error: tuple[float, float, float] = (10.0, 10.0, 1.0)
    """Errors are clipped to ± this before k_{f,p} [m]."""
    max_attitude_error: tuple[float, float, float] = (1.0, 1.0, 0.4)
    """Attitude errors are clipped to ± this before k_{τ,p}."""
    max_term: tuple[float, float, float] = (10.0, 10.0, 20.0)
    """Each of the terms P, I, D of the position is clipped to ± this [m/s²]."""
    max_acceleration: tuple[float, float, float] = (10.0, 10.0, 28.0)
    """The sum of the position's terms is clipped to ± this [m/s²]."""
    max_integration_speed: float = 0.1
    """An axis whose velocity error exceeds this does not integrate its position error [m/s]."""
    max_angular_acceleration: float = 10.0
    """The attitude's terms and their sum are clipped to ± this [rad/s²]."""


@dataclass(frozen=True, slots=True)
class MotionError:
    """Errors of the centroidal motion, desired − actual, in the frames of the equations."""

    position_w: Vector3
    """e_r [m], world."""
    velocity_w: Vector3
    """ė_r [m/s], world."""
    attitude: Vector3
    """e_R = ½ (RᵀR^d − R^dᵀR)^∨, torso axes; about the rotation vector [rad] while small."""
    omega_b: Vector3
    """e_ω [rad/s], torso axes."""


@dataclass(frozen=True, slots=True)
class Integrals:
    """∫e_r [m s] and ∫e_R [rad s]."""

    position_w: Vector3
    """World axes."""
    attitude: Vector3
    """Torso axes."""


def clip(value: float, limit: float) -> float:
    """Clip `value` to ± `limit`."""
    return -limit if value < -limit else limit if value > limit else value


def _pid(gains: Gains, error: float, integral: float, rate: float, max_error: float, max_term: float) -> float:
    """Compute k_p e + k_i ∫e + k_d ė, with the error clipped before k_p and each term clipped after it."""
    kp, ki, kd = gains
    return clip(kp * clip(error, max_error), max_term) + clip(ki * integral, max_term) + clip(kd * rate, max_term)


def desired_wrench(
    snapshot: Snapshot,
    R_wb: Matrix3,
    omega_b: Vector3,
    error: MotionError,
    integrals: Integrals,
    *,
    config: CentroidalConfig,
) -> Wrench:
    """Compute w^d in {CoG} [N, Nm]: position PID with gravity, attitude PID with gyroscopic term [Zhao2025, Eq. 6-8].

    Args:
        snapshot: Mass and centroidal inertia.
        R_wb: Attitude of the torso.
        omega_b: Angular velocity, torso axes [rad/s].
        error: Errors, desired − actual.
        integrals: Integrals of the errors.
        config: Gains and limits.
    """
    e, s, v = error.position_w.tolist(), integrals.position_w.tolist(), error.velocity_w.tolist()
    gains, bounds, terms, limits = (
        config.position_gains, config.max_position_error, config.max_term, config.max_acceleration
    )  # fmt: skip
    a = [clip(_pid(gains[k], e[k], s[k], v[k], bounds[k], terms[k]), limits[k]) for k in (0, 1, 2)]
    a[2] += GRAVITY
    e, s, v = error.attitude.tolist(), integrals.attitude.tolist(), error.omega_b.tolist()
    gains, bounds, limit = config.attitude_gains, config.max_attitude_error, config.max_angular_acceleration
    alpha = [clip(_pid(gains[k], e[k], s[k], v[k], bounds[k], limit), limit) for k in (0, 1, 2)]
    x, y, z = omega_b.tolist()
    I = snapshot.inertia_c
    hx, hy, hz = (I @ omega_b).tolist()
    wrench = np.empty(6)
    np.matmul(np.array(a), R_wb, out=wrench[:3])
    wrench[:3] *= snapshot.mass
    np.matmul(I, np.array(alpha), out=wrench[3:])
    wrench[3:] += (y * hz - z * hy, z * hx - x * hz, x * hy - y * hx)
    return wrench


def warm_start_integrals(snapshot: Snapshot, R_wb: Matrix3, trim: Wrench, *, config: CentroidalConfig) -> Integrals:
    """Compute the integrals whose terms equal a known trim wrench; 0 on axes without an integral gain.

    Args:
        snapshot: Mass and centroidal inertia.
        R_wb: Attitude of the torso.
        trim: Wrench in {CoG} [N, Nm].
        config: Gains.
    """
    acceleration, angular = R_wb @ trim[:3] / snapshot.mass, np.linalg.solve(snapshot.inertia_c, trim[3:])
    gains = np.array([config.position_gains, config.attitude_gains])[:, :, 1]
    values = np.divide([acceleration, angular], gains, out=np.zeros((2, 3)), where=gains > 0.0)
    return Integrals(values[0], values[1])


def integrate(
    integrals: Integrals,
    error: MotionError,
    unallocated_w: Vector3,
    unallocated_torque: Vector3,
    *,
    dt: float,
    max_speed: float = math.inf,
) -> Integrals:
    """Advance the integrals by one tick, except along axes whose demand the allocation could not meet.

    The integral of an axis stays constant when part of the axis' demand went unallocated and the error would push the
    demand further in that direction (anti-windup) [Zhao2025, Eq. 6, 7]. The integral of a position axis also stays
    constant while the velocity error exceeds `max_speed`, because the position error is then a transient, not a bias.

    Args:
        integrals: ∫e_r, ∫e_R before the tick.
        error: Errors of the tick.
        unallocated_w: Desired minus allocated force of the last tick, world axes [N].
        unallocated_torque: Desired minus allocated torque of the last tick, torso axes [Nm].
        dt: Control period [s].
        max_speed: Largest velocity error at which a position axis integrates [m/s].
    """
    position = _advance(integrals.position_w, error.position_w, unallocated_w, MISSED_FORCE, dt)
    if max_speed < math.inf:
        position = np.where(np.abs(error.velocity_w) > max_speed, integrals.position_w, position)
    return Integrals(
        position,
        _advance(integrals.attitude, error.attitude, unallocated_torque, MISSED_TORQUE, dt),
    )


def _advance(integral: Vector3, error: Vector3, unallocated: Vector3, threshold: float, dt: float) -> Vector3:
    """Compute ∫e + e dt on the axes whose unallocated demand is below `threshold` or opposed to the error."""
    return np.array(
        [
            i if abs(missing) > threshold and missing * e > 0.0 else i + dt * e
            for i, e, missing in zip(integral.tolist(), error.tolist(), unallocated.tolist(), strict=True)
        ]
    )


def motion_error(state: RobotState, reference: Reference, snapshot: Snapshot, R_wb: np.ndarray) -> MotionError:
    """Compute e_r, ė_r, e_R, e_ω of the CoG's motion, desired − actual [Zhao2025, Eq. 6, 7]."""
    rows = R_wb.tolist()
    com = snapshot.com_b.tolist()
    # Velocity of the CoG relative to the torso's origin, torso axes: from the torso's rotation and the moving joints.
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


def quasi_static_error(error: MotionError, state: RobotState, snapshot: Snapshot, R_wb: np.ndarray) -> MotionError:
    """Remove the share of the moving joints from ė_r: the CoG then moves as if fixed to the torso [JSK]."""
    share = (snapshot.momentum_map[:3] @ state.joint_velocity) / snapshot.mass
    return replace(error, velocity_w=error.velocity_w + R_wb @ share)


def _offset(desired: np.ndarray, actual: np.ndarray, rows: list[list[float]], shift: Sequence[float]) -> np.ndarray:
    """Compute desired − (actual + R shift) with Python floats, which is faster than numpy for three numbers."""
    x, y, z = shift
    return np.array(
        [
            d - a - (r[0] * x + r[1] * y + r[2] * z)
            for d, a, r in zip(desired.tolist(), actual.tolist(), rows, strict=True)
        ]
    )
