"""Pins the artifact of a learned policy: what is written is what acts, and what is refused."""

import io
import json
import math
import time
import zipfile
from dataclasses import fields, replace
from functools import cache
from itertools import pairwise

import gymnasium
import numpy as np
import pytest

from spidar_gym.benchmark.track import CRAWL, HOVER
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.policies import artifact as artifacts
from spidar_gym.policies.artifact import (
    Artifact,
    ArtifactError,
    LearnedPolicy,
    Washout,
    interface,
    read_artifact,
    write_artifact,
)
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import Policy, defined_on, policy_digest, policy_doc, policy_kind


@cache
def sizes(env_id):
    """Numbers of an observation, of an action."""
    shown = interface(env_id, {})
    return sum(size for _, size, _ in shown["observation"]), shown["action"]


def network(shape, seed=0, scale=1.0):
    """Weights and biases of a network with these layers."""
    rng = np.random.default_rng(seed)
    pairs = list(pairwise(shape))
    weights = tuple((scale * rng.normal(size=(n, m)) / np.sqrt(m)).astype(np.float32) for m, n in pairs)
    return weights, tuple((scale * 0.3 * rng.normal(size=n)).astype(np.float32) for _, n in pairs)


def made(shape=(3, 8, 5, 2), *, seed=0, scale=1.0, **options):
    weights, biases = network(shape, seed, scale)
    rng = np.random.default_rng(seed + 1)
    known = {"name": "net", "kind": "learned", "doc": "A net.", "env_id": HOVER, "arguments": {}}
    known |= {"mean": rng.normal(size=shape[0]), "variance": rng.uniform(0.2, 3.0, shape[0])}
    return Artifact(**(known | {"weights": weights, "biases": biases} | options))


def flier(env_id=HOVER, **options):
    """An artifact that fits its environment."""
    n, m = sizes(env_id)
    training = {"seed": 3, "steps": 1000, "curve": [[0, 0.1], [1000, 0.5]], "command": "train ½"}
    return made((n, 6, 5, m), **({"env_id": env_id, "training": training} | options))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("artifacts") / "net.npz"
    write_artifact(flier(), path)
    return path


def rewritten(path, folder, *, change=lambda meta: None, arrays=None, drop=()):
    """A copy with other words, other arrays, or fewer parts."""
    copy = folder / "copy.npz"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(copy, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "policy.json":
                meta = json.loads(data)
                change(meta)
                data = json.dumps(meta).encode()
            if name.removesuffix(".npy") in (arrays or {}):
                buffer = io.BytesIO()
                np.save(buffer, arrays[name.removesuffix(".npy")])
                data = buffer.getvalue()
            if name not in drop:
                new.writestr(name, data)
    return copy


def same(a, b):
    """Whether two artifacts are equal, arrays bit for bit and with their types."""
    for part in fields(Artifact):
        x, y = getattr(a, part.name), getattr(b, part.name)
        if part.name in ("weights", "biases", "mean", "variance", "washout"):
            x, y = (list(v) if isinstance(v, tuple) else [v] for v in (x, y))
            if [(v.dtype, v.shape, v.tobytes()) for v in x] != [(v.dtype, v.shape, v.tobytes()) for v in y]:
                return False
        elif x != y:
            return False
    return True


def refused(path):
    with pytest.raises(ArtifactError) as caught:
        read_artifact(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"env_id": CRAWL, "kind": "residual", "activation": "relu", "output": "tanh", "clip": 5.0, "doc": "½ ‖x‖"},
        {"arguments": {"preset": "tuned"}, "training": {}},
        {"washout": np.array([0.5, 0.0, 2.0, 1e-9, 0.0, 1e9])},
    ],
)
def test_an_artifact_is_read_as_it_was_written(tmp_path, options):
    original = flier(**options)
    write_artifact(original, tmp_path / "net.npz")
    again = read_artifact(tmp_path / "net.npz")
    assert same(again, original)
    for observation in np.random.default_rng(5).normal(size=(20, len(original.mean))):
        assert again.act(observation).tobytes() == original.act(observation).tobytes()


