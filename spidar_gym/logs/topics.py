"""Topics of a record: their arrays with unit and frame, and the ROS 1 messages that hold them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

from spidar_gym.logs.ros1 import SEPARATOR, VARIABLE, Field, parse
from spidar_gym.native.constants import MAX_ACTION
from spidar_gym.onboard.messages import (
    ARM_OFF,
    ARM_ON,
    COMMANDS,
    DEFINITIONS,
    FEEDBACK,
    FORCE_LANDING,
    ORDERS,
    STATE_NAMES,
)
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS, field_docs
from spidar_gym.state import Reference, RobotState

PACKAGE = "spidar_gym"
"""Package of this project's message types."""
ANY = None
"""Shape of a column whose number of entries is that of the messages."""


@dataclass(frozen=True)
class Column:
    """One array of a series."""

    name: str
    """Name in `Series.values`."""
    leaves: tuple[str, ...]
    """Paths of the values in the message, one for each entry or one for all; alternatives are separated by `|`."""
    unit: str
    """Unit; 1 for numbers without one, empty for text."""
    doc: str
    """Contents and frame."""
    shape: tuple[int, ...] | None = ()
    """Shape of the values of a message, or `ANY`."""
    order: tuple[int, ...] = ()
    """Indices of the entries in the message, where their order differs."""
    kind: str = "float64"
    """ROS type of an entry: whole numbers stay whole, `string` is text."""

    @property
    def words(self) -> str:
        """Unit and contents, for the metadata of files."""
        return f"{self.unit}; {self.doc}" if self.unit else self.doc


@dataclass(frozen=True)
class Format:
    """Message of a topic, and the columns that it holds."""

    topic: str
    """Name without the namespace."""
    kind: str
    """ROS type."""
    columns: tuple[Column, ...]
    """Columns in the order of the message."""
    doc: str
    """Contents."""
    rate: float = 0.0
    """Usual rate [Hz]; 0 for a topic without a fixed rate."""
    frame: str = ""
    """Frame of the values, `header.frame_id`."""
    names: tuple[str, ...] = ()
    """Names of the entries of messages that have none."""

    def column(self, name: str) -> Column:
        """Return a column by name (`KeyError` if there is none)."""
        return {column.name: column for column in self.columns}[name]


# Messages of the robot.


def _quat(front: str) -> Column:
    leaves = tuple(f"{front}.{axis}" for axis in "wxyz")
    return Column("quat_wb", leaves, "1", "attitude of the torso in the world (w, x, y, z)", (4,))


def _vector(name: str, front: str, unit: str, doc: str) -> Column:
    return Column(name, tuple(f"{front}.{axis}" for axis in "xyz"), unit, doc, (3,))


def _data(unit: str, doc: str, kind: str) -> tuple[Column]:
    return (Column("data", ("data",), unit, doc, kind=kind),)


