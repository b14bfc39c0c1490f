"""Pins the final report of a run: comparison with the base, and commands for the next steps."""

import json

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from spidar_gym.benchmark.track import HOVER
from train.lib.report import conclusion

pytestmark = pytest.mark.train
LINE = {
    "steps": 64, "score": -0.1, "worst": 0.01, "success": 0.0,
    "cells": {"flight-fast3": {"position_rms_m": -0.21, "attitude_rms_rad": 0.01}},
}  # fmt: skip


def concluded(folder, chosen):
    (folder / "curve.json").write_text(json.dumps({"chosen": chosen, "curve": [LINE | {"steps": 32}, LINE]}))
    return conclusion(folder / "policy.npz", "paper", HOVER, ("flight-fast3",))


def test_the_conclusion_compares_in_words_and_numbers_and_names_commands(tmp_path):
    said = concluded(tmp_path, {"steps": 64, "score": -0.1})
    assert "10.0% better than paper in the mean, chosen after 64 ticks; worst +1.0%" in said
    assert "flight-fast3 position -21.0%, attitude +1.0%" in said
    assert f"spidar run {HOVER} --policy {tmp_path / 'policy.npz'} --out {tmp_path / 'film.mp4'}" in said
    assert f"spidar eval --policy {tmp_path / 'policy.npz'} --tracks flight-fast3" in said


def test_the_conclusion_states_whether_the_agent_is_better(tmp_path):
    assert "no agent of 2 did better than paper" in concluded(tmp_path, {"steps": 0, "score": 0.0})
    assert "3.0% worse than paper" in concluded(tmp_path, {"steps": 64, "score": 0.03})
