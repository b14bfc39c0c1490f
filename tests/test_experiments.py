"""Pins the flight experiment: its figures by hand, its words, and the flight itself against the paper's numbers."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from spidar_gym.envs.tasks import HoverTask
from spidar_gym.errors import SpidarError, UnknownNameError
from spidar_gym.experiments import PAPER_FLIGHT, FlightLog, flight_figures, flight_table, fly_paper

KEYS = {
    "preset", "rmse_position_m", "rmse_attitude_rad", "theta_form3_rad", "phi_form3_rad", "tau2_form3_nm",
    "thrust_form1_n", "thrust_form3_n", "qp",
}  # fmt: skip
QP_KEYS = {"median_us", "p99_us", "max_us", "unsolved"}


def log_of(**columns) -> FlightLog:
    """A flight of 40 s at one row a second in which nothing happens but what `columns` say of the time."""
    t = np.arange(1.0, 41.0)
    shapes = {
        "position_error": (3,), "attitude_error": (3,), "joint_position": (16,), "joint_torque": (16,),
        "vectoring": (8, 2), "thrust": (8,), "solve_time": (), "qpos": (39,),
    }  # fmt: skip
    values = {name: np.zeros((40, *shape)) for name, shape in shapes.items()}
    log = FlightLog("as_flown", time=t, status=np.full(40, "solved"), **values)
    return replace(log, **{name: column(t) for name, column in columns.items()})


def test_rmse_is_per_axis_and_over_the_first_27_seconds_only():
    def error(t):
        return np.where((t <= 27.0)[:, None], np.where(t % 2 == 0, 1.0, -1.0)[:, None] * (1.0, 2.0, 3.0), 99.0)

    figures = flight_figures(log_of(position_error=error, attitude_error=lambda t: 0.1 * error(t)))
    np.testing.assert_allclose(figures["rmse_position_m"], [1.0, 2.0, 3.0], rtol=1e-12)
    np.testing.assert_allclose(figures["rmse_attitude_rad"], [0.1, 0.2, 0.3], rtol=1e-12)


def test_form_3_is_averaged_over_14_to_27_seconds_and_form_1_over_2_to_4():
    def within(t, a, b):
        return ((a <= t) & (t <= b)).astype(float)

    def vectoring(t):
        return within(t, 14, 27)[:, None, None] * np.arange(16.0).reshape(8, 2)

    log = log_of(
        vectoring=vectoring,
        joint_torque=lambda t: within(t, 14, 27)[:, None] * np.arange(16.0),
        thrust=lambda t: (within(t, 2, 4) + 2 * within(t, 14, 27))[:, None] * np.arange(8.0),
    )
    figures = flight_figures(log)
    # Rotors 1, 3, 5, 7: rows 0, 2, 4, 6 of (φ, θ).
    assert figures["phi_form3_rad"] == [0.0, 4.0, 8.0, 12.0]
    assert figures["theta_form3_rad"] == [1.0, 5.0, 9.0, 13.0]
    assert figures["tau2_form3_nm"] == 1.0
    assert figures["thrust_form1_n"] == list(range(8))
    assert figures["thrust_form3_n"] == list(range(0, 16, 2))


def test_a_mean_over_a_window_weighs_its_rows_alike():
    log = log_of(thrust=lambda t: np.repeat(t[:, None], 8, axis=1))
    figures = flight_figures(log)
    assert figures["thrust_form1_n"] == [3.0] * 8
    assert figures["thrust_form3_n"] == [20.5] * 8


def test_qp_times_are_microseconds_and_ticks_without_an_optimum_are_counted():
    log = log_of(solve_time=lambda t: 1e-6 * t)
    status = np.array(["solved", "closed_form", "softened", "held"] * 10)
    qp = flight_figures(replace(log, status=status))["qp"]
    assert abs(qp["median_us"] - 20.5) < 1e-9
    assert abs(qp["max_us"] - 40.0) < 1e-9
    assert 39.0 < qp["p99_us"] < 40.0
    assert qp["unsolved"] == 20


def test_figures_have_exactly_the_promised_keys_and_survive_json():
    figures = json.loads(json.dumps(flight_figures(log_of())))
    assert set(figures) == KEYS
    assert set(figures["qp"]) == QP_KEYS
    lengths = {name: len(value) for name, value in figures.items() if isinstance(value, list)}
    assert lengths == {
        "rmse_position_m": 3, "rmse_attitude_rad": 3, "theta_form3_rad": 4, "phi_form3_rad": 4,
        "thrust_form1_n": 8, "thrust_form3_n": 8,
    }  # fmt: skip


def test_the_papers_figures_have_the_same_keys_where_the_paper_gives_them():
    assert set(PAPER_FLIGHT) < KEYS
    assert set(PAPER_FLIGHT["qp"]) < QP_KEYS
    ours = flight_figures(log_of())
    for name, value in PAPER_FLIGHT.items():
        assert np.shape(ours[name]) == np.shape(value), name
    assert PAPER_FLIGHT["rmse_position_m"] == [0.038, 0.037, 0.043]
    assert PAPER_FLIGHT["rmse_attitude_rad"] == [0.016, 0.016, 0.016]


def test_the_table_shows_ours_and_the_papers_numbers_side_by_side():
    log = log_of(
        position_error=lambda t: np.full((40, 3), 0.0123),
        thrust=lambda t: np.where(t < 10, 20.0, 21.0)[:, None] * np.ones(8)
    )  # fmt: skip
    lines = flight_table(flight_figures(log)).splitlines()
    assert "as_flown" in lines[0]
    (position,) = [line for line in lines if line.startswith("RMSE position")]
    assert position.index("0.0123") < position.index("0.038")
    (thrust,) = [line for line in lines if line.startswith("Σλ")]
    assert "160.0 → 168.0 (+5.0%)" in thrust
    assert lines[0].rindex("paper") == position.index("0.038  0.037  0.043")


def test_an_unknown_preset_is_refused():
    with pytest.raises(UnknownNameError, match="paper, as_flown"):
        fly_paper("mine")


def test_a_flight_that_ends_early_says_when_and_why(monkeypatch):
    words, seen = iter(["", "", "", "tilt"]), []
    monkeypatch.setattr(HoverTask, "failed", lambda *_: next(words))
    with pytest.raises(SpidarError, match=r"0\.\d+ s: tilt"):
        fly_paper(on_tick=lambda: seen.append(1))
    assert len(seen) == 3


@pytest.fixture(scope="module")
def flown() -> FlightLog:
    return fly_paper()


@pytest.mark.slow
def test_the_flight_is_40_seconds_from_form_1_at_4_to_form_3_at_about_12(flown):
    assert len(flown.time) == 1600
    assert abs(flown.time[-1] - 40.0) < 1e-9
    outer = flown.joint_position[:, 3]
    assert np.abs(outer[flown.time <= 4.0]).max() < 0.02
    speed = np.gradient(outer, flown.time)
    assert speed.max() < 0.22
    arrival = flown.time[np.flatnonzero(np.abs(outer - math.pi / 2) > 0.03)[-1]]
    assert 11.5 < arrival < 12.5


@pytest.mark.slow
def test_the_flight_as_flown_meets_the_papers_figures(flown):
    figures = flight_figures(flown)
    for name in ("rmse_position_m", "rmse_attitude_rad"):
        assert np.all(np.array(figures[name]) <= PAPER_FLIGHT[name]), figures[name]
    np.testing.assert_allclose(figures["theta_form3_rad"], -0.40, rtol=0, atol=0.03)
    np.testing.assert_allclose(figures["phi_form3_rad"], 0.0, rtol=0, atol=0.01)
    more = sum(figures["thrust_form3_n"]) / sum(figures["thrust_form1_n"]) - 1.0
    assert 0.02 <= more <= 0.06
    assert figures["qp"]["unsolved"] == 0


@pytest.mark.slow
def test_the_papers_allocation_flies_no_worse_than_the_paper():
    figures = flight_figures(fly_paper("paper"))
    for name in ("rmse_position_m", "rmse_attitude_rad"):
        assert np.all(np.array(figures[name]) <= PAPER_FLIGHT[name]), figures[name]
    assert figures["qp"]["unsolved"] == 0
