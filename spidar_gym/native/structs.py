"""Structs that Python and the onboard core share, each defined once: by a dataclass, or a table of members."""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.control.allocation.modes import ALLOCATIONS
from spidar_gym.control.allocation.problem import N_UNKNOWNS, Demand
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import MOST_CORRECTIONS, STRIDES, GaitConfig
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.centroidal import CentroidalConfig, MotionError
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.motion import MOTIONS
from spidar_gym.control.grasp.claw import Contact
from spidar_gym.control.grasp.grip import Grip
from spidar_gym.control.grasp.phases import GRASP_PHASES, GraspConfig, GraspMemory, Seen, Setting
from spidar_gym.control.grasp.rule import RuleMemory
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.control.locomotion.commands import OBJECTS
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.model.interference import Disc, InterferenceConfig, no_interference
from spidar_gym.model.rotor import Lock, LockConfig
from spidar_gym.native.constants import ENUMERATIONS, snake
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, RobotSpec, field_docs, source_doc
from spidar_gym.sim.disturbances import FAULTS
from spidar_gym.sim.object import SHAPES
from spidar_gym.state import IMU_SAMPLES, POSE_FRAMES, Command, Measurement, Reference, Residual, RobotState

T = TypeVar("T")

WORDS: dict[tuple[str, str], tuple[str, ...]] = {
    ("reference", "mode"): ("flight", "flight_unrestricted"),
    ("controller_config", "allocation"): tuple(ALLOCATIONS),
    ("controller_config", "motion"): MOTIONS,
    ("gait_config", "stride"): STRIDES,
    ("disturbances", "fault"): FAULTS,
    ("object_config", "shape"): SHAPES,
    ("grasp_memory", "phase"): GRASP_PHASES,
    ("grasp_scene", "shape"): OBJECTS,
}
"""Fields that are words in Python and numbers in C, with the valid words in order."""
Bounds = tuple[int | float, int | float]
"""Least and largest valid value of a member."""
FLAG: Bounds = (0, 1)
"""Bounds of a flag."""
CODE: Bounds = (-1, 2**30)
"""Bounds of a word's number, −1 for none; the number of words is not checked here."""
COUNT: Bounds = (0, 2**30)
"""Bounds of counts such as ticks; the sum of two does not overflow."""
ANY: Bounds = (-(2**63), 2**64 - 1)
"""Bounds that admit every value of the kind."""
USUAL: Bounds = (-1e15, 1e15)
"""Default bounds of a floating-point number: neither NaN nor infinite, and its cube is finite."""
INFINITE: Bounds = (-math.inf, math.inf)
"""Bounds of a number that may be infinite."""
SINCE: Bounds = (0.0, 1e15)
"""Bounds of a time or an amount that is never negative."""
LIMIT: Bounds = (0.0, math.inf)
"""Bounds of a limit that may be infinite."""
WHOLE: dict[tuple[str, str], Bounds] = {
    ("measurement", "pose_count"): (0, POSE_FRAMES),
    ("measurement", "imu_count"): (0, IMU_SAMPLES),
    ("interference", "side"): (-1, 1),
    ("compensation_config", "observer_order"): (1, 2),
    ("gait_config", "corrections"): (0, MOST_CORRECTIONS),
    ("allocator_config", "max_iter"): COUNT,
    ("plant_config", "substeps"): COUNT,
    ("disturbances", "lost_rotor"): (0, N_ROTORS),
    ("grasp_memory", "tests"): COUNT,
    ("rule_memory", "tries"): COUNT,
    ("grasp_memory", "count"): COUNT,
    ("grasp_config", "most_tests"): COUNT,
}
"""Bounds of integers that are neither flags nor words, by struct and field."""
FRACTIONS: dict[tuple[str, str], Bounds] = {
    ("robot_state", "time"): SINCE,
    ("actuator_config", "battery_spent"): (0.0, 1.0),
    ("actuator_config", "jitter"): SINCE,
    ("actuator_config", "loss"): (0.0, 1.0),
    ("interference", "lower"): INFINITE,
    ("interference", "upper"): INFINITE,
    ("demand", "lower"): INFINITE,
    ("demand", "upper"): INFINITE,
    ("demand", "thrust_limit"): LIMIT,
}
"""Bounds of floating-point numbers that differ from `USUAL`."""
OPTIONAL = {("residual", "forces_l"): (N_ROTORS, 3), ("residual", "leg_forces_b"): (N_LEGS, 3)}
"""Arrays that may be missing, with their shapes; in C a flag `has_…` precedes each of them."""


