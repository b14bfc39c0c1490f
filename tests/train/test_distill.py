"""Pins imitation of a teacher: lessons are its commands, units of the loss, and bit-identical results per seed."""

import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
import torch

from spidar_gym.errors import InvalidValueError
from spidar_gym.policies import torso
from spidar_gym.policies.artifact import read_artifact
from train.distill import PRESETS, learn
from train.lib.config import override
from train.lib.run import CheckpointError, Run
from train.lib.student import FORCE, NET_FORCE, Shelf, Student, loss_of
from train.lib.taught import Lessons, TaughtFlights

pytestmark = pytest.mark.train
TINY = override(
    PRESETS["hover"], tracks=("flight-fast3", "flight-wind"), robots=2, first_ticks=30, rounds=3, ticks=12,
    validations=1, scenarios=1, workers=1, hidden=16, first_updates=20, updates=5, batch=32, room=400,
)  # fmt: skip


def test_the_teachers_answers_flown_one_tick_late_keep_errors_small():
    flights, rng = TaughtFlights(("flight-forms",), "tuned", 3, 1, (1.0,)), np.random.default_rng(0)
    said = flights.fly(None, 60, rng).answers[-3:]
    worst = 0.0
    for _ in range(40):
        said = flights.fly(lambda _, last=said: last, 1, rng).answers
        errors = flights._vectors[0].robots["position_error"]
        worst = max(worst, float(np.linalg.norm(errors, axis=1).max()))
    flights.close()
    assert not flights.led.any()
    assert 0.0 < worst < 0.03


def test_what_is_seen_is_what_a_flight_without_a_controller_shows():
    flights = TaughtFlights(("flight-randomised",), "tuned", 2, 2, ())
    alone = flights._vectors[0].buffers["observations"].copy()
    flights.fly(None, 20, np.random.default_rng(0))
    seen = flights._seen
    names = ("position_integral", "attitude_integral")
    np.testing.assert_array_equal(seen[:, torso.entries(*names)], alone[:, torso.entries(*names)])
    assert np.ptp(
        flights._vectors[0].buffers["observations"][:, torso.entries(*names)] - alone[:, torso.entries(*names)]
    )
    flights.close()


def test_the_loss_counts_forces_and_what_they_add_up_to_in_their_units():
    answers, levers, one = torch.zeros(1, 40), torch.zeros(1, 8, 3), torch.ones(1)

    def loss(said):
        return (2.0 * (loss_of(said, answers, levers, one).item() + 1.0)) ** 2 - 4.0

    said = answers.clone()
    said[0, 0] = 1.0 / torso.FORCE
    assert loss(said) == pytest.approx(1.0 / FORCE**2 + 1.0 / NET_FORCE**2, rel=1e-3)
    said[0, 3] = -1.0 / torso.FORCE  # opposite: the total wrench of the two is zero
    assert loss(said) == pytest.approx(2.0 / FORCE**2, rel=1e-3)
    said = answers.clone()
    said[0, 30] = 1.0  # joint outputs are not part of the loss
    assert loss(said) == 0.0
    levers[0, 0, 1] = 0.5
    said = answers.clone()
    said[0, 2] = 1.0 / torso.FORCE
    assert loss(said) > 1.0 / FORCE**2 + 1.0 / NET_FORCE**2 + 1.0


def test_a_full_shelf_keeps_the_latest_lessons():
    def lessons(value, rows):
        return Lessons(np.full((rows, 2), value), np.zeros((rows, 40)), np.zeros((rows, 8, 3)), np.ones(rows))

    shelf = Shelf(10, lessons(1.0, 6))
    assert shelf.count == 6
    shelf.add(lessons(2.0, 7))
    drawn = shelf.draw(np.random.default_rng(0), 1000)[0][:, 0]
    assert shelf.count == 10
    assert float((drawn == 2.0).float().mean()) == pytest.approx(0.7, abs=0.06)


def test_equal_seeds_yield_equal_bytes_and_traces_are_optional(tmp_path):
    first, again = (learn(override(TINY, out=tmp_path / name)) for name in ("a", "b"))
    assert first.read_bytes() == again.read_bytes()
    net = read_artifact(first)
    assert len(net.mean) == torso.FEATURES + 12 * len(TINY.trace_times)
    other = read_artifact(learn(override(TINY, seed=1, trace_times=(), out=tmp_path / "c")))
    assert len(other.mean) == torso.FEATURES
    assert other.act(np.zeros(torso.SHOWN)).shape == (40,)
    assert not np.any(other.weights[-1][24:]), "joint outputs are zero"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the artifact's bytes of a run without interruption."""
    return learn(override(TINY, out=tmp_path_factory.mktemp("whole"))).read_bytes()


