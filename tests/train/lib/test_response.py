"""Pins the pulse response of the pose to a residual wrench against Newton's law, and its convolution."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
import torch

from spidar_gym.control.presets import controller_config
from spidar_gym.envs.actions import WRENCH_AUTHORITY
from spidar_gym.robot import ROBOT
from train.lib.config import CONTROL
from train.lib.response import RESPONSE_TICKS, pulse_response, respond

pytestmark = pytest.mark.train


@pytest.fixture(scope="module")
def paper():
    """Return the pulse response with the paper's controller in one form."""
    return pulse_response({"preset": "paper", "action_mode": "residual_wrench"}, 3, RESPONSE_TICKS, CONTROL)


def test_a_lasting_force_displaces_the_robot_as_far_as_its_spring_gives(paper):
    """At rest F = m k_P x; the sum of a pulse response is the response to a constant force."""
    (stiffness, integral, _), *_ = controller_config("paper").centroidal.position_gains
    assert integral < 0.05 * stiffness  # negligible within the 5 s of the response
    for axis in range(2):
        expected = -WRENCH_AUTHORITY[axis] / (ROBOT.total_mass * stiffness)
        assert paper[axis, axis].sum() == pytest.approx(expected, rel=0.05)


def test_a_pulse_moves_the_robot_by_its_momentum_at_most_and_by_half_of_it_at_least(paper):
    """Without a controller the speed is F dt / m; the damping reduces it while the rotors respond."""
    speed = WRENCH_AUTHORITY[0] / 40.0 / ROBOT.total_mass
    for axis in range(2):
        fastest = np.diff(-paper[axis, axis]).max() * 40.0
        assert 0.5 * speed < fastest < speed


def test_a_response_is_the_sum_of_the_responses_to_every_tick():
    rng = np.random.default_rng(0)
    response, wrench = rng.normal(size=(6, 6, 5)), rng.normal(size=(12, 6))
    by_hand = np.zeros((12, 6))
    for t in range(12):
        for k in range(min(5, t + 1)):
            by_hand[t] += response[:, :, k] @ wrench[t - k]
    kernel = torch.tensor(response[:, :, ::-1].copy())
    np.testing.assert_allclose(respond(kernel, torch.tensor(wrench)).numpy(), by_hand, atol=1e-12)
