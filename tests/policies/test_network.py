"""Pins the network of a learned policy: outputs against double precision and torch, and invalid networks."""

import math

import numpy as np
import pytest
from support.artifacts import made, network

from spidar_gym.errors import InvalidValueError, SpidarError


def answer(net, observation):
    """Compute the action in double precision, entry by entry."""
    x = [(o - m) / math.sqrt(v) for o, m, v in zip(observation, net.mean, net.variance, strict=True)]
    x = [max(-net.clip, min(net.clip, entry)) for entry in x]
    for k, (w, b) in enumerate(zip(net.weights, net.biases, strict=True)):
        x = [sum(float(a) * c for a, c in zip(row, x, strict=True)) + float(d) for row, d in zip(w, b, strict=True)]
        if k < len(net.weights) - 1:
            x = [math.tanh(entry) if net.activation == "tanh" else max(0.0, entry) for entry in x]
    return [math.tanh(entry) if net.output == "tanh" else max(-1.0, min(1.0, entry)) for entry in x]


@pytest.mark.parametrize("shape", [(3, 2), (3, 8, 2), (4, 7, 5, 6, 3)])
@pytest.mark.parametrize("output", ["clip", "tanh"])
@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_an_action_is_that_of_the_network_in_double_precision(activation, output, shape):
    net = made(shape, activation=activation, output=output, clip=2.0)
    observations = np.random.default_rng(2).normal(scale=3.0, size=(50, shape[0]))
    found = np.array([net.act(observation) for observation in observations])
    np.testing.assert_allclose(found, [answer(net, o.tolist()) for o in observations], atol=1e-5)
    # The comparison is not trivial.
    assert np.mean(np.abs(found) < 0.99) > 0.3
    assert np.ptp(found, axis=0).min() > 0.1


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_an_action_is_summed_in_the_order_of_the_inputs_whatever_the_processor(activation, output):
    """The library of NumPy's products sums in an order of its processor; flights that sway differed by it."""
    skip = np.random.default_rng(5).normal(size=(40, 90)).astype(np.float32)
    net = made((90, 70, 33, 40), activation=activation, output=output, skip=skip)
    seen = np.random.default_rng(4).normal(size=(3, 7, 90))
    x = inputs = np.clip((seen - net.mean) / np.sqrt(net.variance), -net.clip, net.clip).astype(np.float32)
    for k, (w, b) in enumerate(zip(net.weights, net.biases, strict=True)):
        x = in_order(w, x) + b
        if k < len(net.weights) - 1:
            x = squashed(x) if activation == "tanh" else np.maximum(x, np.float32(0.0))
    x = x + in_order(skip, inputs)
    expected = squashed(x) if output == "tanh" else np.clip(x, -1.0, 1.0)
    np.testing.assert_array_equal(net.act(seen), expected)
    np.testing.assert_array_equal([[net.act(one) for one in rows] for rows in seen], expected)
    assert not np.array_equal(in_order(skip, inputs), inputs @ skip.T), "the order matters"


def in_order(w, x):
    """Return W x in single precision, summed in the order of x."""
    total = np.zeros((*x.shape[:-1], len(w)), np.float32)
    for j in range(w.shape[1]):
        total += w[:, j] * x[..., j, None]
    return total


def squashed(x):
    return np.tanh(x.astype(np.float64)).astype(np.float32)


@pytest.mark.train
@pytest.mark.parametrize("output", ["clip", "tanh"])
@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_an_action_is_that_of_torch(activation, output):
    torch = pytest.importorskip("torch")
    net = made((12, 32, 16, 4), activation=activation, output=output)
    layers = []
    for w, b in zip(net.weights, net.biases, strict=True):
        linear = torch.nn.Linear(w.shape[1], w.shape[0])
        with torch.no_grad():
            linear.weight.copy_(torch.from_numpy(w))
            linear.bias.copy_(torch.from_numpy(b))
        layers += [linear, torch.nn.Tanh() if activation == "tanh" else torch.nn.ReLU()]
    last = torch.nn.Tanh() if output == "tanh" else torch.nn.Hardtanh(-1.0, 1.0)
    model = torch.nn.Sequential(*layers[:-1], last)
    observations = np.random.default_rng(3).normal(size=(100, 12))
    normalised = np.clip((observations - net.mean) / np.sqrt(net.variance), -10.0, 10.0)
    with torch.no_grad():
        expected = model(torch.from_numpy(normalised.astype(np.float32))).numpy()
    np.testing.assert_allclose([net.act(o) for o in observations], expected, atol=1e-5)


