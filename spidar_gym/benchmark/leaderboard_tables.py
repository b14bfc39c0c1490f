"""Tables of the leaderboard, for terminals and for the page LEADERBOARD.md."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from spidar_gym.benchmark.comparison import compare_rows, comparison_tables
from spidar_gym.benchmark.leaderboard import (
    FRONT,
    GROUPS,
    RANKED,
    SHOWN,
    Board,
    cell,
    common_tracks,
    overall_interval,
    ranked,
    ranking,
)
from spidar_gym.benchmark.metrics import METRICS
from spidar_gym.benchmark.row import REFERENCE, Row
from spidar_gym.benchmark.statistics import Interval, iqm
from spidar_gym.benchmark.track import CALIBRATED, CAP, REFERENCES, TRACKS
from spidar_gym.policies.policy import LEARNED
from spidar_gym.sim.worlds import World
from spidar_gym.text import code, escaped, format_table

FEWEST_RUNS = 5
"""Number of training runs below which a learned row is flagged."""
NARROW = 7
"""Number of leading columns of a track's table that a terminal shows; the other columns are metrics."""


def format_interval(interval: Interval, *, percent: bool = False) -> str:
    """Format a value with its interval in brackets, optionally as a change in percent."""
    if percent:
        return f"{interval.value:+.0%} [{interval.low:+.0%}, {interval.high:+.0%}]"
    return f"{interval.value:.3g} [{interval.low:.3g}, {interval.high:.3g}]"


def flag(row: Row) -> str:
    """Return the mark of a learned row with fewer than `FEWEST_RUNS` training runs, else nothing."""
    return " †" if row.kind in LEARNED and len(row.policies) < FEWEST_RUNS else ""


def overall_lines(board: Board) -> list[list[str]]:
    """Return the policies with all tracks of flight or ground, best first: a heading and one line per policy."""
    lines = [["policy", "class", "runs", "flight", "ground", "success", "… on ground", "what it is"]]
    for name in ranked(board, GROUPS):
        row = board.rows[name]
        scores = [format_interval(board.overall[name, g]) if (name, g) in board.overall else "–" for g in GROUPS]
        success = []
        for tracks in GROUPS.values():
            own = [board.cells[name, t].success for t in tracks if (name, t) in board.cells]
            success.append(f"{np.mean(own):.0%}" if len(own) == len(tracks) else "–")
        lines.append([f"{name}{flag(row)}", row.kind, str(len(row.policies)), *scores, *success, escaped(row.doc)])
    return lines


def front_lines(board: Board, *, wide: bool = True) -> list[list[str]]:
    """Return the policies with all calibrated flights or crawls, best first: a heading and one line per policy.

    Args:
        board: Results.
        wide: Whether to show class, runs, description, the intervals of the second draw and the variants' errors.
    """
    variants = [name for name, _ in _world(board).variants]
    labels = [f"{world}, {name}: error, failed" for world in CALIBRATED for name in variants]
    heads = ["policy", "flight", "second draw", "ground", "second draw"]
    lines = [
        [heads[0], "class", "runs", *heads[1:], "failed", "… on ground", *labels, "what it is"]
        if wide
        else [*heads, f"failed: {', '.join(variants)}", "… on ground"]
    ]
    for name in ranked(board, FRONT):
        row = board.rows[name]
        scores = [cell for group in FRONT for cell in _both_draws(board, name, group, wide=wide)]
        failed, parts, lost = [], [], []
        for tracks in FRONT.values():
            own = [board.cells[name, track] for track in tracks if (name, track) in board.cells]
            own = own if len(own) == len(tracks) else []
            failed.append(f"{np.mean([c.failed for c in own]):.0%}" if own else "–")
            halves = [result_on(board, name, tracks, variant) for variant in variants]
            parts += [part_cell(half) for half in halves]
            lost.append(", ".join(f"{half[1]:.0%}" for half in halves if half) or "–")
        head = f"{name}{flag(row)}"
        more = [row.kind, str(len(row.policies)), *scores, *failed, *parts, escaped(row.doc)]
        lines.append([head, *more] if wide else [head, *scores, *lost])
    return lines


