"""The robot's parameters: every physical quantity with unit and source, and names and counts of joints and rotors.

MJCF, URDF, controller, plant and the tables of the documentation are all derived from one `RobotSpec`. Sources:
[Zhao2025, Tab. 1] the paper's specification table; [JSK] facts from the lab's public robot package as flown for the
paper; [estimate] ours. Part frames as in `PARTS`.
"""

import ast
import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError
from spidar_gym.robot.inertial import Inertial, merge
from spidar_gym.robot.payload import Payload
from spidar_gym.robot.valid import check, own_masses, read_spec

N_LEGS = 4
N_LINKS = 8
N_ROTORS = 8
N_JOINTS = 16
GRAVITY = 9.81
"""Standard gravity used everywhere [m/s²]."""

JOINT_NAMES = tuple(f"joint{i}_{axis}" for i in range(1, N_LINKS + 1) for axis in ("yaw", "pitch"))
"""The 16 joints in the paper's order q₁ … q₁₆ (q₄ₗ₋₃, q₄ₗ₋₂, q₄ₗ₋₁, q₄ₗ of leg l); names as on the robot."""
GIMBAL_NAMES = tuple(f"gimbal{i}_{axis}" for i in range(1, N_ROTORS + 1) for axis in ("roll", "pitch"))
"""The 16 vectoring joints: φ₁, θ₁, φ₂, θ₂ …; names as on the robot."""
ROTOR_SITES = tuple(f"thrust{i}" for i in range(1, N_ROTORS + 1))
"""Frames of the rotors; the z axis is the direction of the thrust."""
FOOT_SITES = tuple(f"foot{leg}" for leg in range(1, N_LEGS + 1))
"""The centres of the foot spheres."""
PEG_SITES = tuple(f"peg{i}" for i in (1, 3, 5, 7, 2, 4, 6, 8))
"""The tips of the pegs: the four under the torso (inner junctions) first, then the four under the knees."""
CONTACT_SITES = FOOT_SITES + PEG_SITES
"""The 12 points that are designed to touch the ground."""


FORMS: dict[str, np.ndarray] = {
    name: np.tile(np.radians([0.0, inner, 0.0, outer]), N_LEGS)
    for name, (inner, outer) in {"form1": (0.0, 0.0), "form2": (30.0, 60.0), "form3": (45.0, 90.0)}.items()
}
"""The paper's joint configurations ① (flat), ② (outer links vertical), ③ (rotors stacked), shape (16,) [rad]."""


PARTS: dict[str, Inertial] = {
    "torso": Inertial(1.17803, (0.0, 0.0, 0.027), (0.009512, 0.009512, 0.017150, 0.0, 0.0, 0.0)),
    "flight_controller": Inertial(0.03542, (0.0129, 0.0045, -0.0227), (2.25e-5, 2.25e-5, 3.46e-5, 0.0, 0.0, 0.0)),
    "computer": Inertial(0.14113, (0.0009, 0.0304, 0.0272), (7.7e-5, 1.38e-4, 1.49e-4, 2e-6, -2e-6, 7e-6)),
    "inner_junction": Inertial(0.103, (0.028, 0.007, 0.003), (8.7e-5, 8.7e-5, 9.6e-5, 1.6e-5, -1.0e-5, -2e-6)),
    "outer_junction": Inertial(0.095, (0.026, 0.004, 0.004), (7.4e-5, 7.9e-5, 7.9e-5, 9e-6, -9e-6, -1e-6)),
    "peg": Inertial(0.027, (0.0, 0.0, -0.046), (2.9e-5, 2.9e-5, 2e-6, 0.0, 0.0, 0.0)),
    "inner_link": Inertial(0.523, (0.257, -0.002, 0.004), (5.19e-4, 0.021290, 0.020931, -2.46e-4, 1.893e-3, -4.4e-5)),
    "outer_link": Inertial(0.347, (0.157, 0.015, 0.0), (2.76e-4, 8.551e-3, 8.772e-3, -6.06e-4, -3.1e-5, 1e-6)),
    "roll_module": Inertial(0.275, (0.01458, -0.00072, -0.02190), (4.56e-4, 5.04e-4, 1.57e-4, 3e-6, -1.25e-4, -9e-6)),
    "pitch_module": Inertial(0.434, (0.0, -0.00151, -0.00109), (7.595e-3, 4.01e-4, 7.781e-3, 0.0, 0.0, 1.0e-5)),
    "battery": Inertial(0.417, (-0.001, 0.0, 0.0), (9.9e-5, 7.0e-4, 6.73e-4, 0.0, 0.0, 0.0)),
    "foot": Inertial(0.090, (0.007, 0.0, 0.0), (5.5e-5, 4.7e-5, 5.5e-5, 0.0, 0.0, 0.0)),
}
"""Mass distribution of each part in its own frame, before the scaling to the total mass [JSK]."""


