"""Pins a single-file training loop in the style of CleanRL, over Gymnasium's vector interface."""

import numpy as np
import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

pytestmark = [*needs("torch"), pytest.mark.train]


def test_what_the_guide_shows_learns_and_counts_returns_and_successes():
    made = run_shown("cleanrl")
    assert np.isfinite(made["loss"].item())
    assert all(parameter.grad.abs().sum() > 0.0 for parameter in made["actor"].parameters())
    # 160 ticks of four robots: two episodes each, with the steps of the resets.
    assert len(made["returns"]) == len(made["successes"]) == 8
    assert all(0.0 < total < STEPS for total in made["returns"])
    envs = made["envs"]
    envs.reset(seed=0)
    steps = [envs.step(np.zeros((4, 6), np.float32)) for _ in range(STEPS)]
    for k in range(4):
        assert_judged_at_the_end([bool(info["is_success"][k]) for *_, info in steps])
    envs.close()
