"""Pins the leaderboard: scores computed by hand, the reference of each row, and the content of its tables."""

import json
import re
from dataclasses import asdict
from functools import partial

import numpy as np
import pytest
from support.rows import made_row, score

from spidar_gym.benchmark import leaderboard
from spidar_gym.benchmark.leaderboard import GROUPS, as_json, cell, summary, tabulate
from spidar_gym.benchmark.leaderboard_tables import FEWEST_RUNS, markdown, report, text
from spidar_gym.benchmark.row import RowError, read_rows, write_row
from spidar_gym.benchmark.statistics import stratified_bootstrap
from spidar_gym.benchmark.track import CAP, CRAWL, HOVER, TRACKS

FLIGHT, GROUND = "flight-fast5", "ground-paper"


@pytest.fixture(autouse=True, scope="module")
def few_draws():
    """Few draws are enough to test the tables."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(leaderboard, "stratified_bootstrap", partial(stratified_bootstrap, draws=100))
        yield


def errors(scale=1.0, *, n=5, seed=0):
    return (scale * np.random.default_rng(seed).uniform(0.2, 0.9, n)).tolist()


def qp(tracks=(FLIGHT, GROUND), **options):
    return made_row({track: [errors(seed=k)] for k, track in enumerate(tracks)}, "qp", **options)


PAPERS = [name for name, track in TRACKS.items() if track.reference == "qp" and not track.is_calibrated]
"""Tracks of the nominal part on which scores refer to the paper's controller."""


def board_of(*rows):
    return tabulate({row.name: row for row in rows})


def lines_of(page, start):
    """Lines of a page that begin with a given word."""
    return [line for line in page.splitlines() if line.lstrip("| ").startswith(start)]


def cells_of(line):
    """Cells of a line of a Markdown table."""
    return [part.strip() for part in re.split(r"(?<!\\)\|", line)[1:-1]]


def table(page, heading, *, partial=False):
    """Lines of the Markdown table under a heading: cells by column."""
    part = page.split(f"\n## {heading}\n")[1].split("\n## ")[0].partition("on some tracks only")
    head, _, *lines = [line for line in part[2 if partial else 0].splitlines() if line.startswith("|")]
    return [dict(zip(cells_of(head), cells_of(line), strict=True)) for line in lines]


def test_scores_need_the_row_that_they_refer_to():
    with pytest.raises(RowError, match=r"there is no row qp, .*; valid: rows with qp\.json"):
        board_of(made_row({FLIGHT: [[0.5]]}, "other"))


def test_the_reference_scores_exactly_one_against_itself():
    board = board_of(qp(GROUPS["flight"]))
    for track in GROUPS["flight"]:
        c = board.cells["qp", track]
        assert list(asdict(c.score).values()) == pytest.approx([1.0] * 3, rel=1e-12)
        assert list(asdict(c.difference).values()) == [0.0] * 3
        assert list(asdict(c.improvement).values()) == [0.5] * 3
    assert list(asdict(board.overall["qp", "flight"]).values()) == pytest.approx([1.0] * 3, rel=1e-12)


def test_a_cell_is_that_by_hand():
    base = made_row({FLIGHT: [[1.0, 2.0, 3.0, 4.0]]}, "qp")
    own = made_row({FLIGHT: [[0.5, 2.0, 2.0, CAP]]}, "own")
    c = board_of(base, own).cells["own", FLIGHT]
    assert c.score.value == pytest.approx(2.5 / 2.375)
    # Differences −½, 0, −1, 1: the mean of the middle two, −½ and 0, over 2.5.
    assert c.difference.value == pytest.approx(-0.25 / 2.5)
    assert c.improvement.value == pytest.approx(2.5 / 4.0)
    assert c.error == pytest.approx(2.0)
    assert (c.success, c.failed, c.scenarios) == (0.25, 0.25, 4)
    for interval in (c.score, c.difference, c.improvement):
        assert interval.low < interval.value < interval.high