def result_on(board: Board, name: str, tracks: Sequence[str], variant: str) -> tuple[float, float] | None:
    """Return a row's error and share of failures on a variant, means over the tracks; None where one is missing."""
    own = [board.cells[name, track].parts for track in tracks if (name, track) in board.cells]
    found = [parts[variant] for parts in own if variant in parts]
    if len(found) < len(tracks):
        return None
    error, failed = (float(np.mean([getattr(part, key) for part in found])) for key in ("error", "failed"))
    return error, failed


def part_cell(result: tuple[float, float] | None) -> str:
    """Return the text of `result_on`."""
    return f"{result[0]:.3f}, {result[1]:.0%}" if result else "–"


def _world(board: Board) -> World:
    """Return the calibrated world of the board's tracks."""
    return next(world for track in board.tracks if (world := TRACKS[track].calibration) is not None)


def _both_draws(board: Board, name: str, group: str, *, wide: bool) -> list[str]:
    """Return a row's overall score, and that of the second draw with its place inside or outside the interval."""
    first = board.overall.get((name, group))
    later = None if board.second is None else board.second.overall.get((name, group))
    if first is None:
        return ["–", "–"]
    if later is None:
        return [format_interval(first), "–"]
    place = "within" if first.low <= later.value <= first.high else "outside"
    return [format_interval(first), f"{format_interval(later) if wide else f'{later.value:.3g}'}, {place}"]


def first_lines(board: Board, *, wide: bool = True) -> list[list[str]]:
    """Return the front of the leaderboard: the calibrated tracks, or the nominal part before any row has them."""
    return front_lines(board, wide=wide) if board.has_front else overall_lines(board)


def order_lines(board: Board) -> list[list[str]]:
    """Return the place of each row in the nominal part and on the calibrated tracks, in the order of the latter."""
    lines = [["policy", *(f"{world}, {part}" for world in CALIBRATED for part in ("nominal", "calibrated"))]]
    orders = {group: ranked(board, [group]) for group in RANKED}
    for name in dict.fromkeys((*ranked(board, FRONT), *ranked(board, GROUPS))):
        found = [orders[group] for world, front in CALIBRATED.items() for group in (world, front)]
        places = [f"{order.index(name) + 1} of {len(order)}" if name in order else "–" for order in found]
        lines.append([f"{name}{flag(board.rows[name])}", *places])
    return lines


def partial_lines(board: Board, tracks: Sequence[str], groups: Iterable[str] = GROUPS) -> list[list[str]]:
    """Return the rows without an overall score of the groups, with their place on each track.

    Args:
        board: Results.
        tracks: Tracks to show, of which the calibrated ones belong to `FRONT` and the others to `GROUPS`.
        groups: `FRONT` or `GROUPS`.
    """
    lines = [["policy", "class", "runs", "track", "place", "score", "what it is"]]
    others, calibrated = set(board.rows) - set(ranked(board, groups)), set(groups) == set(FRONT)
    for track in [track for track in board.tracks if track in tracks and TRACKS[track].is_calibrated == calibrated]:
        order = ranking(board, track)
        for place, name in enumerate(order, 1):
            if name in others:
                row, score = board.rows[name], format_interval(board.cells[name, track].score)
                head = [f"{name}{flag(row)}", row.kind, str(len(row.policies))]
                lines.append([*head, track, f"{place} of {len(order)}", score, escaped(row.doc)])
    return lines


def track_lines(board: Board, track: str) -> list[list[str]]:
    """Return the policies of a track in the order of `ranking`: a heading and one line per policy."""
    shown, reference = SHOWN[TRACKS[track].group], TRACKS[track].reference
    heads = ["policy", "score", "error, IQM", f"against {reference}", "P(better)", "success", "failed"]
    world = TRACKS[track].calibration
    kinds = () if world is None else tuple(name for name, _ in (*world.variants, *world.mixtures))
    lines = [[*heads, *(f"{name}: error, failed" for name in kinds), *(head for _, head, *_ in shown)]]
    for name in ranking(board, track):
        c = board.cells[name, track]
        against = [
            format_interval(c.difference, percent=True),
            f"{c.improvement.value:.2f} [{c.improvement.low:.2f}, {c.improvement.high:.2f}]",
        ]
        parts = [f"{own.error:.3f}, {own.failed:.0%}" if (own := c.parts.get(kind)) else "–" for kind in kinds]
        numbers = [
            "–" if math.isnan(c.metrics[key]) else f"{factor * c.metrics[key]:.{digits}f}"
            for key, _, factor, digits in shown
        ]
        lines.append(
            [f"{name}{flag(board.rows[name])}", format_interval(c.score), f"{c.error:.3f}",
             *(["", ""] if name == reference else against), f"{c.success:.0%}", f"{c.failed:.0%}", *parts, *numbers]
        )  # fmt: skip
    return lines


