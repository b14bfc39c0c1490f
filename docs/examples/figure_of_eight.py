"""A custom task: fly a figure of eight with moving legs and a torso that rolls into the turns."""

from dataclasses import dataclass

import numpy as np

from spidar_gym.envs.registry import HOVER, register_task
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.task import tolerance


@dataclass(frozen=True)
class FigureOfEight(HoverTask):
    """Two loops of a random width; the fields are also options of `reset`."""

    seconds: float = 16.0
    """Time of both loops [s]."""
    lean: float = 0.1
    """Roll of the torso into the loops [rad]."""

    reward_terms = {
        "position": (0.5, "1 / (1 + (‖position error‖ / 0.03 m)²)"),
        "attitude": (0.3, "1 / (1 + (‖attitude error‖ / 0.03 rad)²)"),
        "joints": (0.2, "1 / (1 + (max |planned − measured joint angle| / 0.1 rad)²)"),
    }
    memory = (("width", "f8"),)

    def draw(self, rng):
        """Sample the initial memory of an episode."""
        return {"width": rng.uniform(0.2, 0.4)}

    def reference(self, robots):
        """Move the hover's reference along x = a sin s, y = a sin s cos s, and roll it into the turns."""
        wanted, a = super().reference(robots), robots.memory["width"]
        rate = 2.0 * np.pi / self.seconds
        s, roll = rate * robots.time, -self.lean * np.sin(2.0 * rate * robots.time)
        wanted["position_w"][:, :2] += (a * np.array([np.sin(s), np.sin(s) * np.cos(s)])).T
        wanted["velocity_w"][:, :2] = (a * rate * np.array([np.cos(s), np.cos(2.0 * s)])).T
        wanted["acceleration_w"][:, :2] = (-a * rate**2 * np.array([np.sin(s), 2.0 * np.sin(2.0 * s)])).T
        wanted["quat_wb"][:, :2] = np.array([np.cos(0.5 * roll), np.sin(0.5 * roll)]).T
        wanted["omega_b"][:, 0] = -2.0 * self.lean * rate * np.cos(2.0 * s)
        return wanted

    def terms(self, robots):
        """Compute the terms of the reward."""
        return {
            "position": tolerance(robots.distance, 0.03),
            "attitude": tolerance(robots.angle, 0.03),
            "joints": tolerance(robots.joint_error, 0.1),
        }


register_task("examples/FigureOfEight-v0", HOVER, FigureOfEight(), forms="independent", joint_speed=0.6)
