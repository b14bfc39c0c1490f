"""Tables of the parameters of a simulated robot that are randomised, with operation, range and source."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.robot import N_JOINTS, N_LINKS, N_ROTORS, RobotSpec

ORIGINS = ("published", "derived", "fitted", "chosen")
"""Origins of a calibrated range."""


@dataclass(frozen=True)
class Row:
    """A randomised parameter."""

    field: str
    """Field of `PlantConfig`, `part.name`."""
    operation: str
    """`set`: the sample replaces the nominal value; `scale`: it multiplies it; `add`: it is added."""
    low: float
    """Least value at strength 1."""
    high: float
    """Largest value at strength 1; samples are uniform between both."""
    unit: str
    """Unit of the sample."""
    source: str
    """Source of the range."""
    shape: tuple[int, ...] = ()
    """Shape of the independent samples; () is one number for all."""
    is_log: bool = False
    """Whether the logarithm of a sample is uniform, not the sample."""
    origin: str = ""
    """Origin of a calibrated range, one of `ORIGINS`."""
    kinds: tuple[tuple[float, float], ...] = ()
    """Range of each kind of a calibrated world; `low` and `high` are then the least and the largest of these."""

    @property
    def distribution(self) -> str:
        """Distribution in words."""
        own = f"U({self.low:.4g}, {self.high:.4g})" + (f" × {math.prod(self.shape)}" if self.shape else "")
        return f"log {own}" if self.is_log else own

    @property
    def is_of_floor(self) -> bool:
        """Whether the parameter is of the floor, not of the robot or the air."""
        return self.field.startswith("ground.")

    def sample(self, rng: np.random.Generator, kind: int = 0) -> np.ndarray:
        """Sample the parameter.

        Args:
            rng: Random generator.
            kind: Index of the kind of a calibrated world.
        """
        low, high = self.kinds[kind] if self.kinds else (self.low, self.high)
        if not self.is_log:
            return rng.uniform(low, high, self.shape)
        drawn = rng.uniform(math.log(low), math.log(high), self.shape)
        # Of the same library as in C; a range of one value is that value.
        found = [low if low == high else math.exp(x) for x in np.ravel(drawn).tolist()]
        return np.reshape(found, self.shape)


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
    Row("actuators.max_thrust", "set", 31.8, RobotSpec.max_thrust, "N", "[JSK], empty to full pack"),
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
"""Randomised parameters of the nominal robot, for flight and ground; nominal values are the fields' defaults."""
CHOSEN = "chosen"
OPTIONAL_ROWS: tuple[Row, ...] = (
    Row("actuators.joint_kd", "set", 0.5, 8.9, "Nm s/rad", "chosen; at 1 legs and yaw waver as in the paper's crawl"),
    Row("actuators.servo_speed", "scale", 0.85, 1.15, "1", "chosen; the paper's legs move unequally", (N_JOINTS,)),
    Row("actuators.jitter", "set", 0.0, 0.010, "s", CHOSEN),
    Row("actuators.loss", "set", 0.0, 0.05, "1", CHOSEN),
    Row("actuators.vectoring_backlash", "set", 0.0, 0.01, "rad", CHOSEN),
    Row("actuators.vectoring_friction", "set", 0.0, 0.1, "Nm", CHOSEN),
    Row("actuators.battery_spent", "set", 0.0, 1.0, "1", "full to empty"),
    Row("aero.stacking_loss", "set", 0.0, 0.1, "1", CHOSEN),
    Row("recirculation.flow_xy", "set", 0.0, 0.04, "1", CHOSEN),
    Row("recirculation.flow_z", "set", 0.0, 0.08, "1", CHOSEN),
    Row("recirculation.turn_xy", "set", 0.0, 0.12, "1/m", CHOSEN),
    Row("recirculation.turn_z", "set", 0.0, 0.04, "1/m", CHOSEN),
    Row("recirculation.mean_flow", "add", -0.02, 0.02, "1", CHOSEN, (3,)),
    Row("recirculation.mean_turn", "add", -0.02, 0.02, "1/m", CHOSEN, (3,)),
    Row("recirculation.flow_seconds", "set", 0.5, 4.0, "s", CHOSEN),
    Row("recirculation.turn_seconds", "set", 0.2, 2.0, "s", CHOSEN),
    Row("recirculation.near", "set", 0.0, 2.0, "1", CHOSEN),
    Row("sensors.position_drift", "set", 0.0, 0.005, "m", CHOSEN),
    Row("sensors.rotation_drift", "set", 0.0, 0.02, "rad", CHOSEN),
    Row("ground.slope", "set", 0.0, 0.02, "rad", CHOSEN),
    Row("ground.heading", "set", -math.pi, math.pi, "rad", "any direction"),
)
"""Parameters that are sampled, after those of `TABLE`, only if the user gives a range for them; a strength does not
randomise them. `low` and `high` are suggestions."""
