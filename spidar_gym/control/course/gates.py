"""Map of a course: gates and floors that span the field from side to side, and the goal."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError, SpidarError, require_flag, require_name, require_within

GATES = ("wall", "beam", "slot")
"""Gates are passed: over a wall, under a beam (closed above, up to the ceiling), through a slot (up to the ceiling)."""
FLOORS = ("platform", "tiles", "slope")
"""Floors are stood on; the slope rises along the course."""
KINDS = (*GATES, *FLOORS)
"""All kinds of gates and floors."""
MAX_GATES = 8
"""Largest number of gates and floors of a course."""
HALF_WIDTH, CEILING = 3.0, 3.0
"""Half the width and the height of the field [m]."""
BEFORE, BEYOND = 2.5, 2.5
"""Length of the field before the start, and behind the goal or the last gate, whichever is farther [m]."""
ROW, TILE_ROWS, TILE_COLUMNS = 0.25, 14, 2
"""Length of a row of tiles [m], largest number of rows, and number of tiles in a row."""
POSSIBLE = {
    "wall": (0.0, 2.0, "m"),
    "beam": (0.5, CEILING, "m"),
    "slot": (1.25, 2.0 * HALF_WIDTH, "m"),
    "platform": (0.0, 0.6, "m"),
    "tiles": (0.0, 0.03, "m"),
    "slope": (0.0, math.radians(12.0), "rad"),
}
"""Range and unit of the sizes with which a gate can be passed, or a floor stood on."""
ROOM, REACH = 2.4, 1.2
"""Smallest distance between two gates, and radius of the lying robot [m]."""
FARTHEST = 60.0
"""Largest distance of gates and goal from the start [m]."""


@dataclass(frozen=True, slots=True)
class Gate:
    """A part of a course, from side to side of the field."""

    kind: str
    """One of `KINDS`."""
    begin: float
    """Begin along the course [m]."""
    end: float
    """End along the course [m]."""
    size: float
    """Height of a wall, a platform or the highest tile, clearance under a beam, width of a slot [m]; angle of a
    slope [rad]."""
    middle: float = 0.0
    """Lateral position of the middle of a slot, to the left [m]."""

    def __post_init__(self) -> None:
        """Raise `UnknownNameError` or `InvalidValueError` for an invalid kind, position or size."""
        require_name("gate", self.kind, KINDS)
        require_within(-FARTHEST, FARTHEST, "m", begin=self.begin, end=self.end)
        if not self.begin < self.end:
            raise InvalidValueError("end", self.end, f"behind the gate's begin at {self.begin:g} m")
        most = 1.0 if self.kind == "slope" else 2.0 * HALF_WIDTH
        require_within(0.0, most, POSSIBLE[self.kind][2], size=self.size)
        require_within(-HALF_WIDTH, HALF_WIDTH, "m", middle=self.middle)

    @property
    def is_passed(self) -> bool:
        """Whether it is passed rather than stood on."""
        return self.kind in GATES

    @property
    def tile_count(self) -> int:
        """Number of tiles."""
        return TILE_COLUMNS * round((self.end - self.begin) / ROW) if self.kind == "tiles" else 0


@dataclass(frozen=True)
class Course:
    """Gates along x in their order, and the pose to reach behind them; the start is at the origin, looking along x."""

    gates: tuple[Gate, ...] = ()
    """Gates and floors in the order in which they are reached."""
    goal: Pose2 = field(default_factory=lambda: Pose2(2.0))
    """Goal pose of the lying torso, world."""
    tiles: tuple[float, ...] = ()
    """Heights of the tiles, row by row from right to left [m]; empty without tiles."""
    dares: bool = False
    """Whether sizes outside `POSSIBLE` are allowed, for experiments."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for gates that cannot be passed or a goal that cannot be reached."""
        require_flag(dares=self.dares)
        if len(self.gates) > MAX_GATES:
            raise InvalidValueError("gates", len(self.gates), f"at most {MAX_GATES}")
        before: Gate | None = None
        for gate in self.gates:
            self._check_gate(gate, before)
            before = gate
        counts = [gate.tile_count for gate in self.gates if gate.kind == "tiles"]
        if len(counts) > 1 or len(self.tiles) != sum(counts):
            valid = f"{TILE_COLUMNS} for each of the rows of {ROW:g} m of the only stretch of tiles"
            raise InvalidValueError("tiles", len(self.tiles), valid)
        if self.tiles:
            (size,) = (gate.size for gate in self.gates if gate.kind == "tiles")
            require_within(0.0, size, "m", **{"lowest tile": min(self.tiles), "highest tile": max(self.tiles)})
        self._check_goal()

    def _check_gate(self, gate: Gate, before: Gate | None) -> None:
        low, high, unit = POSSIBLE[gate.kind]
        if not (self.dares or low <= gate.size <= high):
            raise InvalidValueError(f"size of a {gate.kind}", gate.size, f"within {low:g} … {high:.4g} {unit}")
        if gate.kind == "slot" and abs(gate.middle) + 0.5 * gate.size > HALF_WIDTH:
            raise InvalidValueError("middle", gate.middle, f"a slot between the field's sides at ± {HALF_WIDTH:g} m")
        if gate.kind == "tiles" and not 1 <= gate.tile_count <= TILE_ROWS * TILE_COLUMNS:
            raise InvalidValueError("end", gate.end, f"1 … {TILE_ROWS} rows of tiles of {ROW:g} m")
        # Between a beam and a platform the robot takes off, so all of it must be clear of the beam.
        needs_room = (
            before is not None
            and before.is_passed
            and (gate.is_passed or (before.kind == "beam" and gate.kind == "platform"))
        )
        least = (0.0 if before is None else before.end) + (ROOM if needs_room else REACH)
        if gate.begin < least:
            raise InvalidValueError("begin", gate.begin, f"at least {least:g} m, for the robot to lie before it")

    def _check_goal(self) -> None:
        goal = self.goal
        require_within(-BEFORE, FARTHEST, "m", x=goal.x)
        require_within(-HALF_WIDTH + REACH, HALF_WIDTH - REACH, "m", y=goal.y)
        require_within(-math.pi, math.pi, "rad", yaw=goal.yaw)
        for gate in self.gates:
            off = max(gate.begin - goal.x, goal.x - gate.end)
            if gate.is_passed and gate.kind != "beam" and off < REACH:
                raise InvalidValueError(
                    "goal", (goal.x, goal.y), f"{REACH:g} m from the {gate.kind} at {gate.begin:g} m"
                )
            if gate.kind in FLOORS and abs(off) < REACH:
                valid = f"{REACH:g} m from where the {gate.kind} begins and ends"
                raise InvalidValueError("goal", (goal.x, goal.y), valid)

    @property
    def end(self) -> float:
        """End of the field along the course [m]."""
        return BEYOND + max([self.goal.x, *(gate.end for gate in self.gates)])

    def floor_at(self, x: float) -> float:
        """Return the height of the floor at x [m]; for tiles that of the highest tile."""
        for gate in self.gates:
            if not gate.is_passed and gate.begin <= x <= gate.end:
                return (x - gate.begin) * math.tan(gate.size) if gate.kind == "slope" else gate.size
        return 0.0

    def is_inside(self, x: float, y: float, z: float) -> bool:
        """Whether a point is in the field."""
        return -BEFORE <= x <= self.end and abs(y) <= HALF_WIDTH and z <= CEILING


