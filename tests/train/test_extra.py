"""Pins scripts without the extra `train`: runs fail with an error of one line, and `--help` works."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.train
ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = {
    "residual": ["hover-paper-ppo"], "supervised": ["hover-paper"], "gait": ["crawl"], "course": ["rule"],
    "sweep": ["hover-paper-ppo"], "speed": [], "plain": [],
}  # fmt: skip
"""Training scripts, each with the arguments that a run needs."""


@pytest.fixture
def called(tmp_path):
    """Return a function that calls a script in an empty folder without torch."""
    missing, here = tmp_path / "missing", tmp_path / "here"
    missing.mkdir()
    here.mkdir()
    (missing / "torch.py").write_text("raise ModuleNotFoundError('no torch', name='torch')")
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join([str(missing), str(ROOT)])}

    def call(script: str, *options: str) -> subprocess.CompletedProcess:
        command = [sys.executable, "-m", f"train.{script}", *options]
        told = subprocess.run(command, cwd=here, env=environ, capture_output=True, text=True, check=False)
        assert list(here.iterdir()) == []
        return told

    return call


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_without_its_extra_states_in_one_line_what_to_install(script, called):
    told = called(script, *SCRIPTS[script])
    assert (told.returncode, told.stdout) == (2, "")
    (line,) = told.stderr.splitlines()
    assert line.startswith(f"train.{script}: torch is not available")
    assert ".[train]" in line


@pytest.mark.parametrize("script", [*SCRIPTS, "headroom", "curves", "presets", "rllib"])
def test_help_works_without_the_extra(script, called):
    told = called(script, "--help")
    assert told.returncode == 0, told.stderr
    assert f"usage: python -m train.{script}" in told.stdout
