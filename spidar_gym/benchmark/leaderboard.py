"""Leaderboard: scores of rows with intervals, by track and over all tracks."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from spidar_gym.benchmark.row import REFERENCE, Row, RowError
from spidar_gym.benchmark.statistics import (
    Interval,
    Numbers,
    improvement,
    iqm,
    named_generator,
    on_one_track,
    overall_score,
    paired_difference,
    ratio_score,
    stratified_bootstrap,
)
from spidar_gym.benchmark.track import CALIBRATED, TRACKS, by_group


def _tracks_of(group: str) -> list[str]:
    return [name for name, track in TRACKS.items() if track.group == group]


FRONT = {group: _tracks_of(group) for group in CALIBRATED.values()}
"""Groups of calibrated tracks and their tracks; their overall scores are the front of the leaderboard."""
GROUPS = {group: _tracks_of(group) for group in ("flight", "ground")}
"""Groups of the nominal part with one overall score, and their tracks."""
RANKED = {**FRONT, **GROUPS}
"""All groups with an overall score; tracks of other groups have only their own scores."""
SHOWN: dict[str, tuple[tuple[str, str, float, int], ...]] = by_group({
    "flight": (
        ("position_rms_m", "pos. mm", 1e3, 1), ("attitude_rms_rad", "att. mrad", 1e3, 1),
        ("joint_rms_rad", "joints mrad", 1e3, 1), ("energy_wh", "Wh", 1.0, 2), ("endurance_min", "endur. min", 1.0, 2),
        ("thrust_mean", "Σλ/mg", 1.0, 3), ("torque_share", "τ share", 1.0, 2), ("violations", "violated %", 1e2, 1),
        ("unsolved", "unsolved", 1.0, 2),
    ),
    "ground": (
        ("final_error_m", "final mm", 1e3, 1), ("final_yaw_rad", "yaw mrad", 1e3, 1), ("drift", "drift mm/m", 1e3, 1),
        ("attitude_rms_rad", "tilt mrad", 1e3, 1), ("joint_rms_rad", "joints mrad", 1e3, 1),
        ("slip_m", "slip mm", 1e3, 0), ("duration_s", "s", 1.0, 1), ("energy_wh", "Wh", 1.0, 2),
        ("cost_of_transport", "CoT", 1.0, 1),
        ("thrust_mean", "Σλ/mg", 1.0, 3), ("torque_share", "τ share", 1.0, 2), ("violations", "violated %", 1e2, 1),
        ("unsolved", "unsolved", 1.0, 2),
    ),
    "course": (
        ("duration_s", "s", 1.0, 1), ("flown_s", "flown s", 1.0, 1), ("crawled_s", "crawled s", 1.0, 1),
        ("energy_wh", "Wh", 1.0, 2), ("final_error_m", "final mm", 1e3, 1), ("final_yaw_rad", "yaw mrad", 1e3, 1),
        ("attitude_rms_rad", "tilt mrad", 1e3, 1), ("hit_n", "contact N", 1.0, 1), ("thrust_mean", "Σλ/mg", 1.0, 3),
        ("torque_share", "τ share", 1.0, 2), ("unsolved", "unsolved", 1.0, 2),
    ),
    "grasp": (
        ("duration_s", "s", 1.0, 1), ("energy_wh", "Wh", 1.0, 1), ("final_error_m", "final mm", 1e3, 1),
        ("final_yaw_rad", "yaw mrad", 1e3, 1), ("lifted_m", "lifted m", 1.0, 2), ("force_n", "force N", 1.0, 1),
        ("force_share", "force share", 1.0, 2), ("tries", "tries", 1.0, 0), ("attitude_rms_rad", "tilt mrad", 1e3, 1),
        ("thrust_mean", "Σλ/mg", 1.0, 3), ("torque_share", "τ share", 1.0, 2), ("unsolved", "unsolved", 1.0, 2),
    ),
})  # fmt: skip
"""Metrics of the tables by group: name, heading, factor, digits; medians over runs and scenarios."""
COUNTED = ("unsolved", "violations")
"""Metrics of `SHOWN` that are means, not medians."""


@dataclass(frozen=True)
class Part:
    """Results of a row over the robots of one variant or mixture of a calibrated world."""

    error: float
    """IQM of the errors."""
    failed: float
    """Share of failed scenarios."""
    scenarios: int
    """Number of scenarios."""


@dataclass(frozen=True)
class Cell:
    """Results of a row on a track."""

    score: Interval
    """Mean error of the reference over mean error of the row."""
    difference: Interval
    """IQM of the paired differences over the reference's IQM; below 0 is better."""
    improvement: Interval
    """Probability that a scenario's error is below the reference's."""
    error: float
    """IQM of the errors."""
    success: float
    """Success rate."""
    failed: float
    """Share of failed scenarios, whose error is `CAP`."""
    scenarios: int
    """Number of evaluated scenarios."""
    metrics: dict[str, float]
    """Metrics of `SHOWN`."""
    parts: dict[str, Part]
    """Variant, then mixture of the track's calibrated world → results over its robots; empty without a world."""


