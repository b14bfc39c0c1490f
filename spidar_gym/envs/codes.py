"""Words of `info` as numbers, by a wrapper: for clients that make tensors of everything, with the vector's codes."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.info import SETS, words_of
from spidar_gym.errors import InvalidValueError, require_name


class Coded(gymnasium.Wrapper[Any, np.ndarray, Any, np.ndarray], RecordConstructorArgs):
    """Tells numbers in place of words, as the native vector does: `qp_status_code`, `failure_code`, in the crawl more.

    Gymnasium's `NumpyToTorch`, `JaxToTorch` and `ArrayConversion` have no tensor for a word: that of a single
    environment is lost in them, those of a vector are an error. Around this wrapper they find numbers and arrays alone.
    """

    def __init__(self, env: gymnasium.Env[Any, np.ndarray]) -> None:
        """Take an environment of this package, wrapped or not (`InvalidValueError` for another)."""
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner = env.unwrapped
        if not isinstance(inner, SpidarEnv):
            raise InvalidValueError("env", inner, "an environment of spidar_gym, wrapped or not")
        self.words = words_of(inner.failures, inner.words)
        """What numbers mean, by the word's name in `info`: −1 is none, in `shortfalls` bit k is the k-th."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As of the environment."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, self._coded(info)

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As of the environment."""
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
        """Number of what is said (`UnknownNameError` for a word that the environment does not list)."""
        require_name("word of info", name, self.words)
        words = self.words[name]
        if name in SETS:
            return sum(1 << words.index(word) for word in value.split(", ") if word)
        if value in ("", "none"):
            return -1
        require_name(name, value, words)
        return words.index(value)
