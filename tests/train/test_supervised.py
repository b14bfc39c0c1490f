"""Pins the supervised residual: inputs without errors, improvement of the base, and written files."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from spidar_gym.benchmark.track import TRACKS
from spidar_gym.control.flight.observation import layout
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.artifact import read_artifact
from train import supervised
from train.lib.config import CONTROL, override
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.stages import scalars
from train.supervised import PRESETS, learn, visible_entries, weakened

pytestmark = pytest.mark.train
TINY = override(
    PRESETS["hover-paper"], tracks=("flight-fast3",), rounds=1, flights=6, updates=150, forms=1, scenarios=2,
    hidden=16, workers=2, control=CONTROL,
)  # fmt: skip


def test_the_network_sees_the_joints_motion_and_no_error():
    seen = visible_entries(TINY.fit)
    names = np.concatenate([np.full(field.size, field.name) for field in layout(6)])
    assert set(names[seen]) == {
        "joint_position", "joint_velocity", "joint_target_error", "joint_command_velocity", "leg_momentum",
        "leg_momentum_rate",
    }  # fmt: skip
    assert "joint_position" not in set(names[visible_entries(replace(TINY.fit, posture=False))])


def test_a_minute_of_flight_is_enough_to_foresee_half_of_what_moving_joints_do(tmp_path):
    path = learn(override(TINY, out=tmp_path))
    curve = json.loads((path.parent / "curve.json").read_text())
    assert curve["chosen"]["score"] < -0.15
    learned = read_artifact(path)
    hidden = ~visible_entries(TINY.fit)
    np.testing.assert_array_equal(learned.weights[0][:, hidden], 0.0)
    assert learned.training["steps"] == curve["chosen"]["steps"] > 6 * 480


def test_the_same_seed_gives_the_same_bytes_however_many_processes_fly(tmp_path, monkeypatch):
    monkeypatch.setattr(supervised, "RESPONSE_TICKS", 40)
    monkeypatch.setitem(TRACKS, "flight-fast3", replace(TRACKS["flight-fast3"], seconds=2.0))
    args = override(TINY, flights=2, updates=5)
    first, second = (learn(override(args, out=tmp_path / str(n), workers=n)) for n in (1, 2))
    assert first.read_bytes() == second.read_bytes()
    alone = PairedEvaluator(args.tracks, Base(args.arguments), args.scenarios, control=CONTROL)
    assert json.loads((second.parent / "curve.json").read_text())["base"] == alone.means
    assert learn(override(args, seed=1, out=tmp_path / "other")).read_bytes() != first.read_bytes()


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
        ({"tracks": ("ground-paper",)}, "crawls and paths have no single pose to hold"),
        ({"tracks": ("flight-path",)}, "crawls and paths have no single pose to hold"),
        ({"tracks": ("flight-to-mars",)}, "unknown track"),
    ],
)
def test_settings_that_cannot_be_learned_with_are_refused(change, words):
    with pytest.raises((InvalidValueError, UnknownNameError), match=words):
        override(TINY, **change)


def test_the_regression_writes_its_loss_and_its_verdicts_for_tensorboard(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(supervised, "RESPONSE_TICKS", 40)
    monkeypatch.setitem(TRACKS, "flight-fast3", replace(TRACKS["flight-fast3"], seconds=1.0))
    args = override(
        PRESETS["hover-paper"], tracks=("flight-fast3",), rounds=2, flights=2, updates=7, forms=1, scenarios=1,
        hidden=8, workers=1, out=tmp_path,
    )  # fmt: skip
    path = learn(args)
    board = EventAccumulator(str(path.parent / "tensorboard"))
    board.Reload()
    curve = json.loads((path.parent / "curve.json").read_text())["curve"]
    losses = board.Scalars("train/loss")
    assert [event.step for event in losses] == list(range(14))
    assert losses[6].value < losses[0].value
    for name, value in scalars(curve[-1]):
        events = board.Scalars(name)
        assert len(events) == 2
        assert events[-1].value == pytest.approx(value, rel=1e-6)
    said = capfd.readouterr().err
    for stage, unit in (("evaluating the base", "scenario"), ("round 2 of 2, flying", "flight"), ("fitting", "update")):
        assert stage in said
        assert f"{unit}/s" in said or f"s/{unit}" in said
    assert "it/s" not in said
