"""Domain randomisation: tables of the varied parameters with operation, range and source.

The controller keeps the nominal parameters; the mismatch is intended.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, read_toml
from spidar_gym.errors import InvalidValueError, SpidarError, is_finite, require_name
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.rows import OPTIONAL_ROWS, TABLE, Row
from spidar_gym.sim.worlds import World, find_world, read_world

MOST_BYTES = 2**16
"""Largest size of a file of ranges [bytes]."""


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
    """Custom ranges (field, low, high) that replace the table's, independently of the strength, or the world's."""
    world: World | None = None
    """Calibrated world, whose rows are sampled instead; those with a custom range that it lacks follow."""
    kind: int = -1
    """Index of the kind of the world's robots; −1 if each episode samples one."""
    factors: tuple[tuple[str, float], ...] = ()
    """Factors (field, factor) on the ranges of rows of the world."""

    @classmethod
    def parse(cls, given: "float | str | Path | Mapping[str, Any] | Randomization") -> "Randomization":
        """Read a randomisation from a user's argument.

        Args:
            given: A strength; or ranges by field, `{"body.total_mass": (15.5, 17.0)}`, with `strength` for all others
                of `TABLE`, 0 by default; or a TOML file of these, in which a field may be in the table of its part; or
                a calibrated world by name or file, `calibrated_1`, or one kind of its robots,
                `calibrated_1:wake-damped`; or, beyond its ranges, `world` with ranges for robots of all kinds, or with
                factors on the ranges of each kind: `{"world": "calibrated_1", "actuators.delay": (0.08, 0.08),
                "recirculation.flow_z": 1.5}`.

        Raises:
            UnknownNameError: For a field that is in neither table, a world or a kind that does not exist; it lists the
                valid ones.
            InvalidValueError: For an invalid strength or range, or a range with values that no robot can have.
            SpidarError: For a file that cannot be read, or is not TOML.
        """
        if isinstance(given, Randomization):
            return given
        if isinstance(given, str | Path):
            place, kind = _place(given)
            if not place.suffix and not place.is_file():
                return cls._of_world(find_world(str(place)), kind)
            content = _read(place)
            if "mixtures" in content or kind:
                return cls._of_world(_read_world(place), kind)
            given = content
        if not isinstance(given, Mapping):
            check_strength(given)
            return cls(float(given))
        if "world" in given:
            return cls._beyond(given)
        rest = {name: value for name, value in _flat(given).items() if name != "strength"}
        strength = given.get("strength", 0.0)
        check_strength(strength)
        return cls(float(strength), tuple(_range(name, value) for name, value in rest.items()))

    @classmethod
    def _of_world(cls, world: World, kind: str) -> "Randomization":
        """Return the randomisation of a world, of one kind if it is named."""
        if kind:
            require_name("kind of robots", kind, world.kinds)
        return cls(world=world, kind=world.kinds.index(kind) if kind else -1)

    @classmethod
    def _beyond(cls, given: Mapping[str, Any]) -> "Randomization":
        """Return the randomisation of a world with custom ranges."""
        base = cls.parse(given["world"]) if isinstance(given["world"], str | Path) else cls()
        if base.world is None:
            raise InvalidValueError("randomization: world", given["world"], "name or file of a calibrated world")
        rows = {row.field: row for row in base.world.rows}
        ranges, factors = list[tuple[str, float, float]](), list[tuple[str, float]]()
        for name, value in _flat({key: own for key, own in given.items() if key != "world"}).items():
            if is_finite(value):
                require_name("randomization: row of the world", name, rows)
                if not value > 0.0:
                    raise InvalidValueError(f"randomization: {name}", value, "a factor above 0, or a range (low, high)")
                _range(name, (value * rows[name].low, value * rows[name].high))
                factors.append((name, float(value)))
                continue
            ranges.append(_range(name, value))
            if name in rows and rows[name].is_log and not ranges[-1][1] > 0.0:
                raise InvalidValueError(f"randomization: {name}", value, "a range above 0, whose logarithm is sampled")
        return replace(base, ranges=tuple(ranges), factors=tuple(factors))

    @property
    def name(self) -> str:
        """Name of the calibrated world, with the kind if it is given; empty without a world."""
        if self.world is None:
            return ""
        return self.world.name if self.kind < 0 else f"{self.world.name}:{self.world.kinds[self.kind]}"

    @property
    def draws(self) -> bool:
        """Whether anything is randomised."""
        return self.strength > 0.0 or bool(self.ranges) or self.world is not None

    @property
    def tilts(self) -> bool:
        """Whether each robot has its own plane of the floor."""
        return any(row.is_of_floor for row in self.rows)

    def in_turn(self, index: int) -> "Randomization":
        """Return the randomisation of one of many robots: kinds of a calibrated world in turn, unless one is given."""
        if self.world is None or self.kind >= 0:
            return self
        return replace(self, kind=index % len(self.world.kinds))

    def on_level_floors(self) -> "Randomization":
        """Return the same randomisation with level floors, which consumes the same random numbers.

        Raises:
            InvalidValueError: For ranges of the floor that the user has given.
        """
        if own := [name for name, *_ in self.ranges if name.startswith("ground.")]:
            raise InvalidValueError("randomization", own[0], "fields of the robot: the floor of a course is level")
        if self.world is None or not self.tilts:
            return self
        level = {"low": 0.0, "high": 0.0, "kinds": ((0.0, 0.0),) * len(self.world.kinds)}
        rows = (replace(row, **level) if row.field == "ground.slope" else row for row in self.world.rows)
        return replace(self, world=replace(self.world, rows=tuple(rows)))

    @property
    def rows(self) -> tuple[Row, ...]:
        """Rows of the nominal robot that are sampled, in order: `TABLE`, and the optional ones with a range."""
        if self.world is not None:
            return self._rows_of(self.world)
        own = {name for name, _, _ in self.ranges}
        return (*TABLE, *(row for row in OPTIONAL_ROWS if row.field in own)) if own else TABLE

    def _rows_of(self, world: World) -> tuple[Row, ...]:
        """Return the rows of the world with custom ranges and factors, then the further rows with a custom range."""
        if not (self.ranges or self.factors):
            return world.rows
        own, factors = {name: ends for name, *ends in self.ranges}, dict(self.factors)
        known = {row.field for row in world.rows}
        further = [row for row in (*TABLE, *OPTIONAL_ROWS) if row.field in own and row.field not in known]
        rows = []
        for row in (*world.rows, *further):
            factor = factors.get(row.field, 1.0)
            kinds = [own[row.field]] * len(world.kinds) if row.field in own else row.kinds
            ends = tuple((factor * low, factor * high) for low, high in kinds)
            low, high = min(low for low, _ in ends), max(high for _, high in ends)
            rows.append(replace(row, low=low, high=high, kinds=ends))
        return tuple(rows)

    def nominal(self, plant: PlantConfig) -> PlantConfig:
        """Return the robot from which samples deviate: the given one, with the values of an identified robot."""
        return plant if self.world is None else self.world.nominal(plant)

    def table(self, nominal: PlantConfig) -> tuple[float, tuple[Row, ...]]:
        """Return the strength and the table to sample from.

        Args:
            nominal: The nominal robot.

        Raises:
            InvalidValueError: For a calibrated world and another robot.
        """
        if self.world is not None:
            if nominal.robot not in (ROBOT, self.world.robot):
                raise InvalidValueError("randomization", self.name, "a strength or ranges for a robot of another spec")
            return 1.0, self.rows
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