def test_the_same_artifact_gives_the_same_bytes_at_any_time(written, tmp_path, monkeypatch):
    monkeypatch.setattr(time, "localtime", lambda *_: time.struct_time((2001, 2, 3, 4, 5, 6, 5, 34, 0)))
    write_artifact(flier(), tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == written.read_bytes()
    write_artifact(read_artifact(written), tmp_path / "read.npz")
    assert (tmp_path / "read.npz").read_bytes() == written.read_bytes()
    for other in (flier(seed=1), flier(washout=np.full(6, 0.5))):
        write_artifact(other, tmp_path / "other.npz")
        assert (tmp_path / "other.npz").read_bytes() != written.read_bytes()


def test_numpy_can_open_the_arrays_without_this_package(written):
    with np.load(written, allow_pickle=False) as found:
        np.testing.assert_array_equal(found["weight1"], flier().weights[1])
        np.testing.assert_array_equal(found["variance"], flier().variance)


def answer(net, observation):
    """The action in double precision, entry by entry."""
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
    # Something is left to compare.
    assert np.mean(np.abs(found) < 0.99) > 0.3
    assert np.ptp(found, axis=0).min() > 0.1


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
    """Shows what enters the network, a tenth of it."""
    known = {"weights": (0.1 * np.eye(3, dtype=np.float32),), "biases": (np.zeros(3, np.float32),)}
    known |= {"mean": np.array([1.0, 2.0, 3.0]), "variance": np.array([4.0, 0.25, 1.0])}
    return made((3, 3), **(known | options))


def test_observations_are_normalised_and_clipped():
    net = linear(clip=2.0)
    np.testing.assert_allclose(net.act(np.array([3.0, 2.5, 3.5])), [0.1, 0.1, 0.05], atol=1e-7)
    np.testing.assert_allclose(net.act(np.array([-1e6, 3.5, 1.5])), [-0.2, 0.2, -0.15], atol=1e-7)
    # No other bound than the artifact's own.
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


def test_a_file_that_is_no_artifact_is_refused(tmp_path):
    path = tmp_path / "net.npz"
    assert "valid: a learned policy's artifact" in refused(path)
    path.mkdir()
    refused(path)
    path.rmdir()
    for data in (b"", b"garbage", b"PK\x03\x04" + bytes(100), np.random.default_rng(0).bytes(3000)):
        path.write_bytes(data)
        assert "is no artifact" in refused(path)
    np.savez(path, weight0=np.ones(3))
    assert "policy.json" in refused(path)


def test_half_an_artifact_is_refused(written, tmp_path):
    whole, path = written.read_bytes(), tmp_path / "net.npz"
    for length in np.linspace(0, len(whole) - 1, 60).astype(int).tolist():
        path.write_bytes(whole[:length])
        assert "is no artifact" in refused(path)


def test_an_artifact_with_a_wrong_byte_is_refused_or_not_harmed(written, tmp_path, monkeypatch):
    shown = interface(HOVER, {})
    monkeypatch.setattr(artifacts, "interface", lambda *_: shown)
    whole, path, original, count = written.read_bytes(), tmp_path / "net.npz", read_artifact(written), 0
    rng = np.random.default_rng(0)
    for place in rng.integers(len(whole), size=300).tolist():
        data = bytearray(whole)
        data[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(data))
        try:
            assert same(read_artifact(path), original)
        except ArtifactError:
            count += 1
    assert count > 100


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("mean", "normaliser"),
        ("variance", "normaliser"),
        ("washout", "action"),
        ("weight0", "network"),
        ("weight2", "network"),
        ("bias1", "network"),
    ],
)
def test_an_artifact_without_one_of_its_arrays_is_refused(written, tmp_path, name, what):
    message = refused(rewritten(written, tmp_path, drop=(f"{name}.npy",)))
    assert f"lacks {name} of its {what}" in message


def test_an_artifact_without_its_words_is_refused(written, tmp_path):
    assert "is no artifact" in refused(rewritten(written, tmp_path, drop=("policy.json",)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda meta: meta.update(format=1), "has format 1; valid: format 2"),
        (lambda meta: meta.pop("format"), "has format None; valid: format 2"),
        (
            lambda meta: meta.update(env_id="spidar_gym/Hover-v9"),
            "was learned in spidar_gym/Hover-v9; valid: .*Hover-v0",
        ),
        (lambda meta: meta.update(model_sha256="0" * 64), "learned on another robot model; valid: "),
        (lambda meta: meta["interface"].update(action=7), r"another interface of .*\(bounds or action\)"),
        (lambda meta: meta["interface"]["observation"].pop(3), r"another interface .*\(angular_velocity_error\)"),
        (lambda meta: meta["interface"]["observation"].reverse(), "another interface"),
        (lambda meta: meta.update(arguments={"action_mode": "direct"}), "another interface"),
    ],
)
def test_an_artifact_from_elsewhere_is_refused(written, tmp_path, change, message):
    path = rewritten(written, tmp_path, change=change)
    with pytest.raises(ArtifactError, match=message):
        read_artifact(path)
    refused(path)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda shown: shown["observation"][2].__setitem__(1, 4), "attitude_error"),
        (lambda shown: shown["observation"].append(["temperature", 1, 1.0]), "temperature"),
        (lambda shown: shown["observation"][2].__setitem__(2, 9.0), "bounds or action"),
        (lambda shown: shown.update(action=8), "bounds or action"),
    ],
)
def test_an_artifact_is_refused_when_the_environment_has_changed_since(written, monkeypatch, change, named):
    shown = interface(HOVER, {})
    monkeypatch.setattr(artifacts, "interface", lambda *_: shown)
    read_artifact(written)
    change(shown)
    assert f"another interface of {HOVER} ({named})" in refused(written)


