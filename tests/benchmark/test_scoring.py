"""Pins an episode of the benchmark: repeatable, metrics computed by hand, no gain by failing or moving slowly."""

import json
import math
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from spidar_gym.benchmark import CRAWL, HOVER, TRACKS, PolicyError, PresetPolicy, load_scenarios
from spidar_gym.benchmark.metrics import told_in
from spidar_gym.benchmark.scenario import reset_options
from spidar_gym.benchmark.scoring import play_scenario
from spidar_gym.benchmark.track import CAP, flight_error, ground_error
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.native.library import STATUS
from spidar_gym.robot import ROBOT

FLIGHT_ONLY = ("position_rms_m", "late_forms")
GROUND_ONLY = ("final_error_m", "final_yaw_rad", "drift", "slip_m", "cost_of_transport")


class Paper(PresetPolicy):
    """The paper's controllers."""

    presets = {HOVER: {"preset": "paper"}, CRAWL: {"preset": "published"}}


class Residual(PresetPolicy):
    """Zero residuals on the paper's controllers, in the modes with the largest authority."""

    presets = {
        HOVER: {"preset": "paper", "action_mode": "residual"},
        CRAWL: {"preset": "published", "action_mode": "residual_gait"},
    }


class Slow(PresetPolicy):
    """Moves the joints at half the speed."""

    presets = {HOVER: {"preset": "paper", "action_mode": "residual_joint"}}

    def act(self, observation):
        return np.append(np.zeros(16), -1.0)


class Falls(PresetPolicy):
    """Turns all rotors off."""

    presets = {HOVER: {"action_mode": "direct"}, CRAWL: {"action_mode": "direct"}}

    def act(self, observation):
        return np.full(self._size, -1.0)


def shorten(monkeypatch, name="flight-fast5", seconds=1.5):
    monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=seconds))


@pytest.fixture
def short(monkeypatch):
    """A flight of a second and a half."""
    shorten(monkeypatch)


def scene(index=0, name="flight-fast5"):
    return load_scenarios(name)[0][index]


def metrics_of(policy, scenario=None, name="flight-fast5"):
    return play_scenario(policy, name, scenario or scene(0, name))["metrics"]


# The same twice


def test_an_episode_is_the_same_twice_whatever_was_played_in_between(short):
    policy = Paper()
    first = metrics_of(policy)
    metrics_of(Falls(), scene(1))
    metrics_of(policy, scene(2))
    assert metrics_of(policy) == first
    assert metrics_of(Paper()) == first
    assert metrics_of(policy, scene(1)) != first


@pytest.mark.parametrize("name", ["flight-randomised", "ground-directions"])
def test_a_randomised_robot_with_noisy_sensors_moves_identically_twice(name, monkeypatch):
    shorten(monkeypatch, name)
    assert metrics_of(Paper(), name=name) == metrics_of(Paper(), name=name)


@pytest.mark.parametrize("name", ["flight-fast5", "ground-paper"])
def test_adding_nothing_is_the_preset_to_the_bit(name, monkeypatch):
    shorten(monkeypatch, name)
    assert metrics_of(Residual(), name=name) == metrics_of(Paper(), name=name)


def test_the_policy_receives_the_number_of_the_run_and_a_copy_of_the_observation(short):
    seeds, policy = [], Paper()
    policy.reset = seeds.append

    def scribble(observation):
        observation[:] = np.nan
        return np.zeros(6)

    policy.act = scribble
    assert metrics_of(policy) == metrics_of(Paper())
    assert seeds == [0]


# The numbers


@pytest.mark.parametrize(("name", "missing"), [("flight-fast5", GROUND_ONLY), ("ground-paper", FLIGHT_ONLY)])
def test_the_metrics_are_those_of_the_table_and_json_and_none_only_where_they_mean_nothing(name, missing, monkeypatch):
    shorten(monkeypatch, name)
    result = play_scenario(Paper(), name, scene(0, name))
    assert set(result) == {"metrics", "timing"}
    names = list(told_in(TRACKS[name].world))
    assert list(result["metrics"]) == names
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    assert [key for key, value in result["metrics"].items() if value is None] == [k for k in names if k in missing]
    assert set(result["timing"]) == {"act_s", "step_s", "wall_s"}


