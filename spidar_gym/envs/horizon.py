"""When an episode is over: after `horizon_s` or `max_episode_steps`, whichever is given, the shorter where both are."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs

from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.registry import RegisteredSteps


class Horizon(gymnasium.Wrapper[Any, np.ndarray, Any, np.ndarray], RecordConstructorArgs):
    """Truncates, and tells the environment when, so that success is judged there; `gymnasium.make` puts it outermost.

    The registered `TimeLimit` below it knows nothing of `horizon_s`, and the environment nothing of `TimeLimit`.
    """

    def __init__(self, env: gymnasium.Env[Any, np.ndarray]) -> None:
        """Take an environment as `gymnasium.make` wraps it."""
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner = env.unwrapped
        assert isinstance(inner, SpidarEnv)
        assert env.spec is not None
        steps = env.spec.max_episode_steps
        inner.most_steps = None if isinstance(steps, RegisteredSteps) else steps
        self._inner, self._ends = inner, steps is not None

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step; truncated where the episode is over, never with `max_episode_steps=-1`."""
        observation, reward, terminated, _, info = self.env.step(action)
        return observation, reward, terminated, self._ends and self._inner.ticks >= self._inner.horizon, info

    @property
    def spec(self) -> EnvSpec | None:
        """The specification with the steps after which the episode really ends."""
        spec = super().spec
        if spec is not None:
            spec.max_episode_steps = self._inner.horizon if self._ends else None
        return spec
