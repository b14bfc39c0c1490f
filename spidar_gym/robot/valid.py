"""Reading and validation of a robot's parameters from user input; errors are one line that names valid values."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, read_toml
from spidar_gym.errors import InvalidValueError, SpidarError, is_finite, require_instance, require_keys, require_name
from spidar_gym.robot.payload import Payload, numbers
from spidar_gym.robot.ranges import INERTIAS, LENGTHS, MASSES, OTHERS, PLACES

MOST_BYTES = 2**16
"""Largest size of a robot file [byte]."""
LIFTED = 0.8
"""Largest allowed weight as a share of the rotors' maximum thrust; the rest is for control."""
KIND = {"legs": 4, "links": 8, "rotors": 8, "joints": 16}
"""Counts that every robot has."""
NOT_NEGATIVE = (
    "idle_thrust",
    "joint_armature",
    "joint_damping",
    "joint_friction",
    "vectoring_armature",
    "vectoring_kd",
)
ANY_SIGN = ("yaw_axis_z", "peg_top")
MECHANICAL = (
    *NOT_NEGATIVE, "max_thrust", "thrust_lag", "max_vectoring_torque", "max_vectoring_speed", "vectoring_kp",
    "max_joint_torque", "joint_speed", "joint_limit", "joint_stop", "joint_kp", "joint_kd", "foot_friction",
    "peg_friction",
)  # fmt: skip
"""Fields that are neither lengths nor masses."""


def own_masses(given: object, parts: Mapping[str, Any]) -> tuple[tuple[str, float], ...]:
    """Validate masses by part and return sorted pairs (`UnknownNameError` for a part that does not exist)."""
    pairs = given.items() if isinstance(given, Mapping) else given
    if not (isinstance(pairs, Sequence) or isinstance(given, Mapping)):
        raise InvalidValueError("part_masses", given, "masses [kg] by part")
    try:
        masses = {name: mass for name, mass in pairs}  # pyright: ignore[reportGeneralTypeIssues]
    except (TypeError, ValueError):
        raise InvalidValueError("part_masses", given, "masses [kg] by part") from None
    for name, mass in masses.items():
        require_name("part", name, parts)
        if not (is_finite(mass) and mass > 0.0):
            raise InvalidValueError(f"part_masses: {name}", mass, "a number above 0 [kg]")
        MASSES.require(f"part_masses: {name}", mass)
    return tuple((name, float(masses[name])) for name in sorted(masses))


def read_spec(given: object, described: Mapping[str, Any], parts: Mapping[str, Any]) -> dict[str, Any]:
    """Read the arguments of a `RobotSpec` from a mapping or a TOML file.

    Args:
        given: A mapping, or the path of a TOML file; of the file of an identified robot its table `robot` is read.
        described: Default values by field.
        parts: Parts whose masses may be set.
    """
    if isinstance(given, str | Path):
        given = _read(Path(given))
        given = given["robot"] if isinstance(given.get("robot"), Mapping) and "row" in given else given
    for name, count in KIND.items():
        for key in (name, f"n_{name}"):
            if isinstance(given, Mapping) and key in given:
                raise InvalidValueError(key, given[key], f"no such entry: every robot has {count} {name}")
    found = dict(require_keys("robot", "number of the robot", given, list(described)))
    return {name: _value(name, value, described[name], parts) for name, value in found.items()}


def _value(name: str, given: object, default: object, parts: Mapping[str, Any]) -> Any:  # noqa: ANN401 - of any field
    """Convert a field's value to the type of the field."""
    if name == "part_masses":
        return own_masses(given, parts)
    if name == "payloads":
        if not isinstance(given, list | tuple):
            raise InvalidValueError(name, given, "a list of tables with body, mass, position, size, inertia")
        return tuple(each if isinstance(each, Payload) else _payload(each) for each in given)
    if isinstance(default, tuple):
        return numbers(name, given, len(default))
    if not is_finite(given):
        raise InvalidValueError(name, given, "a finite number")
    return float(given)


def _payload(given: object) -> Payload:
    fields = tuple(Payload.__dataclass_fields__)
    found = dict(require_keys("payload", "number of a payload", given, fields))
    for name in ("body", "mass"):
        if name not in found:
            raise InvalidValueError("payload", found, f"{name} among {', '.join(fields)}")
    for name in ("position", "size", "inertia"):
        if isinstance(found.get(name), list):
            found[name] = numbers(f"payload: {name}", found[name], 6 if name == "inertia" else 3)
    return Payload(**found)


def _read(path: Path) -> Mapping[str, Any]:
    try:
        return read_toml(path, MOST_BYTES)
    except BorderError as error:
        raise SpidarError(
            f"robot: {path} cannot be read: {error}; valid: a TOML file with numbers of RobotSpec by name, as "
            "pitch_to_foot = 0.6138"
        ) from error


