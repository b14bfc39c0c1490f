"""Bags of ROS 1, read with the library `rosbags`; damaged and unindexed ones record by record."""

import bz2
import contextlib
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from spidar_gym.border import BorderError
from spidar_gym.errors import MissingDependencyError
from spidar_gym.logs.mcap import INSTALL, Collected, assemble
from spidar_gym.logs.messages import SECOND
from spidar_gym.logs.record import Record
from spidar_gym.onboard.messages import NAMESPACE

MAGIC = b"#ROSBAG V"
"""First bytes of a bag."""
_VERSION = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = b"\x02", b"\x05", b"\x07"
"""Kinds of records."""
_COMPRESSION = b"compression="
"""Field of a chunk, by which the next one is found after damage."""


def read_bag(
    path: Path, *, namespace: str = NAMESPACE, on_bytes: Callable[[int], object] = lambda count: None
) -> Record:
    """Read a bag; damaged parts are left out, with a warning.

    Args:
        path: The bag.
        namespace: Namespace of the robot's topics.
        on_bytes: Called with a number of bytes that have been read, for progress.

    Raises:
        BorderError: For a file that cannot be read or is no bag of version 2.0.
        MissingDependencyError: Without the library.
    """
    try:
        with path.open("rb") as file:
            start = file.read(len(_VERSION))
    except (OSError, ValueError) as error:
        raise BorderError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    if start != _VERSION:
        raise BorderError(f"{path} is no bag of version 2.0; valid: a bag of ROS 1.2 or later")
    try:
        from rosbags.rosbag1 import Reader  # imported late, since the library is optional
    except ImportError as error:
        raise MissingDependencyError("rosbags", INSTALL) from error
    try:
        found = _indexed(Reader, path, on_bytes)
    # Whatever the library raises for a damaged bag, its whole records can be read.
    except Exception as error:
        found = _scanned(path)
        reason = " ".join(str(error).split()) or type(error).__name__
        found.warnings.insert(0, f"the bag is damaged or unindexed ({reason:.80}): its whole messages are kept")
    return assemble("bag", found, namespace, found.warnings, {})


def _indexed(reader: Any, path: Path, on_bytes: Callable[[int], object]) -> Collected:  # noqa: ANN401 - a class
    """Read a whole bag."""
    found, bag = Collected(), reader(path)
    try:
        bag.open()
        for c in bag.connections:
            found.add_channel(c.id, c.topic, c.msgtype.replace("/msg/", "/"), c.msgdef.data, {})
            if c.id in found.skipped:  # of cameras, for example, nothing is read
                found.skipped[c.id] = c.msgcount
        wanted = [c for c in bag.connections if c.id not in found.skipped]
        for connection, time, data in bag.messages(wanted) if wanted else ():
            found.add(connection.id, time, bytes(data))
            on_bytes(len(data))
    finally:
        with contextlib.suppress(Exception):  # raised by versions that close a damaged bag themselves
            bag.close()
    return found


# Damaged and unindexed bags.


def _scanned(path: Path) -> Collected:
    """Read the records of a bag in their order, from one to the next whole one."""
    data, found, lost = path.read_bytes(), Collected(), 0
    at = len(_VERSION)
    while at < len(data):
        try:
            header, body, end = _record(data, at)
            if header.get(b"op") == _CHUNK:
                lost += not _take_all(_decompressed(header, body), found) or end > len(data)
            else:
                _take(header, body, found)
        except (ValueError, KeyError, EOFError, OSError, RuntimeError, struct.error):
            lost += 1
            end = _next_chunk(data, at)
        at = end
    strange = [channel for channel in found.messages if channel not in found.channels]
    count = sum(len(found.messages.pop(channel)) for channel in strange)
    if count:
        found.warnings.append(f"{count} messages are of connections that the bag does not describe: left out")
    if lost:
        found.warnings.append(f"damaged or cut parts of the bag: {lost}; what follows the damage in them is left out")
    return found


def _fields(data: bytes) -> dict[bytes, bytes]:
    """Return the fields of a header (`ValueError` for damaged ones)."""
    found, place = dict[bytes, bytes](), 0
    while place < len(data):
        (length,) = struct.unpack_from("<I", data, place)
        name, sign, value = data[place + 4 : place + 4 + length].partition(b"=")
        place += 4 + length
        if not sign or place > len(data):
            raise ValueError("no field")
        found[name] = value
    return found


def _record(data: bytes, at: int) -> tuple[dict[bytes, bytes], bytes, int]:
    """Return header, content (up to the end of the data) and end of the record at an offset."""
    (size,) = struct.unpack_from("<I", data, at)
    place = at + 4 + size
    header = _fields(data[at + 4 : place])
    if b"op" not in header or place > len(data):
        raise ValueError("no header")
    (size,) = struct.unpack_from("<I", data, place)
    return header, data[place + 4 : place + 4 + size], place + 4 + size


def _next_chunk(data: bytes, at: int) -> int:
    """Return the offset of the next chunk after damage, or the end of the data."""
    while (place := data.find(_COMPRESSION, at + 1)) >= 0:
        # Before the field lie its length and the header's; `rosbags` writes the kind of the record first.
        for start in (place - 8, place - 16):
            if start > at:
                try:
                    if _record(data, start)[0][b"op"] == _CHUNK:
                        return start
                except (ValueError, struct.error):
                    pass
        at = place
    return len(data)


def _decompressed(header: dict[bytes, bytes], body: bytes) -> bytes:
    """Return the content of a chunk; of a cut one what can be decompressed."""
    kind = header[b"compression"]
    if kind == b"none":
        return body
    if kind == b"bz2":
        return bz2.BZ2Decompressor().decompress(body)
    if kind == b"lz4":
        from lz4.frame import LZ4FrameDecompressor  # imported late: it comes with the optional rosbags

        return LZ4FrameDecompressor().decompress(body)
    raise ValueError("unknown compression")


def _records(data: bytes) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    at = 0
    while at < len(data):
        header, body, at = _record(data, at)
        if at > len(data):
            raise ValueError("cut")
        yield header, body


def _take_all(chunk: bytes, found: Collected) -> bool:
    """Take the records of a chunk; returns whether all of them are whole."""
    try:
        for header, body in _records(chunk):
            _take(header, body, found)
    except (ValueError, KeyError, struct.error):
        return False
    return True


def _take(header: dict[bytes, bytes], body: bytes, found: Collected) -> None:
    """Take a message or a connection; other records hold indices."""
    if header[b"op"] == _CONNECTION:
        (channel,) = struct.unpack("<I", header[b"conn"])
        about = _fields(body)
        topic, kind, text = (
            each.decode(errors="replace") for each in (header[b"topic"], about[b"type"], about[b"message_definition"])
        )
        found.add_channel(channel, topic, kind, text, {})
    elif header[b"op"] == _MESSAGE:
        (channel,), (seconds, rest) = struct.unpack("<I", header[b"conn"]), struct.unpack("<II", header[b"time"])
        found.add(channel, SECOND * seconds + rest, body)
