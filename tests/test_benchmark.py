"""Pins the committed leaderboard: whole, made of its rows; what the constraint is worth."""

from functools import cache
from pathlib import Path

import pytest

from spidar_gym import viz
from spidar_gym.benchmark import TRACKS
from spidar_gym.benchmark.leaderboard import GROUPS, markdown, tabulate, text
from spidar_gym.benchmark.policy import defined_on, load_policy, policy_name
from spidar_gym.benchmark.row import read_rows
from spidar_gym.benchmark.track import SCENARIOS
from spidar_gym.cli_eval import BASELINES

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


@cache
def board():
    return tabulate(read_rows(ROOT / "baselines" / "scores"))


@pytest.mark.parametrize("spec", BASELINES)
def test_every_baseline_has_a_whole_row_on_every_track_on_which_it_is_defined(spec, monkeypatch):
    monkeypatch.chdir(ROOT)
    policy = load_policy(spec)
    row = board().rows[policy_name(policy)]
    assert row.policies == (spec,)
    assert row.tracks == [name for name, track in TRACKS.items() if track.env_id in defined_on(policy)]
    for track in row.tracks:
        assert row.scenarios(track) == list(range(SCENARIOS))
        assert row.content["tracks"][track]["split"] == "test"


def test_the_leaderboard_is_what_its_rows_give():
    assert (ROOT / "baselines" / "LEADERBOARD.md").read_text(encoding="utf-8") == markdown(board())


def test_readme_shows_the_scores_and_every_track():
    for line in text(board(), ["flight-narrow"]).splitlines():
        assert line.rstrip() in README
    for name, track in TRACKS.items():
        assert f"| `{name}` | {track.doc} |" in README


@pytest.mark.parametrize("name", ["pinv", "qp_unconstrained"])
def test_where_rotors_are_stacked_the_constraint_is_worth_something(name):
    cell = board().cells[name, "flight-narrow"]
    assert cell.difference.low > 0.0, "its error is larger, interval and all"
    assert cell.score.high < 1.0
    assert cell.metrics["violations"] > 0.5
    assert board().cells["qp", "flight-narrow"].metrics["violations"] < 0.05


def test_the_reference_scores_one_on_every_track():
    for name in TRACKS:
        cell = board().cells["qp", name]
        assert (cell.score.value, cell.score.low, cell.score.high) == (1.0, 1.0, 1.0)
        assert cell.improvement.value == 0.5
    for group in GROUPS:
        assert board().overall["qp", group].value == pytest.approx(1.0, abs=1e-12)


def test_in_the_picture_the_names_of_all_rows_stand_above_the_panels_and_not_on_them(monkeypatch):
    pytest.importorskip("matplotlib")
    kept = []
    monkeypatch.setattr(viz, "_save", lambda figure, path: kept.append(figure))
    viz.leaderboard_picture(board(), ROOT)
    (figure,) = kept
    figure.canvas.draw()
    (legend,) = figure.legends
    names = legend.get_window_extent()
    assert {text.get_text() for text in legend.get_texts()} == set(board().names)
    assert names.y1 <= figure.bbox.y1
    assert names.y0 >= max(ax.get_tightbbox().y1 for ax in figure.axes)
    viz._pyplot().close(figure)
