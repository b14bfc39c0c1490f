"""Pins sb3-contrib as a client: an algorithm with a buffer learns by id, and records successes of episodes."""

import numpy as np
import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

pytestmark = [*needs("sb3_contrib"), pytest.mark.train]


def test_what_the_guide_shows_learns_and_counts_successes():
    made = run_shown("sb3_contrib")
    model, env = made["model"], made["env"]
    assert model.num_timesteps == 300
    assert model.replay_buffer.observations.shape[1:] == (2, *env.observation_space.shape)
    assert np.isfinite(model.replay_buffer.rewards[:150]).all()
    assert [episode["l"] for episode in model.ep_info_buffer] == [STEPS] * 4
    assert len(model.ep_success_buffer) == 4
    env.reset()
    steps = [env.step(np.zeros((2, 6))) for _ in range(STEPS)]
    for k in range(2):
        assert_judged_at_the_end([infos[k]["is_success"] for *_, infos in steps])
    env.close()
