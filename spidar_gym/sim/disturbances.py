"""What happens to the robot from outside: wind, pushes, a rotor that fails; native/engine/weather.c lets it happen."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError, is_finite, require_keys, require_name
from spidar_gym.robot import N_ROTORS

FAULTS = ("thrust", "vectoring")
"""What a lost rotor loses: its thrust, or the motion of its vectoring servos."""
LENGTH = np.array([23.0, 23.0, 3.05])
"""Turbulence lengths u, v, w at 10 ft and below [m] [MIL-F-8785C]."""
INTENSITY = np.array([0.196, 0.196, 0.1])
"""Standard deviation of the turbulence over the wind speed there [MIL-F-8785C]."""
MOST = {"wind": (200.0, "m/s"), "push": (1e4, "N"), "fault_time": (1e9, "s")}
"""No more than this: what is left of the robot would be no simulation."""
PUSH_SECONDS = 0.2
"""Length of a push [s]."""
PUSH_EVERY = (5.0, 15.0)
"""Seconds between two pushes, drawn evenly."""


@dataclass(frozen=True)
class Disturbances:
    """Disturbances of an episode; all off by default."""

    wind: float = 0.0
    """Mean wind [m/s], from a direction drawn at reset, with first-order Dryden turbulence of that strength."""
    push: float = 0.0
    """Force of pushes on the torso [N], 0.2 s long, every 5 … 15 s, from a direction drawn each time."""
    lost_rotor: int = 0
    """Module that fails, 1 … 8; 0 for none. The controller is told."""
    fault: str = "thrust"
    """`thrust`: the module no longer thrusts; `vectoring`: its φ and θ stay where they are."""
    fault_time: float = 2.0
    """When it fails [s]."""

    def __post_init__(self) -> None:
        """Refuse what cannot happen."""
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
        """Whether there is wind, or pushes."""
        return self.wind > 0.0 or self.push > 0.0

    @classmethod
    def parse(cls, values: "Mapping[str, Any] | Disturbances | None") -> "Disturbances":
        """From a dictionary, as `gym.make` and `reset` take it (`UnknownNameError` lists the valid names)."""
        if isinstance(values, Disturbances):
            return values
        given = {} if values is None else values
        return cls(**require_keys("disturbances", "disturbance", given, [f.name for f in fields(cls)]))
