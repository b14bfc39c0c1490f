"""SPIDAR in simulation: Gymnasium environments whose zero action is the paper's controller.

Importing this package registers the environments: `gymnasium.make("spidar_gym/Hover-v0")`; a process that has not
imported it does so by `gymnasium.make("spidar_gym:spidar_gym/Hover-v0")`.
"""

from spidar_gym.envs.registry import register

__version__ = "0.1.0"

register()
