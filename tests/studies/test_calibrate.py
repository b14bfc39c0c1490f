"""Checks the fit of calibrated worlds: its file, its convergence, and the comparison with what was published."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.paper.calibration import (
    CRAWL,
    CRAWL_NUMBERS,
    FLIGHT,
    FLIGHT_NUMBERS,
    FLIGHT_WORDS,
    crawl_sampled,
    fly_sampled,
)
from spidar_gym.sim import worlds
from spidar_gym.sim.randomize import Randomization
from spidar_gym.sim.worlds import find_world, read_world, world_names
from spidar_gym.studies import calibrate
from spidar_gym.studies.calibrate import LEVERS, START, fit, world_text, write_world
from spidar_gym.studies.reality import RMSE, measure, reality_lines, summary

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "calibrate.json"


def flight(rng: np.random.Generator, errors: np.ndarray, spread: float = 0.2, **others: float) -> dict[str, float]:
    """Figures of a flight whose errors are near the given ones."""
    found = dict(zip(RMSE, (errors * np.exp(spread * rng.standard_normal(6))).tolist(), strict=True))
    named = {name: number.value for name, number in FLIGHT_NUMBERS.items() if name not in RMSE}
    words = {"within_position": 0.9, "within_attitude": 1.0, "moving_z": 0.05, "resting_z": 0.03, "sink": 0.3,
             "back": 1.0, "rise": 1.0, "failed": 0.0}  # fmt: skip
    return found | named | words | others


def paper_errors() -> np.ndarray:
    return np.array([FLIGHT_NUMBERS[name].value for name in RMSE])


def test_the_published_errors_fit_robots_about_them_and_no_others():
    rng = np.random.default_rng(0)
    about = summary(FLIGHT, [flight(rng, paper_errors()) for _ in range(400)])
    assert all(number["fits"] for number in about["numbers"].values())
    assert about["nearer"] < 0.05
    assert about["words"] == dict.fromkeys(FLIGHT_WORDS, 1.0)
    # σ of the logarithm is 0.2: the ratio of the quantiles is exp(2 · 1.645 · 0.2).
    assert about["numbers"]["rmse_x"]["ratio_90"] == pytest.approx(math.exp(2 * 1.645 * 0.2), rel=0.1)
    kind = summary(FLIGHT, [flight(rng, 0.5 * paper_errors()) for _ in range(400)])
    assert not any(kind["numbers"][name]["fits"] for name in RMSE)
    assert kind["nearer"] > 0.95


def test_robots_that_fall_are_counted_and_keep_no_word_about_staying():
    rng = np.random.default_rng(1)
    found = summary(FLIGHT, [flight(rng, paper_errors(), failed=float(k < 5)) for k in range(20)])
    assert (found["robots"], found["failed"]) == (20, 5)
    assert found["words"]["stays"] == 0.75


@pytest.mark.parametrize("gain", [0.6, 1.7])
def test_a_fit_finds_the_levers_of_robots_whose_errors_are_proportional_to_them(tmp_path, monkeypatch, gain):
    def flights(path, mixtures, robots, *_):
        """Errors that are proportional to the levers, beside a part that has no lever."""
        rng, rows = np.random.default_rng(2), read_world(path).rows
        centre = {(m, row.field): np.mean(row.kinds[2 * k]) for row in rows for k, m in enumerate(mixtures)}
        found = {}
        for mixture in mixtures:
            errors = paper_errors().copy()
            for lever, names in LEVERS[mixture].items():
                scale = gain * centre[mixture, lever] / START[mixture][lever]
                errors[[RMSE.index(name) for name in names]] *= math.hypot(scale, 0.3)
            found[mixture] = [flight(rng, errors) for _ in range(robots)]
        return found

    monkeypatch.setattr(calibrate, "_flights", flights)
    history = fit("known_1", tmp_path, robots=400)
    assert 1 < len(history) <= calibrate.ROUNDS
    for mixture, own in history[-1]["centres"].items():
        for lever in LEVERS[mixture]:
            assert own[lever] * gain / START[mixture][lever] == pytest.approx(math.sqrt(1.0 - 0.3**2), rel=0.08)
        assert all(number["fits"] for number in history[-1]["found"][mixture]["numbers"].values())


def test_a_fitted_world_is_frozen(tmp_path, monkeypatch):
    monkeypatch.setattr(worlds, "FOLDER", tmp_path / "worlds")
    monkeypatch.setattr(calibrate, "FOLDER", tmp_path / "worlds")
    path = tmp_path / "some_1.toml"
    path.write_text(world_text(START), encoding="utf-8")
    write_world(path, "some_1")
    assert find_world.__wrapped__("some_1").kinds == tuple(f"{m}-{v}" for m in START for v in calibrate.VARIANTS)
    write_world(path, "some_1")
    path.write_text(world_text(START, floor_steps=0.001), encoding="utf-8")
    with pytest.raises(SpidarError, match="worlds are frozen"):
        write_world(path, "some_1")


def test_the_committed_world_is_that_of_the_committed_fit():
    last = json.loads(RESULTS.read_text(encoding="utf-8"))["result"]["calibrate"][-1]
    assert world_names() == ["calibrated_1"]
    assert (worlds.FOLDER / "calibrated_1.toml").read_text(encoding="utf-8") == world_text(last["centres"])


def test_the_experiments_with_a_calibrated_robot_have_every_published_figure():
    how = Randomization.parse("calibrated_1:wake-damped")
    flown, crawled = fly_sampled("as_flown_quasi", how, 3), crawl_sampled("robust_overlapped", how, 3)
    assert {*FLIGHT_NUMBERS} <= {*flown}
    assert {*CRAWL_NUMBERS} <= {*crawled}
    assert flown == fly_sampled("as_flown_quasi", how, 3)
    assert not flown["failed"]
    assert flown["theta"] == pytest.approx(-0.4, abs=0.03)
    # The integrals begin at zero, and have settled before the experiment begins.
    assert flown["rmse_z"] < 0.15
    assert 0.3 < crawled["thrust_fraction"] < 0.5


def test_groups_of_a_comparison_are_mixtures_variants_and_all(tmp_path):
    rows = measure("calibrated_1", robots=2, folder=tmp_path, experiments=[(CRAWL, "robust_overlapped")])
    assert [row["robots of"] for row in rows] == ["wake", "capture", "build", "described", "damped", "all"]
    assert [row["robots"] for row in rows] == [2, 2, 2, 3, 3, 6]
    assert reality_lines(rows)[0] == ["crawl, robust_overlapped", "paper", *(row["robots of"] for row in rows)]
    with pytest.raises(InvalidValueError, match="calibrated world"):
        measure(str(ranges(tmp_path)), robots=2)


def ranges(folder: Path) -> Path:
    """A file of ranges, which is no world."""
    path = folder / "ranges.toml"
    path.write_text('"body.total_mass" = [16.0, 17.0]\n')
    return path
