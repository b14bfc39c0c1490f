"""Pins the committed leaderboard: complete, generated from its rows; the benefit of the interference constraint."""

import shutil
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from spidar_gym.benchmark import TRACKS
from spidar_gym.benchmark.leaderboard import GROUPS, RANKED, ranking, tabulate
from spidar_gym.benchmark.leaderboard_tables import first_lines, markdown, overall_lines, track_lines
from spidar_gym.benchmark.row import read_rows
from spidar_gym.benchmark.track import SCENARIOS
from spidar_gym.cli.evaluate import BASELINES
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import defined_on, policy_name

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROTOCOL = (ROOT / "docs" / "benchmark" / "protocol.md").read_text(encoding="utf-8")


@cache
def board():
    return tabulate(read_rows(ROOT / "baselines" / "scores"))


@pytest.mark.parametrize("spec", BASELINES)
def test_every_baseline_has_a_whole_row_on_every_track_on_which_it_is_defined(spec, monkeypatch):
    monkeypatch.chdir(ROOT)
    policy = load_policy(spec)
    row = board().rows.get(policy_name(policy))
    if row is None:
        assert not board().has_front, "it came with the calibrated tracks"
        return
    assert row.policies == (spec,)
    tracks = [name for name, track in TRACKS.items() if track.env_id in defined_on(policy)]
    for calibrated in (False, True):
        own, every = (
            [name for name in names if TRACKS[name].is_calibrated == calibrated] for names in (row.tracks, tracks)
        )
        assert own == every or (not own and board().has_front != calibrated)
    for track in row.tracks:
        assert row.scenarios(track) == list(range(SCENARIOS))
        assert row.split(track) == "test"


def test_a_group_that_came_later_moved_no_overall_score_and_no_place(tmp_path):
    rows = ROOT / "baselines" / "scores"
    for path in rows.glob("*.json"):
        shutil.copy(path, tmp_path)
    before = tabulate(read_rows(tmp_path))
    assert {len(GROUPS["flight"]), len(GROUPS["ground"])} == {7, 5}
    assert before.overall == {key: score for key, score in board().overall.items() if key[1] in GROUPS}
    assert overall_lines(before) == overall_lines(board())
    assert before.cells == {key: cell for key, cell in board().cells.items() if key[1] in before.tracks}
    assert not {name for name in before.tracks if TRACKS[name].group not in GROUPS}


def test_along_a_path_the_tuned_controller_has_a_tenth_of_the_papers_error():
    paper, tuned = (board().cells[name, "flight-path"] for name in ("qp", "qp_tuned"))
    assert tuned.error < 0.1 * paper.error
    assert tuned.score.low > 10.0
    assert tuned.success == 1.0
    assert {board().rows[name].kind for name, track in board().cells if track == "flight-path"} == {"classical"}


def test_on_courses_the_planner_is_better_than_the_rule_and_one_gait_alone_fails():
    for track in ("course-takeoff", "course-gates", "course-mixed"):
        rule, planner, fly, crawl = (
            board().cells[f"course_{name}", track] for name in ("rule", "planner", "fly", "crawl")
        )
        assert rule.success >= 0.8
        assert planner.success >= 0.9
        assert planner.difference.high < 0.0, "the whole interval of the difference is below 0"
        assert max(fly.success, crawl.success) < 0.2


def test_the_rule_carries_objects_and_with_the_papers_interference_rows_alone_it_does_not():
    cells = board().cells
    assert cells["grasp_rule", "grasp-claw"].success >= 0.85
    assert cells["grasp_rule", "grasp-boxes"].success >= 0.9
    for track in ("grasp-boxes", "grasp-fragile"):
        assert cells["grasp_paper_rows", track].success < 0.3
        assert cells["grasp_paper_rows", track].difference.low > 0.0, "the whole interval of the difference is above 0"


def test_knowing_mass_and_friction_lowers_the_error_of_a_grasp_but_does_not_carry_more():
    for track in ("grasp-claw", "grasp-boxes", "grasp-fragile"):
        rule, told = (board().cells[f"grasp_{name}", track] for name in ("rule", "told"))
        assert told.difference.high < 0.0
        assert abs(told.success - rule.success) < 0.15


