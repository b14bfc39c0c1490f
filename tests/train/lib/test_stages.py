"""Pins the progress of a run: stages with their units, the verdict, and the wall time of the parts."""

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from train.lib.evaluate import Verdict
from train.lib.stages import Stages

pytestmark = pytest.mark.train


def test_every_stage_has_its_own_bar_and_unit_and_the_latest_verdict_stays(capfd):
    with Stages("run", {}) as stages:
        stages.begin("evaluating the base", 3, "scenario", "validation")
        stages.count(3)
        stages.begin("learning", 100, "tick", "learner", done=50)
        stages.evaluated(Verdict({"flight-fast3": {"position_rms_m": -0.25}}, 0.0, False))
        stages.say("warming up the critic", "learner")
        stages.count(50)
    first, second = (line.split("\r")[-1] for line in capfd.readouterr().err.replace("\n", "@").split("@")[:2])
    assert first.startswith("run: evaluating the base: 100%")
    assert "scenario/s" in first or "s/scenario" in first
    assert second.startswith("run: warming up the critic: 100%")
    assert "against the base -25.0%" in second
    assert "tick" in second
    assert "it/s" not in first + second


def test_every_second_belongs_to_a_part_and_a_resumed_run_keeps_its_times(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("train.lib.stages.time.perf_counter", lambda: now[0])

    def later(seconds):
        now[0] += seconds

    parts = {"learner": 7.0}
    with Stages("run", parts) as stages:
        later(1.0)
        stages.begin("evaluating the base", 3, "scenario", "validation")
        later(2.0)
        stages.begin("learning", 100, "tick", "learner")
        later(4.0)
        stages.say("learning on", "learner")
        later(8.0)
        stages.hand_over({"engine": 5.0, "policy": 0.5})
        stages.say("comparing with the base", "validation")
        later(16.0)
    assert parts == {"rest": 1.0, "validation": 18.0, "learner": 7.0 + 12.0 - 5.5, "engine": 5.0, "policy": 0.5}
