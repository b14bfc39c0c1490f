"""The path: follow a path through the air, level, while the joints go through forms; all else is as in the hover."""

import math
from dataclasses import dataclass
from typing import Any

from spidar_gym.control.flight.path import EASE
from spidar_gym.errors import require_name
from spidar_gym.native.engine_structs import HEADINGS, PATHS
from spidar_gym.tasks.hover import RANGES as HOVER_RANGES
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.task import require_ranges, write_constants

PATH_BEGIN = 1.0
"""Time of hovering before the path begins [s]."""
PATH_MIXTURE = 0.25, 0.5
"""Cumulative shares of `mixed`: straight legs, then also lemniscates; all others are splines."""
SPEEDS = 0.3, 1.5
"""Range of sampled speeds [m/s]."""
HALF_WIDTH = 2.0
"""Half the width of a lemniscate, from its crossing to either end [m]."""
CORNER_RADIUS, CORNER_TURN = (0.7, 1.5), (2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)
"""Ranges of a corner of straight legs: distance from the start [m], angle to the previous corner, seen there [rad]."""
BEND_RADIUS, BEND_TURN = (1.0, 2.0), (0.6, 1.2)
"""Ranges of a spline's point: distance from its middle [m], angle to the previous point, seen there [rad]."""
CLIMB = 1.0
"""Largest height of a point above the start [m]."""
RANGES = {**HOVER_RANGES, "speed": (0.05, 3.0, "m/s")}
"""Least and largest value of each argument, and its unit."""


@dataclass(frozen=True)
class PathTask(HoverTask):
    """Follow a path with the CoG, level, while the joints go through a sequence of forms."""

    path: str = "mixed"
    """Kind of path: `legs`, straight from corner to corner with a stop at each, `lemniscate`, 4 m wide, `spline`, round
    and up and down, or `mixed` (25 % legs, 25 % lemniscates, 50 % splines)."""
    speed: float | None = None
    """Speed along the path [m/s]; sampled from 0.3 … 1.5 if None."""
    heading: str = "mixed"
    """Heading: `kept`, `along` the path, or `mixed`, both equally often."""

    def __post_init__(self) -> None:
        """Validate the options."""
        super().__post_init__()
        require_name("path", self.path, PATHS[1:])
        require_name("heading", self.heading, HEADINGS)
        require_ranges(self, {"speed": RANGES["speed"]})

    @property
    def most_knots(self) -> int:
        """Largest number of knots of a path: a leg takes at least 2 s, a piece of a spline is at least 0.5 m long."""
        fastest = SPEEDS[1] if self.speed is None else self.speed
        return 8 + math.ceil(max(4.0, fastest / 0.5) * (self.horizon_s + 2.0 * fastest / EASE))

    def write(self, rules: Any) -> None:  # noqa: ANN401 - a record of `sp_hover_rules`
        """Write the options and constants that the engine needs into `rules`."""
        super().write(rules)
        rules["path"], rules["heading"] = PATHS.index(self.path), HEADINGS.index(self.heading)
        rules["speed"] = SPEEDS if self.speed is None else self.speed
        shapes = "half_width climb corner_radius corner_turn bend_radius bend_turn"
        write_constants(rules, globals(), f"path_begin path_mixture {shapes}")
