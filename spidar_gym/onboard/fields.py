"""Fields of the runner's parameter file: path, unit, count and range of each, from the structs that hold them."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import pi
from typing import Any

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.native.codegen.header import array, define, header, hex_float
from spidar_gym.native.constants import ONBOARD_ITERATIONS
from spidar_gym.native.core_structs import CORE_STRUCTS
from spidar_gym.native.structs import WORDS, Bounds, CStruct, border_structs, struct_of
from spidar_gym.onboard.health import HEALTH_STRUCTS, HOTTEST, VOLTAGES
from spidar_gym.onboard.limits import Limits
from spidar_gym.robot.ranges import INERTIAS, LENGTHS, OTHERS, PLACES

PARAMETERS, MODEL = "spidar_parameters 1", "robot.model"
"""First words of a file, and its first field, which holds the SHA-256 of the robot's model."""
MOST_BYTES, LONGEST = 2**20, 1023
"""Largest size of a file, and of a line without its end [byte]."""
LEAST_MOMENT, ROUNDING = 1e-12, 1e-6
"""A matrix of inertia is positive definite where its leading minors exceed this share of the trace's power; numbers
that determine each other differ by at most this share."""
SECTIONS = {"robot": "robot", "limits": "limits", "estimator": "estimator_config", "manager": "manager_config"}
"""Sections of every file in their order: first part of a field's name, and struct."""
PRESETS = {"flight": "controller_config", "crawl": "crawler_config"}
"""Sections of presets, which follow in any number: first part of a field's name, and struct; the second part is the
preset's name."""
STRUCTURE = {
    ("body", "parent"), ("body", "joint"), ("robot", "joint_body"), ("robot", "link_body"), ("robot", "rotor_body"),
}  # fmt: skip
"""Members that are the same for every robot, and therefore compiled."""
ELSEWHERE = {("manager_config", "flight"), ("manager_config", "crawl")}
"""Members that a mission's presets replace."""
POSITIVE = 1e-12
"""Least value of a number that must be above 0."""
UNITS: dict[str, Bounds] = {
    "1": (0.0, 100.0), "kg": (1e-9, 1e6), "m": (0.0, 10.0), "m/s": (0.0, 30.0), "m/s²": (0.0, 1e3), "s": (0.0, 100.0),
    "rad": (0.0, 2.0 * pi), "rad/s": (0.0, 1e3), "rad/s²": (0.0, 1e4), "Hz": (CONTROL_RATE, CONTROL_RATE),
    "N": (0.0, OTHERS.most), "Nm": (0.0, OTHERS.most), "Nm/rad": (0.0, OTHERS.most), "Nm s/rad": (0.0, OTHERS.most),
    "1/s": (0.0, 1e4), "1/s²": (0.0, 1e4), "1/s³": (0.0, 1e4), "1/(Nm)²": (0.0, 1e6),
    "V": VOLTAGES, "°C": (0.0, HOTTEST), "kg m²": (-INERTIAS.most, INERTIAS.most), "1/s²,1/s³,1/s": (0.0, 1e4),
}  # fmt: skip
"""Least and largest value of numbers by their unit, 1 without one; of gains with more than one unit by all of them."""
_LENGTH, _PLACE, _ANGLE = (LENGTHS.least, LENGTHS.most), (PLACES.least, PLACES.most), (-pi / 2.0, pi / 2.0)
_ABOVE_0: Bounds = (POSITIVE, OTHERS.most)
_AGE: Bounds = (1e-3, 0.5)
RANGES: dict[tuple[str, str], Bounds] = {
    **{("body", name): _PLACE for name in ("position", "com")},
    **{("body", name): (-1.0 - 1e-9, 1.0 + 1e-9) for name in ("rotation", "axis")},
    **{("robot", name): _LENGTH for name in (
        "yaw_axis_xy", "yaw_axis_radius", "yaw_to_pitch", "pitch_to_yaw", "pitch_to_foot", "foot_radius", "peg_depth",
        "duct_reach",
    )},
    **{("robot", name): _PLACE for name in ("yaw_axis_z", "flight_controller")},
    **{("robot", name): _ABOVE_0 for name in (
        "weight", "hover_thrust", "max_thrust", "max_joint_torque", "joint_kp", "max_vectoring_speed",
    )},
    ("robot", "gravity"): (1.0, 30.0),
    ("robot", "joint_limit"): (POSITIVE, pi / 2.0 + 1e-12),
    **{("limits", f"{name}_age"): _AGE for name in ("pose", "imu", "joint", "state")},
    **{("limits", name): (-100.0, 100.0) for name in ("fence_low", "fence_high")},
    ("limits", "settle"): (1.0 / CONTROL_RATE, 60.0),
    ("limits", "gap"): (1.0 / CONTROL_RATE, 0.5),
    ("limits", "tilt"): (1e-3, 1.0),
    ("limits", "torque"): _ABOVE_0,
    ("limits", "hold_ticks"): (0, 4),
    ("limits", "landing_ticks"): (1, 400),
    **{("health_limits", name): _ABOVE_0 for name in ("load", "load_time", "output_time", "age")},
    ("health_limits", "output"): (POSITIVE, 1.0),
    **{(struct, name): _ABOVE_0 for struct in ("controller_config", "crawler_config") for name in (
        "joint_speed", "joint_torque_limit", "torque_limit", "foot_friction", "peg_friction",
    )},
    **{("gait_config", name): _ANGLE for name in ("inner", "outer")},
    **{("gait_config", name): (POSITIVE, 10.0) for name in ("max_distance", "max_turn", "lift_height")},
    ("gait_config", "timeout"): (POSITIVE, 100.0),
    ("allocator_config", "price"): (0.0, 1e6),
    ("allocator_config", "max_iter"): (1, ONBOARD_ITERATIONS),
    ("manager_config", "unload_time"): (POSITIVE, 100.0),
    **{("grasp_config", name): _ABOVE_0 for name in (
        "reach_speed", "near_speed", "turn_speed", "feel_speed", "friction",
    )},
    ("grasp_config", "most_tests"): (1, 100),
}  # fmt: skip
"""Least and largest value of the members of a struct that have another range than their unit."""


