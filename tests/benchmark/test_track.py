"""Pins the tracks: their ids, the environment of each, and errors that agree with their formulas."""

import math
import re

import gymnasium
import numpy as np
import pytest

from spidar_gym.benchmark import COURSE, CRAWL, GRASP, HOVER, TRACKS
from spidar_gym.benchmark.track import (
    CAP,
    REFERENCES,
    course_error,
    find_track,
    flight_error,
    grasp_error,
    ground_error,
)
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import PATH
from spidar_gym.errors import UnknownNameError
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.tasks import course
from spidar_gym.tasks.hover import SUCCESS_ATTITUDE, SUCCESS_POSITION

IDS = [
    "flight-calibrated", "flight-calibrated-fast", "ground-calibrated",
    "flight-paper", "flight-forms", "flight-fast3", "flight-fast5", "flight-randomised", "flight-wind",
    "flight-narrow", "ground-paper", "ground-directions", "ground-friction", "ground-uneven", "ground-randomised",
    "flight-path", "ground-steps", "course-takeoff", "course-gates", "course-mixed",
    "grasp-claw", "grasp-boxes", "grasp-fragile",
]  # fmt: skip


def by_words(formula: str, **numbers: float) -> float:
    """Evaluate a formula in words: its names are replaced by numbers, its units are left out."""
    text = formula.split(", a radian")[0].replace("½", "0.5 *").replace("¼", "0.25 *")
    for name, number in numbers.items():
        assert name.replace("_", " ") in text
        text = text.replace(name.replace("_", " "), f"{number:.15f}")
    text = re.sub(r"(/ [\d.]+) [A-Za-z/]+", r"\1", text)
    assert not re.search(r"[A-Za-z]", text)
    return eval(text)


def test_there_are_exactly_these_tracks():
    assert list(TRACKS) == IDS
    for name in IDS:
        assert find_track(name) is TRACKS[name]


@pytest.mark.parametrize("name", ["flight", "flight-paper ", "Flight-paper", ""])
def test_a_track_that_does_not_exist_is_refused_with_all_that_do(name):
    with pytest.raises(UnknownNameError) as refusal:
        find_track(name)
    assert all(track in str(refusal.value) for track in IDS)


@pytest.mark.parametrize("name", IDS)
def test_a_track_flies_or_crawls_as_it_is_called_and_has_a_line_of_its_own(name):
    track = TRACKS[name]
    world = name.split("-")[0]
    assert track.env_id == (
        PATH if name == "flight-path" else {"flight": HOVER, "ground": CRAWL, "course": COURSE, "grasp": GRASP}[world]
    )
    assert (track.world, track.flies) == (world, world == "flight")
    calibrated = "calibrated" in name
    group = f"calibrated {world}" if calibrated else world
    assert track.group == {"flight-path": "path", "ground-steps": "steps"}.get(name, group)
    assert track.folder == ("calibrated" if calibrated else track.group)
    assert track.splits == ("test", "validation", *(("second",) if calibrated or world == "grasp" else ()))
    first = {"flight": "flight-paper", "ground": "ground-paper", "course": "course-gates", "grasp": "grasp-claw"}
    formula = TRACKS[first[world]].formula
    assert track.formula == formula + (", RMS from 10 s" if calibrated and track.flies else "")
    assert (
        track.reference == REFERENCES[track.group] == {"course": "course_rule", "grasp": "grasp_rule"}.get(world, "qp")
    )
    assert track.doc
    assert "\n" not in track.doc
    assert sum(other.doc == track.doc for other in TRACKS.values()) == 1
    assert track.seconds * CONTROL_RATE == round(track.seconds * CONTROL_RATE)


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("end", [0, 1])
def test_the_environment_takes_what_the_track_fixes_and_both_ends_of_what_it_draws(name, end):
    track = TRACKS[name]
    assert not set(track.options) & set(track.ranges)
    drawn = {key: bounds[end] for key, bounds in track.ranges.items()}
    weather = {key: bounds[end] for key, bounds in track.disturbances.items()}
    env = gymnasium.make(track.env_id, **{**track.options, **drawn}, disturbances=weather, horizon_s=track.seconds)
    for key, value in {**track.options, **drawn}.items():
        if key in vars(env.unwrapped.task):
            assert getattr(env.unwrapped.task, key) == value
    assert env.unwrapped.task.horizon_s == track.seconds
    assert Disturbances.parse(weather) == Disturbances(**weather)
    env.close()


@pytest.mark.parametrize("name", IDS)
def test_every_range_has_an_inside(name):
    bounds = [*TRACKS[name].ranges.values(), *TRACKS[name].disturbances.values()]
    assert all(low < high for low, high in bounds)


def test_the_error_of_a_flight_by_hand():
    assert flight_error(0.05, 0.05, failed=False) == pytest.approx(1.0)
    assert flight_error(0.1, 0.0, failed=False) == pytest.approx(1.0)
    assert flight_error(0.0, 0.02, failed=False) == pytest.approx(0.2)
    assert flight_error(0.0, 0.0, failed=False) == 0.0


