"""Truncation of episodes after `horizon_s` or `max_episode_steps`, the shorter if both are given."""

import copy
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec, WrapperSpec
from gymnasium.utils import RecordConstructorArgs

from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.registry import HORIZON, OnlyOfOne, RegisteredSteps


class OfMade(OnlyOfOne):
    """This wrapper in the specification of an environment that has been made.

    A slice, which `gymnasium.make` takes, contains the wrapper, so `max_episode_steps` can be changed. Iteration, from
    which JSON is written, is empty: in JSON the wrapper would be one that `gymnasium.make_vec` refuses. There the
    horizon is among the arguments.
    """

    __slots__ = ()
    __hash__ = None  # pyright: ignore[reportAssignmentType] - as its entries

    def __iter__(self) -> Iterator[WrapperSpec]:
        """Iterate over no entries."""
        return iter(())

    def __eq__(self, other: object) -> bool:
        """Return whether the other one has no entries either."""
        return other == () or isinstance(other, OfMade)


class Horizon(gymnasium.Wrapper[Any, np.ndarray, Any, np.ndarray], RecordConstructorArgs):
    """Sets the environment's horizon, where success is evaluated; `gymnasium.make` applies it as the outermost wrapper.

    The registered `TimeLimit` below it does not depend on `horizon_s`, nor the environment on `TimeLimit`. The
    specification of a made environment has the horizon among its arguments, so that `gymnasium.make_vec`, which refuses
    wrappers, makes a native vector of it. A specification read from JSON has a fixed horizon: another
    `max_episode_steps` of `gymnasium.make` can only shorten episodes, and success is not evaluated there.
    """

    def __init__(self, env: gymnasium.Env[Any, np.ndarray]) -> None:
        """Wrap an environment as `gymnasium.make` does."""
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner = env.unwrapped
        assert isinstance(inner, SpidarEnv)
        assert env.spec is not None
        steps = env.spec.max_episode_steps
        inner.end(-1 if steps is None else None if isinstance(steps, RegisteredSteps) else steps)
        self._inner, self._spec = inner, copy.deepcopy(env.spec)
        self._spec.additional_wrappers = OfMade((HORIZON,))

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment; its own truncation replaces that of `TimeLimit`."""
        observation, reward, terminated, _, info = self.env.step(action)
        return observation, reward, terminated, self._inner.is_over, info

    @property
    def spec(self) -> EnvSpec | None:
        """Specification with the steps after which an episode is truncated."""
        steps = self._inner.horizon if self._inner.truncates else None
        self._spec.max_episode_steps = steps
        self._spec.kwargs["max_episode_steps"] = -1 if steps is None else steps
        return self._spec
