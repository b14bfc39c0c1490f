"""How much gain and delay a controller's loops bear: each axis of the centroidal motion as a loop of its own.

An axis is a double integrator behind the actuators, D(s) = e^{−Ts} / (1 + τs). With the PID C(s) and the observer
F(s) = 1 / (1 + T_o s), or its square, whose share g of the estimate is cancelled, the loop is
L = D (C + g F s²) / (1 − g F D_m) / s², D_m the observer's belief about D. A lead compensator is part of C.
"""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.control.flight.controller import ControllerConfig

DELAY = 0.040
"""T: half a hold of 25 ms, the command's way and the estimator's, on the robot [s]."""
LAG = 0.035
"""τ: of thrust and vectoring servos [s]."""
FREQUENCIES = np.geomspace(0.02, 200.0, 8000)
"""Where the loops are looked at [rad/s]."""
AXES = ("x, y", "z", "roll, pitch", "yaw")
"""The loops that differ."""


@dataclass(frozen=True)
class Margins:
    """Margins of one loop."""

    gain: float
    """The loop's gain may rise by this factor."""
    phase: float
    """Phase margin at the gain crossover [rad]."""
    delay: float
    """More delay than the modelled one that it bears [s]."""
    sensitivity: float
    """Largest |1 / (1 + L)|; 1 over it is the distance from −1."""
    noise: float
    """What white noise of the rate makes of the commanded acceleration, RMS over RMS: how the rotors tremble [1/s]."""


def loop(
    config: ControllerConfig, axis: int, omega: np.ndarray, *, delay: float, lag: float
) -> tuple[np.ndarray, np.ndarray]:
    """L(iω) of one of `AXES`, and what the controller makes of the rate in it, both with the loop open."""
    centroidal, options = config.centroidal, config.compensation
    rows = (centroidal.position_gains[0], centroidal.position_gains[2], *centroidal.attitude_gains[1:])
    kp, ki, kd = rows[axis]
    s = 1j * omega
    D = np.exp(-s * delay) / (1.0 + lag * s)
    gain, time, belief = options.observers[axis // 2]
    observer = gain / (1.0 + time * s) ** options.observer_order
    believed = 1.0 / (1.0 + belief * s)
    kept = np.exp(-1.0 / (config.rate_hz * options.lead_time))  # of the low-pass, from tick to tick
    slow = (1.0 - kept) / (1.0 - kept * np.exp(-s / config.rate_hz))
    lead = 1.0 + options.lead_gain * (1.0 - slow)
    within = 1.0 - observer * believed
    of_rate = (kd * lead + observer * s) / within
    return D * ((kp + ki / s + kd * s) * lead + observer * s * s) / within / (s * s), of_rate


def margins(config: ControllerConfig, axis: int, *, delay: float = DELAY, lag: float = LAG) -> Margins:
    """Margins of one of `AXES`; all zero for a loop that is unstable."""
    return margins_of(*loop(config, axis, FREQUENCIES, delay=delay, lag=lag), rate_hz=config.rate_hz)


def margins_of(L: np.ndarray, of_rate: np.ndarray, *, rate_hz: float) -> Margins:
    """Margins of a loop; all zero, and infinite noise, for one that is unstable.

    Args:
        L: L(iω) at `FREQUENCIES`.
        of_rate: Commanded acceleration over rate there, the loop open.
        rate_hz: Rate of the ticks.
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
        return Margins(0.0, 0.0, 0.0, float("inf"), float("inf"))
    k = crossing[0]
    phase = float(angle[k] + np.pi)
    above = turning[turning > k]
    return Margins(
        gain=float(1.0 / size[above].max()) if len(above) else float("inf"),
        phase=phase,
        delay=phase / float(omega[k]),
        sensitivity=float(np.abs(1.0 / (1.0 + L)).max()),
        noise=_noise(of_rate / (1.0 + L), np.pi * rate_hz),
    )


def _noise(closed: np.ndarray, nyquist: float) -> float:
    """RMS gain of white noise up to a frequency, from what the closed loop makes of it at `FREQUENCIES`."""
    heard = nyquist >= FREQUENCIES
    return math.sqrt(float(np.trapezoid(np.abs(closed[heard]) ** 2, FREQUENCIES[heard])) / nyquist)
