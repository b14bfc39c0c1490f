"""Learning curves of all runs, with classical controllers as lines."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from spidar_gym.viz.style import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILLION, Axes, label_lines, pyplot, save

AXES = {
    "position_rms_m": ("position RMS [mm]", 1e3), "attitude_rms_rad": ("attitude RMS [mrad]", 1e3),
    "duration_s": ("time [s]", 1.0), "energy_wh": ("energy [Wh]", 1.0), "error": ("error", 1.0),
}  # fmt: skip
"""Label and factor of metrics."""
LOOKS = ((BLUE, "o"), (VERMILLION, "D"), (GREEN, "s"), (PURPLE, "v"), (BLACK, "^"))
STROKES = ("-", "--", ":", "-.")
Curves = Sequence[tuple[list[float], list[float]]]


def learning_curves(
    panels: Mapping[str, Mapping[str, Curves]], lines: Mapping[str, Mapping[str, float]], title: str, path: Path
) -> None:
    """Learning curves of all runs, a panel a metric, with classical controllers as lines, written as PNG and PDF.

    Args:
        panels: Metric → row → for each run its steps and values.
        lines: Row → metric → value.
        title: Title.
        path: Where the PNG goes.
    """
    plt = pyplot()
    figure, axes = plt.subplots(1, len(panels), figsize=(3.9 * len(panels), 3.0), squeeze=False)
    rows = list(dict.fromkeys(row for runs in panels.values() for row in runs))
    labelled = []
    for axis, (metric, runs) in zip(axes[0], panels.items(), strict=True):
        label, factor = AXES[metric]
        last = []
        for row, curves in runs.items():
            color, mark = LOOKS[rows.index(row) % len(LOOKS)]
            drawn = [
                axis.plot(
                    np.array(steps) / 1e6, factor * np.array(values), color=color, linestyle="-", linewidth=0.9,
                    alpha=0.8, marker=mark, markersize=2.2,
                )[0]
                for steps, values in curves
            ]  # fmt: skip
            # The name stands at the run in the middle of its row.
            last.append(sorted(drawn, key=lambda line: line.get_ydata()[-1])[len(drawn) // 2])
        for k, values in enumerate(lines.values()):
            last.append(axis.axhline(factor * values[metric], color=GREY, linewidth=1.0, linestyle=STROKES[k % 4]))
        axis.margins(x=0.03)
        axis.set_yscale("log")
        _number(axis)
        axis.set_xlabel("control ticks [million]")
        axis.set_ylabel(label)
        labelled.append((axis, last, [*runs, *lines]))
    figure.suptitle(title)
    figure.draw_without_rendering()
    for axis, last, names in labelled:
        label_lines(axis, last, names)
    save(figure, path)


def _number(axis: Axes) -> None:
    """Numbers instead of powers of ten on a logarithmic axis; beyond a decade not every line has room for its own."""
    low, high = axis.get_ylim()
    digits = "125" if high > 12.0 * low else "123456789"
    for setter in (axis.yaxis.set_major_formatter, axis.yaxis.set_minor_formatter):
        setter(lambda value, _, digits=digits: f"{value:g}" if f"{value:e}"[0] in digits else "")
    axis.grid(which="both")
