"""Pins the supervised residual: the measured answer to a pulse, the network that sees no error, and that it helps."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
import torch

from spidar_gym.benchmark.artifact import read_artifact
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.control.core import core_path
from spidar_gym.control.observation import layout
from spidar_gym.control.presets import controller_config
from spidar_gym.envs.actions import WRENCH_AUTHORITY
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import ROBOT
from train import presets, supervised
from train.referee import Base, Referee
from train.response import RESPONSE_TICKS, answer, pulse_response
from train.supervised import Args, learn, visible, weakened

pytestmark = pytest.mark.train
CONTROL = "core" if core_path().is_file() else "python"
TINY = Args(**presets.SUPERVISED["hover-paper"])
TINY = replace(
    TINY, tracks=("flight-fast3",), rounds=1, flights=6, updates=150, forms=1, scenarios=2, hidden=16, workers=2,
    control=CONTROL,
)  # fmt: skip


@pytest.fixture(scope="module")
def paper():
    """Answer of the paper's controller in one form."""
    return pulse_response({"preset": "paper", "action_mode": "residual_wrench"}, 3, RESPONSE_TICKS, CONTROL)


def test_a_lasting_force_displaces_the_robot_as_far_as_its_spring_gives(paper):
    """Newton: F = m k_P x at rest; the sum of a pulse response is the answer to what lasts."""
    (stiffness, integral, _), *_ = controller_config("paper").centroidal.position_gains
    assert integral < 0.05 * stiffness  # within the 5 s of the answer it does little
    for axis in range(2):
        expected = -WRENCH_AUTHORITY[axis] / (ROBOT.total_mass * stiffness)
        assert paper[axis, axis].sum() == pytest.approx(expected, rel=0.05)


def test_a_pulse_moves_the_robot_by_its_momentum_at_most_and_by_half_of_it_at_least(paper):
    """F dt / m is the speed without a controller; while the rotors turn, damping takes a part of it."""
    speed = WRENCH_AUTHORITY[0] / 40.0 / ROBOT.total_mass
    for axis in range(2):
        fastest = np.diff(-paper[axis, axis]).max() * 40.0
        assert 0.5 * speed < fastest < speed


def test_an_answer_is_the_sum_of_the_answers_to_every_tick():
    rng = np.random.default_rng(0)
    response, wrench = rng.normal(size=(6, 6, 5)), rng.normal(size=(12, 6))
    by_hand = np.zeros((12, 6))
    for t in range(12):
        for k in range(min(5, t + 1)):
            by_hand[t] += response[:, :, k] @ wrench[t - k]
    reversed_ = torch.tensor(response[:, :, ::-1].copy())
    np.testing.assert_allclose(answer(reversed_, torch.tensor(wrench)).numpy(), by_hand, atol=1e-12)


def test_the_network_sees_the_joints_motion_and_no_error():
    seen = visible(TINY)
    names = np.concatenate([np.full(field.size, field.name) for field in layout(6)])
    assert set(names[seen]) == {
        "joint_position", "joint_velocity", "joint_target_error", "joint_command_velocity", "leg_momentum",
        "leg_momentum_rate",
    }  # fmt: skip
    assert "joint_position" not in set(names[visible(replace(TINY, posture=False))])


def test_a_minute_of_flight_is_enough_to_foresee_half_of_what_moving_joints_do(tmp_path):
    path = learn(replace(TINY, out=tmp_path))
    curve = json.loads((path.parent / "curve.json").read_text())
    assert curve["chosen"]["score"] < -0.15
    learned = read_artifact(path)
    hidden = ~visible(TINY)
    np.testing.assert_array_equal(learned.weights[0][:, hidden], 0.0)
    assert learned.training["steps"] == curve["chosen"]["steps"] > 6 * 480


def test_the_same_seed_gives_the_same_bytes_however_many_processes_fly(tmp_path, monkeypatch):
    monkeypatch.setattr(supervised, "RESPONSE_TICKS", 40)
    monkeypatch.setitem(TRACKS, "flight-fast3", replace(TRACKS["flight-fast3"], seconds=2.0))
    args = replace(TINY, flights=2, updates=5)
    first, second = (learn(replace(args, out=tmp_path / str(n), workers=n)) for n in (1, 2))
    assert first.read_bytes() == second.read_bytes()
    alone = Referee(args.tracks, Base(args.arguments), args.scenarios, control=CONTROL)
    assert json.loads((second.parent / "curve.json").read_text())["base"] == alone.means
    assert learn(replace(args, seed=1, out=tmp_path / "other")).read_bytes() != first.read_bytes()


def test_a_share_of_a_residual_is_that_share_of_its_output():
    layers = ((np.ones((2, 3)), np.ones(2)), (np.ones((6, 2)), np.ones(6)))
    weak = weakened(layers, 0.3)
    np.testing.assert_array_equal(weak[0][0], layers[0][0])
    np.testing.assert_allclose(weak[1][0], 0.3)
    np.testing.assert_allclose(weak[1][1], 0.3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"flights": 0}, "flights = 0 is not valid"),
        ({"tracks": ("ground-paper",)}, "a crawl has no pose to hold"),
        ({"tracks": ("flight-to-mars",)}, "unknown track"),
    ],
)
def test_settings_that_cannot_be_learned_with_are_refused(change, words):
    with pytest.raises((InvalidValueError, UnknownNameError), match=words):
        replace(TINY, **change)
