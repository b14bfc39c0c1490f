"""The robot in numbers: every physical quantity with unit and source, names, counts and index maps.

One `RobotSpec` feeds the MJCF, the URDF, the controller, the plant and the tables of the documentation.
Sources: [Zhao2025, Tab. 1] the paper's specification table; [JSK] facts read from the lab's public robot package
as flown for the paper; [Dynamixel] the servo maker's manual; [estimate] ours. Part frames as in `PARTS`.
"""

import ast
import inspect
import math
from dataclasses import dataclass, field, fields, is_dataclass
from itertools import pairwise

import numpy as np

from spidar_gym.errors import InvalidValueError
from spidar_gym.so3 import rotation_x, skew

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
"""The frames whose z axis is the direction of the thrust."""
FOOT_SITES = tuple(f"foot{leg}" for leg in range(1, N_LEGS + 1))
"""The centres of the foot spheres."""
PEG_SITES = tuple(f"peg{i}" for i in (1, 3, 5, 7, 2, 4, 6, 8))
"""The tips of the pegs: the four under the torso (inner junctions) first, then the four under the knees."""
CONTACT_SITES = FOOT_SITES + PEG_SITES
"""The 12 points made to touch the ground."""


FORMS: dict[str, np.ndarray] = {
    name: np.tile(np.radians([0.0, inner, 0.0, outer]), N_LEGS)
    for name, (inner, outer) in {"form1": (0.0, 0.0), "form2": (30.0, 60.0), "form3": (45.0, 90.0)}.items()
}
"""The paper's joint configurations ① (flat), ② (outer links vertical), ③ (rotors stacked), shape (16,) [rad]."""


@dataclass(frozen=True)
class Inertial:
    """Mass distribution of a rigid part in some frame."""

    mass: float
    """Mass [kg]."""
    com: tuple[float, float, float]
    """Centre of mass [m]."""
    inertia: tuple[float, float, float, float, float, float]
    """xx, yy, zz, xy, xz, yz of the inertia tensor about the centre of mass, axes of the frame [kg m²]."""

    @property
    def matrix(self) -> np.ndarray:
        """Inertia tensor about the centre of mass, shape (3, 3) [kg m²]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def placed(self, position: tuple[float, float, float], roll: float = 0.0) -> "Inertial":
        """The same part seen from a frame in which its own frame sits at `position` [m], turned by `roll` about x."""
        R = rotation_x(roll)
        x, y, z = (np.array(position) + R @ self.com).tolist()
        return Inertial(self.mass, (x, y, z), _six(R @ self.matrix @ R.T))

    def scaled(self, factor: float) -> "Inertial":
        """The same shape with `factor` times the density."""
        return Inertial(self.mass * factor, self.com, _six(factor * self.matrix))


def _six(I: np.ndarray) -> tuple[float, float, float, float, float, float]:
    return float(I[0, 0]), float(I[1, 1]), float(I[2, 2]), float(I[0, 1]), float(I[0, 2]), float(I[1, 2])


def merge(*parts: Inertial) -> Inertial:
    """One rigid body of several parts given in one frame (parallel axes)."""
    mass = sum(part.mass for part in parts)
    com = np.sum([part.mass * np.array(part.com) for part in parts], axis=0) / mass
    I = np.zeros((3, 3))
    for part in parts:
        S = skew(np.array(part.com) - com)
        I += part.matrix - part.mass * S @ S
    x, y, z = com.tolist()
    return Inertial(mass, (x, y, z), _six(I))


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
    pitch lowers the leg.
    """

    total_mass: float = 16.0
    """Mass of the whole robot [kg] [Zhao2025, Tab. 1]; the parts add up to 15.21 kg and are scaled to it."""
    yaw_axis_xy: float = 0.12233
    """± x and ± y of the inner yaw axes in the torso [JSK]; leg l points at azimuth 45° + 90° (l − 1)."""
    yaw_axis_z: float = -0.0155
    """Height of the inner yaw axes in the torso [JSK]."""
    yaw_to_pitch: float = 0.0515
    """From a yaw axis to the pitch axis of the same junction [JSK]."""
    pitch_to_yaw: float = 0.523
    """From the inner pitch axis to the outer yaw axis, also the length of the rod [JSK]."""
    pitch_to_foot: float = 0.5115
    """From the outer pitch axis to the centre of the foot sphere [JSK]."""
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
    """Dry friction of a joint [Nm] [JSK], which gives 0 (0.1 in its simulator); each one above 0 is a constraint that
    the solver meets at every step."""
    foot_friction: float = 1.0
    """Sliding friction of the taped feet [JSK]."""
    peg_friction: float = 0.6
    """Sliding friction of pegs and ducts [estimate]: 0.4 … 0.8."""

    bodies: dict[str, Inertial] = field(init=False)
    """Mass distribution of the seven kinds of moving body, scaled to `total_mass`; derived from `PARTS`."""

    def __post_init__(self) -> None:
        """Merge the parts that do not move against each other."""
        peg = PARTS["peg"].placed((0.0, 0.0, self.peg_top))
        lumps = {
            "torso": merge(
                PARTS["torso"],
                PARTS["flight_controller"].placed(self.flight_controller),
                PARTS["computer"].placed(self.computer, math.pi / 2),
            ),
            "inner_junction": merge(PARTS["inner_junction"], peg),
            "inner_link": merge(PARTS["inner_link"], PARTS["battery"].placed(self.inner_battery, -math.pi / 2)),
            "outer_junction": merge(PARTS["outer_junction"], peg),
            "outer_link": merge(
                PARTS["outer_link"],
                PARTS["battery"].placed(self.outer_battery, -math.pi / 2),
                PARTS["foot"].placed((self.pitch_to_foot, 0.0, 0.0)),
            ),
            "roll_module": PARTS["roll_module"],
            "pitch_module": PARTS["pitch_module"],
        }
        count = {"torso": 1, "roll_module": N_ROTORS, "pitch_module": N_ROTORS}
        factor = self.total_mass / sum(count.get(name, N_LEGS) * lump.mass for name, lump in lumps.items())
        object.__setattr__(self, "bodies", {name: lump.scaled(factor) for name, lump in lumps.items()})

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
        """From the torso's origin down to the tips of its four pegs: its height when it lies on a floor [m]."""
        return self.peg_length - self.peg_top - self.yaw_axis_z

    def leg_azimuth(self, leg: int) -> float:
        """Direction of leg 0 … 3 (front left, back left, back right, front right) in the torso [rad]."""
        return math.pi / 4 + leg * math.pi / 2


ROBOT = RobotSpec()
"""The nominal robot."""


def require_kind() -> None:
    """Refuse counts of another kind of robot: shapes, the gait and the onboard core are written for these."""
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
    """Why a file of the robot that `RobotSpec` describes is not one of `spec`, in words."""
    described = RobotSpec()
    other = ", ".join(
        f"{f.name} = {getattr(spec, f.name)!r} instead of {getattr(described, f.name)!r}"
        for f in fields(RobotSpec)
        if f.init and getattr(spec, f.name) != getattr(described, f.name)
    )
    return (
        f"is of the robot that RobotSpec describes, but ROBOT in memory has {other}: give RobotSpec these numbers in "
        "spidar_gym/robot/spec.py"
    )


def field_docs(cls: type) -> dict[str, str]:
    """The docstring under each field of a dataclass, on one line: what the generated tables say of it."""
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
    """(name, value, documentation) of every number of `spec`, for the generated tables."""
    docs = field_docs(RobotSpec)
    return [(f.name, f"{getattr(spec, f.name)}", docs[f.name]) for f in fields(spec) if f.init]