_JOINTS = (
    Column("position", ("position",), "rad", "angle of each named joint or gimbal", ANY),
    Column("velocity", ("velocity",), "rad/s", "rate of each named joint or gimbal", ANY),
    Column("effort", ("effort",), "Nm", "torque of each named joint; in `joints_torque_ctrl` its limit", ANY),
)
COLUMNS: dict[str, tuple[Column, ...]] = {
    "sensor_msgs/JointState": _JOINTS,
    "spinal/Imu": (
        # The names of these values differ between SPIDAR's branch of the lab's software and its HEAD.
        Column("specific_force", ("acc_data|acc",), "m/s²", "acceleration minus gravity, torso axes", (3,)),
        Column("angular_velocity", ("gyro_data|gyro",), "rad/s", "angular velocity of the torso, torso axes", (3,)),
        Column("magnetic_field", ("mag_data|mag",), "T", "magnetic flux density, torso axes", (3,)),
        Column("angles", ("angles",), "rad", "roll, pitch, yaw", (3,)),
        Column(
            "quat_wb",
            ("quaternion",),
            "1",
            "attitude of the torso (w, x, y, z), in messages (x, y, z, w)",
            (4,),
            order=(3, 0, 1, 2),
        ),
    ),
    "geometry_msgs/PoseStamped": (
        _vector("position_w", "pose.position", "m", "position in the world"),
        _quat("pose.orientation"),
    ),
    "nav_msgs/Odometry": (
        _vector("position_w", "pose.pose.position", "m", "position in the world"),
        _quat("pose.pose.orientation"),
        _vector("velocity_w", "twist.twist.linear", "m/s", "velocity in the world"),
        _vector("omega_b", "twist.twist.angular", "rad/s", "angular velocity, torso axes"),
    ),
    "std_msgs/UInt8": _data("1", "code", "uint8"),
    "std_msgs/Float32": _data("V", "voltage", "float32"),
    "std_msgs/String": _data("", "text", "string"),
    "std_msgs/Empty": (),
    "spinal/FourAxisCommand": (
        Column("angles", ("angles",), "rad", "attitude for the flight controller to stabilise", (3,)),
        Column("base_thrust", ("base_thrust",), "N", "thrust of each module", ANY),
    ),
    "spinal/FlightConfigCmd": (
        Column(
            "cmd", ("cmd",), "1", f"{ARM_ON} ARM_ON, {ARM_OFF} ARM_OFF, {FORCE_LANDING} FORCE_LANDING", kind="uint8"
        ),
    ),
    "spinal/ServoStates": (
        Column("index", ("servos[].index",), "1", "number of each servo", ANY, kind="uint8"),
        Column("angle", ("servos[].angle",), "1", "encoder count of each servo", ANY, kind="int16"),
        Column("temperature", ("servos[].temp",), "°C", "temperature of each servo", ANY, kind="uint8"),
        Column("load", ("servos[].load",), "1", "load of each servo, as reported", ANY, kind="int16"),
        Column("error", ("servos[].error",), "1", "error bits of each servo", ANY, kind="uint8"),
    ),
    "spinal/Pwms": (
        Column("motor_value", ("motor_value",), "µs", "length of each module's signal, of 2000", ANY, kind="uint16"),
    ),
}
"""ROS type → columns."""
_NAMES = {"joint_states": STATE_NAMES, "gimbals_ctrl": GIMBAL_NAMES, "joints_ctrl": JOINT_NAMES,
          "joints_torque_ctrl": JOINT_NAMES}  # fmt: skip
_FRAMES: dict[str, str] = dict.fromkeys(("mocap/pose", "uav/cog/odom", "uav/baselink/odom"), "world")


# This project's messages: definitions and columns are generated from the same rows.


def _row(kind: str, name: str, unit: str, doc: str, shape: tuple[int, ...] = ()) -> Column:
    return Column(name, (name,), unit, doc, shape, kind=kind)


def _rows(sample: Any, **docs: str) -> tuple[Column, ...]:  # noqa: ANN401 - a dataclass
    """Return a column for every field of a shared struct, apart from its time."""
    found, texts = [], field_docs(type(sample)) | docs
    for field in fields(sample):
        value, text = np.asarray(getattr(sample, field.name)), texts[field.name].rstrip(".")
        if field.name == "time":
            continue
        unit = re.findall(r" ?\[([^\]]+)\]", text)
        kind = {"U": "string", "b": "uint8"}.get(value.dtype.kind, "float64")
        doc = re.sub(r" \[[^\]]+\]", "", text)
        found.append(_row(kind, field.name, "" if kind == "string" else (unit or ["1"])[-1], doc, value.shape))
    return tuple(found)


