"""Parameters of the recirculation: the air of the jets that returns to the robot in slow eddies of the robot's size.

native/engine/weather.c advances the eddy, native/engine/air.c adds its flow to the air at every station.
"""

from dataclasses import dataclass, field, fields

import numpy as np

from spidar_gym.arrays import constant
from spidar_gym.errors import InvalidValueError, require_arrays

NEAR_LENGTH = 1.0
"""Distance to the nearest surface over which its effect falls by a factor of e [m] [chosen]."""
MOST_FLOW, MOST_TURN, MOST_NEAR, MOST_SECONDS = 1.0, 1.0, 100.0, 1e4
"""Largest flow over the jets' speed, rotation rate over it [1/m], effect of a surface, time constant [s]."""


@dataclass(frozen=True)
class RecirculationConfig:
    """Parameters of the recirculating wake; off by default.

    The returning air moves like a rigid body with the velocity U + Ω × p at the distance p from the robot's CoG. U and
    Ω are in proportion to the jets' mean speed w = √(Σλ / (16 ρ A)), 25 m/s at hover, so that forces and torques are
    in proportion to the thrust.
    """

    flow_xy: float = 0.0
    """Standard deviation of U over w along x and along y, world axes [1]."""
    flow_z: float = 0.0
    """Standard deviation of U over w along z [1]."""
    turn_xy: float = 0.0
    """Standard deviation of Ω over w about x and about y, world axes [1/m]."""
    turn_z: float = 0.0
    """Standard deviation of Ω over w about z [1/m]."""
    mean_flow: np.ndarray = field(default_factory=lambda: constant(0.0, 3))
    """Mean of U over w, world axes [1]."""
    mean_turn: np.ndarray = field(default_factory=lambda: constant(0.0, 3))
    """Mean of Ω over w, world axes [1/m]."""
    flow_seconds: float = 1.0
    """Correlation time of U [s]."""
    turn_seconds: float = 0.5
    """Correlation time of Ω [s]."""
    near: float = 0.0
    """n in the factor 1 + n exp(−d / 1 m) on U and Ω at the distance d from the nearest floor or box."""

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_arrays(self)
        for f in fields(self):
            value = np.asarray(getattr(self, f.name), float)
            if f.name.endswith("seconds"):
                if not 0.0 < value <= MOST_SECONDS:
                    valid = f"a time above 0, at most {MOST_SECONDS:g} s"
                    raise InvalidValueError(f.name, getattr(self, f.name), valid)
                continue
            most = MOST_NEAR if f.name == "near" else MOST_TURN if "turn" in f.name else MOST_FLOW
            least = -most if f.name.startswith("mean") else 0.0
            if not ((value >= least) & (value <= most)).all():
                valid = f"numbers within {least:g} … {most:g}"
                raise InvalidValueError(f.name, value.tolist(), valid)

    @property
    def acts(self) -> bool:
        """Whether there is any recirculation."""
        parts = (self.flow_xy, self.flow_z, self.turn_xy, self.turn_z, self.mean_flow, self.mean_turn)
        return any(bool(np.any(each)) for each in parts)
