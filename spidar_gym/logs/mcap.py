"""Records as MCAP files with ROS 1 messages, written and read with the library `mcap`."""

import io
import json
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym import __version__
from spidar_gym.border import BorderError
from spidar_gym.errors import MissingDependencyError
from spidar_gym.files import whole_file
from spidar_gym.logs.messages import SECOND, nanoseconds, to_messages, to_series, uses_head
from spidar_gym.logs.record import Other, Record, Series, ordered
from spidar_gym.logs.ros1 import MessageError, parse
from spidar_gym.logs.topics import FORMATS, definition
from spidar_gym.onboard.messages import NAMESPACE

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of a file."""
OURS = "spidar_gym"
"""Name of the metadata in files that this module wrote."""
INSTALL = "pip install 'spidar-gym[log]'"
"""Command that installs the libraries for MCAP and bags."""
_PROFILE, _JSON = "ros1", "application/json"
_FRONT, _FOOTER = 9, 9 + 20
"""Sizes of the front of a record, and of the last record [byte]."""
MOST_CHUNK = 2**30
"""Largest size of a chunk [byte]; writers make chunks of about 1 MB."""
_MOST_TIME = 2**63 - 1
"""Latest time that NumPy can hold [ns]."""
_PIECE = 5000
"""Messages between two calls for progress."""


def mcap_library() -> Any:  # noqa: ANN401 - a module
    """Import the library `mcap` (`MissingDependencyError` without it)."""
    try:
        import mcap.data_stream  # imported late, since the library is optional
        import mcap.opcode
        import mcap.records
        import mcap.stream_reader
        import mcap.writer
    except ImportError as error:
        raise MissingDependencyError("mcap", INSTALL) from error
    return mcap


def write_mcap(
    record: Record, path: Path, *, namespace: str = NAMESPACE, on_messages: Callable[[int], object] = lambda count: None
) -> tuple[str, ...]:
    """Write a record as a file, atomically; the same record gives the same bytes.

    Args:
        record: The record.
        path: The file.
        namespace: Namespace of the topics in the file.
        on_messages: Called with a number of messages that have been written, for progress.

    Returns:
        Warnings about what MCAP cannot hold.

    Raises:
        MissingDependencyError: Without the library.
        SpidarError: If the file cannot be written.
    """
    library, warnings = mcap_library(), list[str]()
    with whole_file(path) as part, part.open("wb") as stream:
        writer = library.writer.Writer(stream)
        writer.start(profile=_PROFILE, library=f"{OURS} {__version__}")
        facts = {"version": __version__, "kind": record.kind, "epoch": str(record.epoch), "namespace": namespace}
        facts |= {f"property.{name}": value for name, value in record.properties.items()}
        facts |= {"warnings": json.dumps(record.warnings, ensure_ascii=False)} if record.warnings else {}
        writer.add_metadata(OURS, facts)
        for name, data in record.attachments.items():
            writer.add_attachment(0, 0, name, _JSON, data)
        schemas, channels, messages, times = dict[Any, int](), [], [], []
        for topic, series in record.series.items():
            kind = series.format.kind, uses_head(series)
            if kind not in schemas:
                text = definition(kind[0], head=kind[1])
                schemas[kind] = writer.register_schema(kind[0], "ros1msg", text.encode())
            channels.append(writer.register_channel(f"{namespace}/{topic}", "ros1", schemas[kind], _about(series)))
            own, lost = to_messages(series, record.epoch)
            received, fits = nanoseconds(series.received, record.epoch)
            warnings += [f"{lost} stamps of {topic} are no times of ROS: written as 0"] if lost else []
            warnings += [f"{(~fits).sum()} messages of {topic} have no time: written at 0"] if not fits.all() else []
            messages.append(own)
            times.append(received)
        for count, (topic, row, time) in enumerate(_in_order(times), 1):
            writer.add_message(channels[topic], time, messages[topic][row], time, row)
            if count % _PIECE == 0:
                on_messages(_PIECE)
        on_messages(sum(map(len, times)) % _PIECE)
        writer.finish()
    return tuple(warnings)


def _about(series: Series) -> dict[str, str]:
    """Return the metadata of a channel: unit and contents of every column that the series has."""
    form = series.format
    return {"contents": form.doc} | {f"unit.{c.name}": c.words for c in form.columns if c.name in series.values}


def _in_order(times: Sequence[np.ndarray]) -> Iterator[tuple[int, int, int]]:
    """Yield index of the topic, index of the message and time of all messages, sorted by time, then by topic."""
    if not times:
        return
    topic = np.repeat(np.arange(len(times)), [len(own) for own in times])
    row, time = np.concatenate([np.arange(len(own)) for own in times]), np.concatenate(times)
    order = np.argsort(time, kind="stable")
    yield from zip(topic[order].tolist(), row[order].tolist(), time[order].tolist(), strict=True)


class Collected:
    """Messages of a file, by channel."""

    def __init__(self) -> None:
        """Start without messages."""
        self.schemas: dict[int, Any] = {}
        """Id of a schema → schema of an MCAP."""
        self.channels: dict[int, tuple[str, str, str, Mapping[str, str]]] = {}
        """Id of a channel → topic, type, definition, metadata."""
        self.messages: dict[int, list[bytes]] = {}
        """Id of a channel → messages."""
        self.times: dict[int, list[int]] = {}
        """Id of a channel → times of receipt, since 1970 [ns]."""
        self.skipped: dict[int, int] = {}
        """Id of a channel that no record can hold → number of its messages."""
        self.facts: dict[str, str] = {}
        """Metadata that this module wrote."""
        self.attachments: dict[str, bytes] = {}
        """Attachments by name."""
        self.warnings: list[str] = []
        """What could not be read."""

    def add_channel(self, channel: int, topic: str, kind: str, text: str, about: Mapping[str, str]) -> None:
        """Add a channel: topic, ROS type, definition (empty for other messages than ROS 1's), metadata."""
        self.channels[channel] = topic, kind, text, about
        if not any(topic.endswith(f"/{name}") for name in FORMATS):
            self.skipped.setdefault(channel, 0)

    def add(self, channel: int, time: int, data: bytes) -> None:
        """Add a message; of channels that no record can hold, only the number is kept."""
        if channel in self.skipped:
            self.skipped[channel] += 1
        else:
            self.messages.setdefault(channel, []).append(data)
            self.times.setdefault(channel, []).append(min(time, _MOST_TIME))


def read_mcap(
    path: Path, *, namespace: str = NAMESPACE, on_bytes: Callable[[int], object] = lambda count: None
) -> Record:
    """Read a file with ROS 1 messages; damaged parts are left out, with a warning.

    Args:
        path: The file.
        namespace: Namespace of the robot's topics; files that this module wrote state their own.
        on_bytes: Called with a number of bytes that have been read, for progress.

    Raises:
        BorderError: For a file that cannot be read or is no MCAP.
        MissingDependencyError: Without the library.
    """
    library, found = mcap_library(), Collected()
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise BorderError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    if not data.startswith(MAGIC):
        raise BorderError(f"{path} is no MCAP; valid: a file that starts with its 8 bytes")
    _collect(library, data, found, on_bytes)
    own = found.facts.get("namespace", namespace)
    if any(topic.startswith(f"{own}/") for topic, *_ in found.channels.values()):
        namespace = own
    properties = {name.removeprefix("property."): value for name, value in found.facts.items() if "." in name}
    warnings = json_list(found.facts.get("warnings", "")) + found.warnings
    kind = found.facts.get("kind", "mcap")
    return assemble(kind, found, namespace, warnings, properties, epoch=whole(found.facts.get("epoch")))


def whole(text: str | None) -> int | None:
    """Return a text as a whole number of seconds; None where it is not one."""
    return int(text) if text is not None and text.isascii() and text.isdigit() and len(text) < 11 else None


def json_list(text: str) -> list[str]:
    """Return a list of texts in JSON; empty for anything else."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return []
    return [str(each) for each in found] if isinstance(found, list) else []


def assemble(
    kind: str, found: Collected, namespace: str, warnings: Sequence[str], properties: Mapping[str, str],
    epoch: int | None = None,
) -> Record:  # fmt: skip
    """Build a record from the messages of a file.

    Args:
        kind: Kind of the log.
        found: The messages.
        namespace: Namespace of the robot's topics.
        warnings: What could not be read.
        properties: Facts of the log.
        epoch: Time 0 of the record [s]; the whole second of the first message if None.
    """
    told, others = list(warnings), dict[str, Other]()
    if epoch is None:
        epoch = min((min(times) for times in found.times.values() if times), default=0) // SECOND
    parts = dict[str, list[Series]]()
    counts = {channel: len(messages) for channel, messages in found.messages.items()} | found.skipped
    for channel, count in counts.items():
        topic, type_, text, about = found.channels[channel]
        front = f"{namespace.rstrip('/')}/"
        form, own = FORMATS.get(topic[len(front) :]) if topic.startswith(front) else None, None
        if form is not None and (text or not form.columns):
            # A file that this module wrote names the columns of the series; other messages have all of them.
            named = [name.removeprefix("unit.") for name in about if name.startswith("unit.")]
            only = named if "contents" in about else None
            try:
                received = np.array(found.times[channel], np.int64)
                own = to_series(form, parse(type_, text), found.messages[channel], received, epoch, only)
            except (MessageError, KeyError, RecursionError) as error:
                told.append(f"{topic} cannot be read: {error}")
        if own is not None and (own[0].values or not own[0].format.columns):
            told += own[1]
            parts.setdefault(own[0].topic, []).append(own[0])
        elif count:
            others[topic] = Other(type_, others.get(topic, Other(type_, 0)).count + count)
    series = ordered({topic: _joined(own) for topic, own in parts.items()})
    return Record(kind, series, epoch, properties, tuple(told), dict(sorted(others.items())), found.attachments)


def _joined(parts: Sequence[Series]) -> Series:
    """Join the series of several publishers of a topic, in the order of receipt."""
    if len(parts) == 1 and (np.diff(parts[0].received) >= 0.0).all():
        return parts[0]
    names = tuple(dict.fromkeys(name for part in parts for name in part.names))
    columns = dict.fromkeys(name for part in parts for name in part.values)
    received = np.concatenate([part.received for part in parts])
    order = np.argsort(received, kind="stable")
    values = {name: np.concatenate(_alike(parts, name, names))[order] for name in columns}
    return Series(parts[0].topic, np.concatenate([part.time for part in parts])[order], received[order], values, names)


def _alike(parts: Sequence[Series], name: str, names: Sequence[str]) -> list[np.ndarray]:
    """Return a column of every part with the same width; numbers that a part lacks are NaN."""
    given = [part.values.get(name) for part in parts]
    model = next(each for each in given if each is not None)
    width = len(names) or max(each.shape[1] if each is not None and each.ndim > 1 else 0 for each in given)
    made = []
    for part, each in zip(parts, given, strict=True):
        if part.format.column(name).shape is None:
            table = np.full((len(part), width), np.nan)
            if each is not None:
                table[:, [names.index(own) for own in part.names] if names else range(each.shape[1])] = each
            made.append(table)
        else:
            fill = {"O": "", "i": 0}.get(model.dtype.kind, np.nan)
            blank = np.full((len(part), *model.shape[1:]), fill, model.dtype)
            made.append(blank if each is None else each)
    return made


def _collect(
    library: Any,  # noqa: ANN401 - a module
    data: bytes, found: Collected, on_bytes: Callable[[int], object],
) -> None:  # fmt: skip
    """Read every record of a file that is not damaged."""
    kinds = library.opcode.Opcode
    starts, at, lost, ended = _chunks(library, data), len(MAGIC), 0, False
    while at + _FRONT < len(data):
        opcode, (length,) = data[at], struct.unpack_from("<Q", data, at + 1)
        # A record that extends into a chunk of the index has a damaged length; reading resumes at that chunk.
        end = min([at + _FRONT + length, *(start for start in starts if start > at)])
        ended = ended or opcode == kinds.DATA_END
        try:
            whole_record = end == at + _FRONT + length <= len(data)
            if not whole_record and opcode != kinds.CHUNK:
                raise BorderError("the record is cut")
            body = data[at + _FRONT : end]
            for record in _records(library, opcode, body) if whole_record else _cut_chunk(library, body):
                _take(library, record, found)
            lost += not whole_record
        # Whatever the library raises for damaged bytes, the other parts of the file can be read.
        except Exception:
            lost += 1
        on_bytes(end - at)
        at = end
    if lost:
        found.warnings.append(f"damaged or cut parts of the file, left out: {lost}")
    if not ended:
        found.warnings.append("the file is cut or damaged: it does not end as MCAP does")
    strange = [channel for channel in found.messages if channel not in found.channels]
    if strange:
        count = sum(len(found.messages.pop(channel)) for channel in strange)
        found.warnings.append(f"{count} messages are of channels that the file does not describe: left out")


def _chunks(library: Any, data: bytes) -> list[int]:  # noqa: ANN401 - a module
    """Return the offsets of the chunks according to the index at the end of the file; empty where it is damaged."""
    footer, starts = len(data) - len(MAGIC) - _FOOTER, list[int]()
    if footer < len(MAGIC) or data[footer] != library.opcode.Opcode.FOOTER or not data.endswith(MAGIC):
        return starts
    (at,) = struct.unpack_from("<Q", data, footer + _FRONT)
    while len(MAGIC) < at < footer:
        (length,) = struct.unpack_from("<Q", data, at + 1)
        if data[at] == library.opcode.Opcode.CHUNK_INDEX and length >= 3 * 8:
            starts.append(struct.unpack_from("<Q", data, at + _FRONT + 16)[0])
        at += _FRONT + length
    return sorted(starts)


def _records(library: Any, opcode: int, body: bytes) -> Sequence[Any]:  # noqa: ANN401 - a module and records
    """Parse one record: those of a chunk, a record with content, or none."""
    records, kinds = library.records, library.opcode.Opcode
    stream = library.data_stream.ReadDataStream(io.BytesIO(body))
    if opcode == kinds.MESSAGE:
        return [records.Message.read(stream, len(body))]
    if opcode == kinds.CHUNK:
        chunk = records.Chunk.read(stream)
        if chunk.uncompressed_size > MOST_CHUNK:
            raise BorderError(f"a chunk of more than {MOST_CHUNK} bytes")
        return library.stream_reader.breakup_chunk(chunk, validate_crc=True)
    kind = {
        kinds.SCHEMA: records.Schema, kinds.CHANNEL: records.Channel, kinds.METADATA: records.Metadata,
        kinds.ATTACHMENT: records.Attachment,
    }.get(opcode)  # fmt: skip
    return [] if kind is None else [kind.read(stream)]


def _cut_chunk(library: Any, body: bytes) -> Iterator[Any]:  # noqa: ANN401 - a module and records
    """Yield the records of a chunk whose end is missing, up to the first one that is not whole."""
    import zstandard  # imported late: both come with the optional mcap
    from lz4.frame import LZ4FrameDecompressor

    stream = library.data_stream.ReadDataStream(io.BytesIO(body))
    stream.read(8 + 8 + 8 + 4)  # times, size, checksum
    compression, _ = stream.read_prefixed_string(), stream.read8()
    data = body[stream.count :]
    if compression == "zstd":
        data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
    elif compression == "lz4":
        data = LZ4FrameDecompressor().decompress(data)
    at = 0
    while at + _FRONT < len(data):
        (length,) = struct.unpack_from("<Q", data, at + 1)
        if at + _FRONT + length > len(data):
            return
        yield from _records(library, data[at], data[at + _FRONT : at + _FRONT + length])
        at += _FRONT + length


def _take(library: Any, record: Any, found: Collected) -> None:  # noqa: ANN401 - a module and a record
    """Take a record's content."""
    records = library.records
    if isinstance(record, records.Message):
        found.add(record.channel_id, record.log_time, record.data)
    elif isinstance(record, records.Schema):
        found.schemas[record.id] = record
    elif isinstance(record, records.Channel):
        schema = found.schemas.get(record.schema_id)
        text, name = "", record.message_encoding
        if schema is not None:
            name = schema.name
            if schema.encoding == "ros1msg" and record.message_encoding == "ros1":
                text = schema.data.decode(errors="replace")
        found.add_channel(record.id, record.topic, name, text, record.metadata)
    elif isinstance(record, records.Metadata):
        found.facts |= record.metadata if record.name == OURS else {}
    elif isinstance(record, records.Attachment) and record.media_type == _JSON:
        found.attachments[record.name] = record.data
