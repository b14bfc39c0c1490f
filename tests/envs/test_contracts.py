"""Pins the environments' contracts: interface, determinism, reward, what is refused, vector environments, specs."""

import copy
import json
import math
import pickle
import re
import shutil
from dataclasses import fields
from functools import cache
from itertools import pairwise

import gymnasium
import jaxtyping
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from support.episodes import EARLY, HOVER, ROUGH, actions_of, assert_same, flight, make, named, same

import spidar_gym
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.flight.observation import layout
from spidar_gym.control.presets import PRESETS, controller_config
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.envs.docs import CHAPTERS, page
from spidar_gym.envs.hover.task import FAILURES, REWARD_TERMS, SEQUENCES, HoverTask, hover_height
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, SpidarError, StaleAssetError, UnknownNameError
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import FORMS, ROBOT, description
from spidar_gym.sim import plant
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.plant import Plant
from spidar_gym.sim.randomize import TABLE
from spidar_gym.sim.sensors import SensorConfig
from spidar_gym.so3 import quat_to_matrix

HOVERS = [(HOVER, mode) for mode in ACTION_MODES]
EVERY = [(name, mode) for name in ENVIRONMENTS for mode in CHAPTERS[name].modes]
RESIDUAL_MODES = [name for name, mode in ACTION_MODES.items() if mode.residual is not None]
CONSTANT = {
    # An outer rotor hangs below the inner one of its leg in every form that is flown, so it is never the upper one.
    **{mode: {("restricted_rotors", i) for i in (1, 3, 5, 7)} for mode in RESIDUAL_MODES},
    # No controller runs: there is nobody who restricts rotors or integrates errors.
    "direct": {("restricted_rotors", i) for i in range(8)}
    | {(f"{what}_integral", i) for what in ("position", "attitude") for i in range(3)},
}
"""Elements of the observation that never change in the rollouts below, and why."""


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


@pytest.mark.parametrize("spoilt", ["qpos", "qvel", "act"])
@pytest.mark.parametrize("value", [math.nan, math.inf, 1e200])
@pytest.mark.parametrize(("name", "options"), [*((name, {}) for name in ENVIRONMENTS), (HOVER, ROUGH)], ids=named)
def test_a_diverged_step_says_so_in_finite_numbers_and_nothing_is_printed(
    name, options, value, spoilt, capfd, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    env = make(name, **options)
    zero = np.zeros(env.action_space.shape)
    before = flight(env, [zero] * 2, seed=0)[-1][3]
    getattr(env.plant.data, spoilt)[:] = value
    with np.errstate(all="ignore"):
        observation, reward, terminated, truncated, info = env.step(zero)
    assert (terminated, truncated, reward, info["failure"]) == (True, False, 0.0, "diverged")
    assert not info["is_success"]
    assert observation in env.observation_space
    assert kind_of(info) == kind_of(before)
    for key, number in info.items():
        assert np.asarray(number).dtype.kind != "f" or np.isfinite(number).all(), key
    # The last numbers that were ones stay.
    for key in ("thrust", "joint_torque", "vectoring", "air_force", "power_w", "energy_wh"):
        assert same(info[key], before[key]), key
    assert all(np.isfinite(values).all() for values in (env.state.joint_position, env.state.position_w))
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "mode"), HOVERS)
def test_infos_have_the_same_keys_and_shapes_at_reset_at_every_step_and_when_diverged(name, mode):
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
    controller, bare = FlightController(controller_config(preset)), Plant(PlantConfig(aero=AeroConfig(**options)))
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
    state, tick = env.state, env.controller.last_step
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
    if info["qp_status"] in ("closed_form", "solved", "projected"):
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
        *(({"joint_speed": v}, InvalidValueError, r"within 1e-06 … 1000 \[rad/s\]")
          for v in (0.0, -0.2, 1001.0, math.nan, math.inf)),
        *(({"horizon_s": v}, InvalidValueError, r"within 0.001 … 86400 \[s\]")
          for v in (0.0, -1.0, 1e8, math.nan, math.inf)),
        *(({"perturbation": v}, InvalidValueError, "within 0 … 1000") for v in (-1.0, 1001.0, math.nan, math.inf)),
        *(({"idle_thrust": v}, InvalidValueError, r"0 … 42 \[N\]") for v in (-1.0, 50.0, math.nan)),
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


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("action_mod", "action_mode"),
        ("sensor", "sensors"),
        ("randomisation", "randomization"),
        ("horizn", "horizon_s"),
    ],
)
def test_an_unknown_argument_gets_the_list_of_all_that_there_are_and_the_one_that_was_meant(name, wrong, meant):
    with pytest.raises(UnknownNameError) as refusal:
        gymnasium.make(name, **{wrong: 1.0})
    valid, guess = str(refusal.value).partition("valid: ")[2].split("; ")
    table = page(name).partition("## Arguments")[2].partition("###")[0]
    assert sorted(valid.split(", ")) == sorted(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE))
    assert guess == f"did you mean {meant}?"


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


REFUSED = [
    {"disturbances": {"wind": 9.0}, "forms": "form3", "zzz": 1},
    {"disturbances": {"wind": 9.0}, "forms": "form4"},
    {"forms": "form3", "disturbances": {"wind": -9.0}},
    {"forms": "form3", "start": {"goals": []}},
    {"start": {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.0] * 3, "rotation": [1e200, 1e200, 0.0]}},
    {"start": {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.0] * 3, "rotation": [0.0] * 3, "velocity": [1.0] * 3}},
    "abc", 5, [("forms", "form3")],
]  # fmt: skip


@pytest.mark.parametrize("options", REFUSED, ids=range(len(REFUSED)))
def test_a_refused_reset_leaves_the_episode_and_all_that_follow_as_they_were(options, monkeypatch):
    # Users have no type checker, which would refuse on its own.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    zero, flights = np.zeros((3, 6)), []
    for asked in (False, True):
        env = make(forms="form1", disturbances={"push": 30.0})
        begun = flight(env, zero, seed=3)
        if asked:
            with pytest.raises(SpidarError):
                env.reset(seed=99, options=options)
        # The episode goes on, and the next one comes of the generator where it was.
        begun += [(o, r, t, i) for o, r, t, _, i in (env.step(action) for action in zero)]
        flights.append(begun + flight(env, zero) + flight(env, zero, seed=4))
    assert_same(*flights)


def test_a_start_has_no_keys_but_its_own():
    start = {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.0] * 3, "rotation": [0.0] * 3, "velocity": [1.0] * 3}
    with pytest.raises(UnknownNameError, match="key of start 'velocity'; valid: goals, position, rotation, trim"):
        make().reset(options={"start": start})


def test_finite_actions_are_clipped_however_large_they_are():
    beyond, edge = (flight(make(), np.full((3, 6), a), seed=0) for a in (1e308, 1.0))
    assert_same(beyond, edge)


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
