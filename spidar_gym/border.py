"""Validation of input files: limits of size and structure, checked before the content is used.

There are two kinds of files: JSON and bundles. A bundle is an uncompressed `.npz` file that numpy can open, with one
JSON part beside the arrays. A sealed bundle ends in the SHA-256 of everything before it. Bundles contain no code.
"""

import hashlib
import io
import json
import math
import re
import stat
import struct
import tomllib
import zipfile
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.errors import SpidarError

MOST_DEPTH = 32
"""Largest nesting depth of objects and lists."""
MOST_INTEGER = 2**63
"""Upper limit (exclusive) of the absolute value of whole numbers."""
MOST_PARTS = 256
"""Largest number of parts of a bundle."""
MOST_WORDS = 2**20
"""Largest size of a bundle's JSON [byte]."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every part of a bundle, so that the same content gives the same bytes."""

_SEAL = 2 * hashlib.sha256().digest_size
_ENTRY = b"PK\x01\x02"
# The header that numpy writes before an array in C order. Numpy's reader is not used: it evaluates the text as Python
# and does not catch the errors of tokenizer and parser.
_HEADER = re.compile(
    rb"\x93NUMPY\x01\x00([\s\S]{2})\{'descr': '(<[fiu][248]|\|[iu]1)', 'fortran_order': False, "
    rb"'shape': \(([0-9, ]{0,64})\), \} *\n"
)


class BorderError(SpidarError):
    """A file that cannot be read, is too large, is damaged, or has another structure; the message states which."""


