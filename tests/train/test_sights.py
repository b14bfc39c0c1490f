"""Pins the learners of every observation mode: each is trained, compared with the controller alone and reported."""

import json
import sys

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from spidar_gym.console import run_cli
from train import sights

pytestmark = pytest.mark.train


@pytest.mark.parametrize("name", sights.CASES)
def test_a_learner_is_trained_and_evaluated(name, monkeypatch, capfd):
    monkeypatch.setattr(sights, "JUDGED", 2)
    for options in (sights.CRAWLS, sights.FLIGHTS):
        monkeypatch.setitem(options, "max_episode_steps", 20)
    monkeypatch.setitem(sights.CASES[name].options, "max_episode_steps", 20)
    monkeypatch.setattr(sys, "argv", ["sights", "--only", name, "--seconds", "1.5", "--json"])
    sights.main()
    (row,) = json.loads(capfd.readouterr().out)["learners"].values()
    assert row["steps"] > 168
    assert row["updates"] > 0
    assert row["processor_ms"] > 0.0
    assert row["alone"].keys() == row["learned"].keys() >= {"reward", "success"}
    is_goal = "goal" in name
    assert all(
        -1.0 <= row[who]["reward"] <= 0.0 if is_goal else row[who]["reward"] >= 0.0 for who in ("alone", "learned")
    )
    assert (row["explained"] is None) == name.startswith("crawl")


def test_an_unknown_learner_is_refused(monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", ["sights", "--only", "walk"])
    with pytest.raises(SystemExit):
        run_cli("train.sights", sights.main)
    assert "train.sights: unknown learner 'walk'; valid: crawl, flat, SAC" in capfd.readouterr().err
