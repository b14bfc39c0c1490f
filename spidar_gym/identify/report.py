"""What logs tell of a robot: a row for every parameter with value, interval and verdict, and the fit."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.identify.ahead import Ahead
from spidar_gym.identify.estimate import Estimate
from spidar_gym.identify.robot_file import Identified
from spidar_gym.identify.sensors import Sensors
from spidar_gym.robot import FORMS, JOINT_NAMES, N_ROTORS

WORSE = {"joints": 1.1, "position": 1.3, "attitude": 1.3}
"""Errors one second ahead over those of the described robot from which on they are worse: about thirty predictions of
what eddies do differ by so much [chosen]."""
MODULES = tuple(f"module {k + 1}" for k in range(N_ROTORS))
AXES = tuple(f"{module} {axis}" for module in MODULES for axis in "xy")


@dataclass(frozen=True)
class Quantity:
    """A kind of parameter in the report."""

    name: str
    """Name."""
    unit: str
    """Unit."""
    advice: str
    """What tells it where a log does not."""
    places: tuple[str, ...] = ("",)
    """Joint, module or axis of each number."""


BENCH, THRUST = "fly the test bench", "fly the test thrust"
WEIGH = "weigh the robot, --mass"
QUANTITIES = {
    "mass": Quantity("mass", "kg", f"{WEIGH}: a flight tells gain over mass only"),
    "delay": Quantity("delay of the commands", "s", f"{BENCH}: a flight tells the sum of delay and lag"),
    "damping": Quantity("damping D of servo and joint", "Nm s/rad", BENCH, JOINT_NAMES),
    "friction": Quantity("dry friction", "Nm", BENCH, JOINT_NAMES),
    "stiffness": Quantity("stiffness of the servo", "Nm/rad", BENCH, JOINT_NAMES),
    "speed": Quantity("speed of the servo's setpoint", "rad/s", BENCH, JOINT_NAMES),
    "backlash": Quantity("backlash", "rad", "turn the joint by hand between its stops of play", JOINT_NAMES),
    "zero": Quantity("zero of the encoder", "rad", "measure the joint in a jig", JOINT_NAMES),
    "gain_over_mass": Quantity("gain over mass", "1/kg", THRUST, MODULES),
    "mean_gain_over_mass": Quantity("mean gain over mass", "1/kg", THRUST),
    "lag": Quantity("lag of the thrust", "s", f"{THRUST}, after the test bench", MODULES),
    "mean_lag": Quantity("mean lag of the thrusts", "s", f"{THRUST}, after the test bench"),
    "tilt": Quantity("tilt of the thrust, vectoring zero and ducts together", "rad", "use a jig", AXES),
    "torso_com": Quantity("shift of the torso's centre of mass", "m", "hang the robot from two points", tuple("xyz")),
    "wind": Quantity(
        "steady horizontal force, world",
        "N",
        "longer hovers at two headings, with a level frame of the motion capture",
        ("x", "y"),
    ),
    "air": Quantity("steady wrench of the air, torso", "N, Nm", "longer hovers; tilts and centre of mass from a jig"),
    "latency": Quantity("latency of the motion capture", "s", "log with the motion capture"),
}
"""Kinds of parameters by their key."""


@dataclass(frozen=True)
class Line:
    """A number of the report."""

    key: str
    """Key of its kind in `QUANTITIES`."""
    place: str
    """Joint, module or axis; empty for one number of all."""
    value: float
    """Value; NaN where nothing is known."""
    low: float
    """Lower end of the 95 % interval."""
    high: float
    """Upper end."""
    told: bool
    """Whether the logs tell it."""

    @property
    def verdict(self) -> str:
        """What the logs tell, and else what would."""
        quantity = QUANTITIES[self.key]
        if self.told:
            return "told"
        of = f" of {self.place}" if self.place else ""
        return f"these logs do not tell the {quantity.name}{of}: {quantity.advice}"


def report_lines(found: Identified, sensors: Sensors) -> list[Line]:
    """Return every number that the issue of an identification is: of servos, modules, balance and sensors."""
    lines = _lines("mass", found.mass)
    servos, hovers, mass = found.servos, found.hovers, float(found.mass.value)
    for key in ("delay", "damping", "friction", "stiffness", "speed"):
        lines += _lines(key, None if servos is None else getattr(servos, key))
    lines += _lines("backlash", None) + _lines("zero", None)
    over = {"gain_over_mass": "gain", "mean_gain_over_mass": "mean_gain"}
    for key in ("gain_over_mass", "mean_gain_over_mass", "lag", "mean_lag", "tilt", "torso_com", "wind"):
        own = None if hovers is None else getattr(hovers, over.get(key, key))
        if own is not None and key in over:
            own = own.over(mass)
        lines += _lines(key, own)
    if hovers is not None:
        for form, own in zip(hovers.forms, _split(hovers.air), strict=True):
            lines += _lines(
                "air", own, tuple(f"{_form_name(form)} {axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz"))
            )
    return lines + _lines("latency", sensors.latency)


def _split(estimate: Estimate) -> Iterable[Estimate]:
    rows = zip(estimate.value, estimate.deviation, estimate.known, strict=True)
    return (Estimate(*row) for row in rows)


def _form_name(form: np.ndarray) -> str:
    """Return the name of the paper's form, or its largest angle."""
    near = [name for name, own in FORMS.items() if abs(own - form).max() < 0.11]
    return near[0] if near else f"form up to {abs(form).max():.1f} rad"