@dataclass(frozen=True)
class RobotSpec:
    """Geometry, mass and actuators of SPIDAR; lengths [m], angles [rad].

    Frames of torso, junctions and links at q = 0: x away from the torso along the leg, y to the left, z up. Positive
    pitch lowers the leg. The default values describe the real robot; environments, models and the export accept any
    other valid robot. Every robot has four legs and eight links with a rotor in each.
    """

    described_mass: float = 16.0
    """Mass of a robot with links of the default lengths, the masses of `PARTS` and no payload [kg]
    [Zhao2025, Tab. 1]; the parts add up to 15.21 kg and are scaled to it. `total_mass` is the mass of this robot."""
    yaw_axis_xy: float = 0.12233
    """± x and ± y of the inner yaw axes in the torso [JSK]; leg l points at azimuth 45° + 90° (l − 1)."""
    yaw_axis_z: float = -0.0155
    """Height of the inner yaw axes in the torso [JSK]."""
    yaw_to_pitch: float = 0.0515
    """Distance from a yaw axis to the pitch axis of the same junction [JSK]."""
    pitch_to_yaw: float = 0.523
    """Distance from the inner pitch axis to the outer yaw axis, also the length of the rod [JSK]; a longer inner link
    is stretched, and therefore heavier."""
    pitch_to_foot: float = 0.5115
    """Distance from the outer pitch axis to the centre of the foot sphere [JSK]; a longer link is stretched too."""
    foot_radius: float = 0.04
    """Radius of the foot sphere [JSK]."""
    rod_radius: float = 0.0125
    """Half of the link diameter [Zhao2025, Tab. 1]."""
    roll_axis_x: float = 0.268
    """Position of the φ module on the link [JSK]."""
    pitch_axis_offset: tuple[float, float, float] = (-0.0065, 0.0, -0.027)
    """Origin of the θ module, which is the rotor centre, in the φ module [JSK]."""
    duct_offset_y: float = 0.1335
    """The two ducts of a module lie side by side on the θ axis at ± this distance [JSK]."""
    duct_radius: float = 0.0825
    """Outer radius of a duct [JSK]."""
    duct_z: tuple[float, float] = (-0.030, 0.038)
    """Lower and upper end of a duct along the thrust axis [JSK]."""
    propeller_radius: float = 0.0635
    """Radius of a propeller: 5 inch diameter [Zhao2025, Tab. 1]."""
    torso_radius: float = 0.169
    """Radius of the torso disc [JSK]."""
    torso_height: float = 0.0928
    """Height of the torso disc [JSK]."""
    peg_top: float = -0.0283
    """z of a peg's upper end in its junction, on the yaw axis [JSK]."""
    peg_length: float = 0.1045
    """Length of a peg; its tip is a ball of `peg_radius` [JSK]."""
    peg_radius: float = 0.01
    """Radius of a peg [JSK]."""
    inner_battery: tuple[float, float, float] = (0.430, 0.0, -0.039)
    """Battery on an inner link, turned by −90° about x [JSK]."""
    outer_battery: tuple[float, float, float] = (0.410, 0.0, -0.039)
    """Battery on an outer link, turned by −90° about x [JSK]."""
    battery_size: tuple[float, float, float] = (0.150, 0.033, 0.042)
    """Edges of a battery in its own frame [JSK]."""
    flight_controller: tuple[float, float, float] = (-0.0129, -0.0044, 0.0398)
    """Position of the flight controller (IMU) in the torso [JSK]."""
    computer: tuple[float, float, float] = (0.0, 0.0899, 0.002)
    """Position of the onboard computer in the torso, turned by +90° about x [JSK]."""

    max_thrust: float = 42.0
    """Largest thrust of a module, λ̄ [N] [Zhao2025, Tab. 1]."""
    idle_thrust: float = 1.2
    """Thrust of an armed module at its lowest motor speed [N] [JSK]: 1.0 … 1.4."""
    thrust_lag: float = 0.030
    """Time constant of the thrust [s] [estimate]; the lab's simulators use 0.01."""
    max_vectoring_torque: float = 1.5
    """Torque limit of a vectoring servo [Nm] [Zhao2025, Tab. 1]."""
    max_vectoring_speed: float = 10.0
    """Speed limit of a vectoring servo [rad/s] [JSK]."""
    vectoring_kp: float = 15.0
    """Stiffness of a vectoring servo [Nm/rad] [estimate]."""
    vectoring_kd: float = 0.5
    """Damping of a vectoring servo [Nm s/rad] [estimate]."""
    vectoring_armature: float = 1e-3
    """Reflected rotor inertia of a vectoring servo [kg m²] [estimate]."""
    max_joint_torque: float = 7.0
    """Torque limit of a joint, τ̄ [Nm] [Zhao2025, Tab. 1]."""
    joint_speed: float = 0.2
    """Largest commanded joint speed [rad/s] [Zhao2025, Tab. 1]."""
    joint_limit: float = math.pi / 2
    """Commanded range of a joint, ± [rad] [Zhao2025, Sec. Robot Platform]."""
    joint_stop: float = 1.9108
    """Mechanical stop of a joint, ± [rad] [JSK]."""
    joint_kp: float = 175.0
    """Stiffness k_{j,p} of a joint servo [Nm/rad] [estimate]: 150 … 200 recommended."""
    joint_kd: float = 8.0
    """Damping k_{j,d} of a joint servo [Nm s/rad] [estimate]."""
    joint_armature: float = 0.02
    """Reflected rotor inertia of a joint servo [kg m²] [estimate]."""
    joint_damping: float = 0.9
    """Viscous friction of a joint [Nm s/rad] [JSK]."""
    joint_friction: float = 0.0
    """Dry friction of a joint [Nm] [JSK]: 0 there (0.1 in its simulator). Above 0 each joint adds a constraint that
    the solver handles at every step."""
    foot_friction: float = 1.0
    """Sliding friction of the taped feet [JSK]."""
    peg_friction: float = 0.6
    """Sliding friction of pegs and ducts [estimate]: 0.4 … 0.8."""

    part_masses: Mapping[str, float] | tuple[tuple[str, float], ...] = ()
    """Masses of parts by name that replace those of `PARTS` [kg]; they are not scaled, and `total_mass` changes with
    them. A mapping becomes sorted pairs."""
    payloads: tuple[Payload, ...] = ()
    """Payloads: bodies fixed to torso or links."""

    def __post_init__(self) -> None:
        """Convert numbers to floats and check that the robot can hover, lie and stand (`InvalidValueError`)."""
        for f in fields(self):
            if isinstance(given := getattr(self, f.name), int | np.integer | np.floating):
                object.__setattr__(self, f.name, float(given))
            elif isinstance(given, list | np.ndarray):
                object.__setattr__(self, f.name, tuple(given))
        object.__setattr__(self, "part_masses", own_masses(self.part_masses, PARTS))
        check(self, {f.name: f.default for f in fields(self)})

    @classmethod
    def parse(cls, given: "RobotSpec | str | Path | Mapping[str, Any] | None") -> "RobotSpec":
        """Build a robot from user input.

        Args:
            given: A robot; a mapping from fields to numbers, where other fields keep their defaults; a TOML file with
                such a mapping and tables `[part_masses]` and `[[payloads]]`; or None for the nominal robot.

        Raises:
            UnknownNameError: For a field that does not exist; it lists the valid fields.
            InvalidValueError: For numbers that do not describe a valid robot.
            SpidarError: For a file that cannot be read or is not TOML.
        """
        if given is None:
            return ROBOT
        if isinstance(given, RobotSpec):
            return given
        return cls(**read_spec(given, {f.name: f.default for f in fields(cls)}, PARTS))

    @cached_property
    def bodies(self) -> dict[str, Inertial]:
        """Mass distribution of the seven kinds of moving body without payload, scaled to the robot's mass."""
        return {name: lump.scaled(self._density) for name, lump in self._lumps.items()}

    def inertial(self, body: str, kind: str) -> Inertial:
        """Compute the mass distribution of a body including its payloads.

        Args:
            body: Name of the body: `torso`, `junction1`, `link1` …
            kind: Kind of the body, a key of `bodies`.
        """
        carried = [payload.inertial for payload in self.payloads if payload.body == body]
        return merge(self.bodies[kind], *carried) if carried else self.bodies[kind]

    @property
    def _density(self) -> float:
        """Factor that scales the masses of `PARTS` to the described mass."""
        return self.described_mass / _sum(_merged(self, PARTS))

    @cached_property
    def _lumps(self) -> dict[str, Inertial]:
        """The seven kinds of moving body with this robot's link lengths and part masses, before the scaling."""
        own = dict(PARTS)
        for name, length in (("inner_link", "pitch_to_yaw"), ("outer_link", "pitch_to_foot")):
            if (stretch := getattr(self, length) / getattr(RobotSpec, length)) != 1.0:
                own[name] = own[name].stretched(stretch)
        for name, mass in own_masses(self.part_masses, PARTS):
            own[name] = own[name].scaled(mass / (own[name].mass * self._density))
        return _merged(self, own)

    @cached_property
    def total_mass(self) -> float:
        """Mass of the whole robot, payload included [kg]."""
        own = self.described_mass * (_sum(self._lumps) / _sum(_merged(self, PARTS)))
        return own + sum(payload.mass for payload in self.payloads)

    @property
    def weight(self) -> float:
        """Weight mΣ g [N]."""
        return self.total_mass * GRAVITY

    @property
    def hover_thrust(self) -> float:
        """Thrust of each module in a level hover with all rotors upright, mΣ g / 8 [N]."""
        return self.weight / N_ROTORS

    @property
    def yaw_axis_radius(self) -> float:
        """Distance of the inner yaw axes from the torso's axis."""
        return math.hypot(self.yaw_axis_xy, self.yaw_axis_xy)

    @property
    def diameter(self) -> float:
        """Span of the flat robot, foot to opposite foot."""
        reach = self.yaw_axis_radius + 2 * self.yaw_to_pitch + self.pitch_to_yaw + self.pitch_to_foot
        return 2.0 * (reach + self.foot_radius)

    @property
    def peg_depth(self) -> float:
        """Distance of the tips of the torso's pegs below its origin: the height of the lying torso [m]."""
        return self.peg_length - self.peg_top - self.yaw_axis_z

    @property
    def duct_reach(self) -> float:
        """Distance of the ducts' outer edge from the rotor centre [m]."""
        return self.duct_offset_y + self.duct_radius

    def leg_azimuth(self, leg: int) -> float:
        """Return the direction of leg 0 … 3 (front left, back left, back right, front right) in the torso [rad]."""
        return math.pi / 4 + leg * math.pi / 2


