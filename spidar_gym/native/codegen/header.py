"""Generates C text: constants, structs, the robot's numbers, presets; and computes the digest of an interface."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import dataclasses
import hashlib
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.control.presets import (
    CRAWL_PRESETS,
    FORMER_CRAWL_PRESETS,
    controller_config,
    crawler_config,
)
from spidar_gym.native.constants import (
    ENUMERATIONS,
    NUMBERS,
    ONBOARD_ITERATIONS,
    ROWS,
    SIZES,
    STEPS,
    Enumeration,
    program_modes,
    snake,
)
from spidar_gym.native.core_structs import CORE_STRUCTS
from spidar_gym.native.recipe import source_bytes
from spidar_gym.native.robot import robot
from spidar_gym.native.structs import WORDS, CStruct, border_structs
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.description import model_hash

CORE = Path(__file__).resolve().parents[1] / "core"
"""Sources of the core."""
_C_TYPES = {
    "f8": "double", "f4": "float", "i4": "int32_t", "i8": "int64_t", "u4": "uint32_t", "u8": "uint64_t", "u1": "char",
    "b1": "uint8_t",
}  # fmt: skip


def hex_float(x: float) -> str:
    """Format a double so that C reads it back bit for bit."""
    if np.isinf(x):
        return "HUGE_VAL" if x > 0.0 else "-HUGE_VAL"
    return float(x).hex()


def numbers(values: object) -> str:
    """Format numbers for C, separated by commas."""
    return ", ".join(hex_float(x) for x in np.asarray(values, float).reshape(-1).tolist())


def initializer(value: Any, indent: int = 1) -> str:  # noqa: ANN401 - any configuration
    """Format a C initialiser of a configuration, with hexadecimal floats that keep every bit."""
    struct, pad, parts = snake(type(value).__name__), "    " * indent, []
    for field in dataclasses.fields(value):
        own = getattr(value, field.name)
        if isinstance(own, RobotSpec):
            continue  # in C a robot is `sp_robot`
        if dataclasses.is_dataclass(own):
            text = initializer(own, indent + 1)
        elif isinstance(own, str):
            text = f"SP_{struct}_{field.name}_{own}".upper()
        elif isinstance(own, bool | int):
            text = str(int(own))
        else:
            text = f"{{{numbers(own)}}}" if np.shape(own) else numbers(own)
        parts.append(f"{pad}.{field.name} = {text}")
    return "{\n" + ",\n".join(parts) + "\n" + "    " * (indent - 1) + "}"


def header(guard: str, doc: str, lines: Iterable[str], includes: Iterable[str] = ("<stdint.h>",)) -> str:
    """Format a generated header.

    Args:
        guard: Name of the include guard without `_H`.
        doc: Description of the content.
        lines: Lines of the content.
        includes: Included headers, with brackets or quotes.
    """
    front = [f"/* Generated: {doc} */", f"#ifndef {guard}_H", f"#define {guard}_H", ""]
    return "\n".join([*front, *(f"#include {name}" for name in includes), "", *lines, "", "#endif", ""])


def define(name: str, value: int | float | Sequence[float] | np.ndarray, origin: str = "") -> str:
    """Format a constant of C, an integer, a hexadecimal float or an array, with its origin in Python."""
    if isinstance(value, Sequence | np.ndarray):
        return f"static const double SP_{name}[{len(value)}] = {{{numbers(value)}}};"
    text, comment = f"{value}u" if value > np.iinfo(np.int32).max else str(value), origin
    if isinstance(value, float):
        text, comment = hex_float(value), f"{value!r}, {origin}"
    return f"#define SP_{name} {text}" + (f" /* {comment} */" if comment else "")


def array(kind: str, name: str, items: Sequence[object]) -> list[str]:
    """Format a constant array of C, four items a line."""
    rows = [", ".join(map(str, items[k : k + 4])) for k in range(0, len(items), 4)]
    return [f"static const {kind} {name}[{len(items)}] = {{", *(f"    {row}," for row in rows), "};"]


def c_only(lines: Iterable[str]) -> list[str]:
    """Hide numbers from C++, which has hexadecimal floats from C++17 on, and initialisers with names from C++20 on."""
    return ["#ifndef __cplusplus", *lines, "#endif"]


def tables_last(lines: Sequence[str]) -> list[str]:
    """Move the arrays among constants of `define` to the end, hidden from C++."""
    return [*(x for x in lines if x.startswith("#")), *c_only(x for x in lines if not x.startswith("#"))]


def enumeration(each: Enumeration) -> list[str]:
    """Format an enumeration of C."""
    items = [f"SP_{each.prefix}{word}".upper() + f" = {number}" for word, number in each.numbers.items()]
    items += [f"SP_{each.count}"] if each.count else []
    lines = textwrap.wrap(", ".join(items), 116)
    return [f"/* {each.doc} */", "typedef enum {", *(f"    {line}" for line in lines), f"}} sp_{each.name};", ""]


def struct(each: CStruct) -> list[str]:
    """Format a struct of C."""
    lines = [f"/* {each.doc.replace('*/', '* /')} */", "typedef struct {"]
    for names, kind, shape, doc, *_ in each.rows:
        size = "".join(f"[{n}]" for n in shape)
        members = ", ".join(name + size for name in names.split())
        comment = f" /* {doc.replace('*/', '* /')} */" if doc else ""
        lines.append(f"    {_C_TYPES.get(kind) or f'sp_{kind}'} {members};{comment}")
    return [*lines, f"}} sp_{each.name};", ""]


def constants_header() -> str:
    """Generate spidar_constants.h: sizes, numbers and enumerations, each from its definition in Python."""
    defined = [define(name, value) for name, value in SIZES.items()]
    for prefix, place, names in NUMBERS:
        defined += [define(f"{prefix}{n}".upper(), getattr(place, n), f"{place.__name__}.{n}") for n in names]
    lines = tables_last(defined)
    lines += ["", *(line for each in ENUMERATIONS.values() for line in enumeration(each))]
    for (kind, name), words in WORDS.items():
        items = ", ".join(f"SP_{kind}_{name}_{word}".upper() + f" = {k}" for k, word in enumerate(words))
        lines += [f"enum {{ {items} }};", ""]
    longest = max(map(len, STEPS.values())) + 1
    lines += ["/* Phases of each of sp_phases, −1 after the last. */",
              f"static const int32_t SP_STEP_PHASES[{len(STEPS)}][{longest}] = {{"]  # fmt: skip
    lines += [f"    {{{', '.join(f'SP_{phase}'.upper() for phase in phases)}, -1}}," for phases in STEPS.values()]
    return header("SPIDAR_CONSTANTS", "the numbers that Python and C share.", [*lines, "};"])


def structs_header() -> str:
    """Generate spidar_structs.h: structs that Python and C exchange, configurations, the core's own structs."""
    lines = [line for each in (*border_structs(), *CORE_STRUCTS) for line in struct(each)]
    return header(
        "SPIDAR_STRUCTS", "structs that Python and C exchange, configurations, and the core's state.", lines[:-1],
        ("<stdint.h>", '"spidar_constants.h"'),
    )  # fmt: skip


