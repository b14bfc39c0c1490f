"""Flights of calibrated robots: the same for each controller, ratios with intervals, and refused arguments."""

import json

import numpy as np
import pytest

from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.studies.__main__ import main
from spidar_gym.studies.flights import draw, flight_lines, flight_study, policy_of, ratio_interval


def test_flights_differ_by_robot_and_by_speed_and_by_nothing_else():
    assert draw(0.2, 3) == draw(0.2, 3)
    assert len({draw(speed, k).seed for speed in (0.2, 0.6) for k in range(6)}) == 12
    assert draw(0.6, 3).options["joint_speed"] == 0.6


@pytest.mark.slow
def test_a_fragile_controller_falls_where_the_recommended_one_flies():
    rows = flight_study(("steady", "retuned"), (0.6,), 2)  # one robot as described, one badly damped
    damped = {row["controller"]: row for row in rows if row["variant"] == "damped" and row["joint_speed"]}
    assert (damped["steady"]["falls"], damped["retuned"]["falls"]) == (0, 1)
    assert damped["steady"]["ratio"] == 1.0
    assert damped["retuned"]["ratio"] == damped["steady"]["error"] / damped["retuned"]["error"] < 0.2


def test_an_interval_contains_the_ratio_and_shrinks_with_the_flights():
    rng = np.random.Generator(np.random.PCG64(0))
    widths = []
    for robots in (20, 2000):
        other = rng.uniform(0.5, 1.5, (2, robots))
        low, high = ratio_interval(0.8 * other * rng.uniform(0.9, 1.1, other.shape), other, "any")
        assert low < 0.8 < high
        widths.append(high - low)
    assert widths[1] < 0.2 * widths[0]
    assert ratio_interval(other, other, "any") == (1.0, 1.0)


def test_rows_of_all_speeds_and_variants_and_the_command(tmp_path, capsys, monkeypatch):
    def quick(flight):
        return {"error": 0.1 if flight.controller == "steady" else 0.2, "fell": flight.robot == 1}

    monkeypatch.setattr("spidar_gym.studies.flights.play", quick)
    arguments = [
        "--controllers",
        "steady",
        "paper",
        "--robots",
        "6",
        "--workers",
        "1",
        "--out",
        str(tmp_path),
        "--json",
    ]
    main(["flights", *arguments])
    rows = json.loads(capsys.readouterr().out)["flights"]
    assert len(rows) == 2 * 3 * 3
    of_all = next(r for r in rows if (r["controller"], r["joint_speed"], r["variant"]) == ("paper", None, "all"))
    assert (of_all["flights"], of_all["falls"], of_all["ratio"]) == (12, 2, pytest.approx(0.5))
    damped = [row for row in rows if row["variant"] == "damped" and row["joint_speed"] == 0.2]
    assert [row["falls"] for row in damped] == [1, 1]
    assert flight_lines(rows)[1][-1] == "–"


def test_controllers_that_do_not_exist_or_do_not_fly_are_refused():
    with pytest.raises(UnknownNameError):
        policy_of("glide")
    with pytest.raises(InvalidValueError):
        policy_of("baselines.course:CourseRule")
