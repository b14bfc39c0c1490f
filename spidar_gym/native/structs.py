"""Structs that Python and the onboard core share, written down once: dataclasses, or tables of members."""

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
from spidar_gym.control.crawl.footsteps import STRIDES, GaitConfig
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.centroidal import CentroidalConfig, MotionError
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.model.interference import InterferenceConfig, no_interference
from spidar_gym.model.rotor import Lock, LockConfig
from spidar_gym.native.constants import ENUMERATIONS, snake
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, RobotSpec, field_docs, source_doc
from spidar_gym.sim.disturbances import FAULTS
from spidar_gym.state import IMU_SAMPLES, POSE_FRAMES, Command, Measurement, Reference, Residual, RobotState

T = TypeVar("T")

WORDS: dict[tuple[str, str], tuple[str, ...]] = {
    ("reference", "mode"): ("flight", "flight_unrestricted"),
    ("controller_config", "allocation"): tuple(ALLOCATIONS),
    ("gait_config", "stride"): STRIDES,
    ("disturbances", "fault"): FAULTS,
}
"""Fields that are words in Python and numbers in C: the valid ones in order."""
Bounds = tuple[int | float, int | float]
"""The least and the largest value of a member that the library works with."""
FLAG: Bounds = (0, 1)
"""Yes or no."""
CODE: Bounds = (-1, 2**30)
"""A word by number, −1 for none; how many words there are is known elsewhere."""
COUNT: Bounds = (0, 2**30)
"""Ticks and the like: far from where a sum of two leaves its kind."""
ANY: Bounds = (-(2**63), 2**64 - 1)
"""Whatever its kind holds."""
USUAL: Bounds = (-1e15, 1e15)
"""A number with a fraction for which nothing else is said: neither NaN nor infinite, and its cube is a number."""
INFINITE: Bounds = (-math.inf, math.inf)
"""A number that may be infinite."""
SINCE: Bounds = (0.0, 1e15)
"""A time or an amount that is never negative."""
WHOLE: dict[tuple[str, str], Bounds] = {
    ("measurement", "pose_count"): (0, POSE_FRAMES),
    ("measurement", "imu_count"): (0, IMU_SAMPLES),
    ("interference", "side"): (-1, 1),
    ("compensation_config", "observer_order"): (1, 2),
    ("allocator_config", "max_iter"): COUNT,
    ("plant_config", "substeps"): COUNT,
    ("disturbances", "lost_rotor"): (0, N_ROTORS),
}
"""Bounds of whole numbers that are neither flags nor words, by struct and field."""
FRACTIONS: dict[tuple[str, str], Bounds] = {
    ("robot_state", "time"): SINCE,
    ("interference", "lower"): INFINITE,
    ("interference", "upper"): INFINITE,
    ("demand", "lower"): INFINITE,
    ("demand", "upper"): INFINITE,
}
"""Bounds of numbers with a fraction that are others than `USUAL`."""
OPTIONAL = {("residual", "forces_l"): (N_ROTORS, 3), ("residual", "leg_forces_b"): (N_LEGS, 3)}
"""Arrays that may be missing, with their shapes: in C a flag `has_…` goes before them."""


def samples() -> list[Any]:
    """An instance of every dataclass that becomes a struct, those inside others first."""
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
        Pose2(), Lock(mask, mask, eight), no_interference(), MotionError(zero, zero, zero, zero),
        Demand(np.zeros(6), *maps, q, mask, eight, mask, eight, eight),
        CentroidalConfig(), CompensationConfig(), AllocatorConfig(), InterferenceConfig(), LockConfig(),
        ControllerConfig(), GaitConfig(), CrawlerConfig(), EstimatorConfig(), ManagerConfig(),
    ]  # fmt: skip


Row = (
    tuple[str, str, tuple[int, ...], str]
    | tuple[str, str, tuple[int, ...], str, Bounds | str | tuple[Bounds | str, ...]]
)
"""Members of a struct that are alike: names, apart by blanks; kind; shape, () for a number; comment; bounds.

The kind is `f8`, `f4`, `i4`, `i8`, `u4`, `u8`, `u1`, an enumeration, or a struct that came before. Bounds are those of
all of the row's members or of each, or the name of an enumeration; what a saved robot holds is held to them. Every
whole number that is saved has some; an enumeration has its own, and a fraction without any is `USUAL`.
"""


@dataclasses.dataclass(frozen=True, slots=True)
class CStruct:
    """One struct: its C text and its numpy type come from here."""

    name: str
    """Without `sp_`."""
    doc: str
    """What it is."""
    rows: Sequence[Row]
    """Its members, in order."""


@cache
def border_structs() -> tuple[CStruct, ...]:
    """Structs of the dataclasses that cross the border, in the core's order."""
    return tuple(map(struct_of, samples()))


def struct_of(sample: Any) -> CStruct:  # noqa: ANN401 - any of the dataclasses
    """The struct of a dataclass, from an instance of it."""
    return CStruct(snake(type(sample).__name__), source_doc(type(sample)).partition("\n")[0], _rows(sample))


def _rows(sample: Any) -> list[Row]:  # noqa: ANN401 - any of the dataclasses
    """Fields of a dataclass in its order; in the core arrays are flat."""
    struct, docs = snake(type(sample).__name__), field_docs(type(sample))
    rows: list[Row] = []
    for field in dataclasses.fields(sample):
        value, doc = getattr(sample, field.name), docs.get(field.name, "")
        if isinstance(value, RobotSpec):
            continue  # in C a robot is `sp_robot`
        kind, shape, at = "i4", (), (struct, field.name)
        if at in OPTIONAL:
            rows.append((f"has_{field.name}", "i4", (), "Whether the next field counts.", FLAG))
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
    """Numpy types by name, laid out as a C compiler does.

    Args:
        structs: Those inside others first.
        known: Types of structs that came before.
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
    """The struct that a dataclass becomes, and the names of its fields."""
    return snake(kind.__name__), tuple(field.name for field in dataclasses.fields(kind))


def read(kind: type[T], record: Any) -> T:  # noqa: ANN401 - a numpy record
    """The dataclass that a record of its struct stands for, its arrays its own; the inverse of `fill`.

    Whose it is stays the default: a record knows no `RobotSpec`.
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
