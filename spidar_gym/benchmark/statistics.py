"""Statistics of comparisons: interquartile means, bootstrap intervals over scenarios and runs, paired differences."""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

DRAWS = 2000
"""Bootstrap draws of an interval."""


@dataclass(frozen=True)
class Interval:
    """A number and its 95 % bootstrap interval."""

    value: float
    """The statistic of the data themselves."""
    low: float
    """2.5th percentile of the draws."""
    high: float
    """97.5th percentile."""


Numbers = np.ndarray | np.floating
"""One number, or one for each draw."""
Strata = Sequence[tuple[np.ndarray, np.ndarray]]
"""For each track the errors of the base (…, scenarios) and of a policy (…, runs, scenarios)."""


def named_generator(*words: str) -> np.random.Generator:
    """A generator for one interval, seeded by what it is of, so that it does not depend on which others there are."""
    return np.random.Generator(np.random.PCG64([zlib.crc32(word.encode()) for word in words]))


def iqm(values: np.ndarray) -> Numbers:
    """Interquartile mean over the last axis: the mean of the middle half, quarters of values counted in part."""
    x = np.sort(np.asarray(values, float), axis=-1)
    n = x.shape[-1]
    edges = np.clip(np.array([np.arange(n), np.arange(1, n + 1)]) / n, 0.25, 0.75)
    weights = edges[1] - edges[0]
    return x @ weights / weights.sum()


def ratio_score(base: np.ndarray, own: np.ndarray) -> Numbers:
    """Score: the base's mean error over one's own on the same scenarios; above 1 is better than the base.

    Args:
        base: Errors of the base, shape (…, scenarios).
        own: Errors, shape (…, runs, scenarios).
    """
    return np.mean(base, axis=-1) / np.mean(own, axis=(-1, -2))


def paired_difference(base: np.ndarray, own: np.ndarray) -> Numbers:
    """IQM of the paired differences over the base's IQM: −0.5 is half the error. Shapes as in `ratio_score`."""
    return iqm(np.mean(own, axis=-2) - base) / iqm(base)


def improvement(base: np.ndarray, own: np.ndarray) -> Numbers:
    """Probability that a run's error on a scenario is below the base's; ties count half. Shapes as in `ratio_score`."""
    base = np.asarray(base)[..., None, :]
    return np.mean((own < base) + 0.5 * (own == base), axis=(-1, -2))


def stratified_bootstrap(
    strata: Strata, statistic: Callable[[Strata], Numbers], rng: np.random.Generator, *, draws: int = DRAWS
) -> Interval:
    """95 % interval of a statistic of paired errors, drawn within strata.

    Args:
        strata: Errors of base and policy, track by track. In every draw each track's scenarios are drawn with
            replacement, the same for both, and so are the policy's runs.
        statistic: Strata → number, for all draws at once: their axis comes first.
        rng: Source of the draws.
        draws: How many.
    """
    drawn = []
    for base, own in strata:
        scenarios = rng.integers(0, len(base), (draws, len(base)))
        runs = rng.integers(0, len(own), (draws, len(own)))
        drawn.append((base[scenarios], own[runs[:, :, None], scenarios[:, None, :]]))
    low, high = np.percentile(statistic(drawn), [2.5, 97.5]).tolist()
    return Interval(float(statistic(strata)), low, high)


def on_one_track(statistic: Callable[[np.ndarray, np.ndarray], Numbers]) -> Callable[[Strata], Numbers]:
    """A statistic of one track as one of strata."""
    return lambda strata: statistic(*strata[0])


def overall_score(strata: Strata) -> Numbers:
    """Geometric mean of the tracks' scores, so that no track counts more for its unit."""
    return np.exp(np.mean([np.log(ratio_score(base, own)) for base, own in strata], axis=0))


@dataclass(frozen=True)
class Change:
    """A controller against another on the same scenarios."""

    before: float
    """IQM of the other one's errors."""
    after: float
    """IQM of its own."""
    relative: float
    """IQM of the paired differences over `before`; −0.5 is half the error."""
    low: float
    """Lower end of its 95 % bootstrap interval over scenarios and runs."""
    high: float
    """Upper end."""


def compare(before: np.ndarray, after: np.ndarray, rng: np.random.Generator) -> Change:
    """Paired comparison on the same scenarios, with intervals over them and over one's own runs.

    Args:
        before: Errors of the other one, shape (scenarios,).
        after: Errors, shape (runs, scenarios).
        rng: Source of the draws.
    """
    change = stratified_bootstrap([(before, after)], on_one_track(paired_difference), rng)
    return Change(float(iqm(before)), float(iqm(after.mean(axis=0))), change.value, change.low, change.high)