@dataclass(frozen=True)
class Board:
    """Results of all rows on all tracks."""

    rows: Mapping[str, Row]
    """Rows by name, the reference first."""
    tracks: list[str]
    """Tracks with at least one row."""
    cells: Mapping[tuple[str, str], Cell]
    """(row, track) → cell."""
    overall: Mapping[tuple[str, str], Interval]
    """(row, group) → geometric mean of the tracks' scores, for rows with all tracks of the group."""
    second: "Board | None" = None
    """Results on the second draw, of the rows that have it; None if the reference lacks it."""

    @property
    def has_front(self) -> bool:
        """Whether a row has an overall score on calibrated tracks."""
        return any(group in FRONT for _, group in self.overall)


def tabulate(rows: Mapping[str, Row]) -> Board:
    """Compute scores and intervals of all rows (`RowError` without the reference row of a track)."""
    seconds = {name: row.second for name, row in rows.items() if row.second is not None}
    for name in dict.fromkeys((REFERENCE, *(TRACKS[track].reference for row in rows.values() for track in row.tracks))):
        if name not in rows:
            raise RowError(f"there is no row {name}, to which scores refer; valid: rows with {name}.json")
    cells = {
        (name, track): cell(row, rows[TRACKS[track].reference], track)
        for name, row in rows.items()
        for track in row.tracks
        if track in common_tracks(row, rows[TRACKS[track].reference])
    }
    overall = {
        (name, group): interval
        for name, row in rows.items()
        for group in RANKED
        if (interval := overall_interval(row, rows[REFERENCE], group)) is not None
    }
    tracks = [track for track in TRACKS if any((name, track) in cells for name in rows)]
    return Board(rows, tracks, cells, overall, tabulate(seconds) if REFERENCE in seconds else None)


def common_tracks(row: Row, base: Row) -> list[str]:
    """Return the tracks on which the base has all scenarios of the row, of the same split."""
    return [
        track
        for track in row.tracks
        if track in base.tracks
        and row.split(track) == base.split(track)
        and set(row.scenarios(track)) <= set(base.scenarios(track))
    ]


