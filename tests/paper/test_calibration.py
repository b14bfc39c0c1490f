"""Checks the published figures, and the experiments on calibrated robots in the tables of the paper's experiments."""

import pytest

from spidar_gym.paper.calibration import (
    CRAWL,
    CRAWL_NUMBERS,
    FLIGHT,
    FLIGHT_NUMBERS,
    FLIGHT_WORDS,
    LABELS,
    Published,
    calibrated_figures,
)
from spidar_gym.paper.crawl import PAPER_CRAWL, crawl_figures, crawl_lines, crawl_paper
from spidar_gym.paper.flight import PAPER_FLIGHT, with_calibrated


def test_the_published_numbers_are_those_of_the_experiments():
    rmse = [FLIGHT_NUMBERS[f"rmse_{name}"].value for name in ("x", "y", "z", "roll", "pitch", "yaw")]
    assert rmse == PAPER_FLIGHT["rmse_position_m"] + PAPER_FLIGHT["rmse_attitude_rad"]
    assert FLIGHT_NUMBERS["theta"].value == PAPER_FLIGHT["theta_form3_rad"][0]
    assert FLIGHT_NUMBERS["tau2"].value == PAPER_FLIGHT["tau2_form3_nm"]
    rest = [CRAWL_NUMBERS[f"rest_{name}"].value for name in "xyz"]
    assert rest == PAPER_CRAWL["final_position_error_m"]
    assert CRAWL_NUMBERS["duration"].value == PAPER_CRAWL["duration_s"]
    assert CRAWL_NUMBERS["torso"].value == PAPER_CRAWL["duration_torso_s"]
    assert CRAWL_NUMBERS["endurance"].value == PAPER_CRAWL["endurance_min"]


def test_a_number_is_compared_at_its_published_precision():
    number = Published(0.038, 0.0005, "")
    assert number.matches(0.0384, 0.05)
    assert number.matches(0.03, 0.0376)
    assert not number.matches(0.0386, 0.05)
    assert not number.matches(0.03, 0.0374)


@pytest.mark.parametrize(
    ("name", "figure", "kept", "broken"),
    [("within 5 cm", "within_position", 0.81, 0.79), ("within 50 mrad", "within_attitude", 0.96, 0.94),
     ("descent", "sink", 0.11, 0.09), ("recovery", "back", 2.4, 2.6), ("thrusts", "rise", 0.1, -0.1),
     ("stays", "failed", 0.0, 1.0)],
)  # fmt: skip
def test_an_inequality_has_the_limit_that_it_states(name, figure, kept, broken):
    assert FLIGHT_WORDS[name].holds({figure: kept})
    assert not FLIGHT_WORDS[name].holds({figure: broken})


def test_calibrated_robots_stand_beside_the_nominal_one_in_the_table():
    found = calibrated_figures(CRAWL, "robust_overlapped", "calibrated_1", robots=2)
    assert (found["robots"], found["failed"], found["preset"]) == (2, 0, "robust_overlapped")
    nominal = crawl_figures(crawl_paper("robust_overlapped"))
    head, *lines = crawl_lines(nominal, None, found)
    assert head[2] == "calibrated: robust_overlapped, median of 2"
    filled = {line[0]: line[2] for line in lines if line[2] != "–"}
    assert set(filled) == set(LABELS[CRAWL])
    assert filled["duration [s]"] == f"{found['figures']['duration'][0]:.1f}"


def test_calibrated_robots_fly_what_flew_in_place_of_as_flown():
    found = calibrated_figures(FLIGHT, "as_flown", "calibrated_1", robots=1)
    assert found["preset"] == "as_flown_quasi"
    label = "RMSE position x y z, 0–27 s [m]"
    lines = with_calibrated([["head", "ours", "paper"], [label, "0", "1"], ["other", "2", "3"]], found)
    assert lines[1] == [label, "0", found["lines"][label], "1"]
    assert lines[2] == ["other", "2", "–", "3"]
    assert set(found["lines"]) == set(LABELS[FLIGHT])
