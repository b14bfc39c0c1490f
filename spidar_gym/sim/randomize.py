"""Domain randomisation: tables of the varied parameters with operation, range and source.

The controller keeps the nominal parameters; the mismatch is intended.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, read_toml
from spidar_gym.errors import InvalidValueError, SpidarError, is_finite, require_name
from spidar_gym.robot import N_JOINTS, N_LINKS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.sim.config import PlantConfig


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

    @property
    def distribution(self) -> str:
        """Distribution in words."""
        return f"U({self.low:.4g}, {self.high:.4g})" + (f" × {math.prod(self.shape)}" if self.shape else "")


MOST_BYTES = 2**16
"""Largest size of a file of ranges [bytes]."""
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
)
"""Parameters that are sampled, after those of `TABLE`, only if the user gives a range for them; a strength does not
randomise them. `low` and `high` are suggestions."""


def _of(row: Row, robot: RobotSpec) -> Row:
    """Return a row for a robot: a range of its own parameter is scaled in proportion to the nominal robot's."""
    name = row.field.rpartition(".")[2]
    nominal = getattr(ROBOT, name, 0.0)
    if row.operation != "set" or not nominal or (share := getattr(robot, name) / nominal) == 1.0:
        return row
    return replace(row, low=share * row.low, high=share * row.high)


@dataclass(frozen=True)
class Randomization:
    """Randomisation of robots: a strength, and custom ranges."""

    strength: float = 0.0
    """Strength 0 … 1; a sample x of the table becomes x₀ + strength (x − x₀), x₀ being the value without effect."""
    ranges: tuple[tuple[str, float, float], ...] = ()
    """Custom ranges (field, low, high) that replace the table's, independently of the strength."""

    @classmethod
    def parse(cls, given: "float | str | Path | Mapping[str, Any] | Randomization") -> "Randomization":
        """Read a randomisation from a user's argument.

        Args:
            given: A strength; or ranges by field, `{"body.total_mass": (15.5, 17.0)}`, with `strength` for all others
                of `TABLE`, 0 by default; or a TOML file of these, in which a field may be in the table of its part.

        Raises:
            UnknownNameError: For a field that is in neither table; it lists the valid ones.
            InvalidValueError: For an invalid strength or range, or a range with values that no robot can have.
            SpidarError: For a file that cannot be read, or is not TOML.
        """
        if isinstance(given, Randomization):
            return given
        if isinstance(given, str | Path):
            given = _read(Path(given))
        if not isinstance(given, Mapping):
            check_strength(given)
            return cls(float(given))
        rest = {name: value for name, value in _flat(given).items() if name != "strength"}
        strength = given.get("strength", 0.0)
        check_strength(strength)
        return cls(float(strength), tuple(_range(name, value) for name, value in rest.items()))

    @property
    def draws(self) -> bool:
        """Whether anything is randomised."""
        return self.strength > 0.0 or bool(self.ranges)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Rows of the nominal robot that are sampled, in order: `TABLE`, and the optional ones with a range."""
        own = {name for name, _, _ in self.ranges}
        return (*TABLE, *(row for row in OPTIONAL_ROWS if row.field in own)) if own else TABLE

    def table(self, nominal: PlantConfig) -> tuple[float, tuple[Row, ...]]:
        """Return the strength and the table to sample from.

        Args:
            nominal: The nominal robot.
        """
        table = self.rows if nominal.robot == ROBOT else tuple(_of(row, nominal.robot) for row in self.rows)
        if not self.ranges:
            return self.strength, table
        own = {name: (low, high) for name, low, high in self.ranges}
        return 1.0, tuple(replace(row, **_bounds(row, own.get(row.field), self.strength, nominal)) for row in table)


def _bounds(row: Row, own: tuple[float, float] | None, strength: float, nominal: PlantConfig) -> dict[str, float]:
    """Return a row's range: the custom one, or the table's scaled by the strength about the value without effect."""
    if own is None:
        middle = _neutral(row, nominal)
        own = (middle + strength * (row.low - middle), middle + strength * (row.high - middle))
    return {"low": own[0], "high": own[1]}


def _neutral(row: Row, nominal: PlantConfig) -> Any:  # noqa: ANN401 - a number, of the nominal robot or of the operation
    """Return the value without effect."""
    part, name = row.field.split(".")
    return {"set": getattr(getattr(nominal, part), name), "scale": 1.0, "add": 0.0}[row.operation]


def _read(path: Path) -> Mapping[str, Any]:
    try:
        return read_toml(path, MOST_BYTES)
    except BorderError as error:
        raise SpidarError(
            f"randomization: {path} cannot be read: {error}; valid: a TOML file with strength and ranges by field, as "
            '"body.total_mass" = [15.5, 17.0]'
        ) from error


def _flat(given: Mapping[Any, Any]) -> dict[str, Any]:
    """Return ranges by field, with TOML's tables by part flattened."""
    found: dict[str, Any] = {}
    for name, value in given.items():
        found |= {f"{name}.{own}": one for own, one in value.items()} if isinstance(value, Mapping) else {name: value}
    return found


def _range(name: str, value: Any) -> tuple[str, float, float]:  # noqa: ANN401 - user input
    """Validate the custom range of a field."""
    rows = {row.field: row for row in (*TABLE, *OPTIONAL_ROWS)}
    require_name("randomization", name, ["strength", *rows])
    try:
        low, high = value
    except (TypeError, ValueError):
        low = high = None
    if not (is_finite(low) and is_finite(high) and low <= high):
        raise InvalidValueError(f"randomization: {name}", value, f"a range (low, high) [{rows[name].unit}]")
    for end in (low, high):
        try:
            _with(PlantConfig(), {name: (rows[name], float(end))})
        except InvalidValueError as error:
            raise InvalidValueError(f"randomization: {name}", value, f"values of a robot: {error}") from error
    return name, float(low), float(high)


def _with(nominal: PlantConfig, draws: Mapping[str, tuple[Row, Any]]) -> PlantConfig:
    """Return a robot with sampled values, by field."""
    parts: dict[str, dict[str, Any]] = {}
    for field, (row, draw) in draws.items():
        part, name = field.split(".")
        base = getattr(getattr(nominal, part), name)
        value = draw if row.operation == "set" else base * draw if row.operation == "scale" else base + draw
        parts.setdefault(part, {})[name] = value if row.shape else float(value)
    return replace(nominal, **{part: replace(getattr(nominal, part), **values) for part, values in parts.items()})


def randomize(
    nominal: PlantConfig, rng: np.random.Generator, how: float | Randomization
) -> tuple[PlantConfig, dict[str, np.ndarray]]:
    """Sample a randomised robot.

    Args:
        nominal: The nominal robot.
        rng: Random generator; the number of samples does not depend on `how`, so that strengths are comparable.
        how: A strength, 0 … 1, or a `Randomization` with ranges.

    Returns:
        The randomised robot, and the samples by field.

    Raises:
        InvalidValueError: For a strength outside 0 … 1.
    """
    strength, table = Randomization.parse(how).table(nominal)
    draws = {}
    for row in table:
        neutral = _neutral(row, nominal)
        draws[row.field] = row, neutral + strength * (rng.uniform(row.low, row.high, row.shape) - neutral)
    return _with(nominal, draws), {field: np.array(draw) for field, (_, draw) in draws.items()}


def check_strength(strength: object) -> None:
    """Require a strength within 0 … 1 (`InvalidValueError`)."""
    if not (is_finite(strength) and 0.0 <= strength <= 1.0):
        raise InvalidValueError(
            "randomization", strength, "a strength within 0 … 1, ranges by field, or a TOML file of these"
        )
