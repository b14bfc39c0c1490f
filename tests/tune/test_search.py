"""Pins the search for `tuned` and `robust_overlapped`: cost, scenarios, files and resuming."""

import importlib
import itertools
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.benchmark import HOVER, scoring
from spidar_gym.benchmark.scenario import load_scenarios, make_env
from spidar_gym.benchmark.track import CAP, REST_S, TRACKS
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import (
    RETUNED,
    ROBUST_OVERLAPPED,
    ROBUST_RETUNED,
    STEADY,
    STEADY_CRAWL,
    TUNED,
    TUNED_V1,
)
from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError, UnknownNameError
from spidar_gym.sim.worlds import FOLDER
from spidar_gym.tune import crawl
from spidar_gym.tune import search as tuning
from spidar_gym.tune.flight import RETUNED_START
from spidar_gym.tune.search import (
    SEARCHES,
    Candidate,
    cost,
    draw_scenarios,
    find_search,
    found_controller,
    play_candidate,
)

WORLD_FILE = FOLDER / "calibrated_1.toml"
STARTS = {
    "flight": TUNED_V1,
    "retuned": RETUNED_START,
    "crawl": crawl.START,
    "recrawl": crawl.RESTART,
    "steady_crawl": STEADY_CRAWL,
}
ROOT = Path(__file__).resolve().parents[2]
RIVALS = {"adrc": "Adrc", "compensation": "Compensation", "indi": "Indi", "mpc": "MPC"}
SEARCHED = ROOT / "baselines/searches"
BUDGET = {"population": 4, "scenarios": 1, "seed": 0, "workers": 1}


def started(name):
    search = find_search(name)
    values = search.settle({p.name: p.start for p in search.parameters})
    return search.arguments(values), search.shortfall(values)


@pytest.mark.parametrize("name", STARTS)
def test_a_search_begins_where_it_says(name):
    arguments, shortfall = started(name)
    assert shortfall == 0.0
    if name == "retuned":  # as stiff as the margins allow
        rows = arguments["controller"].centroidal.position_gains, STARTS[name].centroidal.position_gains
        np.testing.assert_allclose(*rows, rtol=0.02)
        arguments = {"controller": replace(arguments["controller"], centroidal=STARTS[name].centroidal)}
    assert arguments == {"controller": STARTS[name]}


@pytest.mark.parametrize("name", STARTS)
def test_a_search_is_made_on_all_tracks_of_its_group_and_begins_with_its_margins(name):
    search = find_search(name)
    on_ground = name.endswith("crawl")
    if name == "steady_crawl":
        assert search.tracks == ("ground-calibrated", "the paper's way at 0.8 rad/s")
        return
    assert search.tracks == tuple(t for t in TRACKS if TRACKS[t].group == ("ground" if on_ground else "flight"))
    assert len(search.tracks) == (5 if on_ground else 7)
    assert started(name)[1] == 0.0


