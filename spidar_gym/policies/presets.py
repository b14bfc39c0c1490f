"""Policies that consist of an environment's controller: the base class of the classical baselines."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from spidar_gym.envs.registry import HOVER, PATH


class PresetPolicy:
    """Controller of an environment: the zero action, which adds nothing to a preset."""

    name: ClassVar[str] = ""
    """Name of its row; the class's name in lower case if empty."""
    kind: ClassVar[str] = "classical"
    """`classical`, `learned`, `residual` if it has learned to add to a controller, or `unstated`."""
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Arguments of `gym.make` by environment id; on other environments the policy is not defined.

    For `Path-v0` the arguments of `Hover-v0` apply, unless there are others.
    """
    _size = 0

    def arguments(self, env_id: str) -> Mapping[str, Any] | None:
        """Return arguments of `gym.make`, of those in `ARGUMENTS`; None where the policy is not defined."""
        return self.presets.get(env_id, self.presets.get(HOVER) if env_id == PATH else None)

    def begin(self, action_size: int) -> None:
        """Store the length of an action."""
        self._size = action_size

    def reset(self, seed: int) -> None:
        """Do nothing: the policy has no memory."""

    def act(self, observation: Any) -> np.ndarray:  # noqa: ANN401 - unused
        """Return the zero action."""
        return np.zeros(self._size)

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Do nothing: the policy has no memory."""

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Return zero actions."""
        return np.zeros((len(observations), self._size))


class OwnController(PresetPolicy):
    """The zero action on a custom controller, with the same arguments in every environment."""

    def __init__(self, arguments: Mapping[str, Any]) -> None:
        """Store the arguments of `gym.make`."""
        self._arguments = arguments

    def arguments(self, env_id: str) -> Mapping[str, Any]:
        """Return the arguments of `gym.make`."""
        return self._arguments