@pytest.mark.parametrize(
    "arrays",
    [
        {"weight0": np.zeros((6, 5), np.float32)},
        {"bias2": np.zeros(5, np.float32)},
        {"weight1": np.full((5, 6), np.nan, np.float32)},
        {"variance": np.zeros(207)},
        {"mean": np.full(207, np.inf)},
        {"mean": np.zeros(3)},
        {"washout": np.full(6, -1.0)},
        {"washout": np.ones(5)},
    ],
)
def test_an_artifact_with_other_arrays_is_refused(written, tmp_path, arrays):
    assert "expected" in refused(rewritten(written, tmp_path, arrays=arrays))


@pytest.mark.parametrize(("inputs", "outputs"), [(3, 6), (207, 4)])
def test_a_network_of_other_sizes_than_its_environment_has_is_refused(tmp_path, inputs, outputs):
    write_artifact(made((inputs, 4, outputs)), tmp_path / "net.npz")
    assert f"a network from {inputs} to {outputs}; valid: (207, 6)" in refused(tmp_path / "net.npz")


@pytest.mark.parametrize("change", [{"activation": "elu"}, {"output": "softmax"}, {"kind": "clever"}])
def test_an_artifact_with_words_that_do_not_exist_is_refused(written, tmp_path, change):
    assert "valid: " in refused(rewritten(written, tmp_path, change=lambda meta: meta.update(change)))


@pytest.mark.parametrize("key", ["env_id", "model_sha256", "interface", "arguments", "layers", "training", "clip"])
def test_an_artifact_that_lacks_a_word_is_refused(written, tmp_path, key):
    refused(rewritten(written, tmp_path, change=lambda meta: meta.pop(key)))


class Trap:
    """Bites whoever unpickles it."""

    def __reduce__(self):
        return pytest.fail, ("unpickled",)


def test_no_pickle_in_an_artifact_is_opened(written, tmp_path):
    trap = np.array([Trap()], object)
    assert "is no artifact" in refused(rewritten(written, tmp_path, arrays={"weight1": trap}))


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_learned_policy_is_defined_on_its_own_environment_only(tmp_path, env_id):
    write_artifact(flier(env_id, arguments={"preset": "tuned"} if env_id == HOVER else {}), tmp_path / "net.npz")
    policy = LearnedPolicy(read_artifact(tmp_path / "net.npz"))
    assert defined_on(policy) == [env_id]
    assert policy.arguments(env_id) == ({"preset": "tuned"} if env_id == HOVER else {})


def test_a_path_is_a_policy_with_the_name_kind_and_words_of_its_artifact(tmp_path):
    path = tmp_path / "some.npz"
    write_artifact(flier(name="ppo", kind="residual", doc="Adds to it."), path)
    policy = load_policy(str(path))
    assert isinstance(policy, LearnedPolicy)
    assert isinstance(policy, Policy)
    assert (policy.name, policy_kind(policy), policy_doc(policy)) == ("ppo", "residual", "Adds to it.")
    assert policy.training["seed"] == 3
    observation = np.random.default_rng(6).normal(size=207)
    policy.reset(0)
    np.testing.assert_array_equal(policy.act(observation), flier().act(observation))
    with pytest.raises(ArtifactError, match=r"none\.npz"):
        load_policy(str(tmp_path / "none.npz"))


def test_the_digest_of_a_learned_policy_is_that_of_its_file(written, tmp_path):
    digest = policy_digest(load_policy(str(written)))
    copy = tmp_path / "copy.npz"
    copy.write_bytes(written.read_bytes())
    assert policy_digest(load_policy(str(copy))) == digest
    write_artifact(flier(seed=1), copy)
    assert policy_digest(load_policy(str(copy))) != digest


