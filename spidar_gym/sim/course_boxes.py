"""The boxes that represent a course in the simulation."""

import math

from spidar_gym.control.course.gates import CEILING, HALF_WIDTH, ROW, TILE_COLUMNS, Course, Gate

Box = tuple[float, float, float, float, float, float, float]
"""Centre, half of length, width and height [m], pitch [rad]: a row of `GroundConfig.boxes`."""
THICK = 0.3
"""Half the thickness of the slab that forms a slope [m]."""
SILL, BEHIND = 0.05, 0.5
"""Half the height of the sill that marks the end of the field, and its distance behind the end [m]."""


def boxes(course: Course) -> list[Box]:
    """Return the boxes of a course; the last one is the sill behind the end of the field."""
    found = [box for gate in course.gates for box in parts(gate, course.tiles)]
    return [*found, (course.end + BEHIND, 0.0, SILL, SILL, HALF_WIDTH, SILL, 0.0)]


def parts(gate: Gate, tiles: tuple[float, ...]) -> list[Box]:
    """Return the boxes of a gate; `tiles` are the heights of its tiles [m]."""
    size = gate.size
    if gate.kind == "beam":
        return [_box(gate, -HALF_WIDTH, HALF_WIDTH, size, CEILING)]
    if gate.kind == "slot":
        right, left = gate.middle - 0.5 * size, gate.middle + 0.5 * size
        return [_box(gate, -HALF_WIDTH, right, 0.0, CEILING), _box(gate, left, HALF_WIDTH, 0.0, CEILING)]
    if gate.kind == "tiles":
        wide = 2.0 * HALF_WIDTH / TILE_COLUMNS
        return [
            (gate.begin + ROW * (k // TILE_COLUMNS + 0.5), wide * (k % TILE_COLUMNS + 0.5) - HALF_WIDTH, 0.5 * height,
             0.5 * ROW, 0.5 * wide, 0.5 * height, 0.0)
            for k, height in enumerate(tiles)
        ]  # fmt: skip
    if gate.kind == "slope":
        c, s, half = math.cos(size), math.sin(size), 0.5 * (gate.end - gate.begin)
        return [(gate.begin + half + THICK * s, 0.0, half * s / c - THICK * c, half / c, HALF_WIDTH, THICK, -size)]
    return [_box(gate, -HALF_WIDTH, HALF_WIDTH, 0.0, size)]


def _box(gate: Gate, right: float, left: float, bottom: float, top: float) -> Box:
    middle = 0.5 * (gate.begin + gate.end), 0.5 * (right + left), 0.5 * (bottom + top)
    return (*middle, 0.5 * (gate.end - gate.begin), 0.5 * (left - right), 0.5 * (top - bottom), 0.0)
