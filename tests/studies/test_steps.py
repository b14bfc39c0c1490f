"""Pins the sweep of steps: gaits, foot lift, floors, and resuming."""

import json
from pathlib import Path

import pytest

from spidar_gym.benchmark import TRACKS
from spidar_gym.control.presets import CRAWL_PRESETS
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.source import PolicyError
from spidar_gym.studies import steps as step_study
from spidar_gym.studies.steps import FEET, GAITS, HEIGHTS, OPTIONS, Case, cells, controller_of, higher, play

ROOT = Path(__file__).resolve().parents[2]


def test_the_floors_and_the_robots_are_those_of_the_track():
    track = TRACKS["ground-steps"]
    assert {name: OPTIONS[name] for name in track.options if name != "terrain"} | {"terrain": "mixed"} == track.options
    assert OPTIONS["horizon_s"] == track.seconds
    assert HEIGHTS[-1] == track.ranges["steps"][1]


def test_a_gait_is_a_preset_or_a_policy_that_only_selects_a_controller():
    assert controller_of("robust") == {"controller": CRAWL_PRESETS["robust"]}
    assert controller_of("baselines.qp_tuned:QPTuned") == controller_of("robust")
    walking = controller_of("baselines.walking:Walking")
    assert walking["law"].__name__ == "Walker"
    assert step_study.gait_name("baselines.walking:Walking") == "walking"
    for name, error in (
        ("trot", UnknownNameError), ("baselines.indi:Indi", InvalidValueError),
        ("baselines.hold:Hold", InvalidValueError), ("baselines.walking:Trot", PolicyError),
    ):  # fmt: skip
        with pytest.raises(error):
            controller_of(name)


def test_the_higher_lift_is_at_least_the_default_and_changes_nothing_else():
    for config in CRAWL_PRESETS.values():
        lifted = higher(config).gait
        assert lifted.raise_angle == max(config.gait.raise_angle, 0.3)
        assert lifted.lift_height == max(config.gait.lift_height, 0.08)
        assert {k for k, v in vars(lifted).items() if v != getattr(config.gait, k)} <= {"raise_angle", "lift_height"}


@pytest.mark.slow
def test_robust_with_higher_lift_climbs_stairs_on_which_it_slips_otherwise():
    plain, lifted = (play(Case("robust", feet, "stairs", 0.05, 1)) for feet in FEET)
    assert "slip" in plain["failure"]
    assert lifted["failure"] == ""
    assert lifted["slip_m"] < 0.05 < plain["slip_m"]


@pytest.fixture
def quick(monkeypatch):
    """Replace the crawls by instant ones; returns the list of the cases that were run."""
    played = []

    def play(case):
        played.append(case)
        falls = case.height > 0.05 and case.seed > 0
        return {"failure": "slip, time" if falls else "", "slip_m": 0.01 * case.seed, "time_s": 30.0}

    monkeypatch.setattr(step_study, "play", play)
    return played


def test_a_sweep_resumes_and_counts_successes(quick, tmp_path):
    step_study.sweep(seeds=1, folder=tmp_path)
    assert len(quick) == len(cells())
    rows = step_study.sweep(seeds=3, folder=tmp_path)
    assert len(quick) == 3 * len(cells())
    assert [(row["feet"], row["terrain"], row["height"]) for row in rows] == [cell[1:] for cell in cells()]
    for row in rows:
        lost = 2 if row["height"] > 0.05 else 0
        assert (row["runs"], row["successes"], row["slip_m"]) == (3, 3 - lost, 0.01)
        assert row["failures"] == ({"slip": 2, "time": 2} if lost else {})
    heading, first, *_ = step_study.step_lines(rows)
    assert heading[3:] == ["20 mm", "40 mm", "60 mm", "80 mm", "100 mm", "failures"]
    assert first == [
        "`robust`", "as it does", "tiles", *["3 of 3, 10 mm"] * 2, *["1 of 3, 10 mm"] * 3, "slip 6, time 6",
    ]  # fmt: skip


def test_the_committed_sweep_is_of_these_cells():
    result = json.loads((ROOT / "docs" / "results" / "steps.json").read_text(encoding="utf-8"))["result"]
    found = [(row["gait"], row["feet"], row["terrain"], row["height"]) for row in result["steps"]]
    assert found == [(step_study.gait_name(gait), *rest) for gait, *rest in cells(GAITS)]
