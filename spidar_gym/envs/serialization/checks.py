"""Validation of saved values before they become attributes of an environment and its parts.

Attributes of this package's classes have types by class and name. Fields of its dataclasses have the types of their
annotations, and `__post_init__` checks them again. Additional attributes of custom laws and environments are not
checked.
"""

import copy
import typing
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from inspect import getattr_static
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np
from jaxtyping import Float

from spidar_gym.arrays import FootForces, JointVector, Vector3
from spidar_gym.control.allocation.allocator import Allocator, AllocatorConfig
from spidar_gym.control.course.gates import Course
from spidar_gym.control.course.pilot import Pilot
from spidar_gym.control.course.target import Target
from spidar_gym.control.crawl.controller import Crawler, CrawlerConfig
from spidar_gym.control.crawl.footsteps import GaitConfig
from spidar_gym.control.crawl.gait import Gait
from spidar_gym.control.crawl.memory import CrawlMemory, CrawlRecord
from spidar_gym.control.crawl.phases import CYCLE, LIFT, PHASES, STAND, GaitMemory
from spidar_gym.control.estimator import Estimator, EstimatorConfig, EstimatorMemory
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.control.flight.memory import ControlState, FlightMemory, FlightRecord
from spidar_gym.control.flight.path import Path
from spidar_gym.control.grasp.claw import Contact
from spidar_gym.control.grasp.grip import Grip
from spidar_gym.control.grasp.phases import GRASP_PHASES, Grasper, GraspMemory, Seen
from spidar_gym.control.grasp.rule import RuleMemory
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.control.locomotion import orders
from spidar_gym.control.locomotion.commands import Grasp, LocomotionCommand
from spidar_gym.control.locomotion.manager import Manager, ManagerMemory
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.envs.commander import CourseCommander, CrawlCommander, FlightCommander, GraspCommander
from spidar_gym.robot import N_LEGS
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.state import Command, Reference, RobotState
from spidar_gym.tasks.start import FlightStart

MOST = 2**53
"""Limit of the magnitude of integers."""
_COMMANDER = {"seen": RobotState | None, "command": Command | None}
_COMMON = {"dt": float, "_torque_limit": JointVector}
KEPT: dict[type, dict[str, Any]] = {
    FlightController: _COMMON
    | {"config": ControllerConfig, "memory": FlightMemory, "last_step": FlightRecord | None},
    Crawler: _COMMON | {"config": CrawlerConfig, "memory": CrawlMemory, "last_step": CrawlRecord | None},
    Gait: {"config": GaitConfig, "joint_speed": float, "dt": float, "home_b": FootForces, "memory": GaitMemory},
    Allocator: {"config": AllocatorConfig},
    Estimator: {
        "config": EstimatorConfig, "_bandwidth": Float[np.ndarray, "32"], "_lever_b": Vector3,
        "memory": EstimatorMemory,
    },
    Manager: {
        "config": ManagerConfig, "dt": float, "memory": ManagerMemory, "commands": list[LocomotionCommand],
        "path": Path | None, "lying": JointVector, "grip": Grip, "_seen": Seen | None, "_lying_height": float,
    },
    Grasper: {"memory": GraspMemory, "target": Grasp | None, "plan": Contact | None},
    Pilot: {"last": Target | None},
    FlightCommander: _COMMANDER | {
        "control_state": ControlState | None, "truth": ControlState | None, "_joint_velocity": JointVector,
        "_leg_momentum": Vector3, "_leg_momentum_rate": Vector3, "_reference": tuple[bytes, Reference] | None,
    },
    CrawlCommander: _COMMANDER,
    CourseCommander: _COMMANDER,
    GraspCommander: _COMMANDER | {"rule": RuleMemory, "_scene": GraspScene},
}  # fmt: skip
"""Types of the attributes of an environment's parts, by class."""
KEPT_BY_ENVIRONMENTS: dict[str, Any] = {
    "ticks": int, "sampled_parameters": dict[str, np.ndarray], "_began": bool,
    "_np_random": np.random.Generator | None, "_np_random_seed": int | None, "_choices": dict[str, Any],
    "_disturbances": Disturbances, "_start": FlightStart | None, "_given": Course | GraspScene | None,
}  # fmt: skip
"""Types of the attributes of environments besides their task."""