def text(board: Board, tracks: Sequence[str] = (), *, wide: bool = False) -> str:
    """Format the leaderboard for a terminal, in 120 columns or with all metrics; selected tracks come first."""
    shown = tracks or board.tracks
    tables = [front_lines(board, wide=wide)] if board.has_front else []
    described = [partial_lines(board, shown, FRONT), overall_lines(board), partial_lines(board, shown)]
    tables += [[line[:-1] for line in lines] for lines in described]
    overall = [format_table(lines) for lines in tables if len(lines) > 1]
    parts = list[str]()
    for track in shown:
        if track in board.tracks:
            lines = [line if wide else line[:NARROW] for line in track_lines(board, track)]
            parts.append(f"{track}: {TRACKS[track].doc}\n{format_table(lines)}")
    return "\n\n".join([*parts, *overall] if tracks else [*overall, *parts])


def report(row: Row, references: Mapping[str, Row]) -> str:
    """Format an evaluation for a terminal: the row with the reference of each track."""
    bases = {name: references[name] for name in dict.fromkeys(REFERENCES.values()) if name in references}
    common = {
        track: bases[name]
        for track in row.tracks
        if (name := TRACKS[track].reference) in bases and track in common_tracks(row, bases[name])
    }
    if not common:
        lines = [["track", "error, IQM", "success", "failed"]]
        for track in row.tracks:
            numbers = [row.column(track, name).mean() for name in ("success", "failed")]
            lines.append([track, f"{iqm(row.errors(track).reshape(-1)):.3f}", *(f"{number:.0%}" for number in numbers)])
        names = " or ".join(dict.fromkeys(TRACKS[track].reference for track in row.tracks))
        return f"{row.name}; there is no row {names} to compare it with\n{format_table(lines)}"
    lines = [["track", "score", "error, IQM", "against", "", "P(better)", "success", "failed", "success there"]]
    for track, base in common.items():
        c = cell(row, base, track)
        against, theirs = format_interval(c.difference, percent=True), base.column(track, "success").mean()
        shares = [f"{share:.0%}" for share in (c.success, c.failed, theirs)]
        numbers = [format_interval(c.score), f"{c.error:.3f}", base.name, against, f"{c.improvement.value:.2f}"]
        lines.append([track, *numbers, *shares])
    for group in RANKED:
        interval = overall_interval(row, bases[REFERENCE], group) if REFERENCE in bases else None
        if interval is not None:
            lines.append([f"all {group}", format_interval(interval), *[""] * 7])
    few = f"\n† fewer than {FEWEST_RUNS} training runs" if flag(row) else ""
    return f"{row.name}{flag(row)}: {row.doc}\n{format_table(lines)}{few}"


