"""Figures of courses: the path of a robot, from above and from the side, and the limits of each gait at gates."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.control.course.gates import BEFORE, CEILING, HALF_WIDTH, POSSIBLE, Course
from spidar_gym.sim.course_boxes import parts
from spidar_gym.tasks.course import SIZES
from spidar_gym.viz.style import BLACK, BLUE, GREEN, GREY, PURPLE, SKY, VERMILLION, Axes, pyplot, save

GAIT_LOOKS = {
    "rule": (BLUE, "o", "-"), "fly wide": (VERMILLION, "D", "--"), "fly narrow": (GREEN, "s", "-."),
    "crawl": (PURPLE, "v", ":"),
}  # fmt: skip
"""Colour, marker and line style of a gait."""
MEASURES = {
    "wall": "height of a wall", "beam": "clearance under a beam", "slot": "width of a slot",
    "platform": "height of a platform", "tiles": "highest tile", "slope": "angle of a slope",
}  # fmt: skip
"""Meaning of the size of each kind of gate."""
DECADES = ("wall", "platform", "tiles")
"""Kinds with a logarithmic axis of sizes: crawling fails at centimetres, flying at metres."""
WAYS = {
    "takes off, lands": SKY, "flies, legs stretched out": VERMILLION, "flies, narrow": GREEN, "crawls": PURPLE
}  # fmt: skip
"""Colour of the path by the robot's motion."""
NARROW = 0.5
"""Least value of a narrow form, between 0, form 1, and 1, form 3."""
APART = 0.015
"""Vertical distance between lines that would overlap, as a share of robots."""


def gate_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw the share of arriving robots over the size of a gate, with a panel per kind and a line per gait."""
    plt = pyplot()
    figure, axes = plt.subplots(2, 3, figsize=(7.2, 4.2), sharey=True)
    for axis, (kind, measure) in zip(axes.flat, MEASURES.items(), strict=True):
        for k, (gait, (color, mark, stroke)) in enumerate(GAIT_LOOKS.items()):
            own = sorted(
                (row for row in rows if (row["kind"], row["gait"]) == (kind, gait)), key=lambda row: row["size"]
            )
            shares = [row["arrived"] / row["runs"] + APART * (1.5 - k) for row in own]
            axis.plot([row["size"] for row in own], shares, color=color, marker=mark, linestyle=stroke)
        axis.axvspan(*SIZES[kind], color=GREY, alpha=0.16, linewidth=0, zorder=0)
        axis.set_title(f"{measure} [{POSSIBLE[kind][2]}]")
        if kind in DECADES:
            axis.set_xscale("log")
            axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.margins(x=0.04)
        axis.set_ylim(-0.06, 1.06)
    for axis in axes[:, 0]:
        axis.set_ylabel("share of arrivals")
    handles = [
        plt.Line2D([], [], color=color, marker=mark, linestyle=stroke, label=gait)
        for gait, (color, mark, stroke) in GAIT_LOOKS.items()
    ]
    handles.append(plt.Rectangle((0, 0), 1, 1, color=GREY, alpha=0.16, linewidth=0, label="sizes of Course-v0"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), columnspacing=1.2, handletextpad=0.5)
    save(figure, path)


def way_of(phase: str, narrow: float) -> str:
    """Return a robot's motion, one of `WAYS`, from its manager's phase and the form of its target."""
    if phase in ("lie", "crawl"):
        return "crawls"
    if phase in ("spool", "climb", "descend", "unload"):
        return "takes off, lands"
    return "flies, narrow" if narrow >= NARROW else "flies, legs stretched out"


def way_figure(course: Course, com_w: np.ndarray, ways: Sequence[str], path: Path) -> None:
    """Draw a course from above and from the side, with the path of the CoG in the colours of `WAYS`.

    Args:
        course: Course.
        com_w: Positions of the CoG, world, (n, 3) [m].
        ways: Motion at each position, n of `WAYS`.
        path: File, PNG, PDF or SVG.
    """
    plt = pyplot()
    figure, axes = plt.subplots(2, 1, figsize=(7.2, 4.4), sharex=True, height_ratios=(2.0 * HALF_WIDTH, CEILING))
    for axis, vertical in zip(axes, (1, 2), strict=True):
        _draw_gates(axis, course, vertical)
        for name, color in WAYS.items():
            is_so = np.array([way == name for way in ways])
            # A segment ends at the first point of the next one, to avoid gaps.
            is_so[1:] |= is_so[:-1]
            axis.plot(
                com_w[:, 0], np.where(is_so, com_w[:, vertical], np.nan), color=color, linestyle="-", linewidth=1.8
            )
        goal = (course.goal.x, course.goal.y if vertical == 1 else course.floor_at(course.goal.x))
        axis.plot(*goal, marker="*", markersize=9, color=BLACK, zorder=5)
        axis.set_aspect("equal")
        axis.grid(visible=False)
        axis.set_xlim(-BEFORE, course.end)
    axes[0].set_ylim(-HALF_WIDTH, HALF_WIDTH)
    axes[0].set_ylabel("y [m]")
    axes[1].set_ylim(0.0, CEILING)
    axes[1].set_ylabel("z [m]")
    axes[1].set_xlabel("x [m]")
    for gate in course.gates:
        words = gate.kind if gate.kind == "slope" else f"{gate.kind}\n{gate.size:.2f} m"
        axes[0].text(0.5 * (gate.begin + gate.end), HALF_WIDTH, words, ha="center", va="bottom", fontsize=7)
    handles = [plt.Line2D([], [], color=color, linestyle="-", label=name) for name, color in WAYS.items()]
    handles.append(plt.Line2D([], [], color=BLACK, marker="*", markersize=9, linestyle="", label="goal"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    save(figure, path)


def _draw_gates(axis: Axes, course: Course, vertical: int) -> None:
    """Draw the boxes of a course, viewed along y or, for `vertical` 1, from above; beams are hatched."""
    patch: Any = pyplot().matplotlib.patches
    for gate in course.gates:
        look: dict[str, Any] = {"facecolor": "0.72", "edgecolor": "0.45", "linewidth": 0.5}
        if gate.kind == "beam":
            look |= {"facecolor": "none", "hatch": "////"} if vertical == 1 else {"hatch": "////"}
        if gate.kind == "slope" and vertical == 2:
            top = course.floor_at(gate.end)
            axis.add_patch(patch.Polygon([(gate.begin, 0.0), (gate.end, 0.0), (gate.end, top)], **look))
            continue
        if not gate.is_passed:
            look["facecolor"] = "0.88"
        for box in parts(gate, course.tiles):
            if vertical == 2 and gate.kind == "slot":
                look["alpha"] = 0.35  # before and behind the robot
            corner = (box[0] - box[3], box[vertical] - box[3 + vertical])
            axis.add_patch(patch.Rectangle(corner, 2.0 * box[3], 2.0 * box[3 + vertical], **look))
