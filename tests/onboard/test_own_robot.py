"""Pins the export of a custom robot: its numbers, presets and missions, and commands equal to Python's."""

import subprocess
from pathlib import Path

import pytest
from support.commands import LEARNED
from support.needs import needs_compiler
from support.robots import LONG
from support.runner import compile_, said

from spidar_gym.cli.main import main
from spidar_gym.errors import InvalidValueError
from spidar_gym.onboard.export import export_files
from spidar_gym.onboard.parameters import digest_of
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.robot.description import model_hash

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def nominal(onboard, tmp_path_factory):
    """The runner of the nominal robot's export."""
    return onboard.compile_as_shipped(onboard.export(tmp_path_factory.mktemp("nominal") / "onboard"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Export a custom robot with `spidar export --robot`; return the folder."""
    path = tmp_path_factory.mktemp("own")
    (path / "long.toml").write_text(f"pitch_to_foot = {LONG.pitch_to_foot!r}\n", encoding="utf-8")
    main(["export", "--robot", str(path / "long.toml"), "--out", str(path / "onboard")])
    return path / "onboard"


@pytest.fixture(scope="module")
def runner(folder):
    return compile_(folder, folder.parent / "runner")


@pytest.mark.parametrize("log", ["flight", "crawl"])
def test_the_exported_core_commands_the_longer_robot_as_python_does(folder, runner, log, tmp_path):
    out, golden = tmp_path / "out", folder / "golden" / f"{log}.out"
    run = [runner, "replay", folder / "golden" / f"{log}.in", out]
    subprocess.run(run, check=True, capture_output=True)
    done = subprocess.run([runner, "compare", out, golden], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) < 1e-9


@pytest.mark.parametrize("log", ["flight", "crawl"])
def test_the_nominal_runner_replays_it_bit_for_bit_with_its_parameters(folder, runner, nominal, log, tmp_path):
    golden, parameters = folder / "golden" / f"{log}.in", folder / "parameters" / "long.txt"
    assert said(runner, "replay", golden, tmp_path / "own").returncode == 0
    assert said(nominal, "replay", golden, tmp_path / "out", "--parameters", parameters).returncode == 0
    assert (tmp_path / "out").read_bytes() == (tmp_path / "own").read_bytes()
    assert "whole ticks" in said(nominal, "bench", golden, "--parameters", parameters).stdout
    done = said(nominal, "replay", golden, tmp_path / "none")
    line = "runner: the log is of another robot; valid: --parameters with a file of that robot\n"
    assert (done.returncode, done.stderr) == (2, line)
    assert not (tmp_path / "none").exists()


def test_the_folder_is_of_that_robot(folder, runner):
    about = subprocess.run([runner, "about"], check=True, capture_output=True, text=True).stdout
    parameters = digest_of((folder / "parameters" / "long.txt").read_bytes())
    assert about == f"interface {runner_hash()}\nmodel {model_hash(LONG)}\nparameters {parameters}\n"
    assert model_hash(LONG) != model_hash()
    missions = {path.stem for path in (folder / "missions").iterdir()}
    assert missions == {"crawl", "flight", "hover", "bench", "thrust", "legs", "forms"}


def test_what_was_learned_on_the_nominal_robot_is_not_exported_with_another():
    with pytest.raises(InvalidValueError, match="learned on the nominal robot"):
        export_files(golden=False, residual=Path(LEARNED), robot=LONG)
