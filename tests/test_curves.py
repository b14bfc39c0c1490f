"""Pins learning curves: gathered from runs, drawn in absolute numbers from the base on, refused where damaged."""

import json

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from spidar_gym.errors import SpidarError
from train.curves import gather, panels, read_curve

pytestmark = pytest.mark.train


def line(steps, position, attitude):
    return {"steps": steps, "cells": {"flight-fast3": {"position_rms_m": position, "attitude_rms_rad": attitude}}}


def run(folder, seed, *lines):
    path = folder / "ppo" / f"seed{seed}" / "curve.json"
    path.parent.mkdir(parents=True)
    base = {"flight-fast3": {"position_rms_m": 0.01, "attitude_rms_rad": 0.02}}
    path.write_text(json.dumps({"settings": {"scenarios": 2}, "base": base, "curve": list(lines)}))


def test_all_seeds_of_a_row_are_in_one_file_and_start_as_their_base(tmp_path):
    run(tmp_path / "runs", 0, line(100, -0.5, 0.0), line(200, -0.75, 0.5))
    run(tmp_path / "runs", 1, line(100, 0.1, 0.1))
    (path,) = gather(tmp_path / "runs", tmp_path / "curves")
    assert path.name == "ppo.json"
    curve = read_curve(path)
    assert len(curve["runs"]) == 2
    found = panels([curve], "flight-fast3")
    first, second = found["position_rms_m"]["ppo"]
    assert first == ([0.0, 100, 200], pytest.approx([0.01, 0.005, 0.0025]))
    assert second == ([0.0, 100], pytest.approx([0.01, 0.011]))
    assert found["attitude_rms_rad"]["ppo"][0][1] == pytest.approx([0.02, 0.02, 0.03])
    assert panels([curve], "flight-fast5") == {}


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
        assert picture.width > 2 * picture.height
