"""Figures of the paper's flight and crawl, of the studies, of learning curves, and of the leaderboard."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.leaderboard import Board, ranking
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.margins import LEAST_GAIN
from spidar_gym.paper.crawl import LEGS_UP, TORSO_PHASES, CrawlLog
from spidar_gym.paper.flight import FORM_CHANGE, PAPER_FLIGHT, UNRESTRICTED, FlightLog
from spidar_gym.policies.policy import KINDS
from spidar_gym.tasks.crawl import SUCCESS_SLIP
from spidar_gym.viz.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    PURPLE,
    SKY,
    VERMILLION,
    Axes,
    Figure,
    Line,
    Span,
    label_lines,
    pyplot,
    save,
    spans,
)

Labelled = tuple[Axes, Sequence[Line], Sequence[str]]
"""A panel, its lines, and the names of the lines."""
LOOKS = ((BLUE, "o"), (VERMILLION, "D"), (GREEN, "s"), (PURPLE, "v"), (BLACK, "^"), (SKY, "P"))
"""Colours and markers for different series."""
CLASSES: dict[str, tuple[str, str]] = dict(zip(KINDS, LOOKS, strict=False))
"""Colour and marker of a class of policies."""
STROKES = ("-", "--", ":", "-.")
METRICS = {
    "position_rms_m": ("position RMS [mm]", 1e3), "attitude_rms_rad": ("attitude RMS [mrad]", 1e3),
    "duration_s": ("time [s]", 1.0), "energy_wh": ("energy [Wh]", 1.0), "error": ("error", 1.0),
}  # fmt: skip
"""Label and factor of the metrics of learning curves."""
COLUMNS = 2
"""Number of panels of the leaderboard side by side."""
BEST, PER_GROUP = 10, 2
"""Number of policies per panel, and of panels per group of tracks, in the leaderboard's picture."""
WIDE = (0.01, 0.1, 1.0, 10.0)
FINE = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
"""Ticks of the score axis, over decades or within one decade."""


@dataclass(frozen=True)
class Curve:
    """Learning curve of a run."""

    ticks: Sequence[float]
    """Number of control ticks of training before each validation."""
    minutes: Sequence[float]
    """Wall time before each validation [min]."""
    values: Sequence[float]
    """Metric on the validation scenarios, in the metric's unit."""


def flight_figure(log: FlightLog, path: Path) -> None:
    """Draw the six panels of the paper's flight figure: errors, joints, torques, vectoring angles and thrusts of leg 1.

    Errors are actual − desired, so that a sinking robot appears as a downward curve.
    """
    position, attitude = -log.position_error, -1e3 * log.attitude_error
    panels = [
        ("CoG position, actual − desired [m]", position, ["x", "y", "z"]),
        ("attitude, actual − desired [mrad]", attitude, ["roll", "pitch", "yaw"]),
        ("joint angles, leg 1 [rad]", log.joint_position[:, :4], ["q₁", "q₂", "q₃", "q₄"]),
        ("allocated joint torques, leg 1 [Nm]", log.joint_torque[:, :4], ["τ₁", "τ₂", "τ₃", "τ₄"]),
        ("vectoring angles, leg 1 [rad]", log.vectoring[:, :2].reshape(-1, 4), ["φ₁", "θ₁", "φ₂", "θ₂"]),
        ("thrust, leg 1 [N]", log.thrust[:, :2], ["λ₁", "λ₂"]),
    ]
    figure, axes, labelled = _panels(log.time, panels)
    flown = f"Flight with joint motion, preset {log.preset}{', with noise' if log.noise else ''}"
    figure.suptitle(f"{flown}; shaded: without interference constraints")
    for axis in axes.flat:
        _shade(axis, UNRESTRICTED, VERMILLION)
        for edge in FORM_CHANGE:
            axis.axvline(edge, color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))
    start, end = FORM_CHANGE
    names = [(0.0, start, "form ①"), (start, end, "① → ② → ③"), (end, UNRESTRICTED[0][0], "form ③")]
    names += [(*window, "dropped") for window in UNRESTRICTED]
    for axis in axes[0]:
        _name_spans(axis, names)
    _mark_rmse(axes[0, 0], max(PAPER_FLIGHT["rmse_position_m"]), "{:g} m")
    _mark_rmse(axes[0, 1], 1e3 * max(PAPER_FLIGHT["rmse_attitude_rad"]), "{:g} mrad")
    _finish(figure, labelled, path)


