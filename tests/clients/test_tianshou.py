"""Pins Tianshou as a client: PPO on its own vector, whose buffer stores every text and number of `info`."""

import numpy as np
import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

pytestmark = [*needs("tianshou"), pytest.mark.train]


def test_what_the_guide_shows_learns_and_its_buffer_stores_all_of_info():
    made = run_shown("tianshou")
    result, collector = made["result"], made["collector"]
    assert (result.train_step, result.train_episode) == (480, 8)
    told = collector.collect(n_episode=2, reset_before_collect=True)
    assert told.lens.tolist() == [STEPS] * 2
    assert ((told.returns > 0.0) & (told.returns < STEPS)).all()
    kept = collector.buffer.sample(0)[0]
    assert kept.truncated.sum() == 2
    assert set(kept.info.failure) == {""}
    assert np.isfinite(kept.obs).all()
    assert kept.info.position_error.shape == (2 * STEPS, 3)
    envs = made["envs"]
    envs.reset()
    steps = [envs.step(np.zeros((2, 6))) for _ in range(STEPS)]
    for k in range(2):
        assert_judged_at_the_end([infos[k]["is_success"] for *_, infos in steps])