def markdown(board: Board) -> str:
    """Return the text of LEADERBOARD.md."""
    apart = [track for track in board.tracks if TRACKS[track].group not in RANKED]
    lines = [
        "# Leaderboard",
        "",
        "Written by `spidar leaderboard build` from the rows in `scores/`. A score is the mean error of the paper's",
        f"controller, `{REFERENCE}`, divided by the mean error of the policy on the same scenarios. A score above 1 is",
        f"better than the paper's controller. A failed scenario has the error {CAP:g}. Brackets contain 95 % bootstrap",
        "intervals over scenarios and, if there are several, training runs. The paper has no courses; their scores",
        f"refer to `{REFERENCES['course']}`.",
        "",
        "![Scores with their intervals on the tracks that separate the best policies most clearly](leaderboard.png)",
        "",
        *_front_part(board),
        "## Nominal part" if board.has_front else "## All tracks",
        "",
        "Geometric mean of the tracks' scores; – where a policy is not defined on all of them.",
        *([f"These tracks have separate scores: {', '.join(map(code, apart))}."] if apart else []),
        *(["Their tables are ordered by success, then by error; the other tables by score."] if apart else []),
        "",
        format_table(overall_lines(board), markdown=True),
    ]
    lines += _partial_part(board, GROUPS)
    lines += _added_lines(board)
    if any(flag(row) for row in board.rows.values()):
        lines += ["", f"† fewer than {FEWEST_RUNS} training runs."]
    for track in board.tracks:
        scenarios = board.cells[TRACKS[track].reference, track].scenarios
        lines += [
            "",
            f"## {track}",
            "",
            f"{TRACKS[track].doc[0].upper()}{TRACKS[track].doc[1:]}.",
            f"Error: {TRACKS[track].formula}. {scenarios} scenarios.",
            "",
            format_table(track_lines(board, track), markdown=True),
        ]
    headings = dict.fromkeys((name, heading) for shown in SHOWN.values() for name, heading, *_ in shown)
    versions = board.rows[REFERENCE].content["versions"]
    lines += [
        "",
        "## How to read it",
        "",
        "- error, IQM: interquartile mean of the scenarios' errors.",
        "- against REFERENCE: interquartile mean of the paired differences over the interquartile mean of the",
        "  reference's errors; below 0 is better.",
        "- P(better): probability that the error in a scenario is below the reference's error.",
        "- The other columns are medians, except violations and unsolved QPs, which are means over the scenarios.",
        *(f"- {heading}: {METRICS[name].doc}." for name, heading in headings),
        "",
        "## Rows",
        "",
        *(
            f"- {code(name)}: {code(part.content['command'])}" + _trained(part) + f", {part.content['sha256'][:12]}"
            for name, row in board.rows.items()
            for part in row.files
        ),
        "",
        "Versions: " + escaped(", ".join(" ".join(entry) for entry in versions.items())) + ".",
        "",
    ]
    return "\n".join(lines)


def _front_part(board: Board) -> list[str]:
    """Return the part of the page with the calibrated tracks; nothing before any row has them."""
    if not board.has_front:
        return []
    world, tracks = _world(board), [track for track in board.tracks if TRACKS[track].is_calibrated]
    return [
        "## Calibrated world",
        "",
        f"Robots of the world `{world.name}` ({world.digest[:12]}) on {', '.join(map(code, tracks))}. {world.doc}",
        "Overall scores are geometric means; – where a policy is not defined on all tracks. The second draw has fifty",
        "other scenarios of each track. *Within*: its score lies inside the first draw's interval, as the scores of",
        "about five of six repetitions do. The columns of the hardware's variants have the mean of the tracks' errors",
        "(IQM) and the share of failed scenarios:",
        f"{', '.join(f'{code(name)}, {doc}' for name, doc in world.variants)}.",
        "",
        format_table(front_lines(board), markdown=True),
        *_partial_part(board, FRONT),
        "",
        "### Old order beside the new",
        "",
        "Place of each row by its overall score in the nominal part and on the calibrated tracks.",
        "",
        format_table(order_lines(board), markdown=True),
        "",
    ]


def _partial_part(board: Board, groups: Iterable[str]) -> list[str]:
    """Return the part of the page with the rows that lack an overall score of the groups; nothing if there are none."""
    partial = partial_lines(board, board.tracks, groups)
    if len(partial) == 1:
        return []
    head = ["", "Policies that are defined on some tracks only, with their place on each track:", ""]
    return [*head, format_table(partial, markdown=True)]


def _added_lines(board: Board) -> list[str]:
    """Compare every residual with the controller to which it adds."""
    lines = []
    for row in board.rows.values():
        if row.base not in board.rows:
            continue
        for cells in comparison_tables(compare_rows(row, board.rows[row.base])):
            lines += ["", f"{code(row.name)}{flag(row)} against `{row.base}`:", "", format_table(cells, markdown=True)]
    if not lines:
        return []
    head = [
        "Interquartile mean (IQM) of the paired differences over the IQM of the base, with 95 % intervals over",
        "scenarios and runs; below 0 is better.",
    ]
    return ["", "## What learning adds", "", *head, *lines]


def _trained(row: Row) -> str:
    """Return command and steps of the training from the row, as text."""
    first = next((entry for entry in row.content["training"] or () if entry), None)
    if first is None:
        return ""
    steps = first.get("steps")
    verb = "trained" if row.kind in LEARNED else "tuned"
    return f"; {verb} with {code(first.get('command', ''))}" + (f", {steps:,} steps a run" if steps else "")
