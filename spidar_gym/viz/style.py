"""Shared parts of all figures: the style file, colours that are safe for colour blindness, and labels of lines."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression

from spidar_gym.errors import MissingDependencyError
from spidar_gym.files import whole_file

Figure = Any
Axes = Any
Line = Any
"""Matplotlib's types; Matplotlib is imported only for drawing."""
INSTALL_VIZ = "pip install 'spidar-gym[viz]'"
STYLE = "spidar_gym.viz.spidar"
"""Name of the style file for Matplotlib: `spidar.mplstyle` beside this module."""
BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
SKY, BLACK, GREY = "#56B4E9", "#222222", "#8A8A8A"
Span = tuple[float, float]
"""Start and end of a time span [s]."""
UNDATED = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}
"""Metadata without a date, by the suffix of the file."""
LABEL_GAP = 1.15
"""Least distance of labels, in heights of a label."""


def pyplot() -> Any:  # noqa: ANN401 - a module
    """Import Matplotlib without a display and in the project's style (`MissingDependencyError` without Matplotlib)."""
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot as plt
    except ImportError as error:
        raise MissingDependencyError("matplotlib", INSTALL_VIZ) from error
    plt.style.use(["default", STYLE])
    return plt


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the path's suffix (PNG, PDF, SVG), completely or not at all, and close it."""
    plt = pyplot()
    try:
        with whole_file(path) as draft:
            # Without a date, the same data yield the same file.
            figure.savefig(draft, metadata=UNDATED.get(path.suffix, {}))
    finally:
        plt.close(figure)


def spans(time: np.ndarray, inside: np.ndarray) -> list[Span]:
    """Return start and end of each span in which a condition holds [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], inside, [0])).astype(int))).reshape(-1, 2)
    return [(float(time[start]), float(time[min(end, len(time) - 1)])) for start, end in edges]


def spread(wanted: np.ndarray, gap: float) -> np.ndarray:
    """Return positions at least `gap` apart, in the order of the wanted ones and nearest to them by least squares."""
    order = np.argsort(wanted, kind="stable")
    steps = gap * np.arange(len(wanted))
    places = np.empty(len(wanted))
    places[order] = isotonic_regression(np.asarray(wanted, float)[order] - steps).x + steps
    return places


def label_lines(axis: Axes, lines: Sequence[Line], names: Iterable[str]) -> None:
    """Write each line's name right of the axes, in the line's colour and at the height of its end, without overlaps.

    Call it when the limits and the position of the axes are final, since the distance of names is in points. A thin
    leader connects a name with its line.
    """
    names = list(names)
    size = pyplot().rcParams["xtick.labelsize"]
    pixels = axis.figure.dpi / 72.0
    box = axis.get_window_extent()
    # The end of a line across the axes is in axes coordinates, not in data coordinates.
    ends = np.array([line.get_transform().transform(line.get_xydata()[-1]) for line in lines])
    heights = ends[:, 1]
    gap = LABEL_GAP * size * pixels
    places = spread(np.clip(heights, box.y0, box.y1), gap)
    # Shift all names together to stay beside the axes.
    places -= max(0.0, places.max() - box.y1)
    places += max(0.0, box.y0 - places.min())
    for line, name, (end, height), place in zip(lines, names, ends, places, strict=True):
        color = line.get_color()
        axis.annotate(
            name, xy=(1.0, (place - box.y0) / box.height), xycoords="axes fraction", xytext=(9, 0),
            textcoords="offset points", color=color, fontsize=size, va="center", annotation_clip=False,
        )  # fmt: skip
        axis.plot(
            [(end - box.x0) / box.width, 1.0, 1.0 + 7.0 * pixels / box.width],
            [(height - box.y0) / box.height] * 2 + [(place - box.y0) / box.height],
            transform=axis.transAxes, color=color, linewidth=0.6, linestyle=":", clip_on=False, zorder=1,
        )  # fmt: skip