def _blocks(blocks: Iterable[Any], size: int) -> str:
    """Format C initialisers of costs or rows: the kind of each, and `size` numbers."""
    return ", ".join(
        f"{{SP_{snake(type(each).__name__).upper()}, {numbers([*dataclasses.astuple(each), 0.0, 0.0][:size])}}}"
        for each in blocks
    )


def modes_header() -> str:
    """Generate spidar_modes.h: the blocks of every mode, those on the ground with the default configuration."""
    tables = {"COUNTS": [len(kind.pattern) for kind in ROWS], "ARE_SOFT": [int(kind.soft) for kind in ROWS]}
    lines = ["/* Number of rows of each sp_rows_kind, and whether the fallback may violate them at a cost. */"]
    lines += [line for name, table in tables.items() for line in array("int32_t", f"SP_ROWS_{name}", [0, *table])]
    lines += ["", "static const sp_mode SP_MODES[SP_PROGRAMS] = {"]
    for name, mode in program_modes().items():
        sizes = f"{int(mode.feet_carry)}, {mode.size}, {len(mode.pattern)}"
        costs, rows = _blocks(mode.costs, 1), _blocks(mode.constraints, 2)
        lines.append(f"    {{SP_PROGRAM_{name.upper()}, {sizes},\n     {{{costs}}},\n     {{{rows}}}}},")
    return header("SPIDAR_MODES", "the allocation's modes.", [*lines, "};"], ('"spidar_structs.h"',))


