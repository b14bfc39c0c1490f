"""Pins the validation of outside input: exact round trips, and refusals before anything is built."""

import io
import json
import os
import tracemalloc
import zipfile

import numpy as np
import pytest

from spidar_gym.border import MOST_DEPTH, MOST_PARTS, BorderError, pack, parse_json, read_file, require_form, unpack
from spidar_gym.errors import SpidarError
from spidar_gym.robot import RobotSpec
from spidar_gym.sim.randomize import Randomization

ARRAYS = {
    "matrix": np.arange(6.0).reshape(2, 3).T,
    "single": np.array(3.5, np.float32),
    "none": np.zeros((0, 4)),
    "whole": np.array([1, -(2**62)]),
    "bytes": np.arange(7, dtype=np.uint8),
    "nan": np.array([np.nan, np.inf]),
}
WORDS = {"name": "½ ‖x‖", "numbers": [1, 2.5, None, True], "none": {}}


@pytest.fixture(params=[False, True], ids=["open", "sealed"])
def sealed(request):
    return request.param


def test_a_bundle_is_read_as_it_was_packed(sealed):
    data = pack("words.json", WORDS, ARRAYS, sealed=sealed)
    words, arrays = unpack("words.json", data, sealed=sealed)
    assert words == WORDS
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        found = arrays[name]
        assert (found.dtype, found.shape) == (array.dtype, array.shape)
        assert found.tobytes() == array.tobytes()
        assert found.flags.writeable
    assert pack("words.json", WORDS, ARRAYS, sealed=sealed) == data


def test_numpy_opens_a_bundle_sealed_or_not(sealed):
    with np.load(io.BytesIO(pack("w.json", WORDS, ARRAYS, sealed=sealed)), allow_pickle=False) as found:
        for name, array in ARRAYS.items():
            np.testing.assert_array_equal(found[name], array)


def test_every_flipped_bit_and_every_lost_byte_of_a_sealed_bundle_is_detected():
    data = pack("w.json", {"a": 1}, {"x": np.arange(3)}, sealed=True)
    for place in range(len(data)):
        for bit in range(8):
            damaged = bytearray(data)
            damaged[place] ^= 1 << bit
            with pytest.raises(BorderError, match="checksum"):
                unpack("w.json", bytes(damaged), sealed=True)
        with pytest.raises(BorderError, match="checksum"):
            unpack("w.json", data[:place], sealed=True)


def archive(parts, **options):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", **options) as file:
        for name, part in parts:
            file.writestr(name, part)
    return buffer.getvalue()


def npy(header, data=b"", magic=b"\x93NUMPY\x01\x00"):
    text = header.encode() + b"\n"
    return magic + len(text).to_bytes(2, "little") + text + data


def header(descr="<f8", order="False", shape="(3,)"):
    return f"{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}"


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (npy(header(shape="(1000000000000,)"), bytes(24)), "another size than its header states"),
        (npy(header(shape="(0, 1000000000000000000000)")), "no shape"),
        (npy(header(shape="(9223372036854775807, 9223372036854775807)"), bytes(24)), "another size"),
        (npy(header(shape="(" + "1," * 40 + ")"), bytes(8)), "no array|no shape"),
        (npy(header(shape="(-1,)"), bytes(8)), "no array"),
        (npy(header("|O"), bytes(24)), "no array"),
        (npy(header("|V8"), bytes(24)), "no array"),
        (npy(header(order="True"), bytes(24)), "no array"),
        (npy(header() + "(" * 5000, bytes(24)), "no array"),
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (3", bytes(24)), "no array"),
        (npy(header(), bytes(23)), "another size"),
        (npy(header(), bytes(24), b"\x93NUMPY\x03\x00"), "no array"),
        (b"", "no array"),
    ],
)
def test_an_array_that_contradicts_its_header_is_refused_before_it_is_built(part, words):
    assert "x" in unpack("w.json", archive([("w.json", "{}"), ("x.npy", npy(header(), bytes(24)))]))[1]
    tracemalloc.start()
    with pytest.raises(BorderError, match=words):
        unpack("w.json", archive([("w.json", "{}"), ("x.npy", part)]))
    assert tracemalloc.get_traced_memory()[1] < 2_000_000
    tracemalloc.stop()


def test_compressed_parts_are_refused_before_they_are_unpacked():
    bomb = archive([("w.json", "{}"), ("x.npy", npy(header(shape="(10000000,)"), bytes(80_000_000)))],
                   compression=zipfile.ZIP_DEFLATED, compresslevel=1)  # fmt: skip
    assert len(bomb) < 1_000_000
    tracemalloc.start()
    with pytest.raises(BorderError, match="compressed"):
        unpack("w.json", bomb)
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


def test_parts_that_overlap_are_refused():
    """A part of one megabyte listed under 200 names would expand to 200 megabytes."""
    data = archive([("w.json", "{}"), ("x000.npy", npy(header("|u1", shape="(1000000,)"), bytes(1_000_000)))])
    begin = data.rindex(b"PK\x01\x02")
    end = data.index(b"PK\x05\x06")
    entry, tail = data[begin:end], bytearray(data[end:])
    more = b"".join(entry.replace(b"x000", b"x%03d" % k) for k in range(1, 200))
    tail[8:10] = tail[10:12] = (202).to_bytes(2, "little")
    directory = int.from_bytes(tail[12:16], "little") + len(more)
    tail[12:16] = directory.to_bytes(4, "little")
    with pytest.raises(BorderError, match=r"larger than the file|no bundle"):
        unpack("w.json", data[:end] + more + bytes(tail))