def test_a_cell_of_several_runs_is_over_all_of_them():
    base = made_row({FLIGHT: [[1.0, 2.0]]}, "qp")
    own = made_row({FLIGHT: [[0.5, CAP], [0.25, 0.75], [1.0, 1.5]]}, "own", "learned")
    c = board_of(base, own).cells["own", FLIGHT]
    assert c.score.value == pytest.approx(1.5 / 1.5)
    assert c.improvement.value == pytest.approx(4.5 / 6.0)
    # Sorted ¼, ½, ¾, 1, 1½, 5 with weights 0, 1/6, 1/3, 1/3, 1/6, 0.
    assert c.error == pytest.approx((0.5 + 2 * 0.75 + 2 * 1.0 + 1.5) / 6.0)
    assert (c.success, c.failed, c.scenarios) == (3 / 6, 1 / 6, 2)


def test_metrics_are_medians_but_counts_are_means_and_what_has_no_meaning_is_left_out():
    columns = {"energy_wh": [1.0, 2.0, 9.0], "unsolved": [0, 0, 3], "violations": [0.0, 0.0, 0.3]}
    columns |= {"endurance_min": [None, 8.0, None], "joint_rms_rad": [None] * 3}
    own = made_row({FLIGHT: [score(FLIGHT, [CAP] * 3, **columns)]})
    metrics = cell(own, own, FLIGHT).metrics
    assert (metrics["energy_wh"], metrics["unsolved"], metrics["endurance_min"]) == (2.0, 1.0, 8.0)
    assert metrics["violations"] == pytest.approx(0.1)
    assert np.isnan(metrics["joint_rms_rad"])


def test_a_row_with_fewer_scenarios_is_compared_on_just_those_whatever_their_order():
    base = made_row({FLIGHT: [[1.0, 2.0, 3.0, 4.0]]}, "qp")
    own = made_row({FLIGHT: [score(FLIGHT, [2.0, 1.0], indices=(3, 1))]}, "own")
    c = board_of(base, own).cells["own", FLIGHT]
    assert c.scenarios == 2
    assert list(asdict(c.score).values()) == pytest.approx([2.0] * 3, rel=1e-12)
    assert c.difference.value == pytest.approx(-0.5)
    assert c.improvement.value == 1.0


def test_a_row_is_not_compared_on_scenarios_that_the_reference_has_not_played():
    base = made_row({FLIGHT: [[1.0, 2.0]], GROUND: [[1.0, 2.0]]}, "qp")
    more = made_row({FLIGHT: [[1.0, 2.0, 3.0]], GROUND: [[0.5, 0.5]]}, "more")
    other = made_row({FLIGHT: [score(FLIGHT, [0.5, 0.5], split="validation")], "flight-wind": [[0.5]]}, "other")
    board = board_of(base, more, other)
    assert {track for name, track in board.cells if name == "more"} == {GROUND}
    assert not [track for name, track in board.cells if name == "other"]
    assert board.tracks == [FLIGHT, GROUND]


def test_an_interval_depends_on_no_other_row_and_not_on_their_order():
    a = made_row({track: [errors(0.8, seed=9), errors(0.7, seed=8)] for track in GROUPS["ground"]}, "a", "learned")
    b = made_row({track: [errors(2.0, seed=7)] for track in GROUPS["ground"]}, "b")
    base = qp(GROUPS["ground"])
    alone, among = board_of(base, a), board_of(b, a, base)
    for track in GROUPS["ground"]:
        assert alone.cells["a", track].score == among.cells["a", track].score
        assert alone.cells["a", track].difference == among.cells["a", track].difference
        assert among.cells["a", track].score.low < among.cells["a", track].score.high
    assert alone.overall["a", "ground"] == among.overall["a", "ground"]


