"""Records as folders of CSV: a file for each topic, whose first line names the columns with their units."""

import csv
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from spidar_gym.files import output_folder, whole_file
from spidar_gym.logs.record import Record, Series
from spidar_gym.robot import JOINT_NAMES, N_JOINTS

_PIECE = 5000
"""Lines between two calls for progress."""


def write_csv(record: Record, folder: Path, *, on_messages: Callable[[int], object] = lambda count: None) -> list[Path]:
    """Write a record as a folder, each file atomically; numbers keep all their digits.

    Args:
        record: The record.
        folder: The folder; its other files stay.
        on_messages: Called with a number of messages that have been written, for progress.

    Returns:
        The files.

    Raises:
        SpidarError: If a file cannot be written.
    """
    files, parent = list[Path](), output_folder(folder)
    for topic, series in record.series.items():
        path = parent / f"{topic.replace('/', '.')}.csv"
        with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(_heading(series))
            columns = list(_columns(series))
            for at in range(0, len(series), _PIECE):
                piece = [column[at : at + _PIECE].tolist() for column in columns]
                writer.writerows(zip(*piece, strict=True))
                on_messages(len(piece[0]))
        files.append(path)
    return files


def _heading(series: Series) -> list[str]:
    """Return the names of the columns, with units."""
    names = ["time [s]", "received [s]"]
    for name, values in series.values.items():
        unit = series.unit(name)
        entries = _entries(values.shape[1:], series.names) if values.ndim > 1 else [""]
        names += [f"{name}{entry}{f' [{unit}]' if unit else ''}" for entry in entries]
    return names


def _entries(shape: tuple[int, ...], names: tuple[str, ...]) -> list[str]:
    """Return the endings of the names of a column's entries: axes, joints, rotors from 1 on."""
    found = [""]
    for size in shape:
        known = {3: "xyz", 4: "wxyz", N_JOINTS: JOINT_NAMES, 2: ("phi", "theta")}.get(size)
        own = names if len(names) == size else known or [str(k + 1) for k in range(size)]
        found = [f"{front}.{entry}" for front in found for entry in own]
    return found


def _columns(series: Series) -> Iterator[Any]:
    """Yield the columns (n,) in the order of the heading."""
    yield from (series.time, series.received)
    for values in series.values.values():
        yield from values.reshape(len(series), -1).T if values.ndim > 1 else (values,)
