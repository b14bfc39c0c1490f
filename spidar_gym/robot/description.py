"""Generates MJCF and URDF: `mjcf(spec)` and `urdf(spec)` are pure functions of the robot description.

The committed files under assets/ are exactly this text; `mjcf_path` raises an error if one differs. Both engines load
the MJCF, so every body has an explicit inertial (Pinocchio drops the mass of geoms that do not collide). Visual geoms
are primitives of group 2; collision geoms are of group 3 and collide with the floor only.
"""

import hashlib
import math
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import numpy as np

from spidar_gym.committed import ROOT
from spidar_gym.errors import StaleAssetError
from spidar_gym.robot.inertial import Inertial
from spidar_gym.robot.spec import (
    GIMBAL_NAMES,
    GRAVITY,
    JOINT_NAMES,
    N_LEGS,
    ROBOT,
    ROTOR_SITES,
    RobotSpec,
    differences,
    require_kind,
)
from spidar_gym.robot.tables import assets_readme

Numbers = int | float | Iterable[int | float]

COLORS = {
    "shell": "0.93 0.93 0.91 1",
    "rod": "0.16 0.17 0.19 1",
    "metal": "0.62 0.64 0.67 1",
    "duct": "0.95 0.95 0.93 1",
    "fan": "0.10 0.11 0.13 1",
    "battery": "0.12 0.33 0.62 1",
    "rubber": "0.85 0.35 0.10 1",
}
PAYLOAD = {"payload": "0.86 0.65 0.13 1"}
"""Colour of payloads."""
CAMERAS: dict[str, tuple[str, str]] = {
    "chase": ("-2.6 -2.2 1.3", "0 0 -0.15"),
    "side": ("0 -3.4 0.1", "0 0 -0.2"),
    "front": ("3.4 0 0.1", "0 0 -0.2"),
    "top": ("-0.001 0 3.6", "0 0 0"),
}
"""Position and target [m] of the cameras, which follow the robot's centre of mass."""
FOOT_CONTACT = {"condim": "4", "priority": "1", "solref": "0.006 1"}
"""Contact settings of the feet, which set the friction of their contacts: those with the least creep in a prototype."""


def _colors(spec: RobotSpec) -> dict[str, str]:
    return COLORS | (PAYLOAD if spec.payloads else {})


def _text(value: Numbers) -> str:
    """Format numbers with 12 significant digits, so that both engines read the same model to 1e-12."""
    values = [value] if isinstance(value, int | float) else list(value)
    return " ".join(f"{v + 0.0:.12g}" for v in values)


def _add(parent: ET.Element, tag: str, **attributes: str | Numbers) -> ET.Element:
    element = ET.SubElement(parent, tag)
    for key, value in attributes.items():
        element.set(key.rstrip("_"), value if isinstance(value, str) else _text(value))
    return element


def _camera_axes(position: str, target: str) -> list[float]:
    """Compute the x and y axes of a camera at `position` that points at `target` with the horizon level."""
    back = np.array(position.split(), float) - np.array(target.split(), float)
    x = np.cross([0.0, 0.0, 1.0], back)
    y = np.cross(back, x)
    return [*(x / math.hypot(*x)), *(y / math.hypot(*y))]


def _inertial(body: ET.Element, inertial: Inertial) -> None:
    _add(body, "inertial", pos=inertial.com, mass=inertial.mass, fullinertia=inertial.inertia)


def _visual(body: ET.Element, kind: str, color: str, **attributes: str | Numbers) -> None:
    _add(body, "geom", class_="visual", type=kind, material=color, **attributes)


def _carried(body: ET.Element, spec: RobotSpec) -> None:
    """Add a body's payloads as visual boxes; the body's inertial already includes their masses."""
    for payload in spec.payloads:
        if payload.body == body.get("name"):
            _visual(body, "box", "payload", pos=payload.position, size=[edge / 2 for edge in payload.size])


