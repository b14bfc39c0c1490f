"""Pins serialised values: they are read as written, shared objects stay shared, and no code is executed."""

import json
import math
import time
from collections import OrderedDict, deque
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
import pytest
from support.episodes import same

from spidar_gym.control.flight.path import Path
from spidar_gym.control.presets import PRESETS
from spidar_gym.envs.serialization.values import find_class, pack_values, unpack_values
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.state import RobotState


@dataclass(frozen=True)
class Limits:
    """Its constructor refuses the values which it is changed to later."""

    low: float
    high: float = 1.0

    def __post_init__(self):
        assert self.low < self.high


@dataclass(slots=True)
class Slotted:
    """A dataclass without `__dict__`."""

    numbers: np.ndarray


class Pair(NamedTuple):
    """A named tuple."""

    left: Any
    right: Any


class Word(Enum):
    """An enumeration."""

    ONE = "one"
    TWO = 2


HERE = {__name__}
ARRAYS = {
    "matrix": np.arange(6.0).reshape(2, 3),
    "turned": np.arange(6.0).reshape(2, 3).T,
    "strided": np.arange(12.0)[::3],
    "single": np.array(3.5, np.float32),
    "none": np.zeros((0, 4)),
    "flags": np.array([True, False]),
    "whole": np.array([-(2**62), 7]),
    "small": np.array([3], np.uint8),
    "text": np.array(["a", "bc"]),
    "complex": np.array([1.0 + 2.0j]),
    "odd": np.array([np.nan, np.inf, -0.0, 5e-324]),
}
VALUES: dict[str, Any] = {
    "nothing": None, "flag": True, "number": 0.1, "zero": -0.0, "infinite": [math.inf, -math.inf], "whole": -3,
    "wide": 2**200, "text": "½ ‖x‖", "bytes": b"\x00\xff", "list": [1, [2.5, "a"]], "tuple": (1, (2,)), "empty": (),
    "set": {1, 2}, "frozen": frozenset({"a"}), "dict": {"a": 1, (1, 2): [3], 4: {}}, "deque": deque([1, 2], 5),
    "numpy": [np.float64(0.1), np.float32(0.1), np.int8(-3), np.bool_(True), np.str_("a")],
    "limits": Limits(0.5), "slotted": Slotted(np.ones(2)), "pair": Pair(1, [2]), "words": [Word.ONE, Word.TWO],
    "preset": PRESETS["tuned"],
}  # fmt: skip


def again(values: dict[str, Any], modules=HERE) -> dict[str, Any]:
    return unpack_values(*pack_values(values, modules), modules)


@pytest.mark.parametrize("name", VALUES)
def test_a_value_is_read_as_it_was_written(name):
    found = again({name: VALUES[name]})[name]
    assert type(found) is type(VALUES[name])
    assert same(found, VALUES[name])
    if name == "zero":
        assert math.copysign(1.0, found) == -1.0
    if name == "deque":
        assert found.maxlen == 5
    if name == "numpy":
        assert [type(each) for each in found] == [type(each) for each in VALUES[name]]


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_keeps_its_bits_and_its_order_in_memory(name):
    array = ARRAYS[name]
    found = again({"it": array})["it"]
    assert (found.dtype, found.shape, found.tobytes()) == (array.dtype, array.shape, array.tobytes())
    assert found.flags.writeable
    if name != "strided":
        assert found.flags.f_contiguous == array.flags.f_contiguous
    array = array.copy()
    array.flags.writeable = False
    assert not again({"it": array})["it"].flags.writeable


def test_read_objects_are_new_and_shared_objects_stay_shared():
    shared, rows = [1], np.zeros(3)
    found = again({"first": {"a": shared, "b": rows}, "second": (shared, rows, rows[:2])})
    assert found["first"]["a"] is found["second"][0] is not shared
    assert found["first"]["b"] is found["second"][1] is not rows
    assert found["second"][2] is not found["second"][1]


def test_without_sharing_equal_values_give_equal_bytes():
    array = np.zeros(3)
    one, other = {"a": array, "b": array}, {"a": array.copy(), "b": array.copy()}
    whole = [b"".join(part.tobytes() for part in pack_values(each, shared=False)) for each in (one, other)]
    assert whole[0] == whole[1]
    assert not np.array_equal(pack_values(one)[0], pack_values(other)[0])


def test_a_generator_draws_and_spawns_on():
    rng = np.random.default_rng(7)
    rng.random(5)
    rng.integers(10, dtype=np.int32)  # leaves half a word in the generator
    rng.spawn(2)
    child = rng.spawn(1)[0]
    found = again({"rng": rng, "child": child, "wide": np.random.default_rng(2**190)})
    for own, other in ((found["rng"], rng), (found["child"], child)):
        assert own.bit_generator.state == other.bit_generator.state
        assert np.array_equal(own.random(5), other.random(5))
        assert own.spawn(1)[0].random() == other.spawn(1)[0].random()
    with pytest.raises(InvalidValueError, match="Generator of PCG64"):
        again({"rng": np.random.Generator(np.random.MT19937(1))})


def test_a_dataclass_is_read_as_it_was_even_if_its_constructor_would_refuse_it():
    odd = Limits(0.5)
    object.__setattr__(odd, "low", 3.0)
    assert again({"odd": odd})["odd"].low == 3.0
    marked = Limits(0.5)
    object.__setattr__(marked, "note", "mine")
    with pytest.raises(SpidarError, match=r"^marked\.note is a builtins\.str, which cannot be saved"):
        again({"marked": marked})


