"""Pins PPO and SAC: an agent starts as its base, results are reproducible, and interruptions have no effect."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from support.training import TINY, parameters, same

from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.artifact import read_artifact
from train.lib import evaluate
from train.lib.config import override
from train.lib.envs import FIRST_SEED, Scaling
from train.lib.vector import baseline_scaling
from train.residual import PRESETS, learn, make_agent, make_robots

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("short")]


def test_training_resets_with_its_own_seeds_and_uses_validation_scenarios_only(tmp_path, monkeypatch):
    seeds, splits = [], []
    resets, load = {kind: kind.reset for kind in (SpidarEnv, NativeVectorEnv)}, load_scenarios

    def spy(self, *, seed=None, options=None):
        given = seed if isinstance(seed, list) else [seed]
        seeds.extend((one, "start" in (options or {})) for one in given if one is not None)
        return resets[NativeVectorEnv if isinstance(self, NativeVectorEnv) else SpidarEnv](
            self, seed=seed, options=options
        )

    def look(name, split="test"):
        splits.append(split)
        return load(name, split)

    for kind in resets:
        monkeypatch.setattr(kind, "reset", spy)
    monkeypatch.setattr(evaluate, "load_scenarios", look)
    learn(override(TINY, steps=96, out=tmp_path))
    assert set(splits) == {"validation"}
    assert {scenario for _, scenario in seeds} == {True, False}
    allowed = {s.seed for s in load("flight-fast3", "validation")[0]}
    assert {seed for seed, scenario in seeds if scenario} <= allowed
    assert min(seed for seed, scenario in seeds if not scenario) >= FIRST_SEED


def test_a_run_is_scaled_by_its_base_and_without_one_by_its_own_first_exploration(done, tmp_path, monkeypatch):
    monkeypatch.setitem(TRACKS, "flight-paper", replace(TRACKS["flight-paper"], seconds=2.0))
    alone = override(
        PRESETS["hover-direct-ppo"], steps=32, segment=32, envs=1, n_steps=16, batch_size=16, epochs=1,
        hidden=8, critic_hidden=8, scenarios=1, scaling_ticks=100, out=tmp_path,
    )  # fmt: skip
    for args, folder, spread in ((TINY, done, 0.0), (alone, learn(alone).parent, np.exp(alone.learner.log_std))):
        scaling = baseline_scaling(args.env, args.seed, args.schedule.scaling_ticks // args.env.hold, spread)
        found = read_artifact(folder / "policy.npz")
        np.testing.assert_allclose(found.mean, scaling.mean, rtol=1e-6)
        np.testing.assert_allclose(found.variance, scaling.variance, rtol=1e-6)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_starts_with_a_mean_action_of_zero_and_small_exploration(name):
    args = override(PRESETS[name], envs=1, n_steps=8, batch_size=8, buffer=100)
    size = len(args.env.hidden_entries())
    envs = make_robots(args, Scaling(np.zeros(size), np.ones(size)))
    model, observation = make_agent(args, envs), envs.reset()[0]
    np.testing.assert_array_equal(model.predict(observation, deterministic=True)[0], 0.0)
    drawn = np.array([model.predict(observation)[0] for _ in range(200)])
    assert drawn.std() == pytest.approx(np.exp(args.learner.log_std), rel=0.2)


def test_the_same_seed_gives_the_same_checkpoint_and_another_one_another(done, tmp_path):
    again = learn(override(TINY, out=tmp_path / "again")).parent
    mine, theirs = parameters(done), parameters(again)
    assert same(mine, theirs)
    assert (again / "policy.npz").read_bytes() == (done / "policy.npz").read_bytes()
    other = learn(override(TINY, seed=1, out=tmp_path / "other")).parent
    name = "learner/policy/action_net.weight"
    assert not np.array_equal(parameters(other)[name], mine[name])


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_an_interrupted_run_resumes_with_the_same_result(done, tmp_path, algorithm):
    args = override(TINY, out=tmp_path / "cut")
    if algorithm == "sac":
        args = override(args, algorithm="sac", buffer=500, warmup=24, updates=2, tracks=("flight-fast3",))
        done = learn(override(args, out=tmp_path / "whole")).parent

    def stop(line):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learn(args, on_segment=stop)
    folder = tmp_path / "cut" / args.name / "seed0"
    assert not (folder / "policy.npz").exists()
    assert learn(args) == folder / "policy.npz"
    mine, theirs = parameters(done), parameters(folder)
    assert same(mine, theirs)
    assert (folder / "policy.npz").read_bytes() == (done / "policy.npz").read_bytes()


def test_what_was_learned_is_in_the_artifact(done):
    learned = read_artifact(done / "policy.npz")
    assert (learned.name, learned.kind, learned.env_id) == ("ppo_paper", "residual", "spidar_gym/Hover-v0")
    assert learned.arguments == {"action_mode": "residual_wrench", "preset": "paper"}
    assert np.abs(learned.weights[-1]).max() > 0.0
    np.testing.assert_array_equal(learned.washout, TINY.env.washout_times())
    assert learned.training["steps"] == 192
    assert [steps for steps, _ in learned.training["curve"]] == [96, 192]
    curve = json.loads((done / "curve.json").read_text())
    assert curve["seconds"] > 0.0
    assert set(curve["curve"][0]["cells"]["flight-fast3"]) == {"position_rms_m", "attitude_rms_rad"}


def test_an_agent_that_is_worse_than_its_base_is_not_chosen(tmp_path):
    wild = override(TINY, lr=1.0, lr_end=1.0, average=0.0, select=True, out=tmp_path)
    learned = read_artifact(learn(wild))
    curve = json.loads((tmp_path / "ppo_paper" / "seed0" / "curve.json").read_text())
    assert all(line["worst"] > 0.1 for line in curve["curve"])
    np.testing.assert_array_equal(learned.weights[-1], 0.0)  # the base itself
    assert curve["chosen"] == {"steps": 0, "score": 0.0}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"algorithm": "trpo"}, "unknown algorithm 'trpo'; valid: ppo, sac"),
        ({"average": 1.0}, "average = 1.0 is not valid"),
        ({"gamma": 1.5}, "gamma = 1.5 is not valid"),
        ({"steps": 0}, "steps = 0 is not valid"),
        ({"tracks": ()}, "at least one track"),
        ({"reward": "joy"}, "unknown reward 'joy'; valid: environment, pose, economy"),
        ({"tracks": ("flight-to-mars",)}, "unknown track 'flight-to-mars'"),
        ({"tracks": ("flight-path",)}, "tracks of spidar_gym/Hover-v0"),
        ({"base": "best"}, "unknown preset 'best'"),
    ],
)
def test_settings_that_cannot_be_learned_with_are_refused(tmp_path, change, words):
    with pytest.raises((InvalidValueError, UnknownNameError), match=words):
        learn(override(TINY, out=tmp_path, **change))
