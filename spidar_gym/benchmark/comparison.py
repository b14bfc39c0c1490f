"""Comparison of two rows, metric by metric: paired differences on their common scenarios."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spidar_gym.benchmark.row import Row
from spidar_gym.benchmark.statistics import (
    Change,
    Interval,
    Numbers,
    compare,
    named_generator,
    on_one_track,
    stratified_bootstrap,
)
from spidar_gym.benchmark.track import TRACKS, by_group
from spidar_gym.errors import InvalidValueError
from spidar_gym.text import format_table

_ON_THE_GROUND = {
    "duration_s": ("time", 1.0, "s"), "energy_wh": ("energy", 1.0, "Wh"), "error": ("error", 1.0, ""),
}  # fmt: skip
COMPARED: dict[str, dict[str, tuple[str, float, str]]] = by_group({
    "flight": {
        "position_rms_m": ("position", 1e3, "mm"),
        "attitude_rms_rad": ("attitude", 1e3, "mrad"),
        "error": ("error", 1.0, ""),
    },
    "ground": _ON_THE_GROUND,
    "course": _ON_THE_GROUND,
    "grasp": _ON_THE_GROUND,
})  # fmt: skip
"""Compared metrics of each group of tracks: metric → heading, factor, unit."""


@dataclass(frozen=True)
class Gain(Interval):
    """Difference between the success rates of a row and its base."""

    before: float
    """Success rate of the base."""
    after: float
    """Success rate of the row."""


@dataclass(frozen=True)
class Comparison:
    """Comparison of a row with a base on one track, in SI units."""

    track: str
    """Track."""
    scenarios: int
    """Number of common scenarios."""
    changes: Mapping[str, Change]
    """Metric → change of the IQM."""
    success: Gain
    """Difference of the success rates."""


def _gain(base: np.ndarray, own: np.ndarray) -> Numbers:
    """Return the difference of the means; shapes as in `paired_difference`."""
    return np.mean(own, axis=(-1, -2)) - np.mean(base, axis=-1)


def _compare(row: Row, base: Row, track: str, places: np.ndarray) -> Comparison:
    """Compare a row with a base on a track; `places` (2, scenarios): positions of the common scenarios in both."""

    def columns(metric: str) -> tuple[np.ndarray, np.ndarray]:
        return base.column(track, metric)[0][places[1]], row.column(track, metric)[:, places[0]]

    return compare_columns(columns, TRACKS[track].group, row.name, base.name, track)


def compare_columns(
    columns: Callable[[str], tuple[np.ndarray, np.ndarray]], group: str, name: str, base: str, track: str
) -> Comparison:
    """Compare two sets of results; the names seed the intervals.

    Args:
        columns: Metric → values of the base (scenarios,) and of the compared row (runs, scenarios), on the same
            scenarios.
        group: Group of the track; selects the metrics of `COMPARED`.
        name: Name of the compared row.
        base: Name of the base.
        track: Name of the track or condition.

    Raises:
        InvalidValueError: When a value of the base is 0, so that no relative change exists.
    """
    changes = {}
    for metric in COMPARED[group]:
        before, after = columns(metric)
        if (before <= 0.0).any():
            raise InvalidValueError(f"{metric} of {base} on {track}", float(before.min()), "numbers above 0")
        changes[metric] = compare(before, after, named_generator(name, base, track, metric))
    before, after = columns("success")
    gain = stratified_bootstrap([(before, after)], on_one_track(_gain), named_generator(name, base, track, "success"))
    success = Gain(**vars(gain), before=float(before.mean()), after=float(after.mean()))
    return Comparison(track, before.shape[-1], changes, success)


def compare_rows(row: Row, base: Row) -> list[Comparison]:
    """Compare on every common track, all runs of the row with the first run of the base; the names seed the intervals.

    Raises:
        InvalidValueError: When the rows have no common scenario, or a value of the base is 0.
    """
    found = []
    for track in row.tracks:
        if track not in base.tracks or row.split(track) != base.split(track):
            continue
        where = {index: k for k, index in enumerate(base.scenarios(track))}
        both = [(k, where[index]) for k, index in enumerate(row.scenarios(track)) if index in where]
        if both:
            found.append(_compare(row, base, track, np.array(both).T))
    if not found:
        raise InvalidValueError("base", base.name, f"a row with scenarios of {', '.join(row.tracks)}")
    return found


def comparison_tables(comparisons: Sequence[Comparison]) -> list[list[list[str]]]:
    """Return one table for each group with compared tracks: a heading and one line per track."""
    tables = []
    for group, shown in COMPARED.items():
        own = [c for c in comparisons if TRACKS[c.track].group == group]
        if own:
            heads = ["track", *(heading for heading, *_ in shown.values()), "success"]
            tables.append([heads, *([c.track, *comparison_cells(c, group)] for c in own)])
    return tables


def comparison_cells(comparison: Comparison, group: str, *, digits: int = 0) -> list[str]:
    """Format the changes and the success rates; – where a diverged simulation left no value.

    Args:
        comparison: Comparison to format.
        group: Group of its track.
        digits: Decimal places of percentages.
    """
    cells = []
    for metric, (_, factor, unit) in COMPARED[group].items():
        c = comparison.changes[metric]
        if math.isnan(c.relative):
            cells.append("–")
            continue
        numbers = f"{factor * c.before:.3g} → {factor * c.after:.3g} {unit}".strip()
        relative, low, high = (f"{share:+.{digits}%}" for share in (c.relative, c.low, c.high))
        cells.append(f"{numbers}, {relative} [{low}, {high}]")
    c = comparison.success
    return [*cells, f"{c.before:.0%} → {c.after:.0%} [{c.low:+.0%}, {c.high:+.0%}]"]


def comparison_text(row: Row, base: Row) -> str:
    """Format the comparison of two rows for a terminal."""
    tables = [format_table(cells) for cells in comparison_tables(compare_rows(row, base))]
    return "\n\n".join([f"{row.name} against {base.name}, IQM of paired differences with 95 % intervals:", *tables])
