"""Pins the example with Stable-Baselines3's defaults: its zip flies with the printed command."""

import shlex
import sys

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")

from spidar_gym.cli.main import main
from spidar_gym.errors import InvalidValueError
from train import plain

pytestmark = pytest.mark.train


@pytest.mark.parametrize("robots", ["1", "4"])
def test_the_saved_policy_flies_with_the_printed_command(robots, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["train.plain", "--steps", "1", "--robots", robots])
    plain.main()
    *table, ranked, told = capfd.readouterr().out.splitlines()
    # A whole rollout in both cases, although one step was requested; the log reports episodes.
    assert any("total_timesteps" in line and " 2048 " in line for line in table)
    spidar, *command, out, film = shlex.split(told)
    assert (spidar, out, film) == ("spidar", "--out", "plain.mp4")
    assert [p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.*")] == ["out/plain/model.zip"]
    main([*command, "--seconds", "0.2"])
    assert capfd.readouterr().out.startswith("episode 1 (seed 0): 0.2 s")
    main([*shlex.split(ranked)[1:], "--episodes", "1"])
    assert "on spidar_suite/HoverResidual-v1, 1 episodes" in capfd.readouterr().out


@pytest.mark.parametrize("wrong", [{"steps": 0}, {"robots": 0}, {"seed": -1}])
def test_a_run_of_nothing_is_refused(wrong):
    with pytest.raises(InvalidValueError, match=f"{next(iter(wrong))} = "):
        plain.Args(**wrong)
