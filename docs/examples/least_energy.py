"""A task of your own: stay where you are told to, roughly, on as little energy as you can."""

import numpy as np

from spidar_gym.envs.registry import HOVER, register_task
from spidar_gym.tasks.start import FlightStart
from spidar_gym.tasks.task import length, square

NEAR, HOVERS = 0.2, 3000.0
"""How far off costs nothing [m]; power of a hover with all rotors upright, about [W]."""


class LeastEnergy(FlightTask):
    """Hold a form near a place; what is rewarded is power that is not spent."""

    reward_terms = {
        "power": (0.7, "1 / (1 + P / 3000 W)"),
        "near": (0.2, "1 within 0.2 m of the place, falling to 0 at 0.4 m"),
        "action": (0.1, "1 − mean a²"),
    }
    memory = (("energy", "f8"),)

    def start(self, rng, hover):
        """An episode begins in motion, in the form that the environment draws."""
        position, rotation = hover.offset(rng)
        velocity, omega = rng.uniform(-0.2, 0.2, 3), rng.uniform(-0.1, 0.1, 3)
        return FlightStart(tuple(hover.schedule(rng)), position, rotation, velocity=velocity, omega=omega)

    def advance(self, flights):
        """Count the energy."""
        super().advance(flights)
        flights.memory["energy"] += flights.power / 40.0 / 3600.0

    def terms(self, flights):
        """Terms of the reward."""
        far, action = length(flights.position_error), flights.action
        return {
            "power": 1.0 / (1.0 + flights.power / HOVERS),
            "near": np.clip(2.0 - far / NEAR, 0.0, 1.0),
            "action": 1.0 - square(action) / action.shape[1],
        }

    def succeeded(self, flights):
        """Who has flown to the end, and stayed near."""
        return (flights.ticks >= flights.horizon) & (length(flights.position_error) < NEAR)


register_task("examples/LeastEnergy-v0", HOVER, LeastEnergy(), forms="form2", action_mode="residual_force")
