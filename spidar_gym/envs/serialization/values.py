"""Serialisation of values as words and numbers: reading such a file runs no code, unlike a pickle.

A value follows the values that it contains in one list, so that these are read first. Shared values stay shared.
"""

import json
import math
import re
import sys
from collections import deque
from collections.abc import Collection
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cached_property
from typing import Any, NoReturn

import numpy as np

from spidar_gym.border import MOST_INTEGER, parse_json
from spidar_gym.errors import SpidarError, shown
from spidar_gym.native.draws import from_numpy

PACKAGE = __name__.partition(".")[0]
VALID = (
    "numbers, text, arrays, lists, tuples, sets, dictionaries, dataclasses, generators; anything in copy.deepcopy(env)"
)
"""Types that can be written."""
MOST_VALUES = 10**6
"""Limit of the values within a value, with repetitions."""
MOST_DIGITS = 1000
"""Limit of an integer's hexadecimal digits: Python prints no more."""
_CONTAINERS: dict[str, Any] = {kind.__name__: kind for kind in (list, tuple, set, frozenset)}
_KINDS = ("float", "int", "bytes", "array", "number", "deque", "dict", "generator", "word", "named", "data")
_DTYPE = re.compile(r"[<>|][biufcUS]\d+")


def pack_values(
    values: dict[str, Any], modules: Collection[str] = (), *, shared: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Return values as two arrays of bytes: words in JSON, and numbers.

    Args:
        values: Values by name, nested to any depth.
        modules: Modules besides this package's whose classes values may have.
        shared: Whether shared values are stored once; if not, equal values yield equal bytes.

    Raises:
        SpidarError: For a value of another type than those in `VALID`, with its path.
    """
    writer = _Writer(modules, shared=shared)
    root = [[name, writer.write(value, name)] for name, value in values.items()]
    words = json.dumps({"nodes": writer.nodes, "values": root}, separators=(",", ":")).encode()
    return np.frombuffer(words, np.uint8), np.frombuffer(bytes(writer.numbers), np.uint8)


def unpack_values(words: np.ndarray, numbers: np.ndarray, modules: Collection[str] = ()) -> dict[str, Any]:
    """Read values, all newly made (`SpidarError` for bytes that `pack_values` has not written, and unknown classes)."""
    try:
        told = parse_json(words.tobytes())
        reader = _Reader(numbers.tobytes(), modules)
        for node in told["nodes"]:
            reader.append(*node)
        return {name: reader.value(value) for name, value in told["values"]}
    except SpidarError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, MemoryError) as error:
        raise SpidarError(f"these are no saved values ({shown(error)}); valid: bytes from save_state()") from error


def find_class(name: str, modules: Collection[str]) -> Any:  # noqa: ANN401 - a class
    """Return a class that values may have, by `module:name`, or None. Nothing is imported."""
    module, _, path = name.partition(":")
    if not (module.partition(".")[0] == PACKAGE or module in modules):
        return None
    found: Any = sys.modules.get(module)
    for part in path.split("."):
        found = getattr(found, part, None)
    is_named = isinstance(found, type) and issubclass(found, tuple) and hasattr(found, "_fields")
    is_word = isinstance(found, type) and issubclass(found, Enum)
    return found if is_named or is_word or (isinstance(found, type) and is_dataclass(found)) else None


class _Writer:
    """Writer of values."""

    def __init__(self, modules: Collection[str], *, shared: bool) -> None:
        self.nodes: list[list[Any]] = []
        self.numbers = bytearray()
        self._modules, self._shared = modules, shared
        self._known: dict[int, tuple[int, Any]] = {}
        self._open: set[int] = set()

    def write(self, value: Any, place: str) -> Any:  # noqa: ANN401 - any value; JSON
        """Return a plain value itself, or `[k]` for the k-th node."""
        kind = type(value)
        if value is None or kind in (bool, str):
            return value
        if (kind is int and abs(value) < MOST_INTEGER) or (kind is float and math.isfinite(value)):
            return value
        if id(value) in self._known:
            return [self._known[id(value)][0]]
        if id(value) in self._open:
            self._refuse(value, place)
        self._open.add(id(value))
        self.nodes.append(self._node(value, place))
        self._open.remove(id(value))
        if self._shared:  # keep the value, so that its id is not reused
            self._known[id(value)] = len(self.nodes) - 1, value
        return [len(self.nodes) - 1]

    def _node(self, value: Any, place: str) -> list[Any]:  # noqa: ANN401, C901 - any value; one line for each kind
        kind = type(value)
        name = f"{kind.__module__}:{kind.__qualname__}"
        if kind is float:
            return ["float", repr(value)]
        if kind is int:
            return ["int", hex(value)]
        if kind is bytes:
            return ["bytes", self._put(value), len(value)]
        if kind is np.ndarray:
            # Keep the memory order: it determines the order of summation in matrix products.
            order = "C" if value.flags.c_contiguous or not value.flags.f_contiguous else "F"
            at = self._put(self._plain(value, place).tobytes(order))
            return ["array", value.dtype.str, list(value.shape), order, value.flags.writeable, at]
        if isinstance(value, np.generic):
            return ["number", value.dtype.str, self._put(self._plain(value, place).tobytes())]
        if kind in _CONTAINERS.values():
            return [kind.__name__, self._each(value, place)]
        if kind is deque:
            return ["deque", self._each(value, place), value.maxlen]
        if kind is dict:
            items = value.items()
            return ["dict", [[self.write(k, f"{place} key"), self.write(v, f"{place}.{k}")] for k, v in items]]
        if isinstance(value, np.random.Generator):
            return ["generator", self._generator(value, place)]
        if find_class(name, self._modules) is not kind:
            self._refuse(value, place)
        if isinstance(value, Enum):
            return ["word", name, self.write(value.value, place)]
        if isinstance(value, tuple):
            return ["named", name, self._each(value, place)]
        return ["data", name, self._fields(value, place)]

    def _put(self, content: bytes) -> int:
        self.numbers += content
        return len(self.numbers) - len(content)

    def _each(self, values: Any, place: str) -> list[Any]:  # noqa: ANN401 - an iterable
        return [self.write(value, f"{place}[{k}]") for k, value in enumerate(values)]

    def _plain(self, value: Any, place: str) -> Any:  # noqa: ANN401 - an array or a number of numpy's
        if not _DTYPE.fullmatch(value.dtype.str):
            self._refuse(value, place)
        return value

    def _fields(self, value: Any, place: str) -> dict[str, Any]:  # noqa: ANN401 - a dataclass
        names = [each.name for each in fields(value)]
        for name in getattr(value, "__dict__", ()):
            if name not in names and not isinstance(getattr(type(value), name, None), cached_property):
                self._refuse(getattr(value, name), f"{place}.{name}")
        return {name: self.write(getattr(value, name), f"{place}.{name}") for name in names}

    def _generator(self, value: np.random.Generator, place: str) -> dict[str, Any]:
        from_numpy(value)  # raises for other bit generators
        bits: Any = value.bit_generator
        state, seeds = bits.state, bits.seed_seq
        return {
            "state": [hex(state["state"]["state"]), hex(state["state"]["inc"])],
            "half": [state["has_uint32"], state["uinteger"]],
            "entropy": self.write(seeds.entropy, place), "key": self.write(seeds.spawn_key, place),
            "spawned": seeds.n_children_spawned,
        }  # fmt: skip

    def _refuse(self, value: Any, place: str) -> NoReturn:  # noqa: ANN401 - any value
        kind = type(value)
        raise SpidarError(f"{place} is a {kind.__module__}.{kind.__qualname__}, which cannot be saved; valid: {VALID}")


class _Reader:
    """Reader of values."""

    def __init__(self, numbers: bytes, modules: Collection[str]) -> None:
        self._numbers, self._modules = numbers, modules
        self.made: list[Any] = []
        self._sizes: list[int] = []
        self._size = 0

    def value(self, told: Any) -> Any:  # noqa: ANN401 - JSON; any value
        """Return the value of an entry written by `_Writer.write`."""
        if not isinstance(told, list):
            return told
        self._size += self._sizes[told[0]]
        return self.made[told[0]]

    def append(self, kind: str, *told: Any) -> None:  # noqa: ANN401 - JSON
        """Make the next node; its size counts shared parts repeatedly, because Python hashes them repeatedly."""
        self._size = 1
        self.made.append(self.make(kind, *told))
        if self._size > MOST_VALUES:
            raise ValueError(f"more than {MOST_VALUES} values in one")
        self._sizes.append(self._size)

    def make(self, kind: str, *told: Any) -> Any:  # noqa: ANN401 - JSON; any value
        """Return the value of a node."""
        if kind in _CONTAINERS:
            return _CONTAINERS[kind](map(self.value, told[0]))
        if kind not in _KINDS:
            raise ValueError(f"{kind!s:.20} is not a type of value")
        return getattr(self, f"_{kind}")(*told)

    def _float(self, text: str) -> float:
        return float(text)

    def _int(self, text: str) -> int:
        if len(text) > MOST_DIGITS:
            raise ValueError(f"a whole number of more than {MOST_DIGITS} digits")
        return int(text, 16)

    def _bytes(self, at: int, size: int) -> bytes:
        return self._numbers[at : at + size]

    def _array(self, dtype: str, shape: list[int], order: Any, writeable: bool, at: int) -> np.ndarray:  # noqa: ANN401
        if any(size < 0 for size in shape):
            raise ValueError(f"an array of shape {shape}")
        array = np.frombuffer(self._numbers, _dtype(dtype), math.prod(shape), at).reshape(shape, order=order)
        array = _sound(array.copy(order))
        array.flags.writeable = bool(writeable)
        return array

    def _number(self, dtype: str, at: int) -> Any:  # noqa: ANN401 - of numpy
        return _sound(np.frombuffer(self._numbers, _dtype(dtype), 1, at))[0]

    def _deque(self, told: list[Any], most: int | None) -> deque[Any]:
        return deque(map(self.value, told), most)

    def _dict(self, told: list[Any]) -> dict[Any, Any]:
        return {self.value(key): self.value(value) for key, value in told}

    def _generator(self, told: dict[str, Any]) -> np.random.Generator:
        seeds = np.random.SeedSequence(
            self.value(told["entropy"]), spawn_key=self.value(told["key"]), n_children_spawned=told["spawned"]
        )
        bits, (state, increment) = np.random.PCG64(seeds), (int(text, 16) for text in told["state"])
        is_stream = 0 <= state < 2**128 and 0 <= increment < 2**128 and increment % 2
        if not (is_stream and told["half"][0] in (0, 1) and 0 <= told["half"][1] < 2**32):
            raise ValueError("a generator with an invalid state")
        bits.state = {
            "bit_generator": "PCG64", "state": {"state": state, "inc": increment}, "has_uint32": told["half"][0],
            "uinteger": told["half"][1],
        }  # fmt: skip
        return np.random.Generator(bits)

    def _word(self, name: str, value: Any) -> Any:  # noqa: ANN401 - a member of an enumeration
        return self._kind(name)(self.value(value))

    def _named(self, name: str, told: list[Any]) -> Any:  # noqa: ANN401 - a named tuple
        return self._kind(name)(*map(self.value, told))

    def _data(self, name: str, told: dict[str, Any]) -> Any:  # noqa: ANN401 - a dataclass
        kind = self._kind(name)
        if [each.name for each in fields(kind)] != list(told):
            raise SpidarError(f"{name} had other fields when it was saved; valid: what this version saved")
        made = object.__new__(kind)  # sets all fields directly, as they may have changed after construction
        for field, value in told.items():
            object.__setattr__(made, field, self.value(value))
        return made

    def _kind(self, name: str) -> Any:  # noqa: ANN401 - a class
        found = find_class(name, self._modules)
        if found is None:
            raise SpidarError(f"there is no class {name:.99} here; valid: those of the environment and its controller")
        return found


def _sound(array: np.ndarray) -> np.ndarray:
    """Require the bytes of flags and text to be valid, and return the array."""
    if array.dtype.kind == "b" and array.size and array.view(np.uint8).max() > 1:
        raise ValueError("a flag other than 0 or 1")
    if array.dtype.kind == "U" and array.size and array.copy().reshape(-1).view("u4").max() > sys.maxunicode:
        raise ValueError("an invalid character")
    return array


def _dtype(text: str) -> np.dtype[Any]:
    if not _DTYPE.fullmatch(text):
        raise ValueError(f"{text:.20} is not a type of number")
    return np.dtype(text)
