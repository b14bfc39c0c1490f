"""ROS types of the messages, and conversion of their values to and from ROS."""

import importlib
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from spidar_gym.onboard.health import SERVO_FIELDS
from spidar_gym.onboard.message_types import definition
from spidar_gym.onboard.messages import COMMANDS, FEEDBACK, ORDERS

KINDS = {topic.name: topic.kind for topic in (*FEEDBACK, *COMMANDS, ORDERS)}
"""Topic → ROS type."""
RosMessage = Any
"""A message of a class that rospy creates at run time."""


def message_types() -> dict[str, Any]:
    """Return ROS type → class; classes of `spinal` are created from this project's definitions."""
    dynamic = importlib.import_module("genpy.dynamic")
    types = {}
    for kind in set(KINDS.values()):
        package, name = kind.split("/")
        if package == "spinal":
            types[kind] = dynamic.generate_dynamic(kind, definition(kind))[kind]
        else:
            types[kind] = getattr(importlib.import_module(f"{package}.msg"), name)
    return types


def _fill_joints(message: RosMessage, values: dict[str, Any]) -> None:
    message.name = values.get("name", [])
    message.position, message.effort = values.get("position", []), values.get("effort", [])


def _fill_imu(message: RosMessage, values: dict[str, Any]) -> None:
    message.acc_data, message.gyro_data = values["acc"], values["gyro"]
    message.angles = values.get("angles", [0.0, 0.0, 0.0])


def _fill_pose(message: RosMessage, values: dict[str, Any]) -> None:
    pose = message.pose
    pose.position.x, pose.position.y, pose.position.z = values["position"]
    pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z = values["quat"]


def _fill_odometry(message: RosMessage, values: dict[str, Any]) -> None:
    _fill_pose(message.pose, values)
    twist = message.twist.twist
    twist.linear.x, twist.linear.y, twist.linear.z = values["velocity"]
    twist.angular.x, twist.angular.y, twist.angular.z = values["omega"]


def _fill_servos(message: RosMessage, values: dict[str, Any]) -> None:
    rows = zip(*(values[name] for name in SERVO_FIELDS), strict=True)
    message.servos = [SimpleNamespace(**dict(zip(SERVO_FIELDS, row, strict=True))) for row in rows]


def _copy(field: str, key: str) -> Callable[[RosMessage, dict[str, Any]], None]:
    return lambda message, values: setattr(message, field, values[key])


FILL: dict[str, Callable[[Any, dict[str, Any]], None]] = {
    "sensor_msgs/JointState": _fill_joints,
    "spinal/Imu": _fill_imu,
    "geometry_msgs/PoseStamped": _fill_pose,
    "nav_msgs/Odometry": _fill_odometry,
    "std_msgs/UInt8": _copy("data", "data"),
    "std_msgs/Float32": _copy("data", "data"),
    "std_msgs/String": _copy("data", "data"),
    "std_msgs/Empty": lambda message, values: None,
    "spinal/FourAxisCommand": _copy("base_thrust", "thrust"),
    "spinal/ServoStates": _fill_servos,
    "spinal/Pwms": _copy("motor_value", "motor_value"),
    "spinal/FlightConfigCmd": _copy("cmd", "cmd"),
}
"""Type → function that writes values into a message."""
READ: dict[str, Callable[[RosMessage], dict[str, Any]]] = {
    "sensor_msgs/JointState": lambda m: {key: list(getattr(m, key)) for key in ("name", "position", "effort")},
    "std_msgs/Empty": lambda m: {},
    "spinal/FourAxisCommand": lambda m: {"thrust": list(m.base_thrust)},
    "spinal/FlightConfigCmd": lambda m: {"cmd": m.cmd},
}
"""Type → function that reads the values of a message."""
