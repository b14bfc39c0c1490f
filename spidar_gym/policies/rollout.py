"""One episode: an environment, who acts in it, and what happens in every control period."""

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from spidar_gym.policies.policy import Policy


class Step(NamedTuple):
    """One control period of an episode."""

    observation: Any
    """What was seen before the action."""
    action: np.ndarray
    """What was done, in [−1, 1]."""
    reward: float
    """Reward of this period."""
    next_observation: Any
    """What is seen after it."""
    terminated: bool
    """Whether it ended in a failure."""
    truncated: bool
    """Whether the time is up; only what `gymnasium.make` returns knows that, not the environment without wrappers."""
    info: dict[str, Any]
    """The environment's `info` after it."""
    seconds: float
    """How long the environment took for it [s]."""

    @property
    def finished(self) -> bool:
        """Whether a crawl has arrived; a flight never has."""
        return bool(self.info.get("finished", False))


def rollout(
    env: gymnasium.Env[Any, np.ndarray],
    policy: Policy | None = None,
    *,
    seed: int,
    policy_seed: int | None = None,
    options: dict[str, Any] | None = None,
    ticks: int | None = None,
    until_finished: bool = True,
) -> Iterator[Step]:
    """Reset an environment at once, and play the episode as the steps are asked for.

    Whoever iterates records what is wanted of each step and of the environment, which stands right after it, and may
    stop whenever enough was seen.

    Args:
        env: Environment, with or without wrappers.
        policy: Who acts; None for the zero action, which is the environment's controller alone.
        seed: Seed of the episode.
        policy_seed: Seed of what the policy draws; the episode's by default.
        options: Options of `reset`.
        ticks: Most steps; without a limit the environment has to end the episode.
        until_finished: Whether a crawl ends when it has arrived.

    Returns:
        The steps, up to the one with which the episode ends.
    """
    observation, _ = env.reset(seed=seed, options=options)
    if policy is not None:
        policy.reset(seed if policy_seed is None else policy_seed)
    return _steps(env, policy, observation, ticks, until_finished)


def _steps(
    env: gymnasium.Env[Any, np.ndarray],
    policy: Policy | None,
    observation: Any,  # noqa: ANN401 - an array, or a dictionary of them
    ticks: int | None,
    until_finished: bool,
) -> Iterator[Step]:
    action, played = np.zeros(env.action_space.shape or ()), 0
    while ticks is None or played < ticks:
        if policy is not None:
            # A copy: what a policy does to its observation changes nothing in the records.
            action = policy.act(observation.copy())
        begin = time.perf_counter()
        after, reward, terminated, truncated, info = env.step(action)
        seconds = time.perf_counter() - begin
        step = Step(observation, action, float(reward), after, terminated, truncated, info, seconds)
        observation, played = after, played + 1
        yield step
        if terminated or truncated or (until_finished and step.finished):
            return


def columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Records of steps as arrays: name → (steps, …)."""
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}