def crawl_figure(log: CrawlLog, path: Path) -> None:
    """Draw the six panels of the paper's crawl figure: torso pose, joints, torques, vectoring and thrusts of leg 1."""
    thrust = np.column_stack((log.thrust[:, :2], log.thrust.mean(axis=1)))
    panels = [
        ("torso position [m]", log.position_w, ["x", "y", "z"]),
        ("torso attitude [mrad]", 1e3 * log.euler, ["roll", "pitch", "yaw"]),
        ("joint angles, leg 1 [rad]", log.joint_position[:, :4], ["q₁", "q₂", "q₃", "q₄"]),
        ("servo torques, leg 1 [Nm]", log.joint_torque[:, :4], ["τ₁", "τ₂", "τ₃", "τ₄"]),
        ("vectoring angles, leg 1 [rad]", log.vectoring[:, :2].reshape(-1, 4), ["φ₁", "θ₁", "φ₂", "θ₂"]),
        ("thrust, leg 1 and mean of all [N]", thrust, ["λ₁", "λ₂", "Σλ/8"]),
    ]
    figure, axes, labelled = _panels(log.time, panels)
    figure.suptitle(f"Crawl, preset {log.preset}, {log.joint_speed:g} rad/s{', with noise' if log.noise else ''}")
    legs, torso = spans(log.time, np.isin(log.phase, LEGS_UP)), spans(log.time, np.isin(log.phase, TORSO_PHASES))
    for axis in axes.flat:
        _shade(axis, legs, BLUE)
        _shade(axis, torso, VERMILLION)
    for axis in axes[0]:
        _name_spans(axis, [(*span, "legs") for span in legs] + [(*span, "torso") for span in torso])
    _finish(figure, labelled, path)


def speed_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw interquartile means of the errors over joint speed, of `paper` and `tuned`, nominal and randomised."""
    plt = pyplot()
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    controllers = list(dict.fromkeys(row["controller"] for row in rows))
    figure, axes = plt.subplots(2, len(conditions), figsize=(7.2, 4.6), sharex=True, sharey="row", squeeze=False)
    labelled: list[Labelled] = []
    for row_axes, key, label in zip(
        axes, ("position_mm", "attitude_mrad"), ("position error [mm]", "attitude error [mrad]"), strict=True
    ):
        for axis, condition in zip(row_axes, conditions, strict=True):
            lines = []
            for name in controllers:
                own = [row for row in rows if row["controller"] == name and row["condition"] == condition]
                lines += axis.plot([row["joint_speed"] for row in own], [row[key] for row in own], marker="o")
            axis.margins(x=0.04)
            labelled.append((axis, lines, controllers))
        row_axes[0].set_ylabel(label)
        row_axes[0].set_ylim(0.0, 1.08 * max(row[key] for row in rows))
    for axis, condition in zip(axes[0], conditions, strict=True):
        axis.set_title(condition)
    for axis in axes[-1]:
        axis.set_xlabel("joint speed [rad/s]")
    figure.suptitle("Random asymmetric forms: RMS norm of a flight without its first second, interquartile mean")
    _finish(figure, labelled, path)


def ablation_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw the error without a part over that of the complete controller: mean over tracks and interval, each track.

    Args:
        rows: Rows of `spidar_gym.studies.ablations`.
        path: File, PNG, PDF or SVG.
    """
    plt = pyplot()
    groups = list(dict.fromkeys(row["group"] for row in rows))
    figure, axes = plt.subplots(1, len(groups), figsize=(7.6, 3.6), squeeze=False)
    for axis, group in zip(axes[0], groups, strict=True):
        names = list(dict.fromkeys(row["name"] for row in rows if row["group"] == group))[1:]
        for k, name in enumerate(reversed(names)):
            mean, *tracks = (row for row in rows if (row["group"], row["name"]) == (group, name))
            axis.plot([t["factor"] for t in tracks], [k] * len(tracks), "o", color=GREY, markersize=2.5, alpha=0.7)
            axis.plot([mean["low"], mean["high"]], [k, k], "-", color=BLUE, linewidth=3.0, solid_capstyle="butt")
            axis.plot(mean["factor"], k, "D", color=BLUE, markersize=4.0)
        axis.axvline(1.0, color=BLACK, linewidth=0.8, linestyle="-")
        axis.set_yticks(range(len(names)), reversed(names))
        axis.set_ylim(-0.7, len(names) - 0.3)
        axis.set_xscale("log")
        axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if value in (0.5, 2.0, 5.0, 20.0) else "")
        axis.margins(x=0.05)
        axis.set_title(group)
        axis.set_xlabel("error ratio (grey: each track)")
    save(figure, path)