def test_rows_and_tracks_have_draws_of_their_own():
    base = made_row({track: [errors()] for track in (FLIGHT, GROUND)}, "qp")
    same = {track: [errors(0.8, seed=9)] for track in (FLIGHT, GROUND)}
    board = board_of(base, made_row(same, "a"), made_row(same, "b"))
    drawn = [board.cells[name, track].score for name in "ab" for track in (FLIGHT, GROUND)]
    assert len({interval.value for interval in drawn}) == 1
    assert len({(interval.low, interval.high) for interval in drawn}) == 4


def test_an_overall_score_is_the_geometric_mean_and_only_where_no_track_of_the_group_is_missing():
    base = qp(PAPERS)

    def row(name, tracks):
        """A row with half of the error on the first track, a quarter on the next …"""
        return made_row({t: [(0.5**k * base.errors(t)[0]).tolist()] for k, t in enumerate(tracks, 1)}, name)

    flights, ground = GROUPS["flight"], GROUPS["ground"]
    board = board_of(base, row("flier", flights), row("walker", ground), row("half", flights[1:]), row("both", PAPERS))
    assert set(board.overall) == {("qp", "flight"), ("qp", "ground"), ("flier", "flight"), ("walker", "ground"),
                                  ("both", "flight"), ("both", "ground")}  # fmt: skip
    for name, group in (("flier", "flight"), ("walker", "ground")):
        mean = (len(GROUPS[group]) + 1) / 2
        assert list(asdict(board.overall[name, group]).values()) == pytest.approx([2.0**mean] * 3, rel=1e-9)
    assert set(flights).isdisjoint(ground)
    assert (len(flights), len(ground)) == (7, 5)
    apart = {"ground-steps"}
    nominal = {n for n, track in TRACKS.items() if not track.is_calibrated}
    assert {*flights, *ground} == {n for n in nominal if TRACKS[n].env_id in (HOVER, CRAWL)} - apart


@pytest.mark.parametrize("kind", ["classical", "learned", "residual"])
@pytest.mark.parametrize("runs", [1, FEWEST_RUNS - 1, FEWEST_RUNS])
def test_only_a_row_that_learned_with_fewer_than_five_runs_is_flagged(kind, runs):
    assert FEWEST_RUNS == 5
    own = made_row({FLIGHT: [errors(seed=k) for k in range(runs)]}, "own", kind)
    board = board_of(qp([FLIGHT]), own)
    flagged = kind != "classical" and runs < 5
    page = markdown(board)
    assert ("† fewer than 5 training runs" in page) == flagged
    for shown in (page, text(board)):
        assert all(("own †" in line) == flagged for line in lines_of(shown, "own"))
        assert len(lines_of(shown, "own")) == 2
        assert "qp †" not in shown


def test_on_courses_scores_refer_to_the_rule_alone():
    flown, walked = [1.0, 2.0, 4.0], [0.5, 1.0, CAP]
    rule, other = (made_row({"course-mixed": [e]}, n) for e, n in ((flown, "course_rule"), (walked, "other")))
    board = board_of(qp([FLIGHT]), rule, other)
    assert board.cells["course_rule", "course-mixed"].score.value == 1.0
    assert board.cells["other", "course-mixed"].score.value == pytest.approx(sum(flown) / sum(walked))
    assert ("qp", "course-mixed") not in board.cells
    assert not [key for key in board.overall if key[0] != "qp"]
    page, said = markdown(board), report(other, {"qp": qp([FLIGHT]), "course_rule": rule})
    lines = {line["policy"]: line for line in table(page, "course-mixed")}
    assert lines["course_rule"]["against course_rule"] == ""
    assert lines["other"]["against course_rule"].startswith(
        f"{board.cells['other', 'course-mixed'].difference.value:+.0%}"
    )
    assert "course_rule" in lines_of(said, "course-mixed")[0].split()
    with pytest.raises(RowError, match="no row course_rule"):
        board_of(qp([FLIGHT]), other)
    assert "there is no row course_rule" in report(other, {"qp": qp([FLIGHT])})


