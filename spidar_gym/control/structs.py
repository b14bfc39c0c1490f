"""Dataclasses → C structs, and numpy types of the same layout: what crosses the border is written down once."""

import dataclasses
import hashlib
import re
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from spidar_gym.control.allocator import AllocatorConfig
from spidar_gym.control.centroidal import CentroidalConfig
from spidar_gym.control.compensation import CompensationConfig
from spidar_gym.control.controller import ControllerConfig
from spidar_gym.control.crawler import CrawlerConfig
from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.footsteps import STRIDES, GaitConfig
from spidar_gym.control.layout import CORE
from spidar_gym.control.modes import ALLOCATIONS
from spidar_gym.description import mjcf_path
from spidar_gym.model.interference import InterferenceConfig
from spidar_gym.model.rotor import LockConfig
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, field_docs
from spidar_gym.state import Command, Measurement, Reference, Residual, RobotState

POSE_FRAMES, IMU_SAMPLES = 4, 8
"""Rows of a measurement."""
WORDS: dict[tuple[str, str], tuple[str, ...]] = {
    ("reference", "mode"): ("flight", "flight_unrestricted"),
    ("controller_config", "allocation"): tuple(ALLOCATIONS),
    ("gait_config", "stride"): STRIDES,
}
"""Fields that are words in Python and numbers in C: the valid ones in order."""
OPTIONAL = {("residual", "forces_l"): (N_ROTORS, 3), ("residual", "leg_forces_b"): (N_LEGS, 3)}
"""Arrays that may be missing, with their shapes: in C a flag `has_…` goes before them."""


def samples() -> list[Any]:
    """An instance of every dataclass that becomes a struct, those inside others first."""
    zero, quat, q = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(N_JOINTS)
    angles, eight = np.zeros((N_ROTORS, 2)), np.zeros(N_ROTORS)
    return [
        RobotState(0.0, zero, quat, zero, zero, q, q, angles, angles, eight, q),
        Measurement(
            0.0, 0, np.zeros(POSE_FRAMES), np.zeros((POSE_FRAMES, 3)), np.zeros((POSE_FRAMES, 4)), 0,
            np.zeros(IMU_SAMPLES), np.zeros((IMU_SAMPLES, 3)), np.zeros((IMU_SAMPLES, 3)), 0.0, q, q, angles,
        ),
        Reference(zero, quat, zero, zero, q),
        Residual(),
        Command(eight, angles, q, q),
        CentroidalConfig(), CompensationConfig(), AllocatorConfig(), InterferenceConfig(), LockConfig(),
        ControllerConfig(), GaitConfig(), CrawlerConfig(), EstimatorConfig(),
    ]  # fmt: skip


def snake(name: str) -> str:
    """RobotState → robot_state."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


@dataclasses.dataclass(frozen=True)
class Member:
    """One field of a struct."""

    name: str
    """As in Python."""
    kind: str
    """`f8`, `i4`, or the name of another struct."""
    shape: tuple[int, ...]
    """() for a number."""
    doc: str
    """From the dataclass."""


def members(sample: Any) -> list[Member]:  # noqa: ANN401 - any of the dataclasses
    """Fields of a struct, in the dataclass's order."""
    struct = snake(type(sample).__name__)
    docs = field_docs(type(sample))
    found: list[Member] = []
    for field in dataclasses.fields(sample):
        value, doc = getattr(sample, field.name), docs.get(field.name, "")
        if (struct, field.name) in OPTIONAL:
            found.append(Member(f"has_{field.name}", "i4", (), "Whether the next field counts."))
            found.append(Member(field.name, "f8", OPTIONAL[struct, field.name], doc))
        elif dataclasses.is_dataclass(value):
            found.append(Member(field.name, snake(type(value).__name__), (), doc))
        elif isinstance(value, bool | int | str):
            found.append(Member(field.name, "i4", (), doc))
        else:
            array = np.asarray(value)
            found.append(Member(field.name, "i4" if array.dtype == bool else "f8", array.shape, doc))
    return found


def fill(record: Any, value: Any) -> None:  # noqa: ANN401 - a numpy record and a dataclass
    """Write a dataclass into a numpy record of its struct."""
    struct = snake(type(value).__name__)
    for field in dataclasses.fields(value):
        own = getattr(value, field.name)
        if (struct, field.name) in OPTIONAL:
            record[f"has_{field.name}"] = own is not None
            record[field.name][...] = 0.0 if own is None else np.reshape(own, -1)
        elif dataclasses.is_dataclass(own):
            fill(record[field.name], own)
        elif isinstance(own, str):
            record[field.name] = WORDS[struct, field.name].index(own)
        else:
            # In the core arrays are flat.
            record[field.name] = np.reshape(own, -1) if np.ndim(own) else own


def structs_header() -> str:
    """spidar_structs.h."""
    lines = [
        "/* Generated from the Python dataclasses: what crosses the border, and configurations. */",
        "#ifndef SPIDAR_STRUCTS_H",
        "#define SPIDAR_STRUCTS_H",
        "",
        "#include <stdint.h>",
        "",
    ]
    for (struct, name), words in WORDS.items():
        items = ", ".join(f"SP_{struct}_{name}_{word}".upper() + f" = {k}" for k, word in enumerate(words))
        lines += [f"enum {{ {items} }};", ""]
    types: Mapping[str, str] = {"f8": "double", "i4": "int32_t"}
    for sample in samples():
        name, doc = snake(type(sample).__name__), (type(sample).__doc__ or "").splitlines()[0]
        lines += [f"/* {doc} */", "typedef struct {"]
        for member in members(sample):
            kind = types.get(member.kind, f"sp_{member.kind}")
            size = f"[{int(np.prod(member.shape))}]" if member.shape else ""
            shape = f"{member.shape} " if len(member.shape) > 1 else ""
            lines.append(f"    {kind} {member.name}{size}; /* {shape}{_plain(member.doc)} */")
        lines += [f"}} sp_{name};", ""]
    return "\n".join([*lines, "#endif", ""])


def _plain(doc: str) -> str:
    return doc.replace("*/", "* /")


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
            array = np.asarray(own, float)
            numbers = ", ".join(hex_float(x) for x in array.reshape(-1).tolist())
            text = f"{{{numbers}}}" if array.shape else numbers
        parts.append(f"{pad}.{field.name} = {text}")
    return "{\n" + ",\n".join(parts) + "\n" + "    " * (indent - 1) + "}"


@cache
def interface_hash() -> str:
    """Digest of everything that a compiled core has to agree on: structs, robot, sources."""
    digest = hashlib.sha256(structs_header().encode() + mjcf_path().read_bytes())
    for file in sorted(CORE.glob("*.[ch]")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:32]


def hex_float(x: float) -> str:
    """A double as C reads it back bit for bit."""
    if np.isinf(x):
        return "HUGE_VAL" if x > 0.0 else "-HUGE_VAL"
    return float(x).hex()