def step_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw success rate and slip over the height of the steps: a column per terrain, a line per gait and foot lift.

    Args:
        rows: Rows of `spidar_gym.studies.steps`.
        path: File, PNG, PDF or SVG.
    """
    plt = pyplot()
    terrains, lines = (list(dict.fromkeys(of(row) for row in rows)) for of in (_terrain, _gait_and_feet))
    gaits = list(dict.fromkeys(gait for gait, _ in lines))
    figure, axes = plt.subplots(2, len(terrains), figsize=(7.2, 4.2), squeeze=False, sharex=True, sharey="row")
    looks = [(*LOOKS[gaits.index(gait) % len(LOOKS)], *(("-", "full") if feet == "higher" else ("--", "none")))
             for gait, feet in lines]  # fmt: skip
    for column, terrain in zip(axes.T, terrains, strict=True):
        for k, (gait, feet) in enumerate(lines):
            own = [row for row in rows if (_terrain(row), *_gait_and_feet(row)) == (terrain, gait, feet)]
            color, mark, stroke, filled = looks[k]
            heights = [1e3 * row["height"] for row in own]
            shares = [row["successes"] / row["runs"] + 0.012 * (k - 0.5 * (len(lines) - 1)) for row in own]
            for axis, values in zip(column, (shares, [1e3 * row["slip_m"] for row in own]), strict=True):
                axis.plot(heights, values, stroke, color=color, marker=mark, fillstyle=filled, markersize=4.5)
        column[0].set_title(terrain)
        column[0].set_ylim(-0.08, 1.08)
        column[1].axhline(1e3 * SUCCESS_SLIP, color=GREY, linewidth=0.9, linestyle="-")
        column[1].set_xlabel("height of the steps [mm]")
        column[0].margins(x=0.04)
    axes[0, 0].set_ylabel("share of successes")
    axes[1, 0].set_ylabel("slip of a foot [mm]")
    names = [f"{gait}, feet {feet}" if feet == "higher" else f"{gait}" for gait, feet in lines]
    handles = [
        plt.Line2D([], [], color=color, marker=mark, linestyle=stroke, fillstyle=filled, label=name)
        for name, (color, mark, stroke, filled) in zip(names, looks, strict=True)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, columnspacing=1.2, handletextpad=0.5)
    save(figure, path)


def energy_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw the energy of a way over its length: crawls, and flights with take-off and landing.

    Args:
        rows: Rows of `spidar_gym.studies.energy`, of which at least one is a hop.
        path: File, PNG, PDF or SVG.
    """
    plt = pyplot()
    figure, axis = plt.subplots(figsize=(7.2, 4.2))
    hop = next(row["energy_wh"]["median"] for row in rows if row["gait"] == "hop")
    length = np.array([0.0, 10.0])
    names = list(dict.fromkeys(row["preset"] for row in rows if row["wh_per_m"]))
    for row in rows:
        if row["wh_per_m"] is None:
            continue
        color, _ = LOOKS[names.index(row["preset"]) % len(LOOKS)]
        flies = row["gait"] == "fly"
        own = [other["speed"] for other in rows if (other["preset"], other["gait"]) == (row["preset"], row["gait"])]
        stroke = STROKES[own.index(row["speed"]) % len(STROKES)]
        label = f"{row['preset']}, {row['speed']:g} {'m/s' if flies else 'rad/s'}"
        start = hop if flies else 0.0
        axis.plot(length, start + row["wh_per_m"]["median"] * length, stroke, color=color, lw=1.2, label=label)
    axis.set_xlabel("length of the way [m]")
    axis.set_ylabel("energy [Wh]")
    axis.set_xlim(0.0, 10.0)
    axis.set_ylim(0.0, 45.0)
    figure.legend(loc="outside right upper", handletextpad=0.5)
    save(figure, path)