def test_a_track_that_stands_apart_is_ordered_by_success_then_error_and_the_others_by_score():
    scores = {"qp": [0.9, CAP, CAP, CAP], "near": [0.5, 0.6, 0.7, CAP], "arrives": [3.0, 3.1, 3.2, 3.3]}
    for track, best in (("ground-steps", ["arrives", "near", "qp"]), (GROUND, ["near", "arrives", "qp"])):
        rows = []
        for name, own in scores.items():
            scored = score(track, own)
            scored.metrics["success"] = [name == "arrives" or (name == "near" and k == 0) for k in range(4)]
            rows.append(made_row({track: [scored]}, name))
        board = board_of(*rows)
        assert board.cells["near", track].score.value > board.cells["arrives", track].score.value
        assert leaderboard.ranking(board, track) == best


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    """A board of written and read rows: three on all tracks, one on flights, one on a single track."""
    folder = tmp_path_factory.mktemp("rows")
    base = qp(PAPERS)
    for name, scale, tracks in (
        ("good", 0.5, PAPERS), ("bad", 3.0, PAPERS), ("flier", 0.8, GROUPS["flight"]), ("lone", 0.1, [GROUND]),
    ):  # fmt: skip
        scores = {track: [(scale * base.errors(track)[0]).tolist()] for track in tracks}
        write_row(made_row(scores, name, doc=f"Has {scale} of the error."), folder)
    write_row(base, folder)
    return tabulate(read_rows(folder))


def test_tables_are_sorted_by_score_and_rows_without_an_overall_score_have_a_separate_table(full):
    """A row that is defined on one track and leads it is not listed below the worst row."""
    page = markdown(full)
    assert [line["policy"] for line in table(page, "All tracks")] == ["good", "flier", "qp", "bad"]
    (lone,) = table(page, "All tracks", partial=True)
    (cell_of_it,) = (line for line in table(page, GROUND) if line["policy"] == "lone")
    assert (lone["policy"], lone["track"], lone["place"]) == ("lone", GROUND, "1 of 4")
    assert lone["score"] == cell_of_it["score"]
    assert "on some tracks only" not in markdown(board_of(full.rows["qp"], full.rows["good"]))
    for track in PAPERS:
        scores = [float(line["score"].split()[0]) for line in table(page, track)]
        assert scores == sorted(scores, reverse=True)
    assert [line["policy"] for line in table(page, GROUND)] == ["lone", "good", "qp", "bad"]
    asked, ranked = text(full, [GROUND]).split("\n\n", 1)
    assert asked.startswith(f"{GROUND}: ")
    assert text(full).startswith(ranked[:40])
    shown = [line.split() for line in ranked.splitlines() if line]
    assert [line[0] for line in shown if line[0] in full.rows] == ["good", "flier", "qp", "bad", "lone"]
    assert "lone" not in text(full, [FLIGHT])
    assert shown[-1][:7] == ["lone", "classical", "1", GROUND, "1", "of", "4"]


def test_a_terminal_shows_lines_of_at_most_120_columns_and_every_metric_on_request(full):
    name = "a_name_as_long_as_ours"
    rows = dict(full.rows) | {name: made_row({FLIGHT: [errors(), errors()]}, name, "learned")}
    board = tabulate(rows)
    narrow, wide = text(board), text(board, wide=True)
    assert max(map(len, narrow.splitlines())) <= 120
    assert "Wh" not in narrow
    assert max(map(len, wide.splitlines())) > 150
    for head in ("Wh", "pos. mm", "slip mm"):
        assert head in wide


