"""A task of your own: stay where you are told to, roughly, on as little energy as you can."""

from dataclasses import replace

import numpy as np

from spidar_gym.envs.registry import HOVER, register_task
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import draw_start

NEAR, HOVERS = 0.2, 3000.0
"""How far off costs nothing [m]; power of a hover with all rotors upright, about [W]."""


class LeastEnergy(HoverTask):
    """Hold a form near a place; what is rewarded is power that is not spent."""

    reward_terms = {
        "power": (0.7, "1 / (1 + P / 3000 W)"),
        "near": (0.2, "1 within 0.2 m of the place, falling to 0 at 0.4 m"),
        "action": (0.1, "1 − mean a²"),
    }
    memory = (("energy", "f8"),)

    def start(self, rng):
        """An episode begins in motion, where and in the form that the environment draws."""
        drawn = draw_start(self, rng)
        return replace(drawn, velocity=rng.uniform(-0.2, 0.2, 3), omega=rng.uniform(-0.1, 0.1, 3))

    def advance(self, robots):
        """Count the energy."""
        robots.memory["energy"] += robots.power / 40.0 / 3600.0

    def terms(self, robots):
        """Terms of the reward."""
        return {
            "power": 1.0 / (1.0 + robots.power / HOVERS),
            "near": np.clip(2.0 - robots.distance / NEAR, 0.0, 1.0),
            "action": 1.0 - robots.effort,
        }

    def succeeded(self, robots):
        """Who has flown to the end, and stayed near."""
        return (robots.ticks >= robots.horizon) & (robots.distance < NEAR)


register_task("examples/LeastEnergy-v0", HOVER, LeastEnergy(), forms="form2", action_mode="residual_force")