def samples() -> list[Any]:
    """Return an instance of every dataclass that becomes a struct, nested ones first."""
    zero, quat, q = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(N_JOINTS)
    angles, eight, mask = np.zeros((N_ROTORS, 2)), np.zeros(N_ROTORS), np.zeros(N_ROTORS, bool)
    maps = np.zeros((6, N_UNKNOWNS)), np.zeros((N_JOINTS, N_UNKNOWNS))
    return [
        RobotState(0.0, zero, quat, zero, zero, q, q, angles, angles, eight, q),
        Measurement(
            0.0, 0, np.zeros(POSE_FRAMES), np.zeros((POSE_FRAMES, 3)), np.zeros((POSE_FRAMES, 4)), 0,
            np.zeros(IMU_SAMPLES), np.zeros((IMU_SAMPLES, 3)), np.zeros((IMU_SAMPLES, 3)), 0.0, q, q, angles,
        ),
        Reference(zero, quat, zero, zero, q),
        Residual(),
        Command(eight, angles, q, q),
        Grip(zero, 0.0, 0.0), Disc(zero, 0.0),
        Pose2(), Lock(mask, mask, eight), no_interference(), MotionError(zero, zero, zero, zero),
        Demand(np.zeros(6), *maps, q, mask, eight, mask, eight, eight),
        CentroidalConfig(), CompensationConfig(), AllocatorConfig(), InterferenceConfig(), LockConfig(),
        ControllerConfig(), GaitConfig(), CrawlerConfig(), EstimatorConfig(),
        GraspConfig(), Seen(zero, quat), Setting(), GraspMemory(), Contact(q, q, q, 0.0, 0.0), GraspScene(),
        RuleMemory(), ManagerConfig(),
    ]  # fmt: skip


Row = (
    tuple[str, str, tuple[int, ...], str]
    | tuple[str, str, tuple[int, ...], str, Bounds | str | tuple[Bounds | str, ...]]
)
"""Similar members of a struct: names separated by blanks; kind; shape, () for a number; comment; bounds.

The kind is `f8`, `f4`, `i4`, `i8`, `u4`, `u8`, `u1`, an enumeration, or an earlier struct. Bounds apply to all members
of the row or are given for each; the name of an enumeration stands for its bounds. Saved robots are checked against
them. Every saved integer needs bounds. An enumeration has its own, and a floating-point number without any has `USUAL`.
"""


@dataclasses.dataclass(frozen=True, slots=True)
class CStruct:
    """One struct, from which its C text and its numpy type are generated."""

    name: str
    """Name without `sp_`."""
    doc: str
    """Description of the struct."""
    rows: Sequence[Row]
    """Its members, in order."""


@cache
def border_structs() -> tuple[CStruct, ...]:
    """Return the structs of the dataclasses that Python and C exchange, in the core's order."""
    return tuple(map(struct_of, samples()))


def struct_of(sample: Any) -> CStruct:  # noqa: ANN401 - any of the dataclasses
    """Return the struct of a dataclass, from an instance of it."""
    return CStruct(snake(type(sample).__name__), source_doc(type(sample)).partition("\n")[0], _rows(sample))


