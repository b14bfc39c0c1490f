"""C text from Python: constants, structs, the robot's numbers, presets; and the digest that a core answers to."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import dataclasses
import hashlib
import textwrap
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.native.codegen.solvers import ONBOARD_ITERATIONS
from spidar_gym.native.constants import ENUMERATIONS, NUMBERS, SIZES, STEPS, Enumeration, snake
from spidar_gym.native.core_structs import CORE_STRUCTS
from spidar_gym.native.structs import WORDS, CStruct, border_structs
from spidar_gym.robot import GIMBAL_NAMES, GRAVITY, JOINT_NAMES, N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.robot.description import mjcf_path

CORE = Path(__file__).resolve().parents[1] / "core"
"""Sources of the core."""
_C_TYPES = {"f8": "double", "f4": "float", "i4": "int32_t", "u1": "char"}


def hex_float(x: float) -> str:
    """A double as C reads it back bit for bit."""
    if np.isinf(x):
        return "HUGE_VAL" if x > 0.0 else "-HUGE_VAL"
    return float(x).hex()


def _numbers(values: object) -> str:
    return ", ".join(hex_float(x) for x in np.asarray(values, float).reshape(-1).tolist())


def initializer(value: Any, indent: int = 1) -> str:  # noqa: ANN401 - any configuration
    """A C initialiser of a configuration, numbers as hexadecimal floats: exactly the same ones."""
    struct, pad, parts = snake(type(value).__name__), "    " * indent, []
    for field in dataclasses.fields(value):
        own = getattr(value, field.name)
        if dataclasses.is_dataclass(own):
            text = initializer(own, indent + 1)
        elif isinstance(own, str):
            text = f"SP_{struct}_{field.name}_{own}".upper()
        elif isinstance(own, bool | int):
            text = str(int(own))
        else:
            text = f"{{{_numbers(own)}}}" if np.shape(own) else _numbers(own)
        parts.append(f"{pad}.{field.name} = {text}")
    return "{\n" + ",\n".join(parts) + "\n" + "    " * (indent - 1) + "}"


def header(guard: str, doc: str, lines: Iterable[str], includes: Iterable[str] = ("<stdint.h>",)) -> str:
    """A generated header.

    Args:
        guard: Its name in capitals, without `_H`.
        doc: What is in it.
        lines: Its text.
        includes: What it includes, with brackets or quotes.
    """
    front = [f"/* Generated: {doc} */", f"#ifndef {guard}_H", f"#define {guard}_H", ""]
    return "\n".join([*front, *(f"#include {name}" for name in includes), "", *lines, "", "#endif", ""])


def define(name: str, value: int | float, origin: str = "") -> str:
    """A number of C, whole or as a hexadecimal float, and where Python has it."""
    text, comment = str(value), origin
    if isinstance(value, float):
        text, comment = hex_float(value), f"{value!r}, {origin}"
    return f"#define SP_{name} {text}" + (f" /* {comment} */" if comment else "")


def enumeration(each: Enumeration) -> list[str]:
    """An enumeration of C."""
    items = [f"SP_{each.prefix}{word}".upper() + f" = {number}" for word, number in each.numbers.items()]
    items += [f"SP_{each.count}"] if each.count else []
    lines = textwrap.wrap(", ".join(items), 116)
    return [f"/* {each.doc} */", "typedef enum {", *(f"    {line}" for line in lines), f"}} sp_{each.name};", ""]


def struct(each: CStruct) -> list[str]:
    """A struct of C."""
    lines = [f"/* {each.doc.replace('*/', '* /')} */", "typedef struct {"]
    for names, kind, shape, doc in each.rows:
        size = "".join(f"[{n}]" for n in shape)
        members = ", ".join(name + size for name in names.split())
        comment = f" /* {doc.replace('*/', '* /')} */" if doc else ""
        lines.append(f"    {_C_TYPES.get(kind) or f'sp_{kind}'} {members};{comment}")
    return [*lines, f"}} sp_{each.name};", ""]


def constants_header() -> str:
    """spidar_constants.h: sizes, numbers and enumerations, each from the one place where Python has it."""
    lines = [define(name, value) for name, value in SIZES.items()]
    for prefix, place, names in NUMBERS:
        where = f"{place.__module__}.{place.__name__}" if isinstance(place, type) else place.__name__
        lines += [define(f"{prefix}{n}".upper(), getattr(place, n), f"{where}.{n}") for n in names]
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
    """spidar_structs.h: what crosses the border, configurations, and the core's own structs."""
    lines = [line for each in (*border_structs(), *CORE_STRUCTS) for line in struct(each)]
    return header(
        "SPIDAR_STRUCTS", "what crosses the border, configurations, and what the core remembers.", lines[:-1],
        ("<stdint.h>", '"spidar_constants.h"'),
    )  # fmt: skip


def interface_digest(front: bytes, sources: Path) -> str:
    """Digest of what the two sides of an interface have to agree on, and of a folder's C sources."""
    digest = hashlib.sha256(front)
    for file in sorted(sources.glob("*.[ch]*")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:32]


@cache
def interface_hash() -> str:
    """Digest of everything that a compiled core has to agree on: constants, structs, robot, sources."""
    return interface_digest((constants_header() + structs_header()).encode() + mjcf_path().read_bytes(), CORE)


