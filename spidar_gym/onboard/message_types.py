"""Types of the robot's messages: definitions in ROS's language, checksums, and the unit of every field."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

DEFINITIONS = Path(__file__).parent / "msg"
"""The lab's message types, `spinal`, as this project defines them."""
ARM_ON, ARM_OFF, FORCE_LANDING = 0, 1, 2
"""Values of `flight_config_cmd`."""
SEPARATOR = "=" * 80
"""Line between the definition of a message and those of the types that it uses."""
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
"""ROS type → columns, the only place of the units of its fields."""

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
    if head:
        return _commented(kind, HEAD_IMU)
    if kind in _STANDARD:
        return _commented(kind, _STANDARD[kind])
    return (DEFINITIONS / f"{kind.partition('/')[2]}.msg").read_text("utf-8").rstrip("\n")


def _is_defined(kind: str) -> bool:
    package, _, name = kind.partition("/")
    return kind in _STANDARD or (package == "spinal" and (DEFINITIONS / f"{name}.msg").is_file())


def _declarations(kind: str, text: str) -> Iterator[tuple[str, str, str]]:
    """Yield type, name, and the full name of a message's type or an empty text, of every field and constant."""
    for line in text.splitlines():
        words = line.partition("#")[0].split(maxsplit=1)
        if words:
            base = words[0].partition("[")[0]
            names = (base, f"{kind.partition('/')[0]}/{base}", f"std_msgs/{base}")
            yield words[0], words[1].strip(), next(filter(_is_defined, names), "")


@cache
def definition(kind: str, *, head: bool = False) -> str:
    """Return the whole definition of a type, with those that it uses, as in bags.

    Args:
        kind: ROS type.
        head: Whether `spinal/Imu` is that of the lab's present software.
    """
    main, used = _text(kind, head=head), dict[str, str]()

    def use(user: str, text: str) -> None:
        for _, _, full in _declarations(user, text):
            if full and full not in used:
                used[full] = _text(full)
                use(full, used[full])

    use(kind, main)
    return "\n".join([main, *(f"{SEPARATOR}\nMSG: {name}\n{text}" for name, text in used.items())]) + "\n"


@cache
def checksum(kind: str, *, head: bool = False) -> str:
    """Return the MD5 by which ROS 1 compares definitions; arguments as for `definition`."""
    constants, fields = list[str](), list[str]()
    for type_, name, full in _declarations(kind, _text(kind, head=head)):
        words, is_constant, value = name.partition("=")
        if is_constant:
            constants.append(f"{type_} {words.strip()}={value.strip()}")
        else:
            fields.append(f"{checksum(full) if full else type_} {name}")
    return hashlib.md5("\n".join([*constants, *fields]).encode(), usedforsecurity=False).hexdigest()


@cache
def leaf_types(kind: str, *, head: bool = False) -> dict[str, str]:
    """Return the path of every value of a type without fields of its own → its type; `[]` marks arrays of messages."""
    found = dict[str, str]()
    for type_, name, full in _declarations(kind, _text(kind, head=head)):
        if full:
            front = f"{name}{'[]' if '[' in type_ else ''}."
            found |= {front + path: each for path, each in leaf_types(full).items()}
        elif "=" not in name:
            found[name] = type_
    return found
