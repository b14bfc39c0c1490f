"""An adversary's artifacts: mutated, rebuilt and inflated; each is refused in one line, or is a policy that acts."""

import io
import json
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.control.allocation.allocator import MOST_ITERATIONS
from spidar_gym.policies import artifact as artifacts
from spidar_gym.policies.artifact import ArtifactError, LearnedPolicy, interface, read_artifact

LEARNED = Path(__file__).resolve().parents[2] / "baselines/learned"
ORIGINALS = [(LEARNED / name).read_bytes() for name in ("ppo_paper/seed0.npz", "learned_gait/seed1.npz")]
MOST_SECONDS, MOST_MEMORY = 1.0, 200_000_000
"""Largest effort of a refusal: processor time [s], memory [bytes]."""
VALUES = (
    None, True, 0, -1, 5, 10**9, 2**40, 2**63 - 1, 2**70, 1.5, -1e308, 1e999, float("nan"), "", "x", "a\nb", "\x1b[2J",
    "\ud800", "é" * 300, "x" * 200_000, "../../etc/passwd", [], [[]], [None], {}, {"a": {"b": []}}, [[1, 2, 3]] * 50,
)  # fmt: skip
HEADERS = (
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
    "{'descr': '<f4', 'fortran_order': True, 'shape': (64, 64), }",
    "{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 64), }",
    "{'descr': '<f4', 'fortran_order': False, 'shape': (0, 1000000000000000000000), }",
    "{'descr': [('a', '<f8')] * 1000, 'fortran_order': False, 'shape': (3,), }",
    "{'descr': __import__('os').getcwd(), 'fortran_order': False, 'shape': (3,), }",
    "(" * 9000,
    "-" * 9000 + "1",
    "{'descr': '<f8', 'fortran_order'",
)


