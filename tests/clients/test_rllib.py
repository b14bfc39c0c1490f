"""Pins RLlib as a client: PPO by id, with the module before the colon, and its own vector step by step."""

import numpy as np
import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

pytestmark = [*needs("ray", "tree", "lz4", "torch"), pytest.mark.train]


def test_what_the_guide_shows_learns_and_its_episodes_report_success_at_their_end():
    made = run_shown("rllib")
    result, algorithm = made["result"], made["algorithm"]
    assert (result["episode_len_min"], result["episode_len_max"]) == (STEPS, STEPS)
    assert result["num_episodes"] == 4
    assert 0.0 < result["episode_return_mean"] < STEPS
    envs = algorithm.env_runner.env  # its infos are lists
    envs.reset(seed=0)
    steps = [envs.step(np.zeros(envs.action_space.shape, np.float32)) for _ in range(STEPS)]
    assert_judged_at_the_end([infos[0]["is_success"] for *_, infos in steps])
    algorithm.stop()
