"""Pins README: it is short, its code runs, its links exist, and its figures are those of committed results."""

import json
import re
from pathlib import Path

import pytest

from spidar_gym.cli.tables import RESULTS, markdown_table
from spidar_gym.paper.crawl import crawl_figures, crawl_lines, crawl_paper
from spidar_gym.paper.flight import flight_figures, flight_lines, fly_paper
from spidar_gym.robot.tables import assets_readme

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_is_read_in_three_minutes():
    assert len(README.splitlines()) <= 200


def test_the_python_example_runs(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    exec(compile(code, "README.md", "exec"), {})
    assert "QP closed_form" in capsys.readouterr().out


def test_the_allocator_alone_tilts_the_rotors_of_form_3_as_the_paper_does(capsys):
    page = (ROOT / "docs" / "concepts" / "allocation.md").read_text(encoding="utf-8")
    (code,) = [block for block in re.findall(r"```python\n(.*?)```", page, re.S) if "import ThrustAllocator" in block]
    exec(compile(code, "allocation.md", "exec"), {})
    assert "θ₁ -0.40 rad, closed_form" in capsys.readouterr().out  # the paper's form ③, see the flight's table


@pytest.mark.parametrize("name", ["fly", "test"])
def test_each_of_the_two_commands_is_one_line(name):
    (command,) = re.findall(rf"<!-- command: {name} -->\n```bash\n(.*?)\n```", README, re.S)
    assert "\n" not in command
    assert command.startswith("python3 -m venv ")


def test_every_linked_file_exists():
    for target in re.findall(r"\]\(((?!https:)[^)#]+)\)", README):
        assert (ROOT / target).exists(), target


def result(name):
    """Figures of a committed result."""
    return json.loads((ROOT / RESULTS / f"{name}.json").read_text(encoding="utf-8"))["result"]


@pytest.mark.parametrize("name", ["flight", "flight_noise", "flight_quasi", "crawl"])
def test_times_on_this_machine_are_not_compared_with_those_on_another(name):
    (row,) = [line for line in markdown_table(ROOT, name).splitlines() if line.startswith("| QP time ")]
    assert re.fullmatch(r"\| QP time here, median / p99 / max \[µs\] \|( [\d /]+ \|)+( – \|)+", row)


@pytest.mark.parametrize(
    ("specified", "command", "lines", "row"),
    [("max flight time", "flight", flight_lines(result("flight")["flight"]), "endurance in form ① (calibrated) [min]"),
     ("max crawl time", "crawl", crawl_lines(result("crawl")["noisy"]), "endurance (predicted) [min]")],
)  # fmt: skip
def test_the_specification_has_every_figure_that_an_experiment_prints(specified, command, lines, row):
    (line,) = [line for line in assets_readme().splitlines() if line.startswith(f"| {specified} ")]
    _, _, papers, ours, remark, _ = (cell.strip() for cell in line.split("|"))
    assert f"`spidar paper {command}`" in remark
    assert "not" not in ours
    (printed,) = [cells for cells in lines if cells[0] == row]
    assert printed[-1] == papers.removesuffix(" min")


def untimed(lines):
    """The lines of a table without the digits of the QP time, which depends on the machine."""
    return [[re.sub(r"\d+", "", cell) if line[0].startswith("QP time") else cell for cell in line] for line in lines]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "preset", "noise"),
    [("flight", "as_flown", False), ("flight_noise", "as_flown", True), ("flight_quasi", "as_flown_quasi", False)],
)
def test_the_committed_flights_are_what_the_flights_give(name, preset, noise):
    flown = flight_lines(flight_figures(fly_paper(preset, noise=noise)))
    assert untimed(flown) == untimed(flight_lines(result(name)["flight"]))


@pytest.mark.slow
def test_the_committed_crawl_is_what_the_crawl_gives():
    log, fast = crawl_paper("published"), crawl_paper("overlapped")
    assert untimed(crawl_lines(crawl_figures(log, fast))) == untimed(crawl_lines(result("crawl")["crawl"]))
    noisy = crawl_figures(crawl_paper("published", noise=True))
    assert untimed(crawl_lines(noisy)) == untimed(crawl_lines(result("crawl")["noisy"]))
