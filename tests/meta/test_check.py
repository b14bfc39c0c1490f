"""Pins the test command: it prints its stages and their durations, and includes every test."""

import itertools
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

SPEC = spec_from_file_location("check", Path(__file__).resolve().parents[2] / ".ci" / "check.py")
check = module_from_spec(SPEC)
sys.modules["check"] = check  # dataclasses look up their module by name
SPEC.loader.exec_module(check)
CHECKS, GUIDE, FAST, FULL, ROOT = check.CHECKS, check.GUIDE, check.FAST, check.FULL, check.ROOT
Stage, main, play = check.Stage, check.main, check.play


def marks(stages):
    """The marker expressions of the pytest commands of the stages."""
    commands = [command for stage in stages for command in stage.commands.values() if command[0] == "pytest"]
    return [command[command.index("-m") + 1] for command in commands]


def test_help_names_every_stage_with_its_minutes_and_the_adversaries_command(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    out = capsys.readouterr().out
    for stage in (*FULL, *FAST):
        assert f"{stage.minutes:.1f} min  {stage.title}" in out
    assert "pytest tests/adversary --whole" in out
    assert "--fast" in out


def test_the_fast_run_is_of_files_that_exist_and_takes_three_minutes():
    (command,) = FAST[-1].commands.values()
    files = [word for word in command if word.startswith("tests/")]
    assert len(files) == len(set(files)) > 20
    assert all((ROOT / name).is_file() for name in files)
    assert sum(stage.minutes for stage in FAST) <= 3.0


def test_every_test_is_in_exactly_one_stage_of_the_whole():
    whole = marks(FULL)
    for each in itertools.product((False, True), repeat=4):
        marked = dict(zip(("slow", "train", "ros", "unchecked"), each, strict=True))
        assert sum(bool(eval(expression, {}, marked)) for expression in whole) == 1, marked


def test_all_static_checks_and_the_guide_are_in_the_whole():
    assert FULL[0].commands == CHECKS | GUIDE


def test_a_stage_prints_its_duration_and_a_failure_stops(capfd, monkeypatch):
    monkeypatch.setattr(check, "BIN", Path(sys.executable).parent)
    name = Path(sys.executable).name
    play(Stage("nothing", {"nothing": [name, "-c", "pass"]}, 0.5))
    last = capfd.readouterr().out.splitlines()[-1]
    assert last.startswith("── nothing: 0.")
    assert last.endswith("0.5 min on two quiet cores")
    with pytest.raises(SystemExit, match="breaks failed with exit status 3"):
        play(Stage("one", {"breaks": [name, "-c", "raise SystemExit(3)"]}, 0.5))


def test_a_command_that_hangs_is_stopped():
    with pytest.raises(SystemExit) as stop:
        check.run("a nap", [sys.executable, "-c", "import time; time.sleep(60)"], limit=0.3)
    assert stop.value.code == "a nap was stopped after 0 min"