@dataclass(frozen=True)
class Field:
    """A number, an array, or a word of the file, on a line of its own."""

    keys: tuple[str | int, ...]
    """Names of the members that lead to it from its section's struct, and indices in arrays of structs."""
    unit: str
    """Unit in SI, 1 without one, without blanks; `word` for words."""
    count: int
    """Number of values."""
    whole: bool
    """Whether the values are whole numbers."""
    least: float
    """Least valid value."""
    most: float
    """Largest valid value."""
    words: tuple[str, ...] = ()
    """Valid words, whose indices the struct holds; empty for numbers."""

    @property
    def path(self) -> str:
        """Name of the field in its section, which is also the member in C: `tree[0].mass`."""
        return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in self.keys)[1:]

    def values(self, record: Any) -> np.ndarray:  # noqa: ANN401 - a record of the section's struct
        """Return the values in a record, (count,)."""
        owner, name = self._owner(record)
        return np.atleast_1d(owner[name])

    def put(self, record: Any, values: Sequence[int | float]) -> None:  # noqa: ANN401 - a record of the section's struct
        """Write the values into a record."""
        owner, name = self._owner(record)
        owner[name] = values if owner.dtype[name].shape else values[0]

    def _owner(self, record: Any) -> tuple[Any, Any]:  # noqa: ANN401 - a record
        *way, name = self.keys
        for key in way:
            record = record[key]
        return record, name


@cache
def _tables() -> Mapping[str, CStruct]:
    return {each.name: each for each in (*border_structs(), *CORE_STRUCTS, *HEALTH_STRUCTS, struct_of(Limits()))}


@cache
def fields_of(struct: str) -> tuple[Field, ...]:
    """Return the fields of a section's struct, nested structs included, in the order of its members."""
    return tuple(_fields(struct, ()))


def _fields(struct: str, way: tuple[str | int, ...]) -> Iterator[Field]:
    """Yield the fields of a struct to which these members lead."""
    for names, kind, shape, doc, *stated in _tables()[struct].rows:
        for name in names.split():
            given: Any = stated[0] if stated else None  # as the table has no bounds for each name here
            at, count = (struct, name), int(np.prod(shape, dtype=int))
            if at in STRUCTURE | ELSEWHERE:
                continue
            if kind in _tables():
                for inner in [(*way, name, k) for k in range(count)] if shape else [(*way, name)]:
                    yield from _fields(kind, inner)
                continue
            unit, words = unit_of(doc), WORDS.get(at, ())
            least, most = map(float, RANGES.get(at) or given or UNITS[unit])
            yield Field(
                (*way, name), "word" if words else unit.replace(" ", "·"), count, kind == "i4", least, most, words
            )


def unit_of(doc: str) -> str:
    """Return the unit in a member's description: the known ones in brackets, joined by commas; 1 if there is none."""
    found = [each for each in re.findall(r"\[([^\[\]]+)\]", doc) if each in UNITS]
    return ",".join(dict.fromkeys(found)) or "1"


def fields_header() -> str:
    """Generate spidar_fields.h: the fields of each section as a table."""
    lines = [
        f'#define SP_PARAMETERS_FORMAT "{PARAMETERS}"',
        f'#define SP_PARAMETERS_MODEL "{MODEL}"',
        define("PARAMETERS_BYTES", MOST_BYTES),
        define("PARAMETERS_LINE", LONGEST),
        define("PARAMETERS_LEAST_MOMENT", LEAST_MOMENT, "share of the trace"),
        define("PARAMETERS_ROUNDING", ROUNDING, "share"),
        "",
        "/* A field of a parameter file: name in its section, unit, place in the struct, number of values, whether",
        " * they are whole, least and largest value, words that stand for numbers. */",
        "typedef struct {",
        "    const char *name, *unit;",
        "    size_t at;",
        "    int32_t count, whole;",
        "    double least, most;",
        "    const char *const *words;",
        "} sp_field;",
        "",
    ]
    sections = {**SECTIONS, **PRESETS}
    chosen = dict.fromkeys(each.words for struct in sections.values() for each in fields_of(struct) if each.words)
    names = {words: f"SP_WORDS_{k}" for k, words in enumerate(chosen)}
    for words, name in names.items():
        lines += array("char *const", name, [f'"{word}"' for word in words])
    for section, struct in sections.items():
        lines += ["", f"static const sp_field SP_{section.upper()}_FIELDS[] = {{"]
        for each in fields_of(struct):
            bounds = f"{hex_float(each.least)}, {hex_float(each.most)}"
            lines.append(
                f'    {{"{each.path}", "{each.unit}", offsetof(sp_{struct}, {each.path}), {each.count}, '
                f"{int(each.whole)}, {bounds}, {names.get(each.words, 'NULL')}}},"
            )
        lines.append("};")
    return header("SPIDAR_FIELDS", "fields of the runner's parameter file.", lines, ("<stddef.h>", '"spidar_runner.h"'))
