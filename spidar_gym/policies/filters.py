"""What a learned policy remembers: low-passes of what it sees, and of what it does."""

import math

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import require_not_negative


def shares(name: str, times: np.ndarray) -> np.ndarray:
    """Share of the way to its input that a low-pass of each time constant [s] goes in a tick; 0 for none."""
    for time in times.tolist():
        require_not_negative(**{name: time})
    return np.array([-math.expm1(-1.0 / (CONTROL_RATE * t)) if t > 0.0 else 0.0 for t in times.tolist()])


class Washout:
    """A first-order high-pass on entries of an action: what stays fades, so that none drifts into an offset."""

    def __init__(self, times: np.ndarray) -> None:
        """Begin with nothing to take away.

        Args:
            times: Time constant of every entry of the action [s], 0 where it passes unchanged; or none at all.

        Raises:
            InvalidValueError: For a time that is negative or not finite.
        """
        self.share = shares("washout", times)
        """Share of the way to the action that its low-pass goes in a tick."""
        self.reset()

    def reset(self, *robots: int) -> None:
        """Forget the actions so far, of one robot or of so many."""
        self.low_passed = np.zeros((*robots, len(self.share)))
        """The actions, low-passed."""

    def __call__(self, action: np.ndarray) -> np.ndarray:
        """The action of this tick, with its type: where it is washed out within ± 1, elsewhere as it came."""
        if not self.share.any():
            return action
        self.low_passed = self.low_passed + self.share * (action - self.low_passed)
        washed = np.clip(action - self.low_passed, -1.0, 1.0).astype(action.dtype)
        return np.where(self.share > 0.0, washed, action)


class Traces:
    """First-order low-passes of entries of an observation, shown beside it: the past, and of errors their integrals."""

    def __init__(self, entries: np.ndarray, times: np.ndarray) -> None:
        """Begin at 0.

        Args:
            entries: Which entries of the observation.
            times: Time constants [s]; each entry has a trace of every one.

        Raises:
            InvalidValueError: For a time that is negative or not finite.
        """
        self.entries = entries.astype(int)
        self.share = np.repeat(shares("trace_times", times), len(entries))
        """Share of the way to its entry that each trace goes in a tick: those of the first time constant first."""
        self._of = np.tile(self.entries, len(times))
        self.reset()

    def reset(self, *robots: int) -> None:
        """Forget the observations so far, of one robot or of so many."""
        self.low_passed = np.zeros((*robots, len(self.share)))
        """The traces."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The observation with its traces behind it, this tick's told."""
        if not len(self.share):
            return observation
        self.low_passed = self.low_passed + self.share * (observation[..., self._of] - self.low_passed)
        return np.concatenate([observation, self.low_passed], axis=-1)

    def begin(self, robots: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Some robots' first observations of an episode, with traces of nothing else behind them.

        Args:
            robots: Which rows of the traces, (number,).
            observations: Theirs, shape (number, size).
        """
        self.low_passed[robots] = self.share * observations[:, self._of]
        return np.concatenate([observations, self.low_passed[robots]], axis=-1)