def _merged(spec: RobotSpec, parts: Mapping[str, Inertial]) -> dict[str, Inertial]:
    """Merge the parts that do not move relative to each other into the seven kinds of moving body."""
    peg = parts["peg"].placed((0.0, 0.0, spec.peg_top))
    battery, turned = parts["battery"], -math.pi / 2
    return {
        "torso": merge(
            parts["torso"],
            parts["flight_controller"].placed(spec.flight_controller),
            parts["computer"].placed(spec.computer, math.pi / 2),
        ),
        "inner_junction": merge(parts["inner_junction"], peg),
        "inner_link": merge(parts["inner_link"], battery.placed(spec.inner_battery, turned)),
        "outer_junction": merge(parts["outer_junction"], peg),
        "outer_link": merge(
            parts["outer_link"],
            battery.placed(spec.outer_battery, turned),
            parts["foot"].placed((spec.pitch_to_foot, 0.0, 0.0)),
        ),
        "roll_module": parts["roll_module"],
        "pitch_module": parts["pitch_module"],
    }


def _sum(bodies: Mapping[str, Inertial]) -> float:
    """Compute the mass of all bodies of a robot [kg]."""
    count = {"torso": 1, "roll_module": N_ROTORS, "pitch_module": N_ROTORS}
    return sum(count.get(name, N_LEGS) * body.mass for name, body in bodies.items())


