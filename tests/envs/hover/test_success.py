"""Pins the ends of flights of Hover-v0: success, failure with its word, divergence."""

import math

import gymnasium
import numpy as np
import pytest
from support.episodes import HOVER, ROUGH, actions_of, assert_same, direct, flight, make, named
from support.page_robots import robots_with

from spidar_gym.control.flight.observation import layout
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.robot import FORMS
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.robots import HoverRobots


def test_the_paper_controller_alone_flies_the_papers_sequence_to_a_success_at_the_horizon_only():
    env = gymnasium.make(HOVER, forms="paper", horizon_s=12.5, max_episode_steps=500)
    env.reset(seed=0)
    success = []
    for _ in range(500):
        _, _, terminated, truncated, info = env.step(np.zeros(6))
        success.append(info["is_success"])
        assert not terminated
    assert truncated
    assert success == [False] * 499 + [True]


@pytest.mark.parametrize("horizon", [30, 60])
def test_a_success_must_fly_the_whole_horizon(horizon):
    env = gymnasium.make(HOVER, forms="form1", horizon_s=horizon / 40, max_episode_steps=horizon)
    env.reset(seed=0)
    for k in range(horizon):
        *_, truncated, info = env.step(np.zeros(6))
        assert truncated == info["is_success"] == (k == horizon - 1)


def test_a_horizon_too_short_for_a_second_form_has_none():
    where = [field.name for field in layout(6) for _ in range(field.size)].index("time_to_next_form")
    wait = {n: make(forms="equal", horizon_s=n / 40).reset(seed=0)[0][where] for n in (30, 800)}
    assert wait[30] == 60.0
    assert 1.0 <= wait[800] <= 2.525


def test_forms_reached_too_late_are_no_success_although_the_hover_is_good():
    slow = np.zeros(17, np.float32)
    slow[16] = -1.0
    results = {}
    for name, action in (("slow", slow), ("in time", np.zeros(17, np.float32))):
        env = gymnasium.make(
            HOVER, action_mode="residual_joint", forms="paper", joint_speed=0.8, horizon_s=6.0, max_episode_steps=240
        )
        env.reset(seed=0)
        infos = [env.step(action)[4] for _ in range(240)]
        for key in ("position_error", "attitude_error"):
            assert math.sqrt(np.mean([np.sum(info[key] ** 2) for info in infos])) < 0.05
        results[name] = infos[-1]["is_success"]
    assert results == {"slow": False, "in time": True}


@pytest.mark.parametrize(("position", "attitude", "success"), [
    (0.049, 0.049, True), (0.051, 0.0, False), (0.0, 0.051, False),
])  # fmt: skip
def test_a_success_needs_every_rms_error_below_5_cm_and_50_mrad_and_no_form_overdue(position, attitude, success):
    known = {"ticks": 10, "position_rms": position, "attitude_rms": attitude, "overdue": 0, "horizon": 10}
    assert HoverTask().succeeded(robots_with(HoverRobots, **known)).tolist() == [success]
    for other in ({"horizon": 11}, {"overdue": 1}):
        assert not HoverTask().succeeded(robots_with(HoverRobots, **known | other)).any()


@pytest.mark.parametrize("control", ["core", "python"])
def test_rms_errors_are_those_of_all_ticks_flown(control):
    env = make(forms="equal", control=control)
    steps = flight(env, actions_of(env, 60), seed=3)
    for name in ("position", "attitude"):
        squares = [float(np.square(info[f"{name}_error"]).sum()) for *_, info in steps[1:]]
        expected = math.sqrt(sum(squares) / len(squares))
        assert getattr(env.fleet.view, f"{name}_rms")[0] == pytest.approx(expected, rel=1e-12)


def test_a_form_is_reached_when_every_joint_is_within_50_mrad_at_most_half_a_second_after_its_deadline():
    env = make(horizon_s=4.0, preset="tuned")
    first, target = FORMS["form1"], FORMS["form1"] + 0.3 * np.eye(16)[5]

    def overdue(deadline):
        goals = [[0.0, 0.0, first.tolist()], [0.5, deadline, target.tolist()]]
        start = {"goals": goals, "position": [0.0] * 3, "rotation": [0.0] * 3}
        env.reset(seed=0, options={"start": start})
        arrived = math.inf
        for _ in range(160):
            env.step(np.zeros(6))
            if np.abs(env.state.joint_position - target).max() <= 0.05:
                arrived = min(arrived, env.progress.time)
        return arrived, env.fleet.view.overdue[0]

    arrival, late = overdue(2.0)
    assert (1.5 < arrival < 2.5, late) == (True, 0.0)
    assert overdue(arrival - 0.5 + 0.01)[1] == 0.0
    assert overdue(arrival - 0.5 - 0.035)[1] == 1.0


@pytest.mark.parametrize("control", ["core", "python"])
def test_a_flight_that_fails_at_its_last_tick_is_no_success(monkeypatch, control):
    def failed(_, robots):
        no = np.zeros(1, bool)
        return {"contact": no, "tilt": robots.ticks >= 30, "position": no}

    monkeypatch.setattr(HoverTask, "failed", failed)
    env = make(forms="form1", horizon_s=30 / 40, control=control)
    *_, (_, _, terminated, info) = flight(env, np.zeros((30, 6)), seed=0)
    assert terminated
    assert (info["failure"], info["is_success"]) == ("tilt", False)


@pytest.mark.parametrize(
    ("word", "thrust"),
    [("contact", 0.0), ("position", 42.0), ("tilt", [34.0] * 4 + [12.0] * 4)],
)  # fmt: skip
def test_a_flight_ends_with_the_word_for_what_went_wrong(word, thrust):
    env = make(action_mode="direct", forms="form1", perturbation=0.0)
    steps = flight(env, np.tile(direct(thrust), (200, 1)), seed=0)
    *before, (_, reward, terminated, info) = steps
    assert terminated
    assert info["failure"] == word
    assert not info["is_success"]
    assert 0.0 <= reward <= 1.0
    assert all(info["failure"] == "" for *_, info in before)
    tilt = math.acos(quat_to_matrix(env.state.quat_wb)[2, 2])
    assert (env.plant.in_contact, tilt > 1.0, np.linalg.norm(info["position_error"]) > 1.0) == (
        word == "contact", word == "tilt", word == "position"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("mode", "options"),
    [*((mode, {}) for mode in ACTION_MODES), ("residual", ROUGH), ("direct", ROUGH)],
    ids=named,
)
def test_a_diverged_state_ends_the_episode_finitely_and_does_not_affect_the_next(mode, options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    env = make(action_mode=mode, **options)
    actions = actions_of(env, 5)
    expected = flight(env, actions, seed=4)
    env.plant.data.qpos[:] = math.nan
    observation, reward, terminated, truncated, info = env.step(actions[0])
    assert (reward, terminated, truncated) == (0.0, True, False)
    assert (info["failure"], info["is_success"]) == ("diverged", False)
    assert observation in env.observation_space
    assert_same(flight(env, actions, seed=4), expected)


def test_a_divergence_leaves_no_file_behind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    env = make()
    env.reset(seed=0)
    env.plant.data.qpos[0] = math.nan
    assert env.step(np.zeros(6))[4]["failure"] == "diverged"
    assert list(tmp_path.iterdir()) == []
