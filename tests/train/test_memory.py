"""Pins the residual with a memory: flights match the fit, errors in wind decrease, and the artifact is correct."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
import torch

from spidar_gym.benchmark.track import TRACKS
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies import external
from spidar_gym.policies.artifact import read_artifact
from train import memory
from train.lib.config import override
from train.lib.response import respond
from train.lib.run import State
from train.memory import (
    OBSERVATION,
    PRESETS,
    Records,
    artifact,
    fit,
    fly,
    input_scale,
    learn,
    network_inputs,
    responder,
    silent,
    turned,
)

pytestmark = pytest.mark.train
TINY = override(
    PRESETS["hover"], tracks=("flight-wind", "flight-fast3"), robots=4, rounds=1, forms=1, scenarios=1, updates=150,
    hidden=8, batch=2, workers=1,
)  # fmt: skip


def linear_response(seed=0, ticks=60):
    """Return a decaying response of six errors to six entries."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(6, 6, 1)) * np.exp(-np.arange(ticks) / 8.0) * 0.01


def test_a_product_of_spectra_is_the_convolution():
    response, forces = linear_response(), torch.randn(3, 90, 3, generator=torch.Generator().manual_seed(0))
    kernel = torch.tensor(response[:, :, ::-1].copy(), dtype=torch.float32)
    expected = [respond(kernel, torch.cat([each, torch.zeros_like(each)], dim=1)) for each in forces]
    torch.testing.assert_close(responder(response)(forces), torch.stack(expected), atol=1e-6, rtol=1e-4)


def test_the_fit_cancels_errors_caused_by_the_external_force_and_leaves_the_others():
    rng, response = np.random.default_rng(1), linear_response()
    size, sent = network_inputs(TINY.fit), responder(response)
    records = {}
    for track, told in (("windy", 1.0), ("calm", 0.0)):
        inputs = rng.normal(size=(6, 160, size)).astype(np.float32) * (0.2 + told)
        # The first traces, after the current force and the first integral, determine a force.
        cause = 0.3 * told * inputs[..., external.SIZE : external.SIZE + 3]
        noise = 0.002 * rng.normal(size=(6, 160, 6)).astype(np.float32)
        errors = sent(torch.tensor(cause)).numpy() + noise
        records[track] = Records(inputs, np.zeros((6, 160, 6), np.float32), errors)
    scale = input_scale(records)
    config = replace(TINY.fit, updates=400)
    found = fit(config, records, response, scale, 0, lambda _: None)

    def left(own):
        x = own.inputs / np.where(scale > 0.0, scale, 1.0) * (scale > 0.0)
        pair = [np.tanh(each @ found.hidden.T + found.bias) for each in (x, x * turned(config))]
        forces = (pair[0] - pair[1]) @ found.last.T + x @ found.skip.T
        errors = own.errors + sent(torch.tensor(forces, dtype=torch.float32)).numpy()
        return float(np.sqrt(np.square(errors[:, 40:]).mean() / np.square(own.errors[:, 40:]).mean()))

    assert left(records["windy"]) < 0.6
    assert left(records["calm"]) < 1.1
    assert not found.hidden[:, scale == 0.0].any(), "ignored inputs have weights"
    assert not found.skip[:, turned(config) > 0.0].any(), "absolute values have skip weights"


def test_the_output_is_odd_in_the_external_force():
    rng, config = np.random.default_rng(3), TINY.fit
    quiet = silent(config)
    shapes = (quiet.hidden, quiet.bias, quiet.last, quiet.skip * (turned(config) < 0.0) + quiet.skip)
    loud = memory.Weights(*(rng.normal(size=each.shape) for each in shapes))
    loud.skip[:, turned(config) > 0.0] = 0.0
    net = artifact(TINY, loud, np.full(network_inputs(config), 3.0), State())
    seen = 0.3 * rng.normal(size=(5, OBSERVATION + network_inputs(config)))
    other = seen.copy()
    other[:, OBSERVATION:] *= turned(config)
    small = replace(net, weights=(net.weights[0], 0.01 * net.weights[1]), skip=0.01 * net.skip)
    np.testing.assert_allclose(small.act(other), -small.act(seen), atol=1e-6)
    assert np.abs(small.act(seen)[:, :3]).min() > 0.0
    assert not small.act(seen)[:, 3:].any()


def test_the_artifact_flies_as_the_fit_saw_it_and_the_silent_one_is_the_base():
    rng, config = np.random.default_rng(2), TINY.fit
    quiet = silent(config)
    scale = np.full(network_inputs(config), 3.0)
    scale[:6] = 0.0
    base = fly(TINY, artifact(TINY, quiet, scale, State()), 0, "flight-wind")
    assert base.inputs.shape == (4, 800, network_inputs(config))
    assert not base.actions.any()
    again = fly(TINY, artifact(TINY, quiet, scale, State()), 0, "flight-wind")
    np.testing.assert_array_equal(base.inputs, again.inputs)
    loud = replace(quiet, skip=0.02 * rng.normal(size=quiet.skip.shape))
    loud.skip[:, :9] = 0.0
    flown = fly(TINY, artifact(TINY, loud, scale, State()), 0, "flight-wind")
    expected = flown.inputs[..., 9:] / 3.0 @ loud.skip[:, 9:].T
    np.testing.assert_allclose(flown.actions[..., :3], expected, atol=1e-5)
    assert not flown.actions[..., 3:].any(), "no torque is learned"


def test_it_reduces_errors_in_wind_and_makes_no_other_error_worse(tmp_path):
    args = override(TINY, robots=16, updates=300, scenarios=4, hidden=12, batch=4, workers=2)
    path = learn(override(args, out=tmp_path))
    curve = json.loads((path.parent / "curve.json").read_text())
    cells = curve["curve"][-1]["cells"]
    assert cells["flight-wind"]["position_rms_m"] < -0.03
    assert max(value for cell in cells.values() for value in cell.values()) <= 0.02
    learned = read_artifact(path)
    assert not learned.weights[0][:, : OBSERVATION + 6].any()
    assert learned.training["steps"] > 8 * (800 + 480)


def test_the_same_seed_gives_the_same_bytes_however_many_processes_fly(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "RESPONSE_TICKS", 40)
    for name in TINY.tracks:
        monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=3.0))
    args = override(TINY, updates=4, robots=2)
    first, second = (learn(override(args, out=tmp_path / str(n), workers=n)) for n in (1, 2))
    assert first.read_bytes() == second.read_bytes()
    assert learn(override(args, seed=1, out=tmp_path / "other")).read_bytes() != first.read_bytes()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robots": 0}, "robots = 0 is not valid"),
        ({"tracks": ("ground-paper",)}, "crawls and paths have no single pose to hold"),
        ({"tracks": ("flight-path",)}, "crawls and paths have no single pose to hold"),
        ({"tracks": ("flight-to-mars",)}, "unknown track"),
    ],
)
def test_settings_that_cannot_be_learned_with_are_refused(change, words):
    with pytest.raises((InvalidValueError, UnknownNameError), match=words):
        override(TINY, **change)
