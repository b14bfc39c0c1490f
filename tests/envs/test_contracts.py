"""Pins the environments' contracts: interface, determinism, reward, bounds, infos, clipping, closing."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from support.episodes import EARLY, EVERY, HOVER, ROUGH, actions_of, assert_same, flight, make, named, same

from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.flight.observation import layout
from spidar_gym.control.presets import PRESETS, controller_config
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.model.dynamics import Model
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import TABLE
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.tasks.hover import SEQUENCES, HoverTask, hover_height

HOVERS = [(HOVER, mode) for mode in ACTION_MODES]


RESIDUAL_MODES = [name for name, mode in ACTION_MODES.items() if mode.residual is not None]


CONSTANT = {
    # An outer rotor is below the inner rotor of its leg in every flown form, so it is never the upper one.
    **{mode: {("restricted_rotors", i) for i in (1, 3, 5, 7)} for mode in RESIDUAL_MODES},
    # No controller runs, so no rotors are restricted and no errors integrated.
    **dict.fromkeys(
        ("direct", "torso_forces"),
        {("restricted_rotors", i) for i in range(8)}
        | {(f"{what}_integral", i) for what in ("position", "attitude") for i in range(3)},
    ),
}
"""Elements of the observation that never change in the rollouts below, with the reason."""


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
    """Flights of random actions in every form sequence, one of them long enough to reach the next form."""
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
    """Assert that no step's observation or `info` shares memory with those of the next."""
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
def test_writing_into_returned_arrays_changes_nothing_that_follows(name, mode, options):
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
            assert set(terms) == {f"reward_{term}" for term in HoverTask.reward_terms}
            assert all(0.0 <= value <= 1.0 for value in (reward, *terms.values()))
            weights = {t: weight for t, (weight, _) in HoverTask.reward_terms.items()}
            assert abs(reward - sum(weight * info[f"reward_{t}"] for t, weight in weights.items())) < 1e-12
            seen.add(reward)
    assert len(seen) > 60
    assert abs(sum(weight for weight, _ in HoverTask.reward_terms.values()) - 1.0) < 1e-12


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
def test_a_diverged_step_is_reported_in_finite_numbers_and_nothing_is_printed(
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
    # The last finite values are kept.
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
        **dict.fromkeys(("cost", "cost_contact", "cost_torque", "cost_duct", "cost_blown"), ()),
        **dict.fromkeys([f"reward_{term}" for term in HoverTask.reward_terms], ()),
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
@pytest.mark.parametrize(
    ("control", "kind"), [("python", FlightController), ("core", CoreFlightController)], ids=["python", "core"]
)
def test_the_zero_action_is_bit_for_bit_the_controller_alone(mode, preset, options, control, kind):
    env = make(action_mode=mode, preset=preset, forms="independent", control=control, **options)
    env.reset(seed=EARLY)
    start, q = env.state, env.reference().joint_target
    # The environment's joint speed has precedence over the preset's.
    config = replace(controller_config(preset), joint_speed=ROBOT.joint_speed)
    controller, bare = kind(config), Plant(PlantConfig(aero=AeroConfig(**options)))
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
    # A rotation by the error levels the torso, and does not change the axis of the error.
    np.testing.assert_allclose(R_wb @ info["attitude_error"], info["attitude_error"], rtol=0, atol=1e-12)
    x, y, z = info["attitude_error"] / angle
    assert np.dot((R_wb[2, 1] - R_wb[1, 2], R_wb[0, 2] - R_wb[2, 0], R_wb[1, 0] - R_wb[0, 1]), (x, y, z)) < 0.0


def test_info_reports_commands_and_their_effects():
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


def test_finite_actions_are_clipped_however_large_they_are():
    beyond, edge = (flight(make(), np.full((3, 6), a), seed=0) for a in (1e308, 1.0))
    assert_same(beyond, edge)


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


def test_closing_twice_does_nothing():
    env = gymnasium.make(HOVER)
    env.reset(seed=0)
    env.close()
    env.close()
