"""Pins the speed of learning: the same work is timed in every column, and every column is a rate."""

import json
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from spidar_gym.cli.console import run_cli
from train import speed
from train.lib.config import override
from train.lib.envs import make_track_env
from train.residual import PRESETS

pytestmark = pytest.mark.train
ROOT = Path(__file__).resolve().parents[2]


def test_the_same_ticks_are_timed_without_and_with_the_controller():
    arguments = PRESETS["hover-paper-ppo"].env.arguments
    env = make_track_env("flight-randomised", arguments, speed.CONTROL)
    seconds, saved, commands = speed.play(env, 3, 6)
    after = env.unwrapped.state
    assert seconds > 0.0
    assert len(commands) == 6
    assert speed.replay(speed.plant_of(env), saved, commands) > 0.0
    again = env.unwrapped.plant.state()
    for field in fields(after):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(after, field.name))


@pytest.mark.parametrize("json_", [True, False])
def test_every_column_is_a_rate(json_, monkeypatch, capfd):
    small = override(PRESETS["hover-paper-ppo"], envs=2, batch_size=16, scaling_ticks=4)
    monkeypatch.setitem(PRESETS, "hover-paper-ppo", small)
    monkeypatch.setattr(speed, "ROWS", {"flight": ("hover-paper-ppo", ("flight-fast3",))})
    monkeypatch.setattr(speed, "ROUNDS", 2)
    monkeypatch.setattr(sys, "argv", ["speed", "--seconds", "0.005", *(["--json"] if json_ else [])])
    speed.main()
    out = capfd.readouterr().out
    if not json_:
        assert "simulation" in out
        assert "+ learner" in out
        return
    result = json.loads(out)
    row = result["speed"]["flight"]
    rates = row["ticks_per_s"]
    assert list(rates) == list(speed.COLUMNS)
    assert all(rates[name] > 0.0 for name in ("simulation", "allocator_python", "learner"))
    assert (rates["allocator_core"] is None) == (row["learner_control"] == "python")
    assert "torch" in result["machine"]


def test_a_learner_is_timed_in_segments_of_a_batch_that_do_as_much_a_tick_as_long_ones():
    for name, preset in PRESETS.items():
        args = speed.settings(name, preset.env.tracks)
        assert args.learner.ppo.n_steps * args.schedule.envs == args.learner.batch_size
        assert args.schedule.segment == args.learner.batch_size * args.env.hold
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
