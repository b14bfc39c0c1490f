"""`course_planner`: the cheapest way in predicted time and energy over gaits, forms and places, planned as it goes.

Stations lie every few centimetres before the goal; at each the robot may lie, fly stretched out or fly narrow, where
the next gates leave it room. Dijkstra's shortest path (SciPy) over them says until where to go on as it does now, and
what comes then. Speeds and powers below are round numbers of the rule's own runs.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from spidar_gym.benchmark import COURSE
from spidar_gym.control.course.gates import Course, Gate
from spidar_gym.control.course.target import Target
from spidar_gym.policies.course import CoursePolicy, Sight

STEP = 0.05
"""Between two stations [m]."""
LIES, WIDE, NARROW = range(3)
"""On the floor; in the air with legs stretched out, and below."""
CLEAR = {LIES: 1.15, WIDE: 1.5, NARROW: 0.9}
"""A gate that cannot be passed so is kept away from by so much [m]."""
STOPPED_BY = {LIES: {"wall", "slot"}, WIDE: {"beam", "slot"}, NARROW: {"beam"}}
"""What cannot be passed so."""
SPEED = {LIES: 0.043, WIDE: 0.65, NARROW: 0.5}
"""Mean speeds [m/s]."""
POWER = {LIES: 1100.0, WIDE: 2700.0, NARROW: 2700.0}
"""Electrical powers [W]."""
CHANGE = {
    (LIES, WIDE): 5.0, (LIES, NARROW): 8.0, (WIDE, LIES): 8.0, (NARROW, LIES): 15.0, (WIDE, NARROW): 3.0,
    (NARROW, WIDE): 3.0,
}  # fmt: skip
"""Time of a take-off, a landing, a change of form [s]."""
WHOLE_TIME, WHOLE_ENERGY = 300.0, 453.0
"""Time [s] and energy [Wh] that count as much as each other."""
OVER, LOWEST, THROUGH = 0.6, 0.9, 1.3
"""Heights over a wall, over the floor, and in a slot [m]."""
FAST, SLOW = 1.2, 0.9
"""Largest speeds of a flight, wide and narrow [m/s]."""
NEAR, LEVEL, ALIGNED, FORMED = 0.07, 0.12, 0.03, 0.06
"""What counts as there: along the course, in height, to the side of a slot [m], joints [rad]."""
BEFORE_WALL = 2.2
"""So far before a wall it has to be high enough [m]."""


class CoursePlanner(CoursePolicy):
    """Plans the cheapest way over gaits, forms and places, twice a second anew; courses only."""

    name = "course_planner"
    presets = {COURSE: {"action_mode": "waypoint"}}  # noqa: RUF012 - nobody writes it

    def choose(self, sight: Sight) -> Target:
        """Where to go from here; what has begun with a take-off or a landing is not thought over."""
        if sight.target is None or sight.phase in ("lie", "crawl", "hover", "fly", "form"):
            return self._plan(sight)
        if sight.target.flies:
            return sight.target
        return Target(x=float(sight.position_w[0]), y=float(sight.position_w[1]))

    def _plan(self, sight: Sight) -> Target:
        course, goal = sight.course, sight.course.goal
        x = float(sight.position_w[0])
        count = max(1, round((goal.x - x) / STEP))
        stations = goal.x - STEP * np.arange(count, -1, -1)
        now = self._now(sight)
        modes = cheapest(course, stations, now)
        changes = np.flatnonzero(modes[1:, 1] != modes[:-1, 1])
        until = int(modes[changes[0], 0]) if changes.size else count
        then = int(modes[changes[0] + 1, 1]) if changes.size else LIES
        if now == LIES and until > 0:
            return self._crawl(course, float(stations[until]), until == count)
        if now == LIES and not changes.size:
            return Target(x=goal.x, y=goal.y, yaw=goal.yaw)
        return self._fly(sight, float(stations[until]), now, then, is_last=until == count)

    def _now(self, sight: Sight) -> int:
        """How it moves now; with the legs between two forms as it was told last."""
        if sight.phase in ("lie", "crawl"):
            return LIES
        for mode, narrow in ((WIDE, 0.0), (NARROW, 1.0)):
            if np.abs(sight.joint_position - Target(narrow=narrow).form).max() < FORMED:
                return mode
        return NARROW if sight.target is not None and sight.target.narrow > 0.5 else WIDE

    @staticmethod
    def _crawl(course: Course, until: float, is_last: bool) -> Target:
        goal = course.goal
        return Target(x=goal.x, y=goal.y, yaw=goal.yaw) if is_last else Target(x=until, y=0.0)

    def _fly(self, sight: Sight, until: float, now: int, then: int, *, is_last: bool) -> Target:
        """As far as the present form leads, and then the next, once it is there."""
        course = sight.course
        x, y, z = sight.position_w.tolist()
        slot = _ahead(course, "slot", x, until)
        side = slot.middle if slot is not None else course.goal.y if is_last else 0.0
        is_narrow = now == NARROW
        height = _height(course, x, until, is_narrow=is_narrow)
        if now != LIES and abs(until - x) < NEAR and (abs(y - side) < ALIGNED or then != LIES):
            if then == LIES:
                return Target(x=x, y=y)
            is_narrow = then == NARROW
        wall = _ahead(course, "wall", x, until)
        is_low = z < height - LEVEL
        off_line = slot is not None and is_narrow and x < slot.begin and abs(y - side) > ALIGNED
        if wall is not None and is_low and x > wall.begin - BEFORE_WALL:
            until = min(x, wall.begin - CLEAR[WIDE])
        if slot is not None and (off_line or now != NARROW) and until > slot.begin - CLEAR[NARROW]:
            until = min(max(x, slot.begin - CLEAR[WIDE]), slot.begin - CLEAR[NARROW])
        speed = SLOW if is_narrow else FAST
        return Target(True, until, side, height, speed=speed, narrow=1.0 if is_narrow else 0.0)


def cheapest(course: Course, stations: np.ndarray, now: int) -> np.ndarray:
    """The cheapest way from the first station, moving as `now`, to lying at the last: (n, 2) stations and modes.

    Args:
        course: The map.
        stations: Along the course (k,) [m].
        now: How it moves, one of LIES, WIDE, NARROW.
    """
    n, rows, columns, costs = len(stations), [], [], []
    free = {mode: np.array([_is_free(course, mode, x) for x in stations]) for mode in (LIES, WIDE, NARROW)}
    free[now][0] = True
    grounded = np.array([_can_land(course, x) for x in stations]) & free[LIES]

    def add(first: np.ndarray, second: np.ndarray, seconds: float, power: float) -> None:
        rows.append(first)
        columns.append(second)
        costs.append(np.full(len(first), seconds / WHOLE_TIME + seconds * power / 3600.0 / WHOLE_ENERGY))

    for mode in (LIES, WIDE, NARROW):
        on = np.flatnonzero(free[mode][:-1] & free[mode][1:])
        add(mode * n + on, mode * n + on + 1, STEP / SPEED[mode], POWER[mode])
    for (first, second), seconds in CHANGE.items():
        where = free[first] & free[second] & (grounded if LIES in (first, second) else True)
        at = np.flatnonzero(where)
        add(first * n + at, second * n + at, seconds, POWER[WIDE])
    graph = coo_array((np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), (3 * n, 3 * n))
    _, before = dijkstra(graph.tocsr(), indices=now * n, return_predecessors=True)
    way, node = [], LIES * n + n - 1
    while node >= 0:
        way.append((node % n, node // n))
        node = int(before[node])
    return np.array(way[::-1])


def _is_free(course: Course, mode: int, x: float) -> bool:
    near = CLEAR[mode]
    return not any(g.kind in STOPPED_BY[mode] and g.begin - near < x < g.end + near for g in course.gates)


def _can_land(course: Course, x: float) -> bool:
    """Whether all of a robot that lies there is on one floor, with nothing above."""
    near = CLEAR[LIES]
    for gate in course.gates:
        if gate.kind == "beam" and gate.begin - near < x < gate.end + near:
            return False
        if not gate.is_passed and min(abs(x - gate.begin), abs(x - gate.end)) < near:
            return False
    return True


def _ahead(course: Course, kind: str, x: float, until: float) -> Gate | None:
    """The next gate of a kind that this flight comes to."""
    near = CLEAR[WIDE] + 0.2
    return next((g for g in course.gates if g.kind == kind and x < g.end + 0.6 and g.begin < until + near), None)


def _height(course: Course, x: float, until: float, *, is_narrow: bool) -> float:
    """How high it flies: over every wall on the way, and over where it is going."""
    over = [g.size + OVER for g in course.gates if g.kind == "wall" and x < g.end + CLEAR[WIDE] and g.begin < until]
    return max(*over, course.floor_at(until) + LOWEST, course.floor_at(x) + LOWEST, THROUGH if is_narrow else 0.0)