def test_the_errors_of_a_flight_are_those_of_a_rollout_by_hand_after_the_first_second(monkeypatch):
    shorten(monkeypatch, seconds=4.0)
    scenario, track = scene(2), TRACKS["flight-fast5"]
    env = gymnasium.make(HOVER, **track.options, preset="paper", horizon_s=4.0).unwrapped
    env.reset(seed=scenario.seed, options=reset_options(scenario))
    position, attitude, joints, thrust = [], [], [], []
    for _ in range(160):
        info = env.step(np.zeros(6))[4]
        position.append(np.linalg.norm(info["position_error"]))
        attitude.append(np.linalg.norm(info["attitude_error"]))
        joints.append(env.progress.plan() - env.state.joint_position)
        thrust.append(info["thrust_command"].sum() / ROBOT.weight)
    metrics = metrics_of(Paper(), scenario)
    rms = [math.sqrt(np.mean(np.square(values[40:]))) for values in (position, attitude, joints)]
    names = ("position_rms_m", "attitude_rms_rad", "joint_rms_rad")
    assert [metrics[name] for name in names] == pytest.approx(rms, rel=1e-9)
    assert metrics["error"] == pytest.approx(0.5 * (rms[0] / 0.05 + rms[1] / 0.05), rel=1e-9)
    assert metrics["thrust_mean"] == pytest.approx(np.mean(thrust), rel=1e-9)
    assert metrics["energy_wh"] == info["energy_wh"]
    assert (metrics["duration_s"], metrics["failed"], metrics["success"]) == (4.0, False, info["is_success"])
    assert rms[0] > 0.0
    assert joints[0] == pytest.approx(0.0, abs=0.05)


def test_ticks_without_an_optimum_and_ticks_that_break_a_limit_are_counted(short, monkeypatch):
    step, ticks = Fleet.step, []

    def spoiled(fleet, ids=None):
        step(fleet, ids)
        ticks.append(1)
        info = fleet.infos["info"]
        if len(ticks) in (10, 11, 12, 13):
            info["qp_status_code"] = STATUS.index({10: "projected", 11: "softened"}.get(len(ticks), "held"))
        if len(ticks) in (20, 21):
            info["joint_torque_allocated"] = ROBOT.max_joint_torque + (0.1 if len(ticks) == 20 else 0.0)
        if len(ticks) == 30:
            info["joint_torque"][..., -1] = -5.0 * ROBOT.max_joint_torque

    clean = metrics_of(Paper())
    monkeypatch.setattr(Fleet, "step", spoiled)
    metrics = metrics_of(Paper())
    assert len(ticks) == 60
    assert (clean["unsolved"], clean["violations"]) == (0, 0.0)
    assert metrics["unsolved"] == 3
    assert metrics["violations"] == pytest.approx(1 / 60)
    assert clean["torque_share"] < 2.0 < metrics["torque_share"]


# Failures


def test_a_flight_that_ends_early_costs_the_cap():
    metrics = metrics_of(Falls())
    assert metrics["error"] == CAP
    assert (metrics["failed"], metrics["success"]) == (True, False)
    assert metrics["failure"] in ("contact", "tilt", "position")
    assert 0.0 < metrics["duration_s"] < TRACKS["flight-fast5"].seconds


def test_a_slow_policy_tracks_better_and_fails_for_being_late(monkeypatch):
    shorten(monkeypatch, seconds=4.5)
    slow, paper = metrics_of(Slow()), metrics_of(Paper())
    assert (paper["failed"], paper["late_forms"], paper["failure"]) == (False, 0, "")
    assert paper["error"] < CAP
    # The temptation: the slow policy has a smaller error than the punctual one.
    assert flight_error(slow["position_rms_m"], slow["attitude_rms_rad"], failed=False) < paper["error"]
    assert (slow["failed"], slow["late_forms"], slow["failure"]) == (True, 1, "late")
    assert (slow["error"], slow["success"]) == (CAP, False)
    assert slow["duration_s"] == 4.5


