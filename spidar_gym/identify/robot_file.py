"""The file of an identified robot: a calibrated world in which what was identified replaces what was chosen.

`Randomization.parse` and everything that takes a calibrated world read it as one: tracks, `spidar tune`, `spidar sitl`
and the margins of an export. `RobotSpec.parse` reads its table `robot`, what the controller is to know.
"""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spidar_gym.errors import require_name
from spidar_gym.identify.estimate import Estimate
from spidar_gym.identify.hovers import Hovers
from spidar_gym.identify.servos import Servos
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.worlds import FOLDER, world_names

BASE = "calibrated_1"
"""World whose other rows a file keeps: air, ground and whatever was not identified."""
MODEL_SHARE = 0.005
"""Least relative half-width of a range, for what the models leave out [chosen]."""


@dataclass(frozen=True)
class Identified:
    """What was identified of a robot."""

    mass: Estimate
    """Mass of the robot [kg]: of a scale, or as described."""
    servos: Servos | None
    """Joint servos and delay; None without a bench test."""
    hovers: Hovers | None
    """Modules and balance; None without a flight."""


def robot_text(found: Identified, robot: RobotSpec = ROBOT, base: str = BASE) -> str:
    """Return the file of an identified robot.

    Args:
        found: What was identified; numbers that the logs do not tell keep the base's ranges.
        robot: The described robot.
        base: Name of the calibrated world that is the base (`UnknownNameError` lists the valid ones).
    """
    require_name("world", base, world_names())
    content = tomllib.loads((FOLDER / f"{base}.toml").read_text(encoding="utf-8"))
    told = _Told()
    if found.mass.told:
        told.ranges["body.total_mass"] = _range(found.mass)
        told.robot["described_mass"] = robot.described_mass * float(found.mass.value) / robot.total_mass
    if found.servos is not None:
        told.add_servos(found.servos, robot, _middle(content, "actuators.jitter"))
    if found.hovers is not None:
        # Gains are those at this mass, whether it is known exactly or not.
        told.ranges.setdefault("body.total_mass", (float(found.mass.value), float(found.mass.value)))
        told.add_hovers(found.hovers)
    ranges = dict(told.ranges)
    rows = [_row(row["field"], ranges.pop(row["field"])) if row["field"] in ranges else row for row in content["row"]]
    rows += [_row(name, ends) for name, ends in ranges.items()]
    used = {name for row in rows for name in row["ranges"]}
    variants = content["variants"] if used & {*content["variants"]} else {"identified": "the identified robot"}
    content |= {
        "doc": f"An identified robot; the air, the ground and whatever was not identified are those of {base}.",
        "variants": variants, "row": rows,
    }  # fmt: skip
    return _toml(content, told.values, {name: _digits(value) for name, value in told.robot.items()})


@dataclass
class _Told:
    """Contents of a file that replace those of its base."""

    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    robot: dict[str, float] = field(default_factory=dict)

    def add_servos(self, servos: Servos, robot: RobotSpec, jitter: float) -> None:
        """Add joint servos and delay, which contains half of the largest jitter."""
        if servos.delay.told:
            low, high = (max(0.0, end - 0.5 * jitter) for end in _range(servos.delay))
            self.ranges["actuators.delay"] = low, high
        if servos.damping.told.all():
            own = servos.damping.mean()
            self.ranges |= {"actuators.joint_kd": _range(own), "actuators.joint_damping": (0.0, 0.0)}
            self.robot |= {"joint_kd": float(own.value), "joint_damping": 0.0}
        if servos.friction.told.all():
            own = servos.friction.mean()
            self.ranges["actuators.joint_friction"] = _range(own)
            self.robot["joint_friction"] = max(0.0, float(own.value))
        for name, own, nominal in (
            ("actuators.servo_stiffness", servos.stiffness, robot.joint_kp),
            ("actuators.servo_speed", servos.speed, robot.joint_speed),
        ):
            if own.told.all():
                self.values[name], self.ranges[name] = _about(own, nominal)

    def add_hovers(self, hovers: Hovers) -> None:
        """Add gains and lag of the modules."""
        if hovers.mean_lag.told:
            self.ranges["actuators.thrust_lag"] = _range(hovers.mean_lag)
            self.robot["thrust_lag"] = float(hovers.mean_lag.value)
        if hovers.gain.told.all():
            self.values["actuators.module_gain"], self.ranges["actuators.module_gain"] = _about(hovers.gain, 1.0)


def _middle(content: Mapping[str, Any], name: str) -> float:
    """Return the mean of the ranges of a field in a world's file; 0 without a row."""
    ranges = [ends for row in content["row"] if row["field"] == name for ends in row["ranges"].values()]
    return float(np.mean(ranges)) if ranges else 0.0


def _range(estimate: Estimate) -> tuple[float, float]:
    """Return the 95 % interval of one number, above zero and at least as wide as the models are exact."""
    value, half = float(estimate.value), float(estimate.high - estimate.value)
    half = max(half, MODEL_SHARE * abs(value))
    return _digits(max(0.0, value - half)), _digits(max(0.0, value + half))


def _about(estimate: Estimate, nominal: float) -> tuple[list[float], tuple[float, float]]:
    """Return factors on the nominal value, and the range of a common factor on these."""
    factors = estimate.value / nominal
    half = max(MODEL_SHARE, float(np.median((estimate.high - estimate.value) / estimate.value)))
    return [_digits(own) for own in factors.tolist()], (_digits(1.0 - half), _digits(1.0 + half))


def _digits(value: float) -> float:
    return float(f"{value:.6g}")


def _row(name: str, ends: tuple[float, float]) -> dict[str, Any]:
    return {"field": name, "origin": "fitted", "source": "identified from logs: 95 % interval", "log": False,
            "ranges": {"all": list(ends)}}  # fmt: skip


def _toml(content: Mapping[str, Any], values: Mapping[str, Any], spec: Mapping[str, float]) -> str:
    """Format a world's content, with tables of values and of the robot."""
    lines = [f"{name} = {_literal(content[name])}" for name in ("doc", "sensors", "trimmed", "floor_steps")]
    for name in ("mixtures", "variants"):
        lines += ["", f"[{name}]", *(f"{_key(key)} = {_literal(value)}" for key, value in content[name].items())]
    lines += ["", "[values]", *(f"{_literal(key)} = {_literal(value)}" for key, value in values.items())]
    lines += ["", "[robot]", *(f"{key} = {_literal(value)}" for key, value in spec.items())]
    for row in content["row"]:
        ranges = ", ".join(f"{_key(name)} = {_literal(ends)}" for name, ends in row["ranges"].items())
        own = [f"{name} = {_literal(row[name])}" for name in ("field", "origin", "source", "log")]
        lines += ["", "[[row]]", *own, f"ranges = {{ {ranges} }}"]
    return "\n".join([*lines, ""])


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else json.dumps(name)


def _literal(value: str | float | bool | Sequence[Any]) -> str:
    """Format a value of TOML: texts, numbers and lists look as in JSON."""
    return json.dumps(value, ensure_ascii=False)