def pair(row: Row, base: Row, track: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of the reference (scenarios,) and of the row (runs, scenarios) on the row's scenarios."""
    where = {index: k for k, index in enumerate(base.scenarios(track))}
    return base.errors(track)[0][[where[index] for index in row.scenarios(track)]], row.errors(track)


def cell(row: Row, base: Row, track: str) -> Cell:
    """Compute the results of a row on a track."""
    strata = [pair(row, base, track)]

    def interval(statistic: Callable[[np.ndarray, np.ndarray], Numbers]) -> Interval:
        return stratified_bootstrap(strata, on_one_track(statistic), named_generator(row.name, track))

    metrics = {}
    for name, *_ in SHOWN[TRACKS[track].group]:
        column = row.column(track, name)
        finite = column[np.isfinite(column)]
        middle = np.mean if name in COUNTED else np.median
        metrics[name] = float(middle(finite)) if finite.size else math.nan
    return Cell(
        score=interval(ratio_score),
        difference=interval(paired_difference),
        improvement=interval(improvement),
        error=float(iqm(strata[0][1].reshape(-1))),
        success=float(row.column(track, "success").mean()),
        failed=float(row.column(track, "failed").mean()),
        scenarios=len(strata[0][0]),
        metrics=metrics,
        parts=_parts(row, track),
    )


def _parts(row: Row, track: str) -> dict[str, Part]:
    """Return the results over the robots of each variant, then of each mixture."""
    kind = TRACKS[track]
    if (world := kind.calibration) is None:
        return {}
    pairs = [world.pairs[kind.robots(index).kind] for index in row.scenarios(track)]
    errors, failed = row.errors(track), row.column(track, "failed")
    found = {}
    for name, _ in (*world.variants, *world.mixtures):
        own = [k for k, pair in enumerate(pairs) if name in pair]
        if own:
            found[name] = Part(float(iqm(errors[:, own].reshape(-1))), float(failed[:, own].mean()), len(own))
    return found


def overall_interval(row: Row, base: Row, group: str) -> Interval | None:
    """Compute the score over a group of tracks; None if the row lacks one of them."""
    if not set(RANKED[group]) <= set(common_tracks(row, base)):
        return None
    strata = [pair(row, base, track) for track in RANKED[group]]
    return stratified_bootstrap(strata, overall_score, named_generator(row.name, group))


def ranked(board: Board, groups: Iterable[str]) -> list[str]:
    """Return the rows with all tracks of one of the groups, by their best overall score, best first."""
    best = {
        name: max(scores)
        for name in board.rows
        if (scores := [board.overall[name, group].value for group in groups if (name, group) in board.overall])
    }
    return sorted(best, key=lambda name: -best[name])


def ranking(board: Board, track: str) -> list[str]:
    """Return the rows on a track, best first: by score, or by success and then error on tracks outside `RANKED`.

    On tracks outside `RANKED` reaching the goal matters. Failures dominate the mean error and hence the score there, so
    that a row which fails in few scenarios but misses the goal in most would lead.
    """
    own = [name for name in board.rows if (name, track) in board.cells]
    cells = {name: board.cells[name, track] for name in own}
    if TRACKS[track].group in RANKED:
        return sorted(own, key=lambda name: -cells[name].score.value)
    return sorted(own, key=lambda name: (-cells[name].success, cells[name].error))


def as_json(board: Board) -> dict[str, Any]:
    """Return the leaderboard as one JSON object."""
    return {
        "overall": [
            {"policy": name, "group": group, **asdict(interval)} for (name, group), interval in board.overall.items()
        ],
        "tracks": [{"policy": name, "track": track, **_finite(asdict(c))} for (name, track), c in board.cells.items()],
        **({} if board.second is None else {"second": as_json(board.second)}),
    }


def summary(row: Row, references: Mapping[str, Row]) -> dict[str, Any]:
    """Return a row's results as JSON, relative to the reference of each track if `references` has it."""
    bases = {track: references.get(TRACKS[track].reference) for track in row.tracks}
    known = {base.name: base.content["sha256"] for base in bases.values() if base is not None}
    return {
        "name": row.name,
        "sha256": row.content["sha256"],
        "reference": known or None,
        "tracks": {
            track: _finite(asdict(cell(row, base or row, track)))
            for track, base in bases.items()
            if track in common_tracks(row, base or row)
        },
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """Replace NaN by None, because JSON has no NaN."""
    metrics = {name: None if math.isnan(value) else value for name, value in values["metrics"].items()}
    return {**values, "metrics": metrics}