ROBOT = RobotSpec()
"""The nominal robot."""


def require_kind() -> None:
    """Raise `InvalidValueError` for other counts: shapes, gait and onboard core are written for these."""
    counts = {"N_LEGS": 4, "N_LINKS": 8, "N_ROTORS": 8, "N_JOINTS": 16}
    for name, count in counts.items():
        if globals()[name] != count:
            others = ", ".join(f"{other} = {number}" for other, number in counts.items() if other != name)
            raise InvalidValueError(
                name, globals()[name], f"{count}, with {others}: a quadruped with a rotor in each link"
            )
    for name, form in FORMS.items():
        if form.shape != (N_JOINTS,):
            raise InvalidValueError(f"FORMS[{name!r}]", form.shape, f"an angle for each of the {N_JOINTS} joints")


def differences(spec: RobotSpec) -> str:
    """Explain why a file of the default `RobotSpec` is not one of `spec`."""
    described = RobotSpec()
    other = ", ".join(
        f"{f.name} = {getattr(spec, f.name)!r} instead of {getattr(described, f.name)!r}"
        for f in fields(RobotSpec)
        if getattr(spec, f.name) != getattr(described, f.name)
    )
    return (
        f"describes the default RobotSpec, but ROBOT in memory has {other}: change the defaults of RobotSpec in "
        "spidar_gym/robot/spec.py"
    )


