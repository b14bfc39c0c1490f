"""Wrapper that encodes the words of `info` as numbers, with the vector's codes, for clients that need tensors."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.info import SETS, words_of
from spidar_gym.errors import InvalidValueError, require_name


class Coded(gymnasium.Wrapper[Any, np.ndarray, Any, np.ndarray], RecordConstructorArgs):
    """Replaces words in `info` by codes, as in the native vector: `qp_status_code`, `failure_code`, in the crawl more.

    Gymnasium's `NumpyToTorch`, `JaxToTorch` and `ArrayConversion` cannot convert strings: they drop those of a single
    environment and fail on those of a vector. Inside them, this wrapper leaves only numbers and arrays in `info`.
    """

    def __init__(self, env: gymnasium.Env[Any, np.ndarray]) -> None:
        """Wrap an environment of this package, wrapped or not (`InvalidValueError` for another)."""
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner = env.unwrapped
        if not isinstance(inner, SpidarEnv):
            raise InvalidValueError("env", inner, "an environment of spidar_gym, wrapped or not")
        self.words = words_of(inner.failures, inner.words)
        """Words by code, for each name in `info`: −1 is none; in `shortfalls`, bit k is the k-th word."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment and encode `info`."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, self._coded(info)

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and encode `info`."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, self._coded(info)

    def _coded(self, info: dict[str, Any]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, value in info.items():
            if isinstance(value, str):
                found[f"{name}_code"] = self._code(name, value)
            else:
                found[name] = value
        return found

    def _code(self, name: str, value: str) -> int:
        """Return the code of a word (`UnknownNameError` for a word that the environment does not list)."""
        require_name("word of info", name, self.words)
        words = self.words[name]
        if name in SETS:
            return sum(1 << words.index(word) for word in value.split(", ") if word)
        if value in ("", "none") and value not in words:
            return -1
        require_name(name, value, words)
        return words.index(value)
