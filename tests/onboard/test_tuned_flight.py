"""Pins the guide's way from a log to the tuned flight: its commands in their order, against the simulated robot."""

import json
import re
import shlex
from pathlib import Path

import pytest
from support.needs import needs_compiler

from spidar_gym.cli.main import main
from spidar_gym.onboard.parameters import flight_presets
from spidar_gym.sim.worlds import read_world

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "onboard" / "tuned_flight.md").read_text(encoding="utf-8")
(ROBOT,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
COMMANDS = [line for block in re.findall(r"```bash\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()]
SHORT = (
    (" tests/bench.log tests/thrust.log", " tests/thrust.log"),
    ("--generations 30 --scenarios 2", "--generations 1 --population 2 --scenarios 1"),
    ("--presets first_flight steady --out", "--presets steady --fragile --out"),
    ("--flights 5", "--flights 1"),
    ("--policy", "--scenarios 1 --policy"),
)
"""What the short form replaces: an identification of the joints, a search and many flights take an hour."""
LONG = "--flights 50"
"""In the command that the short form leaves out."""


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_of_the_way_and_its_options_exist(line, capsys):
    program, *words = shlex.split(line)
    assert program == "spidar"
    name = words[: 1 + (words[0] in ("sitl", "log", "tune"))]
    with pytest.raises(SystemExit):
        main([*name, "--help"])
    known = capsys.readouterr().out
    options = [word for word in words if word.startswith("--")]
    assert [option for option in options if not re.search(rf"(?<![\w-]){option}(?![\w-])", known)] == []


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("form", ["short", "as on the page"])
def test_the_commands_lead_from_logs_to_a_tuned_flight(form, tmp_path, monkeypatch, request):
    if not request.config.getoption("whole"):
        pytest.skip("three minutes and an hour; with --whole")
    monkeypatch.chdir(tmp_path)
    Path("damped.toml").write_text(ROBOT, encoding="utf-8")
    short = form == "short"
    for line in [line for line in COMMANDS if LONG not in line] if short else COMMANDS:
        for long, instead in SHORT if short else ():
            line = line.replace(long, instead)
        main(shlex.split(line)[1:])
    assert read_world(Path("identified/robot.toml")).robot.described_mass == pytest.approx(16.3)
    assert "tuned_here" in flight_presets(Path("robot.txt"))
    folder = Path("simulated" if short else "out/sitl-first-flights")
    flights = json.loads((folder / "first_flights.json").read_text(encoding="utf-8"))["flights"]
    assert all(row["stayed_up"] for row in flights)
