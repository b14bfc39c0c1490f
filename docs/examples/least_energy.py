"""A custom task: stay near a commanded place with as little energy as possible."""

from dataclasses import replace

import numpy as np

from spidar_gym.envs.registry import HOVER, register_task
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import draw_start

NEAR, HOVERS = 0.2, 3000.0
"""Distance without a penalty [m]; approximate power of a hover with all rotors upright [W]."""


class LeastEnergy(HoverTask):
    """Hold a form near a place; the reward falls with the power."""

    reward_terms = {
        "power": (0.7, "1 / (1 + P / 3000 W)"),
        "near": (0.2, "1 within 0.2 m of the place, falling to 0 at 0.4 m"),
        "action": (0.1, "1 − mean a²"),
    }
    memory = (("energy", "f8"),)

    def start(self, rng):
        """Add random velocities to the start that the environment samples."""
        drawn = draw_start(self, rng)
        return replace(drawn, velocity=rng.uniform(-0.2, 0.2, 3), omega=rng.uniform(-0.1, 0.1, 3))

    def advance(self, robots):
        """Integrate the energy [Wh]."""
        robots.memory["energy"] += robots.power / 40.0 / 3600.0

    def terms(self, robots):
        """Compute the terms of the reward."""
        return {
            "power": 1.0 / (1.0 + robots.power / HOVERS),
            "near": np.clip(2.0 - robots.distance / NEAR, 0.0, 1.0),
            "action": 1.0 - robots.effort,
        }

    def succeeded(self, robots):
        """Return whether each flight has reached the horizon near the place."""
        return (robots.ticks >= robots.horizon) & (robots.distance < NEAR)


register_task("examples/LeastEnergy-v0", HOVER, LeastEnergy(), forms="form2", action_mode="residual_force")
