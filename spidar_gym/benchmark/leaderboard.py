"""The leaderboard: rows → scores with intervals, by track and over all tracks."""

import math
from collections.abc import Callable, Mapping
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
from spidar_gym.benchmark.track import TRACKS, by_group

GROUPS = {group: [name for name, track in TRACKS.items() if track.group == group] for group in ("flight", "ground")}
"""Tracks that are summed up in one score; a track of another group stands for itself."""
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
})  # fmt: skip
"""Metrics of the tables by group: name, heading, factor, digits; medians over runs and scenarios."""
COUNTED = ("unsolved", "violations")
"""Metrics of `SHOWN` that are means, not medians."""


@dataclass(frozen=True)
class Cell:
    """A row on a track."""

    score: Interval
    """The reference's mean error over its own."""
    difference: Interval
    """IQM of the paired differences over the reference's IQM; below 0 is better."""
    improvement: Interval
    """Probability that a scenario's error is below the reference's."""
    error: float
    """IQM of the errors."""
    success: float
    """Share of successes."""
    failed: float
    """Share of failures, which cost the cap."""
    scenarios: int
    """How many were played."""
    metrics: dict[str, float]
    """What `SHOWN` lists."""


@dataclass(frozen=True)
class Board:
    """All rows on all tracks."""

    rows: Mapping[str, Row]
    """Rows by name, the reference first."""
    tracks: list[str]
    """Tracks with at least one row."""
    cells: Mapping[tuple[str, str], Cell]
    """(row, track) → cell."""
    overall: Mapping[tuple[str, str], Interval]
    """(row, group) → geometric mean of the tracks' scores, where the row has them all."""


def tabulate(rows: Mapping[str, Row]) -> Board:
    """Scores and intervals of all rows (`RowError` without the reference row of a track)."""
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
        for group in GROUPS
        if (interval := overall_interval(row, rows[REFERENCE], group)) is not None
    }
    tracks = [track for track in TRACKS if any((name, track) in cells for name in rows)]
    return Board(rows, tracks, cells, overall)


def common_tracks(row: Row, base: Row) -> list[str]:
    """Tracks on which both have played the same scenarios of the same split."""
    return [
        track
        for track in row.tracks
        if track in base.tracks
        and row.split(track) == base.split(track)
        and set(row.scenarios(track)) <= set(base.scenarios(track))
    ]


def pair(row: Row, base: Row, track: str) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the reference (scenarios,) and of the row (runs, scenarios) on the row's scenarios."""
    where = {index: k for k, index in enumerate(base.scenarios(track))}
    return base.errors(track)[0][[where[index] for index in row.scenarios(track)]], row.errors(track)


def cell(row: Row, base: Row, track: str) -> Cell:
    """A row on a track."""
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
    )


def overall_interval(row: Row, base: Row, group: str) -> Interval | None:
    """Score over a group of tracks; None where the row lacks one of them."""
    if not set(GROUPS[group]) <= set(common_tracks(row, base)):
        return None
    strata = [pair(row, base, track) for track in GROUPS[group]]
    return stratified_bootstrap(strata, overall_score, named_generator(row.name, group))


def is_ranked(board: Board, name: str) -> bool:
    """Whether a row has all tracks of a group: an overall score."""
    return any((name, group) in board.overall for group in GROUPS)


def ranking(board: Board, track: str) -> list[str]:
    """Rows on a track, the best first: by score, or by success and then error where a track stands apart.

    A track of another group than `GROUPS` is about arriving, and its mean error, of which a score is made, is mostly
    that of the failures: a row that fails in few scenarios and misses the goal in most would lead.
    """
    own = [name for name in board.rows if (name, track) in board.cells]
    cells = {name: board.cells[name, track] for name in own}
    if TRACKS[track].group in GROUPS:
        return sorted(own, key=lambda name: -cells[name].score.value)
    return sorted(own, key=lambda name: (-cells[name].success, cells[name].error))


def as_json(board: Board) -> dict[str, Any]:
    """The leaderboard as one JSON object."""
    return {
        "overall": [
            {"policy": name, "group": group, **asdict(interval)} for (name, group), interval in board.overall.items()
        ],
        "tracks": [{"policy": name, "track": track, **_finite(asdict(c))} for (name, track), c in board.cells.items()],
    }


def summary(row: Row, references: Mapping[str, Row]) -> dict[str, Any]:
    """A row's figures as JSON: against the reference of each track where there is one."""
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
    """NaN as None, which JSON has."""
    metrics = {name: None if math.isnan(value) else value for name, value in values["metrics"].items()}
    return {**values, "metrics": metrics}