def source_doc(of: type | ModuleType) -> str:
    """Read the docstring of a class or module from its source, because `python -OO` removes `__doc__`."""
    tree = ast.parse(inspect.getsource(of))
    found = ast.get_docstring(
        next(node for node in tree.body if isinstance(node, ast.ClassDef)) if isinstance(of, type) else tree
    )
    return found or ""


def field_docs(cls: type) -> dict[str, str]:
    """Read the docstring below each field of a dataclass as one line, for generated tables."""
    inherited = {name: doc for base in cls.__bases__ if is_dataclass(base) for name, doc in field_docs(base).items()}
    body = next(node for node in ast.parse(inspect.getsource(cls)).body if isinstance(node, ast.ClassDef)).body
    return inherited | {
        node.target.id: " ".join(str(after.value.value).split())
        for node, after in pairwise(body)
        if isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Name)
        and isinstance(after, ast.Expr)
        and isinstance(after.value, ast.Constant)
    }


def spec_rows(spec: RobotSpec = ROBOT) -> list[tuple[str, str, str]]:
    """Return (name, value, documentation) of every number of `spec`, for the generated tables."""
    docs = field_docs(RobotSpec)
    return [(f.name, f"{getattr(spec, f.name)}", docs[f.name]) for f in fields(spec) if f.default != ()]
