"""Calibrated worlds: files of kinds of robots, from which the randomisation samples an episode's robot.

A world has mixtures, which explain the real robot's errors by different causes, and variants of the robot's hardware. A
kind is a pair of both. An episode samples a kind, then the numbers of the kind's ranges. The world of an identified
robot also has values that replace those of the described robot, from which ranges deviate, and the numbers of the robot
that its controller is to know.
"""

import hashlib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, read_file, require_form
from spidar_gym.committed import ROOT
from spidar_gym.errors import InvalidValueError, SpidarError, StaleAssetError, UnknownNameError
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.ground import HIGHEST
from spidar_gym.sim.rows import OPTIONAL_ROWS, ORIGINS, TABLE, Row

FOLDER = ROOT / "assets" / "worlds"
"""Folder of the committed worlds."""
PINS = "SHA256SUMS"
"""File with the hash of every world in the folder."""
MOST_BYTES, MAX_KINDS = 2**16, 8
"""Largest size of a file [bytes], and largest number of kinds."""
EVERY = "all"
"""Name of a range of all kinds."""
FORM = {
    "doc": str, "sensors": bool, "trimmed": bool, "floor_steps": float, "mixtures": {str: str}, "variants": {str: str},
    "row": [{"field": str, "origin": str, "source": str, "log": bool, "ranges": {str: [float, float]}}],
}  # fmt: skip
"""Form of a file, apart from the tables `values` and `robot`, which are optional."""


@dataclass(frozen=True)
class World:
    """A calibrated world."""

    name: str
    """Name with its version, as `calibrated_1`."""
    doc: str
    """Description."""
    digest: str
    """SHA-256 of the file."""
    sensors: bool
    """Whether the controller receives the estimate from simulated sensors."""
    trimmed: bool
    """Whether a flight's integrals begin with the values that the robot needs at rest; else they begin at zero."""
    floor_steps: float
    """Height of the tiles of a crawl's floor, each sampled from 0 to this [m]; 0 for flat floors."""
    mixtures: tuple[tuple[str, str], ...]
    """Name and description of each mixture of causes."""
    variants: tuple[tuple[str, str], ...]
    """Name and description of each variant of the hardware."""
    rows: tuple[Row, ...]
    """Sampled parameters."""
    values: tuple[tuple[str, float | tuple[Any, ...]], ...] = ()
    """Values of fields of `PlantConfig` that replace the nominal ones, from which samples deviate."""
    robot: RobotSpec = ROBOT
    """The robot that the controller is to know."""

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Mixture and variant of each kind."""
        return tuple((m, v) for (m, _), (v, _) in product(self.mixtures, self.variants))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds, `mixture-variant`."""
        return tuple("-".join(pair) for pair in self.pairs)

    def nominal(self, plant: PlantConfig) -> PlantConfig:
        """Return a robot with the world's values, from which samples deviate."""
        parts: dict[str, dict[str, Any]] = {}
        for field, value in self.values:
            part, name = field.split(".")
            parts.setdefault(part, {})[name] = np.array(value) if isinstance(value, tuple) else value
        return replace(plant, **{part: replace(getattr(plant, part), **own) for part, own in parts.items()})


