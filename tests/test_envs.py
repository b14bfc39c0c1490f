"""Pins the environments: the interface's contracts, determinism, reward, success, failure, refusals."""

import copy
import json
import math
import pickle
import shutil
from dataclasses import fields, replace
from functools import cache
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import spidar_gym
from spidar_gym import description
from spidar_gym.control.centroidal import CentroidalConfig
from spidar_gym.control.controller import Controller, ControllerConfig
from spidar_gym.control.observation import layout
from spidar_gym.control.presets import PRESETS, controller_config
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.envs.hover_task import FAILURES, REWARD_TERMS, SEQUENCES, FormGoal, HoverTask, Progress, hover_height
from spidar_gym.envs.page import CHAPTERS
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, SpidarError, StaleAssetError, UnknownNameError
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim import plant
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.aero import AeroConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.plant import Plant
from spidar_gym.sim.randomize import TABLE
from spidar_gym.sim.sensors import SensorConfig
from spidar_gym.so3 import quat_to_matrix

HOVER = "spidar_gym/Hover-v0"
HOVERS = [(HOVER, mode) for mode in ACTION_MODES]
EVERY = [(name, mode) for name in ENVIRONMENTS for mode in CHAPTERS[name].modes]
RESIDUAL_MODES = [name for name, mode in ACTION_MODES.items() if mode.residual is not None]
EARLY = 35
"""A seed whose independent legs start to move after 1.05 s already."""
CONSTANT = {
    # An outer rotor hangs below the inner one of its leg in every form that is flown, so it is never the upper one.
    **{mode: {("restricted_rotors", i) for i in (1, 3, 5, 7)} for mode in RESIDUAL_MODES},
    # No controller runs: there is nobody who restricts rotors or integrates errors.
    "direct": {("restricted_rotors", i) for i in range(8)}
    | {(f"{what}_integral", i) for what in ("position", "attitude") for i in range(3)},
}
"""Elements of the observation that never change in the rollouts below, and why."""
PUSHED = 147
"""A seed whose first push comes within a quarter of a second."""
ROUGH = {"sensors": True, "randomization": 1.0, "battery": True, "disturbances": {"wind": 2.0, "push": 30.0}}
CONDITIONS = {
    "sensors": {"sensors": True},
    "randomization": {"randomization": 1.0},
    "wind": {"disturbances": {"wind": 2.0}},
    "push": {"disturbances": {"push": 30.0}},
    "lost rotor": {"disturbances": {"lost_rotor": 4, "fault_time": 0.3}},
    "stuck rotor": {"disturbances": {"lost_rotor": 4, "fault": "vectoring", "fault_time": 0.3}},
    "no wake": {"wake": False},
    "all at once": {**ROUGH, "disturbances": {**ROUGH["disturbances"], "lost_rotor": 4, "fault_time": 0.3}},
}
"""What can be switched on or off, by name."""
USABLE_WH = 0.85 * 8 * 22.2 * 3.0
"""Energy that is flown of eight packs of 22.2 V and 3 Ah [Wh]."""


def named(value) -> str:
    """Name of a parameter of a test."""
    return value if isinstance(value, str) else "rough" if value is ROUGH else "-".join(value) or "plain"


def make(name: str = HOVER, **options):
    """The environment without wrappers."""
    return gymnasium.make(name, **options).unwrapped


def actions_of(env, n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (n, *env.action_space.shape)).astype(np.float32)


def flight(env, actions, seed=None, options=None) -> list[tuple]:
    """(observation, reward, terminated, info) of the reset and of every step until the end."""
    observation, info = env.reset(seed=seed, options=options)
    steps = [(observation, None, False, info)]
    for action in actions:
        observation, reward, terminated, _, info = env.step(action)
        steps.append((observation, reward, terminated, info))
        if terminated:
            break
    return steps


def same(a, b) -> bool:
    """Whether two entries of an info or two saved moments are equal bit for bit, whatever they hold."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, np.random.Generator):
        return a.bit_generator.state == b.bit_generator.state
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return np.array_equal(a, b)


def arrays_in(*values) -> list[np.ndarray]:
    """The arrays among the values and in the dictionaries among them."""
    arrays = []
    for value in values:
        arrays += arrays_in(*value.values()) if isinstance(value, dict) else [value]
    return [array for array in arrays if isinstance(array, np.ndarray)]


def kind_of(value):
    """Type, shape and kind of number of an entry of an info."""
    if isinstance(value, dict):
        return {key: kind_of(entry) for key, entry in value.items()}
    return type(value), np.shape(value), np.asarray(value).dtype.kind


def assert_same(a, b):
    """Two flights are equal bit for bit, infos included."""
    assert len(a) == len(b)
    for (o1, r1, t1, i1), (o2, r2, t2, i2) in zip(a, b, strict=True):
        assert np.array_equal(o1, o2)
        assert (r1, t1) == (r2, t2)
        assert i1.keys() == i2.keys()
        for key in i1:
            assert same(i1[key], i2[key]), key


@cache
def rollouts(name, mode) -> list[list[tuple]]:
    """Flights of random actions in every form sequence, one of them far enough to move on to the next form."""
    env = make(name, action_mode=mode, joint_speed=1.0)
    return [
        flight(env, actions_of(env, 60 if forms == "independent" else 25, seed), EARLY, {"forms": forms})
        for seed, forms in enumerate(SEQUENCES)
    ]


@pytest.mark.parametrize(("name", "mode"), EVERY)
def test_gymnasiums_checker_finds_nothing_to_warn_of(name, mode):
    check_env(make(name, action_mode=mode), skip_render_check=True)


@pytest.mark.train
@pytest.mark.parametrize(("name", "mode"), EVERY)
def test_the_checker_of_stable_baselines_finds_nothing_to_warn_of(name, mode):
    from stable_baselines3.common.env_checker import check_env

    check_env(make(name, action_mode=mode), warn=True, skip_render_check=True)


@pytest.mark.parametrize(("name", "mode"), EVERY)
def test_the_same_seed_gives_the_same_flight_after_other_episodes_and_in_another_instance(name, mode):
    env = make(name, action_mode=mode, joint_speed=1.0)
    actions = actions_of(env, 20)
    first = flight(env, actions, seed=5)
    other = flight(env, actions_of(env, 10, seed=1), seed=6)
    assert not np.array_equal(first[0][0], other[0][0])
    assert_same(first, flight(env, actions, seed=5))
    assert_same(first, flight(make(name, action_mode=mode, joint_speed=1.0), actions, seed=5))


def test_episodes_that_follow_a_seeded_one_differ_from_it_and_follow_from_the_seed():
    first, second = make(), make()
    a = [flight(first, np.zeros((2, 6)), seed) for seed in (5, None, None)]
    assert_same(a[1], [flight(second, np.zeros((2, 6)), seed) for seed in (5, None)][1])
    assert not np.array_equal(a[0][0][0], a[1][0][0])
    assert not np.array_equal(a[1][0][0], a[2][0][0])


def assert_nothing_shared(steps):
    """No step's observation or info shares memory with those of the next."""
    arrays = [arrays_in(observation, info) for observation, _, _, info in steps]
    for before, after in pairwise(arrays):
        assert not any(np.shares_memory(a, b) for a in before for b in after)


