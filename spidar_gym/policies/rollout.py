"""Run one episode of an environment with a policy, and yield every step."""

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from spidar_gym.policies.policy import Policy


class Step(NamedTuple):
    """One step of an episode."""

    observation: Any
    """Observation before the action."""
    action: np.ndarray
    """Action, in [−1, 1]."""
    reward: float
    """Reward of the step."""
    next_observation: Any
    """Observation after the action."""
    terminated: bool
    """Whether the episode ended in a failure."""
    truncated: bool
    """Whether the episode was truncated; without the wrappers of `gymnasium.make` it may not be."""
    info: dict[str, Any]
    """The environment's `info` after the action."""
    seconds: float
    """Wall time of the environment's step [s]."""

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
    """Reset an environment immediately, and run the episode step by step as the caller iterates.

    During an iteration the environment is in the state after the yielded step. The caller may stop at any step.

    Args:
        env: Environment, with or without wrappers.
        policy: The policy; None for the zero action, which is the environment's controller alone.
        seed: Seed of the episode.
        policy_seed: Seed of the policy; the episode's by default.
        options: Options of `reset`.
        ticks: Largest number of steps; without a limit the environment must end the episode.
        until_finished: Whether to end a crawl when it has arrived.

    Returns:
        The steps up to the end of the episode.
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
            # A copy, so that the policy cannot change the recorded observation.
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
    """Convert records of steps to arrays (steps, …) by name."""
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}
