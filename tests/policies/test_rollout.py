"""Pins the rollout: equal steps to the environment, start and end of episodes, and inputs of the policy."""

import gymnasium
import numpy as np
import pytest
from support.episodes import HOVER, actions_of, assert_same, flight, make

from spidar_gym.policies.rollout import columns, rollout


class Script(gymnasium.Env):
    """Environment whose episode ends at a given step; the observation is the number of steps."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))

    def __init__(self, **ends):
        self.ends, self.log = ends, []

    def reset(self, *, seed=None, options=None):
        self.ticks = 0
        self.log.append((seed, options))
        return np.zeros(1), {}

    def step(self, action):
        self.ticks += 1
        assert self.ticks < 50
        self.log.append(action)
        ended = {name: self.ticks >= self.ends.get(name, 100) for name in ("terminated", "truncated", "finished")}
        info = {"finished": ended["finished"]} if "finished" in self.ends else {}
        return np.full(1, self.ticks), 0.5, ended["terminated"], ended["truncated"], info


class Notes:
    """Policy that records seeds and observations, and overwrites the observations."""

    def __init__(self):
        self.seeds, self.seen = [], []

    def reset(self, seed):
        self.seeds.append(seed)

    def act(self, observation):
        self.seen.append(float(observation[0]))
        observation[:] = 9.0
        return np.full(2, len(self.seen))


def test_the_steps_are_those_of_the_environment():
    env = make(HOVER, sensors=True, randomization=1.0)
    actions = actions_of(env, 12)
    expected = flight(env, actions, seed=3, options={"forms": "narrow"})

    class Replay:
        def reset(self, seed):
            self.left = iter(actions)

        def act(self, observation):
            return next(self.left)

    steps = list(rollout(env, Replay(), seed=3, options={"forms": "narrow"}, ticks=12))
    assert_same(
        [(s.next_observation, s.reward, s.terminated, s.info) for s in steps],
        [(o, float(r), t, i) for o, r, t, i in expected[1:]],
    )
    for step, before, action in zip(steps, expected, actions, strict=False):
        np.testing.assert_array_equal(step.observation, before[0])
        np.testing.assert_array_equal(step.action, action)
        assert step.seconds > 0.0


def test_the_zero_action_is_used_without_a_policy():
    env = Script(terminated=3)
    assert [step.action.tolist() for step in rollout(env, seed=1)] == [[0.0, 0.0]] * 3


def test_the_episode_is_reset_at_once_and_stepped_on_demand():
    env, policy = Script(), Notes()
    steps = rollout(env, policy, seed=7, options={"a": 1})
    assert (env.log, policy.seeds, policy.seen) == ([(7, {"a": 1})], [7], [])
    next(steps)
    next(steps)
    assert env.ticks == 2


@pytest.mark.parametrize(
    ("ends", "given", "ticks"),
    [
        ({"terminated": 4}, {}, 4),
        ({"truncated": 5}, {}, 5),
        ({"finished": 6, "truncated": 9}, {}, 6),
        ({"finished": 6, "truncated": 9}, {"until_finished": False}, 9),
        ({"finished": 6, "terminated": 7}, {"until_finished": False}, 7),
        ({"truncated": 9}, {"ticks": 3}, 3),
        ({"truncated": 9}, {"ticks": 0}, 0),
    ],
)
def test_the_last_step_is_the_one_that_ends_the_episode(ends, given, ticks):
    env = Script(**ends)
    steps = list(rollout(env, seed=0, **given))
    assert len(steps) == env.ticks == ticks
    assert not any(s.terminated or s.truncated for s in steps[:-1])


def test_a_step_says_whether_a_crawl_has_arrived():
    found = [step.finished for step in rollout(Script(finished=3, truncated=5), seed=0, until_finished=False)]
    assert found == [False, False, True, True, True]
    assert not any(step.finished for step in rollout(Script(truncated=5), seed=0))


def test_what_a_policy_does_to_its_observation_changes_nothing():
    policy = Notes()
    steps = list(rollout(Script(terminated=4), policy, seed=0))
    assert policy.seen == [0.0, 1.0, 2.0, 3.0] == [float(s.observation[0]) for s in steps]
    assert [float(s.next_observation[0]) for s in steps] == [1.0, 2.0, 3.0, 4.0]


def test_columns_are_arrays_by_name():
    found = columns([{"a": np.arange(3), "b": "x"}, {"a": np.ones(3), "b": "y"}])
    assert found["a"].shape == (2, 3)
    assert found["b"].tolist() == ["x", "y"]