def linear(**options):
    """Build a network whose output is a tenth of its scaled input."""
    known = {"weights": (0.1 * np.eye(3, dtype=np.float32),), "biases": (np.zeros(3, np.float32),)}
    known |= {"mean": np.array([1.0, 2.0, 3.0]), "variance": np.array([4.0, 0.25, 1.0])}
    return made((3, 3), **(known | options))


def test_observations_are_normalised_and_clipped():
    net = linear(clip=2.0)
    np.testing.assert_allclose(net.act(np.array([3.0, 2.5, 3.5])), [0.1, 0.1, 0.05], atol=1e-7)
    np.testing.assert_allclose(net.act(np.array([-1e6, 3.5, 1.5])), [-0.2, 0.2, -0.15], atol=1e-7)
    # The artifact's clip is the only bound.
    np.testing.assert_allclose(linear().act(np.array([13.0, -1.0, 1e9])), [0.6, -0.6, 1.0], atol=1e-7)


def test_an_observation_is_left_as_it_was_and_may_be_of_single_precision():
    observation = np.array([3.0, 2.5, 3.5])
    before, net = observation.copy(), linear()
    action = net.act(observation)
    np.testing.assert_array_equal(observation, before)
    np.testing.assert_allclose(net.act(observation.astype(np.float32)), action, atol=1e-7)
    assert action.dtype == np.float32


@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_no_action_leaves_its_bounds(output):
    net = made((3, 8, 2), scale=30.0, output=output)
    observations = np.random.default_rng(4).normal(scale=1e6, size=(200, 3))
    actions = np.array([net.act(observation) for observation in observations])
    assert np.abs(actions).max() == 1.0
    assert np.isfinite(actions).all()


@pytest.mark.parametrize(
    "options",
    [
        {"kind": "clever"},
        {"activation": "elu"},
        {"output": "softmax"},
        {"mean": np.array([0.0, np.nan, 0.0])},
        {"mean": np.array([0.0, np.inf, 0.0])},
        {"mean": np.zeros(4)},
        {"variance": np.array([1.0, 0.0, 1.0])},
        {"variance": np.array([1.0, -1.0, 1.0])},
        {"variance": np.array([1.0, np.nan, 1.0])},
        {"variance": np.array([1.0, np.inf, 1.0])},
        {"variance": np.ones(2)},
        {"mean": np.zeros((3, 1)), "variance": np.ones((3, 1))},
        {"clip": math.nan},
        {"clip": -1.0},
        {"washout": np.zeros(3)},
        {"washout": np.zeros((2, 1))},
        {"washout": np.zeros(2, int)},
        {"washout": np.array([0.0, -0.1])},
        {"washout": np.array([0.0, np.nan])},
        {"washout": np.array([np.inf, 0.0])},
        {"weights": (np.full((2, 3), np.nan, np.float32),), "biases": (np.zeros(2, np.float32),)},
        {"biases": (np.zeros(8), np.array([0.0, 0.0, np.inf, 0.0, 0.0]), np.zeros(2))},
        {"biases": network((3, 8, 5, 2))[1][:2]},
        {"biases": network((3, 8, 5, 3))[1]},
        {"weights": network((4, 8, 5, 2))[0]},
        {"weights": network((3, 8, 6, 2))[0]},
        {"weights": tuple(w.T for w in network((3, 8, 5, 2))[0])},
        {"weights": (), "biases": ()},
    ],
)
def test_what_is_no_network_is_refused(options):
    made()
    with pytest.raises(SpidarError, match=r"valid|expected"):
        made(**options)


def test_the_error_of_an_invalid_network_states_the_expected_shape():
    with pytest.raises(InvalidValueError, match=r"weights = \(8, 4\) .*expected \(8, 3\)"):
        made(weights=network((4, 8, 5, 2))[0])