def _module(link: ET.Element, i: int, spec: RobotSpec) -> None:
    """Add vectorable rotor i: roll module (φ) and pitch module (θ) with two ducts side by side."""
    roll = _add(link, "body", name=f"gimbal{i}_roll_module", pos=[spec.roll_axis_x, 0, 0])
    _inertial(roll, spec.bodies["roll_module"])
    _add(roll, "joint", name=f"gimbal{i}_roll", class_="gimbal", axis=[1, 0, 0])
    x, _, z = spec.pitch_axis_offset
    _visual(roll, "cylinder", "metal", fromto=[-0.012, 0, 0, 0.030, 0, 0], size=0.024)
    _visual(roll, "box", "metal", pos=[0.012, 0, z / 2 - 0.004], size=[0.014, 0.022, 0.018])
    _visual(roll, "capsule", "rod", fromto=[x, -spec.duct_offset_y, z, x, spec.duct_offset_y, z], size=0.008)
    pitch = _add(roll, "body", name=f"gimbal{i}_pitch_module", pos=spec.pitch_axis_offset)
    _inertial(pitch, spec.bodies["pitch_module"])
    _add(pitch, "joint", name=f"gimbal{i}_pitch", class_="gimbal", axis=[0, 1, 0])
    low, high = spec.duct_z
    for side in (1, -1):
        center = [0, side * spec.duct_offset_y]
        size = [spec.duct_radius, (high - low) / 2]
        _add(pitch, "geom", class_="collision", type="cylinder", pos=[*center, (low + high) / 2], size=size)
        _visual(pitch, "cylinder", "duct", pos=[*center, (low + high) / 2], size=size)
        # A dark disc slightly longer than the duct looks like its opening, which primitives cannot model.
        opening = [spec.propeller_radius, (high - low) / 2 + 0.0008]
        _visual(pitch, "cylinder", "fan", pos=[*center, (low + high) / 2], size=opening)
        _visual(pitch, "ellipsoid", "metal", pos=[*center, high], size=[0.017, 0.017, 0.014])
    _add(pitch, "site", name=f"thrust{i}", pos=[0, 0, 0])


def _junction(parent: ET.Element, i: int, kind: str, spec: RobotSpec, **placement: Numbers) -> ET.Element:
    """Add two-axis joint module i with its peg; return the body behind the yaw axis."""
    junction = _add(parent, "body", name=f"junction{i}", **placement)
    _inertial(junction, spec.bodies[f"{kind}_junction"])
    _add(junction, "joint", name=f"joint{i}_yaw", class_="joint", axis=[0, 0, 1])
    tip = spec.peg_top - spec.peg_length
    _visual(junction, "cylinder", "metal", fromto=[0, 0, -0.026, 0, 0, 0.030], size=0.021)
    _visual(junction, "box", "shell", pos=[spec.yaw_to_pitch / 2, 0, 0], size=[spec.yaw_to_pitch / 2, 0.015, 0.016])
    peg_end = [0, 0, tip + spec.peg_radius]
    _visual(junction, "capsule", "rod", fromto=[0, 0, spec.peg_top, *peg_end], size=spec.peg_radius)
    _add(
        junction, "geom", name=f"peg{i}", class_="collision", type="sphere", pos=peg_end, size=spec.peg_radius,
        friction=[spec.peg_friction, 0.005, 0.0001], **FOOT_CONTACT,
    )  # fmt: skip
    _add(junction, "site", name=f"peg{i}", pos=[0, 0, tip])
    return junction


def _link(junction: ET.Element, i: int, kind: str, spec: RobotSpec) -> ET.Element:
    """Add link i behind its pitch axis, with rod, battery and rotor module; return its body."""
    link = _add(junction, "body", name=f"link{i}", pos=[spec.yaw_to_pitch, 0, 0])
    _inertial(link, spec.inertial(f"link{i}", f"{kind}_link"))
    _add(link, "joint", name=f"joint{i}_pitch", class_="joint", axis=[0, 1, 0])
    end = spec.pitch_to_yaw if kind == "inner" else spec.pitch_to_foot
    _visual(link, "cylinder", "metal", fromto=[0, -0.026, 0, 0, 0.026, 0], size=0.020)
    _visual(link, "capsule", "rod", fromto=[0, 0, 0, end, 0, 0], size=spec.rod_radius)
    battery = spec.inner_battery if kind == "inner" else spec.outer_battery
    length, width, height = (edge / 2 for edge in spec.battery_size)
    # Turned by −90° about x: the battery's y axis becomes the link's −z axis.
    _visual(link, "box", "battery", pos=battery, size=[length, height, width])
    _module(link, i, spec)
    _carried(link, spec)
    return link


