"""Episodes of a policy on a task of the suite, with the seeds of its evaluation."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils.seeding import np_random

from spidar_gym.benchmark.scoring import ACT_LIMIT_S
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.suite import CEILING, CLASSICAL, LAZY, SUITE, SuiteTask
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.policies.actor import Actor
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import READABLE, Policy, acts_in_batches, policy_arguments, policy_name, require_spaces
from spidar_gym.policies.presets import OwnController
from spidar_gym.policies.rollout import rollout

SEED = 1_000_000
"""Seed of the first evaluation episode; training seeds are below."""
EPISODES = 100
"""Episodes of a full evaluation."""
METRICS = ("return", "success", "failure", "duration_s")
"""Means over the episodes of an evaluation: sum of rewards, shares of successes and failures, length of an episode."""


@dataclass(frozen=True)
class Episodes:
    """Results of one episode for each seed, (N,) each."""

    returns: np.ndarray
    """Sum of the rewards."""
    success: np.ndarray
    """Whether the episode was a success."""
    failed: np.ndarray
    """Whether it ended with a failure."""
    seconds: np.ndarray
    """Its length [s]."""
    terms: Mapping[str, np.ndarray]
    """Part of the return that each term of the reward brings."""

    @property
    def means(self) -> dict[str, float]:
        """Means by metric, in the order of `METRICS`."""
        values = self.returns, self.success, self.failed, self.seconds
        return {name: float(value.mean()) for name, value in zip(METRICS, values, strict=True)}


class RandomPolicy(OwnController):
    """Uniform actions, independent of everything; the seed determines them."""

    name = "random"

    def __init__(self) -> None:
        """Choose nothing of the environment."""
        super().__init__({})

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Begin an episode of each robot."""
        self._generators = [np.random.Generator(np.random.PCG64(seed)) for seed in seeds]

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self.reset_batch([seed])

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Return actions."""
        return np.array([rng.uniform(-1.0, 1.0, self._size) for rng in self._generators])

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return an action."""
        return self.act_batch(observation[None])[0]


def find_task(name: str) -> SuiteTask:
    """Return a task of the suite by name (`UnknownNameError` lists the valid ones)."""
    require_name("task of the suite", name, SUITE)
    return SUITE[name]


def options_for(task: SuiteTask, policy: Policy) -> dict[str, Any]:
    """Return the arguments of the environment for a policy (`InvalidValueError` where it is not defined)."""
    chosen = policy_arguments(policy, task.env_id)
    if chosen is None:
        raise InvalidValueError("policy", policy_name(policy), f"one that is defined on {task.env_id}")
    return task.options_of(chosen)


def play(
    name: str,
    policy: Policy,
    episodes: int = EPISODES,
    *,
    threads: int = 1,
    act_limit_s: float = ACT_LIMIT_S,
    sensors: bool | None = None,
    on_end: Callable[[int], object] = lambda _: None,
) -> Episodes:
    """Play the first episodes of the evaluation's seeds.

    Args:
        name: Task of the suite.
        policy: The policy. Its random numbers begin at the number of the episode. If it selects a controller, the
            environment has the arguments that it states in place of `INTERFACE`.
        episodes: Number of episodes.
        threads: Number of threads that simulate robots; the result is the same.
        act_limit_s: Largest time of the policy for one action of one robot [s].
        sensors: Whether the policy sees the sensors' estimate, not the true state; as in the task if not given.
        on_end: Called with the number of episodes that have ended in a step, if any.

    Raises:
        UnknownNameError: For a task that does not exist.
        PolicyError: When the policy raises, returns invalid actions, or takes too long.
    """
    task = find_task(name)
    options = options_for(task, policy) | ({} if sensors is None else {"sensors": sensors})
    # Not its id, whose arguments a policy may replace. A single robot states the spaces.
    env = gymnasium.make(task.env_id, **options)
    require_spaces(policy, task.id, env)
    robot = env.unwrapped
    assert isinstance(robot, SpidarEnv)
    if acts_in_batches(policy) and not any(name in options for name in READABLE):
        fleet = robot.make_fleet(episodes, threads, truncates=True)
        actor = Actor(policy, fleet.actions.shape, task.id, limit_s=act_limit_s * episodes)
        found = _play_together(fleet, actor, on_end)
        fleet.close()
    else:
        actor = Actor(policy, env.action_space.shape or (), task.id, limit_s=act_limit_s)
        rows = []
        for k in range(episodes):
            rows.append(_play_one(env, actor, k))
            on_end(1)
        found = np.concatenate(rows)
    names = [*robot.task.reward_terms]
    env.close()
    returns, success, failed, seconds, *terms = found.T
    return Episodes(returns, success > 0.0, failed > 0.0, seconds, dict(zip(names, terms, strict=True)))


def _play_together(fleet: Fleet, actor: Actor, on_end: Callable[[int], object]) -> np.ndarray:
    """Play an episode of each robot; return a row for each: return, success, failure, length [s], terms."""
    count = len(fleet.robots)
    for k in range(count):
        fleet.seed(k, np_random(SEED + k)[0])
    fleet.reset()
    actor.reset_batch([*range(count)])
    weights = [weight for weight, _ in fleet.task.reward_terms.values()]
    found, ids = np.zeros((count, 4 + len(weights))), np.arange(count)
    while ids.size:
        fleet.actions[:] = actor.act_batch(fleet.observations.copy())
        fleet.step(ids)
        found[ids, 0] += fleet.rewards[ids]
        found[ids, 1] = fleet.infos["is_success"][ids]
        found[ids, 2] = fleet.infos["info"]["failure_code"][ids] >= 0
        found[ids, 3] = fleet.view.time[ids]
        found[ids, 4:] += weights * fleet.terms[ids]
        going = ids[~(fleet.terminated[ids] | fleet.truncated[ids])]
        on_end(len(ids) - len(going))
        ids = going
    return found


def _play_one(env: gymnasium.Env[Any, np.ndarray], actor: Actor, episode: int) -> np.ndarray:
    """Play one episode; return its row, (1, …) as of `_play_together`."""
    robot = env.unwrapped
    assert isinstance(robot, SpidarEnv)
    weights = {f"reward_{name}": weight for name, (weight, _) in robot.task.reward_terms.items()}
    found = np.zeros((1, 4 + len(weights)))
    for step in rollout(env, actor, seed=SEED + episode, policy_seed=episode, until_finished=False):
        info = step.info
        found[0, 0] += step.reward
        found[0, 1:4] = bool(info["is_success"]), info["failure"] != "", robot.fleet.view.time[0]
        found[0, 4:] += [weight * info[name] for name, weight in weights.items()]
        if step.terminated or step.truncated:
            break
    return found


def anchoring(name: str) -> dict[str, Policy]:
    """Return the policies that anchor a task's scale, by name, and its privileged ceiling if it has one."""
    task, lazy = find_task(name), dict(zip(LAZY, (OwnController({}), RandomPolicy()), strict=True))
    best = load_policy(task.classical)
    return {**lazy, CLASSICAL: best, **({CEILING: best} if task.has_ceiling else {})}
