"""Messages between a policy's process and its caller: JSON and at most one array of numbers, no code."""

import json
import math
import os
import re
import select
import struct
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, parse_json

MOST_WORDS, MOST_ARRAY = 2**20, 2**24
"""Longest JSON and largest array of a message [bytes]."""
NUMBERS = re.compile(r"[<>=|]?[fiu](1|2|4|8|16)")
"""Types of an array's numbers."""
SIZES = struct.Struct(">II")
"""Head of a message: lengths of its JSON and of its array [bytes]."""
CLOSED = "the line is closed"


class LateError(Exception):
    """A message that was not received or sent in time."""


class Line:
    """One end of two pipes."""

    def __init__(self, inward: int, outward: int) -> None:
        """Store the file descriptors to read from and to write to."""
        self._inward, self._outward = inward, outward
        for end in (inward, outward):
            os.set_blocking(end, False)

    def send(self, words: Mapping[str, Any], array: np.ndarray | None = None, limit_s: float | None = None) -> None:
        """Send a message within a time limit [s], or without a limit.

        Raises:
            LateError: When the time limit is exceeded.
            BorderError: When the other end is closed.
        """
        data = b"" if array is None else array.tobytes()
        if array is not None:
            words = {**words, "dtype": array.dtype.str, "shape": list(array.shape)}
        text = json.dumps(words).encode()
        rest, end = memoryview(SIZES.pack(len(text), len(data)) + text + data), _end(limit_s)
        while rest:
            _wait(self._outward, select.POLLOUT, end)
            try:
                rest = rest[os.write(self._outward, rest) :]
            except BlockingIOError:
                continue
            except OSError as error:
                raise BorderError(CLOSED) from error

    def receive(self, limit_s: float | None = None) -> tuple[dict[str, Any], np.ndarray | None]:
        """Receive and validate the next message.

        Raises:
            LateError: When the time limit [s] is exceeded.
            BorderError: When the other end is closed, or for an invalid message.
        """
        end = _end(limit_s)
        words_size, array_size = SIZES.unpack(self._read(SIZES.size, end))
        if words_size > MOST_WORDS or array_size > MOST_ARRAY:
            raise BorderError(f"a message of {words_size + array_size} bytes")
        words = parse_json(self._read(words_size, end))
        if not isinstance(words, dict):
            raise BorderError("a message that is not an object")
        data = self._read(array_size, end)
        if not ("dtype" in words or array_size):
            return words, None
        dtype, shape = words.pop("dtype", None), words.pop("shape", None)
        if not (isinstance(dtype, str) and NUMBERS.fullmatch(dtype) and _is_shape(shape)):
            raise BorderError("an array of other types than numbers")
        try:
            # A copy: the receiver may write to it.
            return words, np.frombuffer(data, dtype).reshape(shape).copy()
        except (TypeError, ValueError) as error:
            raise BorderError(f"an array of another size than its shape {shape}") from error

    def _read(self, size: int, end: float) -> bytes:
        found = bytearray()
        while len(found) < size:
            _wait(self._inward, select.POLLIN, end)
            try:
                part = os.read(self._inward, size - len(found))
            except BlockingIOError:
                continue
            except OSError as error:
                raise BorderError(CLOSED) from error
            if not part:
                raise BorderError(CLOSED)
            found += part
        return bytes(found)


def _is_shape(shape: object) -> bool:
    return isinstance(shape, list) and len(shape) <= 8 and all(type(n) is int and 0 <= n <= MOST_ARRAY for n in shape)


def _end(limit_s: float | None) -> float:
    return math.inf if limit_s is None else time.monotonic() + limit_s


def _wait(line: int, event: int, end: float) -> None:
    """Wait until a pipe can be read from or written to, or is closed (`LateError` after `end`)."""
    poll = select.poll()
    poll.register(line, event)
    left = None if end == math.inf else max(0.0, 1e3 * (end - time.monotonic()))
    if not poll.poll(left):
        raise LateError