def _rows(sample: Any) -> list[Row]:  # noqa: ANN401 - any of the dataclasses
    """Return the fields of a dataclass in order; in the core arrays are flat."""
    struct, docs = snake(type(sample).__name__), field_docs(type(sample))
    rows: list[Row] = []
    for field in dataclasses.fields(sample):
        value, doc = getattr(sample, field.name), docs.get(field.name, "")
        if isinstance(value, RobotSpec):
            continue  # in C a robot is `sp_robot`
        kind, shape, at = "i4", (), (struct, field.name)
        if at in OPTIONAL:
            rows.append((f"has_{field.name}", "i4", (), "Whether the next field is valid.", FLAG))
            kind, shape = "f8", OPTIONAL[at]
        elif dataclasses.is_dataclass(value):
            kind = snake(type(value).__name__)
        elif not isinstance(value, bool | int | str):
            array = np.asarray(value)
            kind, shape = "f8" if array.dtype == float else "i4", array.shape
        flat = (int(np.prod(shape)),) if shape else ()
        row = field.name, kind, flat, f"{shape} {doc}" if len(shape) > 1 else doc
        bounds = (0, len(WORDS[at]) - 1) if at in WORDS else {**WHOLE, **FRACTIONS}.get(at)
        if np.asarray(value).dtype == bool:
            bounds = FLAG
        rows.append(row if bounds is None else (*row, bounds))
    return rows


def dtypes(structs: Iterable[CStruct], known: Mapping[str, np.dtype] | None = None) -> dict[str, np.dtype]:
    """Return numpy types by name, laid out as by a C compiler.

    Args:
        structs: Structs, nested ones first.
        known: Types of earlier structs.
    """
    types = dict(known or {})
    for struct in structs:
        members = [
            (name, types.get(kind) or np.dtype("i4" if kind in ENUMERATIONS else kind), shape)
            for names, kind, shape, *_ in struct.rows
            for name in names.split()
        ]
        types[struct.name] = np.dtype(members, align=True)
    return types


def fill(record: Any, value: Any) -> None:  # noqa: ANN401 - a numpy record and a dataclass
    """Write a dataclass into a numpy record of its struct."""
    struct, names = _members(type(value))
    for name in names:
        own = getattr(value, name)
        if type(own) is np.ndarray and own.ndim and (struct, name) not in OPTIONAL:
            record[name] = own.reshape(-1)  # in the core arrays are flat
        elif isinstance(own, RobotSpec):
            continue
        elif (struct, name) in OPTIONAL:
            record[f"has_{name}"] = own is not None
            record[name][...] = 0.0 if own is None else np.reshape(own, -1)
        elif dataclasses.is_dataclass(own):
            fill(record[name], own)
        elif isinstance(own, str):
            record[name] = WORDS[struct, name].index(own)
        else:
            record[name] = np.reshape(own, -1) if np.ndim(own) else own


@cache
def _members(kind: type) -> tuple[str, tuple[str, ...]]:
    """Return the name of a dataclass's struct, and the names of its fields."""
    return snake(kind.__name__), tuple(field.name for field in dataclasses.fields(kind))


def read(kind: type[T], record: Any) -> T:  # noqa: ANN401 - a numpy record
    """Copy a record into the dataclass of its struct; the inverse of `fill`.

    A `RobotSpec` field keeps its default, as records do not contain it.
    """
    struct, sample, values = snake(kind.__name__), kind(), {}
    for field in dataclasses.fields(kind):  # pyright: ignore[reportArgumentType] - a dataclass, as every caller's
        own = getattr(sample, field.name)
        if isinstance(own, RobotSpec):
            continue
        if dataclasses.is_dataclass(own):
            values[field.name] = read(type(own), record[field.name])
        elif isinstance(own, str):
            values[field.name] = WORDS[struct, field.name][int(record[field.name])]
        elif np.ndim(own):
            values[field.name] = np.array(record[field.name], np.asarray(own).dtype).reshape(np.shape(own))
        else:
            values[field.name] = type(own)(record[field.name])
    return kind(**values)
