"""Tests actions in torso axes: the trim, the forces that reach the robot, the joints, and what is refused."""

from itertools import pairwise

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.actions import TORSO, TorsoScale, action_modes
from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, HOVER, PATH
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import MIN_FORCE, aim, vectoring_to_force
from spidar_gym.robot import FORMS, N_ROTORS, ROBOT


def made(name, **options):
    return gymnasium.make(name, action_mode=TORSO, **options)


def forces_b(R_bl, thrust, phi, theta):
    return (R_bl @ vectoring_to_force(thrust, np.stack([phi, theta], axis=1))[..., None])[..., 0]


@pytest.mark.parametrize("form", FORMS)
def test_aimed_forces_become_the_wanted_ones_as_the_last_angle_follows(form):
    R_bl = Model().snapshot(FORMS[form], np.eye(3), np.zeros((N_ROTORS, 2))).R_bl
    wanted = np.array([0.0, 0.0, ROBOT.hover_thrust]) + np.random.default_rng(4).uniform(-3.0, 3.0, (N_ROTORS, 3))
    phi, apart = np.random.default_rng(5).uniform(-np.pi, np.pi, N_ROTORS), []
    for _ in range(12):
        thrust, phi, theta = aim(R_bl, wanted, np.sin(phi), np.cos(phi))
        apart.append(np.linalg.norm(forces_b(R_bl, thrust, phi, theta) - wanted, axis=1).max())
    # Across φ's plane at most the held share is missing; each tick leaves a fraction of that.
    assert apart[0] < 0.06 * np.linalg.norm(wanted, axis=1).max()
    assert all(after < 0.5 * before for before, after in pairwise(apart) if before > 1e-9)
    assert apart[-1] < 1e-4


@pytest.mark.parametrize("form", ["form1", "form3"])
def test_a_zero_action_bears_the_weight_and_keeps_the_form(form):
    env = made(HOVER, forms=form, perturbation=0.0, wake=False).unwrapped
    env.reset(seed=0)
    for _ in range(8):
        env.step(np.zeros(40, np.float32))
    assert np.allclose(env.command.thrust, ROBOT.weight / N_ROTORS, rtol=1e-3)
    assert np.array_equal(env.command.joint_position, FORMS[form])
    assert np.abs(env.state.velocity_w).max() < 0.02


def test_the_joints_go_to_their_form_and_an_entry_offsets_one_of_them():
    env = made(HOVER, forms="form2", perturbation=0.0, joint_speed=0.4, action_scale={"joint": 0.3}).unwrapped
    env.reset(seed=0)
    action = np.zeros(40, np.float32)
    action[24 + 5] = 1.0
    before = env.command.joint_position if env.ticks else FORMS["form2"]
    for _ in range(40):
        env.step(action)
        assert np.abs(env.command.joint_position - before).max() <= 0.4 / 40.0 + 1e-9
        before = env.command.joint_position
    offset = env.command.joint_position - FORMS["form2"]
    assert abs(offset[5] - 0.3) < 1e-6
    assert not np.delete(offset, 5).any()


@pytest.mark.parametrize(("name", "share"), [(HOVER, 1.0), (PATH, 1.0), (CRAWL, 0.0), (COURSE, 0.0)])
def test_the_trim_is_the_weight_in_the_air_and_nothing_on_the_floor(name, share):
    env = made(name).unwrapped
    env.reset(seed=0)
    env.step(np.zeros(40, np.float32))
    assert abs(env.command.thrust.sum() - share * ROBOT.weight) < 0.02 * ROBOT.weight


def test_small_forces_on_the_floor_do_not_turn_the_modules():
    env = made(CRAWL).unwrapped
    env.reset(seed=0)
    env.step(np.r_[np.full(24, 0.15), np.zeros(16)].astype(np.float32))
    kept = env.command.vectoring
    env.step(np.r_[np.full(24, -0.09), np.zeros(16)].astype(np.float32))
    assert 0.0 < env.command.thrust.max() < MIN_FORCE
    assert np.array_equal(env.command.vectoring, kept)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_bits_do_not_depend_on_the_number_of_robots(name):
    options = {"action_mode": TORSO, "hold": 3, "reward": "sloped", "observation": "scaled", "randomization": 1.0}
    one, five = (gymnasium.make_vec(name, num_envs=n, num_threads=min(n, 2), **options) for n in (1, 5))
    one.reset(seed=[7])
    five.reset(seed=[3, 4, 7, 5, 6])
    rng = np.random.default_rng(1)
    for _ in range(12):
        actions = rng.normal(0.0, 0.3, (5, 40)).astype(np.float32)
        seen, rewards, *_ = one.step(actions[2:3])
        all_seen, all_rewards, *_ = five.step(actions)
        assert seen[0].tobytes() == all_seen[2].tobytes()
        assert rewards[0] == all_rewards[2]
    one.close()
    five.close()


def test_without_authority_over_joints_the_action_has_no_entries_for_them():
    env = made(CRAWL, action_scale={"joint": 0.0})
    assert env.action_space.shape == (24,)
    _, _ = env.reset(seed=0)
    env.step(np.ones(24, np.float32))
    assert action_modes(ROBOT, TorsoScale(joint=0.0))[TORSO].size == 24


@pytest.mark.parametrize(
    ("scale", "mode", "error"),
    [
        ({"force": 0.0}, TORSO, InvalidValueError), ({"force": np.nan}, TORSO, InvalidValueError),
        ({"joint": -0.1}, TORSO, InvalidValueError), ({"trim": 3.0}, TORSO, InvalidValueError),
        ({"torque": 1.0}, TORSO, UnknownNameError),
        ({"force": 1.0}, "direct", InvalidValueError), ({"share": 0.5}, "direct", InvalidValueError),
        ({"share": 0.0}, "residual", InvalidValueError), ({"share": 1.5}, "residual", InvalidValueError),
        ({"force": 1.0}, "residual", InvalidValueError), ({"share": 0.5}, TORSO, UnknownNameError),
    ],
)  # fmt: skip
def test_a_scale_that_is_not_valid_is_refused_in_one_line(scale, mode, error):
    for name in (HOVER, CRAWL, COURSE):
        with pytest.raises(error) as refused:
            gymnasium.make(name, action_mode=mode, action_scale=scale)
        assert "valid" in str(refused.value)
        assert "\n" not in str(refused.value)