def mjcf(spec: RobotSpec = ROBOT) -> str:
    """Generate the MJCF of the robot alone (scenes are composed at load time).

    Args:
        spec: The robot.

    Returns:
        The file's text: torso with the free joint `root`, then leg by leg, the joints named as on the real robot,
        one thrust site per rotor, actuators thrust1 … 8, the 16 joint servos, the 16 vectoring servos in this order.
    """
    root = ET.Element("mujoco", model="spidar")
    root.append(ET.Comment(" Written by `spidar assets` from spidar_gym/robot.py: edit that, not this. "))
    _add(root, "compiler", angle="radian", autolimits="true")
    _add(
        root, "option", timestep=0.0025, integrator="implicitfast", cone="elliptic", impratio=10, jacobian="dense",
        tolerance=1e-8, gravity=[0, 0, -GRAVITY],
    )  # fmt: skip
    default = _add(_add(root, "default"), "default", class_="spidar")
    stop = [-spec.joint_stop, spec.joint_stop]
    _add(
        _add(default, "default", class_="joint"), "joint", range=stop, armature=spec.joint_armature,
        damping=spec.joint_damping, frictionloss=spec.joint_friction,
    )  # fmt: skip
    _add(_add(default, "default", class_="gimbal"), "joint", armature=spec.vectoring_armature, damping=0.02)
    _add(_add(default, "default", class_="visual"), "geom", contype="0", conaffinity="0", group="2", mass="0")
    _add(
        _add(default, "default", class_="collision"), "geom", contype="0", conaffinity="1", group="3", mass="0",
        friction=[spec.peg_friction, 0.005, 0.0001], solref="0.006 1",
    )  # fmt: skip
    _add(default, "site", group="4", size="0.01")
    asset = _add(root, "asset")
    for name, rgba in _colors(spec).items():
        _add(asset, "material", name=name, rgba=rgba, specular="0.3", shininess="0.4")

    torso = _add(_add(root, "worldbody"), "body", name="torso", childclass="spidar")
    _add(torso, "freejoint", name="root")
    _inertial(torso, spec.inertial("torso", "torso"))
    for name, (position, target) in CAMERAS.items():
        _add(torso, "camera", name=name, mode="trackcom", pos=position, xyaxes=_camera_axes(position, target))
    half = spec.torso_height / 2
    _add(torso, "geom", name="torso", class_="collision", type="cylinder", size=[spec.torso_radius, half])
    _visual(torso, "cylinder", "shell", size=[0.146, 0.020], pos=[0, 0, -0.0155])
    _visual(torso, "cylinder", "rod", size=[spec.torso_radius, 0.004], pos=[0, 0, -0.040])
    _visual(torso, "box", "rod", size=[0.055, 0.045, 0.016], pos=[0, 0, 0.020])
    _visual(torso, "box", "metal", size=[0.044, 0.025, 0.015], pos=[0, 0.0899, 0.018])
    _visual(torso, "box", "rubber", size=[0.030, 0.012, 0.003], pos=[0.100, 0, 0.0055])
    _carried(torso, spec)
    _add(torso, "site", name="imu", pos=spec.flight_controller)
    for leg in range(N_LEGS):
        inner, outer = 2 * leg + 1, 2 * leg + 2
        azimuth = spec.leg_azimuth(leg)
        signs = (math.copysign(1, math.cos(azimuth)), math.copysign(1, math.sin(azimuth)))
        hip = [signs[0] * spec.yaw_axis_xy, signs[1] * spec.yaw_axis_xy, spec.yaw_axis_z]
        turn = [math.cos(azimuth / 2), 0, 0, math.sin(azimuth / 2)]
        inner_link = _link(_junction(torso, inner, "inner", spec, pos=hip, quat=turn), inner, "inner", spec)
        knee = _junction(inner_link, outer, "outer", spec, pos=[spec.pitch_to_yaw, 0, 0])
        outer_link = _link(knee, outer, "outer", spec)
        foot = [spec.pitch_to_foot, 0, 0]
        _visual(outer_link, "sphere", "rubber", pos=foot, size=spec.foot_radius)
        _add(
            outer_link, "geom", name=f"foot{leg + 1}", class_="collision", type="sphere", pos=foot,
            size=spec.foot_radius, friction=[spec.foot_friction, 0.02, 0.001], **FOOT_CONTACT,
        )  # fmt: skip
        _add(outer_link, "site", name=f"foot{leg + 1}", pos=foot)

    actuator = _add(root, "actuator")
    limits = [0, spec.max_thrust]
    for name in ROTOR_SITES:
        _add(
            actuator, "general", name=name, site=name, gear=[0, 0, 1, 0, 0, 0], ctrlrange=limits,
            dyntype="filterexact", dynprm=spec.thrust_lag, actrange=limits,
        )  # fmt: skip
    for name in JOINT_NAMES:
        _add(
            actuator, "pid", name=name, joint=name, input="pos", kp=spec.joint_kp, kv=spec.joint_kd,
            slewmax=spec.joint_speed, ctrlrange=[-spec.joint_limit, spec.joint_limit],
            forcerange=[-spec.max_joint_torque, spec.max_joint_torque],
        )  # fmt: skip
    for name in GIMBAL_NAMES:
        _add(
            actuator, "pid", name=name, joint=name, input="pos", kp=spec.vectoring_kp, kv=spec.vectoring_kd,
            slewmax=spec.max_vectoring_speed, forcerange=[-spec.max_vectoring_torque, spec.max_vectoring_torque],
        )  # fmt: skip
    return _serialise(root)


