"""Figures of the paper's experiments and of the comparison over joint speeds."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.paper.crawl import LEGS_UP, TORSO_PHASES, CrawlLog
from spidar_gym.paper.flight import FORM_CHANGE, PAPER_FLIGHT, UNRESTRICTED, FlightLog
from spidar_gym.viz.style import BLUE, GREY, VERMILLION, Axes, Figure, Line, label_lines, pyplot, save

Span = tuple[float, float]


def flight_figure(log: FlightLog, path: Path) -> None:
    """The six panels of the paper's flight figure: errors, joints, torques, vectoring angles and thrusts of leg 1.

    Errors are actual − desired: a robot that sinks is drawn downwards.
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
    figure, axes, lines = _panels(log.time, panels)
    flown = f"Flight with joint motion, preset {log.preset}{', with noise' if log.noise else ''}"
    figure.suptitle(f"{flown}; shaded: interference rows dropped")
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
    _finish(figure, axes, panels, lines, path)


def crawl_figure(log: CrawlLog, path: Path) -> None:
    """The six panels of the paper's crawl figure: torso pose, joints, torques, vectoring and thrusts of leg 1."""
    thrust = np.column_stack((log.thrust[:, :2], log.thrust.mean(axis=1)))
    panels = [
        ("torso position [m]", log.position_w, ["x", "y", "z"]),
        ("torso attitude [mrad]", 1e3 * log.euler, ["roll", "pitch", "yaw"]),
        ("joint angles, leg 1 [rad]", log.joint_position[:, :4], ["q₁", "q₂", "q₃", "q₄"]),
        ("servo torques, leg 1 [Nm]", log.joint_torque[:, :4], ["τ₁", "τ₂", "τ₃", "τ₄"]),
        ("vectoring angles, leg 1 [rad]", log.vectoring[:, :2].reshape(-1, 4), ["φ₁", "θ₁", "φ₂", "θ₂"]),
        ("thrust, leg 1 and mean of all [N]", thrust, ["λ₁", "λ₂", "Σλ/8"]),
    ]
    figure, axes, lines = _panels(log.time, panels)
    figure.suptitle(f"Crawl, preset {log.preset}, {log.joint_speed:g} rad/s{', with noise' if log.noise else ''}")
    legs, torso = _spans(log.time, np.isin(log.phase, LEGS_UP)), _spans(log.time, np.isin(log.phase, TORSO_PHASES))
    for axis in axes.flat:
        _shade(axis, legs, BLUE)
        _shade(axis, torso, VERMILLION)
    for axis in axes[0]:
        _name_spans(axis, [(*span, "legs") for span in legs] + [(*span, "torso") for span in torso])
    _finish(figure, axes, panels, lines, path)


def speed_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Errors against joint speed, `paper` beside `tuned`, nominal and randomised: interquartile means."""
    plt = pyplot()
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    controllers = list(dict.fromkeys(row["controller"] for row in rows))
    figure, axes = plt.subplots(2, len(conditions), figsize=(7.2, 4.6), sharex=True, sharey="row", squeeze=False)
    drawn = []
    for row_axes, key, label in zip(
        axes, ("position_mm", "attitude_mrad"), ("position error [mm]", "attitude error [mrad]"), strict=True
    ):
        for axis, condition in zip(row_axes, conditions, strict=True):
            lines = []
            for name in controllers:
                own = [row for row in rows if row["controller"] == name and row["condition"] == condition]
                lines += axis.plot([row["joint_speed"] for row in own], [row[key] for row in own], marker="o")
            axis.margins(x=0.04)
            drawn.append((axis, lines))
        row_axes[0].set_ylabel(label)
        row_axes[0].set_ylim(0.0, 1.08 * max(row[key] for row in rows))
    for axis, condition in zip(axes[0], conditions, strict=True):
        axis.set_title(condition)
    for axis in axes[-1]:
        axis.set_xlabel("joint speed [rad/s]")
    figure.suptitle("Random asymmetric forms: RMS norm of a flight without its first second, interquartile mean")
    _label(figure, drawn, controllers)
    save(figure, path)


def _panels(
    time: np.ndarray, panels: Sequence[tuple[str, np.ndarray, list[str]]]
) -> tuple[Figure, Axes, list[list[Line]]]:
    """Three rows of two panels over one time axis; the figure, its axes and each panel's lines."""
    figure, axes = pyplot().subplots(3, 2, figsize=(7.2, 6.2), sharex=True)
    lines = []
    for letter, axis, (title, values, _) in zip("ABCDEF", axes.flat, panels, strict=True):
        lines.append([axis.plot(time, column)[0] for column in values.T])
        axis.set_title(f"{letter}   {title}", pad=12 if letter in "AB" else 5)
        axis.margins(y=0.08)
        axis.set_xlim(0.0, time[-1])
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    return figure, axes, lines


def _finish(
    figure: Figure,
    axes: Axes,
    panels: Sequence[tuple[str, np.ndarray, list[str]]],
    lines: Sequence[Sequence[Line]],
    path: Path,
) -> None:
    """Names at the lines, then the files."""
    _label(figure, zip(axes.flat, lines, strict=True), *(names for _, _, names in panels))
    save(figure, path)


def _label(figure: Figure, drawn: Iterable[tuple[Axes, Sequence[Line]]], *names: list[str]) -> None:
    """Names at the lines of several axes; one list of names may serve all of them."""
    drawn = list(drawn)
    figure.draw_without_rendering()
    for (axis, lines), own in zip(drawn, names * len(drawn) if len(names) == 1 else names, strict=True):
        label_lines(axis, lines, own)


def _spans(time: np.ndarray, inside: np.ndarray) -> list[Span]:
    """Start and end of each stretch in which a condition holds [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], inside, [0])).astype(int))).reshape(-1, 2)
    return [(float(time[start]), float(time[min(end, len(time) - 1)])) for start, end in edges]


def _shade(axis: Axes, spans: Iterable[Span], color: str) -> None:
    for start, end in spans:
        axis.axvspan(start, end, color=color, alpha=0.10, linewidth=0, zorder=0)


def _name_spans(axis: Axes, names: Iterable[tuple[float, float, str]]) -> None:
    """Names of stretches of time, above the axes."""
    for start, end, name in names:
        axis.annotate(
            name, xy=((start + end) / 2, 1.0), xycoords=axis.get_xaxis_transform(), xytext=(0, 2),
            textcoords="offset points", ha="center", va="bottom", fontsize=6, color="0.35", annotation_clip=False,
        )  # fmt: skip


def _mark_rmse(axis: Axes, rmse: float, form: str) -> None:
    """The real robot's RMSE as a grey band; its words have a strip of their own, where no curve is."""
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