def test_a_directory_of_a_million_parts_is_not_read():
    entry = archive([("w.json", "")])
    entry = entry[entry.index(b"PK\x01\x02") : entry.index(b"PK\x05\x06")]
    data = entry * (MOST_PARTS + 1)
    tail = b"PK\x05\x06" + bytes(4) + b"\xff\xff" * 2 + len(data).to_bytes(4, "little") + bytes(6)
    with pytest.raises(BorderError, match=f"more than {MOST_PARTS} parts"):
        unpack("w.json", data + tail)


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ([("x.npy", npy(header(), bytes(24)))], r"no w\.json"),
        ([("w.json", "{}"), ("w.json", "{}")], "same name"),
        ([("w.json", "{}"), ("code.py", "")], "no array"),
        ([("w.json", "{")], "no JSON"),
        ([("w.json", b"\xff")], "no JSON"),
        ([("w.json", " " * 2_000_000)], "more than"),
    ],
)
def test_a_bundle_of_other_parts_is_refused(parts, words):
    with pytest.raises(BorderError, match=words):
        unpack("w.json", archive(parts))


@pytest.mark.parametrize("text", ["NaN", "[1e999]", "-Infinity", str(2**63), '"\\ud800"', '{"\\udfff": 1}', "1" * 5000,
                                  "[" * 100_000, "[" * (MOST_DEPTH + 1) + "1" + "]" * (MOST_DEPTH + 1), "",
                                  "{'a': 1}"])  # fmt: skip
def test_json_that_cannot_be_serialised_again_or_is_too_deep_is_refused(text):
    with pytest.raises(BorderError) as caught:
        parse_json(text.encode())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [WORDS, [], 2**63 - 1, -1e308, "", None, True, [[[[1]]]]])
def test_json_within_bounds_is_unchanged(value):
    assert parse_json(json.dumps(value).encode()) == value


@pytest.mark.parametrize(
    ("value", "form"),
    [
        (1, int), (1, float), (1.5, float), ("a", str), (True, bool), (None, (int, None)), ([], [int]),
        ([1, 2], [int]), (["a", 1, 2.0], [str, int, float]), ({"a": 1, "b": [[1.0]]}, {"a": int, "b": [[float]]}),
        ({"any": 1, "name": 2}, {str: int}), ({}, {str: int}), ({"x": 1}, dict),
    ],
)  # fmt: skip
def test_a_value_of_the_form_passes(value, form):
    require_form(value, form, "it")


@pytest.mark.parametrize(
    ("value", "form", "words"),
    [
        (True, int, "it is bool, not int"), (True, float, "not float"), (1, bool, "not bool"), (1.0, int, "not int"),
        (None, str, "it is NoneType, not str"), ("1", (int, None), "not int"), ({}, [int], "not a list"),
        ([1, "a"], [int], r"it\[1\] is str"), (["a", 1], [str, int, float], "2 entries, not 3"),
        ([], {"a": int}, "not an object"), ({"a": 1}, {"a": int, "b": int}, "lacks b"),
        ({"a": 1, "c\n": 1}, {"a": int}, r"has 'c\\n'; valid: a"), ({"x\n": "y"}, {str: int}, r"it\['x\\n'\] is str"),
        ({"a": [{"b": None}]}, {"a": [{"b": str}]}, r"it\['a'\]\[0\]\['b'\] is NoneType"),
    ],
)  # fmt: skip
def test_a_value_of_another_form_is_refused_with_the_place_of_the_error(value, form, words):
    with pytest.raises(BorderError, match=words) as caught:
        require_form(value, form, "it")
    assert "\n" not in str(caught.value)


def test_only_regular_files_within_their_size_are_read(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    assert read_file(path, 5) == b"12345"
    with pytest.raises(BorderError, match="more than 4 bytes"):
        read_file(path, 4)
    with pytest.raises(BorderError, match="No such file"):
        read_file(tmp_path / "none", 4)
    with pytest.raises(BorderError, match="no regular file"):
        read_file(tmp_path, 4)
    with pytest.raises(BorderError, match="null"):
        read_file(tmp_path / "a\0b", 4)
    os.mkfifo(tmp_path / "pipe")  # without a writer
    with pytest.raises(BorderError, match="no regular file"):
        read_file(tmp_path / "pipe", 4)


@pytest.mark.parametrize("option", ["robot", "randomization"])
def test_toml_of_many_levels_is_refused_in_one_line(tmp_path, option):
    deep = tmp_path / "deep.toml"
    deep.write_text("a = " + "[" * 20000)
    parse = {"robot": RobotSpec.parse, "randomization": Randomization.parse}[option]
    with pytest.raises(SpidarError, match=f"{option}: .* cannot be read: no TOML") as error:
        parse(str(deep))
    assert "\n" not in str(error.value)
