"""Pins the ablations: each removes one part, is paired with the complete controller, and reported with its interval."""

from dataclasses import fields

import pytest

from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.studies import ablations as ablation_study
from spidar_gym.studies.ablations import BEST, OVERALL, PARTS, WHOLE, Job, ablation_lines, jobs, play_job, study


def changed(one, other):
    """Return the names of the fields, also nested, in which two configurations differ."""
    found = set()
    for each in fields(one):
        a, b = getattr(one, each.name), getattr(other, each.name)
        if hasattr(a, "__dataclass_fields__"):
            found |= changed(a, b)
        elif a != b:
            found.add(each.name)
    return found


@pytest.mark.parametrize("group", PARTS)
def test_every_ablation_lacks_a_different_part(group):
    parts = PARTS[group]()
    whole = parts[WHOLE]["controller"]
    for name, arguments in parts.items():
        differs = changed(arguments["controller"], whole) | (arguments.keys() - {"controller"})
        assert bool(differs) == (name != WHOLE), name
    assert len({repr(arguments) for arguments in parts.values()}) == len(parts)


def test_every_controller_is_evaluated_on_every_track_of_its_group():
    assert {job.track for job in jobs()} == {name for name, track in TRACKS.items() if track.group in BEST}
    assert len(jobs()) == sum(len(PARTS[track.group]()) for track in TRACKS.values() if track.group in BEST)


def test_an_important_part_changes_the_error_and_the_complete_controller_is_the_preset():
    lame = play_job(Job("flight", "the paper's gains", "flight-fast5", 2))
    whole = play_job(Job("flight", WHOLE, "flight-fast5", 2))
    assert all(a > 2.0 * b for a, b in zip(lame["error"], whole["error"], strict=True))
    assert whole["success"] == [True, True]
    assert len(load_scenarios("flight-fast5")[0]) > 2


@pytest.fixture
def played(monkeypatch):
    """Replace the evaluation: errors are 1 for the complete controller, and 2 with a failure in four for the others."""

    def made(job):
        worse = job.name != WHOLE
        return {"error": [1.0 + worse] * job.scenarios, "success": [not worse, True, True, True]}

    made.__qualname__ = "made"
    monkeypatch.setattr(ablation_study, "play_job", made)


@pytest.mark.usefixtures("played")
def test_the_table_shows_the_ratio_of_the_errors_and_the_successes(tmp_path):
    rows = study(scenarios=4, folder=tmp_path)
    for row in rows:
        expected = 1.0 if row["name"] == WHOLE else 2.0
        assert [row[key] for key in ("factor", "low", "high")] == pytest.approx([expected] * 3)
        assert row["success"] == (1.0 if row["name"] == WHOLE else 0.75)
    assert {row["track"] for row in rows if row["group"] == "ground"} > {OVERALL, "ground-paper"}
    lines = ablation_lines(rows)
    assert len({len(line) for line in lines}) == 1
    assert lines[0][:2] == [f"error over that of {BEST['flight']}", OVERALL]
    assert lines[1][:3] == [WHOLE, "1", "1"]
    assert lines[2][1] == "2.00 [2.00, 2.00], 75%"
    below = lines[len(PARTS["flight"]()) + 1 :]
    assert below[0][:2] == [f"error over that of {BEST['ground']}", OVERALL]
    assert [line[0] for line in below[1:]] == list(PARTS["ground"]())
    assert {line[7] for line in below} == {""}  # the ground has two tracks fewer
