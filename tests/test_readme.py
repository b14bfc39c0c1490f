"""Pins README: its code runs, its commands are the ones that CI calls, its flight table is what the flight gives."""

import re
from pathlib import Path

import pytest

from spidar_gym.benchmark.comparison import comparison_text
from spidar_gym.benchmark.row import read_row
from spidar_gym.control.presets import controller_config
from spidar_gym.crawl_experiment import crawl_figures, crawl_paper, crawl_table
from spidar_gym.experiments import flight_figures, flight_table, fly_paper
from spidar_gym.tune import margin_table

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_example_runs(capsys):
    for code in re.findall(r"```python\n(.*?)```", README, re.S):
        exec(compile(code, "README.md", "exec"), {})
    assert "QP closed_form" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["fly", "test"])
def test_each_of_the_two_commands_is_one_line(name):
    (command,) = re.findall(rf"<!-- command: {name} -->\n```bash\n(.*?)\n```", README, re.S)
    assert "\n" not in command
    assert command.startswith("python3 -m venv ")


def test_every_linked_file_exists():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), target


@pytest.mark.slow
@pytest.mark.parametrize("noise", [False, True])
def test_the_flight_tables_are_what_the_flights_give(noise):
    lines = flight_table(flight_figures(fly_paper("as_flown", noise=noise))).splitlines()
    for line in lines:
        if not line.startswith("QP time"):  # the one line that differs from machine to machine
            assert line in README


@pytest.mark.slow
def test_the_crawl_table_is_what_the_crawl_gives():
    log, fast = crawl_paper("published", noise=True), crawl_paper("overlapped", noise=True)
    # The width of the columns follows the times, which differ from machine to machine.
    readme = {" ".join(line.split()) for line in README.splitlines()}
    for line in crawl_table(crawl_figures(log, fast)).splitlines():
        if not line.startswith(("QP time", "─")):
            assert " ".join(line.split()) in readme


def test_the_margins_are_those_of_the_preset():
    for line in margin_table(controller_config("tuned")).splitlines():
        assert line in README


def test_the_comparisons_are_those_of_the_rows():
    found = re.findall(r"<!-- compare: (\w+) (\w+) -->\n```text\n(.*?)```", README, re.S)
    assert found
    for name, base, shown in found:
        row, other = (read_row(ROOT / "baselines" / "scores" / f"{n}.json") for n in (name, base))
        text = comparison_text(row, other)
        assert [line.rstrip() for line in text.splitlines()] == shown.splitlines(), name
