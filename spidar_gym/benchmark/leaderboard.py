"""The leaderboard: rows → scores with intervals, as text, Markdown and JSON."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from spidar_gym.benchmark.comparison import compare_rows, comparison_tables
from spidar_gym.benchmark.episode import METRICS
from spidar_gym.benchmark.row import REFERENCE, Row, RowError
from spidar_gym.benchmark.statistics import (
    Interval,
    Numbers,
    improvement,
    iqm,
    named_generator,
    one,
    overall_score,
    paired_difference,
    ratio_score,
    stratified_bootstrap,
)
from spidar_gym.benchmark.tables import aligned, piped
from spidar_gym.benchmark.track import CAP, TRACKS

FEWEST_RUNS = 5
"""A learned row with fewer training seeds is flagged."""
GROUPS = {"flight": [n for n, t in TRACKS.items() if t.flies], "ground": [n for n, t in TRACKS.items() if not t.flies]}
"""Tracks that are summed up in one score."""
SHOWN = {
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
}  # fmt: skip
"""Metrics of the tables: name, heading, factor, digits; medians over runs and scenarios."""
COUNTED = ("unsolved", "violations")
"""… of which these are means."""


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

    names: list[str]
    """Rows, the reference first."""
    rows: Mapping[str, Row]
    """… by name."""
    tracks: list[str]
    """Tracks with at least one row."""
    cells: Mapping[tuple[str, str], Cell]
    """(row, track) → cell."""
    overall: Mapping[tuple[str, str], Interval]
    """(row, group) → geometric mean of the tracks' scores, where the row has them all."""


def tabulate(rows: Mapping[str, Row]) -> Board:
    """Scores and intervals of all rows (`RowError` without the reference row)."""
    if REFERENCE not in rows:
        raise RowError(f"there is no row {REFERENCE}, to which scores refer; valid: rows with {REFERENCE}.json")
    base = rows[REFERENCE]
    cells = {(name, track): cell(row, base, track) for name, row in rows.items() for track in _common(row, base)}
    overall = {
        (name, group): interval
        for name, row in rows.items()
        for group in GROUPS
        if (interval := overall_interval(row, base, group)) is not None
    }
    tracks = [track for track in TRACKS if any((name, track) in cells for name in rows)]
    return Board(list(rows), rows, tracks, cells, overall)