_STATE = _rows(
    RobotState.at_rest(np.zeros(N_JOINTS)), thrust="λ: of a true state delivered by the modules, else commanded [N]"
)
_ZERO = np.zeros(3)
OWN: dict[str, tuple[str, tuple[Column, ...]]] = {
    "State": ("State of the robot at one instant.", _STATE),
    "Reference": (
        "Desired motion of the robot at one instant.",
        _rows(Reference(_ZERO, np.zeros(4), _ZERO, _ZERO, np.zeros(N_JOINTS))),
    ),
    "Allocation": (
        "Allocation of one control tick.",
        (
            _row("float64", "forces_l", "N", "force of each rotor, axes of its link", (N_ROTORS, 3)),
            _row("float64", "joint_torques", "Nm", "torque of each joint", (N_JOINTS,)),
            _row("uint8", "status", "1", "code of the status"),
            _row("string", "status_text", "", "status of the solution"),
            _row("int32", "iterations", "1", "iterations of the solver"),
        ),
    ),
    "Status": (
        "Stage and fault of the runner after one tick.",
        (
            _row("uint8", "action", "1", "0 silent, 1 publishes, 2 forces the landing"),
            _row("uint8", "stage", "1", "code of the stage"),
            _row("string", "stage_text", "", "stage"),
            _row("uint8", "fault", "1", "code of the fault, 0 for none"),
            _row("string", "fault_text", "", "fault"),
            _row("uint8", "phase", "1", "code of the phase of the gait"),
            _row("string", "phase_text", "", "phase of the gait"),
            _row("uint8", "manager_phase", "1", "code of the phase of a course"),
            _row("string", "manager_phase_text", "", "phase of a course"),
            _row("uint8", "heard", "1", "orders of the tick: 0 none, 1 taken, 2 refused"),
            _row("uint8", "finished", "1", "whether the mission is over"),
            _row("uint8", "aborted", "1", "whether excitations were ended: a joint was too far from its command"),
            _row("int32", "to_do", "1", "number of pending orders"),
            _row("int32", "timeouts", "1", "number of phases ended by time-out"),
            _row("float64", "mission_time", "s", "time since the take-over, 0 before"),
        ),
    ),
    "Timing": (
        "Timing of one tick of the runner.",
        (
            _row("float64", "wait_us", "µs", "delay of the tick, negative without a clock"),
            _row("float64", "compute_us", "µs", "computing time of the tick"),
        ),
    ),
    "Policy": (
        "Learned policy at one tick.",
        (_row("float64", "action", "1", "action after its limits, padded with 0", (MAX_ACTION,)),),
    ),
}  # fmt: skip
"""This project's message types: their contents and columns."""
COLUMNS |= {f"{PACKAGE}/{name}": columns for name, (_, columns) in OWN.items()}


def _formats() -> Iterator[Format]:
    for topic in (*FEEDBACK, *COMMANDS, ORDERS):
        name, frame = topic.name, _FRAMES.get(topic.name, "")
        yield Format(name, topic.kind, COLUMNS[topic.kind], topic.doc, topic.rate, frame, _NAMES.get(name, ()))
    for name, kind, doc in (
        ("runner/other_command", "spinal/FourAxisCommand", "rotor command of another node, as the runner received it"),
        ("runner/estimate", f"{PACKAGE}/State", "state that the controller uses"),
        ("runner/reference", f"{PACKAGE}/Reference", "desired motion"),
        ("runner/allocation", f"{PACKAGE}/Allocation", "allocated forces of the rotors and torques of the joints"),
        ("runner/status", f"{PACKAGE}/Status", "stage, fault and phase"),
        ("runner/timing", f"{PACKAGE}/Timing", "delay and computing time of the tick"),
        ("runner/policy", f"{PACKAGE}/Policy", "action of the learned policy"),
        ("runner/events", "std_msgs/String", "take-over, faults, phases, orders, end of the mission, as text"),
        ("truth/state", f"{PACKAGE}/State", "true state of a simulated robot"),
    ):
        yield Format(name, kind, COLUMNS[kind], doc)


FORMATS = {each.topic: each for each in _formats()}
"""Topic → its format, in the order of files."""