def fault_of(part: object, names: Collection[str], told: dict[str, Any], *, is_environment: bool) -> str:
    """Return why saved attributes do not fit an object, in words; empty if all fit.

    Args:
        part: An environment or a part of one.
        names: Names of its current attributes.
        told: Saved attributes by name.
        is_environment: Whether it is an environment.
    """
    kinds = KEPT_BY_ENVIRONMENTS if is_environment else _kinds(type(part))
    wrong = [name for name in told if not _is_attribute(part, name)] or [
        n for n in names if n in kinds and n not in told
    ]
    if wrong:
        return f"{wrong[0]!s:.40} missing, or not an attribute"
    for name, value in told.items():
        if not _fits(value, kinds.get(name, Any)):
            return f"{name} of another type"
        if fault := _fault_of_value(value, set()):
            return f"{name}: {fault}"
    return ""


def _is_attribute(part: object, name: object) -> bool:
    """Return whether an object may have an attribute of this name: no method or property is named so."""
    meaning = getattr_static(type(part), name, None) if isinstance(name, str) else None
    return isinstance(name, str) and name.isidentifier() and not (callable(meaning) or isinstance(meaning, property))


def _kinds(kind: type) -> dict[str, Any]:
    return next((names for each, names in KEPT.items() if issubclass(kind, each)), {})


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Return the annotations of a dataclass's fields; none if they cannot be resolved."""
    try:
        return typing.get_type_hints(kind)
    except (NameError, TypeError):
        return {}


def _fits(value: Any, hint: Any) -> bool:  # noqa: ANN401 - any value; an annotation
    """Return whether a value matches an annotation; an annotation of an unknown form matches any value."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_fits(value, each) for each in arguments)
    if origin is Literal:
        return value in arguments
    if hint is float:
        return isinstance(value, float | int | np.floating | np.integer) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int | np.integer) and not isinstance(value, bool) and abs(int(value)) < MOST
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if hint is None:
        return value is None
    if origin is tuple and arguments and arguments[-1] is not ...:
        return isinstance(value, tuple) and len(value) == len(arguments) and all(map(_fits, value, arguments))
    if origin in (tuple, list, deque, set, frozenset, Sequence) and arguments:
        return isinstance(value, origin) and all(_fits(each, arguments[0]) for each in value)
    if origin in (dict, Mapping) and arguments:
        return isinstance(value, origin) and all(
            _fits(key, arguments[0]) and _fits(each, arguments[1]) for key, each in value.items()
        )
    kind = hint if origin is None else origin
    return hint is Any or not isinstance(kind, type) or isinstance(value, kind)


def _fault_of_value(value: Any, seen: set[int]) -> str:  # noqa: ANN401 - any value
    """Return why a value, or a value within it, does not match its class, in words; empty if all match."""
    if isinstance(value, str | int | float | np.ndarray | NoneType) or id(value) in seen:
        return ""
    seen.add(id(value))
    own = is_dataclass(value) and type(value).__module__.startswith("spidar_gym.")
    if is_dataclass(value):
        parts = [getattr(value, each.name) for each in fields(value)]
    else:
        parts = [*value.keys(), *value.values()] if isinstance(value, Mapping) else value
    if isinstance(parts, list | tuple | deque | set | frozenset):
        for each in parts:
            if fault := _fault_of_value(each, seen):
                return fault
    return _fault_of_ours(value) if own else ""


def _fault_of_ours(value: Any) -> str:  # noqa: ANN401 - a dataclass of this package
    kind, hints = type(value), _hints(type(value))
    for each in fields(value):
        own, hint = getattr(value, each.name), hints.get(each.name, Any)
        shaped = hint is np.ndarray and each.default_factory is not MISSING
        flat = hint is np.ndarray and not np.ndim(own)  # arrays here have at least one dimension
        if not _fits(own, hint) or flat or (shaped and own.shape != np.shape(each.default_factory())):  # pyright: ignore[reportCallIssue] - it is given
            return f"{kind.__name__} with {each.name} of another type"
    if hasattr(kind, "__post_init__"):
        copy.copy(value).__post_init__()
    if isinstance(value, GaitMemory) and not _is_in_a_phase(value):
        return "phase is not one of the current step's"
    if isinstance(value, ManagerMemory) and value.phase not in orders.PHASES:
        return "phase is not one of the manager's"
    if isinstance(value, GraspMemory) and value.phase not in GRASP_PHASES:
        return "phase is not one of a grasp's"
    return ""


def _is_in_a_phase(memory: GaitMemory) -> bool:
    """Return whether the phase of a gait is one of its current step."""
    steps, phase = memory.steps, memory.phase
    known = all(each.phases in (CYCLE, LIFT, STAND) and {*each.legs} <= {*range(N_LEGS)} for each in steps)
    runs = bool(steps) and 0 <= memory.index < len(steps[0].phases) and steps[0].phases[memory.index] == phase
    return known and (runs or phase == PHASES[0])