def test_the_leaderboard_is_what_its_rows_give():
    assert (ROOT / "baselines" / "LEADERBOARD.md").read_text(encoding="utf-8") == markdown(board())


def test_readme_and_the_protocol_show_the_scores_and_every_track():
    for cells in first_lines(board(), wide=False)[:9]:
        assert f"| {' | '.join(cells)} |" in README
    for cells in track_lines(board(), "flight-narrow"):
        assert f"| {' | '.join(cells)} |" in PROTOCOL
    for name, track in TRACKS.items():
        assert f"| `{name}` | {track.doc} |" in PROTOCOL
        assert f"(../pictures/track-{name}.png)" in PROTOCOL


@pytest.mark.parametrize("name", ["pinv", "qp_unconstrained"])
def test_where_rotors_are_stacked_the_constraint_reduces_the_error(name):
    cell = board().cells[name, "flight-narrow"]
    assert cell.difference.low > 0.0, "the whole interval of the difference is above 0"
    assert cell.score.high < 1.0
    assert cell.metrics["violations"] > 0.5
    assert board().cells["qp", "flight-narrow"].metrics["violations"] < 0.05


def test_the_reference_scores_one_on_every_track():
    for name in board().tracks:
        cell = board().cells[TRACKS[name].reference, name]
        assert (cell.score.value, cell.score.low, cell.score.high) == (1.0, 1.0, 1.0)
        assert cell.improvement.value == 0.5
    for group in GROUPS:
        assert board().overall["qp", group].value == pytest.approx(1.0, abs=1e-12)


def test_in_the_picture_each_panel_names_its_rows_the_best_at_the_top(monkeypatch):
    pytest.importorskip("matplotlib")
    from spidar_gym.viz import figures

    kept = []
    monkeypatch.setattr(figures, "save", lambda figure, path: kept.append(figure))
    figures.leaderboard_picture(board(), ROOT)
    (figure,) = kept
    figure.canvas.draw()
    panels = {ax.get_title(loc="left"): ax for ax in figure.axes}
    groups = [TRACKS[track].group for track in panels]
    assert set(groups) == {TRACKS[track].group for track in board().tracks}
    assert all(groups.count(group) <= 2 for group in groups)
    kinds = {}
    for track, ax in panels.items():
        names = [label.get_text() for label in ax.texts]
        assert set(names) == {*ranking(board(), track)[:10], TRACKS[track].reference}
        scores = [board().cells[name, track].score for name in names]
        success = [board().cells[name, track].success for name in names]
        ranked = success if TRACKS[track].group not in RANKED else [score.value for score in scores]
        assert ranked == sorted(ranked, reverse=True)
        low, high = ax.get_xlim()
        assert low <= min(score.low for score in scores)
        assert max(score.high for score in scores) <= high
        drawn = {(line.get_xdata()[0], line.get_ydata()[0]): line for line in ax.lines if len(line.get_xdata()) == 1}
        for y, (name, score) in enumerate(zip(names, scores, strict=True)):
            line = drawn[score.value, y]
            kinds.setdefault(board().rows[name].kind, set()).add((line.get_color(), line.get_marker()))
        boxes = [label.get_window_extent() for label in ax.texts]
        assert all(above.y0 >= below.y1 - 1.0 for above, below in pairwise(boxes))
        assert all(ax.bbox.x0 <= box.x0 and box.x1 <= ax.bbox.x1 for box in boxes)
    # Each class has one colour and one marker, which no other class has.
    assert all(len(looks) == 1 for looks in kinds.values())
    assert len({look for looks in kinds.values() for color, mark in looks for look in (color, mark)}) == 2 * len(kinds)
    legend = figure.legends[0].get_window_extent()
    assert legend.y0 >= max(ax.get_tightbbox().y1 for ax in figure.axes)
    figures.pyplot().close(figure)
