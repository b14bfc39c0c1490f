"""Inter-rotor interference: computes the restricted rotors of a configuration and the bounds of their θ.

A jet that meets another rotor below, or the torso, reduces the lift. With φ held at φ̂ the vectoring range of a rotor is
an interval of angles ψ = θ − θ̂ about the torso's vertical, minus one forbidden interval per target below the rotor.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from spidar_gym.arrays import RotorMask, RotorVector, Vector3, Vectoring
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.model.rotor import HALF_PI
from spidar_gym.robot import N_ROTORS, ROBOT


@dataclass(frozen=True)
class InterferenceConfig:
    """Thresholds of the interference test; the defaults are the values that the lab flew [JSK]."""

    alpha: float = 0.4
    """α̲: a pair inclined by more than this along φ does not interfere [rad] [Zhao2025, Eq. 22]."""
    horizon: float = 1.2
    """A target farther than this from straight below is ignored: the jet of a hovering rotor misses it [rad]."""
    rotor_radius: float = 0.09
    """Radius of a rotor and of its jet: duct inner radius 0.075 m times 1.2 [m]."""
    torso_radius: float = ROBOT.torso_radius
    """Radius of the torso disc [m]."""
    width: float = 0.4
    """A subset of the range narrower than this is not used [rad]."""
    theta: float = 0.2
    """θ̲: a rotor is restricted when a bound comes nearer than this to the vertical [rad] [Zhao2025, Eq. 33]."""
    hysteresis: float = 0.05
    """A restricted rotor is released only when its bound is farther than θ̲ plus this [rad]."""
    tie: float = 0.05
    """If the distances of two subsets from the vertical differ by less than this, the previous side is kept [rad]."""


@dataclass(frozen=True, slots=True)
class Disc:
    """A horizontal disc below the rotors that no jet is to meet: the top of an object."""

    centre_c: Vector3
    """Centre from the CoG, torso axes [m]."""
    radius: float
    """Radius [m]."""


@dataclass(frozen=True, slots=True)
class Interference:
    """The valid vectoring range of each rotor."""

    restricted: RotorMask
    """𝓘: the rotors whose vectoring is restricted."""
    lower: RotorVector
    """μ̲ + θ̂: lower bound of θ [rad]; meaningful where restricted."""
    upper: RotorVector
    """μ̄ + θ̂: upper bound of θ [rad]; meaningful where restricted."""
    side: Int[np.ndarray, "8"]
    """+1 where the lower bound is the one nearer to the vertical, −1 where the upper one is."""


def no_interference() -> Interference:
    """Return the state before the first tick: no rotor is restricted, ties go to the lower bound."""
    free = np.zeros(N_ROTORS, bool)
    return Interference(free, np.full(N_ROTORS, -np.inf), np.full(N_ROTORS, np.inf), np.ones(N_ROTORS, int))


def forbidden_interval(x: float, z: float, radius: float, target_radius: float) -> tuple[float, float]:
    """Compute the angles ψ at which a jet meets a target in the plane [Zhao2025, Eq. 20, 21, 23].

    Args:
        x: Position of the target along the nominal rotor frame's x axis [m]; ψ > 0 tilts the thrust to +x and the jet
            to −x.
        z: Height of the target in that frame [m], negative below.
        radius: Radius of the jet [m].
        target_radius: Radius of the target [m].

    Returns:
        (η̲′, η̄′) [rad]: for every ψ between them the jet meets the target.
    """
    below = -z
    right, left = x + target_radius, x - target_radius
    low = -(math.atan2(right, below) + math.atan2(radius, math.hypot(right, below)))
    high = -(math.atan2(left, below) - math.atan2(radius, math.hypot(left, below)))
    return low, high


def valid_subsets(forbidden: list[tuple[float, float]], *, width: float) -> list[tuple[float, float]]:
    """Compute the disjoint intervals S″ of [−π/2, π/2] outside all forbidden intervals, at least `width` wide.

    [Zhao2025, Eq. 18, 19, 24, 25]: the intersection of the pairs' ranges as a union of isolated subsets.
    """
    subsets = [(-HALF_PI, HALF_PI)]
    for low, high in forbidden:
        subsets = [
            (a, b)
            for start, end in subsets
            for a, b in ((start, low if low < end else end), (high if high > start else start, end))
            if b - a >= width
        ]
    return subsets


def best_subset(subsets: list[tuple[float, float]], side: int, *, tie: float) -> tuple[float, float] | None:
    """Select the subset that needs the least tilt, Ŝ [Zhao2025, Eq. 26, 27].

    Args:
        subsets: Disjoint intervals of ψ [rad].
        side: +1 or −1: the side of the previous choice, which is kept if two subsets tie.
        tie: Subsets tie if their tilts differ by less than this [rad].
    """
    best, least = None, math.inf
    for subset in subsets:
        low, high = subset
        tilt = low if low > 0.0 else -high if high < 0.0 else 0.0
        if (low > 0.0 and side < 0) or (high < 0.0 and side > 0):
            tilt += tie
        if tilt < least:
            best, least = subset, tilt
    return best


def find_interference(
    snapshot: Snapshot, nominal: Vectoring, previous: Interference, *, config: InterferenceConfig,
    disc: Disc | None = None,
) -> Interference:  # fmt: skip
    """Compute the restricted rotors 𝓘 and the bounds of their θ [Zhao2025, Eq. 18-27, 33].

    Args:
        snapshot: The configuration.
        nominal: (φ̂, θ̂) of each rotor [rad].
        previous: The result of the last tick, for ties and the hysteresis of 𝓘.
        config: Thresholds.
        disc: A further target.

    Returns:
        Bounds on θ itself (θ̂ added). The torso disc counts as a target. A rotor without a valid subset keeps its full
        range; no configuration of the robot in which this happens has been found.
    """
    intervals = _forbidden_intervals(snapshot, nominal, config)
    for i, interval in {} if disc is None else _forbidden_by(disc, snapshot, nominal, config).items():
        intervals.setdefault(i, []).append(interval)
    if not intervals:
        return Interference(_NONE.restricted, _NONE.lower, _NONE.upper, previous.side)
    restricted, lower, upper = [False] * N_ROTORS, [-math.inf] * N_ROTORS, [math.inf] * N_ROTORS
    side, was, theta_hat = previous.side.tolist(), previous.restricted.tolist(), nominal[:, 1].tolist()
    for i, forbidden in intervals.items():
        best = best_subset(valid_subsets(forbidden, width=config.width), side[i], tie=config.tie)
        if best is None:
            continue
        low, high = best
        side[i] = 1 if -low <= high else -1
        restricted[i] = min(-low, high) < config.theta + (config.hysteresis if was[i] else 0.0)
        lower[i], upper[i] = low + theta_hat[i], high + theta_hat[i]
    return Interference(np.array(restricted), np.array(lower), np.array(upper), np.array(side))


_NONE = no_interference()


def _forbidden_intervals(
    snapshot: Snapshot, nominal: Vectoring, config: InterferenceConfig
) -> dict[int, list[tuple[float, float]]]:
    """Compute the forbidden intervals of each rotor with targets below it: the pairs of [Zhao2025, Eq. 22, 23]."""
    targets = [(*p, config.rotor_radius) for p in snapshot.rotor_c.tolist()]
    targets.append((*(-snapshot.com_b).tolist(), config.torso_radius))
    tan_alpha, tan_horizon = math.tan(config.alpha), math.tan(config.horizon)
    R_bl, phi_hat = snapshot.R_bl[:, :2, 1:].tolist(), nominal[:, 0].tolist()
    intervals: dict[int, list[tuple[float, float]]] = {}
    for i in range(N_ROTORS):
        x0, y0, z0, _ = targets[i]
        yx = yy = 0.0
        for x, y, z, radius in targets:
            below = z0 - z
            if below <= 0.0:
                continue
            dx, dy = x - x0, y - y0
            if yx == yy == 0.0:
                # Nominal thrust frame of rotor i: z up in the torso, y along its θ axis R_bl Rx(φ̂) ŷ, horizontal.
                c, s = math.cos(phi_hat[i]), math.sin(phi_hat[i])
                (ax, bx), (ay, by) = R_bl[i]
                yx, yy = c * ax + s * bx, c * ay + s * by
                length = math.sqrt(yx * yx + yy * yy)
                yx, yy = yx / length, yy / length
            # α = atan2(|v_y|, |v_z|) ≥ α̲, or beyond the horizon; the frame's x axis is y × z.
            if abs(dx * yx + dy * yy) >= tan_alpha * below or abs(dx * yy - dy * yx) >= tan_horizon * below:
                continue
            interval = forbidden_interval(dx * yy - dy * yx, -below, config.rotor_radius, radius)
            intervals.setdefault(i, []).append(interval)
    return intervals


NEAREST, FARTHEST = 0.02, 0.6
"""Heights of a rotor over a disc between which it avoids the disc [m]: from high above, all rotors would be restricted,
and no torque about the vertical would be left."""


def _forbidden_by(
    disc: Disc, snapshot: Snapshot, nominal: Vectoring, config: InterferenceConfig
) -> dict[int, tuple[float, float]]:
    """Compute the interval of each rotor that is forbidden by a disc, as for the torso [Zhao2025, Eq. 20, 21, 23].

    A disc is wide, so that a jet that is inclined along φ meets it as well: there is no test of α [Eq. 22].
    """
    found = {}
    for i in range(N_ROTORS):
        offset = disc.centre_c - snapshot.rotor_c[i]
        below = -float(offset[2])
        if not NEAREST < below < FARTHEST:
            continue
        y = snapshot.R_bl[i] @ (0.0, math.cos(nominal[i, 0]), math.sin(nominal[i, 0]))
        yx, yy = (y[:2] / math.hypot(y[0], y[1])).tolist()
        along, across = offset[0] * yx + offset[1] * yy, offset[0] * yy - offset[1] * yx
        reach = disc.radius + config.rotor_radius
        if abs(along) < reach and abs(across) < disc.radius + math.tan(config.horizon) * below:
            found[i] = forbidden_interval(float(across), -below, config.rotor_radius, disc.radius)
    return found