INSIDE: list[Any] = [1]
INSIDE.append(INSIDE)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (print, r"^it is a builtins\.builtin_function_or_method, which cannot be saved; valid: numbers, text, arrays"),
        ({"a": [1, lambda x: x]}, r"^it\.a\[1\] is a builtins\.function"),
        (Limits, r"^it is a builtins\.type"),
        (object(), r"^it is a builtins\.object"),
        (OrderedDict(), r"^it is a collections\.OrderedDict"),
        (np.array([None]), r"^it is a numpy\.ndarray"),
        (np.zeros(1, [("a", "f8")]), r"^it is a numpy\.ndarray"),
        (np.datetime64("2020-01-01"), r"^it is a numpy\.datetime64"),
        (INSIDE, r"^it\[1\] is a builtins\.list"),
    ],
    ids=["function", "lambda inside", "class", "object", "ordered", "objects", "records", "date", "itself"],
)  # fmt: skip
def test_unsupported_values_are_refused_with_their_place_in_one_line(value, words):
    with pytest.raises(SpidarError, match=words) as error:
        pack_values({"it": value})
    assert "\n" not in str(error.value)


def test_classes_are_those_of_the_package_and_of_the_modules_that_are_named():
    assert find_class("spidar_gym.state:RobotState", ()) is RobotState
    assert find_class(f"{__name__}:Pair", HERE) is Pair
    for name in (
        f"{__name__}:Pair", "os:system", "builtins:eval", "subprocess:Popen",
        "spidar_gym.envs.serialization.values:pack_values",
        "spidar_gym.native.plant:Plant", "spidar_gym.state:RobotState.__init__", "spidar_gym.nowhere:It", "", ":",
    ):  # fmt: skip
        assert find_class(name, ()) is None
    with pytest.raises(SpidarError, match=r"^it is a .*Limits, which cannot be saved"):
        pack_values({"it": Limits(0.5)})
    words, numbers = pack_values({"it": Limits(0.5)}, HERE)
    with pytest.raises(SpidarError, match=r"no class .*Limits here; valid: those of the environment"):
        unpack_values(words, numbers)


def test_a_dataclass_that_had_other_fields_is_refused():
    words, numbers = pack_values({"path": Path(np.zeros(1), *np.zeros((3, 1, 4)))})
    told = np.frombuffer(words.tobytes().replace(b'"rate_w"', b'"rates"'), np.uint8)
    with pytest.raises(SpidarError, match="Path had other fields when it was saved"):
        unpack_values(told, numbers)


@pytest.mark.parametrize(
    "node",
    [
        *(["array", kind, [1], "C", True, 0] for kind in ("|O8", "(1,)i4,O", "f8", "")),
        *(["array", "<f8", shape, "C", True, 0] for shape in ([10**12], [-1], [[1]], [2], None)),
        ["array", "<f8", [1], "C", True, -80], ["array", "<f8", [1], "X", True, 0], ["number", "|O8", 0],
        ["number", "<f8", 1], ["eval", "1"], ["kind", "os:system"],
        ["value", [0]], ["list", [[5]]], ["list", 3], ["dict", [[1]]], ["dict", [[[0], 1]]], ["data", "os:system", {}],
        ["named", "spidar_gym.state:RobotState", [1]], ["word", "spidar_gym.state:RobotState", 1], ["int", "ten"],
        ["generator", {}], ["float"], [], "list", None,
    ],
    ids=str,
)  # fmt: skip
def test_malformed_words_are_refused_and_nothing_runs(node):
    words = json.dumps({"nodes": [["list", []], node], "values": [["it", [1]]]}).encode()
    with pytest.raises(SpidarError) as error:
        unpack_values(np.frombuffer(words, np.uint8), np.zeros(8, np.uint8))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("words", [b"", b"{}", b"[]", b"null", b'{"nodes": [], "values": [["it", [0]]]}', b"\xff"])
def test_bytes_that_are_no_words_are_refused(words):
    with pytest.raises(SpidarError):
        unpack_values(np.frombuffer(words, np.uint8), np.zeros(0, np.uint8))


CHAIN: list[Any] = [["tuple", [1, 1]], *(["tuple", [[k], [k]]] for k in range(60))]
"""Tuples of two tuples of two tuples …: to hash it Python would visit 2⁶⁰ of them."""
STREAM = {"state": ["0x1", "0x3"], "half": [0, 0], "entropy": 1, "key": [0], "spawned": 0}


@pytest.mark.parametrize(
    ("nodes", "numbers"),
    [
        ([*CHAIN, ["set", [[60]]]], b""), ([*CHAIN, ["dict", [[[60], 1]]]], b""), ([["int", "f" * 10**5]], b""),
        ([["array", "|b1", [2], "C", True, 0]], b"\2\1"), ([["array", "<U1", [1], "C", True, 0]], b"\xff" * 4),
        ([["array", "<f8", [2**40, 2**40], "C", True, 0]], b""), ([["deque", [], -1]], b""),
        ([["tuple", []], ["generator", STREAM | {"state": ["0x1", "0x2"]}]], b""),  # a shorter period
        ([["tuple", []], ["generator", STREAM | {"half": [1, "no"]}]], b""),
        ([["tuple", []], ["generator", STREAM | {"state": ["0x1", hex(2**129 + 1)]}]], b""),
    ],
    ids=["set", "key", "whole", "flags", "text", "large", "deque", "stream", "half", "wide"],
)  # fmt: skip
def test_values_that_would_take_python_very_long_are_refused_at_once(nodes, numbers):
    words = json.dumps({"nodes": nodes, "values": [["it", [len(nodes) - 1]]]}).encode()
    began = time.process_time()
    with pytest.raises(SpidarError, match="these are no saved values"):
        unpack_values(np.frombuffer(words, np.uint8), np.frombuffer(numbers, np.uint8))
    assert time.process_time() - began < 0.5
    unpack_values(*pack_values({"it": np.random.default_rng(1)}))