def model_header() -> str:
    """spidar_model.h."""
    model = pin.buildModelFromMJCF(str(mjcf_path()))
    names = list(model.names)
    ids = [model.getJointId(name) for name in (*JOINT_NAMES, *GIMBAL_NAMES)]
    # The torso is Pinocchio's root joint; every other body follows its parent.
    order = sorted(set(range(1, model.njoints)))
    place = {joint: k for k, joint in enumerate(order)}
    rows = []
    for joint in order:
        inertia, placement = model.inertias[joint], model.jointPlacements[joint]
        root = place[joint] == 0
        axis = np.zeros(3) if root else _axis(model, joint)
        index = 0 if root else ids.index(joint)
        rotation = np.eye(3) if root else placement.rotation
        position = np.zeros(3) if root else placement.translation
        parent = 0 if root else place[model.parents[joint]]
        rows.append(
            f"    {{{parent}, {index}, {{{_numbers(rotation)}}}, {{{_numbers(position)}}}, {{{_numbers(axis)}}},\n"
            f"     {hex_float(inertia.mass)}, {{{_numbers(inertia.lever)}}}, {{{_numbers(inertia.inertia)}}}}}, "
            f"/* {names[joint]} */"
        )
    joints = [place[i] for i in ids[:N_JOINTS]]
    links = [place[model.getJointId(f"joint{i}_pitch")] for i in range(1, N_ROTORS + 1)]
    rotors = [place[model.getJointId(f"gimbal{i}_pitch")] for i in range(1, N_ROTORS + 1)]
    constants = {
        "GRAVITY": GRAVITY, "TOTAL_MASS": ROBOT.total_mass, "WEIGHT": ROBOT.weight,
        "HOVER_THRUST": ROBOT.hover_thrust, "MAX_THRUST": ROBOT.max_thrust,
        "MAX_JOINT_TORQUE": ROBOT.max_joint_torque, "JOINT_LIMIT": ROBOT.joint_limit, "JOINT_KP": ROBOT.joint_kp,
        "MAX_VECTORING_SPEED": ROBOT.max_vectoring_speed, "YAW_AXIS_XY": ROBOT.yaw_axis_xy,
        "YAW_AXIS_RADIUS": ROBOT.yaw_axis_radius, "YAW_AXIS_Z": ROBOT.yaw_axis_z,
        "YAW_TO_PITCH": ROBOT.yaw_to_pitch, "PITCH_TO_YAW": ROBOT.pitch_to_yaw,
        "PITCH_TO_FOOT": ROBOT.pitch_to_foot, "FOOT_RADIUS": ROBOT.foot_radius, "PEG_DEPTH": ROBOT.peg_depth,
    }  # fmt: skip
    digest = hashlib.sha256(mjcf_path().read_bytes()).hexdigest()
    lines = [
        f'#define SP_MODEL_SHA256 "{digest}"',
        f'#define SP_INTERFACE "{interface_hash()}"',
        *(f"#define SP_{name} {hex_float(value)} /* {value!r} */" for name, value in constants.items()),
        "",
        f"static const double SP_FLIGHT_CONTROLLER[3] = {{{_numbers(ROBOT.flight_controller)}}};",
        "",
        f"#define SP_BODIES {len(order)}",
        "/* A body and the joint that carries it: 0 … 15 are joints, from 16 on vectoring angles. */",
        "typedef struct {",
        "    int32_t parent, joint;",
        "    double rotation[9], position[3], axis[3]; /* of the joint in its parent */",
        "    double mass, com[3], inertia[9];          /* in the body's own axes; inertia about its CoG */",
        "} sp_body;",
        "static const sp_body SP_TREE[SP_BODIES] = {",
        *rows,
        "};",
        f"static const int32_t SP_JOINT_BODY[16] = {{{', '.join(map(str, joints))}}};",
        f"static const int32_t SP_LINK_BODY[8] = {{{', '.join(map(str, links))}}};",
        f"static const int32_t SP_ROTOR_BODY[8] = {{{', '.join(map(str, rotors))}}};",
        "static const char *const SP_JOINT_NAMES[16] = {",
        *(f'    "{name}",' for name in JOINT_NAMES),
        "};",
        "static const char *const SP_GIMBAL_NAMES[16] = {",
        *(f'    "{name}",' for name in GIMBAL_NAMES),
        "};",
    ]
    return header("SPIDAR_MODEL", "the robot's kinematic tree, limits and names.", lines)


def _axis(model: object, joint: int) -> np.ndarray:
    """Axis of a revolute joint in its own frame."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    J = pin.computeJointJacobian(model, data, pin.neutral(model), joint)
    return np.round(J[3:, model.idx_vs[joint]], 12) + 0.0


def presets_header() -> str:
    """spidar_presets.h: the presets, with the iteration cap that a tick on the robot has time for."""
    lines: list[str] = []
    for kind, presets in (("controller", PRESETS), ("crawler", CRAWL_PRESETS)):
        for name, config in presets.items():
            capped = replace(config, allocator=replace(config.allocator, max_iter=ONBOARD_ITERATIONS))
            lines += [f"static const sp_{kind}_config SP_PRESET_{name.upper()} = {initializer(capped)};", ""]
        table = " ".join(f"X({name}, SP_PRESET_{name.upper()})" for name in presets)
        lines += [f"#define SP_{kind.upper()}_PRESETS(X) {table}",
                  f'#define SP_{kind.upper()}_NAMES "{", ".join(presets)}"', ""]  # fmt: skip
    lines.append(f"static const sp_estimator_config SP_ESTIMATOR = {initializer(EstimatorConfig())};")
    return header("SPIDAR_PRESETS", "the presets, the very numbers of the simulator.", lines, ('"spidar_structs.h"',))
