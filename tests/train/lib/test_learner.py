"""Pins the learner: hidden entries of the observation, and entries of the action that stay 0."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from support.training import TINY

from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.artifact import read_artifact
from train.lib.config import override
from train.residual import learn

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("short")]


def test_hidden_observations_and_still_actions_have_zero_weights(tmp_path):
    args = override(TINY, sees=("joint_position",), still=(2, 5), lr=0.01, out=tmp_path)
    learned = read_artifact(learn(args))
    blind = args.env.hidden_entries()
    assert blind.sum() == len(blind) - 16
    np.testing.assert_array_equal(learned.weights[0][:, blind], 0.0)
    assert np.abs(learned.weights[0][:, ~blind]).min() > 0.0
    moved = np.abs(learned.weights[-1]).max(axis=1) > 0.0
    np.testing.assert_array_equal(moved, [True, True, False, True, True, False])
    np.testing.assert_array_equal(learned.biases[-1][[2, 5]], 0.0)
    with pytest.raises(UnknownNameError, match="unknown piece of the observation 'mood'; valid: position_error"):
        override(args, sees=("mood",)).env.hidden_entries()
    with pytest.raises(InvalidValueError, match=r"still = 6 is not valid; expected entries within 0 … 5"):
        override(args, still=(6,)).env.still_entries()
