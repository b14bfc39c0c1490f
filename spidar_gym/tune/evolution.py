"""How a search goes on from what it is told: CMA-ES where costs are noisy, a pattern search where they are not."""

import math
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

SMALLEST, LEAST = 0.01, 2e-4
"""A coordinate whose step is shorter than this rests; what is not better by this much is no better."""
GROWTH, SHRINK = 1.3, 0.5
"""What becomes of a step that was worth it, and of one that was not."""


@runtime_checkable
class Evolution(Protocol):
    """What asks for points of the search, is told their costs, and rests on nothing else."""

    @property
    def mean(self) -> np.ndarray:
        """The answer so far."""
        ...

    @property
    def sigma(self) -> float:
        """Size of its steps."""
        ...

    def ask(self) -> list[np.ndarray]:
        """Points that are to be played."""
        ...

    def tell(self, points: Sequence[np.ndarray], costs: Sequence[float]) -> None:
        """Learn what they cost; last stands the cost of the mean."""
        ...


class Cma:
    """CMA-ES with a diagonal covariance [Hansen2016]."""

    def __init__(self, size: int, step: float, population: int, seed: int) -> None:
        """Begin at the origin."""
        import cma

        # Of its own: whatever draws from NumPy's global generator meanwhile would change the search.
        draw = np.random.RandomState(seed + 1).randn
        options = {"popsize": population, "randn": draw, "seed": math.nan, "verbose": -9, "CMA_diagonal": True}
        self._cma: Any = cma.CMAEvolutionStrategy(np.zeros(size), step, options)

    @property
    def mean(self) -> np.ndarray:
        """Mean of the distribution."""
        return self._cma.mean

    @property
    def sigma(self) -> float:
        """Its size."""
        return float(self._cma.sigma)

    def ask(self) -> list[np.ndarray]:
        """Points of the distribution."""
        return self._cma.ask()

    def tell(self, points: Sequence[np.ndarray], costs: Sequence[float]) -> None:
        """Change the distribution; what the mean costs does not count."""
        self._cma.tell(points, list(costs[:-1]))


class Pattern:
    """One coordinate at a time, a step to either side: what is better is kept, and its step grows [Hooke1961].

    On the same scenarios a cost has no noise, so that a thousandth is seen; and where the answer stands at the edge of
    what is allowed, one coordinate finds its way along it that a cloud of points does not fit in.
    """

    def __init__(self, size: int, step: float) -> None:
        """Begin at the origin."""
        self.mean = np.zeros(size)
        self._steps, self._k = np.full(size, step), 0

    @property
    def sigma(self) -> float:
        """The longest step; 0 where all coordinates rest."""
        longest = float(self._steps.max())
        return longest if longest >= SMALLEST else 0.0

    def ask(self) -> list[np.ndarray]:
        """A step to either side along the next coordinate that does not rest."""
        while self._steps[self._k] < SMALLEST and self.sigma:
            self._k = (self._k + 1) % len(self._steps)
        step = np.zeros(len(self.mean))
        step[self._k] = self._steps[self._k]
        return [self.mean + step, self.mean - step]

    def tell(self, points: Sequence[np.ndarray], costs: Sequence[float]) -> None:
        """Go where it costs less."""
        chosen = better(costs)
        if chosen < len(points):
            self.mean = points[chosen]
        self._steps[self._k] *= GROWTH if chosen < len(points) else SHRINK
        self._k = (self._k + 1) % len(self._steps)


def better(costs: Sequence[float]) -> int:
    """Which of the points a pattern search goes to; the last one is where it stands."""
    chosen = int(np.argmin(costs))
    return chosen if costs[chosen] < costs[-1] - LEAST else len(costs) - 1