def test_the_page_shows_what_the_cells_hold(full):
    page = markdown(full)
    overall = {line["policy"]: line for line in table(page, "All tracks")}
    assert overall["good"]["flight"].startswith("2 [2, 2]")
    assert overall["flier"]["flight"].startswith("1.25 [")
    assert overall["flier"]["ground"] == "–"
    assert overall["flier"]["… on ground"] == "–"
    assert overall["good"]["what it is"] == "Has 0.5 of the error."
    for track in PAPERS:
        for line in table(page, track):
            c = full.cells[line["policy"], track]
            assert line["error, IQM"] == f"{c.error:.3f}"
            assert line["success"] == f"{c.success:.0%}"
            assert line["Wh"] == f"{c.metrics['energy_wh']:.2f}"
            beside = line["policy"] != "qp"
            assert line["against qp"].split(" [")[0] == (f"{c.difference.value:+.0%}" if beside else "")
            assert line["P(better)"].split(" [")[0] == (f"{c.improvement.value:.2f}" if beside else "")
    good = {line["policy"]: line for line in table(page, FLIGHT)}["good"]
    assert good["against qp"] == "-50% [-50%, -50%]"
    assert good["P(better)"] == "1.00 [1.00, 1.00]"
    assert good["pos. mm"] == "500.0"


def test_the_page_has_every_row_and_every_track_and_the_command_that_makes_the_row(full):
    page, shown = markdown(full), text(full, full.tracks)
    assert full.tracks == PAPERS
    for track in PAPERS:
        assert {line["policy"] for line in table(page, track)} == {n for n in full.rows if (n, track) in full.cells}
        assert TRACKS[track].doc in shown
        assert TRACKS[track].formula in page
    for name, row in full.rows.items():
        assert f"- `{name}`: `spidar eval --policy {name}`, {row.content['sha256'][:12]}" in page
        assert len(lines_of(shown, name)) >= 1 + len(row.tracks)
    assert "nan" not in page.lower()
    assert "nan" not in shown.lower()


def test_a_table_of_the_terminal_has_only_the_requested_tracks(full):
    shown = text(full, [FLIGHT, "flight-wind"])
    assert re.findall(r"^((?:flight|ground)-\w+): ", shown, re.MULTILINE) == [FLIGHT, "flight-wind"]
    without = board_of(qp([FLIGHT]))
    assert "flight-wind" not in text(without, [FLIGHT, "flight-wind"])
    assert "flight-wind" not in markdown(without)


def test_the_same_rows_give_the_same_page(full):
    assert markdown(full) == markdown(tabulate(full.rows))
    assert as_json(full) == as_json(tabulate(full.rows))


def test_every_line_of_a_table_has_as_many_cells_as_its_head(full):
    """Even if the description of a policy contains a bar."""
    rows = dict(full.rows) | {"odd": made_row({FLIGHT: [errors()]}, "odd", doc="Error ‖e‖ or |e|, a | b.")}
    page = markdown(tabulate(rows))
    named = {line["policy"] for part in (False, True) for line in table(page, "All tracks", partial=part)}
    assert named == set(rows)


def test_json_has_every_cell_and_no_nan(full):
    found = json.loads(json.dumps(as_json(full), allow_nan=False))
    assert {(c["policy"], c["track"]) for c in found["tracks"]} == set(full.cells)
    assert {(c["policy"], c["group"]) for c in found["overall"]} == set(full.overall)
    one = next(c for c in found["tracks"] if (c["policy"], c["track"]) == ("good", FLIGHT))
    assert one["score"]["value"] == pytest.approx(2.0)
    assert one["metrics"]["energy_wh"] == full.cells["good", FLIGHT].metrics["energy_wh"]


def test_a_number_that_no_scenario_has_is_a_dash_null_and_not_a_number():
    gone = made_row({FLIGHT: [score(FLIGHT, [CAP] * 3, position_rms_m=[None] * 3)]}, "gone")
    board = board_of(qp(), gone)
    assert {line["policy"]: line for line in table(markdown(board), FLIGHT)}["gone"]["pos. mm"] == "–"
    found = json.loads(json.dumps(as_json(board), allow_nan=False))
    (one,) = (c for c in found["tracks"] if c["policy"] == "gone")
    assert one["metrics"]["position_rms_m"] is None
    assert np.isnan(board.cells["gone", FLIGHT].metrics["position_rms_m"])


