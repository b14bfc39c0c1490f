"""Pins the comparison of two rows: paired differences computed by hand, common scenarios, printed tables."""

import json

import numpy as np
import pytest
from support.rows import made_row, score

from spidar_gym.benchmark.comparison import compare_rows, comparison_tables, comparison_text
from spidar_gym.benchmark.row import write_row
from spidar_gym.benchmark.statistics import iqm
from spidar_gym.cli.main import main
from spidar_gym.errors import InvalidValueError

FLIGHT, GROUND = "flight-fast5", "ground-paper"


def flown(position, attitude=None, *, indices=None, track=FLIGHT, **columns):
    n = len(position)
    attitude = [0.01] * n if attitude is None else attitude
    columns = {"position_rms_m": list(position), "attitude_rms_rad": list(attitude)} | columns
    return score(track, [0.1] * n, indices=indices, **columns)


def test_a_difference_is_the_mean_of_the_middle_half_over_the_bases():
    rng = np.random.default_rng(0)
    theirs, mine = rng.uniform(0.01, 0.02, 8), rng.uniform(0.005, 0.015, (3, 8))
    (found,) = compare_rows(
        made_row({FLIGHT: [flown(run) for run in mine]}, "own"), made_row({FLIGHT: [flown(theirs)]})
    )
    change = found.changes["position_rms_m"]
    assert change.relative == pytest.approx(float(iqm(mine.mean(axis=0) - theirs) / iqm(theirs)))
    assert (change.before, change.after) == pytest.approx((float(iqm(theirs)), float(iqm(mine.mean(axis=0)))))
    assert change.low < change.relative < change.high
    assert found.scenarios == 8


def test_a_row_against_itself_differs_by_nothing():
    row = made_row({FLIGHT: [flown([0.01, 0.02, 0.03])]})
    (found,) = compare_rows(row, row)
    for change in found.changes.values():
        assert (change.relative, change.low, change.high) == (0.0, 0.0, 0.0)
    assert (found.success.value, found.success.low, found.success.high) == (0.0, 0.0, 0.0)


def test_only_scenarios_that_both_have_played_are_compared_each_with_its_own():
    base = made_row({FLIGHT: [flown([0.1, 0.2, 0.3, 0.4], indices=(0, 1, 2, 3))]})
    own = made_row({FLIGHT: [flown([0.3, 0.1], indices=(3, 1))]}, "own")
    (found,) = compare_rows(own, base)
    assert found.scenarios == 2
    assert found.changes["position_rms_m"].before == pytest.approx(0.3)  # mean of 0.4 and 0.2
    assert found.changes["position_rms_m"].after == pytest.approx(0.2)


def test_successes_are_compared_as_shares():
    base = made_row({FLIGHT: [flown([0.1] * 4, success=[True, False, False, False])]})
    own = made_row({FLIGHT: [flown([0.1] * 4, success=[True, True, True, False])] * 2}, "own")
    (found,) = compare_rows(own, base)
    assert (found.success.before, found.success.after) == (0.25, 0.75)
    assert found.success.value == pytest.approx(0.5)
    assert found.success.low <= 0.5 <= found.success.high


def test_rows_without_a_common_scenario_are_refused():
    base = made_row({GROUND: [score(GROUND, [0.1], duration_s=[1.0])]})
    with pytest.raises(InvalidValueError, match=r"base = 'qp'.*a row with scenarios of flight-fast5"):
        compare_rows(made_row({FLIGHT: [flown([0.1])]}, "own"), base)


def test_a_base_of_zeros_is_refused_in_a_line(tmp_path, capfd):
    base = made_row({FLIGHT: [flown([0.0, 0.0])]})
    own = made_row({FLIGHT: [flown([0.1, 0.1])]}, "own")
    with pytest.raises(InvalidValueError, match=f"position_rms_m of qp on {FLIGHT} = 0.0 is not valid.*above 0"):
        compare_rows(own, base)
    write_row(base, tmp_path / "rows")
    path = write_row(own, tmp_path)
    for more in ([], ["--json"]):
        with pytest.raises(SystemExit):
            main(["leaderboard", "compare", "--row", str(path), "--rows", str(tmp_path / "rows"), *more])
        out, err = capfd.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert "position_rms_m" in err


def test_flights_and_crawls_have_a_table_each_with_their_units():
    scores = {FLIGHT: [flown([0.1, 0.2])], GROUND: [score(GROUND, [0.1, 0.2], duration_s=[20.0, 22.0])]}
    own, base = made_row(scores, "own"), made_row(scores)
    flights, crawls = comparison_tables(compare_rows(own, base))
    assert flights[0] == ["track", "position", "attitude", "error", "success"]
    assert flights[1][:2] == [FLIGHT, "150 → 150 mm, +0% [+0%, +0%]"]
    assert crawls[0] == ["track", "time", "energy", "error", "success"]
    assert crawls[1][:2] == [GROUND, "21 → 21 s, +0% [+0%, +0%]"]
    assert comparison_text(own, base).startswith("own against qp")


def test_the_command_line_compares_a_file_with_a_row_of_a_folder(tmp_path, capfd):
    write_row(made_row({FLIGHT: [flown([0.2, 0.2])]}), tmp_path / "rows")
    path = write_row(made_row({FLIGHT: [flown([0.1, 0.1])]}, "own"), tmp_path)
    main(["leaderboard", "compare", "--row", str(path), "--rows", str(tmp_path / "rows")])
    assert "200 → 100 mm, -50% [-50%, -50%]" in capfd.readouterr().out
    main(["leaderboard", "compare", "--row", str(path), "--rows", str(tmp_path / "rows"), "--json"])
    (found,) = json.loads(capfd.readouterr().out)["comparisons"]
    assert found["changes"]["position_rms_m"]["relative"] == pytest.approx(-0.5)
    with pytest.raises(SystemExit):
        main(["leaderboard", "compare", "--row", str(path), "--rows", str(tmp_path / "rows"), "--base", "rl"])
    assert "unknown row 'rl'; valid: qp" in capfd.readouterr().err