def read_file(path: Path, most: int) -> bytes:
    """Read a file's bytes.

    Raises:
        BorderError: When it cannot be read, is no regular file, or has more than `most` bytes.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise BorderError("no regular file")
        with path.open("rb") as file:
            data = file.read(most + 1)
    except (OSError, ValueError) as error:
        raise BorderError(getattr(error, "strerror", None) or str(error)) from error
    if len(data) > most:
        raise BorderError(f"more than {most} bytes")
    return data


def parse_json(data: bytes) -> Any:  # noqa: ANN401 - JSON
    """Parse a JSON value; numbers must be finite, text must be valid Unicode, and the nesting depth is limited.

    Raises:
        BorderError: When the data is not JSON or violates one of these conditions.
    """
    try:
        value = json.loads(data.decode("utf-8"))
        level, depth = [value], 0
        while level:
            for part in level:
                if isinstance(part, str):
                    part.encode()  # half a surrogate pair has no UTF-8
                elif isinstance(part, float) and not math.isfinite(part):
                    raise BorderError("a number that is not finite")
                elif isinstance(part, int) and abs(part) >= MOST_INTEGER:
                    raise BorderError("a whole number of 2⁶³ or more")
            objects = [part for part in level if isinstance(part, dict)]
            lists = [part for part in level if isinstance(part, list)]
            level = list(chain(*objects, *(part.values() for part in objects), *lists))
            depth += 1
            if level and depth > MOST_DEPTH:
                raise BorderError(f"more than {MOST_DEPTH} levels")
    except (ValueError, RecursionError) as error:
        raise BorderError(f"no JSON: {error!s:.99}") from error
    return value


def read_toml(path: Path, most: int) -> dict[str, Any]:
    """Read a TOML file of at most `most` bytes (`BorderError` when it cannot be read or is not TOML)."""
    try:
        return tomllib.loads(read_file(path, most).decode())
    except (ValueError, RecursionError) as error:
        raise BorderError(f"no TOML: {error!s:.99}" if isinstance(error, RecursionError) else str(error)) from None


def require_form(value: object, form: Any, name: str) -> None:  # noqa: ANN401 - a recursive description
    """Check that a JSON value has a given structure.

    Args:
        value: From `parse_json`.
        form: The structure: a type (`float` accepts whole numbers too, no number is a `bool`), `(form, None)` for a
            value that may be null, `[form]` for a list of any length, `[form, form]` for a list of exactly these
            entries, `{"name": form}` for an object with exactly these names, `{str: form}` for an object with any
            names.
        name: Name of the value in error messages.

    Raises:
        BorderError: For the first part that has another structure.
    """
    if isinstance(form, tuple):
        if value is not None:
            require_form(value, form[0], name)
    elif isinstance(form, list):
        _require(isinstance(value, list), name, value, "a list")
        _require_entries(value, form, name)
    elif isinstance(form, dict):
        _require(isinstance(value, dict), name, value, "an object")
        _require_parts(value, form, name)
    else:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        _require(number if form is float else type(value) is form, name, value, form.__name__)


def _require_entries(value: Any, form: list[Any], name: str) -> None:  # noqa: ANN401 - JSON
    forms = form * len(value) if len(form) == 1 else form
    if len(forms) != len(value):
        raise BorderError(f"{name} has {len(value)} entries, not {len(forms)}")
    for k, (each, own) in enumerate(zip(value, forms, strict=True)):
        require_form(each, own, f"{name}[{k}]")


def _require_parts(value: Any, form: dict[Any, Any], name: str) -> None:  # noqa: ANN401 - JSON
    forms = dict.fromkeys(value, form[str]) if str in form else form
    for key in forms:
        if key not in value:
            raise BorderError(f"{name} lacks {key}")
    for key, each in value.items():
        if key not in forms:
            raise BorderError(f"{name} has {key[:40]!r}; valid: {', '.join(forms)}")
        require_form(each, forms[key], f"{name}[{key[:40]!r}]")


def _require(fits: bool, name: str, value: object, expected: str) -> None:
    if not fits:
        raise BorderError(f"{name} is {type(value).__name__}, not {expected}")


def pack(title: str, words: object, arrays: Mapping[str, np.ndarray], *, sealed: bool = False) -> bytes:
    """Build a bundle; the same content gives the same bytes.

    Args:
        title: Name of the JSON part.
        words: The JSON part.
        arrays: Arrays of numbers by name.
        sealed: Whether the bundle ends in its SHA-256.
    """
    buffer = io.BytesIO()
    # Not compressed: another version of the compressor would give other bytes.
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(zipfile.ZipInfo(title, EPOCH), json.dumps(words, indent=1, ensure_ascii=False))
        for name, array in arrays.items():
            data = io.BytesIO()
            # `ascontiguousarray` would turn a scalar into a vector.
            np.lib.format.write_array(data, np.asarray(array, order="C"), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", EPOCH), data.getvalue())
        archive.comment = bytes(_SEAL) if sealed else b""
    data = buffer.getvalue()
    return data[:-_SEAL] + _digest(data) if sealed else data


def _digest(data: bytes) -> bytes:
    """Compute the seal of a bundle that has room for the seal at its end."""
    return hashlib.sha256(memoryview(data)[:-_SEAL]).hexdigest().encode()


def unpack(title: str, data: bytes, *, sealed: bool = False) -> tuple[Any, dict[str, np.ndarray]]:
    """Read JSON part and arrays of a bundle that `pack` wrote.

    Raises:
        BorderError: When the data is no such bundle, or its seal does not match its content.
    """
    if sealed and data[-_SEAL:] != _digest(data):
        raise BorderError("its checksum is not that of its content")
    # Every part has an entry in the directory. The entries are counted before `zipfile` creates an object for each.
    if data.count(_ENTRY) > MOST_PARTS:
        raise BorderError(f"more than {MOST_PARTS} parts")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            parts = archive.infolist()
            if any(part.compress_type != zipfile.ZIP_STORED or part.file_size != part.compress_size for part in parts):
                raise BorderError("compressed")
            # Overlapping parts could be larger in total than the file.
            if sum(part.file_size for part in parts) > len(data):
                raise BorderError("parts larger than the file")
            content = {part.filename: archive.read(part) for part in parts}
    except (zipfile.BadZipFile, EOFError, RuntimeError, ValueError, OverflowError, struct.error) as error:
        raise BorderError(f"no bundle: {error!s:.99}") from error
    if title not in content or len(content) != len(parts):
        raise BorderError(f"no {title}, or parts with the same name")
    words = content.pop(title)
    if len(words) > MOST_WORDS:
        raise BorderError(f"{title} has more than {MOST_WORDS} bytes")
    arrays = {}
    for name, part in content.items():
        if not (name.endswith(".npy") and name.isprintable()):
            raise BorderError("a part that is no array")
        arrays[name.removesuffix(".npy")] = _array(name, part)
    return parse_json(words), arrays


def _array(name: str, data: bytes) -> np.ndarray:
    """Read an array of numbers whose header matches its data."""
    head = _HEADER.match(data)
    if head is None or int.from_bytes(head[1], "little") != head.end() - 10:
        raise BorderError(f"{name[:40]} is no array of numbers as numpy writes them")
    dtype = np.dtype(head[2].decode())
    shape = tuple(map(int, head[3].replace(b",", b" ").split()))
    if math.prod(shape) * dtype.itemsize != len(data) - head.end():
        raise BorderError(f"{name[:40]} has another size than its header states")
    try:
        return np.ndarray(shape, dtype, data, head.end()).copy()
    except ValueError as error:  # no entries, but a dimension such as 10³⁰
        raise BorderError(f"{name[:40]} has no shape of an array") from error