def interface_digest(front: bytes, sources: Path) -> str:
    """Compute the digest of text on which both sides of an interface must agree, and of a folder's C sources."""
    digest = hashlib.sha256(front)
    for file in sorted(sources.glob("*.[ch]*")):
        digest.update(file.name.encode() + b"\0" + source_bytes(file))
    return digest.hexdigest()[:32]


@cache
def interface_hash() -> str:
    """Return the digest on which compiled cores must agree: constants, structs, modes, sources."""
    text = constants_header() + structs_header() + modes_header()
    return interface_digest(text.encode(), CORE)


def model_header(spec: RobotSpec = ROBOT) -> str:
    """Generate spidar_model.h: a robot's numbers as constants, for the program on the robot."""
    lines = [
        f'#define SP_MODEL_SHA256 "{model_hash(spec)}"',
        "",
        f"static const sp_robot SP_ROBOT = {record_initializer(robot(spec))};",
    ]
    return header("SPIDAR_MODEL", "the robot's kinematic tree and limits.", lines, ('"spidar_structs.h"',))


def record_initializer(record: Any, indent: int = 1) -> str:  # noqa: ANN401 - a numpy record
    """Format a C initialiser of a record of a struct, with numbers that keep every bit."""
    pad, parts = "    " * indent, []
    for name in record.dtype.names:
        value = record[name]
        if value.dtype.names and value.ndim:
            text = "{" + ", ".join(record_initializer(each, indent + 1) for each in value) + "}"
        elif value.dtype.names:
            text = record_initializer(value, indent + 1)
        elif value.dtype.kind == "i":
            text = "{" + ", ".join(map(str, value.tolist())) + "}" if value.ndim else str(int(value))
        else:
            text = f"{{{numbers(value)}}}" if value.ndim else numbers(value)
        parts.append(f"{pad}.{name} = {text}")
    return "{\n" + ",\n".join(parts) + "\n" + "    " * (indent - 1) + "}"


def capped_presets(
    flights: Sequence[str], spec: RobotSpec = ROBOT, own: Mapping[str, ControllerConfig] | None = None
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """Return the presets of an export for a robot, with the iteration cap of its computer.

    Args:
        flights: Names of the flight presets.
        spec: The robot.
        own: Further flight controllers by name.

    Returns:
        Configurations by name, of `controller` and of `crawler`; the crawl presets are all.

    Raises:
        UnknownNameError: For a preset that does not exist.
        InvalidValueError: For a robot whose legs cannot reach the poses of a preset.
    """
    crawls = (*CRAWL_PRESETS, *FORMER_CRAWL_PRESETS)
    found = {
        "controller": {name: controller_config(name, spec) for name in flights} | dict(own or {}),
        "crawler": {name: crawler_config(name, robot=spec) for name in crawls},
    }
    return {
        kind: {
            name: replace(each, allocator=replace(each.allocator, max_iter=ONBOARD_ITERATIONS))
            for name, each in presets.items()
        }
        for kind, presets in found.items()
    }


def presets_header(flights: Sequence[str], spec: RobotSpec = ROBOT, parameters: str = "") -> str:
    """Generate spidar_presets.h: presets for a robot, with the iteration cap of its computer.

    Args:
        flights: Names of the flight presets; the first is that of a manager that is given no other.
        spec: The robot.
        parameters: SHA-256 of the parameter file with the same numbers.

    Raises:
        UnknownNameError: For a preset that does not exist.
        InvalidValueError: For a robot whose legs cannot reach the poses of a preset.
    """
    lines = [f'#define SP_PARAMETERS_SHA256 "{parameters}"', ""]
    found = capped_presets(flights, spec)
    for kind, presets in found.items():
        for name, config in presets.items():
            lines += [f"static const sp_{kind}_config SP_PRESET_{name.upper()} = {initializer(config)};", ""]
        table = " ".join(f"X({name}, SP_PRESET_{name.upper()})" for name in presets)
        lines += [f"#define SP_{kind.upper()}_PRESETS(X) {table}", ""]
    lines.append(f"static const sp_estimator_config SP_ESTIMATOR = {initializer(EstimatorConfig())};")
    both = ManagerConfig(flight=found["controller"][flights[0]], crawl=found["crawler"]["robust_overlapped"])
    lines += ["", f"static const sp_manager_config SP_MANAGER = {initializer(both)};"]
    return header("SPIDAR_PRESETS", "the presets, with the simulator's numbers.", lines, ('"spidar_structs.h"',))
