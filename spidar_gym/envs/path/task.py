"""The path task on a page: what is drawn of a way through the air; all else is the hover's."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.control.flight.path import EASE, Legs, Path, Point, lemniscate, spline
from spidar_gym.envs.hover.task import RANGES as HOVER_RANGES
from spidar_gym.envs.hover.task import HoverTask
from spidar_gym.errors import require_name, require_within
from spidar_gym.native.engine_structs import HEADINGS, PATHS

PATH_BEGIN = 1.0
"""The robot hovers for so long before it leaves [s]."""
SPEEDS = 0.3, 1.5
"""Least and largest speed that is drawn [m/s]."""
HALF_WIDTH = 2.0
"""Half of a lemniscate's width, from its crossing to either end [m]."""
CORNER_RADIUS, CORNER_TURN = (0.7, 1.5), (2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)
"""Corners of straight legs lie so far from where they begin [m], and from one to the next it is such an angle there."""
BEND_RADIUS, BEND_TURN = (1.0, 2.0), (0.6, 1.2)
"""Points of a spline lie so far from its middle [m], and from one to the next it is such an angle there [rad]."""
CLIMB = 1.0
"""Points lie up to this much higher than where they begin [m]."""
RANGES = {**HOVER_RANGES, "speed": (0.05, 3.0, "m/s")}
"""Least and largest number of each argument, and its unit."""


@dataclass(frozen=True)
class PathTask(HoverTask):
    """Follow a path with the CoG, level, while the joints go through a sequence of forms."""

    path: str = "mixed"
    """`legs`, straight from corner to corner with a rest at each, `lemniscate`, 4 m wide, `spline`, round and up and
    down, or `mixed` (25 % legs, 25 % lemniscates, 50 % splines)."""
    speed: float | None = None
    """Speed along it [m/s]; 0.3 … 1.5 is drawn if not given."""
    heading: str = "mixed"
    """`kept`, `along` the path, or `mixed`, one as often as the other."""

    def __post_init__(self) -> None:
        """Refuse what cannot be flown."""
        super().__post_init__()
        require_name("path", self.path, PATHS[1:])
        require_name("heading", self.heading, HEADINGS)
        if self.speed is not None:
            require_within(*RANGES["speed"], speed=self.speed)
            object.__setattr__(self, "speed", float(self.speed))

    @property
    def most_knots(self) -> int:
        """How many a path can have: no leg takes less than 2 s, no piece of a spline goes less than 0.5 m."""
        fastest = SPEEDS[1] if self.speed is None else self.speed
        return 8 + math.ceil(max(4.0, fastest / 0.5) * (self.horizon_s + 2.0 * fastest / EASE))

    def draw_path(self, rng: np.random.Generator) -> Path:
        """The episode's path: it lasts beyond the horizon."""
        kind = self.path
        if kind == "mixed":
            which = rng.random()
            kind = "legs" if which < 0.25 else "lemniscate" if which < 0.5 else "spline"
        speed = rng.uniform(*SPEEDS) if self.speed is None else self.speed
        along = self.heading == "along" or (self.heading == "mixed" and rng.random() < 0.5)
        way, origin = rng.uniform(-math.pi, math.pi), self.position_w
        if kind == "lemniscate":
            seconds = self.horizon_s + 2.0 * speed / EASE
            return lemniscate(
                HALF_WIDTH, speed, seconds, position_w=origin, direction=way, along=along, begin=PATH_BEGIN
            )
        first: Point = (float(origin[0]), float(origin[1]), float(origin[2]))
        if kind == "legs":
            built = Legs(first, speed, along=along, yaw=way if along else 0.0, begin=PATH_BEGIN)
            while built.seconds < self.horizon_s:
                point, way = self._point(rng, first, way, CORNER_RADIUS, CORNER_TURN, 1.0)
                built.to(point)
            return built.path()
        sign = 1.0 if rng.random() < 0.5 else -1.0
        away, radius = way + sign * 0.5 * math.pi, rng.uniform(*BEND_RADIUS)
        middle = (first[0] + radius * math.cos(away), first[1] + radius * math.sin(away), first[2])
        points, seconds = [first], PATH_BEGIN
        way = way - sign * 0.5 * math.pi + sign * rng.uniform(*BEND_TURN)
        while seconds < self.horizon_s or len(points) < 3:
            point, way = self._point(rng, middle, way, BEND_RADIUS, BEND_TURN, sign)
            step = [q - p for p, q in zip(points[-1], point, strict=True)]
            seconds += math.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]) / speed
            points.append(point)
        return spline(points, speed, along=along, begin=PATH_BEGIN)

    @staticmethod
    def _point(
        rng: np.random.Generator, middle: Point, angle: float, radius: tuple[float, float],
        turn: tuple[float, float], sign: float,
    ) -> tuple[Point, float]:  # fmt: skip
        """A point at an angle and a radius round another, drawn; the angle of the next."""
        r = rng.uniform(*radius)
        x, y = middle[0] + r * math.cos(angle), middle[1] + r * math.sin(angle)
        return (x, y, middle[2] + rng.uniform(0.0, CLIMB)), angle + sign * rng.uniform(*turn)