def interrupted(args, monkeypatch, owner, name, n):
    """Interrupt a run at the n-th call of a method; return the note of its `KeyboardInterrupt`."""
    call, left = getattr(owner, name), iter(range(n - 1, -1, -1))

    def count(*arguments):
        if next(left) == 0:
            raise KeyboardInterrupt
        return call(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, count)
        with pytest.raises(KeyboardInterrupt) as stop:
            learn(args)
    return stop.value.__notes__[0]


@pytest.mark.parametrize(
    ("where", "stops"),
    [
        ((Student, "learn"), (3,)),  # before the first checkpoint
        ((Student, "learn"), (24, 1, 8)),  # in round 1, again right after resuming, and in round 2
        ((Lessons, "write"), (3,)),  # between the lessons of a round and its checkpoint
        ((Run, "publish"), (1,)),  # in the validation of the last round
        ((Run, "publish"), (2,)),  # at the end of the run
    ],
)
def test_an_interrupted_run_resumes_and_ends_with_the_same_bytes(where, stops, whole, tmp_path, monkeypatch):
    args = override(TINY, out=tmp_path)
    for n in stops:
        words = interrupted(args, monkeypatch, *where, n)
        assert re.match(rf"\d of 3 rounds kept in {tmp_path}.*; the same command resumes$", words)
    path = learn(args)
    assert path.read_bytes() == whole
    assert not (path.parent / "lessons").exists(), "lessons of a completed run remain"
    assert learn(args).read_bytes() == whole, "resuming a completed run changed the artifact"


def test_lessons_that_are_not_those_of_the_run_are_refused_in_one_line(tmp_path, monkeypatch):
    args = override(TINY, out=tmp_path)
    interrupted(args, monkeypatch, Run, "publish", 1)
    (path,) = tmp_path.rglob("lessons/0001.npz")
    whole = path.read_bytes()
    for damaged in (whole[:-9], whole.replace(b"answers", b"answerz"), b"", whole[:999] + b"?" + whole[1000:]):
        path.write_bytes(damaged)
        with pytest.raises(CheckpointError, match=r"^[^\n]*0001.npz holds [^\n]*; valid: [^\n]*$"):
            learn(args)
    (other,) = tmp_path.rglob("lessons/0000.npz")
    path.write_bytes(other.read_bytes())
    with pytest.raises(CheckpointError, match=r"holds other lessons; valid: 48 of \d+ inputs"):
        learn(args)


def test_a_network_is_equivariant_to_quarter_turns_up_to_a_constant(tmp_path):
    found = read_artifact(learn(override(TINY, out=tmp_path)))
    free = read_artifact(learn(override(TINY, symmetric=False, out=tmp_path / "free")))
    turn, shown = (
        torso.shown_turn(12 * len(TINY.trace_times)),
        np.random.default_rng(0).normal(size=(9, len(found.mean))),
    )

    def said(net, shown):
        x = (shown - net.mean) / np.sqrt(net.variance)
        first, second, last = net.weights
        hidden = np.maximum(
            second @ np.maximum(first @ x.T + net.biases[0][:, None], 0.0) + net.biases[1][:, None], 0.0
        )
        return (last @ hidden + net.skip @ x.T).T

    loudest = np.abs(said(found, shown)).max()
    assert loudest > 0.01
    np.testing.assert_allclose(said(found, turn(shown)), torso.SAID_TURN(said(found, shown)), atol=1e-5 * loudest)
    assert np.abs(said(free, turn(shown)) - torso.SAID_TURN(said(free, shown))).max() > 0.01
    assert np.abs(found.biases[-1] - torso.SAID_TURN(found.biases[-1])).max() > 0.0


@pytest.mark.parametrize(
    "changes", [{"robots": 0}, {"tracks": ("ground-paper",)}, {"tracks": ("flight-path",)}, {"rounds": 0}]
)
def test_invalid_settings_are_refused(changes):
    with pytest.raises(InvalidValueError):
        replace(TINY, **changes)


def test_each_leg_has_as_many_units():
    with pytest.raises(InvalidValueError, match="hidden = 18 is not valid; expected a multiple of 4"):
        override(TINY, hidden=18)
