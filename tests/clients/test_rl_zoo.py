"""Pins RL Zoo as a client, with Optuna: its two commands, with the presets of this repository."""

import os
import subprocess
import sys

import numpy as np
import pytest
from support.clients import ROOT, STEPS, needs, shown

pytestmark = [*needs("rl_zoo3", "optuna"), pytest.mark.train]


def test_what_the_guide_shows_trains_evaluates_and_searches(tmp_path):
    code = shown()["rl_zoo"].replace("train/zoo", str(ROOT / "train" / "zoo"))
    python = os.path.dirname(sys.executable)
    environ = {**os.environ, "PATH": f"{python}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", code], cwd=tmp_path, env=environ, capture_output=True, text=True,
        stdin=subprocess.DEVNULL, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    found = np.load(tmp_path / "logs" / "ppo" / "spidar_gym-Hover-v0_1" / "evaluations.npz")
    assert found["ep_lengths"].tolist() == [[STEPS] * 2] * len(found["timesteps"])
    assert len(found["timesteps"]) >= 1
    # An evaluation has no noise, so it nearly equals a flight of the controller.
    assert found["successes"].all()
    assert np.isfinite(found["results"]).all()
    assert "Number of finished trials:  2" in done.stdout
    assert list((tmp_path / "logs" / "ppo").glob("report_*.csv"))
