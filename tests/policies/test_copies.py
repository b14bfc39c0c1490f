"""Pins copies of policies in the middle of an episode: equal memory, and independence of the original."""

import copy
import pickle
import sys
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from spidar_gym.cli.evaluate import BASELINES
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import acts_in_batches, defined_on, policy_arguments

ROOT = Path(__file__).resolve().parents[2]
LEARNED = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "baselines" / "learned").rglob("*.npz"))
WAYS = [copy.deepcopy, lambda policy: pickle.loads(pickle.dumps(policy))]


@pytest.fixture(autouse=True)
def checkout(monkeypatch):
    """Make the baselines importable, as in a checkout."""
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    monkeypatch.chdir(ROOT)


@cache
def observations(env_id: str, mode: str | None) -> tuple[np.ndarray, int]:
    """Return the first observations of an episode, and the size of an action."""
    env = gymnasium.make(env_id, **({} if mode is None else {"action_mode": mode}))
    seen = [env.reset(seed=1)[0]]
    rng, size = np.random.default_rng(0), int(np.prod(env.action_space.shape or ()))
    for _ in range(11):
        seen.append(env.step(rng.uniform(-0.2, 0.2, size))[0])
    env.close()
    return np.array(seen), size


def begun(policy, env_id):
    """Let a policy act on the first five observations; return all observations."""
    seen, size = observations(env_id, (policy_arguments(policy, env_id) or {}).get("action_mode"))
    if hasattr(policy, "begin"):
        policy.begin(size)
    policy.reset(3)
    for each in seen[:5]:
        policy.act(each)
    return seen


@pytest.mark.parametrize("spec", [*BASELINES, *LEARNED])
def test_a_copy_remembers_what_the_policy_has_seen_and_neither_changes_the_other(spec):
    policy = load_policy(spec)
    for env_id in defined_on(policy):
        seen = begun(policy, env_id)
        copies = [way(policy) for way in WAYS]
        astray = copy.deepcopy(policy)
        expected = []
        for each in seen[5:]:
            astray.act(seen[0] + 0.01)
            expected.append(policy.act(each))
        for other in copies:
            assert all(np.array_equal(other.act(each), due) for each, due in zip(seen[5:], expected, strict=True))


@pytest.mark.parametrize("spec", LEARNED)
def test_a_copy_remembers_what_the_policy_has_seen_of_many_robots(spec):
    policy = load_policy(spec)
    assert acts_in_batches(policy)
    (env_id,) = defined_on(policy)
    rows = begun(policy, env_id)[:, None].repeat(3, axis=1) * np.array([[[1.0], [0.9], [1.1]]])
    policy.reset_batch([1, 2, 3])
    for each in rows[:5]:
        policy.act_batch(each)
    copies = [way(policy) for way in WAYS]
    for each in rows[5:]:
        due = policy.act_batch(each)
        assert [np.array_equal(other.act_batch(each), due) for other in copies] == [True, True]


def test_some_learned_policies_remember_something():
    """Without memories, the tests above would pass trivially."""
    has_memory = {spec: load_policy(spec).artifact for spec in LEARNED}
    assert any(len(artifact.traced) for artifact in has_memory.values())
    assert any(artifact.washout.any() for artifact in has_memory.values())
    assert any(len(artifact.rotor_lag) for artifact in has_memory.values())
