"""Pins the example in RLlib with one small iteration; skipped without RLlib, which needs its own environment."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RLLIB = "train/rllib.py says how to make an environment with RLlib"


def called(*options: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "train.rllib", *options]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)


def test_rllib_trains_the_same_id_through_its_own_interface():
    pytest.importorskip("ray.rllib", reason=RLLIB)
    result = called("--iterations", "1", "--batch", "40", "--ticks", "10")
    assert result.returncode == 0, result.stderr
    alone, mean = (float(re.findall(rf"{name} ([\d.]+)", result.stdout)[0]) for name in ("alone:", "mean return"))
    # Ten ticks, each with a reward of at most 1.
    assert 0.0 < alone <= 10.0
    assert 0.0 < mean <= 10.0


def test_without_rllib_it_is_said_in_one_line_how_to_get_it():
    try:
        import ray.rllib  # noqa: F401 - tests whether it is installed
    except ImportError:
        result = called()
        assert result.returncode == 2
        assert result.stdout == ""
        (line,) = result.stderr.splitlines()
        assert "pip install -e . 'ray[rllib]'" in line
    else:
        pytest.skip("RLlib is here")
