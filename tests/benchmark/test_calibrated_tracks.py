"""Checks the calibrated tracks: kinds of robots in turn, settling time, second draw, one by one as in parallel."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.worlds import WORLD, pinned_world

from spidar_gym.benchmark import CRAWL, HOVER, TRACKS, PresetPolicy
from spidar_gym.benchmark.scenario import draw_scenario, load_scenarios, make_env, reset_options
from spidar_gym.benchmark.scoring import play_scenario, play_scenarios
from spidar_gym.benchmark.tally import Tally
from spidar_gym.benchmark.track import CALIBRATED, SECOND, SETTLE_S
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import SpidarError, UnknownNameError

NAMES = [name for name, track in TRACKS.items() if track.group in CALIBRATED.values()]


class Tuned(PresetPolicy):
    """The tuned controllers."""

    presets = {HOVER: {"preset": "tuned"}, CRAWL: {"preset": "overlapped"}}


@pytest.fixture(autouse=True)
def own_world(tmp_path, monkeypatch):
    """A world of the test in place of the committed one, and short episodes."""
    pinned_world(tmp_path, monkeypatch)
    for name in NAMES:
        monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=1.0, settle=0.5))


def test_scenarios_have_the_kinds_of_the_world_in_turn():
    track = TRACKS["flight-calibrated"]
    world = track.robots(0).world
    kinds = world.kinds
    assert [track.robots(k).name for k in range(50)] == [f"{WORLD}:{kinds[k % len(kinds)]}" for k in range(50)]
    assert Counter(world.pairs[track.robots(k).kind][1] for k in range(50)) == {"described": 25, "damped": 25}
    for k in range(5):
        scenario = draw_scenario("flight-calibrated", "test", k)
        env = make_env(track, scenario, {})
        env.reset(seed=scenario.seed, options=reset_options(scenario))
        assert int(env.sampled_parameters["kind"]) == k % len(kinds)
        assert (float(env.sampled_parameters["actuators.joint_kd"]) < 8.0) == (k % 2 == 1)


@pytest.mark.parametrize("name", NAMES)
def test_scenarios_give_the_same_bits_side_by_side_as_one_by_one(name):
    scenarios = [draw_scenario(name, "test", k) for k in range(6)]
    together = [result["metrics"] for result in play_scenarios(Tuned(), name, scenarios)]
    assert together == [play_scenario(Tuned(), name, one)["metrics"] for one in scenarios]
    assert len({str(metrics) for metrics in together}) == 6


def test_a_robot_of_another_kind_than_the_scenarios_is_refused():
    scenario = draw_scenario("flight-calibrated", "test", 2)
    for play in (play_scenario, lambda *words: play_scenarios(*words[:2], [words[2]] * 2)):
        with pytest.raises(SpidarError, match="the sampled robot is not the scenario's"):
            play(Tuned(), "flight-calibrated", replace(scenario, index=3))


def test_the_integrals_begin_at_zero_and_the_joint_speed_is_the_scenarios(monkeypatch):
    name = "flight-calibrated-fast"
    monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=30.0))
    scenario = draw_scenario("flight-calibrated-fast", "test", 0)
    assert "trim" not in scenario.start
    env = make_env(TRACKS["flight-calibrated-fast"], scenario, {"preset": "paper"})
    env.reset(seed=scenario.seed, options=reset_options(scenario))
    assert not env.controller.memory.integrals.position_w.any()
    assert 0.6 <= scenario.options["joint_speed"] == env.task.joint_speed <= 1.0
    first, later = scenario.start["goals"][:2]
    way = np.abs(np.subtract(later[2], first[2])).max()
    assert later[1] - later[0] == pytest.approx(way / scenario.options["joint_speed"], abs=1e-3)


def test_errors_before_the_settling_time_do_not_count(monkeypatch):
    assert TRACKS["ground-calibrated"].settle == 0.5, "of the fixture"
    scenario = draw_scenario("flight-calibrated", "test", 1)
    squares = []
    rms = Tally._rms
    monkeypatch.setattr(Tally, "_rms", lambda tally, which, robot: squares.append(tally) or rms(tally, which, robot))
    metrics = play_scenario(Tuned(), "flight-calibrated", scenario)["metrics"]
    rows = np.array([row[0][0] for row in squares[0]._squares])
    assert len(rows) == CONTROL_RATE
    assert metrics["position_rms_m"] == pytest.approx(np.sqrt(rows[round(0.5 * CONTROL_RATE) :].mean()), rel=1e-12)
    assert metrics["position_rms_m"] != pytest.approx(np.sqrt(rows.mean()), rel=1e-3)


def test_a_fall_before_the_settling_time_fails(monkeypatch):
    monkeypatch.setitem(TRACKS, "flight-calibrated", replace(TRACKS["flight-calibrated"], seconds=4.0, settle=3.0))

    class Falls(PresetPolicy):
        presets = {HOVER: {"action_mode": "direct"}}

    metrics = play_scenario(Falls(), "flight-calibrated", draw_scenario("flight-calibrated", "test", 0))["metrics"]
    assert metrics["failed"]
    assert metrics["duration_s"] < 3.0


def test_the_second_draw_has_other_scenarios_and_only_calibrated_tracks_have_it():
    for name in NAMES:
        drawn = [draw_scenario(name, split, 0) for split in TRACKS[name].splits]
        assert len({one.seed for one in drawn}) == 3
    for call in (lambda: draw_scenario("flight-fast5", SECOND, 0), lambda: load_scenarios("flight-fast5", SECOND)):
        with pytest.raises(UnknownNameError, match="test, validation"):
            call()
    assert SETTLE_S == 1.0