def _lines(key: str, estimate: Estimate | None, places: tuple[str, ...] = ()) -> list[Line]:
    places = places or QUANTITIES[key].places
    if estimate is None:
        return [Line(key, place, np.nan, np.nan, np.nan, False) for place in places]
    low = np.maximum(estimate.low, 0.0) if key == "friction" else estimate.low
    columns = (np.ravel(own).tolist() for own in (estimate.value, low, estimate.high, estimate.told))
    return [Line(key, place, *row) for place, row in zip(places, zip(*columns, strict=True), strict=True)]


@dataclass(frozen=True)
class Report:
    """The result of an identification."""

    logs: tuple[str, ...]
    """Names of the logs."""
    lines: tuple[Line, ...]
    """All numbers."""
    sensors: Sensors
    """Noise of the sensors."""
    found: Identified
    """Estimates."""
    ahead: Mapping[str, tuple[Ahead, int, Ahead]]
    """Log of a flight → errors one second ahead of the identified robot, their number, and those of the described."""
    unused: tuple[str, ...] = ()
    """Names of logs that tell nothing."""

    def facts(self) -> dict[str, Any]:
        """Return the report as JSON: numbers that are not known are null."""
        servos = self.found.servos
        fit = {
            name: {"identified": vars(own), "count": count, "described": vars(described)}
            for name, (own, count, described) in self.ahead.items()
        }
        bench = None
        if servos is not None:
            bench = {
                "misfit": servos.misfit,
                "lost": servos.lost,
                "identified_rad": servos.ahead.tolist(),
                "described_rad": servos.described.tolist(),
            }
        return {
            "logs": list(self.logs), "unused": list(self.unused), "worse": self.worse,
            "parameters": [
                {
                    "parameter": line.key, "place": line.place, "unit": QUANTITIES[line.key].unit,
                    "value": _number(line.value),
                    "low": _number(line.low), "high": _number(line.high), "told": line.told, "verdict": line.verdict,
                }
                for line in self.lines
            ],
            "sensors": {
                name: _number(getattr(self.sensors, name))
                for name in ("gyro", "accelerometer", "position", "rotation", "encoder", "dropped")
            },
            "one_second_ahead": {"bench": bench, "flights": fit},
        }  # fmt: skip

    @property
    def worse(self) -> list[str]:
        """What the identified robot predicts worse than the described one, beyond what eddies change by chance."""
        found, servos = [], self.found.servos
        if servos is not None and np.linalg.norm(servos.ahead) > np.linalg.norm(servos.described):
            found.append("joint angles on the bench")
        for name, (own, _, described) in self.ahead.items():
            found += [
                f"{kind} in {name}"
                for kind, most in WORSE.items() if getattr(own, kind) > most * getattr(described, kind)
            ]  # fmt: skip
        return found

    def text(self) -> str:
        """Return the report as Markdown."""
        lines = ["# Identification", "", f"Logs: {', '.join(self.logs)}"]
        if self.unused:
            lines[-1] += f"; not used: {', '.join(self.unused)}, which are neither a test bench nor a test thrust"
        lines += ["", "| parameter | of | value | 95 % interval | unit |", "|---|---|---|---|---|"]
        lines += [
            f"| {QUANTITIES[line.key].name} | {line.place} | {line.value:.4g} | {line.low:.4g} … {line.high:.4g} "
            f"| {QUANTITIES[line.key].unit} |"
            for line in self.lines if line.told
        ]  # fmt: skip
        lines += ["", "## Not told by these logs", ""]
        for key, quantity in QUANTITIES.items():
            own = [line for line in self.lines if line.key == key]
            absent = [line.place for line in own if not line.told]
            if absent:
                of = "" if len(absent) == len(own) else f" of {', '.join(absent)}"
                lines.append(f"- {quantity.name}{of}: {quantity.advice}")
        return "\n".join([*lines, *self._sensor_lines(), *self._fit_lines(), ""])

    def _sensor_lines(self) -> list[str]:
        s = self.sensors
        return [
            "", "## Sensors", "", "| noise | value | unit |", "|---|---|---|",
            f"| gyroscope | {s.gyro:.2g} | rad/s/√Hz |",
            f"| accelerometer, with vibration | {s.accelerometer:.2g} | m/s²/√Hz |",
            f"| motion capture, position | {1e3 * s.position:.2g} | mm |",
            f"| motion capture, attitude | {1e3 * s.rotation:.2g} | mrad |",
            f"| encoders | {1e3 * s.encoder:.2g} | mrad |", f"| frames not received | {100 * s.dropped:.2g} | % |",
        ]  # fmt: skip

    def _fit_lines(self) -> list[str]:
        lines = [
            "",
            "## Held-out fit, one second ahead",
            "",
            "| log | error of | identified | described | unit |",
            "|---|---|---|---|---|",
        ]
        servos, hovers = self.found.servos, self.found.hovers
        if servos is not None:
            root = [1e3 * float(np.sqrt((own**2).mean())) for own in (servos.ahead, servos.described)]
            lines.append(f"| bench | joint angles | {root[0]:.2f} | {root[1]:.2f} | mrad |")
        for name, (own, _, described) in self.ahead.items():
            lines += [
                f"| {name} | joint angles | {1e3 * own.joints:.2f} | {1e3 * described.joints:.2f} | mrad |",
                f"| {name} | position | {own.position:.3f} | {described.position:.3f} | m |",
                f"| {name} | attitude | {own.attitude:.3f} | {described.attitude:.3f} | rad |",
            ]
        if hovers is not None:
            lines += [
                "", "Errors of position and attitude contain what eddies do within a second. The slow wrench of "
                f"the air is {_list(hovers.slow)} N and Nm about the torso's axes, with correlation times of "
                f"{_list(hovers.slow_time)} s.",
            ]  # fmt: skip
        verdict = "The identified robot predicts no worse than the described one."
        if self.worse:
            verdict = f"Worse than the described robot: {', '.join(self.worse)}. Something was wrong in a test."
        lines += ["", verdict]
        if servos is not None:
            lines += ["", f"{100.0 * servos.lost:.1f} % of the commands that would have moved a joint did not arrive."]
        return lines


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _list(values: np.ndarray) -> str:
    return ", ".join(f"{own:.2g}" for own in values)
