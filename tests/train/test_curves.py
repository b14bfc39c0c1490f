"""Pins learning curves: collected from runs, plotted as absolute values from the base on, rejected if damaged."""

import json
import re
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from spidar_gym.cli.tables import read_result
from spidar_gym.errors import SpidarError
from spidar_gym.text import format_table
from train.curves import cost_lines, gather, panels, read_curve, write_costs

pytestmark = pytest.mark.train
ROOT = Path(__file__).resolve().parents[2]


def line(steps, position, attitude):
    return {
        "steps": steps,
        "seconds": 0.6 * steps,
        "cells": {"flight-fast3": {"position_rms_m": position, "attitude_rms_rad": attitude}},
    }


def run(folder, seed, *lines, **more):
    path = folder / "ppo" / f"seed{seed}" / "curve.json"
    path.parent.mkdir(parents=True)
    base = {"flight-fast3": {"position_rms_m": 0.01, "attitude_rms_rad": 0.02}}
    path.write_text(json.dumps({"settings": {"scenarios": 2}, "base": base, "curve": list(lines)} | more))


def test_all_seeds_of_a_row_are_in_one_file_and_start_as_their_base(tmp_path):
    run(tmp_path / "runs", 0, line(100, -0.5, 0.0), line(200, -0.75, 0.5))
    run(tmp_path / "runs", 1, line(100, 0.1, 0.1))
    (path,) = gather(tmp_path / "runs", tmp_path / "curves")
    assert path.name == "ppo.json"
    curve = read_curve(path)
    assert len(curve["runs"]) == 2
    found = panels([curve], "flight-fast3")
    first, second = found["position_rms_m"]["ppo"]
    assert (first.ticks, first.minutes) == ((0.0, 100, 200), pytest.approx((0.0, 1.0, 2.0)))
    assert first.values == pytest.approx([0.01, 0.005, 0.0025])
    assert (second.ticks, second.values) == ((0.0, 100), pytest.approx([0.01, 0.011]))
    assert found["attitude_rms_rad"]["ppo"][0].values == pytest.approx([0.02, 0.02, 0.03])
    assert panels([curve], "flight-fast5") == {}


def test_the_curve_of_a_run_without_controller_does_not_start_at_the_base(tmp_path):
    run(tmp_path / "runs", 0, line(100, 9.0, 4.0), settings={"action_mode": "direct"})
    (path,) = gather(tmp_path / "runs", tmp_path / "curves")
    (curve,) = panels([read_curve(path)], "flight-fast3")["position_rms_m"]["ppo"]
    assert (curve.ticks, curve.values) == ((100,), pytest.approx([0.1]))


def test_the_curve_of_imitation_does_not_start_at_the_base(tmp_path):
    run(tmp_path / "runs", 0, line(100, -0.5, 0.0), command="python -m train.distill hover --seed 0")
    (path,) = gather(tmp_path / "runs", tmp_path / "curves")
    (curve,) = panels([read_curve(path)], "flight-fast3")["position_rms_m"]["ppo"]
    assert (curve.ticks, curve.values) == ((100,), pytest.approx([0.005]))


def test_the_guide_lists_the_costs_of_every_committed_row(tmp_path):
    curves = [read_curve(path) for path in sorted((ROOT / "train" / "curves").glob("*.json"))]
    write_costs(curves, tmp_path / "costs.json")
    assert read_result(tmp_path / "costs.json")["lines"] == cost_lines(curves)
    page = (ROOT / "docs" / "studies" / "learning.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"<!-- table: learned_costs -->\n(.*?)\n\n.*?<!-- /table -->", page, re.S)
    assert shown == format_table(cost_lines(curves), markdown=True)


def test_costs_are_ranges_over_the_runs(tmp_path):
    for seed, (steps, seconds) in enumerate(((200_000, 50.0), (200_400, 150.0))):
        run(
            tmp_path / "runs", seed, line(steps, -0.5, 0.0), seconds=seconds, chosen={"steps": steps, "score": -0.25},
            parts={"learner": 0.2 * seconds, "engine": 0.8 * seconds, "rest": 0.001},
        )  # fmt: skip
    (path,) = gather(tmp_path / "runs", tmp_path / "curves")
    curve = read_curve(path)
    _, row = cost_lines([curve])
    assert row == ["ppo", "2", "200 k", "0.8 … 2.5", "1336 … 4000", "engine 80%, learner 20%", "200 k", "-25.0 %"]
    for each in curve["runs"]:
        del each["parts"]  # as in versions that did not measure them
    assert cost_lines([curve])[1][5] == "not measured"


def test_a_damaged_curve_is_refused_in_words(tmp_path):
    run(tmp_path / "runs", 0, line(100, 0.0, 0.0))
    (tmp_path / "runs" / "ppo" / "seed0" / "curve.json").write_text("{")
    with pytest.raises(SpidarError, match="is no learning curve"):
        gather(tmp_path / "runs", tmp_path / "curves")
    assert not (tmp_path / "curves").exists()


def test_a_picture_has_a_panel_for_each_metric(tmp_path):
    from spidar_gym.viz import learning_curves

    run(tmp_path / "runs", 0, line(100, -0.5, 0.1))
    (path,) = gather(tmp_path / "runs", tmp_path / "curves")
    drawn = panels([read_curve(path)], "flight-fast3")
    lines = {"qp": {"position_rms_m": 0.01, "attitude_rms_rad": 0.02}}
    learning_curves(drawn, lines, "title", tmp_path / "curve.png")
    from PIL import Image

    with Image.open(tmp_path / "curve.png") as picture:
        assert picture.width > 1.2 * picture.height
