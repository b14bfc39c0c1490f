"""Pins the meaning of actions: sizes, authority, zero is the controller alone, angles take the shorter rotation."""

from dataclasses import fields

import numpy as np
import pytest

from spidar_gym.envs.actions import ACTION_MODES, direct_command, find_action_mode
from spidar_gym.errors import SpidarError, UnknownNameError
from spidar_gym.robot import ROBOT
from spidar_gym.state import NO_RESIDUAL, Residual

RESIDUAL_MODES = [name for name, mode in ACTION_MODES.items() if mode.residual is not None]
REST = np.zeros((8, 2))


def residual(mode: str, action) -> Residual:
    """The residual of an action; a number stands for equal entries."""
    found = find_action_mode(mode)
    assert found.residual is not None
    return found.residual(np.broadcast_to(action, found.size).astype(float))


def channel(mode: str, name: str) -> slice:
    """Slice of a channel's entries."""
    start = 0
    for part in ACTION_MODES[mode].channels:
        if part.name == name:
            return slice(start, start + part.size)
        start += part.size
    raise AssertionError(name)


def test_actions_have_the_documented_sizes():
    sizes = {name: mode.size for name, mode in ACTION_MODES.items()}
    assert sizes == {
        "residual_wrench": 6,
        "residual_joint": 17,
        "residual": 23,
        "residual_force": 24,
        "direct": 40,
        "torso_forces": 40,
    }


def test_every_channel_has_its_authority_and_no_name_occurs_twice_in_a_mode():
    for mode in ACTION_MODES.values():
        assert len({part.name for part in mode.channels}) == len(mode.channels)
        assert all(part.authority for part in mode.channels)
        assert mode.doc


@pytest.mark.parametrize("mode", RESIDUAL_MODES)
def test_the_zero_action_adds_nothing(mode):
    zero = residual(mode, 0.0)
    for field in fields(Residual):
        value, nothing = getattr(zero, field.name), getattr(NO_RESIDUAL, field.name)
        assert not np.any(value) if nothing is None else np.array_equal(value, nothing), field.name


@pytest.mark.parametrize("mode", ["residual_wrench", "residual"])
def test_a_wrench_entry_of_one_is_15_percent_of_the_weight_or_8_newton_metres(mode):
    where = channel(mode, "wrench")
    for k in range(6):
        action = np.zeros(ACTION_MODES[mode].size)
        action[where.start + k] = -1.0
        expected = np.zeros(6)
        expected[k] = -0.15 * 16.0 * 9.81 if k < 3 else -8.0
        np.testing.assert_allclose(residual(mode, action).wrench, expected, rtol=1e-12)


@pytest.mark.parametrize("mode", ["residual_joint", "residual"])
def test_joint_entries_of_one_are_a_tenth_of_a_radian_and_half_the_speed(mode):
    action = np.zeros(ACTION_MODES[mode].size)
    action[channel(mode, "joint_offset").start + 5] = 1.0
    offset = residual(mode, action)
    assert np.flatnonzero(offset.joint_offset).tolist() == [5]
    assert abs(offset.joint_offset[5] - 0.1) < 1e-12
    assert offset.joint_speed_scale == 1.0
    for a, scale in ((-1.0, 0.5), (1.0, 1.5)):
        action = np.zeros(ACTION_MODES[mode].size)
        action[channel(mode, "joint_speed_scale")] = a
        assert abs(residual(mode, action).joint_speed_scale - scale) < 1e-12
        assert not residual(mode, action).joint_offset.any()


def test_both_residuals_together_are_the_two_of_them():
    action = np.random.default_rng(0).uniform(-1, 1, 23)
    both = residual("residual", action)
    assert np.array_equal(both.wrench, residual("residual_wrench", action[:6]).wrench)
    joint = residual("residual_joint", action[6:])
    assert np.array_equal(both.joint_offset, joint.joint_offset)
    assert both.joint_speed_scale == joint.joint_speed_scale


def test_a_force_entry_of_one_is_5_newton_along_its_rotors_axis():
    action = np.zeros(24)
    action[3 * 6 + 1] = 1.0
    forces = residual("residual_force", action).forces_l
    assert forces is not None
    assert np.argwhere(forces).tolist() == [[6, 1]]
    assert abs(forces[6, 1] - 5.0) < 1e-12


def test_direct_thrust_and_joints_span_their_whole_range():
    for a, thrust, joint in ((-1.0, 0.0, -np.pi / 2), (0.0, 21.0, 0.0), (1.0, 42.0, np.pi / 2)):
        command = direct_command(np.full(40, a), REST)
        np.testing.assert_allclose(command.thrust, thrust, rtol=0, atol=1e-12)
        np.testing.assert_allclose(command.joint_position, joint, rtol=0, atol=1e-12)
        np.testing.assert_allclose(command.joint_torque_limit, ROBOT.max_joint_torque)


def test_direct_channels_reach_the_rotor_and_joint_of_their_number():
    action = np.zeros(40)
    for name, k in (("thrust", 2), ("phi", 3), ("theta", 4), ("joint_target", 9)):
        action[channel("direct", name).start + k] = 0.5
    command = direct_command(action, REST)
    assert np.flatnonzero(command.thrust != 21.0).tolist() == [2]
    assert np.argwhere(np.abs(command.vectoring) > 1e-9).tolist() == [[3, 0], [4, 1]]
    np.testing.assert_allclose(command.vectoring[[3, 4], [0, 1]], np.pi / 2, rtol=1e-12)
    assert np.flatnonzero(command.joint_position).tolist() == [9]


def test_direct_angles_take_the_shorter_rotation_to_the_commanded_direction():
    rng = np.random.default_rng(1)
    for _ in range(200):
        action, present = rng.uniform(-1, 1, 40), rng.uniform(-20, 20, (8, 2))
        vectoring = direct_command(action, present).vectoring
        assert np.abs(vectoring - present).max() <= np.pi + 1e-9
        wanted = np.pi * np.stack([action[8:16], action[16:24]], axis=1)
        np.testing.assert_allclose(np.exp(1j * vectoring), np.exp(1j * wanted), rtol=0, atol=1e-9)


def test_the_ends_of_an_angles_channel_are_the_same_direction():
    present = np.full((8, 2), 3.0)
    ends = []
    for a in (-1.0, 1.0):
        action = np.zeros(40)
        action[8:24] = a
        ends.append(direct_command(action, present).vectoring)
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ends[0], np.pi, rtol=0, atol=1e-12)


def test_an_unknown_mode_is_refused_with_the_names_of_all():
    with pytest.raises(UnknownNameError, match=", ".join(ACTION_MODES)) as refusal:
        find_action_mode("torque")
    assert isinstance(refusal.value, SpidarError)
