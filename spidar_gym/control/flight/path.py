"""Paths of the CoG and its heading: quintics between knots, and the builders of straight legs, lemniscates, splines."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.errors import InvalidValueError, require_above
from spidar_gym.state import Reference

EASE = 0.75
"""Mean acceleration from rest and to rest [m/s²]; the peak is 1.9 times as large."""
REST = 0.5
"""Shortest rest between two straight legs [s]."""
TURN_RATE = 0.6
"""Largest rate of the heading while the position rests [rad/s]."""
KNOT_TIME = 0.25
"""Time between two knots of a lemniscate [s]: the error of the quintics is then below 10 µm at 1.5 m/s."""
AHEAD, AHEAD_STEP = 4, 0.25
"""Number of future times in the preview of a path, and the time between them [s]."""
DETOUR, RUN_AHEAD = 0.1, 0.35
"""Largest overshoot of a coordinate that begins in motion [m] or [rad]; in motion towards its end, plus this share of
its distance."""
TOGETHER = 1e-6
"""Knots closer in time than this are merged [s]."""
LEAST_SECONDS, FADE = 0.5, 0.4
"""Shortest time in which a moving coordinate comes to rest, and shortest time in which an acceleration fades [s]."""
PEAK, DRIFT, SWING = 1.875, 0.2, 0.0173
"""Constants of a quintic of duration t: peak over mean speed from rest to rest; overshoot due to an initial speed v,
over v t; overshoot due to an initial acceleration a, over a t²."""
SUBSTEPS = 8
"""Steps of the fourth-order Runge-Kutta integration between two knots of a lemniscate."""

Point = tuple[float, float, float]
_LATER = tuple(AHEAD_STEP * (k + 1) for k in range(AHEAD))


@dataclass(frozen=True, slots=True)
class PathPreview:
    """Preview of a path at a time for the observation of a policy, world axes."""

    ahead_w: np.ndarray
    """Positions at the future times relative to the present one, shape (4, 3) [m]."""
    turn: np.ndarray
    """Headings at the future times relative to the present one, shape (4,) [rad]."""
    velocity_w: Vector3
    """Present velocity [m/s]."""
    acceleration_w: Vector3
    """Present acceleration [m/s²]."""


@dataclass(frozen=True)
class Path:
    """Knots in the order of time. The robot rests at the first knot before it and at the last knot after it.

    Between two knots every coordinate is the quintic with their values and first and second derivatives, so the
    acceleration is continuous.
    """

    times: np.ndarray
    """Time of each knot, shape (K,) [s]."""
    pose_w: np.ndarray
    """Position of the CoG and heading at each knot, shape (K, 4) [m], [rad]."""
    rate_w: np.ndarray
    """First derivatives at each knot, shape (K, 4) [m/s], [rad/s]."""
    acceleration_w: np.ndarray
    """Second derivatives at each knot, shape (K, 4) [m/s²], [rad/s²]."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for times out of order and for arrays of the wrong shape."""
        knots, times = len(self.times), self.times
        if times.ndim != 1 or not knots or not np.isfinite(times).all() or not (np.diff(times) > 0.0).all():
            raise InvalidValueError("times", times.tolist(), "finite times, each after the one before it")
        for name in ("pose_w", "rate_w", "acceleration_w"):
            values = getattr(self, name)
            if values.shape != (knots, 4) or not np.isfinite(values).all():
                raise InvalidValueError(name, values.shape, f"finite numbers of shape ({knots}, 4)")

    @property
    def seconds(self) -> float:
        """Time of the last knot [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Evaluate pose, rate and acceleration (4,) at a time: x, y, z [m] and heading [rad]."""
        first = int(np.searchsorted(self.times, time, side="right")) - 1
        if first < 0 or first + 1 >= len(self.times):
            return self.pose_w[max(first, 0)].copy(), np.zeros(4), np.zeros(4)
        last, T = first + 1, float(self.times[first + 1] - self.times[first])
        u = (time - float(self.times[first])) / T
        c0, c1, c2 = self.pose_w[first], T * self.rate_w[first], 0.5 * T * T * self.acceleration_w[first]
        d = self.pose_w[last] - (c0 + c1 + c2)
        e = T * self.rate_w[last] - (c1 + 2.0 * c2)
        f = T * T * self.acceleration_w[last] - 2.0 * c2
        c3, c4, c5 = 10.0 * d - 4.0 * e + 0.5 * f, -15.0 * d + 7.0 * e - f, 6.0 * d - 3.0 * e + 0.5 * f
        pose = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        rate = (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / T
        acceleration = (2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (T * T)
        return pose, rate, acceleration

    def preview(self, time: float) -> PathPreview:
        """Compute the preview at a time."""
        pose, rate, acceleration = self.at(time)
        ahead = np.array([self.at(time + later)[0] for later in _LATER]) - pose
        return PathPreview(ahead[:, :3], ahead[:, 3], rate[:3], acceleration[:3])

    def reference(self, time: float, joint_target: JointVector, mode: str = "flight") -> Reference:
        """Compute the reference at a time: the level robot on the path, its joints moving to a form."""
        pose, rate, acceleration = self.at(time)
        half = 0.5 * float(pose[3])
        return Reference(
            pose[:3], np.array([math.cos(half), 0.0, 0.0, math.sin(half)]), rate[:3],
            np.array([0.0, 0.0, rate[3]]), joint_target, mode,
            acceleration_w=acceleration[:3], alpha_b=np.array([0.0, 0.0, acceleration[3]]),
        )  # fmt: skip


class _Knots:
    """Builder of a path from knots."""

    def __init__(self) -> None:
        self._rows: list[list[float]] = []

    def add(self, time: float, pose: list[float], rate: list[float], acceleration: list[float]) -> None:
        """Append a knot."""
        self._rows.append([time, *pose, *rate, *acceleration])

    def path(self) -> Path:
        """Return the path."""
        rows = np.array(self._rows)
        return Path(rows[:, 0], rows[:, 1:5], rows[:, 5:9], rows[:, 9:])


_STILL = [0.0, 0.0, 0.0, 0.0]


def wrap(angle: float) -> float:
    """Wrap an angle into −π … π [rad]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def ease(u: float) -> float:
    """Evaluate the quintic from 0 to 1, from rest to rest."""
    u = min(1.0, max(0.0, u))
    return u * u * u * (10.0 - u * (15.0 - 6.0 * u))


def from_motion(pose: np.ndarray, rate: np.ndarray, acceleration: np.ndarray, end: np.ndarray, speed: float) -> Path:
    """Build a path from a present motion to rest at a pose; from rest it is a straight line.

    A quintic of duration T that begins with rate v and acceleration a overshoots by up to 0.2 v T + 0.017 a T² before
    it turns to its end. A coordinate that would overshoot too far gets a shorter duration, and comes to rest before the
    others. If its distance does not allow that, its acceleration fades in a first segment, in which the coordinate also
    brakes to rest if it moves away from its end.

    Args:
        pose: Present position and heading (4,) [m], [rad].
        rate: Present rates [m/s], [rad/s].
        acceleration: Present accelerations [m/s²], [rad/s²].
        end: Position and heading at the end (4,) [m], [rad].
        speed: Largest speed of a path from rest [m/s].
    """
    way = end - pose
    length, fast = math.sqrt(float(way[:3] @ way[:3])), math.sqrt(float(rate[:3] @ rate[:3]))
    turn = abs(float(way[3]))
    seconds = max(
        PEAK * length / speed, math.sqrt(3.0 * length / EASE), 2.0 * fast / EASE,
        PEAK * turn / TURN_RATE, math.sqrt(3.0 * turn / TURN_RATE), LEAST_SECONDS,
    )  # fmt: skip
    fades, takes = [False] * 4, [0.0] * 4
    brakes = (EASE, EASE, EASE, TURN_RATE)
    for k in range(4):
        d, v, a = float(way[k]), float(rate[k]), float(acceleration[k])
        pace, brake = TURN_RATE if k == 3 else speed, brakes[k]
        least = max(LEAST_SECONDS, PEAK * abs(d) / pace, 2.0 * abs(v) / brake, math.sqrt(3.0 * abs(d) / brake))
        to_drift, to_swing = (DETOUR + (0.0 if d * of < 0.0 else RUN_AHEAD * abs(d)) for of in (v, a))
        drifts = to_drift / (DRIFT * abs(v)) if v else math.inf
        swings = math.sqrt(to_swing / (SWING * abs(a))) if a else math.inf
        takes[k] = min(seconds, max(least, min(drifts, swings)))
        fades[k] = takes[k] > swings or (d * v < 0.0 and takes[k] > drifts)
    fade = max(
        [FADE, *(2.0 * abs(float(rate[k])) / brakes[k] for k in range(4) if fades[k] and way[k] * rate[k] < 0.0)]
    )
    parts = []
    for k in range(4):
        p, v, a = float(pose[k]), float(rate[k]), float(acceleration[k])
        if not fades[k]:
            parts.append(_part([0.0, takes[k]], [p, float(end[k])], [v, 0.0], [a, 0.0]))
            continue
        after = 0.0 if v * way[k] < 0.0 else max(-speed, min(speed, v))
        middle = p + 0.5 * fade * (v + after)
        parts.append(_part([0.0, fade, fade + takes[k]], [p, middle, float(end[k])], [v, after, 0.0], [a, 0.0, 0.0]))
    knots, times = _Knots(), {float(t) for part in parts for t in part.times}
    knots.add(0.0, pose.tolist(), rate.tolist(), acceleration.tolist())
    last = 0.0
    for time in sorted(times):
        if time - last < TOGETHER:
            continue
        last, rows = time, [part.at(time) for part in parts]
        knots.add(time, *([float(row[j][0]) for row in rows] for j in range(3)))
    return knots.path()


def _part(times: list[float], places: list[float], rates: list[float], accelerations: list[float]) -> Path:
    """Build a path with one coordinate, the first; the others are zero."""
    columns = [np.column_stack((values, np.zeros((len(times), 3)))) for values in (places, rates, accelerations)]
    return Path(np.array(times), *columns)


class Legs:
    """Builder of a path of straight legs with a rest at every point."""

    def __init__(
        self, point: Point, speed: float, *, along: bool = False, yaw: float = 0.0, begin: float = 0.0
    ) -> None:
        """Begin at a point; arguments as those of `legs`."""
        self._point, self._speed, self._along, self._heading = point, speed, along, yaw
        self.seconds = begin
        """Time of the last knot so far [s]."""
        self._knots = _Knots()
        self._knots.add(begin, [*point, yaw], _STILL, _STILL)

    def to(self, point: Point) -> None:
        """Append a straight leg to another point and a rest there."""
        (x, y, z), (nx, ny, nz), add = self._point, point, self._knots.add
        way = (nx - x, ny - y, nz - z)
        length = math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
        if self._along and (way[0] or way[1]):
            turn = wrap(math.atan2(way[1], way[0]) - self._heading)
            self._heading += turn
            # The peak rate of a turn from rest to rest is 15/8 of its mean rate.
            self.seconds += max(REST, PEAK * abs(turn) / TURN_RATE) if turn else 0.0
            if turn:
                add(self.seconds, [x, y, z, self._heading], _STILL, _STILL)
        most = math.sqrt(length * EASE)
        fast = min(self._speed, most)
        ease, share = fast / EASE, 0.5 * (fast / most) * (fast / most)
        rate = [fast / length * way[0], fast / length * way[1], fast / length * way[2], 0.0]
        self.seconds += ease
        add(self.seconds, [x + share * way[0], y + share * way[1], z + share * way[2], self._heading], rate, _STILL)
        if share < 0.5 - 1e-9:
            self.seconds += (1.0 - 2.0 * share) * length / fast
            braking = [nx - share * way[0], ny - share * way[1], nz - share * way[2], self._heading]
            add(self.seconds, braking, rate, _STILL)
        for rest in (ease, REST):
            self.seconds += rest
            add(self.seconds, [*point, self._heading], _STILL, _STILL)
        self._point = point

    def path(self) -> Path:
        """Return the path so far."""
        return self._knots.path()


def legs(points: list[Point], speed: float, *, along: bool = False, yaw: float = 0.0, begin: float = 0.0) -> Path:
    """Build a path of straight lines from point to point with a rest at each.

    Args:
        points: Start point and every following point [m].
        speed: Speed between the points, lower on legs too short to reach it [m/s].
        along: Whether the robot turns at each rest to face the next point; otherwise it keeps its heading.
        yaw: Heading at the beginning [rad].
        begin: Time at which it leaves the first point [s].
    """
    _require(points, speed)
    built = Legs(points[0], speed, along=along, yaw=yaw, begin=begin)
    for point in points[1:]:
        built.to(point)
    return built.path()


def lemniscate(
    half_width: float, speed: float, seconds: float,
    *, position_w: Vector3, direction: float = 0.0, along: bool = False, begin: float = 0.0,
) -> Path:  # fmt: skip
    """Build Bernoulli's lemniscate from its crossing, at constant speed except at both ends.

    Args:
        half_width: Distance from the crossing to either end [m].
        speed: Speed along the curve [m/s].
        seconds: Duration from `begin` until the robot is at rest again [s].
        position_w: Position of the crossing [m].
        direction: Initial direction of the curve [rad].
        along: Whether the heading is the direction of the curve; otherwise it is 0.
        begin: Time at which the robot leaves the crossing [s].
    """
    require_above("m", half_width=half_width)
    require_above("m/s", speed=speed)
    require_above("s", seconds=seconds)
    a, ease, knots = half_width, speed / EASE, _Knots()
    if seconds < 2.0 * ease:
        raise InvalidValueError("seconds", seconds, f"{2.0 * ease:.3g} s or more, from rest to {speed:g} m/s and back")
    # x = a cos s / (1 + sin² s), y = x sin s; |dγ/ds| = a / √(1 + sin² s); its tangent turns by 3 atan(sin s) + π/2.
    # At the crossing, s = −π/2, the tangent is −π/4: the curve is turned so that it begins in `direction`.
    turn = direction + 0.25 * math.pi
    c, n = math.cos(turn), math.sin(turn)
    s, x0, y0, z0 = -0.5 * math.pi, *position_w.tolist()

    def pace(t: float) -> tuple[float, float]:
        """Speed and its rate at the time t after the beginning."""
        u = max(0.0, min(1.0, t / ease, (seconds - t) / ease))
        sign = 1.0 if t < 0.5 * seconds else -1.0
        rate = sign * speed * 30.0 * u * u * (1.0 - u) * (1.0 - u) / ease
        return speed * u * u * u * (10.0 - u * (15.0 - 6.0 * u)), rate

    def slope(s: float, t: float) -> float:
        sine = math.sin(s)
        return pace(t)[0] * math.sqrt(1.0 + sine * sine) / a

    for k in range(math.ceil(seconds / KNOT_TIME - 1e-9) + 1):
        time = k * KNOT_TIME
        if k > 0:
            h = KNOT_TIME / SUBSTEPS
            for i in range(SUBSTEPS):
                t = time - KNOT_TIME + i * h
                k1 = slope(s, t)
                k2 = slope(s + 0.5 * h * k1, t + 0.5 * h)
                k3 = slope(s + 0.5 * h * k2, t + 0.5 * h)
                k4 = slope(s + h * k3, t + h)
                s += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        (v, dv), sine, cosine = pace(time), math.sin(s), math.cos(s)
        D = 1.0 + sine * sine
        root = math.sqrt(D)
        x, y = a * cosine / D, a * sine * cosine / D
        heading = turn + 3.0 * math.atan(sine) + 0.5 * math.pi
        bend = 3.0 * cosine / (a * root)  # curvature [1/m]
        bend_rate = -3.0 * sine * (D + cosine * cosine) / (a * root * D) * (v * root / a)
        tx, ty, swing = math.cos(heading), math.sin(heading), bend_rate * v + bend * dv
        knots.add(
            begin + time,
            [x0 + c * x - n * y, y0 + n * x + c * y, z0, heading if along else 0.0],
            [v * tx, v * ty, 0.0, v * bend if along else 0.0],
            [dv * tx - v * v * bend * ty, dv * ty + v * v * bend * tx, 0.0, swing if along else 0.0],
        )
    return knots.path()


def spline(points: list[Point], speed: float, *, along: bool = False, yaw: float = 0.0, begin: float = 0.0) -> Path:
    """Build a smooth path through points, from rest to rest.

    Velocity and acceleration at a point are those of the parabola through the point and its neighbours.

    Args:
        points: Start point and every following point [m].
        speed: Mean speed between two points, halved in the first and the last segment [m/s].
        along: Whether the heading is the direction of the path at every point, and close to it in between; otherwise it
            is constant.
        yaw: The constant heading [rad].
        begin: Time at which the robot leaves the first point [s].
    """
    _require(points, speed)
    ends, times = len(points) - 1, [begin]
    for k in range(ends):
        chord = math.dist(points[k], points[k + 1])
        times.append(times[-1] + chord / speed * (2.0 if k in (0, ends - 1) else 1.0))
    places = [list(point) for point in points]
    rates, bends = _parabolas(times, places)
    headings = [yaw] * len(points)
    if along:
        # At both ends the velocity is zero, and the third derivative gives the direction.
        ways, inside = rates[:], len(points) - 2
        for end, knot, sign in ((0, 1, 1.0), (-1, inside, -1.0)):
            T = abs(times[end] - times[knot])
            ways[end] = [
                10.0 * sign * (places[knot][i] - places[end][i])
                - 4.0 * T * rates[knot][i]
                + 0.5 * sign * T * T * bends[knot][i]
                for i in range(2)
            ]
        headings[0] = math.atan2(ways[0][1], ways[0][0])
        for k in range(1, len(points)):
            headings[k] = headings[k - 1] + wrap(math.atan2(ways[k][1], ways[k][0]) - headings[k - 1])
    turns, swings = _parabolas(times, [[heading] for heading in headings])
    knots = _Knots()
    for k, time in enumerate(times):
        knots.add(time, [*places[k], headings[k]], [*rates[k], *turns[k]], [*bends[k], *swings[k]])
    return knots.path()


def _parabolas(times: list[float], values: list[list[float]]) -> tuple[list[list[float]], list[list[float]]]:
    """Compute both derivatives of the parabola through each value and its neighbours; 0 at both ends."""
    size = len(values[0])
    rates, bends = ([[0.0] * size for _ in values] for _ in range(2))
    for k in range(1, len(values) - 1):
        before, after = times[k] - times[k - 1], times[k + 1] - times[k]
        for i in range(size):
            left, right = (values[k][i] - values[k - 1][i]) / before, (values[k + 1][i] - values[k][i]) / after
            rates[k][i] = (after * left + before * right) / (before + after)
            bends[k][i] = 2.0 * (right - left) / (before + after)
    return rates, bends


def _require(points: list[Point], speed: float) -> None:
    """Raise `InvalidValueError` for invalid points, equal consecutive points or a speed that is not above 0."""
    require_above("m/s", speed=speed)
    numbers = np.array(points, float)
    is_way = numbers.ndim == 2 and numbers.shape[1] == 3 and len(numbers) > 1 and np.isfinite(numbers).all()
    if not is_way or not np.diff(numbers, axis=0).any(axis=1).all():
        raise InvalidValueError("points", numbers.tolist(), "two points (x, y, z) [m] or more, no two in a row alike")
