"""Tests the training of standard algorithms: resumed runs, their results and artifacts, variants, arguments."""

import dataclasses
import sys

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from spidar_gym.benchmark.suite import METRICS, play
from spidar_gym.benchmark.suite_results import read_results
from spidar_gym.envs.suite import SUITE
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.artifact import LearnedPolicy, read_artifact
from train import standard
from train.standard import Args, Run

pytestmark = pytest.mark.train
TINY = {
    "ppo": {"robots": 4, "n_steps": 8, "batch_size": 16, "n_epochs": 2},
    "sac": {"robots": 4, "batch_size": 16, "buffer_size": 500, "learning_starts": 20, "gradient_steps": 1},
}
NAMES = ("results.csv", "policy.npz")


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Make runs of two pieces, with few robots and short evaluations."""
    monkeypatch.setattr(standard, "PIECES", 2)
    monkeypatch.setattr(standard, "EPISODES", 3)
    monkeypatch.setattr(standard, "EVALUATED", 2)
    monkeypatch.setattr(standard, "ALGORITHMS", {name: {**standard.ALGORITHMS[name], **TINY[name]} for name in TINY})


@pytest.mark.parametrize("algorithm", TINY)
def test_a_resumed_run_ends_as_one_that_was_not_interrupted(tmp_path, algorithm):
    args = Args("Hover", algorithm, seed=1, steps=2000, out=tmp_path / "whole")
    whole, cut = Run(args), Run(dataclasses.replace(args, out=tmp_path / "cut"))
    whole.learn()
    cut._piece()
    cut._keep()
    again = Run(cut.args)
    assert again.done == 1
    again.learn()
    assert [path.name for path in sorted(whole.folder.iterdir())] == [
        path.name for path in sorted(cut.folder.iterdir())
    ]
    first, second = (read_results(run.folder / "results.csv") for run in (whole, again))
    assert [dataclasses.replace(row, seconds=0.0) for row in first] == [
        dataclasses.replace(row, seconds=0.0) for row in second
    ]
    one, two = (read_artifact(run.folder / "policy.npz") for run in (whole, again))
    assert [each.tobytes() for each in one.weights] == [each.tobytes() for each in two.weights]
    other = Run(dataclasses.replace(args, seed=2, out=tmp_path / "other"))
    other.learn()
    assert read_artifact(other.folder / "policy.npz").weights[0].tobytes() != one.weights[0].tobytes()


def test_the_artifact_is_the_policy_that_was_evaluated(tmp_path):
    run = Run(Args("Crawl", "ppo", steps=2000, out=tmp_path))
    run.learn()
    rows = read_results(run.folder / "results.csv")
    assert {(row.algorithm, row.task, row.seed) for row in rows} == {("ppo", "Crawl", 0)}
    assert [row.metric for row in rows] == [*METRICS] * 2
    assert [row.step for row in rows[:: len(METRICS)]] == [1120, 2080], "whole rollouts of 4 robots, 8 steps, 5 ticks"
    found = play("Crawl", LearnedPolicy(read_artifact(run.folder / "policy.npz")), 3).means
    assert {row.metric: row.value for row in rows[-len(METRICS) :]} == pytest.approx(found, rel=1e-5)
    seen, _ = run.env.venv.vector.reset(seed=3)
    ours = run.artifact().act(seen)
    theirs, _ = run.model.predict(seen, deterministic=True)
    assert ours == pytest.approx(theirs, abs=1e-5)


def test_a_variant_trains_with_another_mode_or_reward_and_is_evaluated_on_the_task(tmp_path):
    run = Run(Args("Hover", "ppo", steps=2000, mode="direct", reward="narrow", out=tmp_path))
    assert run.folder == tmp_path / "Hover-direct-narrow" / "ppo-0"
    single = run.env.venv.vector
    assert type(single.task).__name__ == "HoverTask"
    assert single.single_action_space.shape == (40,)
    assert run.artifact().arguments == {"action_mode": "direct", "observation": "scaled"}
    same = Run(Args("Hover", "ppo", steps=2000, mode="torso_forces", reward="sloped", out=tmp_path))
    assert same.options == dict(SUITE["Hover"].options)


def test_other_arguments_are_refused_with_the_valid_ones(tmp_path, monkeypatch, capsys):
    with pytest.raises(UnknownNameError, match="HoverResidual, Hover"):
        Args("Swim", "ppo")
    with pytest.raises(UnknownNameError, match="ppo, sac"):
        Args("Hover", "td3")
    with pytest.raises(InvalidValueError, match=r"seed = -1 .* 0 … 499"):
        Args("Hover", "ppo", seed=-1)
    with pytest.raises(InvalidValueError, match="at least 2000"):
        Args("Hover", "ppo", steps=10)
    run = Run(Args("Hover", "ppo", steps=2000, out=tmp_path))
    run._piece()
    run._keep()
    with pytest.raises(InvalidValueError, match="that of the run in"):
        Run(Args("Hover", "ppo", steps=4000, out=tmp_path))
    monkeypatch.setattr(sys, "argv", ["train.standard", "Hover", "ppo", "--steps", "2000", "--out", str(tmp_path)])
    standard.main()
    assert "spidar run spidar_suite/Hover-v1 --policy" in capsys.readouterr().out
