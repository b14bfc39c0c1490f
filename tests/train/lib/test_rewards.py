"""Pins the training rewards: their names, and the terms of the reward for crawls."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from train.lib.rewards import REWARDS, RewardConfig, Tick

pytestmark = pytest.mark.train


def test_a_crawl_is_over_when_it_is_finished_and_its_reward_prefers_the_shorter_way_to_it():
    assert set(REWARDS) == {"environment", "pose", "economy"}
    info = {"failure_code": -1, "energy_wh": 1.0, "foot_slip_m": 0.0, "remaining": 0.5, "way": 0.5}
    config = RewardConfig("economy", penalty=0.0)

    def reward(**after):
        now, before = ({name: np.array([x]) for name, x in told.items()} for told in ({**info, **after}, info))
        return REWARDS["economy"](config, Tick(np.zeros(1), now, before, np.zeros((1, 4)), np.zeros(1))).item()

    assert reward(remaining=0.4) == pytest.approx(0.2)  # a fifth of the distance
    assert reward(energy_wh=2.0) == pytest.approx(-0.1)  # a tenth of 20 Wh/m
    assert reward(foot_slip_m=0.05) == pytest.approx(-0.5)
    assert reward(failure_code=1) == -1.0