@pytest.mark.parametrize("name", RIVALS)
def test_a_rivals_search_is_made_on_all_flights_and_begins_and_ends_with_its_margins(name, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    search = find_search(f"baselines.{name}:SEARCH")
    assert search.name == name
    assert search.tracks == SEARCHES["flight"].tracks
    assert search.reference == "tuned"
    assert search.by_pattern
    assert search.shortfall(search.settle({p.name: p.start for p in search.parameters})) == 0.0


def test_a_custom_search_is_found_in_its_module_and_nothing_else_is(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "searched_for.py").write_text(
        "from spidar_gym.tune.search import SEARCHES\nMINE, NUMBER = SEARCHES['flight'], 3\n"
    )
    assert find_search("searched_for:MINE") is SEARCHES["flight"]
    for name in ("searched_for:NUMBER", "searched_for:NOTHING", "searched_by:MINE", "searched_for:", "a:b:c"):
        with pytest.raises(
            InvalidValueError,
            match=r"search = .*flight, retuned, steady, crawl, recrawl, steady_crawl, or module:NAME of a `Search`",
        ):
            find_search(name)


def test_the_cost_is_the_logarithm_of_the_geometric_mean_over_tracks_and_margins_come_on_top():
    errors = {"a": 0.1, "b": 0.4}
    assert cost(errors, 0.0) == pytest.approx(np.log(0.2))
    assert cost(errors, 0.3) > cost(errors, 0.1) > cost(errors, 0.0)
    halved = cost({"a": 0.05, "b": 0.4}, 0.0)
    assert halved == pytest.approx(cost({"a": 0.1, "b": 0.2}, 0.0))


def test_scenarios_are_the_searchs_own_and_other_ones_in_every_generation():
    drawn = [draw_scenarios("flight", generation, seed, 2) for generation, seed in ((0, 0), (1, 0), (0, 1))]
    assert drawn[0] == draw_scenarios("flight", 0, 0, 2)
    seeds = [one.seed for draw in drawn for scenarios in draw.values() for one in scenarios]
    for name in SEARCHES["flight"].tracks:
        seeds += [one.seed for split in TRACKS[name].splits for one in load_scenarios(name, split)[0]]
    assert len(set(seeds)) == len(seeds)
    wind = drawn[0]["flight-wind"][0]
    assert 1.0 <= wind.disturbances["wind"] <= 3.0
    assert drawn[0]["flight-randomised"][0].robot != drawn[1]["flight-randomised"][0].robot


def test_a_search_on_other_robots_flies_these_and_holds_their_margins(tmp_path):
    path = tmp_path / "robot.toml"
    text = WORLD_FILE.read_text(encoding="utf-8")
    path.write_text(text.replace("ranges = { described = [8, 8], damped = [0.55, 1.4] }", "ranges = { all = [2, 2] }"))
    drawn = draw_scenarios("steady", 0, 0, 2, str(path))
    usual = draw_scenarios("steady", 0, 0, 2)
    for track, scenarios in drawn.items():
        assert (scenarios == usual[track]) != TRACKS[track].is_calibrated
        assert [own.seed for own in scenarios] == [own.seed for own in usual[track]]
    env = make_env(TRACKS["flight-calibrated"], drawn["flight-calibrated"][1], {})
    assert env.reset(seed=drawn["flight-calibrated"][1].seed)[1]["randomization"]["actuators.joint_kd"] == 2.0
    with pytest.raises(InvalidValueError, match="steady, steady_crawl"):
        tuning.tune("retuned", tmp_path / "out", generations=1, robots=str(path), **BUDGET)
    path.write_text('"body.total_mass" = [16.0, 16.0]')
    with pytest.raises(InvalidValueError, match="calibrated world"):
        draw_scenarios("steady", 0, 0, 1, str(path))


def test_the_controller_of_a_log_is_that_of_its_search(tmp_path):
    assert found_controller(SEARCHED / "steady.json") == STEADY
    with pytest.raises(SpidarError, match="crawler"):
        found_controller(SEARCHED / "recrawl.json")
    (tmp_path / "cut.json").write_bytes((SEARCHED / "steady.json").read_bytes()[:-40])
    with pytest.raises(SpidarError, match="no log of a search"):
        found_controller(tmp_path / "cut.json")


def test_a_candidate_with_the_references_numbers_flies_as_the_reference_does():
    scenarios = draw_scenarios("flight", 0, 0, 1)["flight-narrow"]
    start = {p.name: p.start for p in SEARCHES["flight"].parameters}
    same, own = (play_candidate(Candidate("flight", v, "flight-narrow", scenarios)) for v in (start, None))
    assert same == own
    assert own["ticks"] == 640
    weak = play_candidate(Candidate("flight", start | {"z_p": 1.6, "z_d": 1.5}, "flight-narrow", scenarios))
    assert weak["errors"][0] > own["errors"][0]


def test_a_start_pose_out_of_reach_costs_what_a_failure_does():
    values = {p.name: p.start for p in SEARCHES["crawl"].parameters} | {"inner": 1.5, "outer": 0.0}
    scenarios = load_scenarios("ground-paper", "validation")[0][:2]
    assert play_candidate(Candidate("crawl", values, "ground-paper", scenarios)) == {"errors": [CAP] * 2, "ticks": 0}


def test_a_crawl_that_arrives_with_dragged_feet_costs_more_than_its_error():
    values = {p.name: p.start for p in SEARCHES["crawl"].parameters}
    scenarios = draw_scenarios("crawl", 0, 0, 1)["ground-uneven"]
    (lifted,), (dragged,) = (
        play_candidate(Candidate("crawl", values | own, "ground-uneven", scenarios))["errors"]
        for own in ({"swing_at": 0.6, "raise_angle": 0.12}, {"swing_at": 0.2, "raise_angle": 0.04})
    )
    assert dragged - crawl.UNSUCCESSFUL < lifted < dragged  # dragging is faster: errors alone would favour it


def test_a_crawl_that_arrives_late_counts_as_unsuccessful_and_costs_its_share_of_lateness_besides(monkeypatch):
    track = "the paper's way at 0.8 rad/s"
    scenarios = draw_scenarios("steady_crawl", 0, 0, 1)[track]
    values = {p.name: p.start for p in SEARCHES["steady_crawl"].parameters}
    found = {}
    for longest in (100.0, 5.0):
        late = replace(SEARCHES["steady_crawl"], durations={track: longest})
        monkeypatch.setitem(SEARCHES, "steady_crawl", late)
        found[longest] = play_candidate(Candidate("steady_crawl", values, track, scenarios))
    assert found[5.0]["ticks"] == found[100.0]["ticks"]
    seconds = found[5.0]["ticks"] / CONTROL_RATE - REST_S
    more = found[5.0]["errors"][0] - found[100.0]["errors"][0]
    assert more == pytest.approx(crawl.UNSUCCESSFUL + seconds / 5.0 - 1.0)


@pytest.fixture
def short(monkeypatch):
    """Shorten tracks to eight ticks."""
    monkeypatch.setattr(scoring, "_steps_of", lambda seconds, env: 8)
    monkeypatch.setattr(tuning, "draw_scenarios", lambda name, *_: {
        track: load_scenarios(track, "validation")[0][:1] for track in ("flight-paper", "flight-forms")
    })  # fmt: skip


def log(folder):
    return json.loads((folder / "flight.json").read_text(encoding="utf-8"))


def test_a_search_writes_its_log_and_answers_with_its_last_line(short, tmp_path):
    done, heads = [], []
    last = tuning.tune(
        "flight", tmp_path, generations=2, **BUDGET, on_piece=lambda: done.append(None), on_generation=heads.append
    )
    written = log(tmp_path)
    assert written["settings"] == {"search": "flight", "population": 4, "scenarios": 1, "seed": 0}
    assert [line["generation"] for line in written["log"]] == [0, 1]
    assert written["log"][-1] == last
    assert [head["cost"] for head in heads] == [line["cost"] for line in written["log"]]
    # Four candidates, the mean of the distribution and the reference, on two tracks each, for eight ticks, and margins.
    assert len(done) == 2 * 6 * 3
    assert last["ticks"] == 6 * 2 * 8
    assert set(last["parameters"]) == {p.name for p in SEARCHES["flight"].parameters}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight.json"]


def test_the_log_has_the_cost_of_the_mean_of_the_distribution_and_of_the_reference_on_the_same_scenarios(
    short, tmp_path
):
    """In the first generation the mean and the reference are the same controller."""
    line = tuning.tune("flight", tmp_path, generations=1, **BUDGET)
    assert line["cost"] == line["reference"] == pytest.approx(cost(line["errors"], 0.0))
    assert line["shortfall"] == 0.0
    assert line["best"] == min(line["costs"][:4]) != line["cost"]
    later = tuning.tune("flight", tmp_path, generations=2, **BUDGET)
    assert later["cost"] != later["reference"]


def test_an_interrupted_search_goes_on_as_if_it_had_not_been(short, tmp_path):
    tuning.tune("flight", tmp_path / "whole", generations=3, **BUDGET)
    for generations in (1, 2, 3):
        # Another process would start with another state of NumPy's global generator, and other code draws from it.
        np.random.seed(generations)  # noqa: NPY002 - the global state must not matter
        draw = lambda: np.random.random(generations)  # noqa: E731, NPY002, B023 - called at once
        tuning.tune("flight", tmp_path / "parts", generations=generations, **BUDGET, on_piece=draw)
    assert log(tmp_path / "whole") == log(tmp_path / "parts")
    finished = log(tmp_path / "parts")["log"][-1]
    assert tuning.tune("flight", tmp_path / "parts", generations=2, **BUDGET) == finished


@pytest.fixture
def by_pattern(monkeypatch):
    """Replace the costs of a pattern search by those of a bowl; return the number of jobs of each generation."""
    counted = []

    def finish(call, jobs, *, on_done, **_):
        counted.append(len(jobs))
        for k, _ in enumerate(jobs):
            on_done(k, None)
        off = [0.3 if job.values is None else abs(job.values["momentum_gain"] - 1.2) for job in jobs]
        played = [{"errors": [0.1 * (1.0 + own)], "ticks": 3} for own in off]
        return [each if job.track else {"shortfall": 0.0} for job, each in zip(jobs, played, strict=True)]

    monkeypatch.setattr(tuning, "finish", finish)
    search = SEARCHES["retuned"]
    drawn = {track: load_scenarios(track, "validation")[0][:1] for track in search.tracks}
    monkeypatch.setattr(tuning, "draw_scenarios", lambda *_: drawn)
    # Computing margins, and the stiffness that they allow, takes seconds.
    monkeypatch.setitem(SEARCHES, "retuned", replace(search, loops=None, settle=dict, arguments=lambda _: {}))
    return counted


def test_a_pattern_search_plays_the_same_scenarios_and_tells_what_its_answer_costs(by_pattern, tmp_path):
    how = {"population": 2, "scenarios": 1, "seed": 0, "workers": 1}
    done = []
    last = tuning.tune("retuned", tmp_path, generations=40, **how, on_piece=lambda: done.append(None))
    tracks = len(SEARCHES["retuned"].tracks) + 1  # and the margins
    assert by_pattern == [4 * tracks, *[2 * tracks] * 39]  # mean and reference: in the first generation only
    assert sum(tuning.pieces("retuned", 2, k) for k in range(40)) == len(done) == sum(by_pattern)
    lines = json.loads((tmp_path / "retuned.json").read_text(encoding="utf-8"))["log"]
    assert all(later["cost"] <= earlier["cost"] for earlier, later in itertools.pairwise(lines))
    assert len({line["reference"] for line in lines}) == 1
    assert last["cost"] == pytest.approx(cost(last["errors"], last["shortfall"]))
    assert abs(last["parameters"]["momentum_gain"] - 1.2) < abs(lines[0]["parameters"]["momentum_gain"] - 1.2)
    again = tuning.tune("retuned", tmp_path, generations=41, **how)
    assert again["generation"] == 40
    assert by_pattern[40:] == [2 * tracks]


def test_a_pattern_search_has_two_candidates_and_ends_where_it_rests(by_pattern, tmp_path, monkeypatch):
    assert [tuning.candidates("retuned", None), tuning.candidates("flight", None)] == [2, 12]
    with pytest.raises(InvalidValueError, match=r"population = 12 .*2 for a pattern search"):
        tuning.candidates("retuned", 12)
    monkeypatch.setitem(sys.modules, "cma", None)  # a pattern search does not need cma
    monkeypatch.setattr(tuning, "STEP", 0.015)
    how = {"population": 2, "scenarios": 1, "seed": 0, "workers": 1}
    last = tuning.tune("retuned", tmp_path, generations=1000, **how)
    assert last["sigma"] == 0.0
    assert last["generation"] < 200
    played = len(by_pattern)
    assert tuning.tune("retuned", tmp_path, generations=1000, **how) == last
    assert len(by_pattern) == played, "a search that has ended is not resumed"


def test_another_seed_is_another_search(short, tmp_path):
    a, b = (tuning.tune("flight", tmp_path / str(seed), generations=1, **(BUDGET | {"seed": seed})) for seed in (0, 1))
    assert a["parameters"] != b["parameters"]


@pytest.mark.parametrize("other", [{"population": 5}, {"scenarios": 2}, {"seed": 1}])
def test_a_search_of_other_settings_is_not_mixed_with_one_in_the_folder(short, tmp_path, other):
    tuning.tune("flight", tmp_path, generations=1, **BUDGET)
    before = log(tmp_path)
    with pytest.raises(SpidarError, match="valid: the same settings, or another folder"):
        tuning.tune("flight", tmp_path, generations=2, **(BUDGET | other))
    assert log(tmp_path) == before


def test_every_flipped_bit_of_a_log_is_noticed(short, tmp_path):
    tuning.tune("flight", tmp_path, generations=2, **BUDGET)
    path = tmp_path / "flight.json"
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for place in rng.choice(len(whole), 300, replace=False).tolist():
        data = bytearray(whole)
        data[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        with pytest.raises(SpidarError) as caught:
            tuning.tune("flight", tmp_path, generations=2, **BUDGET)
        assert str(caught.value).isprintable()
        assert "valid: " in str(caught.value)


@pytest.mark.parametrize(
    "change",
    [
        lambda log: log[1]["costs"].reverse(),
        lambda log: log[1]["costs"].pop(),
        lambda log: log[1].update(sigma=0.25),
        lambda log: log[0]["parameters"].update(z_p=1.0),
        lambda log: log[0].update(cost=0.0),
        lambda log: log.pop(0),
    ],
)
def test_a_log_whose_costs_do_not_lead_to_it_is_refused_though_its_checksum_is_right(short, tmp_path, change):
    tuning.tune("flight", tmp_path, generations=2, **BUDGET)
    content = log(tmp_path)
    change(content["log"])
    (tmp_path / "flight.json").write_text(tuning.log_text(content["settings"], content["log"]), encoding="utf-8")
    with pytest.raises(SpidarError, match=r"log's costs, the search does not reproduce generation .*; valid: "):
        tuning.tune("flight", tmp_path, generations=3, **BUDGET)


@pytest.mark.parametrize(
    ("name", "value", "least"),
    [("generations", 0, 1), ("scenarios", 0, 1), ("workers", 0, 1), ("population", 1, 2), ("seed", -1, 0)],
)
def test_a_search_that_cannot_be_made_is_refused_before_it_flies(tmp_path, name, value, least):
    with pytest.raises(InvalidValueError, match=f"{name} = {value} .*at least {least}"):
        tuning.tune("flight", tmp_path, **({"generations": 1} | BUDGET | {name: value}))
    assert not list(tmp_path.iterdir())


def test_a_search_without_cma_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cma", None)
    with pytest.raises(MissingDependencyError, match=r"cma is not available; install it with: .*spidar-gym\[tune\]"):
        tuning.tune("flight", tmp_path, generations=1, **BUDGET)


def test_a_search_that_does_not_exist_is_refused_with_those_that_do(tmp_path):
    with pytest.raises(UnknownNameError, match="flight, retuned, steady, crawl, recrawl, steady_crawl"):
        tuning.tune("swim", tmp_path, generations=1, **BUDGET)


def test_tuned_is_what_the_committed_search_ended_with():
    log = json.loads((SEARCHED / "flight.json").read_text())["log"]
    assert SEARCHES["flight"].arguments(log[-1]["parameters"]) == {"controller": TUNED}
    gains = [line["reference"] - line["cost"] for line in log]
    assert np.exp(np.mean(gains[-20:])) > 1.5


def test_robust_overlapped_is_what_the_committed_search_ended_with():
    log = json.loads((SEARCHED / "crawl.json").read_text())["log"]
    assert SEARCHES["crawl"].arguments(log[-1]["parameters"]) == {"controller": ROBUST_OVERLAPPED}
    gains = [line["reference"] - line["cost"] for line in log]
    assert np.exp(np.mean(gains[-10:])) > 1.25


@pytest.mark.parametrize("name", RIVALS)
def test_a_rival_flies_with_what_its_committed_search_ended_with(name, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    module = importlib.import_module(f"baselines.{name}")
    log = json.loads((SEARCHED / f"{name}.json").read_text())["log"]
    assert log[-1]["parameters"] == module.FOUND
    assert log[-1]["shortfall"] == module.SEARCH.shortfall(module.FOUND) == 0.0
    own, found = getattr(module, RIVALS[name]).presets[HOVER], module.SEARCH.arguments(module.FOUND)
    assert own["controller"] == found["controller"]
    assert log[-1]["cost"] < log[0]["cost"]


def test_retuned_is_what_the_committed_search_came_to_rest_at():
    log = json.loads((SEARCHED / "retuned.json").read_text())["log"]
    assert SEARCHES["retuned"].arguments(log[-1]["parameters"]) == {"controller": RETUNED}
    assert log[-1]["sigma"] == 0.0
    assert np.exp(log[-1]["reference"] - log[-1]["cost"]) > 1.15


def test_steady_is_what_the_committed_search_ended_with_all_margins_held():
    log = json.loads((SEARCHED / "steady.json").read_text())["log"]
    assert SEARCHES["steady"].arguments(log[-1]["parameters"]) == {"controller": STEADY}
    assert log[-1]["shortfall"] == 0.0
    assert log[-1]["cost"] < log[0]["cost"]


def test_robust_retuned_is_what_the_committed_search_ended_with_higher_feet_and_less_torque():
    log = json.loads((SEARCHED / "recrawl.json").read_text())["log"]
    found = SEARCHES["recrawl"].arguments(log[-1]["parameters"])["controller"]
    own = ROBUST_RETUNED
    assert own.gait.raise_angle > found.gait.raise_angle
    assert own.gait.lift_height > found.gait.lift_height
    assert own.torque_limit < found.torque_limit
    lifted = replace(found.gait, raise_angle=own.gait.raise_angle, lift_height=own.gait.lift_height)
    assert replace(found, gait=lifted, torque_limit=own.torque_limit) == own
    assert np.exp(log[-1]["reference"] - log[-1]["cost"]) > 1.25
