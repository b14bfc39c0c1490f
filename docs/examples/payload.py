"""A custom task: fetch a load in mid-flight, carry it to its place, put it down, and return."""

import numpy as np

from spidar_gym.control.flight.observation import Field
from spidar_gym.envs.registry import HOVER, register_task
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.task import length, tolerance

PLACES = np.array([[0.4, 0.0, 0.0], [0.4, 0.5, 0.1], [0.0, 0.0, 0.0]])
"""Place of the load, its destination, and home, relative to the hover's place [m]."""
BELOW, SPEED, CLOSE = np.array([0.05, 0.0, -0.1]), 0.2, 0.04
"""Position of the load in torso axes [m]; speed of the reference [m/s]; distance at which a place is reached [m]."""


class Fetch(HoverTask):
    """Three places in sequence; the controller has no information about the load."""

    reward_terms = {"position": (0.6, "1 / (1 + (‖position error‖ / 0.05 m)²)"), "way": (0.4, "places reached / 3")}
    memory = (("at", "f8", (3,)), ("reached", "i4"), ("mass", "f8"))
    fields = (Field("carried", 1, 5.0, "kg", "mass of what the torso carries"),)
    loads = True

    def draw(self, rng):
        """Sample the mass of the load [kg]."""
        return {"mass": rng.uniform(0.5, 1.5)}

    def reference(self, robots):
        """Shift the hover's reference to the moving point."""
        wanted = super().reference(robots)
        wanted["position_w"] += robots.memory["at"]
        return wanted

    def advance(self, robots):
        """Advance the reference; where a place is reached, take the load or put it down."""
        memory = robots.memory
        way = PLACES[np.minimum(memory["reached"], 2)] - memory["at"]
        memory["at"] += way * np.minimum(1.0, SPEED / 40.0 / np.maximum(length(way), 1e-9))[:, None]
        there = (length(way) < CLOSE) & (robots.distance < CLOSE) & (memory["reached"] < 3)
        memory["reached"] += there
        takes = there & (memory["reached"] == 1)
        robots.load(takes, memory["mass"][takes], BELOW)
        robots.load(there & (memory["reached"] == 2), 0.0)

    def observe(self, robots):
        """Return the additional observation."""
        return {"carried": robots.payload}

    def terms(self, robots):
        """Compute the terms of the reward."""
        return {"position": tolerance(robots.distance, 0.05), "way": robots.memory["reached"] / 3.0}

    def succeeded(self, robots):
        """Return whether each robot has returned home."""
        return robots.memory["reached"] == 3


register_task("examples/Fetch-v0", HOVER, Fetch(), forms="form2", preset="tuned")
