"""When an episode is over: after `horizon_s` or `max_episode_steps`, whichever is given, the shorter where both are."""

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
    """This wrapper in the specification of an environment that is made already.

    A slice, which `gymnasium.make` takes, has it: there `max_episode_steps` may be another. JSON, which cannot keep the
    difference to a wrapper that `gymnasium.make_vec` refuses, does not; the end is among the arguments there.
    """

    __slots__ = ()
    __hash__ = None  # pyright: ignore[reportAssignmentType] - as its entries

    def __iter__(self) -> Iterator[WrapperSpec]:
        """No entries."""
        return iter(())

    def __eq__(self, other: object) -> bool:
        """Whether the other one is without entries, too."""
        return other == () or isinstance(other, OfMade)


class Horizon(gymnasium.Wrapper[Any, np.ndarray, Any, np.ndarray], RecordConstructorArgs):
    """Gives the environment its end, so that success is judged there; `gymnasium.make` puts it outermost.

    The registered `TimeLimit` below it knows nothing of `horizon_s`, and the environment nothing of `TimeLimit`. The
    specification of a made environment has the end among its arguments: so `gymnasium.make_vec`, which refuses
    wrappers, makes a native vector of it. Read from JSON it has that end for good: another `max_episode_steps` of
    `gymnasium.make` can only make episodes shorter then, and success is not judged there.
    """

    def __init__(self, env: gymnasium.Env[Any, np.ndarray]) -> None:
        """Take an environment as `gymnasium.make` wraps it."""
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
        """One step; truncated where the environment says so, which goes before `TimeLimit`."""
        observation, reward, terminated, _, info = self.env.step(action)
        return observation, reward, terminated, self._inner.is_over, info

    @property
    def spec(self) -> EnvSpec | None:
        """The specification with the steps after which the episode really ends."""
        steps = self._inner.horizon if self._inner.truncates else None
        self._spec.max_episode_steps = steps
        self._spec.kwargs["max_episode_steps"] = -1 if steps is None else steps
        return self._spec
