"""Figure of the suite: learning curves over steps and wall time, and performance profiles."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spidar_gym.benchmark.statistics import iqm
from spidar_gym.benchmark.suite_results import ALGORITHMS, Result, curves, profile, returns_of
from spidar_gym.envs.suite import SUITE
from spidar_gym.viz.style import BLUE, GREY, VERMILLION, Axes, label_lines, pyplot, save

COLORS = dict(zip(ALGORITHMS, (BLUE, VERMILLION), strict=True))
"""Colour of each algorithm."""
THRESHOLDS = np.linspace(-0.1, 1.1, 121)
"""Thresholds of a performance profile, on the tasks' scale."""


def suite_figure(rows: Sequence[Result], path: Path) -> None:
    """Draw the return of each task over control ticks and over hours, and below the profiles of the algorithms.

    A curve is the IQM over the seeds, its band from the least to the largest. On the scale 0 is the better of zero
    action and random policy, 1 the best classical controller.

    Args:
        rows: Results.
        path: File, PNG, PDF or SVG.
    """
    plt = pyplot()
    names = [name for name in SUITE if any(curves(rows, name, each, "return") for each in ALGORITHMS)]
    figure, axes = plt.subplots(3, max(2, len(names)), figsize=(3.1 * max(2, len(names)), 7.2), squeeze=False)
    for column, name in enumerate(names):
        axes[0, column].set_title(name)
        for row, label in ((0, "control ticks [million]"), (1, "wall time [h]")):
            axis = axes[row, column]
            _draw(axis, rows, name, over_time=row == 1)
            axis.set_xlabel(label)
            axis.set_ylabel("return, scaled" if column == 0 else "")
    for axis in axes[:2, len(names) :].flat:
        axis.remove()
    lines, drawn = [], []
    for algorithm in ALGORITHMS:
        found = returns_of(rows, algorithm)
        if found:
            share = profile(found, THRESHOLDS)
            lines += axes[2, 0].plot(THRESHOLDS, share, color=COLORS[algorithm], drawstyle="steps-post")
            drawn.append(f"{algorithm}, {len(found)} task{'s' * (len(found) > 1)}")
    axes[2, 0].set_xlabel("return, scaled")
    axes[2, 0].set_ylabel("share of runs above")
    for axis in axes[2, 1:]:
        axis.remove()
    figure.draw_without_rendering()
    label_lines(axes[2, 0], lines, drawn)
    save(figure, path)


def _draw(axis: Axes, rows: Sequence[Result], name: str, *, over_time: bool) -> None:
    """Draw the curves of a task."""
    for at in (0.0, 1.0):
        axis.axhline(at, color=GREY, linewidth=0.8, linestyle="--")
    for algorithm in ALGORITHMS:
        own = curves(rows, name, algorithm, "return")
        if own is None:
            continue
        x = own.seconds.mean(axis=0) / 3600.0 if over_time else own.steps / 1e6
        values = SUITE[name].normalised(own.values)
        axis.fill_between(x, values.min(axis=0), values.max(axis=0), color=COLORS[algorithm], alpha=0.2, linewidth=0.0)
        axis.plot(x, iqm(values.T), color=COLORS[algorithm], label=algorithm)
    axis.legend(loc="best", fontsize="small")
