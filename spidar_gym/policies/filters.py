"""Memory of a learned policy: low-pass filters of its observations and actions."""

import math

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import require_not_negative


def shares(name: str, times: np.ndarray) -> np.ndarray:
    """Return the share by which a low-pass of each time constant [s] approaches its input per tick; 0 for none."""
    for time in times.tolist():
        require_not_negative(**{name: time})
    return np.array([-math.expm1(-1.0 / (CONTROL_RATE * t)) if t > 0.0 else 0.0 for t in times.tolist()])


class Washout:
    """First-order high-pass on entries of an action: constant offsets fade."""

    def __init__(self, times: np.ndarray) -> None:
        """Begin with a low-passed action of zero.

        Args:
            times: Time constant of every entry of the action [s], 0 for unfiltered ones; or empty for none.

        Raises:
            InvalidValueError: For a time that is negative or not finite.
        """
        self.share = shares("washout", times)
        """Share by which the low-pass of each entry approaches the action per tick."""
        self.reset()

    def reset(self, *robots: int) -> None:
        """Reset the filter, of one robot or of a number of robots."""
        self.low_passed = np.zeros((*robots, len(self.share)))
        """Low-passed actions."""

    def __call__(self, action: np.ndarray) -> np.ndarray:
        """Return the filtered action of this tick in the input's type; filtered entries are clipped to ± 1."""
        if not self.share.any():
            return action
        self.low_passed = self.low_passed + self.share * (action - self.low_passed)
        washed = np.clip(action - self.low_passed, -1.0, 1.0).astype(action.dtype)
        return np.where(self.share > 0.0, washed, action)


class Traces:
    """First-order low-passes of entries of an observation, appended to it: averages, and integrals of errors."""

    def __init__(self, entries: np.ndarray, times: np.ndarray) -> None:
        """Begin at 0.

        Args:
            entries: Indices of the observation's entries.
            times: Time constants [s]; each entry has a trace for each of them.

        Raises:
            InvalidValueError: For a time that is negative or not finite.
        """
        self.entries = entries.astype(int)
        self.share = np.repeat(shares("trace_times", times), len(entries))
        """Share by which each trace approaches its entry per tick, ordered by time constant."""
        self._of = np.tile(self.entries, len(times))
        self.reset()

    def reset(self, *robots: int) -> None:
        """Reset the traces, of one robot or of a number of robots."""
        self.low_passed = np.zeros((*robots, len(self.share)))
        """Traces."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Update the traces with this tick's observation and append them to it."""
        if not len(self.share):
            return observation
        self.low_passed = self.low_passed + self.share * (observation[..., self._of] - self.low_passed)
        return np.concatenate([observation, self.low_passed], axis=-1)

    def begin(self, robots: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Append newly begun traces to the first observations of some robots' episodes.

        Args:
            robots: Indices of the robots, (number,).
            observations: First observations of these robots, (number, size).
        """
        self.low_passed[robots] = self.share * observations[:, self._of]
        return np.concatenate([observations, self.low_passed[robots]], axis=-1)