def parts(data):
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(content, method=zipfile.ZIP_STORED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, part in content.items():
            archive.writestr(name, part)
    return buffer.getvalue()


def flipped(data, rng):
    """A few bits changed."""
    out = bytearray(data)
    for place in rng.integers(len(out), size=rng.integers(1, 9)):
        out[place] ^= 1 << rng.integers(8)
    return bytes(out)


def cut(data, rng):
    """Truncated, with a part removed or replaced, or with additional bytes."""
    a, b = sorted(rng.integers(len(data) + 1, size=2).tolist())
    return (data[:a], data[:a] + data[b:], data[:a] + rng.bytes(b - a) + data[b:], data + data[a:b])[rng.integers(4)]


def directory(data, rng):
    """A number in the zip's headers changed: sizes, offsets, methods, flags."""
    out = bytearray(data)
    at = data.index((b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06")[rng.integers(3)]) + int(rng.integers(4, 46))
    size = int(rng.integers(1, 5))
    out[at : at + size] = (b"\xff" * size, bytes(size), rng.bytes(size))[rng.integers(3)]
    return bytes(out)


def places(value, at=()):
    """Path to every place in a JSON value."""
    yield at
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in inside:
        yield from places(each, (*at, key))


def reworded(data, rng):
    """One or two values of `policy.json` replaced, removed or added, anywhere."""
    content = parts(data)
    meta = json.loads(content["policy.json"])
    for _ in range(rng.integers(1, 3)):
        # More often near the root than deep in the observation's pieces.
        everywhere = [at for at in places(meta) if at]
        shallow = [at for at in everywhere if at[0] != "interface" and at[:2] != ("training", "curve")]
        *path, last = (shallow if rng.random() < 0.7 else everywhere)[rng.integers(len(shallow))]
        parent = meta
        for key in path:
            parent = parent[key]
        action = rng.integers(4)
        if action == 0:
            del parent[last]
        elif action == 1 and isinstance(parent, dict):
            parent[("max_iter", "render_mode", "plant", "controller", "a\nb", "x" * 999)[rng.integers(6)]] = 2**40
        else:
            parent[last] = VALUES[rng.integers(len(VALUES))]
    content["policy.json"] = json.dumps(meta).encode()
    return packed(content)


def retyped(data, rng):
    """A `policy.json` that is no JSON, or has too much of it."""
    content = parts(data)
    content["policy.json"] = (
        b"", b"null", b"[]", b"{", b"\xff\xfe", b"[" * 100_000, b'{"a":' * 50_000, b"1" * 5000, b" " * 6_000_000,
        b'"' + b"x" * 3_000_000 + b'"', b"[" + b"[]," * 900_000 + b"[]]",
    )[rng.integers(11)]  # fmt: skip
    return packed(content)


def reshaped(data, rng):
    """An array of another type, size or content, or under another name."""
    content = parts(data)
    name = [name for name in content if name.endswith(".npy")][rng.integers(len(content) - 1)]
    array = np.load(io.BytesIO(content[name]))
    other = (
        array.astype(np.float64), array.astype(np.float16), array.astype(int), array.astype(complex), array != 0.0,
        array.astype("S8"), array.T, array[..., :-1], array[None], np.zeros(0), np.float32(1.0), array * np.nan,
        array + np.inf, -array, 1e30 * array, np.zeros((1200, 1200), np.float32), np.array(["x", {}], object),
    )[rng.integers(17)]  # fmt: skip
    buffer = io.BytesIO()
    np.save(buffer, other)
    content[(name, name, "bias7.npy", "x\ny.npy", "weight0.npy")[rng.integers(5)]] = buffer.getvalue()
    return packed(content)


def reheaded(data, rng):
    """An array whose header does not describe its content."""
    content = parts(data)
    name = [name for name in content if name.endswith(".npy")][rng.integers(len(content) - 1)]
    header = HEADERS[rng.integers(len(HEADERS))].encode() + b"\n"
    body = content[name][128:] if rng.random() < 0.5 else b""
    content[name] = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + body
    return packed(content)


def compressed(data, rng):
    """The same content, compressed and mostly damaged."""
    out = packed(parts(data), (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)[rng.integers(3)])
    return out if rng.random() < 0.3 else flipped(out, rng)


def bomb(data, rng):
    """A small file that is large when unpacked."""
    content = parts(data)
    content[("weight0.npy", "policy.json", "mean.npy")[rng.integers(3)]] = bytes(1) * 60_000_000
    return packed(content, zipfile.ZIP_DEFLATED)


def crowded(data, rng):
    """A zip with very many entries."""
    count = int(rng.integers(300, 100_000))
    entry = b"PK\x01\x02" + bytes(24) + (1).to_bytes(2, "little") + bytes(16) + b"x"
    tail = b"PK\x05\x06" + bytes(4) + b"\xff\xff" * 2 + (len(entry) * count).to_bytes(4, "little") + bytes(6)
    return entry * count + tail


def large(data, rng):
    """More bytes than any network has."""
    return data + bytes(40_000_000)


MUTATIONS = (flipped, cut, directory, reworded, reworded, reworded, retyped, reshaped, reheaded, compressed)
RARE = (bomb, crowded, large)


@pytest.fixture
def quick(monkeypatch):
    """Cache the environments' interfaces, so that the reader alone is measured."""
    known = {}

    def once(env_id, arguments):
        key = json.dumps([env_id, arguments], sort_keys=True)
        if key not in known:
            known[key] = interface(env_id, arguments)
        return json.loads(json.dumps(known[key]))

    monkeypatch.setattr(artifacts, "interface", once)
    for data in ORIGINALS:
        meta = json.loads(parts(data)["policy.json"])
        once(meta["env_id"], meta["arguments"])


def attempt(path, *, memory=False):
    """The policy of a file, or None if the file was refused in one line that states what would be valid.

    Args:
        path: File.
        memory: Whether memory is measured, which is slow, instead of time.
    """
    policy, message = None, "valid"
    began = time.process_time()
    if memory:
        tracemalloc.start()
    try:
        policy = LearnedPolicy(read_artifact(path))
    except ArtifactError as error:
        message = str(error)
    if memory:
        assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
        tracemalloc.stop()
    else:
        assert time.process_time() - began < MOST_SECONDS
    assert message.isprintable()
    assert len(message) < 600 + len(str(path))
    assert "valid" in message or "expected" in message
    return policy


def test_no_mutated_artifact_gets_past_the_border_but_as_a_policy_that_acts(quick, tries, rng, tmp_path):
    path, refused = tmp_path / "hostile.npz", 0
    count = tries(1800)
    for k in range(count):
        kinds = RARE if k % 25 == 24 else MUTATIONS
        data = kinds[k % len(kinds)](ORIGINALS[rng.integers(len(ORIGINALS))], rng)
        path.write_bytes(data)
        policy = attempt(path, memory=bool(rng.integers(2)))
        refused += policy is None
        if policy is not None:
            policy.reset(0)
            with np.errstate(all="ignore"):
                action = policy.act(np.zeros(len(policy.artifact.mean)))
            assert action.shape == policy.artifact.biases[-1].shape
            assert np.abs(action[np.isfinite(action)]).max(initial=0.0) <= 1.0
    assert 0.6 * count < refused < count


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"layers": 10**9}, "layers = 1000000000 is not valid; expected 1 … 8"),
        ({"layers": -1}, "layers = -1 is not valid"),
        ({"training": 5}, r"policy\.json\['training'\] is int, not dict"),
        ({"training": {"steps": "many"}}, "training's steps is str, not int"),
        ({"arguments": {"max_iter": 2**40}}, f"max_iter = {2**40} is not valid.*at most {MOST_ITERATIONS}"),
        ({"arguments": {"max_iter": True}}, "max_iter is bool, not int"),
        ({"arguments": {"render_mode": "human"}}, "unknown argument of the environment 'render_mode'; valid: action_m"),
        ({"arguments": {"controller": {"mass": 1}}}, "unknown argument of the environment 'controller'"),
        ({"interface": {"observation": 5, "action": 6}}, "is int, not a list"),
        ({"clip": float("nan")}, "not finite"),
        ({"doc": "a\nb"}, "its doc is not a line"),
        ({"name": "x" * 10_000}, "its name is not a line"),
    ],
)
def test_words_beyond_their_ranges_are_refused_by_name(change, words, tmp_path):
    content = parts(ORIGINALS[0])
    meta = json.loads(content["policy.json"])
    content["policy.json"] = json.dumps({**meta, **change}).encode()
    path = tmp_path / "net.npz"
    path.write_bytes(packed(content))
    with pytest.raises(ArtifactError, match=words):
        read_artifact(path)


def test_a_network_of_too_many_layers_or_too_wide_ones_is_refused(tmp_path):
    def written(sizes):
        content = parts(ORIGINALS[0])
        meta = json.loads(content["policy.json"])
        n, m = len(np.load(io.BytesIO(content["mean.npy"]))), meta["interface"]["action"]
        shape = (n, *sizes, m)
        meta["layers"] = len(shape) - 1
        content["policy.json"] = json.dumps(meta).encode()
        for k in range(meta["layers"]):
            for name, array in ((f"weight{k}", np.zeros((shape[k + 1], shape[k]), np.float32)),
                                (f"bias{k}", np.zeros(shape[k + 1], np.float32))):  # fmt: skip
                buffer = io.BytesIO()
                np.save(buffer, array)
                content[f"{name}.npy"] = buffer.getvalue()
        path = tmp_path / "net.npz"
        path.write_bytes(packed(content))
        return path

    assert attempt(written((1024,) * 7)) is not None, "the largest one"
    with pytest.raises(ArtifactError, match="widest layer = 1025 is not valid; expected at most 1024"):
        read_artifact(written((1025,)))
    with pytest.raises(ArtifactError, match="layers = 9"):
        read_artifact(written((4,) * 8))
