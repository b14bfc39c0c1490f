"""Searches without a gradient: what is to be tried next follows from what was tried and what it cost."""

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from spidar_gym.errors import InvalidValueError, MissingDependencyError, require_above, require_least, require_name
from train.lib.envs import training_seed


@dataclass(frozen=True)
class SearchConfig:
    """How numbers within ± 1 are searched for."""

    method: str = "cma"
    """Method: cma is CMA-ES with a diagonal covariance, pairs the differences of paired trials."""
    generations: int = 60
    """How often it learns what its trials cost."""
    population: int = 12
    """Trials of a generation."""
    spread: float = 0.2
    """Standard deviation of a number's change in a trial, of CMA-ES at the beginning."""
    rate: float = 0.04
    """Pairs: root mean square of a generation's changes of the numbers at the beginning; it falls to 0 evenly."""
    momentum: float = 0.7
    """Pairs: fraction of the last generation's direction that the next one keeps."""

    def __post_init__(self) -> None:
        require_name("method", self.method, METHODS)
        require_least(1, generations=self.generations)
        require_least(2, population=self.population)
        require_above("1", spread=self.spread)
        if self.method == "pairs" and self.population % 2:
            raise InvalidValueError("population", self.population, "an even number: each direction has two sides")


class Search(Protocol):
    """A search: after it was told the same costs it is in the same state, so those are all that is kept of it."""

    @property
    def mean(self) -> np.ndarray:
        """What it takes for the best now (size,)."""
        ...

    def ask(self) -> np.ndarray:
        """What to try, within ± 1 (population, size)."""
        ...

    def tell(self, costs: np.ndarray) -> None:
        """What it cost (population,)."""
        ...


class Pairs:
    """Each direction up and down: the numbers move along the directions by the differences of the costs.

    Augmented random search [Mania2018], its step normalised, with momentum.
    """

    def __init__(self, config: SearchConfig, size: int, seed: int) -> None:
        """Begin at 0."""
        self.mean = np.zeros(size)
        self._config, self._seed, self._generation = config, seed, 0
        self._way, self._directions = np.zeros(size), np.zeros((0, size))

    def ask(self) -> np.ndarray:
        """One side of all directions, then the other."""
        rng = np.random.Generator(np.random.PCG64(training_seed(self._seed, 5, self._generation)))
        self._directions = rng.standard_normal((self._config.population // 2, self.mean.size))
        steps = self._config.spread * np.concatenate([self._directions, -self._directions])
        return np.clip(self.mean + steps, -1.0, 1.0)

    def tell(self, costs: np.ndarray) -> None:
        """Move."""
        config, half = self._config, len(self._directions)
        self._way = config.momentum * self._way - (costs[:half] - costs[half:]) @ self._directions
        size = float(np.sqrt(np.mean(self._way**2)))
        if size > 0.0:
            rate = config.rate * (1.0 - self._generation / config.generations)
            self.mean = np.clip(self.mean + rate * self._way / size, -1.0, 1.0)
        self._generation += 1


class Evolution:
    """CMA-ES of the library `cma`, with a diagonal covariance: sooner there in tens of numbers."""

    def __init__(self, config: SearchConfig, size: int, seed: int) -> None:
        """Begin at 0 (`MissingDependencyError` without the library)."""
        try:
            import cma
        except ModuleNotFoundError as error:
            raise MissingDependencyError("cma", "pip install -e '.[train]'") from error

        # Of its own: whatever draws from NumPy's global generator meanwhile would change the search.
        draw = np.random.RandomState(training_seed(seed, 5) % 2**32).randn
        options = {
            "popsize": config.population, "randn": draw, "seed": math.nan, "verbose": -9, "CMA_diagonal": True,
            "bounds": [-1.0, 1.0],
        }  # fmt: skip
        self._evolution: Any = cma.CMAEvolutionStrategy(np.zeros(size), config.spread, options)
        self._points: Any = []

    @property
    def mean(self) -> np.ndarray:
        """Mean of the distribution, within the bounds."""
        return np.array(self._evolution.result.xfavorite, float)

    def ask(self) -> np.ndarray:
        """A generation."""
        self._points = self._evolution.ask()
        return np.array(self._points, float)

    def tell(self, costs: np.ndarray) -> None:
        """Adapt."""
        self._evolution.tell(self._points, costs.tolist())


METHODS = {"pairs": Pairs, "cma": Evolution}
"""Searches by name."""


def make_search(config: SearchConfig, size: int, seed: int) -> Search:
    """A search among `size` numbers, at its beginning."""
    return METHODS[config.method](config, size, seed)
