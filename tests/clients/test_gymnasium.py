"""Pins Gymnasium as a client: one robot, and native, sync and async vectors in each autoreset mode."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

from spidar_gym.envs.registry import ENVIRONMENTS

pytestmark = needs("gymnasium")
MODES = list(gymnasium.vector.AutoresetMode)


def settings(kind, mode):
    """Return the arguments of `make_vec` for a kind of vector and an autoreset mode."""
    if kind == "native":
        return {"autoreset_mode": mode}
    context = {"context": "spawn"} if kind == "async" else {}
    return {"vectorization_mode": kind, "vector_kwargs": {"autoreset_mode": mode, **context}}


def test_what_the_guide_shows_runs_to_the_end_of_the_first_episodes():
    made = run_shown("gymnasium")
    one = made["one"]
    check_env(one.unwrapped, skip_render_check=True)
    one.reset(seed=0)
    ends = [one.step(np.zeros(6)) for _ in range(STEPS)]
    assert_judged_at_the_end([info["is_success"] for *_, info in ends])
    for name in ("many", "sync", "processes"):
        envs = made[name]
        observations, _ = envs.reset(seed=0)
        assert observations in envs.observation_space
        steps = [envs.step(np.zeros((2, 6), np.float32)) for _ in range(STEPS)]
        assert all(np.isfinite(reward).all() and (reward > 0.0).all() for _, reward, *_ in steps)
        assert [truncated.all() for *_, truncated, _ in steps] == [False] * (STEPS - 1) + [True]
        for k in range(2):
            assert_judged_at_the_end([bool(info["is_success"][k]) for *_, info in steps])
        np.testing.assert_allclose(steps[-1][0][0], ends[-1][0], atol=1e-9)
        envs.close()


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
@pytest.mark.parametrize("kind", ["native", "sync"])
def test_episodes_continue_in_each_autoreset_mode_and_report_success_at_their_end(kind, mode, name):
    envs = gymnasium.make_vec(name, 2, max_episode_steps=4, **settings(kind, mode))
    envs.reset(seed=0)
    zero = np.zeros(envs.action_space.shape, np.float32)
    truncated = []
    for _ in range(9):
        observations, _, _, over, info = envs.step(zero)
        assert observations in envs.observation_space
        if over.all():
            told = info["final_info"] if mode.value == "SameStep" else info
            assert np.shape(told["is_success"]) == (2,)
            if mode.value == "Disabled":
                envs.reset(options={"reset_mask": over})
        truncated.append(bool(over.all()))
    ends = (3, 8) if mode.value == "NextStep" else (3, 7)  # in NextStep, the step after the end is the reset
    assert [k for k, over in enumerate(truncated) if over] == list(ends)
    envs.close()


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
def test_a_process_does_the_same_as_this_one(mode):
    zero, seen = np.zeros((1, 6), np.float32), []
    for kind in ("async", "sync"):
        envs = gymnasium.make_vec("spidar_gym/Hover-v0", 1, max_episode_steps=4, **settings(kind, mode))
        seen.append([envs.reset(seed=3)[0], *(envs.step(zero)[0] for _ in range(4))])
        envs.close()
    assert all(np.array_equal(a, b) for a, b in zip(*seen, strict=True))
