"""Series to ROS 1 messages and back, a whole topic at once."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from spidar_gym.logs.record import Series
from spidar_gym.logs.ros1 import Field, Group, decode, encode, paths, texts_of
from spidar_gym.logs.topics import Column, Format, message_fields, names_path, stamp_path

SECOND = 1_000_000_000
"""Nanoseconds per second."""
MOST_SECONDS = 2**32
"""Upper limit (exclusive) of a time in ROS 1 [s]."""


def nanoseconds(times: np.ndarray, epoch: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times as whole nanoseconds since 1970 (n,), and which of them ROS can represent; the others are 0."""
    fits = np.isfinite(times)
    seconds = np.where(fits, times, 0.0)
    fits &= (seconds + epoch >= -0.5e-9) & (seconds + epoch < MOST_SECONDS - 1.0)
    whole = np.floor(np.where(fits, seconds, 0.0))
    rest = np.rint(SECOND * (np.where(fits, seconds, 0.0) - whole)).astype(np.int64)
    return np.where(fits, SECOND * (epoch + whole.astype(np.int64)) + rest, 0), fits


def seconds(found: np.ndarray, epoch: int) -> np.ndarray:
    """Return whole nanoseconds since 1970 as seconds after the epoch; the inverse of `nanoseconds`."""
    whole, rest = np.divmod(found, SECOND)
    return (whole - epoch) + rest / SECOND


# To messages.


def uses_head(series: Series) -> bool:
    """Return whether messages of the lab's present software hold this series."""
    return series.topic == "imu" and "quat_wb" in series.values


def to_messages(series: Series, epoch: int) -> tuple[list[bytes], int]:
    """Write a series as messages.

    Args:
        series: The series.
        epoch: Time 0 of the series [s].

    Returns:
        The messages, and the number of stamps that ROS cannot represent, which are 0.
    """
    fields, form = message_fields(series.format.kind, head=uses_head(series)), series.format
    stamps, fits = nanoseconds(series.time, epoch)
    pairs = np.stack(np.divmod(stamps, SECOND), axis=1)
    known, stamp = list(paths(fields)), stamp_path(fields)
    given, ragged = dict[str, np.ndarray](), dict[str, Column]()
    for column in form.columns:
        found = series.values.get(column.name)
        if found is not None:
            given |= _leaves(column, known, found)
            ragged |= {column.leaves[0]: column} if column.shape is None and not series.names else {}
        elif column.kind.startswith("float") and column.shape is not None:
            # A number that the log lacks is NaN, not 0.
            given |= _leaves(column, known, np.full((len(series), *column.shape), np.nan))
    shared: dict[str, Any] = {"header.frame_id": form.frame, "child_frame_id": "cog" if "cog" in form.topic else ""}
    if names_path(fields):
        shared["name"] = series.names
    messages = [b""] * len(series)
    for rows, texts, width in _alike(series, [given[path] for path in ragged]):
        part = {path: values[rows] for path, values in given.items()}
        for path, column in ragged.items():
            cut = part[path][:, :width]
            part[path] = cut if column.kind.startswith("float") else np.nan_to_num(cut)
        part |= {path: rows for path in ("header.seq",) if path in known}
        part |= {stamp: pairs[rows]} if stamp else {}
        table = encode(fields, len(rows), {**part, **shared, **texts})
        size, data = table.shape[1], table.tobytes()
        for k, row in enumerate(rows.tolist()):
            messages[row] = data[k * size : (k + 1) * size]
    return messages, int((~fits).sum()) if stamp else 0


