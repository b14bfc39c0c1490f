"""Pins the environments to learn in: seeds, scaling, held and washed out actions."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from support.training import TINY

from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import SPLITS, TRACKS
from train.lib.config import CONTROL
from train.lib.envs import FIRST_SEED, TrainingEnv, baseline_scaling, make_track_env, make_training_env, training_seed
from train.lib.rewards import RewardConfig

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("short")]


def test_no_seed_of_training_is_one_of_a_scenario():
    known = {s.seed for track in TRACKS for split in SPLITS for s in load_scenarios(track, split)[0]}
    assert max(known) < FIRST_SEED
    drawn = {training_seed(run, *words) for run in range(20) for words in ((0, 3), (1, 7), (2, 1, 5), (3,))}
    assert len(drawn) == 80
    assert min(drawn) >= FIRST_SEED
    assert max(drawn) < 2**32 - 1000  # numpy's seeds, with room for one an environment


def test_a_learner_from_nothing_is_not_blind_in_the_flights_that_it_explores():
    env = TrainingEnv(
        make_track_env("flight-paper", {"action_mode": "direct"}, CONTROL), RewardConfig(), washout=np.zeros(0)
    )
    rng, spread, seen = np.random.default_rng(1), 0.135, []
    observation, _ = env.reset(seed=5)
    for _ in range(300):
        action = np.clip(spread * rng.standard_normal(env.action_space.shape), -1.0, 1.0)
        observation, _, terminated, truncated, _ = env.step(action)
        seen.append(observation)
        if terminated or truncated:
            observation, _ = env.reset()
    # Scaled by a fall without actions, which never turns, half of all rates would lie beyond the clip.
    for tried, blind in ((spread, False), (0.0, True)):
        scaling = baseline_scaling([env], 3, 400, tried)
        beyond = np.abs(np.array(seen) - scaling.mean) >= scaling.clip * np.sqrt(scaling.variance)
        assert (beyond.mean() > 0.1) == blind
        assert (beyond.mean() < 0.001) != blind
    env.close()


def test_a_held_action_adds_up_the_rewards_of_its_ticks():
    single, held = (
        make_training_env(replace(TINY.env, hold=hold, washout=0.0), RewardConfig("pose"), "flight-fast3")
        for hold in (1, 5)
    )
    action = np.full(6, 0.1)
    single.reset(seed=3)
    held.reset(seed=3)
    total = sum(single.step(action)[1] for _ in range(5))
    assert held.step(action)[1] == pytest.approx(total, rel=1e-12)


def test_the_washout_of_training_is_the_artifacts():
    env = make_training_env(replace(TINY.env, washout=0.5), RewardConfig(), "flight-fast3")
    env.reset(seed=0)
    for _ in range(200):
        env.step(np.full(6, 0.4))
    given = env.unwrapped._action
    assert np.abs(given).max() < 1e-4
