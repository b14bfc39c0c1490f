"""Interface of the real robot: topics, their ROS types and rates, and the messages on them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.onboard.runner_structs import TOPICS
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES

NAMESPACE = "/spidar"
"""Default namespace of the robot's topics and parameters."""
MODEL_PARAMETER = "spidar_model_sha256"
"""ROS parameter under the namespace: hash of the robot's model."""
STATE_NAMES = (*JOINT_NAMES, *GIMBAL_NAMES)
"""Names of `joint_states`, in its order."""


@dataclass(frozen=True)
class Topic:
    """One topic, under the robot's namespace."""

    name: str
    """Name without the namespace."""
    kind: str
    """ROS type."""
    rate: float
    """Rate [Hz]; 0 for a topic without a fixed rate."""
    doc: str
    """Contents; units are those of the type's columns in `message_types`."""


def _expected(word: str, kind: str, doc: str) -> Topic:
    """Return a topic to which the runner subscribes, with the rate that the runner expects."""
    name, rate = TOPICS[word]
    return Topic(name, kind, rate, doc)


FEEDBACK = (
    _expected("joints", "sensor_msgs/JointState", "angles of 16 joints, then 16 gimbals; torques of the joints"),
    _expected("imu", "spinal/Imu", "acceleration, angular velocity and attitude of the flight controller"),
    _expected("pose", "geometry_msgs/PoseStamped", "pose of the flight controller in the world"),
    _expected("odometry", "nav_msgs/Odometry", "motion of the CoG, attitude and angular velocity of the torso"),
    Topic("uav/baselink/odom", "nav_msgs/Odometry", 100.0, "pose and velocity of the flight controller"),
    Topic(TOPICS["state"][0], "std_msgs/UInt8", CONTROL_RATE, "state of the flight stack"),
    Topic("flight_config_ack", "std_msgs/UInt8", 0.0, "echo of a configuration command"),
    _expected("voltage", "std_msgs/Float32", "voltage of the battery under load"),
    _expected("servos", "spinal/ServoStates", "encoder count, temperature, load and error bits of 32 servos"),
    _expected("motors", "spinal/Pwms", "length of the signal of each of 8 modules, within a period of 2 ms"),
)
"""Topics that the robot publishes."""
COMMANDS = (
    Topic("four_axes/command", "spinal/FourAxisCommand", CONTROL_RATE, "thrusts of the 8 modules"),
    Topic("gimbals_ctrl", "sensor_msgs/JointState", CONTROL_RATE, "angles of 16 gimbals"),
    Topic("joints_ctrl", "sensor_msgs/JointState", CONTROL_RATE, "angles of the joints named"),
    Topic("joints_torque_ctrl", "sensor_msgs/JointState", CONTROL_RATE, "torque limits of the joints named"),
    Topic("flight_config_cmd", "spinal/FlightConfigCmd", 0.0, "command to the flight controller"),
    Topic("teleop_command/start", "std_msgs/Empty", 0.0, "arm"),
    Topic("teleop_command/takeoff", "std_msgs/Empty", 0.0, "take off"),
    Topic("teleop_command/land", "std_msgs/Empty", 0.0, "land"),
    Topic("teleop_command/force_landing", "std_msgs/Empty", 0.0, "force the landing"),
    Topic("teleop_command/halt", "std_msgs/Empty", 0.0, "stop at once"),
)
"""Topics to which the robot subscribes."""
ORDERS = Topic("runner/orders", "std_msgs/String", 0.0, "lines of a course; the first is `now` where they interrupt")
"""Topic of the operator to which the runner subscribes."""


@dataclass(frozen=True)
class Message:
    """One message."""

    topic: str
    """Name of the topic, without the namespace."""
    stamp: float
    """Time by the robot's clock [s]."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Values by field: `name`, `position`, `effort` (JointState); `acc`, `gyro`, `angles` (Imu); `position`, `quat`
    (w, x, y, z), and for odometry `velocity`, `omega`; `thrust` (FourAxisCommand's `base_thrust`); `data` (numbers,
    text); `cmd` (FlightConfigCmd); `index`, `angle`, `temp`, `load`, `error` (ServoStates); `motor_value` (Pwms)."""
