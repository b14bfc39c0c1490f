"""Pins the sweep of gates: sizes beyond those of a course, the behaviour of each gait, and resuming."""

import json
from pathlib import Path

import pytest

from spidar_gym.control.course.gates import KINDS
from spidar_gym.studies import gates as gate_study
from spidar_gym.studies.gates import GAITS, SWEPT, Case, cells, course_of, gate_lines, play
from spidar_gym.tasks.course import SIZES

ROOT = Path(__file__).resolve().parents[2]


def test_every_kind_is_swept_beyond_the_sizes_of_a_course():
    assert {*SWEPT} == {*KINDS}
    easier = {"beam", "slot"}  # the larger, the easier
    for kind, sizes in SWEPT.items():
        low, high = SIZES[kind]
        assert list(sizes) == sorted(sizes)
        assert sizes[0] < low if kind in easier else sizes[-1] > high, kind
        assert sizes[-1] > high if kind in easier else sizes[0] <= low, kind


def test_a_course_has_one_gate_and_the_goal_behind_or_on_it():
    for kind, size, _ in cells():
        course = course_of(kind, size, 3)
        (gate,) = course.gates
        assert (gate.kind, gate.size) == (kind, size)
        assert course.goal.x > (gate.end if gate.is_passed else gate.begin) + 1.0
        assert len(course.tiles) == gate.tile_count
        assert course_of(kind, size, 3) == course
    assert course_of("tiles", 0.02, 3) != course_of("tiles", 0.02, 4)


def test_floors_have_no_narrow_flight_and_high_gates_no_crawl():
    tried = {(kind, gait) for kind, _, gait in cells()}
    assert ("slope", "fly narrow") not in tried
    assert {gait for kind, gait in tried if kind == "beam"} == {*GAITS}
    for kind, most in gate_study.CLIMBS.items():
        assert max(size for k, size, gait in cells() if (k, gait) == (kind, "crawl")) == most


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "size", "gait", "failure"),
    [
        ("wall", 0.6, "fly wide", ""), ("slot", 1.4, "fly narrow", ""), ("slope", 0.1, "fly wide", ""),
        ("beam", 0.8, "fly narrow", "hit"), ("slot", 0.9, "rule", "hit"), ("wall", 0.05, "crawl", "stuck"),
    ],
)  # fmt: skip
def test_a_gait_passes_possible_gates_and_fails_at_others(kind, size, gait, failure):
    run = play(Case(kind, size, gait, 0))
    assert (run["arrived"], run["failure"]) == (failure == "", failure)
    assert (run["off_m"] < gate_study.LANDED) == run["arrived"]
    assert run["time_s"] < gate_study.SECONDS


@pytest.fixture
def quick(monkeypatch):
    """Replace the episodes by instant ones; returns the list of the cases that were run."""
    played = []

    def play(case):
        played.append(case)
        arrives = case.size < 0.5 or case.seed == 0
        return {"arrived": arrives, "failure": "" if arrives else "hit", "time_s": 1.0 + case.seed, "off_m": 0.0}

    monkeypatch.setattr(gate_study, "play", play)
    return played


def test_a_sweep_resumes_and_counts_arrivals(quick, tmp_path):
    first = gate_study.sweep(seeds=1, folder=tmp_path)
    assert all(row["arrived"] == row["runs"] == 1 for row in first)
    assert len(quick) == len(cells())
    rows = gate_study.sweep(seeds=3, folder=tmp_path)
    assert len(quick) == 3 * len(cells())
    assert [(row["kind"], row["size"], row["gait"]) for row in rows] == cells()
    for row in rows:
        assert (row["arrived"], row["failures"]) == ((3, {}) if row["size"] < 0.5 else (1, {"hit": 2}))
        assert row["time_s"] == (2.0 if row["size"] < 0.5 else 1.0)


def test_the_table_lists_the_sizes_at_which_all_arrive_and_at_which_none_does():
    rows = [
        {"kind": "wall", "size": size, "gait": "crawl", "runs": 4, "arrived": arrived, "failures": failures}
        for size, arrived, failures in (
            (0.01, 4, {}), (0.02, 4, {}), (0.05, 3, {"hit": 1}), (0.1, 0, {"stuck": 4}),
            (0.2, 0, {"stuck": 3, "hit": 1}),
        )
    ]  # fmt: skip
    _, line = gate_lines(rows[::-1])
    assert line == ["wall", "0.4 … 1 m", "crawl", "0.01 … 0.02", "0.05", "0.1 … 0.2", "stuck 7, hit 2"]


def test_the_committed_sweep_is_of_these_cells():
    result = json.loads((ROOT / "docs" / "results" / "gates.json").read_text(encoding="utf-8"))["result"]
    assert [(row["kind"], row["size"], row["gait"]) for row in result["gates"]] == cells()