def _leaves(column: Column, known: Sequence[str], values: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values of a column by the path of their leaf; text has none here."""
    if column.kind == "string":
        return {}
    first, *others = column.leaves
    if others:
        return {leaf: values[:, k] for k, leaf in enumerate(column.leaves)}
    leaf = next((each for each in first.split("|") if each in known), "")
    if not leaf:
        return {}
    flat = values.reshape(len(values), int(np.prod(values.shape[1:]))) if values.ndim > 1 else values
    return {leaf: flat[:, np.argsort(column.order)] if column.order else flat}


def _alike(series: Series, ragged: Sequence[np.ndarray]) -> list[tuple[np.ndarray, dict[str, str], int]]:
    """Group the messages whose texts and lengths of arrays are the same: rows, texts by path, length.

    Args:
        series: The series.
        ragged: Arrays (n, most), in which NaN fills the rows of shorter messages.
    """
    texts = {c.leaves[0]: series.values[c.name] for c in series.format.columns
             if c.kind == "string" and c.name in series.values}  # fmt: skip
    keys = [np.unique(found, return_inverse=True)[1] for found in texts.values()]
    widths = np.zeros(len(series), int)
    for values in ragged:
        if values.shape[1]:
            present = np.isfinite(values)
            last = values.shape[1] - np.argmax(present[:, ::-1], axis=1)
            widths = np.maximum(widths, np.where(present.any(axis=1), last, 0))
    keys.append(widths)
    _, first, group = np.unique(np.stack(keys, axis=1), axis=0, return_index=True, return_inverse=True)
    rows = np.split(np.argsort(group.reshape(-1), kind="stable"), np.cumsum(np.bincount(group.reshape(-1)))[:-1])
    return [
        (own, {path: str(found[k]) for path, found in texts.items()}, int(widths[k]))
        for own, k in zip(rows, first.tolist(), strict=True)
    ]


# From messages.


def to_series(
    form: Format, fields: Sequence[Field], messages: Sequence[bytes], received: np.ndarray, epoch: int,
    only: Sequence[str] | None = None,
) -> tuple[Series, list[str]]:  # fmt: skip
    """Read a series from its messages.

    Args:
        form: Format of the topic.
        fields: Definition of the messages, as in the file.
        messages: The messages.
        received: Times of receipt (n,), whole nanoseconds since 1970.
        epoch: Time 0 of the series [s].
        only: Names of the columns to read; all that the messages have if None.

    Returns:
        The series, and warnings about messages that could not be read.
    """
    groups, damaged = decode(fields, messages)
    kept = np.setdiff1d(np.arange(len(messages)), damaged)
    warnings = [f"{len(damaged)} of {len(messages)} messages of {form.topic} are damaged"] if len(damaged) else []
    own, known = _names(form, fields, groups), list(paths(fields))
    place = {name: k for k, name in enumerate(own)}
    columns = {c: leaves for c in form.columns if (leaves := _found(c, known)) and (only is None or c.name in only)}
    values = {c.name: _blank(c, len(messages), groups, leaves, len(own)) for c, leaves in columns.items()}
    odd, stamp, times = 0, stamp_path(tuple(fields)), seconds(received, epoch)
    for group in groups:
        if stamp:
            pair = group.values[stamp].astype(np.int64)
            times[group.rows] = seconds(SECOND * pair[:, 0] + pair[:, 1], epoch)
        at = [place[name] for name in _group_names(form, group)] if own else []
        odd += any([not _fill(values[c.name], c, leaves, group, at) for c, leaves in columns.items()]) * len(group.rows)
    if odd:
        warnings.append(f"{odd} of {len(messages)} messages of {form.topic} have another number of values: read as nan")
    values = {name: found[kept] for name, found in values.items() if found.ndim < 2 or found.shape[1]}
    return Series(form.topic, times[kept], seconds(received, epoch)[kept], values, own), warnings


def _found(column: Column, known: Sequence[str]) -> tuple[str, ...]:
    """Return the paths of a column's values in a type; empty where the type lacks them."""
    leaves = [next((each for each in leaf.split("|") if each in known), "") for leaf in column.leaves]
    return tuple(leaves) if all(leaves) else ()


def _group_names(form: Format, group: Group) -> tuple[str, ...]:
    """Return the names of the entries in a group: the messages', or those of the topic where they have none."""
    texts = [value for path, value in group.values.items() if path.startswith("name[")]
    return tuple(texts_of(text[:1])[0] for text in texts) or form.names


def _names(form: Format, fields: Sequence[Field], groups: Sequence[Group]) -> tuple[str, ...]:
    """Return the names of the columns' entries: those of the topic first, in its order."""
    if not names_path(tuple(fields)):
        return ()
    found = dict.fromkeys(name for group in groups for name in _group_names(form, group))
    return (*(name for name in form.names if name in found), *(name for name in found if name not in form.names))


def _matches(leaf: str, group: Group) -> list[np.ndarray]:
    """Return a leaf's values in a group; one array per element for an array of messages."""
    if "[]" not in leaf:
        return [group.values[leaf]] if leaf in group.values else []
    front, back = leaf.split("[]")
    return [value for path, value in group.values.items() if path.startswith(f"{front}[") and path.endswith(back)]


def _blank(
    column: Column, count: int, groups: Sequence[Group], leaves: Sequence[str], named: int
) -> np.ndarray:  # fmt: skip
    """Return the array of a column, without values."""
    if column.kind == "string":
        return np.full(count, "", object)
    if column.shape is None:
        sizes = [len(each) if "[]" in leaves[0] else each[0].shape[1] for group in groups
                 if (each := _matches(leaves[0], group))]  # fmt: skip
        return np.full((count, named if named and max(sizes, default=0) else max(sizes, default=0)), np.nan)
    if column.kind.startswith("float"):
        return np.full((count, *column.shape), np.nan)
    return np.zeros((count, *column.shape), np.int64)


def _fill(
    target: np.ndarray, column: Column, leaves: Sequence[str], group: Group, at: Sequence[int]
) -> bool:  # fmt: skip
    """Write a group's values into a column; returns whether their number is valid."""
    rows, found = group.rows, [_matches(leaf, group) for leaf in leaves]
    if column.kind == "string":
        target[rows] = texts_of(found[0][0])
        return True
    if column.shape is None:
        part = np.stack(found[0], axis=1) if "[]" in leaves[0] and found[0] else found[0][0] if found[0] else None
        if part is None or not part.shape[1]:
            return True
        if at and part.shape[1] > len(at):
            return False
        target[np.ix_(rows, np.array(at[: part.shape[1]]) if at else np.arange(part.shape[1]))] = part
        return True
    part = np.stack([each[0] for each in found], axis=1) if len(leaves) > 1 else found[0][0]
    if part.size != len(rows) * int(np.prod(column.shape, dtype=int)):
        return False
    part = part.reshape(len(rows), -1)
    target[rows] = (part[:, list(column.order)] if column.order else part).reshape(len(rows), *column.shape)
    return True
