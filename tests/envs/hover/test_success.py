"""Pins how flights of Hover-v0 end: success, failure with its word, divergence."""

import math

import gymnasium
import numpy as np
import pytest
from support.episodes import HOVER, ROUGH, actions_of, assert_same, direct, flight, make, named

from spidar_gym.control.flight.observation import layout
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.envs.progress import FlightProgress
from spidar_gym.robot import FORMS
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import FormGoal


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


@pytest.mark.parametrize("axis", range(6))
def test_a_success_needs_every_error_below_5_cm_and_50_mrad_rms(axis):
    unit = np.eye(6)[axis]
    cases = (([0.049] * 10, True), ([0.051] * 10, False), ([0.0, 0.06] * 5, True), ([0.0] * 9 + [1.0], False))
    for errors, success in cases:
        progress = FlightProgress([FormGoal(0.0, 0.0, FORMS["form1"])])
        for error in errors:
            assert not progress.succeeded(10)
            progress.ticks += 1
            progress.advance(error * unit[:3], -error * unit[3:], FORMS["form1"])
        assert progress.succeeded(10) == success
        assert not progress.succeeded(11)


@pytest.mark.parametrize(
    ("late", "off", "success"), [(0, 0.04, True), (19, 0.04, True), (21, 0.04, False), (0, 0.06, False)]
)
def test_a_form_is_reached_when_every_joint_is_within_50_mrad_half_a_second_after_its_deadline(late, off, success):
    target = np.zeros(16)
    progress = FlightProgress([FormGoal(0.0, 0.0, np.ones(16)), FormGoal(0.5, 1.0, target)])
    for tick in range(1, 101):
        joints = target + (off if tick == 40 + late else 0.3) * np.eye(16)[7]
        progress.ticks += 1
        progress.advance(np.zeros(3), np.zeros(3), joints)
    assert progress.succeeded(100) == success


def test_a_flight_that_fails_at_its_last_tick_is_no_success(monkeypatch):
    words = iter([""] * 29 + ["tilt"])
    monkeypatch.setattr(HoverTask, "failed", lambda *_: next(words))
    env = make(forms="form1", horizon_s=30 / 40, control="python")
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
def test_a_diverged_state_ends_the_episode_finitely_and_the_next_one_is_as_if_nothing_had_been(
    mode, options, tmp_path, monkeypatch
):
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
