"""Pins Stable-Baselines3 as a client: it learns by id, and records successes of episodes."""

import numpy as np
import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

pytestmark = [*needs("stable_baselines3", "torch"), pytest.mark.train]


def test_what_the_guide_shows_learns_and_counts_successes():
    made = run_shown("stable_baselines")
    model, env = made["model"], made["env"]
    assert model.num_timesteps == 512
    assert [episode["l"] for episode in model.ep_info_buffer] == [STEPS] * 8
    assert all(0.0 < episode["r"] < STEPS for episode in model.ep_info_buffer)
    assert len(model.ep_success_buffer) == 8
    assert {type(success) for success in model.ep_success_buffer} == {bool}
    action, _ = model.predict(env.reset(), deterministic=True)
    assert np.isfinite(action).all()
    steps = [env.step(np.zeros((2, 6))) for _ in range(STEPS)]
    for k in range(2):
        assert_judged_at_the_end([infos[k]["is_success"] for *_, infos in steps])
    assert all(infos["TimeLimit.truncated"] for infos in steps[-1][-1])
    env.close()
