"""Pins the held-out table: reading and refusing its file, differences computed by hand, the content of its lines."""

import json
import math
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.benchmark.held_out import CONDITIONS, HELD_OUT, draw_held_out, scenarios_digest
from spidar_gym.benchmark.held_out_play import Entrant, plan
from spidar_gym.benchmark.held_out_table import (
    KEPT,
    condition_lines,
    content_text,
    held_out_lines,
    make_content,
    origin_lines,
    read_content,
    worst_lines,
    write_content,
)
from spidar_gym.benchmark.row import row_hash
from spidar_gym.benchmark.statistics import iqm
from spidar_gym.errors import SpidarError, UnknownNameError

SPEC = "spidar_gym.policies.presets:PresetPolicy"
OTHER = "baselines.qp:QP"
DUCT, DELAY, CRAWL = "duct-fast4", "delay-fast4", "payload-crawl"
COUNT = 4


def flown(position, attitude=0.01, **more):
    return {"position_rms_m": position, "attitude_rms_rad": attitude, "error": 0.2, "success": True, "failed": False,
            **more}  # fmt: skip


def walked(time):
    return {"duration_s": time, "energy_wh": 5.0, "error": 0.2, "success": True, "failed": False}


def made(numbers, *, conditions=(DUCT,), more=None):
    """Content of a base and a residual with one run each; `numbers` holds the metrics by (policy, condition)."""
    entrants = [
        Entrant("qp", "classical", (OTHER,), "", conditions),
        Entrant("own", "residual", (SPEC,), "qp", more or conditions),
    ]
    metrics = [metric for entrant in entrants for c in entrant.conditions for metric in numbers[entrant.name, c]]
    return make_content(entrants, plan(entrants, COUNT), metrics, command="spidar leaderboard held-out")


@pytest.fixture
def content():
    return made(
        {("qp", DUCT): [flown(x) for x in (0.010, 0.012, 0.014, 0.016)],
         ("own", DUCT): [flown(x) for x in (0.005, 0.009, 0.012, 0.012)]}
    )  # fmt: skip


def sealed(content, change):
    """Content after a change, with the hash of the new one."""
    content = deepcopy(dict(content))
    change(content)
    return {**content, "sha256": row_hash(content)}


# The file


def test_the_file_is_read_as_it_was_written_with_a_line_for_every_condition(content, tmp_path):
    write_content(tmp_path / "t.json", content)
    text = (tmp_path / "t.json").read_text(encoding="utf-8")
    assert text == content_text(content)
    assert read_content(tmp_path / "t.json") == json.loads(text) == content
    assert sum(line.strip().startswith(f'"{DUCT}"') for line in text.splitlines()) == 2
    assert content["conditions"] == {DUCT: scenarios_digest(draw_held_out(DUCT, COUNT))}
    assert content["scenarios"] == COUNT
    run = content["policies"][1]["runs"][DUCT][0]
    assert set(run) == set(KEPT["flight"])
    assert run["position_rms_m"] == [0.005, 0.009, 0.012, 0.012]


def damage(*path):
    """Set the entry at a path; the last argument is its value."""

    def change(content):
        *way, key, value = path
        for step in way:
            content = content[step]
        content[key] = value

    return change


RUN = ("policies", 1, "runs", DUCT, 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (damage("format", 2), "another format"),
        (damage("model_sha256", "0" * 64), "another robot model"),
        (damage("policies", 1, "name", "../own"), "name = "),
        (damage("policies", 1, "kind", "magic"), "unknown kind 'magic'"),
        (damage("policies", 1, "against", "missing"), "unknown policy 'missing'; valid: qp, own"),
        (damage("policies", 1, "policies", [SPEC, SPEC]), "one a policy"),
        (damage("policies", 1, "policies", ["<b>"]), "without HTML"),
        (damage("command", "a\nb"), "one line"),
        (damage("scenarios", 3), "3 of each of position_rms_m"),
        (damage("conditions", {}), f"unknown condition '{DUCT}'"),
        (damage("policies", 1, "runs", "flight-paper", []), "unknown condition 'flight-paper'"),
        (damage(*RUN, "error", [0.2, 0.2, 0.2, -1.0]), f"error on {DUCT} = -1.0"),
        (damage(*RUN, "error", [0.2, 0.2, 0.2, "0.2"]), f"error on {DUCT} = '0.2'"),
        (damage(*RUN, "position_rms_m", [0.1, 0.1, 0.1, None]), f"position_rms_m on {DUCT} = None"),
        (damage(*RUN, "energy_wh", [1.0] * 4), "of each of"),
        (damage("more", 1), "has 'more'"),
    ],
)
def test_what_no_evaluation_writes_is_refused_in_a_line(change, words, content, tmp_path):
    write_content(tmp_path / "t.json", sealed(content, change))
    with pytest.raises(SpidarError) as refusal:
        read_content(tmp_path / "t.json")
    assert words in str(refusal.value)
    assert "t.json" in str(refusal.value)
    assert "valid: the file that `spidar leaderboard held-out` writes" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_file_edited_by_hand_and_one_that_is_not_there_are_refused(content, tmp_path):
    path = tmp_path / "t.json"
    path.write_text(content_text(content).replace("0.005", "0.004"), encoding="utf-8")
    with pytest.raises(SpidarError, match="edited by hand"):
        read_content(path)
    with pytest.raises(SpidarError, match="No such file"):
        read_content(tmp_path / "none.json")
    path.write_text("{}", encoding="utf-8")
    with pytest.raises(SpidarError, match="lacks"):
        read_content(path)


