"""Pins the speed measurement of training: every column is a rate, and errors are reported."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from spidar_gym.console import run_cli
from train import speed
from train.lib.config import override
from train.residual import PRESETS

pytestmark = pytest.mark.train
ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("json_", [True, False])
def test_every_column_is_a_rate(json_, monkeypatch, capfd):
    small = override(PRESETS["hover-paper-ppo"], envs=2, n_steps=8, batch_size=16, scaling_ticks=4)
    monkeypatch.setitem(PRESETS, "hover-paper-ppo", small)
    monkeypatch.setattr(speed, "ROWS", {"flight": ("hover-paper-ppo", ("flight-fast3",))})
    monkeypatch.setattr(speed, "ROUNDS", 2)
    monkeypatch.setattr(sys, "argv", ["speed", "--seconds", "0.005", *(["--json"] if json_ else [])])
    speed.main()
    out = capfd.readouterr().out
    if not json_:
        assert "bare physics" in out
        assert "+ learner" in out
        return
    result = json.loads(out)
    row = result["speed"]["flight"]
    rates = row["ticks_per_s"]
    assert list(rates) == list(speed.COLUMNS)
    assert all(rate > 0.0 for rate in rates.values())
    assert row["robots"] == 2
    assert "torch" in result["machine"]


def test_a_learner_is_timed_in_segments_of_a_rollout_from_the_first_tick_on():
    for name, preset in PRESETS.items():
        args = speed.settings(name, preset.env.tracks)
        assert args.schedule.segment == args.learner.ppo.n_steps * args.schedule.envs * args.env.hold
        assert args.learner.critic_first == 0


def test_no_time_to_measure_is_refused(monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", ["speed", "--seconds", "0"])
    with pytest.raises(SystemExit):
        run_cli("train.speed", speed.main)
    assert "train.speed: seconds = 0.0 is not valid; expected a number above 0 [s]" in capfd.readouterr().err


def test_without_a_learning_framework_it_is_refused_in_one_line(tmp_path):
    (tmp_path / "stable_baselines3.py").write_text("raise ModuleNotFoundError(name='stable_baselines3')")
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    command = [sys.executable, "-m", "train.speed"]
    found = subprocess.run(command, cwd=tmp_path, env=environ, capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (2, "")
    (line,) = found.stderr.splitlines()
    assert line.startswith("train.speed: ")
    assert "pip install -e '.[train]'" in line