@pytest.mark.parametrize(
    ("kind", "training", "words"),
    [
        ("learned", {"command": "train ppo", "steps": 2_000_000}, "; trained with `train ppo`, 2,000,000 steps a run"),
        ("classical", {"command": "spidar tune"}, "; tuned with `spidar tune`"),
        ("learned", None, ""),
        ("learned", {}, ""),
    ],
)
def test_the_page_states_command_and_steps_of_the_training(kind, training, words):
    own = made_row({FLIGHT: [errors()]}, "own", kind, training=training)
    assert f"- `own`: `spidar eval --policy own`{words}, {own.content['sha256'][:12]}\n" in markdown(
        board_of(qp(), own)
    )


def test_a_report_without_the_reference_has_errors_but_no_scores():
    own = made_row({FLIGHT: [[1.0, 4.0, 2.0, CAP]], GROUND: [[0.5, 0.7]]}, "own")
    strangers = made_row({"flight-wind": [[1.0]]}, "qp")
    for said in (report(own, {}), report(own, {"qp": strangers})):
        assert "there is no row qp to compare it with" in said
        assert lines_of(said, FLIGHT)[0].split() == [FLIGHT, "3.000", "0%", "25%"]
        assert lines_of(said, GROUND)[0].split() == [GROUND, "0.600", "100%", "0%"]
        assert "score" not in said


def test_a_report_stands_beside_the_reference():
    base = made_row({t: [[1.0, 0.5]] for t in PAPERS}, "qp")
    own = made_row({t: [[0.5, 0.25]] for t in GROUPS["flight"]}, "own", doc="Half of it.")
    said = report(own, {"qp": base})
    assert said.startswith("own: Half of it.\n")
    for track in GROUPS["flight"]:
        assert lines_of(said, track)[0].split() == [track, "2", "[2,", "2]", "0.375", "qp", "-50%", "[-50%,", "-50%]",
                                                    "1.00", "100%", "0%", "50%"]  # fmt: skip
    assert lines_of(said, "all flight")[0].split() == ["all", "flight", "2", "[2,", "2]"]
    assert not lines_of(said, "all ground")
    assert not lines_of(said, GROUND)


def test_a_summary_names_both_rows_and_has_the_cells_of_the_board():
    base, own = qp(), made_row({FLIGHT: [errors(0.5, seed=3)], GROUND: [errors(0.5, seed=4)]}, "own")
    found = json.loads(json.dumps(summary(own, {"qp": base}), allow_nan=False))
    assert (found["sha256"], found["reference"]) == (own.content["sha256"], {"qp": base.content["sha256"]})
    board = as_json(board_of(base, own))
    for part in (entry for entry in board["tracks"] if entry["policy"] == "own"):
        assert found["tracks"][part["track"]] == {k: v for k, v in part.items() if k not in ("policy", "track")}
    assert summary(own, {})["reference"] is None
    assert list(summary(own, {})["tracks"]) == [FLIGHT, GROUND]


def test_a_residual_is_compared_with_the_controller_that_it_adds_to_and_with_no_other():
    base, tuned = qp(), made_row({FLIGHT: [errors(0.5)]}, "qp_tuned")
    learned = made_row({FLIGHT: [errors(0.4), errors(0.45)]}, "learned", "residual", arguments={"preset": "tuned"})
    assert (learned.base, base.base) == ("qp_tuned", "")
    page = markdown(board_of(base, tuned, learned))
    assert "## What learning adds" in page
    assert "`learned` † against `qp_tuned`:" in page
    assert "`learned` † against `qp`:" not in page
    assert "What learning adds" not in markdown(board_of(base, tuned))
    assert "What learning adds" not in markdown(board_of(base, learned))  # no row of its base on this board
    own = made_row({FLIGHT: [errors(0.4)]}, "own", "residual", arguments={"preset": "mine"})
    assert own.base == ""