@pytest.mark.parametrize(("name", "mode"), HOVERS)
def test_no_observation_or_info_shares_memory_with_another_step(name, mode):
    assert_nothing_shared(rollouts(name, mode)[-1][:20])


def test_no_draw_of_the_randomisation_shares_memory_with_another_step():
    env = make(**ROUGH)
    steps = flight(env, np.zeros((4, 6)), seed=0)
    assert len(arrays_in(steps[0][3]["randomization"])) == len(TABLE)
    assert_nothing_shared(steps)


@pytest.mark.parametrize(
    ("name", "mode", "options"), [*((name, mode, {}) for name, mode in EVERY), (HOVER, "residual", ROUGH)], ids=named
)
def test_writing_into_what_was_handed_out_changes_nothing_that_follows(name, mode, options):
    env = make(name, action_mode=mode, joint_speed=1.0, **options)
    actions = actions_of(env, 10)
    expected = flight(env, actions, seed=3)
    observation, info = env.reset(seed=3)
    for action, step in zip(actions, expected[1:], strict=False):
        for array in arrays_in(observation, info):
            array[...] = 1
        observation, reward, terminated, _, info = env.step(action)
        assert_same([(observation, reward, terminated, info)], [step])


@pytest.mark.parametrize(("name", "mode"), HOVERS)
def test_random_flights_stay_within_the_declared_observations(name, mode):
    space = make(name, action_mode=mode).observation_space
    for steps in rollouts(name, mode):
        assert all(observation in space for observation, *_ in steps)


@pytest.mark.parametrize(("name", "mode"), HOVERS)
def test_reward_and_terms_lie_within_0_and_1_and_the_weighted_terms_are_the_reward(name, mode):
    seen = set()
    for steps in rollouts(name, mode):
        for _, reward, _, info in steps[1:]:
            terms = {key: value for key, value in info.items() if key.startswith("reward_")}
            assert set(terms) == {f"reward_{term}" for term in REWARD_TERMS}
            assert all(0.0 <= value <= 1.0 for value in (reward, *terms.values()))
            assert abs(reward - sum(weight * info[f"reward_{t}"] for t, (weight, _) in REWARD_TERMS.items())) < 1e-12
            seen.add(reward)
    assert len(seen) > 60
    assert abs(sum(weight for weight, _ in REWARD_TERMS.values()) - 1.0) < 1e-12


@pytest.mark.parametrize(("name", "mode"), HOVERS)
def test_every_observation_element_changes_except_those_listed_with_a_reason(name, mode):
    observations = np.array([observation for steps in rollouts(name, mode) for observation, *_ in steps])
    env = make(name, action_mode=mode)
    names = [(field.name, i) for field in layout(env.action_space.shape[0]) for i in range(field.size)]
    still = {names[k] for k in np.flatnonzero(np.ptp(observations, axis=0) < 1e-6)}
    assert still == CONSTANT[mode]