def _common(row: Row, base: Row) -> list[str]:
    """Tracks on which both have played the same scenarios of the same split."""
    return [
        track
        for track in row.tracks
        if track in base.tracks
        and row.content["tracks"][track]["split"] == base.content["tracks"][track]["split"]
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
        return stratified_bootstrap(strata, one(statistic), named_generator(row.name, track))

    metrics = {}
    for name, *_ in SHOWN["flight" if TRACKS[track].flies else "ground"]:
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
    if not set(GROUPS[group]) <= set(_common(row, base)):
        return None
    strata = [pair(row, base, track) for track in GROUPS[group]]
    return stratified_bootstrap(strata, overall_score, named_generator(row.name, group))


def _number(interval: Interval, *, percent: bool = False) -> str:
    if percent:
        return f"{interval.value:+.0%} [{interval.low:+.0%}, {interval.high:+.0%}]"
    return f"{interval.value:.3g} [{interval.low:.3g}, {interval.high:.3g}]"


def _flag(row: Row) -> str:
    """A learned row of too few training seeds is marked."""
    return " †" if row.kind != "classical" and len(row.policies) < FEWEST_RUNS else ""


def _overall_lines(board: Board) -> list[list[str]]:
    lines = [["policy", "class", "runs", "flight", "ground", "success in flight", "… on the ground", "what it is"]]
    order = sorted(
        board.names,
        key=lambda n: -max((board.overall[n, g].value for g in GROUPS if (n, g) in board.overall), default=0.0),
    )
    for name in order:
        row = board.rows[name]
        scores = [_number(board.overall[name, g]) if (name, g) in board.overall else "–" for g in GROUPS]
        success = []
        for tracks in GROUPS.values():
            own = [board.cells[name, t].success for t in tracks if (name, t) in board.cells]
            success.append(f"{np.mean(own):.0%}" if len(own) == len(tracks) else "–")
        lines.append([f"{name}{_flag(row)}", row.kind, str(len(row.policies)), *scores, *success, row.doc])
    return lines


def _track_lines(board: Board, track: str) -> list[list[str]]:
    shown = SHOWN["flight" if TRACKS[track].flies else "ground"]
    lines = [
        [
            "policy",
            "score",
            "error, IQM",
            "against qp",
            "P(better)",
            "success",
            "failed",
            *(head for _, head, *_ in shown),
        ]
    ]
    own = [name for name in board.names if (name, track) in board.cells]
    for name in sorted(own, key=lambda name: -board.cells[name, track].score.value):
        c = board.cells[name, track]
        better = "" if name == REFERENCE else _number(c.difference, percent=True)
        chance = (
            ""
            if name == REFERENCE
            else f"{c.improvement.value:.2f} [{c.improvement.low:.2f}, {c.improvement.high:.2f}]"
        )
        numbers = [
            "–" if math.isnan(c.metrics[key]) else f"{factor * c.metrics[key]:.{digits}f}"
            for key, _, factor, digits in shown
        ]
        lines.append(
            [f"{name}{_flag(board.rows[name])}", _number(c.score), f"{c.error:.3f}", better, chance, f"{c.success:.0%}",
             f"{c.failed:.0%}", *numbers]
        )  # fmt: skip
    return lines


def text(board: Board, tracks: Sequence[str]) -> str:
    """The leaderboard for a terminal."""
    parts = [aligned([line[:-1] for line in _overall_lines(board)])]
    for track in tracks:
        if track in board.tracks:
            parts += ["", f"{track}: {TRACKS[track].doc}", aligned(_track_lines(board, track))]
    return "\n".join(parts)


def markdown(board: Board) -> str:
    """LEADERBOARD.md."""
    base = board.rows[REFERENCE]
    lines = [
        "# Leaderboard",
        "",
        "Written by `spidar leaderboard build` from the rows in `scores/`; nothing here is typed. A score is the mean",
        f"error of `{REFERENCE}`, the paper's controller, over the policy's own on the same scenarios: 1 is the",
        "paper's controller, above 1 is beyond the paper. A failed scenario costs an error of "
        f"{CAP:g}. In brackets: 95 %",
        "bootstrap intervals over scenarios (and training runs, where there are several).",
        "",
        "![scores with intervals by track](leaderboard.png)",
        "",
        "## All tracks",
        "",
        "Geometric mean of the tracks' scores; – where a policy is not defined on all of them.",
        "",
        *piped(_overall_lines(board)),
    ]
    lines += _added_lines(board)
    if any(_flag(row) for row in board.rows.values()):
        lines += ["", f"† fewer than {FEWEST_RUNS} training runs."]
    for track in board.tracks:
        scenarios = board.cells[REFERENCE, track].scenarios
        lines += [
            "",
            f"## {track}",
            "",
            f"{TRACKS[track].doc[0].upper()}{TRACKS[track].doc[1:]}.",
            f"Error: {TRACKS[track].formula}. {scenarios} scenarios.",
            "",
            *piped(_track_lines(board, track)),
        ]
    lines += [
        "",
        "## How to read it",
        "",
        "- error, IQM: interquartile mean of the scenarios' errors.",
        f"- against {REFERENCE}: interquartile mean of the paired differences over that of `{REFERENCE}`; below 0 is",
        "  better.",
        "- P(better): probability that the error on a scenario is below the reference's.",
        "- The other columns are medians, but for violations and unsolved QPs, which are means a scenario.",
        *(f"- {heading}: {METRICS[name][1]}." for name, heading in _headings()),
        "",
        "## Rows",
        "",
        *(
            f"- `{name}`: `{row.content['command']}`" + _trained(row) + f", {row.content['sha256'][:12]}"
            for name, row in board.rows.items()
        ),
        "",
        "Versions: " + ", ".join(f"{package} {number}" for package, number in base.content["versions"].items()) + ".",
        "",
    ]
    return "\n".join(lines)


def _added_lines(board: Board) -> list[str]:
    """What learning adds: every residual against the controller that it adds to."""
    lines = []
    for row in board.rows.values():
        if row.base not in board.rows:
            continue
        for table in comparison_tables(compare_rows(row, board.rows[row.base])):
            lines += ["", f"`{row.name}`{_flag(row)} against `{row.base}`:", "", *piped(table)]
    if not lines:
        return []
    head = (
        "IQM of the paired differences over that of the base, with 95 % intervals over scenarios and runs; below 0 is"
    )
    return ["", "## What learning adds", "", head, "better.", *lines]


def _trained(row: Row) -> str:
    """What the training cost, as its artifact says."""
    training = row.content["training"]
    if not training:
        return ""
    first = next(entry for entry in training if entry)
    steps = first.get("steps")
    verb = "tuned" if row.kind == "classical" else "trained"
    return f"; {verb} with `{first.get('command', '')}`" + (f", {steps:,} steps a run" if steps else "")


def _headings() -> list[tuple[str, str]]:
    return list(dict.fromkeys((name, heading) for shown in SHOWN.values() for name, heading, *_ in shown))


def as_json(board: Board) -> dict[str, Any]:
    """The leaderboard as one JSON object."""
    return {
        "overall": [
            {"policy": name, "group": group, **asdict(interval)} for (name, group), interval in board.overall.items()
        ],
        "tracks": [{"policy": name, "track": track, **_finite(asdict(c))} for (name, track), c in board.cells.items()],
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """NaN as None, which JSON has."""
    metrics = {name: None if math.isnan(value) else value for name, value in values["metrics"].items()}
    return {**values, "metrics": metrics}


def summary(row: Row, base: Row | None) -> dict[str, Any]:
    """A row's figures as JSON: against the reference where there is one."""
    own = base or row
    return {
        "name": row.name,
        "sha256": row.content["sha256"],
        "reference": None if base is None else base.content["sha256"],
        "tracks": {
            track: _finite(asdict(cell(row, own, track))) for track in _common(row, own)
        },
    }  # fmt: skip


def report(row: Row, base: Row | None) -> str:
    """What an evaluation gave, for a terminal: the row beside the reference."""
    if base is None or not _common(row, base):
        lines = [["track", "error, IQM", "success", "failed"]]
        for track in row.tracks:
            numbers = [row.column(track, name).mean() for name in ("success", "failed")]
            lines.append([track, f"{iqm(row.errors(track).reshape(-1)):.3f}", *(f"{number:.0%}" for number in numbers)])
        return f"{row.name}; there is no row {REFERENCE} to compare it with\n{aligned(lines)}"
    lines = [
        [
            "track",
            "score",
            "error, IQM",
            f"against {REFERENCE}",
            "P(better)",
            "success",
            "failed",
            f"{REFERENCE}: success",
        ]
    ]
    for track in _common(row, base):
        c = cell(row, base, track)
        against, theirs = _number(c.difference, percent=True), base.column(track, "success").mean()
        shares = [f"{share:.0%}" for share in (c.success, c.failed, theirs)]
        lines.append([track, _number(c.score), f"{c.error:.3f}", against, f"{c.improvement.value:.2f}", *shares])
    for group in GROUPS:
        interval = overall_interval(row, base, group)
        if interval is not None:
            lines.append([f"all {group}", _number(interval), *[""] * 6])
    few = f"\n† fewer than {FEWEST_RUNS} training runs" if _flag(row) else ""
    return f"{row.name}{_flag(row)}: {row.doc}\n{aligned(lines)}{few}"
