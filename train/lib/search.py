"""Gradient-free searches: propose the next trials from the costs of the previous ones."""

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from spidar_gym.errors import InvalidValueError, MissingDependencyError, require_above, require_least, require_name
from train.lib.envs import training_seed


@dataclass(frozen=True)
class SearchConfig:
    """Search for parameters within ± 1."""

    method: str = "cma"
    """Search method: cma is CMA-ES with a diagonal covariance; pairs is random search with paired trials."""
    generations: int = 60
    """Number of generations."""
    population: int = 12
    """Number of trials in a generation."""
    spread: float = 0.2
    """Standard deviation of a parameter's change in a trial; for CMA-ES its initial value."""
    rate: float = 0.04
    """Pairs: initial root mean square of the parameters' change in a generation; it falls linearly to 0."""
    momentum: float = 0.7
    """Pairs: fraction of the previous generation's direction that the next one keeps."""

    def __post_init__(self) -> None:
        require_name("method", self.method, METHODS)
        require_least(1, generations=self.generations)
        require_least(2, population=self.population)
        require_above("1", spread=self.spread)
        if self.method == "pairs" and self.population % 2:
            raise InvalidValueError("population", self.population, "an even number: each direction has two sides")


class Search(Protocol):
    """Interface of a search; its state depends only on the costs it received, so a checkpoint stores only those."""

    @property
    def mean(self) -> np.ndarray:
        """Current estimate of the optimum (size,)."""
        ...

    def ask(self) -> np.ndarray:
        """Return the next trials, within ± 1 (population, size)."""
        ...

    def tell(self, costs: np.ndarray) -> None:
        """Update the search with the costs of the trials (population,)."""
        ...


class Pairs:
    """Augmented random search [Mania2018] with a normalised step and momentum.

    Each random direction is tried with both signs; the parameters move along it by the difference of the two costs.
    """

    def __init__(self, config: SearchConfig, size: int, seed: int) -> None:
        """Start at zero."""
        self.mean = np.zeros(size)
        self._config, self._seed, self._generation = config, seed, 0
        self._way, self._directions = np.zeros(size), np.zeros((0, size))

    def ask(self) -> np.ndarray:
        """Return the trials: the mean plus each direction, then the mean minus each direction."""
        rng = np.random.Generator(np.random.PCG64(training_seed(self._seed, 5, self._generation)))
        self._directions = rng.standard_normal((self._config.population // 2, self.mean.size))
        steps = self._config.spread * np.concatenate([self._directions, -self._directions])
        return np.clip(self.mean + steps, -1.0, 1.0)

    def tell(self, costs: np.ndarray) -> None:
        """Move the mean along the directions."""
        config, half = self._config, len(self._directions)
        self._way = config.momentum * self._way - (costs[:half] - costs[half:]) @ self._directions
        size = float(np.sqrt(np.mean(self._way**2)))
        if size > 0.0:
            rate = config.rate * (1.0 - self._generation / config.generations)
            self.mean = np.clip(self.mean + rate * self._way / size, -1.0, 1.0)
        self._generation += 1


class Evolution:
    """CMA-ES of the library `cma` with a diagonal covariance, which converges faster for tens of parameters."""

    def __init__(self, config: SearchConfig, size: int, seed: int) -> None:
        """Start at zero (`MissingDependencyError` if `cma` is not installed)."""
        try:
            import cma
        except ModuleNotFoundError as error:
            raise MissingDependencyError("cma", "pip install -e '.[train]'") from error

        # A separate generator: other users of NumPy's global generator would change the search.
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
        """Sample a generation of trials."""
        self._points = self._evolution.ask()
        return np.array(self._points, float)

    def tell(self, costs: np.ndarray) -> None:
        """Adapt the distribution to the costs."""
        self._evolution.tell(self._points, costs.tolist())


METHODS = {"pairs": Pairs, "cma": Evolution}
"""Searches by name."""


def make_search(config: SearchConfig, size: int, seed: int) -> Search:
    """Create a search for `size` parameters, in its initial state."""
    return METHODS[config.method](config, size, seed)
