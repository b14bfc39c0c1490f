"""The path: follow a way through the air, level, while the joints go through forms; all else is the hover's."""

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
"""The robot hovers for so long before it leaves [s]."""
PATH_MIXTURE = 0.25, 0.5
"""This share of `mixed` paths are straight legs; these and lemniscates are the second share."""
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
        require_ranges(self, {"speed": RANGES["speed"]})

    @property
    def most_knots(self) -> int:
        """How many a path can have: no leg takes less than 2 s, no piece of a spline goes less than 0.5 m."""
        fastest = SPEEDS[1] if self.speed is None else self.speed
        return 8 + math.ceil(max(4.0, fastest / 0.5) * (self.horizon_s + 2.0 * fastest / EASE))

    def write(self, rules: Any) -> None:  # noqa: ANN401 - a record of `sp_hover_rules`
        """Write what the engine draws and plays."""
        super().write(rules)
        rules["path"], rules["heading"] = PATHS.index(self.path), HEADINGS.index(self.heading)
        rules["speed"] = SPEEDS if self.speed is None else self.speed
        shapes = "half_width climb corner_radius corner_turn bend_radius bend_turn"
        write_constants(rules, globals(), f"path_begin path_mixture {shapes}")
