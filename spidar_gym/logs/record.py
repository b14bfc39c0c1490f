"""The neutral form of every log: series of arrays by topic, with units and frames."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from spidar_gym.errors import UnknownNameError
from spidar_gym.logs.topics import FORMATS, Format


@dataclass(frozen=True)
class Series:
    """The messages of one topic; row k of every array is of message k."""

    topic: str
    """Topic without the namespace, one of `FORMATS`."""
    time: np.ndarray
    """Time at which the values were measured or commanded, (n,) [s], after the record's `epoch`: the message's stamp,
    or the time of receipt for messages without one. NaN where a robot sent a stamp that is not finite."""
    received: np.ndarray
    """Time of receipt, (n,) [s]; in logs of the runner that of the tick which used the message."""
    values: Mapping[str, np.ndarray]
    """Arrays (n, …) by the name of their column, in SI units. Numbers that a message lacks are NaN."""
    names: tuple[str, ...] = ()
    """Names of the entries of the columns, for messages with names: joints and gimbals."""

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.time)

    @property
    def format(self) -> Format:
        """Message and columns of the topic."""
        return FORMATS[self.topic]

    def unit(self, column: str) -> str:
        """Return the unit of a column; 1 for numbers without one, empty for text."""
        return self.format.column(column).unit


@dataclass(frozen=True)
class Other:
    """A topic that a record does not hold."""

    kind: str
    """Type of its messages."""
    count: int
    """Number of messages."""


@dataclass(frozen=True)
class Record:
    """What a log holds, whatever its kind."""

    kind: str
    """Kind of the log: `run` of the runner, `bag` of a robot, `simulation`, or `mcap` of other software."""
    series: Mapping[str, Series]
    """Series by topic, in the order of `FORMATS`; topics without messages are absent."""
    epoch: int = 0
    """Time 0 of all series, since 1970 in UTC [s]; 0 where the log does not state it."""
    properties: Mapping[str, str] = field(default_factory=dict)
    """Facts of the log by name: hash of the interface, kind of the mission, version."""
    warnings: tuple[str, ...] = ()
    """What could not be read, a sentence each."""
    others: Mapping[str, Other] = field(default_factory=dict)
    """Topics that are not in `FORMATS`, by their full name."""
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    """Texts in JSON that belong to the log, by file name: the mission."""

    def __getitem__(self, topic: str) -> Series:
        """Return the series of a topic (`UnknownNameError` if the log has none)."""
        if topic not in self.series:
            raise UnknownNameError("topic of this log", topic, self.series)
        return self.series[topic]

    def __contains__(self, topic: str) -> bool:
        """Return whether the log has messages of a topic."""
        return topic in self.series

    def _ends(self) -> list[tuple[float, float]]:
        finite = (series.received[np.isfinite(series.received)] for series in self.series.values())
        return [(float(times.min()), float(times.max())) for times in finite if len(times)]

    @property
    def start(self) -> float:
        """Time of the first message [s]; NaN for a log without messages."""
        return min((first for first, _ in self._ends()), default=math.nan)

    @property
    def end(self) -> float:
        """Time of the last message [s]; NaN for a log without messages."""
        return max((last for _, last in self._ends()), default=math.nan)


def ordered(series: Mapping[str, Series]) -> dict[str, Series]:
    """Return the series that have messages, in the order of `FORMATS`."""
    return {topic: series[topic] for topic in FORMATS if topic in series and len(series[topic])}
