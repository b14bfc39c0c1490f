"""Tuned parameters: numbers within bounds, mapped to coordinates of a search."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spidar_gym.errors import InvalidValueError


@dataclass(frozen=True)
class Parameter:
    """One tuned number with its bounds."""

    name: str
    """Name in the log."""
    start: float
    """First guess."""
    low: float
    """Least value."""
    high: float
    """Largest value."""
    linear: bool = False
    """Whether equal steps are equal differences, for numbers that may be 0 or negative, instead of equal ratios."""

    def __post_init__(self) -> None:
        """Refuse bounds that do not contain the first guess."""
        if not self.low <= self.start <= self.high or not (self.linear or self.low > 0.0):
            raise InvalidValueError(
                self.name, (self.low, self.start, self.high), "low ≤ start ≤ high, above 0 unless linear"
            )

    def value(self, u: float) -> float:
        """Return the number for a coordinate: 0 is the start, ± 1 the bounds; coordinates beyond ± 1 are reflected."""
        u = 1.0 - abs((u + 1.0) % 4.0 - 2.0)  # a triangle wave through (−1, −1), (1, 1)
        end = self.high if u > 0.0 else self.low
        if self.linear:
            return self.start + (end - self.start) * abs(u)
        return self.start * (end / self.start) ** abs(u)


def decode(parameters: Sequence[Parameter], x: np.ndarray) -> dict[str, float]:
    """Convert a point of the search, shape (n,), to parameters: name → number."""
    return {p.name: p.value(u) for p, u in zip(parameters, np.asarray(x, float).tolist(), strict=True)}
