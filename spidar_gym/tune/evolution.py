"""Search algorithms: CMA-ES for noisy costs, a pattern search for costs without noise."""

import math
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

SMALLEST, LEAST = 0.01, 2e-4
"""Step below which a coordinate is no longer changed, and the least decrease of the cost that counts as better."""
GROWTH, SHRINK = 1.3, 0.5
"""Factors of a step that lowered the cost, and of a step that did not."""


@runtime_checkable
class Evolution(Protocol):
    """Interface of a search algorithm, whose state is determined by the costs that it receives."""

    @property
    def mean(self) -> np.ndarray:
        """Present solution."""
        ...

    @property
    def sigma(self) -> float:
        """Present step size; 0 at the end of the search."""
        ...

    def ask(self) -> list[np.ndarray]:
        """Return the points to evaluate next."""
        ...

    def tell(self, points: Sequence[np.ndarray], costs: Sequence[float]) -> None:
        """Update the search from the costs of the points, followed by the cost of the mean."""
        ...


class Cma:
    """CMA-ES with a diagonal covariance [Hansen2016]."""

    def __init__(self, size: int, step: float, population: int, seed: int) -> None:
        """Begin at the origin."""
        import cma

        # A separate generator: other users of NumPy's global generator would change the search.
        draw = np.random.RandomState(seed + 1).randn
        options = {"popsize": population, "randn": draw, "seed": math.nan, "verbose": -9, "CMA_diagonal": True}
        self._cma: Any = cma.CMAEvolutionStrategy(np.zeros(size), step, options)

    @property
    def mean(self) -> np.ndarray:
        """Mean of the distribution."""
        return self._cma.mean

    @property
    def sigma(self) -> float:
        """Step size of the distribution."""
        return float(self._cma.sigma)

    def ask(self) -> list[np.ndarray]:
        """Sample points of the distribution."""
        return self._cma.ask()

    def tell(self, points: Sequence[np.ndarray], costs: Sequence[float]) -> None:
        """Update the distribution; the cost of the mean is not used."""
        self._cma.tell(points, list(costs[:-1]))


class Pattern:
    """Pattern search: a step to either side of one coordinate at a time; the better point is kept [Hooke1961].

    On fixed scenarios the cost has no noise, so that differences of a thousandth are significant. At the edge of the
    feasible region, single coordinates still make progress along the edge where a cloud of points does not fit.
    """

    def __init__(self, size: int, step: float) -> None:
        """Begin at the origin."""
        self.mean = np.zeros(size)
        self._steps, self._k = np.full(size, step), 0

    @property
    def sigma(self) -> float:
        """Longest step; 0 where all steps are below `SMALLEST`."""
        longest = float(self._steps.max())
        return longest if longest >= SMALLEST else 0.0

    def ask(self) -> list[np.ndarray]:
        """Return a step to either side along the next coordinate whose step is at least `SMALLEST`."""
        while self._steps[self._k] < SMALLEST and self.sigma:
            self._k = (self._k + 1) % len(self._steps)
        step = np.zeros(len(self.mean))
        step[self._k] = self._steps[self._k]
        return [self.mean + step, self.mean - step]

    def tell(self, points: Sequence[np.ndarray], costs: Sequence[float]) -> None:
        """Move to the better point, if any, and adapt the step of the coordinate."""
        chosen = better(costs)
        if chosen < len(points):
            self.mean = points[chosen]
        self._steps[self._k] *= GROWTH if chosen < len(points) else SHRINK
        self._k = (self._k + 1) % len(self._steps)


def better(costs: Sequence[float]) -> int:
    """Return the index of the point that a pattern search moves to; the last point is the present one."""
    chosen = int(np.argmin(costs))
    return chosen if costs[chosen] < costs[-1] - LEAST else len(costs) - 1
