"""Disturbances: wind, pushes, a failing rotor; native/engine/weather.c simulates them."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError, is_finite, require_keys, require_name
from spidar_gym.robot import N_ROTORS

FAULTS = ("thrust", "vectoring")
"""Faults of a rotor: loss of its thrust, or of the motion of its vectoring servos."""
LENGTH = np.array([23.0, 23.0, 3.05])
"""Turbulence lengths u, v, w at 10 ft and below [m] [MIL-F-8785C]."""
INTENSITY = np.array([0.196, 0.196, 0.1])
"""Standard deviation of the turbulence over the wind speed at that height [MIL-F-8785C]."""
MOST = {"wind": (200.0, "m/s"), "push": (1e4, "N"), "fault_time": (1e9, "s")}
"""Upper limits of each disturbance."""
PUSH_SECONDS = 0.2
"""Duration of a push [s]."""
PUSH_EVERY = (5.0, 15.0)
"""Range of the uniformly distributed time between two pushes [s]."""


@dataclass(frozen=True)
class Disturbances:
    """Disturbances of an episode; all off by default."""

    wind: float = 0.0
    """Mean wind speed [m/s], with first-order Dryden turbulence in proportion; its direction is sampled at reset."""
    push: float = 0.0
    """Force of pushes on the torso [N], 0.2 s long, every 5 … 15 s, in a direction sampled for each push."""
    lost_rotor: int = 0
    """Module that fails, 1 … 8; 0 for none. The fault is reported to the controller."""
    fault: str = "thrust"
    """`thrust`: the module loses its thrust; `vectoring`: its φ and θ are stuck."""
    fault_time: float = 2.0
    """Time of the failure [s]."""

    def __post_init__(self) -> None:
        """Validate the disturbances."""
        for name, (most, unit) in MOST.items():
            value = getattr(self, name)
            if not (is_finite(value) and 0.0 <= value <= most):
                raise InvalidValueError(name, value, f"a number of at least 0 [{unit}], at most {most:g}")
            object.__setattr__(self, name, float(value))
        if not (isinstance(self.lost_rotor, Integral) and 0 <= self.lost_rotor <= N_ROTORS):
            raise InvalidValueError("lost_rotor", self.lost_rotor, f"a rotor number 1 … {N_ROTORS}, or 0 for none")
        require_name("fault", self.fault, FAULTS)

    @property
    def has_weather(self) -> bool:
        """Whether there are wind or pushes."""
        return self.wind > 0.0 or self.push > 0.0

    @classmethod
    def parse(cls, values: "Mapping[str, Any] | Disturbances | None") -> "Disturbances":
        """Read disturbances from the dictionary of `gym.make` or `reset` (`UnknownNameError` lists the valid names)."""
        if isinstance(values, Disturbances):
            return values
        given = {} if values is None else values
        return cls(**require_keys("disturbances", "disturbance", given, [f.name for f in fields(cls)]))