def _serialise(root: ET.Element) -> str:
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _urdf_link(root: ET.Element, body: ET.Element) -> None:
    """Add one URDF link with the inertial and the geoms of an MJCF body."""
    link = _add(root, "link", name=body.get("name", ""))
    source = body.find("inertial")
    assert source is not None
    inertial = _add(link, "inertial")
    _add(inertial, "origin", xyz=source.get("pos", ""), rpy="0 0 0")
    _add(inertial, "mass", value=source.get("mass", ""))
    xx, yy, zz, xy, xz, yz = source.get("fullinertia", "").split()
    _add(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy=xy, ixz=xz, iyz=yz)
    for geom in body.findall("geom"):
        if geom.get("type") == "ellipsoid":
            continue  # URDF has no ellipsoid; it is only the hub of a fan.
        role = "visual" if geom.get("class") == "visual" else "collision"
        element = _add(link, role)
        size = [float(v) for v in geom.get("size", "").split()]
        position, rpy = geom.get("pos", "0 0 0"), [0.0, 0.0, 0.0]
        length = 2 * size[-1]
        if fromto := geom.get("fromto"):
            ends = np.array(fromto.split(), float)
            axis = ends[3:] - ends[:3]
            position, length = _text((ends[:3] + ends[3:]) / 2), float(math.hypot(*axis))
            if length > 0.0:
                rpy = [-math.atan2(axis[1], math.hypot(axis[0], axis[2])), math.atan2(axis[0], axis[2]), 0.0]
        _add(element, "origin", xyz=position, rpy=rpy)
        geometry = _add(element, "geometry")
        if geom.get("type") == "box":
            _add(geometry, "box", size=[2 * s for s in size])
        elif geom.get("type") == "sphere":
            _add(geometry, "sphere", radius=size[0])
        else:
            _add(geometry, "cylinder", radius=size[0], length=length)
        if role == "visual":
            _add(element, "material", name=geom.get("material", ""))


def _urdf_fixed(root: ET.Element, parent: str, name: str, position: str) -> None:
    _add(root, "link", name=name)
    joint = _add(root, "joint", name=f"{name}_fixed", type="fixed")
    _add(joint, "parent", link=parent)
    _add(joint, "child", link=name)
    _add(joint, "origin", xyz=position, rpy="0 0 0")