def check(spec: Any, described: Mapping[str, Any]) -> None:  # noqa: ANN401 - a RobotSpec, whose module imports this one
    """Raise `InvalidValueError` for invalid values, or for a robot that cannot hover, lie and stand.

    Args:
        spec: A `RobotSpec`.
        described: Default values by field.
    """
    for name, default in described.items():
        value = getattr(spec, name)
        if name == "part_masses":
            continue
        if name == "payloads":
            for each in value if isinstance(value, tuple) else (value,):
                require_instance(Payload, payloads=each)
        elif isinstance(default, tuple):
            object.__setattr__(spec, name, numbers(name, value, len(default)))
        elif not is_finite(value):
            raise InvalidValueError(name, value, "a finite number")
        elif name in NOT_NEGATIVE:
            _demand(value >= 0.0, name, value, "a number of at least 0")
        elif name not in ANY_SIGN:
            _demand(value > 0.0, name, value, "a number above 0")
        _check_range(name, getattr(spec, name))
    _demand(min(spec.battery_size) > 0.0, "battery_size", spec.battery_size, "three edges above 0 [m]")
    LENGTHS.require("battery_size", *spec.battery_size)
    _check_places(spec)
    _check_limits(spec)
    for kind, body in spec.bodies.items():
        INERTIAS.require(f"a principal moment of inertia of the {kind}", *np.linalg.eigvalsh(body.matrix).tolist())


def _check_range(name: str, value: Any) -> None:  # noqa: ANN401 - of any field
    """Raise `InvalidValueError` for a number outside the range that is simulated accurately."""
    if name == "described_mass":
        MASSES.require(name, value)
    elif name in MECHANICAL:
        OTHERS.require(name, value)
    elif isinstance(value, tuple):
        if name != "payloads":
            PLACES.require(name, *value)
    else:
        (PLACES if name in ANY_SIGN else LENGTHS).require(name, value)


def _demand(holds: bool, name: str, value: object, expected: str) -> None:
    if not holds:
        raise InvalidValueError(name, value, expected)


def _check_places(spec: Any) -> None:  # noqa: ANN401 - a RobotSpec
    """Check that rotors are within their links, ducts do not overlap, and feet reach the floor."""
    shortest = min(spec.pitch_to_yaw, spec.pitch_to_foot)
    _demand(
        spec.roll_axis_x < shortest, "roll_axis_x", spec.roll_axis_x,
        f"a place on both links: below {shortest:g} m, the shorter one's length",
    )  # fmt: skip
    _demand(
        spec.propeller_radius <= spec.duct_radius, "propeller_radius", spec.propeller_radius,
        f"at most the duct's {spec.duct_radius:g} m",
    )  # fmt: skip
    _demand(
        spec.duct_offset_y >= spec.duct_radius, "duct_offset_y", spec.duct_offset_y,
        f"at least {spec.duct_radius:g} m, or the two ducts of a module overlap",
    )  # fmt: skip
    _demand(spec.duct_z[0] < spec.duct_z[1], "duct_z", spec.duct_z, "the lower end before the upper one")
    for name, length in (("inner_battery", spec.pitch_to_yaw), ("outer_battery", spec.pitch_to_foot)):
        place = getattr(spec, name)
        _demand(0.0 <= place[0] <= length, name, place, f"a place on its link: x within 0 … {length:g} m")
    _demand(
        spec.peg_depth > 0.5 * spec.torso_height, "peg_length", spec.peg_length,
        f"above {0.5 * spec.torso_height + spec.peg_top + spec.yaw_axis_z:g} m, so that pegs reach below the torso",
    )  # fmt: skip
    # The torso lies on its pegs, the inner links are level, and the outer links are bent down as far as possible.
    least = (spec.peg_depth + spec.yaw_axis_z - spec.foot_radius) / math.sin(min(spec.joint_limit, math.pi / 2))
    _demand(
        spec.pitch_to_foot > least, "pitch_to_foot", spec.pitch_to_foot,
        f"above {least:.4g} m, or the feet do not reach the floor on which the pegs of the torso lie",
    )  # fmt: skip


def _check_limits(spec: Any) -> None:  # noqa: ANN401 - a RobotSpec
    """Check that joint limits are within the stops, and that the rotors can lift the robot."""
    _demand(
        spec.joint_limit <= math.pi / 2 + 1e-12, "joint_limit", spec.joint_limit,
        "at most π/2: the gait, the forms and the runner's messages assume joints of ± 90°",
    )  # fmt: skip
    _demand(
        spec.joint_limit <= spec.joint_stop < math.pi, "joint_stop", spec.joint_stop,
        f"within joint_limit … π, {spec.joint_limit:g} … 3.14159 rad",
    )  # fmt: skip
    most = LIFTED * KIND["rotors"] * spec.max_thrust
    _demand(
        spec.weight <= most, "max_thrust", spec.max_thrust,
        f"at least {spec.weight / (LIFTED * KIND['rotors']):.4g} N: a robot of {spec.total_mass:.4g} kg weighs "
        f"{spec.weight:.4g} N, which may be at most {LIFTED:g} of its rotors' thrust",
    )  # fmt: skip
    _demand(
        spec.idle_thrust < spec.hover_thrust, "idle_thrust", spec.idle_thrust,
        f"below the {spec.hover_thrust:.4g} N of a module in a hover",
    )  # fmt: skip