def world_names() -> list[str]:
    """Return the names of the committed worlds."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


@cache
def find_world(name: str) -> World:
    """Return a committed world by its name.

    Raises:
        UnknownNameError: For a name that does not exist; it lists the valid ones.
        StaleAssetError: For a file that differs from its pinned hash, or is not valid.
    """
    if name not in world_names():
        raise UnknownNameError("world", name, world_names())
    path = FOLDER / f"{name}.toml"
    try:
        world = read_world(path)
        pins = read_file(FOLDER / PINS, MOST_BYTES).decode("utf-8", "replace").splitlines()
        if f"{world.digest}  {path.name}" not in pins:
            raise BorderError("not the pinned one")
    except SpidarError as error:
        raise StaleAssetError(path, "git checkout", str(error)) from error
    return world


def read_world(path: Path) -> World:
    """Read a world from its file (`BorderError` for a file that cannot be read, or is no world)."""
    data = read_file(path, MOST_BYTES).replace(b"\r\n", b"\n")  # Git may check out CRLF
    try:
        content = tomllib.loads(data.decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise BorderError(f"no TOML: {error!s:.99}") from error
    values, robot = content.pop("values", {}), content.pop("robot", {})
    require_form(content, FORM, path.stem)
    mixtures, variants = tuple(content["mixtures"].items()), tuple(content["variants"].items())
    kinds = list(product(content["mixtures"], content["variants"]))
    if not 0 < len(kinds) <= MAX_KINDS:
        raise BorderError(f"{len(kinds)} pairs of a mixture and a variant, not 1 … {MAX_KINDS}")
    names = [*content["mixtures"], *content["variants"], EVERY]
    if len({*names}) < len(names):
        raise BorderError(f"a mixture and a variant, or one of them and {EVERY}, have the same name")
    rows = tuple(_row(entry, kinds, names) for entry in content["row"])
    fields = [row.field for row in rows]
    if twice := [name for name in fields if fields.count(name) > 1]:
        raise BorderError(f"two rows of {twice[0]}")
    steps = float(content["floor_steps"])
    if not 0.0 <= steps <= HIGHEST:
        raise BorderError(f"floor_steps {steps:g}, not 0 … {HIGHEST:g} m")
    how = content["sensors"], content["trimmed"], steps
    world = World(
        path.stem, content["doc"], hashlib.sha256(data).hexdigest(), *how, mixtures, variants, rows, _values(values)
    )
    try:
        world.nominal(PlantConfig())
        return replace(world, robot=RobotSpec.parse(robot))
    except InvalidValueError as error:
        raise BorderError(f"values of no robot: {error}") from error


def _values(given: object) -> tuple[tuple[str, float | tuple[Any, ...]], ...]:
    """Read the table `values`: numbers, or arrays of the shape of their field."""
    if not isinstance(given, dict):
        raise BorderError("values is no table of fields")
    known, found = {row.field: row for row in (*TABLE, *OPTIONAL_ROWS)}, []
    for name, value in given.items():
        if name not in known:
            raise BorderError(f"a value of {name!r:.60}; valid: {', '.join(known)}")
        shape = known[name].shape
        try:
            array = np.array(value, float)
        except (TypeError, ValueError):
            array = np.full(1, np.nan)
        if array.shape != shape or not np.isfinite(array).all():
            raise BorderError(f"values: {name} {value!s:.60}; valid: finite numbers of the shape {shape}")
        found.append((name, tuple(array.tolist()) if shape else float(array)))
    return tuple(found)


def _row(entry: Mapping[str, Any], kinds: list[tuple[str, str]], names: list[str]) -> Row:
    """Read a row; its ranges are named by mixture, by variant, or `EVERY`."""
    known = {row.field: row for row in (*TABLE, *OPTIONAL_ROWS)}
    field, given, origin = entry["field"], entry["ranges"], entry["origin"]
    if field not in known:
        raise BorderError(f"a row of {field!r:.60}; valid: {', '.join(known)}")
    if origin not in ORIGINS:
        raise BorderError(f"{field}: origin {origin!r:.40}; valid: {', '.join(ORIGINS)}")
    if odd := [name for name in given if name not in names]:
        raise BorderError(f"{field}: a range of {odd[0]!r:.40}; valid: {', '.join(names)}")
    ranges = []
    for kind in kinds:
        own = [given[name] for name in (*kind, EVERY) if name in given]
        if len(own) != 1:
            raise BorderError(f"{field}: {len(own)} ranges of {'-'.join(kind)}, not one")
        low, high = map(float, own[0])
        least = 0.0 if entry["log"] else -math.inf
        if not (least < low <= high < math.inf):
            raise BorderError(f"{field}: {own[0]}, not a range [low, high]" + (" above 0" if entry["log"] else ""))
        ranges.append((low, high))
    low, high = min(low for low, _ in ranges), max(high for _, high in ranges)
    own = {"low": low, "high": high, "source": entry["source"], "origin": origin}
    return replace(known[field], **own, is_log=entry["log"], kinds=tuple(ranges))


def world_lines(world: World) -> list[list[str]]:
    """Return the table of a world's rows: field, operation, range of each kind, unit, origin, source."""
    lines = [["field of `PlantConfig`", "operation", "range", "unit", "origin", "source"]]
    for row in world.rows:
        own = {_span(*ends) for ends in row.kinds}
        shown = own.pop() if len(own) == 1 else ", ".join(_grouped(world, row))
        count = f" × {math.prod(row.shape)}" if row.shape else ""
        shown += count + (", log" if row.is_log else "")
        lines.append([f"`{row.field}`", row.operation, shown, row.unit, row.origin, row.source])
    return lines


def _span(low: float, high: float) -> str:
    return f"{low:.4g} … {high:.4g}" if low < high else f"{low:.4g}"


def _grouped(world: World, row: Row) -> list[str]:
    """Return the ranges of a row by mixture or by variant, whichever decides them."""
    ranges = dict(zip(world.pairs, row.kinds, strict=True))
    for axis, names in enumerate((world.mixtures, world.variants)):
        own = {name: {ends for pair, ends in ranges.items() if pair[axis] == name} for name, _ in names}
        if all(len(ends) == 1 for ends in own.values()):
            return [f"{name} {_span(*ends.pop())}" for name, ends in own.items()]
    return [f"{kind} {_span(*ends)}" for kind, ends in zip(world.kinds, row.kinds, strict=True)]
