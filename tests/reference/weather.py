"""NumPy reference of native/engine/weather.c: wind, pushes, recirculation, noise, with the same random numbers."""

import math
from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import Vector3
from spidar_gym.sim.actuators import NOISE_BANDWIDTH
from spidar_gym.sim.disturbances import INTENSITY, LENGTH, PUSH_EVERY, PUSH_SECONDS, Disturbances
from spidar_gym.sim.recirculation import RecirculationConfig


@dataclass
class Weather:
    """State of the wind and pushes of an episode."""

    mean_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Mean wind [m/s]."""
    gust_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Turbulence [m/s]."""
    push_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Force of the present push [N]; zero between pushes."""
    next_push: float = math.inf
    """Begin of the next push [s]."""
    push_end: float = 0.0
    """End of the present push [s]."""

    @classmethod
    def draw(cls, disturbances: Disturbances, rng: np.random.Generator) -> "Weather":
        """Sample the weather at the start of an episode."""
        azimuth = rng.uniform(-math.pi, math.pi)
        mean = disturbances.wind * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        gust = disturbances.wind * INTENSITY * rng.standard_normal(3)
        first = rng.uniform(0.0, PUSH_EVERY[1]) if disturbances.push > 0.0 else math.inf
        return cls(mean, gust, np.zeros(3), first)

    def advance(self, disturbances: Disturbances, time: float, dt: float, rng: np.random.Generator) -> None:
        """Advance by `dt` [s] to `time` [s]: w ← w e^{−V dt/L} + σ √(1 − e^{−2 V dt/L}) n, V = max(wind, 1 m/s)."""
        if disturbances.wind > 0.0:
            decay = np.exp(-max(disturbances.wind, 1.0) * dt / LENGTH)
            spread = disturbances.wind * INTENSITY * np.sqrt(1.0 - decay * decay)
            self.gust_w = decay * self.gust_w + spread * rng.standard_normal(3)
        if time >= self.next_push - 1e-9:
            direction = rng.standard_normal(3)
            self.push_w = disturbances.push / math.sqrt(float(direction @ direction)) * direction
            self.push_end = time + PUSH_SECONDS
            self.next_push = time + rng.uniform(*PUSH_EVERY)
        elif time >= self.push_end - 1e-9:
            self.push_w = np.zeros(3)


def advance_eddy(eddy: np.ndarray, config: RecirculationConfig, dt: float, rng: np.random.Generator) -> np.ndarray:
    """The next state of the eddy, (6,): U, then Ω, less their means, over their standard deviations."""
    decay = np.exp(-dt / np.repeat([config.flow_seconds, config.turn_seconds], 3))
    return decay * eddy + np.sqrt(1.0 - decay * decay) * rng.standard_normal(6)


def thrust_noise(noise: np.ndarray, sigma: float, dt: float, rng: np.random.Generator) -> np.ndarray:
    """The next sample of a first-order coloured noise of standard deviation `sigma`, `dt` [s] later."""
    decay = math.exp(-2.0 * math.pi * NOISE_BANDWIDTH * dt)
    return decay * noise + sigma * math.sqrt(1.0 - decay * decay) * rng.standard_normal(noise.shape)