def margins_world(path: Path | None, otherwise: str) -> str:
    """Return the calibrated world that a robot's file holds, that of an identified robot; else another one."""
    return otherwise if path is None or "mixtures" not in _read(path) else str(path)


def _place(given: str | Path) -> tuple[Path, str]:
    """Split a user's argument into the name or file of a world, or the file of ranges, and the name of a kind."""
    place, _, kind = str(given).rpartition(":")
    return (Path(place), kind) if place and not {*kind} & {*"/\\."} else (Path(given), "")


def _read_world(path: Path) -> World:
    """Read a world of a user's, whose robots must be valid."""
    try:
        world = read_world(path)
        for row in world.rows:
            for end in (row.low, row.high):
                _with(PlantConfig(), {row.field: (row, end)})
    except SpidarError as error:
        raise SpidarError(f"randomization: {path} is no world: {error}; valid: as assets/worlds/*.toml") from error
    return world


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
    how = Randomization.parse(how)
    nominal = how.nominal(nominal)
    strength, table = how.table(nominal)
    kind = sample_kind(how, rng)
    draws = {}
    for row in table:
        neutral = _neutral(row, nominal)
        draws[row.field] = row, neutral + strength * (row.sample(rng, kind) - neutral)
    return _with(nominal, draws), {field: np.array(draw) for field, (_, draw) in draws.items()}


def sample_kind(how: Randomization, rng: np.random.Generator) -> int:
    """Sample the kind of a world's robot; a given kind consumes the same numbers."""
    if how.world is None:
        return 0
    drawn = int(rng.integers(len(how.world.kinds)))
    return drawn if how.kind < 0 else how.kind


def check_strength(strength: object) -> None:
    """Require a strength within 0 … 1 (`InvalidValueError`)."""
    if not (is_finite(strength) and 0.0 <= strength <= 1.0):
        raise InvalidValueError(
            "randomization", strength, "a strength within 0 … 1, ranges by field, or a TOML file of these"
        )