def test_a_form_that_cannot_be_reached_in_time_costs_the_cap(monkeypatch):
    shorten(monkeypatch, seconds=3.0)
    scenario = scene()
    goals = [[start, start, q] for start, _, q in scenario.start["goals"]]
    late = metrics_of(Paper(), replace(scenario, start={**scenario.start, "goals": goals}))
    assert (late["failed"], late["failure"], late["late_forms"], late["error"]) == (True, "late", 1, CAP)
    assert not metrics_of(Paper(), scenario)["failed"]


def test_a_form_that_is_not_due_yet_is_not_late(monkeypatch):
    scenario = scene()
    (_, deadline, _) = scenario.start["goals"][1]
    shorten(monkeypatch, seconds=math.floor((deadline + 0.5) * 40.0) / 40.0)
    assert metrics_of(Slow(), scenario)["late_forms"] == 0


def test_a_diverged_simulation_is_a_failure_without_a_nan(short, monkeypatch):
    step, ticks = HoverEnv.step, []

    def explode(env, action):
        ticks.append(1)
        if len(ticks) == 50:
            env.plant.data.qvel[:] = np.nan
        return step(env, action)

    monkeypatch.setattr(HoverEnv, "step", explode)
    metrics = metrics_of(Paper())
    assert len(ticks) == 50
    assert (metrics["failure"], metrics["failed"], metrics["error"]) == ("diverged", True, CAP)
    json.dumps(metrics, allow_nan=False)
    assert metrics["position_rms_m"] < 0.5


def test_a_crawl_that_is_not_finished_in_time_costs_the_cap(monkeypatch):
    shorten(monkeypatch, "ground-paper")
    metrics = metrics_of(Paper(), name="ground-paper")
    assert (metrics["error"], metrics["failed"], metrics["success"]) == (CAP, True, False)
    assert metrics["failure"]
    assert metrics["duration_s"] == 1.5
    assert metrics["drift"] == pytest.approx(1.0, abs=0.05)


def test_a_crawl_ends_a_second_after_it_is_finished_and_its_error_is_by_hand():
    # A short distance with fast joints.
    track, scenario = "ground-paper", scene(0, "ground-paper")
    scenario = replace(scenario, options={"distance": 0.1, "direction": 1.0, "turn": 0.1, "joint_speed": 0.6})
    policy, answers = Paper(), []
    policy.act = lambda observation: answers.append(1) or np.zeros(policy._size)
    metrics = metrics_of(policy, scenario, track)
    assert (metrics["failed"], metrics["failure"], metrics["success"]) == (False, "", True)
    # The tick in which the crawl finishes is the first tick of the final second.
    assert len(answers) == round(metrics["duration_s"] * 40.0) + 39
    assert metrics["duration_s"] < TRACKS[track].seconds - 1.0
    rest = metrics["final_error_m"] + 0.5 * metrics["final_yaw_rad"]
    assert metrics["error"] == pytest.approx(
        ground_error(rest, metrics["energy_wh"] / (rest / metrics["drift"]), failed=False), rel=1e-9
    )
    assert rest / metrics["drift"] == pytest.approx(0.1 + 0.5 * 0.1, abs=0.02)


# Refusals


def test_a_policy_plays_only_where_it_is_defined():
    class Hovers(PresetPolicy):
        presets = {HOVER: {}}

    with pytest.raises(InvalidValueError, match="ground-paper"):
        metrics_of(Hovers(), name="ground-paper")
    with pytest.raises(UnknownNameError, match="flight-paper"):
        play_scenario(Paper(), "flight", scene())


def test_an_action_that_is_none_ends_the_evaluation_and_says_where(short):
    policy, ticks = Paper(), []
    policy.act = lambda observation: ticks.append(1) or np.full(6, np.nan if len(ticks) == 4 else 0.0)
    with pytest.raises(PolicyError, match="policy paper on flight-fast5, scenario 7, tick 3: gave NaN"):
        metrics_of(policy, scene(7))


def test_another_robot_than_the_scenarios_is_refused(monkeypatch):
    shorten(monkeypatch, "flight-randomised")
    scenario = scene(0, "flight-randomised")
    with pytest.raises(SpidarError, match="flight-randomised, scenario 0: the sampled robot"):
        metrics_of(Paper(), replace(scenario, seed=scenario.seed + 1), "flight-randomised")
