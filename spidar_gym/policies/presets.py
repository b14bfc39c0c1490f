"""Policies that are a controller of the environments: the base class of the classical baselines."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from spidar_gym.envs.registry import HOVER, PATH


class PresetPolicy:
    """A controller that the environments have: the zero action, which adds nothing to a preset."""

    name: ClassVar[str] = ""
    """Name of its row; the class's name in small letters if empty."""
    kind: ClassVar[str] = "classical"
    """`classical`, `learned`, or `residual` for what learned to add to a controller; `unstated` where it says none."""
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Arguments of `gym.make` by environment id; it is not defined where it has none.

    Along a path flies what hovers, unless a path has some of its own.
    """
    _size = 0

    def arguments(self, env_id: str) -> Mapping[str, Any] | None:
        """Arguments of `gym.make`, of those in `ARGUMENTS`; None where the policy is not defined."""
        return self.presets.get(env_id, self.presets.get(HOVER) if env_id == PATH else None)

    def begin(self, action_size: int) -> None:
        """Learn how long an action is."""
        self._size = action_size

    def reset(self, seed: int) -> None:
        """Nothing to forget."""

    def act(self, observation: Any) -> np.ndarray:  # noqa: ANN401 - not looked at
        """Zero."""
        return np.zeros(self._size)

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Nothing to forget."""

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Zeros."""
        return np.zeros((len(observations), self._size))


class OwnController(PresetPolicy):
    """The zero action on a controller that no preset names, the same in every environment."""

    def __init__(self, arguments: Mapping[str, Any]) -> None:
        """Take the arguments of `gym.make`."""
        self._arguments = arguments

    def arguments(self, env_id: str) -> Mapping[str, Any]:
        """The controller."""
        return self._arguments
