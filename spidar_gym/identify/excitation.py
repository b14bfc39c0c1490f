"""The excitations of a test of the robot, from the mission in its log: `excite.c` adds the same signals."""

import json
from dataclasses import dataclass

import numpy as np

from spidar_gym.identify.estimate import UnfitLogError
from spidar_gym.logs.record import Record
from spidar_gym.onboard.runner_structs import Excited, Shape, Stage

MISSION = "mission.json"
"""Attachment of a log with the runner's mission."""
RAMP = 1.0
"""Time over which a sine or a chirp begins and ends, at most a quarter of its duration [s]."""


@dataclass(frozen=True)
class Excitation:
    """A signal that is added to the target of a joint or to the thrust of a module."""

    excited: Excited
    """What it is added to."""
    index: int
    """Index of the joint or module, from 0."""
    shape: Shape
    """Shape."""
    start: float
    """Begin, since the take-over [s]."""
    end: float
    """End [s]."""
    amplitude: float
    """Amplitude [rad] or [N]."""
    frequency: float
    """Frequency at the begin [Hz]."""
    last_frequency: float
    """Frequency at the end [Hz]."""

    def at(self, time: np.ndarray) -> np.ndarray:
        """Return its value at times since the take-over (n,) [s]."""
        since, span = time + 1e-9 - self.start, self.end - self.start
        turns = since * (self.frequency + 0.5 * (self.last_frequency - self.frequency) * since / span)
        if self.shape == Shape.SQUARE:
            value = np.where(turns - np.floor(turns) < 0.5, 1.0, -1.0)
        else:
            ramp = np.minimum(since, span - since) / min(RAMP, 0.25 * span)
            value = np.minimum(1.0, ramp) * np.sin(2.0 * np.pi * turns)
        return np.where((since >= 0.0) & (since < span), self.amplitude * value, 0.0)


def excitations_of(record: Record) -> tuple[Excitation, ...]:
    """Return the excitations of a log's mission (`UnfitLogError` for a log without a mission)."""
    if MISSION not in record.attachments:
        raise UnfitLogError("mission", "a log of the runner, or an MCAP that `spidar log convert` wrote from one")
    mission = json.loads(record.attachments[MISSION])
    return tuple(
        Excitation(
            Excited(each["excited"]), each["index"], Shape(each["shape"]), each["start"], each["end"],
            each["amplitude"], each["frequency"], each["last_frequency"],
        )
        for each in mission["excitations"][: mission["excitation_count"]]
    )  # fmt: skip


def excited(record: Record, what: Excited, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times at which the runner drove (n,) [s], and the sums of a log's excitations at them (n, size)."""
    status = record["runner/status"]
    drives = status.values["stage"] == Stage.DRIVING
    ends = np.flatnonzero(drives & (status.values["aborted"] > 0))
    time, since = status.received[drives], status.values["mission_time"][drives]
    found = np.zeros((len(time), size))
    for each in excitations_of(record):
        if each.excited == what:
            found[:, each.index] += each.at(since)
    if len(ends):
        found[time >= status.received[ends[0]]] = 0.0
    return time, found