def frontier_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw errors of flight controllers over their worst gain margins.

    No robot of a filled point has fallen; large points are controllers as they are, small ones slower and faster.

    Args:
        rows: Rows of `spidar_gym.studies.frontier`.
        path: File, PNG, PDF or SVG.
    """
    plt = pyplot()
    figure, axis = plt.subplots(figsize=(7.2, 4.6))
    names = list(dict.fromkeys(row["controller"] for row in rows))
    lines, labels = [], []
    for k, name in enumerate(names):
        own = sorted((row for row in rows if row["controller"] == name), key=lambda row: row["scale"])
        color, marker = LOOKS[k % len(LOOKS)]
        gains, errors = ([row[key] for row in own] for key in ("gain", "error"))
        stroke = STROKES[k // len(LOOKS)]
        axis.plot(gains, errors, stroke, color=color, lw=1.0)
        lines += axis.plot([], [], stroke, color=color, lw=1.0, marker=marker, ms=5)
        for row in own:
            face = "white" if row["failed"] else color
            axis.plot(
                row["gain"], row["error"], marker, color=color, markerfacecolor=face, ms=7 if row["scale"] == 1.0 else 4
            )
        labels.append(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.rpartition(":")[2]).lower())
    axis.set_xlabel("worst gain margin over calibrated robots and forms")
    axis.set_ylabel("error on calibrated tracks")
    axis.set_yscale("log")
    axis.set_yticks([0.2, 0.3, 0.5, 1.0, 2.0, 5.0], ["0.2", "0.3", "0.5", "1", "2", "5"])
    axis.minorticks_off()
    axis.margins(x=0.05)
    axis.axvline(LEAST_GAIN, color=GREY, lw=0.8)
    axis.annotate("export", (LEAST_GAIN, 1.0), (3, -3), xycoords=("data", "axes fraction"), textcoords="offset points",
                  va="top", color=GREY, fontsize=8)  # fmt: skip
    figure.legend(lines, labels, loc="outside right upper", handletextpad=0.5)
    save(figure, path)


def _terrain(row: Mapping[str, Any]) -> str:
    """Return the terrain of a row of `spidar_gym.studies.steps`."""
    return row["terrain"]


def _gait_and_feet(row: Mapping[str, Any]) -> tuple[str, str]:
    """Return gait and foot lift of a row of `spidar_gym.studies.steps`."""
    return row["gait"], row["feet"]


def learning_curves(
    panels: Mapping[str, Mapping[str, Sequence[Curve]]],
    lines: Mapping[str, Mapping[str, float]],
    title: str,
    path: Path,
) -> None:
    """Draw learning curves of all runs over ticks and, below, over minutes; classical controllers are horizontal lines.

    Args:
        panels: Metric → row → runs of the row; one column per metric.
        lines: Row of a classical controller → metric → value.
        title: Title.
        path: File, PNG, PDF or SVG.
    """
    plt = pyplot()
    figure, axes = plt.subplots(2, len(panels), figsize=(3.9 * len(panels), 5.4), squeeze=False, sharey="col")
    rows = list(dict.fromkeys(row for runs in panels.values() for row in runs))
    labelled: list[Labelled] = []
    across = (("ticks", 1e-6, "control ticks [million]"), ("minutes", 1.0, "wall time [min]"))
    for row_axes, (over, scale, name) in zip(axes, across, strict=True):
        for axis, (metric, runs) in zip(row_axes, panels.items(), strict=True):
            last = _draw_runs(axis, metric, runs, rows, over, scale)
            for k, values in enumerate(lines.values()):
                height = METRICS[metric][1] * values[metric]
                last.append(axis.axhline(height, color=GREY, linewidth=1.0, linestyle=STROKES[k % 4]))
            axis.margins(x=0.03)
            axis.set_yscale("log")
            _number(axis)
            axis.set_xlabel(name)
            axis.set_ylabel(METRICS[metric][0])
            labelled.append((axis, last, [*runs, *lines]))
    figure.suptitle(title)
    _finish(figure, labelled, path)


def _draw_runs(
    axis: Axes, metric: str, runs: Mapping[str, Sequence[Curve]], rows: list[str], over: str, scale: float
) -> list[Line]:
    """Draw every run of each row; return the line of each row that is labelled with its name."""
    last = []
    for row, curves in runs.items():
        color, mark = LOOKS[rows.index(row) % len(LOOKS)]
        drawn = [
            axis.plot(
                scale * np.array(getattr(curve, over)), METRICS[metric][1] * np.array(curve.values), color=color,
                linestyle="-", linewidth=0.9, alpha=0.8, marker=mark, markersize=2.2,
            )[0]
            for curve in curves
        ]  # fmt: skip
        # The label is at the run with the median last value.
        last.append(sorted(drawn, key=lambda line: line.get_ydata()[-1])[len(drawn) // 2])
    return last


def leaderboard_picture(board: Board, path: Path) -> None:
    """Draw scores with 95 % intervals on the tracks of each group that separate the best policies most clearly."""
    plt = pyplot()
    tracks = _separating(board)
    shown = {track: _best(board, track) for track in tracks}
    lines = [tracks[k : k + COLUMNS] for k in range(0, len(tracks), COLUMNS)]
    heights = [max(len(shown[track]) for track in line) for line in lines]
    figure = plt.figure(figsize=(9.0, 1.0 + 0.75 * len(lines) + 0.2 * sum(heights)))
    grid = figure.add_gridspec(len(lines), COLUMNS, height_ratios=[height + 2.0 for height in heights])
    for k, line in enumerate(lines):
        for column, track in enumerate(line):
            axis = figure.add_subplot(grid[k, column])
            axis.set_title(track, fontsize=11)
            axis.axvline(1.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
            low, high = _limits(board, track, shown[track])
            for y, name in enumerate(shown[track]):
                score, (color, mark) = board.cells[name, track].score, CLASSES[board.rows[name].kind]
                axis.plot([score.low, score.high], [y, y], color=color, linewidth=2.0, linestyle="-", alpha=0.45)
                axis.plot([score.value], [y], mark, color=color, markersize=5)
                left = score.value > math.sqrt(low * high)
                is_reference = name == TRACKS[track].reference
                axis.annotate(
                    name, ((score.low if left else score.high), y), xytext=(-7 if left else 7, 0), fontsize=9.5,
                    textcoords="offset points", ha="right" if left else "left", va="center",
                    color=BLACK if is_reference else color, fontweight="bold" if is_reference else "normal",
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
                )  # fmt: skip
            axis.set_ylim(heights[k] - 0.3, -0.7)
            axis.set_yticks([])
            axis.set_xscale("log")
            axis.set_xlim(low, high)
            ticks = [tick for tick in (WIDE if high > 100.0 * low else FINE) if low <= tick <= high]
            axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks], fontsize=9)
            axis.minorticks_off()
    figure.supxlabel(
        "score: mean error of the bold row over that of the policy, 95 % interval, log scale; higher is better",
        fontsize=9.5,
    )
    kinds = [kind for kind in CLASSES if any(row.kind == kind for row in board.rows.values())]
    handles = [
        plt.Line2D([], [], color=CLASSES[kind][0], marker=CLASSES[kind][1], ls="-", label=kind) for kind in kinds
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=10)
    save(figure, path)


def _separating(board: Board) -> list[str]:
    """Return up to `PER_GROUP` tracks of each group, those that separate most pairs of their best policies."""

    def separated(track: str) -> float:
        scores = [board.cells[name, track].score for name in ranking(board, track)[:BEST]]
        pairs = list(combinations(scores, 2))
        return sum(one.low > other.high or other.low > one.high for one, other in pairs) / max(1, len(pairs))

    groups = {TRACKS[track].group: None for track in board.tracks}
    kept = {
        track
        for group in groups
        for track in sorted((t for t in board.tracks if TRACKS[t].group == group), key=separated)[-PER_GROUP:]
    }
    return [track for track in board.tracks if track in kept]


def _best(board: Board, track: str) -> list[str]:
    """Return the best policies of a track, best first, and its reference."""
    ranked, reference = ranking(board, track), TRACKS[track].reference
    return ranked[:BEST] if reference in ranked[:BEST] else [*ranked[:BEST], reference]


def _panels(
    time: np.ndarray, panels: Sequence[tuple[str, np.ndarray, list[str]]]
) -> tuple[Figure, Axes, list[Labelled]]:
    """Draw three rows of two panels over one time axis; return figure, axes, and the panels with lines and names."""
    figure, axes = pyplot().subplots(3, 2, figsize=(7.2, 6.2), sharex=True)
    labelled = []
    for letter, axis, (title, values, names) in zip("ABCDEF", axes.flat, panels, strict=True):
        labelled.append((axis, [axis.plot(time, column)[0] for column in values.T], names))
        axis.set_title(f"{letter}   {title}", pad=12 if letter in "AB" else 5)
        axis.margins(y=0.08)
        axis.set_xlim(0.0, time[-1])
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    return figure, axes, labelled


def _finish(figure: Figure, labelled: Iterable[Labelled], path: Path) -> None:
    """Label the lines, and write the file."""
    figure.draw_without_rendering()
    for axis, lines, names in labelled:
        label_lines(axis, lines, names)
    save(figure, path)


def _shade(axis: Axes, spans: Iterable[Span], color: str) -> None:
    for start, end in spans:
        axis.axvspan(start, end, color=color, alpha=0.10, linewidth=0, zorder=0)


def _name_spans(axis: Axes, names: Iterable[tuple[float, float, str]]) -> None:
    """Write the names of time spans above the axes."""
    for start, end, name in names:
        axis.annotate(
            name, xy=((start + end) / 2, 1.0), xycoords=axis.get_xaxis_transform(), xytext=(0, 2),
            textcoords="offset points", ha="center", va="bottom", fontsize=6, color="0.35", annotation_clip=False,
        )  # fmt: skip


def _mark_rmse(axis: Axes, rmse: float, form: str) -> None:
    """Draw the real robot's RMSE as a grey band, with its label in a strip below the curves."""
    low, high = axis.get_ylim()
    inside = rmse <= max(-low, high)
    if inside:
        axis.axhspan(-rmse, rmse, color="0.92", linewidth=0, zorder=-1)
    axis.set_ylim(low - 0.1 * (high - low), high)
    words = (
        f"grey: paper's RMSE, ± {form.format(rmse)}" if inside else f"paper's RMSE, ± {form.format(rmse)}, is off scale"
    )
    axis.text(
        0.02, 0.02, words, transform=axis.transAxes, fontsize=6, color="0.35",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
    )  # fmt: skip


def _number(axis: Axes) -> None:
    """Label a logarithmic axis with numbers instead of powers of ten, with fewer labels beyond a decade."""
    low, high = axis.get_ylim()
    digits = "125" if high > 12.0 * low else "123456789"
    for setter in (axis.yaxis.set_major_formatter, axis.yaxis.set_minor_formatter):
        setter(lambda value, _, digits=digits: f"{value:g}" if f"{value:e}"[0] in digits else "")
    axis.grid(which="both")


def _limits(board: Board, track: str, names: Sequence[str]) -> tuple[float, float]:
    """Return limits of the score axis that contain the intervals of some rows of a track, with space for a name."""
    scores = [board.cells[name, track].score for name in names]
    low, high = min(score.low for score in scores), max(score.high for score in scores)
    room = max(1.6, (high / low) ** 0.25)
    return low / room, high * 1.15