@pytest.mark.parametrize(("name", "mode"), HOVERS)
def test_infos_have_the_same_keys_and_shapes_at_reset_at_every_step_and_when_diverged(
    name, mode, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs a divergence in the working folder
    env = make(name, action_mode=mode)
    infos = [info for *_, info in flight(env, actions_of(env, 5), seed=0)]
    env.plant.data.qpos[0] = math.nan
    infos.append(env.step(env.action_space.sample())[4])
    assert infos[-1]["failure"] == "diverged"
    kinds = [kind_of(info) for info in infos]
    assert all(kind == kinds[0] for kind in kinds)
    assert kinds[0].pop("randomization") == {}
    assert {key: shape for key, (_, shape, _) in kinds[0].items()} == {
        **dict.fromkeys(("position_error", "attitude_error", "air_force"), (3,)),
        **dict.fromkeys(("thrust_command", "thrust", "restricted_rotors", "thrust_factor"), (8,)),
        **dict.fromkeys(("vectoring_command", "vectoring"), (8, 2)),
        **dict.fromkeys(("joint_torque_allocated", "joint_torque"), (16,)),
        **dict.fromkeys(("wrench_desired", "wrench_allocated"), (6,)),
        **dict.fromkeys(("total_thrust", "qp_status", "qp_iterations", "qp_slack", "is_success", "failure"), ()),
        **dict.fromkeys(("power_w", "energy_wh", "endurance_min"), ()),
        **dict.fromkeys([f"reward_{term}" for term in REWARD_TERMS], ()),
    }


@pytest.mark.parametrize(
    ("mode", "preset", "options"),
    [
        *((mode, "paper", {}) for mode in RESIDUAL_MODES),
        *(("residual_wrench", preset, {}) for preset in PRESETS if preset != "paper"),
        ("residual_wrench", "paper", {"wake": False}),
    ],
    ids=named,
)
def test_the_zero_action_is_bit_for_bit_the_controller_alone(mode, preset, options):
    env = make(action_mode=mode, preset=preset, forms="independent", **options)
    env.reset(seed=EARLY)
    start, q = env.state, env.reference().joint_target
    controller, bare = Controller(controller_config(preset)), Plant(PlantConfig(aero=AeroConfig(**options)))
    state = bare.reset(start.position_w, start.quat_wb, start.joint_position, start.vectoring, start.thrust)
    controller.reset(state, q)
    for _ in range(60):
        state = bare.step(controller.step(state, env.reference()))
        env.step(np.zeros(env.action_space.shape))
        assert np.array_equal(env.plant.data.qpos, bare.data.qpos)
        assert np.array_equal(env.plant.data.qvel, bare.data.qvel)
    assert not np.array_equal(env.reference().joint_target, q)


@pytest.mark.parametrize("options", [{}, {"sensors": True}, ROUGH], ids=["plain", "sensors", "rough"])
def test_errors_in_info_are_of_the_true_cog_and_attitude(options):
    env = make(forms="equal", perturbation=2.0, **options)
    info = flight(env, np.zeros((3, 6)), seed=1)[-1][-1]
    state = env.state
    R_wb = quat_to_matrix(state.quat_wb)
    com_w = state.position_w + R_wb @ Model().snapshot(state.joint_position, R_wb, state.vectoring).com_b
    np.testing.assert_allclose(info["position_error"], [0, 0, hover_height()] - com_w, rtol=0, atol=1e-12)
    angle = np.linalg.norm(info["attitude_error"])
    assert abs(math.cos(angle) - 0.5 * (np.trace(R_wb) - 1.0)) < 1e-9
    # A rotation by the error brings the torso to the level: the axis stays where it is.
    np.testing.assert_allclose(R_wb @ info["attitude_error"], info["attitude_error"], rtol=0, atol=1e-12)
    x, y, z = info["attitude_error"] / angle
    assert np.dot((R_wb[2, 1] - R_wb[1, 2], R_wb[0, 2] - R_wb[2, 0], R_wb[1, 0] - R_wb[0, 1]), (x, y, z)) < 0.0


def test_info_reports_commands_and_what_came_of_them():
    env = make(forms="form1")
    _, (*_, info) = flight(env, np.ones((1, 6)), seed=0)
    state, tick = env.state, env.controller.tick
    assert np.array_equal(info["thrust"], state.thrust)
    assert np.array_equal(info["joint_torque"], state.joint_torque)
    assert np.array_equal(info["vectoring"], state.vectoring)
    assert abs(info["total_thrust"] - state.thrust.sum()) < 1e-12
    assert np.array_equal(info["joint_torque_allocated"], tick.allocation.joint_torques)
    lag = math.exp(-env.plant.period / ROBOT.thrust_lag)
    expected = info["thrust_command"] + lag * (ROBOT.hover_thrust - info["thrust_command"])
    np.testing.assert_allclose(info["thrust"], expected, rtol=1e-9)
    plain = flight(make(forms="form1"), np.zeros((1, 6)), seed=0)[1][3]
    added = info["wrench_desired"] - plain["wrench_desired"]
    np.testing.assert_allclose(added, [0.15 * ROBOT.weight] * 3 + [8.0] * 3, rtol=1e-9)
    if info["qp_status"] in ("closed_form", "solved"):
        np.testing.assert_allclose(info["wrench_allocated"], info["wrench_desired"], rtol=0, atol=0.01)


def test_an_action_beyond_the_space_is_clipped():
    beyond, edge = (flight(make(), np.full((3, 6), a), seed=0) for a in (7.0, 1.0))
    assert_same(beyond, edge)


def test_the_feet_of_form_3_hover_half_a_metre_above_the_floor():
    env = make(forms="form3", perturbation=0.0)
    env.reset(seed=0)
    feet = [env.plant.data.site(f"foot{leg}").xpos[2] - ROBOT.foot_radius for leg in range(1, 5)]
    np.testing.assert_allclose(feet, 0.5, rtol=0, atol=1e-3)


def test_the_schedule_moves_at_the_joint_speed_and_its_first_goal_is_the_start():
    for forms in SEQUENCES:
        for speed in (0.2, 0.7):
            goals = HoverTask(forms=forms, joint_speed=speed).schedule(np.random.default_rng(3))
            assert (goals[0].start, goals[0].deadline) == (0.0, 0.0)
            for before, after in pairwise(goals):
                assert after.start >= before.deadline - 1e-9
                fastest = np.abs(after.joint_target - before.joint_target).max() / (after.deadline - after.start)
                assert abs(fastest - speed) < 1e-9
            assert len(goals) == 1 if forms in FORMS else len(goals) >= 3


def test_the_papers_sequence_leaves_form_1_at_4_seconds_and_passes_form_2_without_a_stop():
    goals = HoverTask(forms="paper", horizon_s=40.0).schedule(np.random.default_rng(0))
    for goal, form in zip(goals, ("form1", "form2", "form3"), strict=True):
        assert np.array_equal(goal.joint_target, FORMS[form])
    assert goals[1].start == 4.0
    assert 0.0 <= goals[2].start - goals[1].deadline <= 0.025
    assert abs(goals[2].deadline - 11.85) < 0.1


def test_legs_are_alike_in_equal_forms_and_move_for_themselves_with_yaw_in_independent_ones():
    rng = np.random.default_rng(0)
    for forms, spread in (("equal", False), ("independent", True)):
        goals = HoverTask(forms=forms, horizon_s=60.0).schedule(rng)
        legs = np.array([goal.joint_target.reshape(4, 4) for goal in goals])
        assert (np.ptp(legs, axis=1).max() > 0.1) == spread
        assert np.ptp(legs[:, :, (0, 2)]) > 0.5


def test_the_initial_offset_grows_with_the_perturbation_and_is_none_at_zero():
    for scale in (0.0, 1.0, 3.0):
        env, offsets = make(forms="form1", perturbation=scale), []
        for seed in range(20):
            info = env.reset(seed=seed)[1]
            offsets.append(np.abs(np.concatenate([info["position_error"], info["attitude_error"]])))
            assert not env.state.velocity_w.any()
            assert not env.state.omega_b.any()
        most = np.max(offsets, axis=0)
        assert np.all(most <= scale * np.array([0.03] * 3 + [0.051] * 3) + 1e-12)
        assert np.all(most >= 0.5 * scale * np.array([0.03] * 3 + [0.05] * 3))


# Success and failure


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
        progress = Progress([FormGoal(0.0, 0.0, FORMS["form1"])])
        for error in errors:
            assert not progress.succeeded(10)
            progress.advance(error * unit[:3], -error * unit[3:], FORMS["form1"])
        assert progress.succeeded(10) == success
        assert not progress.succeeded(11)


@pytest.mark.parametrize(
    ("late", "off", "success"), [(0, 0.04, True), (19, 0.04, True), (21, 0.04, False), (0, 0.06, False)]
)
def test_a_form_is_reached_when_every_joint_is_within_50_mrad_half_a_second_after_its_deadline(late, off, success):
    target = np.zeros(16)
    progress = Progress([FormGoal(0.0, 0.0, np.ones(16)), FormGoal(0.5, 1.0, target)])
    for tick in range(1, 101):
        joints = target + (off if tick == 40 + late else 0.3) * np.eye(16)[7]
        progress.advance(np.zeros(3), np.zeros(3), joints)
    assert progress.succeeded(100) == success


def test_a_flight_that_fails_at_its_last_tick_is_no_success(monkeypatch):
    words = iter([""] * 29 + ["tilt"])
    monkeypatch.setattr(HoverTask, "failed", lambda *_: next(words))
    env = make(forms="form1", horizon_s=30 / 40)
    *_, (_, _, terminated, info) = flight(env, np.zeros((30, 6)), seed=0)
    assert terminated
    assert (info["failure"], info["is_success"]) == ("tilt", False)


def direct(thrust) -> np.ndarray:
    """An action of `direct`: thrusts [N] with rotors upright in form ①."""
    action = np.zeros(40)
    action[:8] = np.asarray(thrust) / 21.0 - 1.0
    return action


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


@pytest.mark.parametrize(("forms", "speed", "ticks"), [("form2", 0.2, 240), ("paper", 0.8, 260)])
def test_no_locked_phi_turns_by_more_than_the_slew_while_the_errors_stay_small(forms, speed, ticks):
    env = make(forms=forms, joint_speed=speed, perturbation=0.0)
    env.reset(seed=0)
    before, locked = env.controller.memory.vectoring[:, 0], np.zeros(8, bool)
    for _ in range(ticks):
        *_, info = env.step(np.zeros(6))
        memory = env.controller.memory
        step = np.abs(memory.vectoring[:, 0] - before)
        assert step[memory.lock.active].max(initial=0.0) <= 0.04 + 1e-12
        before, locked = memory.vectoring[:, 0], locked | memory.lock.active
        assert np.linalg.norm(info["position_error"]) < 0.05
        assert np.linalg.norm(info["attitude_error"]) < 0.05
    assert locked[1::2].all()


# Air, sensors, other robots, disturbances


@pytest.mark.parametrize("condition", CONDITIONS)
def test_in_every_condition_the_same_seed_gives_the_same_flight_after_other_episodes_and_in_another_instance(condition):
    env = make(joint_speed=1.0, **CONDITIONS[condition])
    actions = actions_of(env, 20)
    first = flight(env, actions, seed=PUSHED)
    other = flight(env, actions, seed=EARLY)
    assert not np.array_equal(first[-1][0], other[-1][0])
    assert_same(first, flight(env, actions, seed=PUSHED))
    assert_same(first, flight(make(joint_speed=1.0, **CONDITIONS[condition]), actions, seed=PUSHED))


@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_makes_a_difference_to_the_flight_but_not_to_where_it_starts_and_goes(condition):
    plain, other = make(), make(**CONDITIONS[condition])
    actions = np.zeros((20, 6))
    a, b = flight(plain, actions, seed=PUSHED), flight(other, actions, seed=PUSHED)
    assert not np.array_equal(a[-1][3]["position_error"], b[-1][3]["position_error"])
    if condition not in ("randomization", "all at once"):  # these draw from the generator first, but after the forms
        assert np.array_equal(a[0][3]["position_error"], b[0][3]["position_error"])
    for first, second in zip(plain.progress.goals, other.progress.goals, strict=True):
        assert (first.start, first.deadline) == (second.start, second.deadline)
        assert np.array_equal(first.joint_target, second.joint_target)


@pytest.mark.parametrize("condition", ["sensors", "wind", "push", "lost rotor"])
def test_what_the_weather_and_the_sensors_draw_changes_no_later_episode(condition):
    plain, other = make(), make(**CONDITIONS[condition])
    for env, ticks in ((plain, 3), (other, 20)):
        flight(env, np.zeros((ticks, 6)), seed=PUSHED)
    starts = [env.reset()[1]["position_error"] for env in (plain, other)]
    assert np.array_equal(*starts)


def test_disturbances_of_a_reset_last_until_the_next_ones_and_leave_nothing_behind():
    env, actions = make(), np.zeros((20, 6))
    calm, storm = flight(env, actions, seed=1), {"wind": 3.0, "lost_rotor": 2, "fault_time": 0.1}
    stormy = flight(env, actions, seed=1, options={"disturbances": storm})
    assert_same(stormy, flight(make(disturbances=storm), actions, seed=1))
    assert_same(stormy, flight(env, actions, seed=1))
    assert_same(calm, flight(env, actions, seed=1, options={"disturbances": {}}))
    assert_same(calm, flight(env, actions, seed=1))
    assert not np.array_equal(calm[-1][0], stormy[-1][0])


def test_gymnasiums_checker_finds_nothing_to_warn_of_in_the_roughest_conditions():
    check_env(make(**ROUGH), skip_render_check=True)


def test_observations_stay_within_their_bounds_in_the_roughest_conditions():
    env = make(**CONDITIONS["all at once"], joint_speed=1.0)
    for seed in range(3):
        steps = flight(env, actions_of(env, 40, seed), seed)
        assert all(observation in env.observation_space for observation, *_ in steps)


def test_there_is_air_by_default_and_none_where_it_is_switched_off():
    still = PlantConfig(aero=AeroConfig(wake=False))
    for options, airy in (({}, True), ({"wake": False}, False), ({"plant": still}, False)):
        info = flight(make(forms="form3", **options), np.zeros((5, 6)), seed=0)[-1][3]
        assert info["air_force"].any() == airy
        assert (info["thrust_factor"] != 1.0).any() == airy
        assert np.abs(info["thrust_factor"] - 1.0).max() < 0.1


def seen_and_true_errors(**options) -> np.ndarray:
    """Position errors in torso axes over a second, the policy's and the true ones, (2, 41, 3)."""
    env, rows = make(forms="form1", perturbation=0.0, **options), []
    observation, info = env.reset(seed=0)
    for k in range(41):
        rows.append((observation[:3], quat_to_matrix(env.state.quat_wb).T @ info["position_error"]))
        if k < 40:
            observation, _, _, _, info = env.step(np.zeros(6))
    return np.array(rows).swapaxes(0, 1)


def test_with_sensors_the_observation_is_off_the_truth_by_their_noise_and_without_them_by_nothing():
    seen, true = seen_and_true_errors(sensors=True)
    off = np.sqrt(((seen - true) ** 2).mean())
    assert 2e-4 < off < 5e-3
    # A motion capture's millimetre is not in the true error, which starts at none.
    assert np.linalg.norm(true[0]) < 1e-5
    assert np.linalg.norm(seen[0]) > 2e-4
    seen, true = seen_and_true_errors()
    np.testing.assert_allclose(seen, true, rtol=0, atol=1e-6)


def test_errors_in_info_are_as_smooth_as_the_flight_while_the_observed_ones_are_not():
    seen, true = seen_and_true_errors(sensors=True)
    rough, smooth = (np.abs(np.diff(values, n=2, axis=0)).max() for values in (seen, true))
    # 2 m/s² of acceleration are 1.25 mm in the square of a tick.
    assert smooth < 1.25e-3
    assert rough > 2.0 * smooth


def test_the_controller_flies_on_what_is_observed_and_not_on_the_truth():
    env = make(forms="form1", perturbation=0.0, sensors=True)
    observation, _ = env.reset(seed=0)
    for _ in range(5):
        following, *_ = env.step(np.zeros(6))
        used = env.controller.tick.percept
        np.testing.assert_allclose(used.R_wb.T @ used.error.position_w, observation[:3], rtol=0, atol=1e-6)
        observation = following


def test_energy_is_the_sum_of_the_power_and_starts_anew_with_every_episode():
    env = make(forms="independent", joint_speed=1.0)
    for seed in (EARLY, None):
        steps = flight(env, actions_of(env, 40), seed)
        power = np.array([info["power_w"] for *_, info in steps])
        energy = np.array([info["energy_wh"] for *_, info in steps])
        assert energy[0] == 0.0
        np.testing.assert_allclose(np.diff(energy), power[1:] * 0.025 / 3600.0, rtol=1e-9)
        assert np.ptp(power) > 10.0
        for k in (1, 40):
            minutes = 60.0 * USABLE_WH / power[1 : k + 1].mean()
            np.testing.assert_allclose(steps[k][3]["endurance_min"], minutes, rtol=1e-9)
        np.testing.assert_allclose(steps[0][3]["endurance_min"], 60.0 * USABLE_WH / power[0], rtol=1e-9)


def test_a_full_battery_gives_less_thrust_at_full_load_than_the_modules_can():
    ideal, real = (
        flight(make(action_mode="direct", forms="form1", perturbation=0.0, battery=battery), [direct(42.0)] * 6, seed=0)
        for battery in (False, True)
    )
    assert ideal[-1][3]["thrust"].min() > 41.5
    # 40.5 N without a load; at 8 × 42 N the packs sag.
    assert 25.0 < real[-1][3]["thrust"].max() < 40.0


@pytest.mark.parametrize("rotor", [1, 4, 8])
def test_a_lost_rotor_is_commanded_nothing_from_the_fault_on_and_the_others_hold_the_robot(rotor):
    env = make(forms="form2", perturbation=0.0, disturbances={"lost_rotor": rotor, "fault_time": 0.5})
    steps, i = flight(env, np.zeros((60, 6)), seed=0), rotor - 1
    commands, thrusts = (np.array([info[key] for *_, info in steps]) for key in ("thrust_command", "thrust"))
    # The 21st command is given at 0.5 s.
    assert commands[1:21, i].min() > 10.0
    assert commands[21:, i].max() < 1e-9
    assert np.delete(commands, i, axis=1).min() > 5.0
    assert thrusts[20, i] > 10.0
    assert np.all(np.diff(thrusts[20:, i]) <= 0.0)
    assert thrusts[-1, i] < 1e-6
    errors = [np.linalg.norm(info["position_error"]) for *_, info in steps]
    assert max(errors) < 0.05
    assert abs(thrusts[-1].sum() - ROBOT.weight) < 0.1 * ROBOT.weight


@pytest.mark.parametrize("rotor", [1, 4, 8])
def test_a_stuck_rotor_keeps_its_angles_and_its_thrust_while_the_others_turn(rotor):
    disturbances = {"lost_rotor": rotor, "fault": "vectoring", "fault_time": 0.5}
    env = make(forms="form2", perturbation=0.0, disturbances=disturbances)
    actions = np.zeros((60, 6))
    actions[20:, :2] = 0.3
    infos, i = [info for *_, info in flight(env, actions, seed=0)], rotor - 1
    angles = np.array([info["vectoring"] for info in infos])[21:]
    turned = np.ptp(angles, axis=0).max(axis=1)
    assert turned[i] < 0.005
    assert np.delete(turned, i).min() > 4.0 * turned[i]
    assert np.delete(turned, i).max() > 0.05
    assert all(info["thrust_command"][i] > 5.0 for info in infos[21:])


def test_the_controller_is_told_of_the_lost_rotor_and_of_no_other_when_it_fails():
    env = make(forms="form1", disturbances={"lost_rotor": 3, "fault_time": 0.1})
    env.reset(seed=0)
    told = []
    for _ in range(8):
        reference = env.reference()
        told.append(reference.lost_thrust.tolist())
        assert not reference.lost_vectoring.any()
        env.step(np.zeros(6))
    third = [False, False, True] + [False] * 5
    assert told == [[False] * 8] * 4 + [third] * 4
    env.reset(seed=0, options={"disturbances": {"lost_rotor": 3, "fault": "vectoring", "fault_time": 0.0}})
    assert env.reference().lost_vectoring.tolist() == third
    assert not env.reference().lost_thrust.any()


@pytest.mark.parametrize("mode", ["residual_wrench", "residual_force", "residual"])
def test_no_action_makes_a_lost_rotor_thrust(mode):
    env = make(action_mode=mode, forms="form2", disturbances={"lost_rotor": 4, "fault_time": 0.0})
    steps = flight(env, actions_of(env, 30), seed=0)
    assert len(steps) > 20
    assert all(info["thrust_command"][3] < 1e-9 for *_, info in steps[1:])


def test_a_controller_of_ones_own_flies_in_place_of_the_preset():
    no_gains = CentroidalConfig(position_gains=((0.0, 0.0, 0.0),) * 3, attitude_gains=((0.0, 0.0, 0.0),) * 3)
    own = replace(PRESETS["as_flown"], centroidal=no_gains, joint_speed=0.9)
    env = make(controller=own, preset="paper", joint_speed=0.3)
    info = flight(env, np.zeros((1, 6)), seed=0)[-1][3]
    assert np.linalg.norm(info["position_error"]) > 0.01
    # Without gains an offset asks for the weight alone.
    assert abs(np.linalg.norm(info["wrench_desired"][:3]) - ROBOT.weight) < 1e-9
    np.testing.assert_allclose(info["wrench_desired"][3:], 0.0, rtol=0, atol=1e-9)
    assert env.controller.config.allocation == "as_flown"
    assert env.controller.config.joint_speed == 0.3
    same_preset = make(controller=ControllerConfig(), preset="as_flown", joint_speed=0.3)
    plain = make(preset="paper", joint_speed=0.3)
    assert_same(flight(same_preset, np.zeros((5, 6)), seed=0), flight(plain, np.zeros((5, 6)), seed=0))


def test_a_robot_of_ones_own_is_simulated_with_the_arguments_of_the_environment_on_top():
    own = PlantConfig(
        body=BodyConfig(total_mass=17.0), actuators=ActuatorConfig(max_thrust=30.0), idle_thrust=1.0, joint_speed=0.9
    )
    env = make(plant=own, action_mode="direct", forms="form1", perturbation=0.0, joint_speed=0.3)
    assert abs(env.plant.model.body_subtreemass[0] - 17.0) < 1e-9
    assert env.plant.config.joint_speed == 0.3
    for wish, thrust in ((42.0, 30.0), (0.0, 1.0)):
        info = flight(env, [direct(wish)] * 15, seed=0)[-1][3]
        np.testing.assert_allclose(info["thrust"], thrust, rtol=0, atol=0.05)
    both = make(plant=own, wake=False, sensors=True, battery=True, idle_thrust=2.0).plant.config
    assert (both.sense, both.aero.wake, both.actuators.battery, both.idle_thrust) == (True, False, True, 2.0)
    assert both.body.total_mass == 17.0
    noisy = make(plant=PlantConfig(sense=True), forms="form1", perturbation=0.0)
    assert np.linalg.norm(noisy.reset(seed=0)[0][:3]) > 2e-4


def test_a_robot_that_is_heavier_than_described_starts_with_the_thrust_that_carries_it():
    env = make(plant=PlantConfig(body=BodyConfig(total_mass=17.0)), forms="form1", perturbation=0.0)
    infos = [info for *_, info in flight(env, np.zeros((40, 6)), seed=0)]
    assert abs(infos[1]["wrench_desired"][2] - 17.0 * 9.81) < 0.1
    assert max(np.linalg.norm(info["position_error"]) for info in infos) < 0.01


def test_drawn_robots_hover_from_the_start_of_the_episode():
    env = make(randomization=1.0, forms="form1", perturbation=0.0)
    for seed in range(6):
        infos = [info for *_, info in flight(env, np.zeros((40, 6)), seed=seed)]
        assert max(np.linalg.norm(info["position_error"]) for info in infos) < 0.05


def test_info_tells_the_drawn_values_of_the_episode_within_their_ranges():
    env = make(randomization=1.0)
    first, second = (flight(env, np.zeros((2, 6)), seed=seed) for seed in (0, 1))
    for steps in (first, second):
        assert all(same(info["randomization"], steps[0][3]["randomization"]) for *_, info in steps)
    a, b = (steps[0][3]["randomization"] for steps in (first, second))
    assert set(a) == {row.field for row in TABLE}
    for row in TABLE:
        assert a[row.field].shape == row.shape
        assert np.all((a[row.field] >= row.low) & (a[row.field] <= row.high))
        assert not np.array_equal(a[row.field], b[row.field])
    assert abs(env.plant.model.body_subtreemass[0] - float(b["body.total_mass"])) < 1e-6


# Bad input


@pytest.mark.parametrize(
    ("options", "kind", "valid"),
    [
        ({"forms": "form4"}, UnknownNameError, "paper, form1"),
        ({"action_mode": "torque"}, UnknownNameError, "residual_wrench, residual_joint"),
        ({"preset": "mine"}, UnknownNameError, "paper, as_flown, tuned"),
        ({"camera": "back"}, UnknownNameError, "chase, side"),
        ({"render_mode": "rgb"}, UnknownNameError, "human, rgb_array, depth_array"),
        ({"joint_sped": 0.2}, UnknownNameError, "forms, joint_speed"),
        *(({"joint_speed": v}, InvalidValueError, "above 0") for v in (0.0, -0.2, math.nan, math.inf)),
        *(({"horizon_s": v}, InvalidValueError, "above 0") for v in (0.0, -1.0, math.nan, math.inf)),
        *(({"perturbation": v}, InvalidValueError, "at least 0") for v in (-1.0, math.nan, math.inf)),
        *(({"idle_thrust": v}, InvalidValueError, "0 … 42 N") for v in (-1.0, 50.0, math.nan)),
        *(({"randomization": v}, InvalidValueError, "within 0 … 1") for v in (-0.1, 1.1, math.nan, math.inf)),
        ({"max_iter": 0}, InvalidValueError, "at least 1"),
        *(({name: v}, InvalidValueError, "pixels within 1") for name in ("width", "height") for v in (0, -4, 5000)),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*render_mode='rgb':UserWarning")  # gymnasium's own remark, before our error
def test_an_argument_that_is_not_valid_is_refused_with_what_would_be(options, kind, valid):
    with pytest.raises(kind, match=valid) as refusal:
        gymnasium.make(HOVER, **options)
    assert isinstance(refusal.value, SpidarError)
    (name, value), = options.items()  # fmt: skip
    assert repr(value) in str(refusal.value) or repr(name) in str(refusal.value)


@pytest.mark.parametrize("name", ["spidar_gym/Hover-v9", "spidar_gym/Hoover-v0"])
def test_an_unknown_id_is_refused(name):
    with pytest.raises(gymnasium.error.Error, match=r"v0|Hover"):
        gymnasium.make(name)


@pytest.mark.parametrize(("name", "mode"), EVERY)
def test_an_action_of_wrong_shape_or_without_a_number_is_refused_and_nothing_moves(name, mode):
    env = make(name, action_mode=mode)
    env.reset(seed=0)
    n = env.action_space.shape[0]
    before = env.plant.save()
    nan = np.zeros(n)
    nan[-1] = math.nan
    for action in (np.zeros(n + 1), np.zeros(n - 1), np.zeros((1, n)), nan, np.full(n, math.inf)):
        with pytest.raises(InvalidValueError, match=rf"\({n},\)|finite"):
            env.step(action)
    assert same(env.plant.save(), before)


def test_unknown_reset_options_and_forms_are_refused():
    env = make()
    with pytest.raises(UnknownNameError, match="form'; valid: forms, start, disturbances"):
        env.reset(options={"form": "paper"})
    with pytest.raises(UnknownNameError, match="valid: paper, form1"):
        env.reset(options={"forms": "form4"})


STORMS = [
    ({"storm": 1.0}, UnknownNameError, "storm.*valid: wind, push, lost_rotor, fault, fault_time"),
    ({"fault": "engine"}, UnknownNameError, "engine.*valid: thrust, vectoring"),
    *(({"lost_rotor": v}, InvalidValueError, rf"lost_rotor = {v} .*1 … 8, or 0 for none") for v in (9, -1)),
    *(({"wind": v}, InvalidValueError, r"wind = .*at least 0 \[m/s\]") for v in (-1.0, math.nan, math.inf)),
    *(({"push": v}, InvalidValueError, r"push = .*at least 0 \[N\]") for v in (-1.0, math.nan)),
    *(({"fault_time": v}, InvalidValueError, r"fault_time = .*at least 0 \[s\]") for v in (-0.1, math.nan)),
]


@pytest.mark.parametrize(("disturbances", "kind", "valid"), STORMS)
def test_a_disturbance_that_cannot_be_is_refused_by_make_and_by_reset_which_keeps_the_old_ones(
    disturbances, kind, valid
):
    with pytest.raises(kind, match=valid):
        gymnasium.make(HOVER, disturbances=disturbances)
    env = make(disturbances={"wind": 2.0})
    before = flight(env, np.zeros((3, 6)), seed=0)
    with pytest.raises(kind, match=valid):
        env.reset(seed=0, options={"disturbances": disturbances})
    assert_same(flight(env, np.zeros((3, 6)), seed=0), before)


@pytest.mark.parametrize("name", ["position_noise", "gyro_noise", "latency", "factor"])
@pytest.mark.parametrize("value", [-1e-3, math.nan])
def test_sensors_with_negative_noise_are_refused(name, value):
    with pytest.raises(InvalidValueError, match=f"{name} = .*at least 0"):
        make(plant=PlantConfig(sensors=SensorConfig(**{name: value})), sensors=True)


def test_the_forms_of_a_reset_last_until_the_next_ones():
    env = make(forms="form1")
    for options, form in (
        (None, "form1"),
        ({"forms": "form3"}, "form3"),
        (None, "form3"),
        ({"forms": "form2"}, "form2"),
    ):
        env.reset(seed=0, options=options)
        assert np.array_equal(env.reference().joint_target, FORMS[form])


def test_what_needs_a_reset_says_so():
    env = make()
    for act in (lambda: env.step(np.zeros(6)), lambda: env.state, lambda: env.reference()):
        with pytest.raises(SpidarError, match="reset"):
            act()
    with pytest.raises(gymnasium.error.ResetNeeded):
        gymnasium.make(HOVER).step(np.zeros(6))


def test_closing_twice_does_nothing():
    env = gymnasium.make(HOVER)
    env.reset(seed=0)
    env.close()
    env.close()


@pytest.mark.parametrize("edit", [lambda text: text.replace("0.0025", "0.0020"), None])
def test_a_model_file_that_was_edited_or_is_missing_is_refused(edit, tmp_path, monkeypatch):
    shutil.copytree(description.assets_dir(), tmp_path / "assets")
    path = tmp_path / "assets" / "mjcf" / "spidar.xml"
    text = path.read_text(encoding="utf-8")
    path.unlink() if edit is None else path.write_text(edit(text), encoding="utf-8")
    monkeypatch.setattr(description, "assets_dir", lambda: tmp_path / "assets")
    plant.scene.cache_clear()
    try:
        with pytest.raises(StaleAssetError, match="spidar assets"):
            gymnasium.make(HOVER)
        with pytest.raises(StaleAssetError, match=r"spidar\.xml"):
            Plant()
    finally:
        plant.scene.cache_clear()


# Vector environments and specs


def row_of(info, i):
    """One environment's share of the infos of several."""
    if isinstance(info, dict):
        return {key: row_of(value, i) for key, value in info.items() if not key.startswith("_")}
    return info[i]


@pytest.mark.parametrize("options", [{}, ROUGH], ids=["plain", "rough"])
def test_vector_environments_in_one_process_and_in_several_fly_like_single_ones(options):
    n, kwargs = 2, {"forms": "equal", "joint_speed": 1.0, **options}
    envs = [gymnasium.make_vec(HOVER, n, "sync", **kwargs)]
    envs.append(gymnasium.make_vec(HOVER, n, "async", vector_kwargs={"context": "spawn"}, **kwargs))
    singles = [make(**kwargs) for _ in range(n)]
    try:
        expected = [env.reset(seed=10 + i)[0] for i, env in enumerate(singles)]
        for env in envs:
            assert np.array_equal(env.reset(seed=10)[0], expected)
        for actions in np.random.default_rng(0).uniform(-1, 1, (20, n, 6)).astype(np.float32):
            steps = [env.step(action) for env, action in zip(singles, actions, strict=True)]
            for env in envs:
                observations, rewards, terminated, truncated, infos = env.step(actions)
                assert np.array_equal(observations, [step[0] for step in steps])
                assert np.array_equal(rewards, [step[1] for step in steps])
                assert not terminated.any()
                assert not truncated.any()
                for key, value in steps[1][4].items():
                    assert same(row_of(infos.get(key, {}), 1), value), key
    finally:
        for env in envs:
            env.close()


@pytest.mark.parametrize("through", ["json", "pickle", "deepcopy"])
@pytest.mark.parametrize("options", [{}, ROUGH], ids=["plain", "rough"])
def test_a_spec_survives_being_written_down_and_makes_the_same_environment(options, through):
    options = {"action_mode": "residual", "forms": "independent", "joint_speed": 0.5, **options}
    env = gymnasium.make(HOVER, **options, max_episode_steps=77)
    again = {
        "json": lambda spec: EnvSpec.from_json(json.dumps(json.loads(spec.to_json()))),
        "pickle": lambda spec: pickle.loads(pickle.dumps(spec)),
        "deepcopy": copy.deepcopy,
    }[through](env.spec)
    assert again == env.spec
    other = gymnasium.make(again)
    assert other.spec.max_episode_steps == 77
    actions = actions_of(env, 10)
    assert_same(flight(env, actions, seed=2), flight(other, actions, seed=2))


def test_importing_the_package_registers_every_environment_under_its_horizon():
    assert spidar_gym.__version__
    for name, entry in ENVIRONMENTS.items():
        assert gymnasium.spec(name).max_episode_steps == entry.horizon
        assert isinstance(gymnasium.spec(name).entry_point, str)


def test_the_words_of_failure_are_the_documented_ones():
    task = HoverTask()
    near, far = np.zeros(3), np.array([0.0, 0.0, 1.1])
    assert task.failed(near, 0.0, False) == ""
    words = {task.failed(near, 0.0, True), task.failed(near, 1.1, False), task.failed(far, 0.0, False), "diverged"}
    assert words == set(FAILURES)


def test_every_option_of_the_task_is_an_argument_of_the_environment():
    for field in fields(HoverTask):
        env = make(**{field.name: getattr(HoverTask(), field.name)})
        assert env.task == HoverTask()
