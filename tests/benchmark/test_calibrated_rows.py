"""Checks rows of the calibrated tracks and their tables: world, second draw, halves, the old order beside the new."""

from functools import partial

import numpy as np
import pytest
from support.rows import changed, made_row, score, stored

from spidar_gym.benchmark import TRACKS, leaderboard, verify
from spidar_gym.benchmark.leaderboard import FRONT, GROUPS, as_json, tabulate
from spidar_gym.benchmark.leaderboard_tables import first_lines, front_lines, markdown, order_lines, overall_lines, text
from spidar_gym.benchmark.row import RowError, read_row, read_rows, write_row
from spidar_gym.benchmark.statistics import stratified_bootstrap
from spidar_gym.benchmark.track import CALIBRATED, CAP, SECOND

TRACK = "flight-calibrated"
FLIGHTS, GROUND = FRONT.values()


@pytest.fixture(autouse=True, scope="module")
def few_draws():
    """Few draws are enough to test the tables."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(leaderboard, "stratified_bootstrap", partial(stratified_bootstrap, draws=100))
        yield


def errors(scale=1.0, seed=0, n=12):
    return (scale * np.random.default_rng(seed).uniform(0.2, 0.9, n)).tolist()


def row_of(name="qp", scale=1.0, tracks=(*FLIGHTS, *GROUND), split="test", seed=0):
    scores = {track: [score(track, errors(scale, seed + k), split=split)] for k, track in enumerate(tracks)}
    return made_row(scores, name)


def written(folder, *rows):
    for row in rows:
        write_row(row, folder / SECOND if row.split(row.tracks[0]) == SECOND else folder)
    return folder


# Rows


def test_a_row_of_a_calibrated_track_names_the_world_of_its_robots(tmp_path):
    world = TRACKS[TRACK].calibration
    row = read_row(write_row(made_row({TRACK: [errors()], "flight-fast5": [errors()]}), tmp_path))
    assert row.content["tracks"][TRACK]["world"] == {"name": world.name, "sha256": world.digest}
    assert "world" not in row.content["tracks"]["flight-fast5"]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda track: track.pop("world"), f"{TRACK} has no calibrated world"),
        (lambda track: track.update(world=None), f"{TRACK} has no calibrated world"),
        (lambda track: track.update(world="calibrated_1"), "not an object"),
        (lambda track: track["world"].update(sha256="0" * 63), "64 hexadecimal digits"),
        (lambda track: track["world"].update(name="../x"), "letters, digits"),
        (lambda track: track["world"].update(more=1), "valid: name, sha256"),
    ],
)
def test_a_row_with_an_invalid_world_is_refused_in_one_line(tmp_path, change, expected):
    path = stored(changed(row_of(), lambda content: change(content["tracks"][TRACK])), tmp_path)
    with pytest.raises(RowError, match=expected) as refusal:
        read_row(path)
    assert "\n" not in str(refusal.value)


def test_a_track_of_the_nominal_part_has_no_world(tmp_path):
    world = {"name": "calibrated_1", "sha256": "0" * 64}
    base = made_row({"flight-fast5": [errors()]})
    path = stored(changed(base, lambda content: content["tracks"]["flight-fast5"].update(world=world)), tmp_path)
    with pytest.raises(RowError, match="flight-fast5 has a calibrated world"):
        read_row(path)


def test_verification_refuses_a_row_of_another_world_and_names_both(tmp_path):
    digest = "0" * 64
    path = stored(changed(row_of(), lambda content: content["tracks"][TRACK]["world"].update(sha256=digest)), tmp_path)
    rows = {"qp": read_row(path)}
    present = TRACKS[TRACK].calibration
    expected = f"row qp: {TRACK} is of world calibrated_1 {digest[:12]}, not {present.name} {present.digest[:12]}"
    with pytest.raises(RowError, match=expected) as refusal:
        verify.verify(rows, [verify.Pick("qp", TRACK, 0, 0)], trust=True)
    assert "\n" not in str(refusal.value)


def test_a_second_draw_is_joined_with_the_row_of_the_first(tmp_path):
    first, second = row_of(), row_of(split=SECOND, seed=5)
    joined = read_rows(written(tmp_path, first, second))["qp"]
    assert joined.content == first.content
    assert joined.second.content == second.content
    every = verify.with_second_draws({"qp": joined})
    assert list(every) == ["qp", f"qp ({SECOND})"]
    assert {verify.shard_of(every[pick.row], *pick[1:]).split for pick in verify.every_scenario(every)} == {
        "test",
        SECOND,
    }


def test_a_second_draw_without_a_first_or_of_other_scenarios_or_policies_is_refused(tmp_path):
    write_row(row_of(split=SECOND), tmp_path / "a" / SECOND)
    with pytest.raises(RowError, match="a second draw without a first"):
        read_rows(tmp_path / "a")
    for row in (row_of(), row_of(split="validation")):
        write_row(row_of(), tmp_path / "b")
        write_row(row, tmp_path / "b" / SECOND)
        with pytest.raises(RowError, match="other scenarios"):
            read_rows(tmp_path / "b")
    other = changed(row_of(split=SECOND), lambda content: content.update(policies_sha256=["0" * 64]))
    stored(other, tmp_path / "b" / SECOND, "qp.json")
    with pytest.raises(RowError, match="other policies"):
        read_rows(tmp_path / "b")


def test_rows_of_the_calibrated_folder_are_joined_with_those_of_the_nominal_part(tmp_path):
    nominal = made_row({"flight-fast5": [errors()]})
    write_row(nominal, tmp_path)
    write_row(row_of(), tmp_path / "calibrated")
    assert read_rows(tmp_path)["qp"].tracks == [*FLIGHTS, *GROUND, "flight-fast5"]


# Tables


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """Three rows on everything, one without a second draw, one on one calibrated track, one of the nominal part."""
    folder = tmp_path_factory.mktemp("rows")
    nominal = [track for tracks in GROUPS.values() for track in tracks]
    for name, old, new in (("qp", 1.0, 1.0), ("good", 0.4, 0.8), ("better", 0.5, 0.5), ("old", 0.6, None)):
        write_row(row_of(name, old, nominal), folder)
        if new is not None:
            write_row(row_of(name, new), folder / "calibrated")
            if name != "better":
                write_row(row_of(name, new, split=SECOND, seed=9), folder / SECOND)
    write_row(row_of("lone", 0.3, [TRACK]), folder)
    return tabulate(read_rows(folder))


def as_table(lines):
    heads, *rows = lines
    return {row[0]: dict(zip(heads, row, strict=True)) for row in rows}


def test_the_front_has_the_calibrated_scores_of_both_draws(board):
    assert first_lines(board) == front_lines(board)
    heads, *lines = front_lines(board)
    assert [line[0] for line in lines] == ["better", "good", "qp"]
    found = dict(zip([line[0] for line in lines], lines, strict=True))
    flight = heads.index("flight")
    assert found["good"][flight].startswith("1.25 [")
    assert found["good"][flight + 1].startswith("1.25 [")
    assert found["good"][flight + 1].endswith(", within")
    assert found["better"][flight + 1] == found["better"][flight + 3] == "–"
    assert {("qp", group) for group in (*FRONT, *GROUPS)} <= set(board.overall)
    assert set(board.second.overall) == {(name, group) for name in ("qp", "good") for group in FRONT}


def test_the_second_draw_is_outside_where_its_score_leaves_the_interval(tmp_path):
    rows = [row_of(), row_of(split=SECOND), row_of("own", 0.5), row_of("own", 0.1, split=SECOND)]
    board = tabulate(read_rows(written(tmp_path, *rows)))
    heads, _, own = sorted(front_lines(board), key=lambda line: ("policy", "qp", "own").index(line[0]))
    assert own[heads.index("second draw")].endswith(", outside")


def test_the_halves_are_those_of_the_scenarios_kinds(tmp_path):
    """Every second kind of the world has damped joints: errors and failures of one half leave the other."""
    world = TRACKS[TRACK].calibration
    halves = [world.pairs[TRACKS[TRACK].robots(k).kind][1] for k in range(24)]
    values = [CAP if half == "damped" and k < 8 else 0.8 if half == "damped" else 0.2 for k, half in enumerate(halves)]
    base = made_row({track: [values] for track in FLIGHTS})
    board = tabulate({"qp": base})
    parts = board.cells["qp", TRACK].parts
    assert list(parts) == [name for name, _ in (*world.variants, *world.mixtures)]
    assert (parts["described"].error, parts["described"].failed) == (pytest.approx(0.2), 0.0)
    assert parts["damped"].failed == pytest.approx(values.count(CAP) / halves.count("damped"))
    assert parts["damped"].error >= 0.8
    line = as_table(front_lines(board))["qp"]
    assert line["flight, described: error, failed"] == "0.200, 0%"
    assert line["ground, described: error, failed"] == "–"
    assert "## Nominal part" in markdown(board)
    for mixture, _ in world.mixtures:
        assert parts[mixture].scenarios == sum(mixture == world.pairs[k % len(world.pairs)][0] for k in range(24))


def test_the_old_order_stands_beside_the_new(board):
    found = as_table(order_lines(board))
    assert found["better"] == {"policy": "better", "flight, nominal": "2 of 4", "flight, calibrated": "1 of 3",
                               "ground, nominal": "2 of 4", "ground, calibrated": "1 of 3"}  # fmt: skip
    assert found["old"]["flight, calibrated"] == found["old"]["ground, calibrated"] == "–"


def test_the_page_has_the_calibrated_part_first_and_the_nominal_part_unchanged(board):
    page = markdown(board)
    places = [page.index(f"\n## {head}\n") for head in ("Calibrated world", "Nominal part", TRACK, "flight-paper")]
    assert places == sorted(places)
    nominal = tabulate({name: row for name, row in board.rows.items() if name != "lone"})
    assert overall_lines(nominal) == overall_lines(board)
    assert "| lone | classical | 1 | flight-calibrated | 1 of 4 |" in page
    assert "nan" not in page.lower()


def test_a_terminal_shows_the_front_in_120_columns_and_everything_on_request(board):
    narrow, wide = text(board), text(board, wide=True)
    assert narrow.split()[:4] == ["policy", "flight", "second", "draw"]
    assert max(map(len, narrow.splitlines())) <= 120
    assert "described: error, failed" in wide
    assert "failed: described, damped" in narrow


def test_json_has_the_second_draw_and_the_halves(board):
    found = as_json(board)
    assert {one["policy"] for one in found["second"]["overall"]} == {"qp", "good"}
    assert all(("described" in one["parts"]) == TRACKS[one["track"]].is_calibrated for one in found["tracks"])
    assert set(CALIBRATED.values()) < {one["group"] for one in found["overall"]}


def test_without_rows_of_calibrated_tracks_the_nominal_part_is_the_front():
    board = tabulate({"qp": made_row({track: [errors()] for track in GROUPS["ground"]})})
    assert not board.has_front
    assert first_lines(board) == overall_lines(board)
    assert "\n## All tracks\n" in markdown(board)
    assert board.second is None


def test_a_score_has_no_overall_value_without_both_flights():
    board = tabulate({"qp": row_of(tracks=[TRACK])})
    assert not board.has_front
    assert board.overall == {}
