"""The strip below a film: what happens over time, with the present moment marked."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from spidar_gym.viz.style import BLUE, VERMILLION, pyplot
from spidar_gym.viz.take import Take, tick_at

COLORS = (BLUE, VERMILLION)
"""Colours of the takes of a film."""
STROKES = ("-", "--")
DPI = 100
OPACITY = 0.86
"""Opacity of the strip over the picture."""


class Strip:
    """A plot of each trace of some takes; what has been is drawn strongly, what comes is pale."""

    def __init__(self, takes: Sequence[Take], width: int, height: int) -> None:
        """Draw it once, strongly and pale; a frame of the film is put together from both.

        Args:
            takes: One or two; two share their plots.
            width: [px].
            height: [px].
        """
        end = max(float(take.time[-1]) for take in takes)
        drawn = [_draw(takes, end, width, height, alpha) for alpha in (1.0, 0.28)]
        (self._past, self._boxes), (self._coming, _) = drawn
        self._takes, self._end = takes, end

    def over(self, frame: np.ndarray, time: float) -> None:
        """Put the strip over the lower end of a frame (height, width, 3) at a time [s]."""
        strip = self._coming.copy()
        for left, right, top, bottom in self._boxes:
            now = left + round((right - left) * min(time / self._end, 1.0))
            strip[:, left - 4 : now] = self._past[:, left - 4 : now]
            strip[top:bottom, now - 1 : now + 1] = 40.0
        below = frame[-len(strip) :]
        below[:] = (1.0 - OPACITY) * below + OPACITY * strip

    def values(self, time: float) -> list[tuple[int, int, list[str]]]:
        """Where the present values are written: right and top [px, from the strip's corner], and those of each take."""
        found = []
        for (_, right, top, _), name in zip(self._boxes, self._takes[0].traces, strict=True):
            largest = max(float(np.abs(take.traces[name]).max()) for take in self._takes)
            digits = 2 if largest < 5.0 else 1 if largest < 50.0 else 0
            numbers = [f"{take.traces[name][tick_at(take, time)]:.{digits}f}" for take in self._takes]
            found.append((right, top, numbers))
        return found


def _draw(
    takes: Sequence[Take], end: float, width: int, height: int, alpha: float
) -> tuple[np.ndarray, list[tuple[int, int, int, int]]]:
    """The strip (height, width, 3), and each plot's left, right, top, bottom [px]."""
    plt = pyplot()
    names = list(takes[0].traces)
    figure, axes = plt.subplots(1, len(names), figsize=(width / DPI, height / DPI), dpi=DPI, layout="none")
    figure.subplots_adjust(left=0.045, right=0.985, bottom=0.22, top=0.80, wspace=0.16)
    for axis, name in zip(axes, names, strict=True):
        for take, color, stroke in zip(takes, COLORS, STROKES, strict=False):
            axis.plot(take.time, take.traces[name], color=color, linestyle=stroke, alpha=alpha, linewidth=1.6)
        for start, last in _marked(takes[0]):
            axis.axvspan(start, last, color=VERMILLION, alpha=0.12, linewidth=0)
        axis.set_title(name, fontsize=9, fontweight="normal", pad=6)
        axis.tick_params(labelsize=8)
        axis.set_xlim(0.0, end)
        axis.margins(y=0.12)
        axis.locator_params(axis="y", nbins=4)
        if axis is axes[-1]:
            axis.set_xlabel("time [s]", fontsize=8, loc="right", labelpad=1)
    figure.canvas.draw()
    image: Any = np.asarray(figure.canvas.buffer_rgba())[:, :, :3].astype(np.float32)
    boxes = []
    for axis in axes:
        box = axis.get_window_extent()
        boxes.append((round(box.x0), round(box.x1), round(height - box.y1), round(height - box.y0)))
    plt.close(figure)
    return image, boxes


def _marked(take: Take) -> list[tuple[float, float]]:
    """Start and end of each phase in which a constraint is dropped [s]."""
    inside = np.array(["dropped" in phase for phase in take.phase])
    edges = np.flatnonzero(np.diff(np.concatenate(([0], inside, [0])).astype(int))).reshape(-1, 2)
    return [(float(take.time[a]), float(take.time[min(b, len(inside) - 1)])) for a, b in edges]
