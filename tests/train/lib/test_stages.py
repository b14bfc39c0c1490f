"""Pins the progress of a run: its stages, each in its own unit, and its verdict against the base."""

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from train.lib.evaluate import Verdict
from train.lib.stages import Stages

pytestmark = pytest.mark.train


def test_every_stage_has_its_own_bar_and_unit_and_the_latest_verdict_stays(capfd):
    with Stages("run") as stages:
        stages.begin("playing the base", 3, "scenario")
        stages.count(3)
        stages.begin("learning", 100, "tick", done=50)
        stages.evaluated(Verdict({"flight-fast3": {"position_rms_m": -0.25}}, 0.0, False))
        stages.say("warming up the critic")
        stages.count(50)
    first, second = (line.split("\r")[-1] for line in capfd.readouterr().err.replace("\n", "@").split("@")[:2])
    assert first.startswith("run: playing the base: 100%")
    assert "scenario/s" in first or "s/scenario" in first
    assert second.startswith("run: warming up the critic: 100%")
    assert "against the base -25.0%" in second
    assert "tick" in second
    assert "it/s" not in first + second
