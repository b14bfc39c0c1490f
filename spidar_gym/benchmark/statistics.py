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
    """Statistic of the data."""
    low: float
    """2.5th percentile of the draws."""
    high: float
    """97.5th percentile of the draws."""


Numbers = np.ndarray | np.floating
"""One number, or one for each draw."""
Strata = Sequence[tuple[np.ndarray, np.ndarray]]
"""For each track the errors of the base (…, scenarios) and of a policy (…, runs, scenarios)."""


def named_generator(*words: str) -> np.random.Generator:
    """Return a generator for one interval, seeded by words, so that the interval does not depend on other intervals."""
    return np.random.Generator(np.random.PCG64([zlib.crc32(word.encode()) for word in words]))


def iqm(values: np.ndarray) -> Numbers:
    """Compute the interquartile mean over the last axis; values at the quartiles are weighted by fractions."""
    x = np.sort(np.asarray(values, float), axis=-1)
    n = x.shape[-1]
    edges = np.clip(np.array([np.arange(n), np.arange(1, n + 1)]) / n, 0.25, 0.75)
    weights = edges[1] - edges[0]
    return x @ weights / weights.sum()


def ratio_score(base: np.ndarray, own: np.ndarray) -> Numbers:
    """Compute the score: mean error of the base over mean error of the policy; above 1 is better than the base.

    Args:
        base: Errors of the base, shape (…, scenarios).
        own: Errors of the policy on the same scenarios, shape (…, runs, scenarios).
    """
    return np.mean(base, axis=-1) / np.mean(own, axis=(-1, -2))


def paired_difference(base: np.ndarray, own: np.ndarray) -> Numbers:
    """Compute the IQM of the paired differences over the base's IQM; −0.5 is half the error. Shapes: `ratio_score`."""
    return iqm(np.mean(own, axis=-2) - base) / iqm(base)


def improvement(base: np.ndarray, own: np.ndarray) -> Numbers:
    """Compute the probability of an error below the base's; ties count half. Shapes as in `ratio_score`."""
    base = np.asarray(base)[..., None, :]
    return np.mean((own < base) + 0.5 * (own == base), axis=(-1, -2))


def stratified_bootstrap(
    strata: Strata, statistic: Callable[[Strata], Numbers], rng: np.random.Generator, *, draws: int = DRAWS
) -> Interval:
    """Compute the 95 % bootstrap interval of a statistic of paired errors, stratified by tracks.

    Args:
        strata: Errors of base and policy, track by track. Every draw samples the scenarios of each track with
            replacement, the same for base and policy, and the policy's runs with replacement.
        statistic: Strata → number, for all draws at once: their axis comes first.
        rng: Random generator; is advanced.
        draws: Number of draws.
    """
    drawn = []
    for base, own in strata:
        scenarios = rng.integers(0, len(base), (draws, len(base)))
        runs = rng.integers(0, len(own), (draws, len(own)))
        drawn.append((base[scenarios], own[runs[:, :, None], scenarios[:, None, :]]))
    low, high = np.percentile(statistic(drawn), [2.5, 97.5]).tolist()
    return Interval(float(statistic(strata)), low, high)


def on_one_track(statistic: Callable[[np.ndarray, np.ndarray], Numbers]) -> Callable[[Strata], Numbers]:
    """Convert a statistic of one track to a statistic of strata."""
    return lambda strata: statistic(*strata[0])


def overall_score(strata: Strata) -> Numbers:
    """Compute the geometric mean of the tracks' scores, so that all tracks have equal weight."""
    return np.exp(np.mean([np.log(ratio_score(base, own)) for base, own in strata], axis=0))


@dataclass(frozen=True)
class Change:
    """Comparison of a controller with a base on the same scenarios."""

    before: float
    """IQM of the base's errors."""
    after: float
    """IQM of the controller's errors."""
    relative: float
    """IQM of the paired differences over `before`; −0.5 is half the error."""
    low: float
    """Lower end of the 95 % bootstrap interval of `relative` over scenarios and runs."""
    high: float
    """Upper end of the interval."""


def compare(before: np.ndarray, after: np.ndarray, rng: np.random.Generator) -> Change:
    """Compare two controllers on the same scenarios, with intervals over scenarios and runs.

    Args:
        before: Errors of the base, shape (scenarios,).
        after: Errors of the compared controller, shape (runs, scenarios).
        rng: Random generator; is advanced.
    """
    change = stratified_bootstrap([(before, after)], on_one_track(paired_difference), rng)
    return Change(float(iqm(before)), float(iqm(after.mean(axis=0))), change.value, change.low, change.high)
