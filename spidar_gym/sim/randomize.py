"""Domain randomisation: one table of what varies, how, by how much and on whose word.

The controller keeps the nominal numbers: the mismatch is the experiment.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError, is_finite
from spidar_gym.robot import N_JOINTS, N_LINKS, N_ROTORS
from spidar_gym.sim.config import PlantConfig


@dataclass(frozen=True)
class Row:
    """One thing that varies."""

    field: str
    """Where in `PlantConfig`."""
    operation: str
    """`set`: the draw replaces the nominal value; `scale`: it multiplies it; `add`: it is added."""
    low: float
    """Least value at strength 1."""
    high: float
    """Largest value at strength 1; draws are even between the two."""
    unit: str
    """Unit of the draw."""
    source: str
    """Whose range it is."""
    shape: tuple[int, ...] = ()
    """Shape of the independent draws; () is one number for all."""

    @property
    def distribution(self) -> str:
        """In words."""
        return f"U({self.low:.4g}, {self.high:.4g})" + (f" × {math.prod(self.shape)}" if self.shape else "")


CRAWL = "estimate, crawl study"
PHYSICS = "estimate, flight study"
TABLE: tuple[Row, ...] = (
    # Body and ground.
    Row("body.total_mass", "set", 15.2, 16.4, "kg", "[JSK] sum of the parts; estimate"),
    Row("body.link_mass", "scale", 0.90, 1.10, "1", PHYSICS, (N_LINKS,)),
    Row("body.link_com", "add", -0.01, 0.01, "m", PHYSICS, (N_LINKS, 3)),
    Row("body.torso_com", "add", -0.02, 0.02, "m", PHYSICS, (3,)),
    Row("body.inertia", "scale", 0.85, 1.15, "1", PHYSICS, (N_LINKS,)),
    Row("body.foot_friction", "set", 0.5, 1.2, "1", CRAWL),
    Row("body.peg_friction", "set", 0.2, 0.8, "1", CRAWL),
    # Rotors.
    Row("actuators.thrust_gain", "scale", 0.9, 1.1, "1", CRAWL),
    Row("actuators.module_gain", "scale", 0.95, 1.05, "1", CRAWL, (N_ROTORS,)),
    Row("actuators.duct_imbalance", "add", -0.05, 0.05, "1", PHYSICS, (N_ROTORS,)),
    Row("actuators.thrust_tilt", "add", -math.radians(1.5), math.radians(1.5), "rad", PHYSICS, (N_ROTORS, 2)),
    Row("actuators.thrust_offset", "add", -0.003, 0.003, "m", PHYSICS, (N_ROTORS, 2)),
    Row("actuators.max_thrust", "set", 31.8, 42.0, "N", "[JSK], empty to full pack"),
    Row("actuators.thrust_lag", "set", 0.010, 0.060, "s", CRAWL),
    Row("actuators.spin_down", "set", 0.5, 1.2, "1", PHYSICS),
    Row("actuators.thrust_noise", "set", 0.0, 0.3, "N", PHYSICS),
    # Servos.
    Row("actuators.joint_kp", "set", 80.0, 300.0, "Nm/rad", CRAWL),
    Row("actuators.servo_stiffness", "scale", 0.85, 1.15, "1", CRAWL, (N_JOINTS,)),
    Row("actuators.max_joint_torque", "set", 5.5, 8.0, "Nm", CRAWL),
    Row("actuators.joint_speed_factor", "set", 0.9, 1.1, "1", CRAWL),
    Row("actuators.joint_friction", "set", 0.0, 0.5, "Nm", PHYSICS),
    Row("actuators.joint_damping", "set", 0.3, 2.0, "Nm s/rad", PHYSICS),
    Row("actuators.backlash", "set", 0.0, 0.01, "rad", PHYSICS),
    Row("actuators.joint_offset", "add", -0.02, 0.02, "rad", PHYSICS, (N_JOINTS,)),
    Row("actuators.vectoring_kp", "scale", 0.75, 1.25, "1", PHYSICS),
    Row("actuators.vectoring_offset", "add", -0.01, 0.01, "rad", PHYSICS, (N_ROTORS, 2)),
    # Delay, air, sensors.
    Row("actuators.delay", "set", 0.005, 0.040, "s", PHYSICS),
    Row("actuators.vectoring_delay", "set", 0.0, 0.015, "s", PHYSICS),
    Row("aero.zero_thrust_speed", "set", 2.1, 3.2, "1", PHYSICS),
    Row("aero.core_length", "set", 3.25, 6.2, "D", PHYSICS),
    Row("aero.duct_drag_area", "set", 0.0, 0.004, "m²", PHYSICS),
    Row("aero.ground_effect", "set", -1.0, 3.0, "1", PHYSICS),
    Row("sensors.latency", "set", 0.005, 0.030, "s", PHYSICS),
    Row("sensors.factor", "set", 0.5, 1.5, "1", "estimate"),
)
"""Everything that varies, for flight and ground; nominal is the default of the field."""


def randomize(
    nominal: PlantConfig, rng: np.random.Generator, strength: float
) -> tuple[PlantConfig, dict[str, np.ndarray]]:
    """Draw a robot.

    Args:
        nominal: The robot in the middle.
        rng: Source of the draws; as many numbers are taken at every strength, so that strengths are comparable.
        strength: 0 … 1; a draw x becomes x₀ + strength (x − x₀), x₀ the value that changes nothing.

    Returns:
        The drawn robot, and the draws by field.

    Raises:
        InvalidValueError: For a strength outside 0 … 1.
    """
    check_strength(strength)
    parts: dict[str, dict[str, Any]] = {}
    draws: dict[str, np.ndarray] = {}
    for row in TABLE:
        part, name = row.field.split(".")
        base = getattr(getattr(nominal, part), name)
        neutral = {"set": base, "scale": 1.0, "add": 0.0}[row.operation]
        draw = neutral + strength * (rng.uniform(row.low, row.high, row.shape) - neutral)
        draws[row.field] = np.array(draw)
        value = draw if row.operation == "set" else base * draw if row.operation == "scale" else base + draw
        parts.setdefault(part, {})[name] = value if row.shape else float(value)
    drawn = {part: replace(getattr(nominal, part), **values) for part, values in parts.items()}
    return replace(nominal, **drawn), draws


def check_strength(strength: float) -> None:
    """Refuse a strength outside 0 … 1."""
    if not (is_finite(strength) and 0.0 <= strength <= 1.0):
        raise InvalidValueError("randomization", strength, "a strength within 0 … 1")
