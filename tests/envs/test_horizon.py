"""Pins the length of an episode: one argument is enough, success is evaluated at its end, the spec agrees."""

import copy
import json
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from support.episodes import HOVER

from spidar_gym.envs.registry import COURSE, ENVIRONMENTS

ENDS = [
    ({}, 800),
    ({"horizon_s": 40.0}, 1600),
    ({"max_episode_steps": 60}, 60),
    ({"horizon_s": 1.5}, 60),
    ({"max_episode_steps": 1600}, 1600),
    ({"horizon_s": 40.0, "max_episode_steps": 60}, 60),
    ({"horizon_s": 1.5, "max_episode_steps": 800}, 60),
    ({"horizon_s": 40.0, "max_episode_steps": 800}, 800),
    ({"horizon_s": 40.0, "max_episode_steps": -1}, None),
]
"""Arguments of `gymnasium.make`, and the steps of an episode."""


def again(env):
    """The environment of a spec that was written as JSON."""
    return gymnasium.make(EnvSpec.from_json(json.dumps(json.loads(env.spec.to_json()))))


@pytest.mark.parametrize(("arguments", "steps"), ENDS)
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_the_spec_has_the_steps_of_an_episode_also_after_serialisation(name, arguments, steps):
    if not arguments:
        steps = ENVIRONMENTS[name].horizon
    one = {"hold": 1} if arguments and name == COURSE else {}  # steps as long as those of the other environments
    env = gymnasium.make(name, **arguments, **one)
    for made in (env, again(env), again(again(env)), gymnasium.make(env.spec)):
        assert made.spec.max_episode_steps == steps
        assert type(made.spec.max_episode_steps) in (int, type(None))
        assert made.spec.additional_wrappers == ()


@pytest.mark.parametrize(
    "arguments",
    [
        {"max_episode_steps": 60}, {"horizon_s": 1.5}, {"horizon_s": 1.5, "max_episode_steps": 800},
        {"horizon_s": 40.0, "max_episode_steps": 60},
    ],
)  # fmt: skip
@pytest.mark.parametrize("written", [False, True])
def test_an_episode_ends_after_the_shorter_limit_and_only_there_is_a_success(arguments, written):
    env = gymnasium.make(HOVER, forms="form1", **arguments)
    env = again(env) if written else env
    env.reset(seed=0)
    for k in range(60):
        _, _, terminated, truncated, info = env.step(np.zeros(6))
        assert not terminated
        assert truncated == info["is_success"] == (k == 59)


@pytest.mark.slow
def test_a_horizon_beyond_the_registered_one_is_flown_to_its_end():
    env = gymnasium.make(HOVER, forms="form1", wake=False, horizon_s=20.25)
    env.reset(seed=0)
    ends = [env.step(np.zeros(6))[2:4] for _ in range(810)]
    assert ends == [(False, False)] * 809 + [(False, True)]


@pytest.mark.parametrize("copied", [lambda spec: spec, copy.deepcopy, lambda spec: pickle.loads(pickle.dumps(spec))])
def test_success_is_evaluated_at_an_end_that_replaces_that_of_the_spec(copied):
    spec = copied(gymnasium.make(HOVER, forms="form1", perturbation=0.0, max_episode_steps=20).spec)
    for steps in (10, 30, -1):
        env = gymnasium.make(spec, max_episode_steps=steps)
        for options in ({}, {"joint_speed": 0.4}):  # the second rebuilds the environment
            env.reset(seed=0, options=options)
            ends = [env.step(np.zeros(6)) for _ in range(30)]
            assert [truncated for *_, truncated, _ in ends] == [k >= steps > 0 for k in range(1, 31)]
            assert [info["is_success"] for *_, info in ends] == [k >= steps > 0 for k in range(1, 31)]


def test_an_episode_without_limit_is_never_truncated_and_a_success_from_its_horizon_on():
    env = gymnasium.make(HOVER, forms="form1", perturbation=0.0, horizon_s=0.5, max_episode_steps=-1)
    env.reset(seed=0)
    steps = [env.step(np.zeros(6)) for _ in range(30)]
    assert not any(truncated for *_, truncated, _ in steps)
    assert [info["is_success"] for *_, info in steps] == [False] * 19 + [True] * 11


@pytest.mark.parametrize("mode", ["sync", "async"])
@pytest.mark.parametrize("arguments", [{"max_episode_steps": 6}, {"horizon_s": 0.15}])
def test_vectors_end_their_episodes_there_too_and_begin_new_ones(mode, arguments):
    more = {"vector_kwargs": {"context": "spawn"}} if mode == "async" else {}
    envs = gymnasium.make_vec(HOVER, 2, mode, forms="form1", **arguments, **more)
    try:
        envs.reset(seed=0)
        truncated = [envs.step(np.zeros((2, 6), np.float32))[3].all() for _ in range(13)]
    finally:
        envs.close()
    # By default a vector's next step after an episode's end is the next reset.
    assert truncated == [False] * 5 + [True] + [False] * 6 + [True]


def test_a_refused_reset_leaves_the_episodes_end_where_it_was():
    env = gymnasium.make(HOVER, forms="form1", max_episode_steps=10)
    env.reset(seed=0)
    ends = []
    for k in range(10):
        if k == 6:
            with pytest.raises(ValueError, match="zzz"):
                env.reset(options={"zzz": 1})
        ends.append(env.step(np.zeros(6))[3])
    assert ends == [False] * 9 + [True]
