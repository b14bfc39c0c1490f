"""Vectoring geometry: force ↔ (λ, φ, θ), the branch nearest to the present angles, and the lock near a vertical link.

The force of a module in the axes of its link is f = λ (sin θ, −sin φ cos θ, cos φ cos θ): φ turns it about the link's
rod, θ about the axis on which the two ducts are mounted. (φ, θ) and (φ + π, π − θ) are the same force. φ is undefined
where the force lies along the rod, as it does in hover if the link is vertical.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spidar_gym.arrays import RotorForces, RotorMask, RotorVector, Vectoring
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.so3 import CROSS

TWO_PI = 2.0 * math.pi
HALF_PI = 0.5 * math.pi
MIN_FORCE = 0.5
"""Below this thrust [N] the direction of a force is ignored."""
AIM_HOLD = 0.05
"""Share of a force in torso axes that is added along the last φ, since φ is undefined for a thrust along φ's axis."""
TURN_BIAS = 0.1
"""Preference of each leg for one of the two turns to the tangential plane [rad]."""
BATTERY_VOLTAGE, BATTERY_THRUST, THRUST_PER_VOLT = 22.2, 31.8, 2.9
"""Voltage of the battery under load [V], largest thrust of a module at it [N], and its slope [N/V] [JSK]."""


def vectoring_to_force(thrust: RotorVector, vectoring: Vectoring) -> RotorForces:
    """Compute the force of each module in link axes, f = λ u(φ, θ) [N] [Zhao2025, Eq. 1]."""
    phi, theta = vectoring[:, 0], vectoring[:, 1]
    c = np.cos(theta)
    return thrust[:, None] * np.stack([np.sin(theta), -np.sin(phi) * c, np.cos(phi) * c], axis=1)


def thrust_map(R_bl: Float[np.ndarray, "8 3 3"], rotor_c: RotorForces) -> Float[np.ndarray, "6 24"]:
    """Compute the matrix from the eight forces in link axes to the total wrench in {CoG} [Zhao2025, Eq. 2].

    Args:
        R_bl: Attitude of each link.
        rotor_c: Rotor centres from the CoG, torso axes [m].

    Returns:
        Q with (f_λ, τ_λ) = Q f; columns 3i … 3i + 2 belong to rotor i. Differs from [Zhao2025, Eq. 2]: the unknowns
        are the forces themselves, because the bounds on them are constant rows in link axes.
    """
    Q = np.empty((6, 8, 3))
    Q[:3] = R_bl.transpose(1, 0, 2)
    Q[3:] = ((rotor_c @ CROSS).reshape(8, 3, 3) @ R_bl).transpose(1, 0, 2)
    return Q.reshape(6, 24)


