"""Pins the study of take-off and landing: limits, resuming and the table."""

import json

import numpy as np
import pytest

from spidar_gym.errors import SpidarError
from spidar_gym.robot import ROBOT
from spidar_gym.studies import hops
from spidar_gym.studies.hops import BARS, LARGEST_STEP, Hop, Seen, fly_hop, hop_count, hop_lines, hop_study


def test_changes_are_those_of_every_tick_of_a_phase_and_of_the_tick_that_follows():
    phases = ["lie", "spool", "spool", "climb", "climb", "descend", "descend"]
    seen = Seen(phase=phases, thrust=[0.0, 1.0, 3.0, 7.0, 15.0, 25.0, 26.0], free=[False] * 5 + [True, False])
    seen.vectoring = [0.1 * k * np.ones((8, 2)) for k in range(7)]
    np.testing.assert_array_equal(seen.steps("spool")[0], [1.0, 2.0])
    steps, turns = seen.steps("spool", after=True)
    np.testing.assert_array_equal(steps, [1.0, 2.0, 4.0])
    np.testing.assert_allclose(turns, 0.1)
    np.testing.assert_array_equal(seen.steps("descend", after=True)[0], [1.0])
    assert seen.phases() == ["lie", "spool", "climb", "descend"]


def hop(**changes):
    good = {"landed": True, "touchdown_m_s": 0.2, "tilt_rad": 0.01, "slip_m": 0.001, "seconds": 11.0, "turn_rad": 0.05,
            "steps_n": [1.0, 4.0], "hover_steps_n": [0.5, 2.0]}  # fmt: skip
    return good | changes


def study(monkeypatch, *found):
    """Return the rows of a study whose hops are `found`: nominal robots first, then randomised ones."""
    monkeypatch.setattr(hops, "finish", lambda call, items, **_: list(found))
    return hop_study(len(found) // 2)


@pytest.mark.parametrize("change", [*({key: bar + 0.01} for key, bar in BARS.items()), {"landed": False}])
def test_a_robot_beyond_any_bar_is_not_within_all(monkeypatch, change):
    nominal, random = study(monkeypatch, hop(), hop(**change), hop(), hop())
    assert (nominal["within"], nominal["beyond"]) == (1, [1])
    assert (random["within"], random["beyond"]) == (2, [])


def test_a_jolt_exceeds_a_limit_of_nominal_robots_and_enters_the_quantile_of_randomised_ones(monkeypatch):
    jolt = {"steps_n": [1.0, LARGEST_STEP + 0.1], "hover_steps_n": [3.0, 9.0]}
    nominal, random = study(monkeypatch, hop(**jolt), hop(**jolt))
    assert (nominal["within"], random["within"]) == (0, 1)
    assert random["step_quantile_n"] == pytest.approx(LARGEST_STEP + 0.1, abs=0.01)
    assert random["hover_step_quantile_n"] == pytest.approx(9.0, abs=0.01)
    table = hop_lines([nominal, random])
    assert {len(line) for line in table} == {4}
    assert table[0][2:] == ["noisy nominal", "randomised at strength 1, wind 2 m/s"]


def test_a_study_resumes(tmp_path, monkeypatch):
    flown = []

    def fly(one):
        if len(flown) == 3 and not stopped:
            stopped.append(one)
            raise KeyboardInterrupt
        flown.append(one)
        return hop(seconds=10.0 + one.seed)

    stopped = []
    fly.__qualname__ = "fly_hop"
    monkeypatch.setattr(hops, "fly_hop", fly)
    with pytest.raises(KeyboardInterrupt):
        hop_study(2, folder=tmp_path)
    rows = hop_study(2, folder=tmp_path)
    assert sorted((one.strength, one.seed) for one in flown) == [(0.0, 0), (0.0, 1), (1.0, 0), (1.0, 1)]
    assert [row["seconds"]["worst"] for row in rows] == [11.0, 11.0]
    json.dumps(rows)


@pytest.mark.slow
def test_a_hop_of_a_robot_with_noise_stays_within_all_limits():
    found = fly_hop(Hop(5))
    assert found["landed"]
    assert all(0.0 < found[key] <= bar + 1e-9 for key, bar in BARS.items())
    assert max(found["steps_n"]) <= LARGEST_STEP + 1e-9
    assert sum(found["steps_n"]) > 2.0 * 0.9 * ROBOT.weight  # the thrust rises to the weight and falls again
    assert len(found["hover_steps_n"]) >= 400
    assert found == fly_hop(Hop(5))


def test_calibrated_robots_hop_in_a_row_for_each_variant(tmp_path):
    rows = hop_study(1, world="calibrated_1", folder=tmp_path)
    assert [row.get("world") for row in rows] == [None, None, "calibrated_1, described", "calibrated_1, damped"]
    assert hop_count(1, "calibrated_1") == 4
    assert hop_lines(rows)[0][-2:] == ["calibrated_1, described", "calibrated_1, damped"]
    with pytest.raises(SpidarError, match="no_world"):
        hop_study(1, world="no_world", folder=tmp_path)
