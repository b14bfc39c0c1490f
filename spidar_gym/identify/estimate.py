"""An estimated parameter: values, standard deviations, 95 % intervals, and whether a log tells it."""

from dataclasses import dataclass

import numpy as np

from spidar_gym.errors import SpidarError

TWO_SIDED = 1.96
"""Half of a 95 % interval over the standard deviation."""
TOLD = 0.5
"""Share of the deviation known before, below which a log tells a parameter."""


@dataclass(frozen=True)
class Estimate:
    """Estimated numbers of any shape."""

    value: np.ndarray
    """Values."""
    deviation: np.ndarray
    """Standard deviation of each."""
    known: np.ndarray
    """Standard deviation of each before the log."""

    @property
    def low(self) -> np.ndarray:
        """Lower ends of the 95 % intervals."""
        return np.asarray(self.value - TWO_SIDED * self.deviation)

    @property
    def high(self) -> np.ndarray:
        """Upper ends of the 95 % intervals."""
        return np.asarray(self.value + TWO_SIDED * self.deviation)

    @property
    def told(self) -> np.ndarray:
        """Whether the log tells each number."""
        return np.asarray(self.deviation < TOLD * self.known)

    def over(self, number: float) -> "Estimate":
        """Return the numbers divided by a number that is known."""
        return Estimate(*(np.array(own / number) for own in (self.value, self.deviation, self.known)))

    def mean(self) -> "Estimate":
        """Return one number for all: the weighted mean, with the scatter beyond the deviations in its deviation."""
        weight = 1.0 / np.maximum(self.deviation, 1e-12) ** 2
        value = float((weight * self.value).sum() / weight.sum())
        own = 1.0 / weight.sum()
        scatter = max(0.0, float((weight * (self.value - value) ** 2).sum() / weight.sum()) - self.value.size * own)
        return Estimate(np.array(value), np.array(np.sqrt(own + scatter)), np.array(self.known.mean()))


class UnfitLogError(SpidarError):
    """Raised when a log does not hold what an estimate needs."""

    def __init__(self, missing: str, valid: str) -> None:
        """State what is missing, and what would have been valid."""
        super().__init__(f"the log has no {missing}; valid: {valid}")