def aim(
    R_bl: np.ndarray, forces_b: np.ndarray, sine: np.ndarray, cosine: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute λ [N], φ and θ [rad], each (…, 8), of modules whose thrusts are forces in torso axes.

    Of the two pairs (φ, θ) that point a module along its force, the one with φ closer to the last φ is used. φ is that
    of the force plus `AIM_HOLD` times its length along the last φ. The component of the force across φ's plane is
    omitted.

    Args:
        R_bl: Attitude of each link, (…, 8, 3, 3).
        forces_b: Forces in torso axes, (…, 8, 3) [N].
        sine: Sine of the last φ, (…, 8).
        cosine: Its cosine.
    """
    x, y, z = np.moveaxis((np.swapaxes(R_bl, -1, -2) * forces_b[..., None, :]).sum(axis=-1), -1, 0)
    hold = AIM_HOLD * np.sqrt(x * x + y * y + z * z)
    side = np.where(cosine * z - sine * y < 0.0, -1.0, 1.0)
    phi = np.arctan2(hold * sine - side * y, hold * cosine + side * z)
    along = np.cos(phi) * z - np.sin(phi) * y
    return np.hypot(x, along), phi, np.arctan2(x, along)


def force_to_angles(
    force_l: Sequence[float], phi0: float, theta0: float, held: float | None = None, *, min_force: float = MIN_FORCE
) -> tuple[float, float]:
    """Compute the vectoring angles (φ, θ) [rad] that point one module along its force [Zhao2025, Eq. 15, 16].

    Args:
        force_l: Force in link axes [N].
        phi0: Present φ, unwrapped [rad]. Of the equivalent solutions the one nearest to the present angles is returned,
            so the angles do not jump by π or 2π as the arctangents do.
        theta0: Present θ, unwrapped [rad].
        held: The locked φ [rad], or None; θ then follows the projection of the force on the plane that θ sweeps.
        min_force: Below this thrust [N] the direction is ignored and the present angles are returned.
    """
    fx, fy, fz = force_l
    if held is None:
        phi = math.atan2(-fy, fz)
        along = math.sqrt(fy * fy + fz * fz)  # = −f_y sin φ + f_z cos φ
    else:
        phi = held
        along = -fy * math.sin(phi) + fz * math.cos(phi)
    if fx * fx + along * along < min_force * min_force:
        return (phi0 if held is None else held), theta0
    theta = math.atan2(fx, along)
    if held is None:
        turn = phi - phi0
        if abs(turn) > HALF_PI:
            turns = round(turn / math.pi)
            phi -= math.pi * turns
            if turns % 2:
                theta = math.pi - theta
    turn = theta - theta0
    return phi, (theta if -math.pi <= turn <= math.pi else theta - TWO_PI * round(turn / TWO_PI))


def nominal_vectoring(R_bl: Float[np.ndarray, "8 3 3"], present: Vectoring) -> Vectoring:
    """Compute the angles (φ̂, θ̂) [rad] that point each rotor along the torso's z axis, on the branch of `present`.

    Solves u(φ̂, θ̂) = (0, 0, 1) in {CoG} [Zhao2025, Sec. Interrotor Aerointerference].
    """
    up_l = R_bl[:, 2].tolist()
    return np.array(
        [force_to_angles(up, *angles, min_force=0.0) for up, angles in zip(up_l, present.tolist(), strict=True)]
    )


@dataclass(frozen=True, slots=True)
class Lock:
    """State of the φ lock of each rotor."""

    vertical: RotorMask
    """Whether the link is near vertical (with hysteresis)."""
    active: RotorMask
    """Whether φ is held: near a vertical link, restricted by interference, or on its way back from either."""
    phi: RotorVector
    """The held angle [rad]; where `active` is False, the angle last commanded."""


@dataclass(frozen=True)
class LockConfig:
    """Thresholds and rates of the φ lock."""

    enter: float = 0.30
    """φ is locked when the link comes within this angle of the vertical [rad] [JSK]."""
    leave: float = 0.35
    """φ is released when the link is farther than this from the vertical [rad]."""
    slew: float = 0.04
    """A held φ moves by at most this much per tick [rad] [JSK]."""
    release: float = 0.25
    """A φ that returns to φ̂ is released within this distance, which the servo turns in one tick [rad]."""
    least: float = 0.1
    """Smallest turn from φ̂ towards the tangential plane of a φ locked near a vertical link [rad]."""
    most: float = 0.4
    """Largest turn from φ̂ towards the tangential plane of a φ locked near a vertical link [rad]."""


def update_lock(
    previous: Lock,
    restricted: RotorMask,
    nominal: Vectoring,
    snapshot: Snapshot,
    phi_command: RotorVector,
    *,
    config: LockConfig,
) -> Lock:
    """Advance the lock of φ by one tick.

    A rotor restricted by interference is held at φ̂, so that its thrust stays in the plane of [Zhao2025, Eq. 32].

    Near a vertical link φ̂ is ill-defined and every φ gives the same lift; φ only selects which horizontal force
    remains possible. The locked angle turns from φ̂ towards the plane that is **tangential** about the CoG. The turn
    grows from `least` to `most` as the link approaches the vertical, stays constant through the vertical, and shrinks
    as the link leaves. Without the turn a form of vertical links and restricted rotors would have only radial planes,
    and no yaw torque. The branch is the same on both sides of the vertical.

    A rotor that is neither restricted nor near the vertical any more moves towards φ̂ and is released before it
    arrives, because at φ̂ all planes would be radial again. Every held angle moves by at most `slew` per tick. Differs
    from the lab's implementation, which searches for the angle of the largest guaranteed wrench.

    Args:
        previous: The lock of the last tick.
        restricted: Rotors restricted by interference.
        nominal: (φ̂, θ̂) of each rotor [rad].
        snapshot: Attitude of each link and positions of the rotors.
        phi_command: φ commanded at the last tick [rad].
        config: Thresholds and slew.
    """
    enter, leave, slew = math.cos(config.enter), math.cos(config.leave), config.slew
    was_vertical, was_active, held_phi = previous.vertical.tolist(), previous.active.tolist(), previous.phi.tolist()
    command, phi_hat, is_restricted = phi_command.tolist(), nominal[:, 0].tolist(), restricted.tolist()
    vertical, active, phi = [], [], []
    for i, up in enumerate(snapshot.R_bl[:, 2, 0].tolist()):  # cosine between the link and the torso's z axis
        upright = abs(up) > (leave if was_vertical[i] else enter)
        held = held_phi[i] if was_active[i] else command[i]
        target = phi_hat[i]
        if upright:
            target = held if is_restricted[i] else _vertical_target(snapshot, i, target, held, up, config)
        # The nearest of target + kπ: both branches lie in the same plane, so turning by π is never needed.
        rest = target - held
        if abs(rest) > HALF_PI:
            rest -= math.pi * round(rest / math.pi)
        lock = upright or is_restricted[i] or (was_active[i] and abs(rest) > config.release)
        if lock:
            held += -slew if rest < -slew else slew if rest > slew else rest
        vertical.append(upright)
        active.append(lock)
        phi.append(held)
    return Lock(vertical=np.array(vertical), active=np.array(active), phi=np.array(phi))


def _vertical_target(snapshot: Snapshot, i: int, phi_hat: float, held: float, up: float, config: LockConfig) -> float:
    """Compute the target of φ of a rotor near a vertical link [rad]; see `update_lock`."""
    x, y, _ = snapshot.rotor_c[i].tolist()
    (_, y_x, z_x), (_, y_y, z_y) = snapshot.R_bl[i, :2].tolist()
    # The plane of φ contains the horizontal direction −sin φ ŷ + cos φ ẑ of the link; the tangent is ẑ × p.
    tangential = math.atan2(y_x * y - y_y * x, z_y * x - z_x * y)
    lean = math.acos(min(1.0, abs(up)))
    # Two turns lead to the same plane. φ continues in its present direction; at a tie, neighbouring legs turn in
    # opposite directions, so that tilting them all inwards or outwards makes no yaw torque.
    bias = TURN_BIAS if i // 2 % 2 == 0 else -TURN_BIAS
    if lean < 0.5 * config.leave:
        # φ̂ is ill-conditioned here: hold φ, unless it is farther from the tangential plane than `most` allows.
        off = (held - tangential + HALF_PI + bias) % math.pi - HALF_PI - bias
        room = HALF_PI - config.most
        return held + max(-room, min(room, off)) - off
    weight = max(0.0, 1.0 - lean / config.leave)
    ahead = (tangential - phi_hat) % math.pi
    back = math.pi - ahead
    forward = phi_hat + min(ahead, config.most, max(config.least, weight * ahead))
    backward = phi_hat - min(back, config.most, max(config.least, weight * back))
    return backward if abs(backward - held) + bias < abs(forward - held) else forward


def rate_limit_vectoring(forces_l: RotorForces, lock: Lock, present: Vectoring, step: float) -> Vectoring:
    """Compute the angles of the forces [rad] with locked φ held and each angle within `step` [rad] of `present`."""
    active, held = lock.active.tolist(), lock.phi.tolist()
    angles = []
    for i, (force, (phi0, theta0)) in enumerate(zip(forces_l.tolist(), present.tolist(), strict=True)):
        phi, theta = force_to_angles(force, phi0, theta0, held[i] if active[i] else None)
        angles.append((phi0 + max(-step, min(step, phi - phi0)), theta0 + max(-step, min(step, theta - theta0))))
    return np.array(angles)