# Its lines


def test_a_difference_is_paired_and_stands_with_its_interval_behind_both_numbers(content):
    heading, base, own = [line for line in held_out_lines(content, "flight") if line[0] in ("condition", DUCT)]
    assert heading == ["condition", "policy", "against", "position", "attitude", "error", "success"]
    assert base == [DUCT, "qp", "", "13 mm", "10 mrad", "0.2", "100%"]
    theirs, mine = np.array([10.0, 12, 14, 16]), np.array([5.0, 9, 12, 12])
    relative = float(iqm(mine - theirs) / iqm(theirs))
    assert own[:3] == [DUCT, "own", "qp"]
    assert own[3].startswith(f"13 → {iqm(mine):.3g} mm, {relative:+.1%} [")
    assert own[4] == "10 → 10 mrad, +0.0% [+0.0%, +0.0%]"
    assert own[6] == "100% → 100% [+0%, +0%]"


def test_a_policy_without_results_has_dashes_and_conditions_and_worlds_without_results_no_lines(content):
    own = content["policies"][1]["runs"]
    own[DELAY] = own.pop(DUCT)
    content["conditions"][DELAY] = content["conditions"][DUCT]
    lines = held_out_lines(content, "flight")
    assert [line[:2] for line in lines[1:]] == [[DELAY, "qp"], [DELAY, "own"], [DUCT, "qp"], [DUCT, "own"]]
    assert [line[3:] == ["–"] * 4 for line in lines[1:]] == [True, False, False, True]
    assert len(held_out_lines(content, "ground")) == 1
    with pytest.raises(UnknownNameError, match=r"valid: .*flight, ground"):
        held_out_lines(content, "air")


def test_crawls_are_listed_in_seconds_and_watt_hours():
    numbers = {("qp", CRAWL): [walked(20.0)] * COUNT, ("own", CRAWL): [walked(18.0)] * COUNT}
    lines = held_out_lines(made(numbers, conditions=(CRAWL,)), "ground")
    assert lines[0][3:] == ["time", "energy", "error", "success"]
    assert lines[1][3:5] == ["20 s", "5 Wh"]
    assert lines[2][3] == "20 → 18 s, -10.0% [-10.0%, -10.0%]"


def test_the_largest_upper_end_is_found_wherever_it_lies():
    numbers = {(name, c): [flown(0.01)] * COUNT for name in ("qp", "own") for c in (DUCT, DELAY)}
    numbers["own", DELAY] = [flown(0.009, attitude=0.0103)] * COUNT
    content = made(numbers, conditions=(DELAY, DUCT))
    heading, line = worst_lines(content)
    assert heading == ["policy", "runs", "against", "largest upper end", "of", "on"]
    assert line == ["own", "1", "qp", "+3.0%", "attitude", DELAY]


def test_a_diverged_simulation_leaves_no_upper_end_and_no_difference(tmp_path):
    lost = flown(None, attitude=None, error=5.0, success=False, failed=True)
    numbers = {("qp", DUCT): [flown(0.01)] * COUNT, ("own", DUCT): [lost, *[flown(0.001)] * (COUNT - 1)]}
    content = made(numbers)
    write_content(tmp_path / "t.json", content)
    content = read_content(tmp_path / "t.json")
    assert worst_lines(content)[1][3:] == ["none: it diverged", "position", DUCT]
    (own,) = [line for line in held_out_lines(content, "flight") if line[:2] == [DUCT, "own"]]
    assert "nan" not in " ".join(own)
    assert own[3] == "–"
    alone = made({**numbers, ("qp", DUCT): [lost] * COUNT})
    (base,) = [line for line in held_out_lines(alone, "flight") if line[:2] == [DUCT, "qp"]]
    assert base[3:] == ["–", "–", "5", "0%"]


def test_a_policy_without_a_base_has_no_line_among_the_worst(content):
    assert [line[0] for line in worst_lines(content)[1:]] == ["own"]
    alone = sealed(content, damage("policies", 1, "against", ""))
    assert len(worst_lines(alone)) == 1


def test_the_origin_of_the_table_and_the_conditions_have_separate_tables(content):
    heading, line = origin_lines(content)
    assert dict(zip(heading, line, strict=True))["scenarios a condition"] == str(COUNT)
    assert line[0] == "`spidar leaderboard held-out`"
    assert [line[0] for line in condition_lines()[1:]] == [f"`{name}`" for name in CONDITIONS]


def test_the_committed_table_is_whole():
    content = read_content(Path(__file__).resolve().parents[2] / HELD_OUT)
    for group in ("flight", "ground"):
        lines = held_out_lines(content, group)
        assert len(lines) > 1
        assert not [cell for line in lines for cell in line if cell == "–"]
        assert all(math.isfinite(float(line[3].split()[0])) for line in lines[1:])
