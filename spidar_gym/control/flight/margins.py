"""Stability margins of a controller's loops: each axis of the centroidal motion is treated as a separate loop.

An axis is a double integrator behind the actuators, D(s) = e^{−Ts} / (1 + τs). C(s) is the PID and F(s) the observer's
low-pass, 1 / (1 + T_o s) or its square. A share g of the observer's estimate is cancelled, and D_m is its model of D.
Then the loop is L = D (C + g F s²) / (1 − g F D_m) / s². A lead compensator is part of C.
"""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.control.flight.controller import ControllerConfig

DELAY = 0.040
"""T: half a control period of 25 ms, plus the delays of command and estimator on the robot [s]."""
LAG = 0.035
"""τ: lag of thrust and vectoring servos [s]."""
FREQUENCIES = np.geomspace(0.02, 200.0, 8000)
"""Frequencies at which the loops are evaluated [rad/s]."""
AXES = ("x, y", "z", "roll, pitch", "yaw")
"""Axes with different loops."""


@dataclass(frozen=True)
class Margins:
    """Margins of one loop."""

    gain: float
    """Gain margin: factor by which the loop's gain may rise."""
    phase: float
    """Phase margin at the gain crossover [rad]."""
    delay: float
    """Delay margin beyond the modelled delay [s]."""
    sensitivity: float
    """Largest |1 / (1 + L)|; its inverse is the distance of L from −1."""
    noise: float
    """Commanded acceleration per white noise of the rate, RMS over RMS: a measure of the rotors' activity [1/s]."""
    crossover: float
    """Frequency at which the loop's gain falls below 1, its bandwidth [rad/s]; 0 for an unstable loop."""


def loop(
    config: ControllerConfig, axis: int, omega: np.ndarray, *, delay: float, lag: float
) -> tuple[np.ndarray, np.ndarray]:
    """Compute L(iω) of one of `AXES` and the controller's response to the rate, both with the loop open."""
    centroidal, options = config.centroidal, config.compensation
    rows = (centroidal.position_gains[0], centroidal.position_gains[2], *centroidal.attitude_gains[1:])
    kp, ki, kd = rows[axis]
    s = 1j * omega
    D = np.exp(-s * delay) / (1.0 + lag * s)
    gain, time, belief = options.observers[axis // 2]
    observer = gain / (1.0 + time * s) ** options.observer_order
    believed = 1.0 / (1.0 + belief * s)
    kept = np.exp(-1.0 / (config.rate_hz * options.lead_time))  # decay of the low-pass per tick
    slow = (1.0 - kept) / (1.0 - kept * np.exp(-s / config.rate_hz))
    lead = 1.0 + options.lead_gain * (1.0 - slow)
    within = 1.0 - observer * believed
    of_rate = (kd * lead + observer * s) / within
    return D * ((kp + ki / s + kd * s) * lead + observer * s * s) / within / (s * s), of_rate


def margins(config: ControllerConfig, axis: int, *, delay: float = DELAY, lag: float = LAG) -> Margins:
    """Compute the margins of one of `AXES`; those of an unstable loop are as in `margins_of`."""
    return margins_of(*loop(config, axis, FREQUENCIES, delay=delay, lag=lag), rate_hz=config.rate_hz)


def margins_of(L: np.ndarray, of_rate: np.ndarray, *, rate_hz: float) -> Margins:
    """Compute the margins of a loop; an unstable loop has zero margins and infinite sensitivity and noise.

    Args:
        L: L(iω) at `FREQUENCIES`.
        of_rate: Commanded acceleration over rate at `FREQUENCIES`, with the loop open.
        rate_hz: Control rate [Hz].
    """
    omega = FREQUENCIES
    angle = np.unwrap(np.angle(L))
    size = np.abs(L)
    # Below the first frequency L is a triple integrator with its phase at −270°, or a double one at −180°.
    start = -1.5 * np.pi if abs(angle[0] % (2 * np.pi) - np.pi / 2) < 0.7 else -np.pi
    angle += start - angle[0] + np.remainder(angle[0] - start + np.pi, 2 * np.pi) - np.pi
    crossing = np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))
    turning = np.flatnonzero(np.diff(np.sign(angle + np.pi)) != 0)
    if len(crossing) != 1 or angle[crossing[0]] <= -np.pi:
        return Margins(0.0, 0.0, 0.0, float("inf"), float("inf"), 0.0)
    k = crossing[0]
    phase = float(angle[k] + np.pi)
    above = turning[turning > k]
    return Margins(
        gain=float(1.0 / size[above].max()) if len(above) else float("inf"),
        phase=phase,
        delay=phase / float(omega[k]),
        sensitivity=float(np.abs(1.0 / (1.0 + L)).max()),
        noise=_noise(of_rate / (1.0 + L), np.pi * rate_hz),
        crossover=float(omega[k]),
    )


def _noise(closed: np.ndarray, nyquist: float) -> float:
    """Compute the RMS gain of white noise up to a frequency from the closed loop's response at `FREQUENCIES`."""
    heard = nyquist >= FREQUENCIES
    return math.sqrt(float(np.trapezoid(np.abs(closed[heard]) ** 2, FREQUENCIES[heard])) / nyquist)
