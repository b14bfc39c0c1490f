"""Pins the count of the allocation's answers: every tick of every run counts once, under its status."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from spidar_gym.benchmark import answers as answering
from spidar_gym.benchmark.answers import answer_shards, answers_text, count_answers, count_ticks
from spidar_gym.benchmark.content import RowError
from spidar_gym.benchmark.row import read_rows
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.cli.main import main

ROWS = Path(__file__).resolve().parents[2] / "baselines" / "scores"


@pytest.fixture(scope="module")
def rows():
    return read_rows(ROWS)


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setitem(TRACKS, "flight-paper", replace(TRACKS["flight-paper"], seconds=0.5))


def scripted(monkeypatch, words):
    def play_scenario(policy, track, scenario, *, act_limit_s, control, on_tick):
        for word in words(track, scenario.index):
            on_tick({"qp_status": word})

    monkeypatch.setattr(answering, "play_scenario", play_scenario)


def test_each_tick_of_each_run_is_counted_once(rows, monkeypatch):
    chosen, tracks = {name: rows[name] for name in ("ppo_paper", "qp")}, rows["ppo_paper"].tracks[:2]
    scripted(monkeypatch, lambda track, index: ["projected"] * (index + 1) + ["held"] * (track == tracks[0]))
    runs = len(rows["ppo_paper"].policies)
    assert runs > 1
    played = []
    shards = answer_shards(chosen, tracks, 3)
    counts = count_answers(shards, on_scenario=lambda: played.append(1))
    assert len(played) == len(shards) == 2 * 3 * (1 + runs)
    for answers in counts:
        share, ticks = 1 if answers["row"] == "qp" else runs, answers["ticks"]
        assert ticks["projected"] == 6 * share
        assert ticks["held"] == 3 * share * (answers["track"] == tracks[0])
        assert sum(ticks.values()) == ticks["projected"] + ticks["held"]
    assert [(a["row"], a["track"]) for a in counts] == [(r, t) for r in chosen for t in tracks]


def test_a_row_is_played_on_the_tracks_that_it_has(rows):
    shards = answer_shards({"learned_gait": rows["learned_gait"], "pinv": rows["pinv"]}, list(TRACKS), 1)
    assert {(name, shard.track) for name, shard in shards} == {
        (name, track) for name in ("learned_gait", "pinv") for track in rows[name].tracks
    }


@pytest.mark.parametrize(
    ("name", "valid"), [("qp", {"closed_form", "solved"}), ("hold", {"none"}), ("pinv", {"closed_form"})]
)
def test_the_ticks_of_a_flight_are_those_of_its_environment(rows, short, name, valid):
    ((_, shard),) = answer_shards({name: rows[name]}, ["flight-paper"], 1)
    ticks = count_ticks(shard)
    assert set(ticks) <= valid
    assert sum(ticks.values()) == 20


def test_the_command_prints_shares_or_json(short, capfd):
    arguments = ["leaderboard", "answers", "--rows", str(ROWS), "--names", "qp", "hold", "--tracks", "flight-paper"]
    arguments += ["--scenarios", "1", "--workers", "1"]
    main(arguments)
    text = capfd.readouterr().out
    assert "100.000 %" in text
    main([*arguments, "--json"])
    found = json.loads(capfd.readouterr().out)["answers"]
    assert {a["row"]: a["ticks"]["none"] for a in found} == {"hold": 20, "qp": 0}
    with pytest.raises(SystemExit):
        main([*arguments[:4], "--names", "qpp"])
    assert "qp_tuned" in capfd.readouterr().err


def test_code_from_outside_is_not_run_unasked(rows):
    with pytest.raises(RowError, match="--trust"):
        answer_shards({"theirs": replace(rows["qp"], policies=("theirs:Policy",))}, ["flight-paper"], 1)


def test_the_table_has_a_line_for_each_row_and_track_and_a_column_for_each_status():
    ticks = dict.fromkeys(answering.STATUSES, 0) | {"projected": 1, "closed_form": 999}
    lines = answers_text([{"row": "qp", "track": "flight-wind", "ticks": ticks}]).splitlines()
    assert lines[0].split() == ["row", "track", "ticks", *answering.STATUSES]
    assert lines[2].split()[2:] == ["1000", "99.900", "%", "–", "0.100", "%", "–", "–", "–"]
