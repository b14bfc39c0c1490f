"""Robots with given quantities and no simulation, for the tests of tasks."""

from types import SimpleNamespace

import numpy as np

from spidar_gym.tasks.robots import Robots


def robots_with(kind: type[Robots], horizon: int = 10, **quantities: float):
    """One robot with these quantities."""
    robots = object.__new__(kind)
    vars(robots).update({name: np.array([value], float) for name, value in quantities.items()})
    vars(robots)["_simulated"] = SimpleNamespace(horizon=np.array(horizon))
    return robots