@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_an_artifact_whose_last_layer_is_zero_is_the_controller_itself(tmp_path, output):
    net = flier(output=output)
    net = replace(
        net, weights=(*net.weights[:-1], 0.0 * net.weights[-1]), biases=(*net.biases[:-1], 0.0 * net.biases[-1])
    )
    write_artifact(net, tmp_path / "net.npz")
    policy = LearnedPolicy(read_artifact(tmp_path / "net.npz"))
    seen = []
    for act in (policy.act, lambda _: np.zeros(6)):
        env = gymnasium.make(HOVER, **(policy.arguments(HOVER) or {})).unwrapped
        observation, _ = env.reset(seed=0)
        for _ in range(4):
            action = act(observation)
            assert not np.any(action)
            observation = env.step(action)[0]
        seen.append(observation)
        env.close()
    np.testing.assert_array_equal(seen[0], seen[1])


def test_an_artifact_that_is_no_network_says_what_is_expected():
    with pytest.raises(InvalidValueError, match=r"weights = \(8, 4\) .*expected \(8, 3\)"):
        made(weights=network((4, 8, 5, 2))[0])


def test_a_constant_answer_is_washed_out():
    """Over one time constant to a part in e; soon after, nothing is left."""
    washout, action = Washout(np.array([0.5, 0.2])), np.array([0.8, -1.0], np.float32)
    found = np.array([washout(action) for _ in range(400)])
    time = np.arange(1, 401)[:, None] / CONTROL_RATE
    np.testing.assert_allclose(found, action * np.exp(-time / [0.5, 0.2]), atol=1e-7)
    assert found[19, 0] == pytest.approx(0.8 / math.e)


def test_a_washout_lets_pass_what_is_fast_and_stays_within_bounds():
    rng, washout = np.random.default_rng(0), Washout(np.full(3, 1e6))
    actions = rng.uniform(-1.0, 1.0, (200, 3))
    np.testing.assert_allclose([washout(action) for action in actions], actions, atol=1e-5)
    turned = Washout(np.array([0.1]))
    found = np.array([turned(np.array([1.0 if k < 40 else -1.0])) for k in range(80)])
    assert found[40] == -1.0, "from the bound to the other one is 2"
    assert np.abs(found).max() == 1.0


def test_entries_without_a_washout_pass_untouched():
    rng, some = np.random.default_rng(1), Washout(np.array([0.0, 0.3, 0.0]))
    for dtype in (np.float32, np.float64):
        for action in rng.normal(scale=5.0, size=(50, 3)).astype(dtype):
            found = some(action)
            assert found.dtype == dtype
            assert found[[0, 2]].tobytes() == action[[0, 2]].tobytes()
            assert found[1] != action[1]
            for none in (Washout(np.zeros(0)), Washout(np.zeros(3))):
                assert none(action).tobytes() == action.tobytes()


def test_a_silent_policy_stays_silent_through_a_washout():
    washout = Washout(np.array([0.5, 0.0]))
    assert not any(washout(np.zeros(2, np.float32)).any() for _ in range(100))


def test_an_action_is_left_as_it_was_by_a_washout():
    washout, action = Washout(np.array([0.5, 0.0])), np.array([0.3, 0.4])
    washout(action)
    assert action.tolist() == [0.3, 0.4]


@pytest.mark.parametrize("time", [-0.1, np.nan, np.inf])
def test_a_washout_of_no_time_is_refused(time):
    with pytest.raises(InvalidValueError, match=r"washout = .* at least 0"):
        Washout(np.array([0.5, time]))


def test_a_learned_policy_washes_out_and_forgets_at_a_reset(tmp_path):
    times = np.array([0.5, 0.5, 0.5, 0.0, 0.0, 0.0])
    write_artifact(flier(washout=times), tmp_path / "net.npz")
    policy, washout = LearnedPolicy(read_artifact(tmp_path / "net.npz")), Washout(times)
    observations = np.random.default_rng(7).normal(size=(30, 207))
    expected = [washout(flier().act(observation)) for observation in observations]
    for seed in (0, 1):
        policy.reset(seed)
        np.testing.assert_array_equal([policy.act(observation) for observation in observations], expected)
    assert np.abs(policy.act(observations[0]) - expected[0]).max() > 0.01, "without a reset it remembers"