def test_a_flight_at_the_limits_of_success_has_error_one():
    assert flight_error(SUCCESS_POSITION, SUCCESS_ATTITUDE, failed=False) == 1.0


def test_the_error_of_a_crawl_by_hand():
    assert ground_error(0.02, 20.0, failed=False) == pytest.approx(1.0)
    assert ground_error(0.04, 0.0, failed=False) == pytest.approx(1.0)
    assert ground_error(0.0, 10.0, failed=False) == pytest.approx(0.25)
    assert ground_error(0.0, 0.0, failed=False) == 0.0


def test_the_error_of_a_course_by_hand():
    assert course_error(10.0, 5.0, 0.03, 20.0, failed=False) == pytest.approx(1.0)
    assert course_error(20.0, 0.0, 0.0, 0.0, failed=False) == pytest.approx(0.5)
    assert course_error(0.0, 2.5, 0.0, 0.0, failed=False) == pytest.approx(0.125)
    assert course_error(0.0, 0.0, 0.015, 10.0, failed=False) == pytest.approx(0.25)
    assert course_error(0.0, 0.0, 0.0, 0.0, failed=False) == 0.0


def test_the_error_of_a_grasp_by_hand():
    assert grasp_error(40.0, 45.0, 0.05, 1.0, failed=False) == pytest.approx(1.0)
    assert grasp_error(80.0, 0.0, 0.0, 0.0, failed=False) == pytest.approx(0.5)
    assert grasp_error(0.0, 0.0, 0.05, 0.0, failed=False) == pytest.approx(0.25)
    assert grasp_error(0.0, 0.0, 0.0, 0.5, failed=False) == pytest.approx(0.125)


def test_what_ends_a_course_or_is_no_success_counts_as_one_in_its_term():
    assert course_error(0.0, 0.0, course.SUCCESS_POSITION, course.MAX_HIT, failed=False) == pytest.approx(0.5)


def _course_error(rest: float, energy: float, *, failed: bool) -> float:
    return course_error(0.0, energy, rest, 0.0, failed=failed)


def _grasp_error(rest: float, energy: float, *, failed: bool) -> float:
    return grasp_error(0.0, energy, rest, 0.0, failed=failed)


@pytest.mark.parametrize("error", [flight_error, ground_error, _course_error, _grasp_error])
def test_a_failure_costs_the_cap_and_nothing_costs_more(error):
    assert error(0.0, 0.0, failed=True) == CAP
    assert error(1e9, 1e9, failed=True) == CAP
    assert error(1e9, 0.0, failed=False) == CAP
    assert error(0.0, 1e9, failed=False) == CAP
    assert error(math.inf, 0.0, failed=False) == CAP
    assert error(0.01, 0.01, failed=False) < CAP


def test_the_formulas_in_words_agree_with_the_numbers():
    rng = np.random.default_rng(3)
    for a, b in rng.uniform(0.0, 0.05, (20, 2)).tolist():
        flight = by_words(TRACKS["flight-paper"].formula, position_RMS=a, attitude_RMS=b)
        assert flight_error(a, b, failed=False) == pytest.approx(flight, rel=1e-9)
        ground = by_words(TRACKS["ground-paper"].formula, final_error=a, energy_per_metre=100.0 * b)
        assert ground_error(a, 100.0 * b, failed=False) == pytest.approx(ground, rel=1e-9)
        numbers = {"time_per_metre": 400.0 * a, "energy_per_metre": 100.0 * b, "final_error": a}
        words = by_words(TRACKS["course-mixed"].formula, **numbers, largest_contact_force=100.0 * b)
        assert course_error(400.0 * a, 100.0 * b, a, 100.0 * b, failed=False) == pytest.approx(words, rel=1e-9)
        numbers = {"time": 1e3 * a, "energy": 1e3 * b, "final_error_of_the_object": a}
        shares = {"largest_force_of_a_foot": 100.0 * b, "force_that_the_object_bears": 7.0}
        words = by_words(TRACKS["grasp-boxes"].formula, **numbers, **shares)
        assert grasp_error(1e3 * a, 1e3 * b, a, 100.0 * b / 7.0, failed=False) == pytest.approx(words, rel=1e-9)


def test_on_the_ground_a_radian_counts_what_the_formula_says():
    (length,) = re.findall(r"a radian counts ([\d.]+) m", TRACKS["ground-paper"].formula)
    for control in ("core", "python"):
        env = gymnasium.make(CRAWL, distance=0.0, turn=0.6, control=control).unwrapped
        env.reset(seed=0)
        assert math.hypot(*env.progress.error[:2]) < 0.01
        assert env.progress.distance == pytest.approx(float(length) * 0.6, rel=0.03)
        env.close()
