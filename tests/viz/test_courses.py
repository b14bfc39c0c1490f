"""Pins the figures of courses: gates at their places on the map, and one colour for every part of the path."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from spidar_gym import viz
from spidar_gym.control.course.gates import Course, Gate
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.studies.gates import cells
from spidar_gym.tasks.course import SIZES
from spidar_gym.viz.courses import MEASURES, WAYS, way_of

COURSE = Course(
    (Gate("wall", 2.3, 2.5, 0.7), Gate("beam", 5.7, 6.1, 0.6), Gate("slot", 9.3, 9.6, 1.5, 0.3),
     Gate("slope", 11.4, 14.9, 0.1)), Pose2(13.1, 0.2, 0.2),
)  # fmt: skip


def test_whatever_a_robot_does_has_one_colour():
    found = {way_of(phase, narrow) for phase in PHASES for narrow in (0.0, 1.0)}
    assert found == {*WAYS}
    assert way_of("fly", 1.0) != way_of("fly", 0.0)
    assert way_of("crawl", 1.0) == way_of("lie", 0.0) == "crawls"


def test_the_way_is_drawn_whole_over_the_gates(kept, tmp_path):
    n = 40
    com = np.column_stack((np.linspace(0.0, 13.1, n), np.linspace(0.0, 0.2, n), 1.0 + np.sin(np.arange(n))))
    ways = [list(WAYS)[k // 10] for k in range(n)]
    viz.way_figure(COURSE, com, ways, tmp_path / "course.png")
    (figure,) = kept
    for axis, column in zip(figure.axes, (1, 2), strict=True):
        drawn = np.array([line.get_ydata() for line in axis.lines if len(line.get_xdata()) == n])
        assert len(drawn) == len(WAYS)
        shown = np.isfinite(drawn)
        assert shown.any(axis=0).all()
        np.testing.assert_allclose(np.nanmax(drawn, axis=0), com[:, column])
        edges = sorted(patch.get_extents().transformed(axis.transData.inverted()).x0 for patch in axis.patches)
        np.testing.assert_allclose(edges, sorted([2.3, 5.7, 9.3, 9.3, 11.4]), atol=0.07)
    top, side = figure.axes
    assert {text.get_text().split("\n")[0] for text in top.texts} == {gate.kind for gate in COURSE.gates}
    low = [p.get_y() for p in side.patches if hasattr(p, "get_y") and np.isclose(p.get_x(), 5.7)]
    assert low == [pytest.approx(0.6)]  # a beam leaves its clearance


def test_the_figure_of_gates_has_a_panel_a_kind_with_what_is_drawn_in_grey(kept, tmp_path):
    rows = [
        {"kind": kind, "size": size, "gait": gait, "runs": 4, "arrived": 4 if size < 0.5 else 0}
        for kind, size, gait in cells()
    ]
    viz.gate_figure(rows, tmp_path / "gates.png")
    (figure,) = kept
    assert len(figure.axes) == len(MEASURES)
    for axis, kind in zip(figure.axes, MEASURES, strict=True):
        assert MEASURES[kind] in axis.get_title(loc="left")
        sizes = {row["size"] for row in rows if row["kind"] == kind}
        assert {float(x) for line in axis.lines for x in line.get_xdata()} == sizes
        (band,) = axis.patches
        low, high = band.get_x(), band.get_x() + band.get_width()
        assert (low, high) == pytest.approx(SIZES[kind])
        assert all(-0.05 < y < 1.05 for line in axis.lines for y in line.get_ydata())
