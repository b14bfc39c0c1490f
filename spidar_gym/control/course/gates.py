"""What a map tells of a course: gates that span the field from side to side, what the goal lies on, and where it is."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError, SpidarError, require_flag, require_name, require_within

GATES = ("wall", "beam", "slot")
"""What is passed: over it, under it (it is closed above, up to the ceiling), through it (as high as the ceiling)."""
FLOORS = ("platform", "tiles", "slope")
"""What is stood on; the slope rises along the course."""
KINDS = (*GATES, *FLOORS)
"""They all."""
MAX_GATES = 8
"""Gates and floors that a course has room for."""
HALF_WIDTH, CEILING = 3.0, 3.0
"""The field reaches so far to either side, and up to there [m]."""
BEFORE, BEYOND = 2.5, 2.5
"""So far before the start, and behind the goal or the last gate, whichever is farther [m]."""
ROW, TILE_ROWS, TILE_COLUMNS = 0.25, 14, 2
"""Tiles are so long [m]; at most so many rows lie behind each other, each in so many pieces from side to side."""
POSSIBLE = {
    "wall": (0.0, 2.0, "m"),
    "beam": (0.5, CEILING, "m"),
    "slot": (1.25, 2.0 * HALF_WIDTH, "m"),
    "platform": (0.0, 0.6, "m"),
    "tiles": (0.0, 0.03, "m"),
    "slope": (0.0, math.radians(12.0), "rad"),
}
"""Between these sizes a gate can be passed, or a floor stood on, and their unit."""
ROOM, REACH = 2.4, 1.2
"""Between two gates is so much room [m]; the robot that lies reaches so far from its middle [m]."""
FARTHEST = 60.0
"""No course leads farther [m]."""


@dataclass(frozen=True, slots=True)
class Gate:
    """A part of a course, from side to side of the field."""

    kind: str
    """One of `KINDS`."""
    begin: float
    """Where it begins along the course [m]."""
    end: float
    """Where it ends [m]."""
    size: float
    """Height of a wall or platform, clearance under a beam, width of a slot, of the highest tile [m]; of a slope its
    angle [rad]."""
    middle: float = 0.0
    """To the left, the middle of a slot [m]."""

    def __post_init__(self) -> None:
        """Refuse what is no gate."""
        require_name("gate", self.kind, KINDS)
        require_within(-FARTHEST, FARTHEST, "m", begin=self.begin, end=self.end)
        if not self.begin < self.end:
            raise InvalidValueError("end", self.end, f"behind the gate's begin at {self.begin:g} m")
        most = 1.0 if self.kind == "slope" else 2.0 * HALF_WIDTH
        require_within(0.0, most, POSSIBLE[self.kind][2], size=self.size)
        require_within(-HALF_WIDTH, HALF_WIDTH, "m", middle=self.middle)

    @property
    def is_passed(self) -> bool:
        """Whether it is passed, not stood on."""
        return self.kind in GATES

    @property
    def tile_count(self) -> int:
        """How many tiles it is made of."""
        return TILE_COLUMNS * round((self.end - self.begin) / ROW) if self.kind == "tiles" else 0


@dataclass(frozen=True)
class Course:
    """Gates along x in their order, and the pose to reach behind them; the start is at the origin, looking along x."""

    gates: tuple[Gate, ...] = ()
    """In the order in which they are passed."""
    goal: Pose2 = field(default_factory=lambda: Pose2(2.0))
    """Where the torso is to lie, world."""
    tiles: tuple[float, ...] = ()
    """Heights of the tiles, row by row from right to left, where there are some [m]."""
    dares: bool = False
    """Whether gates may be smaller than what passes them, to see what happens."""

    def __post_init__(self) -> None:
        """Refuse a course that nobody can go, and a goal that nobody can reach."""
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
        # Behind a beam it takes off before a platform: all of it has to be out there.
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
        """Where the field ends along the course [m]."""
        return BEYOND + max([self.goal.x, *(gate.end for gate in self.gates)])

    def floor_at(self, x: float) -> float:
        """Height of what is stood on there, the tops of tiles [m]."""
        for gate in self.gates:
            if not gate.is_passed and gate.begin <= x <= gate.end:
                return (x - gate.begin) * math.tan(gate.size) if gate.kind == "slope" else gate.size
        return 0.0

    def is_inside(self, x: float, y: float, z: float) -> bool:
        """Whether a point is in the field."""
        return -BEFORE <= x <= self.end and abs(y) <= HALF_WIDTH and z <= CEILING


def parse_course(value: Any) -> Course | None:  # noqa: ANN401 - whatever a user gives
    """A course, or one of a dictionary of lists, as scenario files have it."""
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
    """A course as a dictionary of lists: what `parse_course` reads."""
    gates = [[g.kind, g.begin, g.end, g.size, g.middle] for g in course.gates]
    goal = [course.goal.x, course.goal.y, course.goal.yaw]
    return {"gates": gates, "goal": goal, "tiles": list(course.tiles), "dares": course.dares}
