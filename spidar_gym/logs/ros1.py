"""ROS 1 messages as arrays: definitions are parsed, and whole series of messages are written and read at once."""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.errors import SpidarError

NUMBERS = {
    "bool": "u1", "byte": "i1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "<i2", "uint16": "<u2",
    "int32": "<i4", "uint32": "<u4", "int64": "<i8", "uint64": "<u8", "float32": "<f4", "float64": "<f8",
}  # fmt: skip
"""ROS's types of numbers → numpy's."""
MOMENTS = {"time": "<u4", "duration": "<i4"}
"""Types of two numbers, seconds and nanoseconds [s, ns]."""
MOST_DEPTH = 16
"""Largest nesting depth of types."""
VARIABLE = -1
"""Count of an array whose length is part of the message."""
_FIELD = re.compile(r"([\w/]+)(\[(\d*)\])?\s+(\w+)")


class MessageError(SpidarError):
    """A definition or a message that is not valid in ROS 1."""


@dataclass(frozen=True)
class Field:
    """One field of a message."""

    name: str
    """Name."""
    kind: str
    """A number, `string`, `time`, `duration`, or the name of a message."""
    count: int | None
    """None for a single value, the length of a fixed array, or `VARIABLE`."""
    inner: "tuple[Field, ...]"
    """Fields of a message; empty for any other kind."""


@dataclass(frozen=True)
class Leaf:
    """A value without fields of its own, at its place in a message of known lengths."""

    path: str
    """Names from the message to the value, separated by dots; `[k]` for an element of an array of messages."""
    kind: str
    """numpy type of an element; `S` for text."""
    shape: tuple[int, ...]
    """Shape of the value; of text its number of bytes, of a list of texts empty."""
    offset: int
    """Offset in the message [byte]."""


def parse(name: str, text: str) -> tuple[Field, ...]:
    """Parse a definition in ROS's language.

    Args:
        name: Type of the message, `package/Name`.
        text: Definition, followed by those of the types that it uses, as in bags.

    Raises:
        MessageError: For an invalid definition.
    """
    head, *others = re.split(r"^=+[ \t]*$", text, flags=re.MULTILINE)
    texts = {name: head}
    for other in others:
        title, _, body = other.strip().partition("\n")
        texts[title.removeprefix("MSG:").strip()] = body
    return _fields(name, texts, 0)


def _fields(name: str, texts: Mapping[str, str], depth: int) -> tuple[Field, ...]:
    if depth > MOST_DEPTH:
        raise MessageError(f"the type {name[:80]} is nested too deep; valid: at most {MOST_DEPTH} levels")
    found = []
    for line in texts[name].splitlines():
        words = line.partition("#")[0].strip()
        if not words or "=" in words:  # empty, or a constant
            continue
        match = _FIELD.fullmatch(words)
        if match is None:
            raise MessageError(f"the type {name[:80]} has the line {words[:80]!r}; valid: TYPE NAME")
        kind, is_array, count, field = match.groups()
        inner = () if kind in NUMBERS or kind in MOMENTS or kind == "string" else _inner(kind, name, texts, depth)
        found.append(Field(field, kind, (int(count) if count else VARIABLE) if is_array else None, inner))
    return tuple(found)


def _inner(kind: str, user: str, texts: Mapping[str, str], depth: int) -> tuple[Field, ...]:
    package = user.partition("/")[0]
    for full in (kind, f"{package}/{kind}", "std_msgs/Header" if kind == "Header" else kind):
        if full in texts:
            return _fields(full, texts, depth + 1)
    raise MessageError(f"the type {user[:80]} uses {kind[:80]}, which is not defined; valid: a definition with it")


def paths(fields: Sequence[Field], front: str = "") -> Iterator[str]:
    """Yield the path of every leaf; `[]` stands for the elements of an array of messages."""
    for field in fields:
        path = f"{front}{field.name}"
        if field.inner:
            yield from paths(field.inner, f"{path}{'' if field.count is None else '[]'}.")
        else:
            yield path


