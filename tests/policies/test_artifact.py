"""Pins the file of a learned policy: round trips, and rejection of invalid files."""

import io
import json
import time
import zipfile
from dataclasses import fields

import numpy as np
import pytest
from support.artifacts import flier, made
from support.networks import feeling

from spidar_gym.benchmark.track import CRAWL, HOVER
from spidar_gym.control.flight.observation import layout
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies import artifact as artifacts
from spidar_gym.policies import torso
from spidar_gym.policies.artifact import (
    LATER,
    Artifact,
    ArtifactError,
    LearnedPolicy,
    interface,
    read_artifact,
    write_artifact,
)


def rewritten(path, folder, *, change=lambda meta: None, arrays=None, drop=()):
    """Write a copy with changed metadata, changed arrays, or fewer parts."""
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
    """Return whether two artifacts are equal, with arrays equal bit for bit and of equal types."""
    for part in fields(Artifact):
        x, y = getattr(a, part.name), getattr(b, part.name)
        if part.name in (
            "weights",
            "biases",
            "mean",
            "variance",
            "washout",
            "rotor_lag",
            "traced",
            "trace_times",
            "skip",
        ):
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
        (lambda meta: meta.update(format=1), "has format 1; valid: format 2 or 3"),
        (lambda meta: meta.pop("format"), "has format None; valid: format 2 or 3"),
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
    """Fails the test when it is unpickled."""

    def __reduce__(self):
        return pytest.fail, ("unpickled",)


def test_no_pickle_in_an_artifact_is_opened(written, tmp_path):
    trap = np.array([Trap()], object)
    assert "is no artifact" in refused(rewritten(written, tmp_path, arrays={"weight1": trap}))


def remembering(**options):
    """Build a network in torso axes with traces of three entries at two time constants, and a skip matrix."""
    size, rng = torso.FEATURES + 6, np.random.default_rng(4)
    return made(
        (size, 7, 40), env_id=HOVER, arguments={"action_mode": "direct"}, output="torso",
        traced=np.array([0.0, 2.0, 5.0]), trace_times=np.array([0.2, 1.0]),
        skip=rng.normal(size=(40, size)).astype(np.float32), **options,
    )  # fmt: skip


def test_a_network_with_traces_and_a_skip_in_torso_axes_is_read_as_it_was_written_and_acts(tmp_path):
    net = remembering()
    write_artifact(net, tmp_path / "net.npz")
    found = read_artifact(tmp_path / "net.npz")
    assert same(net, found)
    assert (found.sees, found.answers) == (torso.OBSERVATION, 40)
    x = np.random.default_rng(5).normal(size=(3, torso.SHOWN + 6))
    seen = np.concatenate([torso.features(x[:, :-6]), x[:, -6:]], axis=1)
    inputs = np.clip((seen - net.mean) / np.sqrt(net.variance), -net.clip, net.clip)
    hidden = np.tanh(inputs @ net.weights[0].T + net.biases[0])
    last = hidden @ net.weights[1].T + net.biases[1] + inputs @ net.skip.T
    action = found.act(x)
    np.testing.assert_allclose(action, torso.command(last, x[:, :-6]), atol=1e-4)
    for row in range(3):
        np.testing.assert_array_equal(found.act(x[row]), action[row])


def test_a_file_of_format_2_states_the_version_of_its_controller(tmp_path):
    write_artifact(flier(arguments={"preset": "tuned"}), tmp_path / "net.npz")
    assert read_artifact(tmp_path / "net.npz").arguments == {"preset": "tuned"}
    old = rewritten(
        tmp_path / "net.npz", tmp_path, change=lambda meta: meta.update(format=2), drop=[f"{n}.npy" for n in LATER]
    )
    assert read_artifact(old).arguments == {"preset": "tuned_v1"}


def test_a_file_of_format_2_is_read_as_a_network_that_sees_the_present_alone(tmp_path):
    write_artifact(flier(), tmp_path / "net.npz")
    old = rewritten(
        tmp_path / "net.npz", tmp_path, change=lambda meta: meta.update(format=2), drop=[f"{n}.npy" for n in LATER]
    )
    assert same(read_artifact(old), flier())


def test_a_network_that_is_shown_the_external_force_is_read_as_it_was_written(tmp_path):
    net = feeling()
    write_artifact(net, tmp_path / "net.npz")
    found = read_artifact(tmp_path / "net.npz")
    assert same(net, found)
    assert (found.sees, found.answers) == (sum(f.size for f in layout(6)), 6)
    assert LearnedPolicy(found).behind.share == pytest.approx(1.0 - np.exp(-0.5))
    assert LearnedPolicy(flier()).behind is None


@pytest.mark.parametrize("name", LATER)
def test_a_file_of_format_3_without_a_part_is_refused(tmp_path, name):
    write_artifact(flier(), tmp_path / "net.npz")
    assert f"lacks {name} of its network" in refused(
        rewritten(tmp_path / "net.npz", tmp_path, drop=[f"{name}.npy"])
    )  # fmt: skip


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"skip": np.zeros((2, 4), np.float32)}, r"\(2, 3\), or none"),
        ({"output": "torso"}, "193 and traces to 40"),
        ({"traced": np.array([0.5]), "trace_times": np.ones(1)}, "entries within 0 … 1"),
        ({"traced": np.array([2.0]), "trace_times": np.ones(1)}, "entries within 0 … 1"),
        ({"traced": np.array([0.0]), "trace_times": -np.ones(1)}, "at least 0"),
    ],
)
def test_a_memory_that_does_not_fit_is_refused(options, expected):
    with pytest.raises(InvalidValueError, match=expected):
        made(**options)