# Definitions.

_STANDARD = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id",
    "std_msgs/UInt8": "uint8 data",
    "std_msgs/Float32": "float32 data",
    "std_msgs/String": "string data",
    "std_msgs/Empty": "",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/PoseStamped": "Header header\nPose pose",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
    "geometry_msgs/TwistWithCovariance": "Twist twist\nfloat64[36] covariance",
    "nav_msgs/Odometry": "Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
    "geometry_msgs/TwistWithCovariance twist",
    "sensor_msgs/JointState": "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
}
HEAD_IMU = "time stamp\nfloat32[3] acc\nfloat32[3] gyro\nfloat32[3] mag\nfloat32[4] quaternion"
"""`spinal/Imu` of the lab's present software: other names, and a quaternion (x, y, z, w) in place of angles."""


def _commented(kind: str, text: str) -> str:
    """Add unit and contents of the columns to a definition, as comments."""
    notes = {leaf: column.words for column in COLUMNS.get(kind, ()) for leaf in column.leaves[0].split("|")}
    lines = (f"{line}  # {notes[line.split()[1]]}" if line.split()[1:] and line.split()[1] in notes else line
             for line in text.splitlines())  # fmt: skip
    return "\n".join(lines)


def _text(kind: str, *, head: bool = False) -> str:
    """Return the definition of a type, without those that it uses."""
    package, _, name = kind.partition("/")
    if package == PACKAGE:
        doc, columns = OWN[name]
        lines = [f"# {doc}", "time stamp"]
        for column in columns:
            size = int(np.prod(column.shape or (), dtype=int))
            lines += [f"# {column.words}", f"{column.kind}{f'[{size}]' if column.shape else ''} {column.name}"]
        return "\n".join(lines)
    if head:
        return _commented(kind, HEAD_IMU)
    if kind in _STANDARD:
        return _commented(kind, _STANDARD[kind])
    return (DEFINITIONS / f"{name}.msg").read_text("utf-8").rstrip("\n")


def _is_defined(kind: str) -> bool:
    package, _, name = kind.partition("/")
    return kind in _STANDARD or (package == "spinal" and (DEFINITIONS / f"{name}.msg").is_file())


@cache
def definition(kind: str, *, head: bool = False) -> str:
    """Return the whole definition of a type, with those that it uses, as in bags.

    Args:
        kind: ROS type.
        head: Whether `spinal/Imu` is that of the lab's present software.
    """
    main, used = _text(kind, head=head), dict[str, str]()

    def use(user: str, text: str) -> None:
        for line in text.splitlines():
            words = line.partition("#")[0].split()
            base = words[0].partition("[")[0] if words else ""
            full = next(
                (n for n in (base, f"{user.partition('/')[0]}/{base}", f"std_msgs/{base}") if _is_defined(n)), ""
            )
            if full and full not in used:
                used[full] = _text(full)
                use(full, used[full])

    use(kind, main)
    return "\n".join([main, *(f"{SEPARATOR}\nMSG: {name}\n{text}" for name, text in used.items())]) + "\n"


@cache
def message_fields(kind: str, *, head: bool = False) -> tuple[Field, ...]:
    """Return the parsed definition of a type; arguments as for `definition`."""
    return parse(kind, definition(kind, head=head))


def stamp_path(fields_: tuple[Field, ...]) -> str:
    """Return the path of a message's time stamp; empty for messages without one."""
    for field in fields_:
        if field.name == "stamp" and field.kind == "time" and field.count is None:
            return "stamp"
        if field.name == "header" and any(each.name == "stamp" for each in field.inner):
            return "header.stamp"
    return ""


def names_path(fields_: tuple[Field, ...]) -> str:
    """Return the path of the names of a message's entries; empty for messages without names."""
    named = any(each.name == "name" and each.kind == "string" and each.count == VARIABLE for each in fields_)
    return "name" if named else ""