class _Walk:
    """Walk through one message: leaves, and offsets of its length prefixes."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0
        self.leaves: list[Leaf] = []
        self.prefixes: list[int] = []

    def count(self) -> int:
        """Read a length prefix."""
        self.require(4)
        self.prefixes.append(self.at)
        (found,) = struct.unpack_from("<I", self.data, self.at)
        self.at += 4
        return found

    def require(self, size: int) -> None:
        if size > len(self.data) - self.at:
            raise MessageError(f"a message of {len(self.data)} bytes is too short for its type")

    def leaf(self, path: str, kind: str, shape: tuple[int, ...], size: int) -> None:
        self.require(size)
        self.leaves.append(Leaf(path, kind, shape, self.at))
        self.at += size

    def fields(self, fields: Sequence[Field], front: str) -> None:
        for field in fields:
            path = f"{front}{field.name}"
            count = self.count() if field.count == VARIABLE else field.count
            if count is not None and count > len(self.data):
                raise MessageError(f"a message of {len(self.data)} bytes has an array of {count} values")
            if field.inner:
                for k in range(1 if count is None else count):
                    self.fields(field.inner, f"{path}{'' if count is None else f'[{k}]'}.")
            elif field.kind == "string":
                for k in range(1 if count is None else count):
                    size = self.count()
                    self.leaf(path if count is None else f"{path}[{k}]", "S", (size,), size)
            else:
                kind = NUMBERS.get(field.kind) or MOMENTS[field.kind]
                shape = (() if count is None else (count,)) + ((2,) if field.kind in MOMENTS else ())
                self.leaf(path, kind, shape, np.dtype(kind).itemsize * int(np.prod(shape, dtype=np.int64)))


@dataclass(frozen=True)
class Group:
    """Messages of a series whose arrays and texts have the same lengths, and whose lists of texts are equal."""

    rows: np.ndarray
    """Their indices in the series, ascending."""
    values: Mapping[str, np.ndarray]
    """Values by path, (rows, …); texts as bytes (rows, length)."""


def decode(fields: Sequence[Field], messages: Sequence[bytes]) -> tuple[list[Group], np.ndarray]:
    """Read messages of one type.

    Returns:
        Groups of messages that are alike, and the indices of the messages that are damaged.
    """
    sizes = np.array([len(message) for message in messages])
    groups, damaged = list[Group](), list[int]()
    for size in np.unique(sizes).tolist():
        rows = np.flatnonzero(sizes == size)
        table = np.array(bytearray().join(messages[k] for k in rows.tolist()), np.uint8).reshape(len(rows), size)
        while len(rows):
            walk = _Walk(messages[rows[0]])
            try:
                walk.fields(fields, "")
            except MessageError:
                walk.at = -1
            if walk.at != size:
                damaged.append(int(rows[0]))
                rows, table = rows[1:], table[1:]
                continue
            # Equal lengths give equal places; names, which say what the values are, must be equal themselves.
            names = [np.arange(leaf.shape[0]) + leaf.offset for leaf in walk.leaves
                     if leaf.kind == "S" and leaf.path.endswith("]")]  # fmt: skip
            same = np.concatenate([(np.array(walk.prefixes, int)[:, None] + np.arange(4)).reshape(-1), *names])
            alike = (table[:, same] == table[0, same]).all(axis=1)
            groups.append(Group(rows[alike], {leaf.path: _values(leaf, table[alike]) for leaf in walk.leaves}))
            rows, table = rows[~alike], table[~alike]
    return groups, np.array(sorted(damaged), int)


def _values(leaf: Leaf, table: np.ndarray) -> np.ndarray:
    """Return the values of a leaf in every row of bytes."""
    if leaf.kind == "S":
        return table[:, leaf.offset : leaf.offset + leaf.shape[0]]
    kind = np.dtype(leaf.kind)
    size = kind.itemsize * int(np.prod(leaf.shape, dtype=np.int64))
    if not size:
        return np.zeros((len(table), *leaf.shape), kind)
    part = np.ascontiguousarray(table[:, leaf.offset : leaf.offset + size])
    return np.frombuffer(part, kind).reshape(len(table), *leaf.shape)


def texts_of(values: np.ndarray) -> list[str]:
    """Convert texts from bytes (n, length); bytes that are not UTF-8 become question marks."""
    return [row.tobytes().decode(errors="replace") for row in values]


def encode(fields: Sequence[Field], count: int, values: Mapping[str, Any]) -> np.ndarray:
    """Write messages of one type whose arrays and texts have the same lengths.

    Args:
        fields: Definition.
        count: Number of messages n.
        values: Values by path: (n, …) numbers, a text, or a list of texts, the same for all messages. Numbers without a
            value are 0, texts and arrays of variable length empty. For arrays of messages, the path has `[]` and the
            values are (n, length).

    Returns:
        The messages (n, size) as bytes.
    """
    plan = _Plan(values)
    plan.fields(fields, "", None)
    if not plan.members:
        return np.zeros((count, 0), np.uint8)
    table = np.zeros(count, np.dtype(plan.members))
    for name, value in plan.content:
        table[name] = value
    return table.view(np.uint8).reshape(count, -1)


class _Plan:
    """Members of the records that hold messages of one length, and their values."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.values = values
        self.members: list[tuple[str, str, tuple[int, ...]]] = []
        self.content: list[tuple[str, Any]] = []

    def add(self, kind: str, shape: tuple[int, ...], value: Any) -> None:  # noqa: ANN401 - of any type
        name = str(len(self.members))
        self.members.append((name, kind, shape))
        if value is not None:
            self.content.append((name, value))

    def fields(self, fields: Sequence[Field], front: str, element: int | None) -> None:
        """Append the fields of a message; `element` is its index in an array, None outside arrays."""
        for field in fields:
            path = f"{front}{field.name}"
            if field.inner:
                self.messages(field, path, element)
            elif field.kind == "string":
                self.texts(field, self.values.get(path))
            else:
                self.numbers(field, self.values.get(path), element)

    def messages(self, field: Field, path: str, element: int | None) -> None:
        if field.count is None:
            self.fields(field.inner, f"{path}.", element)
            return
        inner, length = f"{path}[].", field.count
        if length == VARIABLE:
            length = next((np.shape(self.values[p])[1] for p in self.values if p.startswith(inner)), 0)
            self.add("<u4", (), length)
        for k in range(length):
            self.fields(field.inner, inner, k)

    def texts(self, field: Field, given: Any) -> None:  # noqa: ANN401 - a text or a list of texts
        texts = [given or ""] if field.count is None else list(given or ())
        if field.count == VARIABLE:
            self.add("<u4", (), len(texts))
        for text in texts:
            data = text.encode()
            self.add("<u4", (), len(data))
            if data:
                self.add(f"S{len(data)}", (), data)

    def numbers(self, field: Field, given: Any, element: int | None) -> None:  # noqa: ANN401 - an array
        pair = (2,) if field.kind in MOMENTS else ()
        length = field.count
        if length == VARIABLE:
            length = 0 if given is None else np.shape(given)[1]
            self.add("<u4", (), length)
        if given is not None and element is not None:
            given = np.asarray(given)[:, element]
        if length != 0:
            self.add(
                NUMBERS.get(field.kind) or MOMENTS[field.kind], (*(() if length is None else (length,)), *pair), given
            )