def urdf(spec: RobotSpec = ROBOT) -> str:
    """Generate the URDF of the robot: the same bodies, joints, inertials and frames as the MJCF, for ROS tools."""
    root = ET.Element("robot", name="spidar")
    root.append(ET.Comment(" Written by `spidar assets` from spidar_gym/robot.py: edit that, not this. "))
    for name, rgba in _colors(spec).items():
        _add(_add(root, "material", name=name), "color", rgba=rgba)
    world = ET.fromstring(mjcf(spec)).find("worldbody")
    assert world is not None

    def visit(body: ET.Element, parent: str | None) -> None:
        name = body.get("name", "")
        _urdf_link(root, body)
        joint = body.find("joint")
        if parent is not None and joint is not None:
            gimbal = joint.get("class") == "gimbal"
            element = _add(root, "joint", name=joint.get("name", ""), type="continuous" if gimbal else "revolute")
            _add(element, "parent", link=parent)
            _add(element, "child", link=name)
            w, _, _, z = (float(v) for v in body.get("quat", "1 0 0 0").split())
            _add(element, "origin", xyz=body.get("pos", "0 0 0"), rpy=[0, 0, 2 * math.atan2(z, w)])
            _add(element, "axis", xyz=joint.get("axis", ""))
            if gimbal:
                _add(element, "limit", effort=spec.max_vectoring_torque, velocity=spec.max_vectoring_speed)
            else:
                stop, speed = spec.joint_stop, spec.joint_speed
                _add(element, "limit", lower=-stop, upper=stop, effort=spec.max_joint_torque, velocity=speed)
                _add(element, "dynamics", damping=spec.joint_damping, friction=spec.joint_friction)
        for site in body.findall("site"):
            _urdf_fixed(root, name, site.get("name", ""), site.get("pos", "0 0 0"))
        for child in body.findall("body"):
            visit(child, name)

    torso = world.find("body")
    assert torso is not None
    visit(torso, None)
    return _serialise(root)


def generated_files() -> dict[str, str]:
    """Generate every asset: path relative to assets/ → text (`InvalidValueError` for other counts of joints)."""
    require_kind()
    return {**robot_files(ROBOT), "README.md": assets_readme()}


def robot_files(spec: RobotSpec) -> dict[str, str]:
    """Generate MJCF and URDF of a robot: path → text."""
    return {"mjcf/spidar.xml": mjcf(spec), "urdf/spidar.urdf": urdf(spec)}


def assets_dir() -> Path:
    """Return the folder of the committed assets, in a checkout or in an installed wheel."""
    return ROOT / "assets"


@lru_cache(maxsize=64)
def _written(spec: RobotSpec) -> str:
    return mjcf(spec)


def mjcf_path() -> Path:
    """Return the path of assets/mjcf/spidar.xml, the model that both engines load.

    Raises:
        StaleAssetError: The file is missing or differs from what the robot description generates.
    """
    path = assets_dir() / "mjcf" / "spidar.xml"
    text = path.read_text(encoding="utf-8") if path.is_file() else None
    if text != _written(ROBOT):
        raise StaleAssetError(path, cause=differences(ROBOT) if text == mjcf(RobotSpec()) else "")
    return path


def model_text(spec: RobotSpec) -> str:
    """Return the MJCF of a robot; for the nominal robot the committed file (`StaleAssetError` as `mjcf_path`)."""
    return mjcf_path().read_text(encoding="utf-8") if spec == ROBOT else _written(spec)


@contextmanager
def model_file(spec: RobotSpec) -> Iterator[Path]:
    """Yield a file with the MJCF of a robot; for another robot than the nominal one the file is temporary."""
    if spec == ROBOT:
        yield mjcf_path()
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "spidar.xml"
        path.write_text(model_text(spec), encoding="utf-8")
        yield path


def model_hash(spec: RobotSpec = ROBOT) -> str:
    """Compute the SHA-256 of a robot's model file."""
    return hashlib.sha256(model_text(spec).encode()).hexdigest()