def parse_course(value: Any) -> Course | None:  # noqa: ANN401 - user input
    """Return a course, built from a dictionary of lists (the form in scenario files) if necessary."""
    if value is None or isinstance(value, Course):
        return value
    valid = "a Course, or {'gates': [[kind, begin, end, size, middle], …], 'goal': [x, y, yaw], 'tiles': […]}"
    if not (isinstance(value, Mapping) and {"gates", "goal"} <= value.keys() <= {"gates", "goal", "tiles", "dares"}):
        raise InvalidValueError("course", value, valid)
    try:
        gates = tuple(Gate(kind, *map(float, rest)) for kind, *rest in value["gates"])
        goal, tiles = Pose2(*map(float, value["goal"])), tuple(map(float, value.get("tiles", ())))
    except SpidarError:
        raise
    except (TypeError, ValueError):
        raise InvalidValueError("course", value, valid) from None
    return Course(gates, goal, tiles, value.get("dares", False))


def plain_course(course: Course) -> dict[str, Any]:
    """Convert a course to a dictionary of lists, which `parse_course` reads."""
    gates = [[g.kind, g.begin, g.end, g.size, g.middle] for g in course.gates]
    goal = [course.goal.x, course.goal.y, course.goal.yaw]
    return {"gates": gates, "goal": goal, "tiles": list(course.tiles), "dares": course.dares}
