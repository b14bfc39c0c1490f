"""Pins the training environments: seeds, scaling, held actions and washout."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from support.training import TINY

from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import CRAWL, HOVER, TRACKS
from spidar_gym.policies.artifact import Washout
from train.lib.config import CONTROL
from train.lib.envs import FIRST_SEED, NOMINAL, EnvConfig, make_track_env, training_seed
from train.lib.rewards import RewardConfig
from train.lib.vector import TrainingVec, baseline_scaling

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("short")]


def test_no_seed_of_training_is_one_of_a_scenario():
    known = {s.seed for track in TRACKS for split in TRACKS[track].splits for s in load_scenarios(track, split)[0]}
    assert max(known) < FIRST_SEED
    drawn = {training_seed(run, *words) for run in range(20) for words in ((0, 3), (1, 7), (2, 1, 5), (3,))}
    assert len(drawn) == 80
    assert min(drawn) >= FIRST_SEED
    assert max(drawn) < 2**32 - 1000  # NumPy's range of seeds, with a margin for one seed per environment


def test_the_scaling_without_a_controller_covers_the_explored_flights():
    config = EnvConfig(HOVER, ("flight-paper",), "paper", "direct")
    robots = TrainingVec(config, RewardConfig(), 3)
    rng, spread, seen = np.random.default_rng(1), 0.135, []
    robots.seed(5)
    robots.reset()
    for _ in range(100):
        action = np.clip(spread * rng.standard_normal((3, *robots.action_space.shape)), -1.0, 1.0)
        seen.append(robots.step(action)[0])
    # Scaled by falls with zero actions, which do not rotate, half of all rates would exceed the clipping bound.
    for tried, blind in ((spread, False), (0.0, True)):
        scaling = baseline_scaling(config, 3, 400, tried)
        beyond = np.abs(np.concatenate(seen) - scaling.mean) >= scaling.clip * np.sqrt(scaling.variance)
        assert (beyond.mean() > 0.1) == blind
        assert (beyond.mean() < 0.001) != blind
    robots.close()


def test_a_held_action_adds_up_the_rewards_of_its_ticks():
    single, held = (TrainingVec(replace(TINY.env, hold=hold, washout=0.0), RewardConfig("pose"), 2) for hold in (1, 5))
    action = np.full((2, 6), 0.1)
    for robots in (single, held):
        robots.seed(3)
        robots.reset()
    total = sum(single.step(action)[1] for _ in range(5))
    assert held.step(action)[1] == pytest.approx(total, rel=1e-6)


def test_the_washout_of_training_is_the_artifacts():
    robots = TrainingVec(replace(TINY.env, washout=0.5), RewardConfig(), 2)
    robots.seed(0)
    robots.reset()
    for _ in range(70):
        robots.step(np.full((2, 6), 0.4))
    given = robots._groups[0].vector.robots["episode"]["action"]
    expected, washout = None, Washout(np.full(6, 0.5))
    for _ in range(70):
        expected = washout(np.full(6, 0.4))
    assert given[:, :6] == pytest.approx(np.tile(expected, (2, 1)), rel=1e-12)


CASES = {
    "flights of three tracks, held": (
        EnvConfig(HOVER, NOMINAL, "paper", "residual_wrench", hold=2, washout=1.0, still=(2,)),
        RewardConfig("pose", velocity=0.03),
    ),
    "flights that fall": (EnvConfig(HOVER, ("flight-paper",), "paper", "direct", hold=3), RewardConfig()),
    "crawls of drawn robots": (
        EnvConfig(CRAWL, ("ground-randomised",), "robust_overlapped", "residual_gait_force", hold=10),
        RewardConfig("economy", reward_scale=10.0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_observations_and_rewards_of_a_robot_do_not_depend_on_the_others(case, monkeypatch):
    config, reward = CASES[case]
    for track in config.tracks:
        monkeypatch.setitem(TRACKS, track, replace(TRACKS[track], seconds=1.0))
    robots, tracks, rng = TrainingVec(config, reward, 5, threads=2), len(config.tracks), np.random.default_rng(4)
    actions = rng.uniform(-1.0, 1.0, (50, 5, *robots.action_space.shape))
    robots.seed(11)
    played = [(robots.reset(), *[None] * 3), *[robots.step(each) for each in actions]]
    assert sum(step[2].sum() for step in played[1:]) >= 5
    for k in range(5):
        alone = TrainingVec(replace(config, tracks=(config.tracks[k % tracks],)), reward, 1)
        alone.seed(11 + k)
        assert np.array_equal(alone.reset()[0], played[0][0][k])
        for action, (seen, earned, done, infos) in zip(actions, played[1:], strict=True):
            own = alone.step(action[k : k + 1])
            assert np.array_equal(own[0][0], seen[k])
            assert (own[1][0], own[2][0]) == (earned[k], done[k])
            assert own[3][0].keys() == infos[k].keys()
            if done[k]:
                assert np.array_equal(own[3][0]["terminal_observation"], infos[k]["terminal_observation"])
                assert own[3][0]["TimeLimit.truncated"] == infos[k]["TimeLimit.truncated"]
                assert own[3][0]["episode"]["r"] == infos[k]["episode"]["r"]
                assert own[3][0]["episode"]["l"] == infos[k]["episode"]["l"]
        alone.close()
    robots.close()


def test_rewards_follow_from_the_info_of_a_single_environment():
    config, reward = replace(TINY.env, washout=0.0), RewardConfig("pose", velocity=0.1, rate=0.2)
    robots = TrainingVec(config, reward, 1)
    env = make_track_env("flight-fast3", config.arguments, CONTROL).unwrapped
    robots.seed(8)
    assert np.array_equal(robots.reset()[0], env.reset(seed=8)[0])
    for action in np.random.default_rng(0).uniform(-1.0, 1.0, (20, 6)):
        observation, *_, info = env.step(action)
        seen, earned, _, _ = robots.step(action[None])
        assert np.array_equal(seen[0], observation)
        error = env.truth.error
        pairs = (
            (info["position_error"], 0.01),
            (info["attitude_error"], 0.02),
            (error.velocity_w, 0.1),
            (error.omega_b, 0.2),
        )
        terms = [1.0 / (1.0 + float(value @ value) / unit**2) for value, unit in pairs]
        assert earned[0] == pytest.approx(np.mean(terms) * (1.0 - 0.05 * np.mean(action**2)), rel=1e-6)
    robots.close()
