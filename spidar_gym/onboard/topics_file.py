"""The file `topics.toml` of an export: topics of the runner, as needed for a link to another middleware."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import spidar_gym
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.onboard.health import HEALTH_TOPICS
from spidar_gym.onboard.message_types import (
    ARM_OFF,
    ARM_ON,
    COLUMNS,
    FORCE_LANDING,
    Column,
    checksum,
    definition,
    leaf_types,
)
from spidar_gym.onboard.messages import COMMANDS, FEEDBACK, MODEL_PARAMETER, NAMESPACE, ORDERS, Topic
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.onboard.runner_structs import RATE_TOLERANCE, TOPICS, Action, FlightState, log_layouts
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, ROBOT, RobotSpec
from spidar_gym.robot.description import model_hash

NAMES = {"joints": JOINT_NAMES, "gimbals": GIMBAL_NAMES}
"""Names of the entries of `sensor_msgs/JointState`."""
ALWAYS, MOCAP, LAB, NEVER = "always", "estimate mocap", "estimate odometry", "never"
"""When the runner requires a topic: of every mission, of one with this line, or of none."""
INPUT, OUTPUT = "sp_loop_input", "sp_loop_output"
"""Structs of a tick in C."""
MESSAGES = "messages since the last tick, oldest first; if more came than the arrays hold, the newest"
NEW = "1 if a message came since the last tick, else 0"
ENTRIES = "entries of the newest message"
FRONT = """\
# Topics of SPIDAR's runner: types, rates, fields, units, and the members of the structs in C. `spidar export` wrote
# this file from the tables in spidar_gym/onboard. It describes the robot's interface in ROS 1; runner/ros1.cpp
# implements it.
#
# A link for another middleware converts these messages, and is otherwise like runner/ros1.cpp: sp_run_open; sp_agree
# and sp_say_absent with an sp_found (model, names of joint_states, measured rates); then, at control_rate, sp_run_tick
# with the messages since the last tick; at the end sp_run_close. runner/runner.h declares these functions. A link that
# ends while the runner drives publishes flight_config_cmd first.
#
# A member keeps its value until the next message. Before the first one angles of joints and gimbals are NaN,
# flight_state is -1, encoder_time, flight_state_time and the times of health are -1e9, all other members 0. The members
# time and measurement.time are now. All times are seconds by the clock of the stamps, since any instant. If the names
# of joint_states differ from those at start, the link takes no angle from the message, and joint_position is NaN in
# that tick.
#
# [[topic]]
#   direction  "in": from the robot, under its namespace; "out": from the runner, under the namespace of --out
#   rate       usual rate, or that of the runner's commands [Hz]; without it there is none
#   accepted   smallest and largest rate at start with which the runner accepts the robot [Hz]; without it any
#   required   "always", "never", or the line of a mission which requires the topic at start
#   action     word of [values.action] in sp_loop_output.action with which the runner publishes the topic
#   struct     struct of the members
#   time       path of the time stamp, and its member; without a path the member is the time of receipt
#   count      member that the link sets, and what it counts
#   fields     what the runner reads or writes: paths in the message, in the order of the member's entries; type; unit,
#              "1" for a number without one; [names] of the entries; member, and its size if it is an array; or a value
#   paths_head the paths in the lab's present software, where they differ
# [[type]]     definition in ROS's language, and the MD5 by which ROS 1 compares definitions; head: of the lab's present
#              software
"""
"""Comment at the top of the file."""


@dataclass(frozen=True)
class Use:
    """A field that the runner reads from a message or writes to it."""

    column: str
    """Column of the message's type."""
    member: str = ""
    """Member of the struct in C; empty for a constant."""
    names: str = ""
    """Names of the entries, of `NAMES`; empty if the order is that of the member."""
    value: float | int | None = None
    """Value of a constant."""


@dataclass(frozen=True)
class Port:
    """A topic of the runner, and where its values are in C."""

    topic: Topic
    """Topic."""
    uses: tuple[Use, ...]
    """Fields that the runner reads or writes."""
    time: str = ""
    """Member for the time of the message; empty if there is none."""
    count: tuple[str, str] | None = None
    """Member that counts messages or entries, and its meaning."""
    required: str = NEVER
    """When the runner requires a received topic."""
    doc: str = ""
    """Contents; those of the topic if empty."""
    action: Action | None = None
    """Action with which the runner publishes the topic; None for a received one."""


_FEEDBACK: Mapping[str, Topic] = {topic.name: topic for topic in FEEDBACK}
_COMMANDS: Mapping[str, Topic] = {topic.name: topic for topic in COMMANDS}


def _heard(word: str, *uses: Use, **options: Any) -> Port:  # noqa: ANN401 - fields of Port
    """Return a port of one of `TOPICS`."""
    return Port(_FEEDBACK[TOPICS[word][0]], uses, **options)


PORTS = (
    _heard(
        "joints",
        Use("position", "measurement.joint_position", "joints"),
        Use("position", "measurement.vectoring", "gimbals"),
        Use("effort", "measurement.joint_torque", "joints"),
        time="measurement.encoder_time", required=ALWAYS,
    ),
    _heard(
        "imu",
        Use("specific_force", "measurement.specific_force_b"),
        Use("angular_velocity", "measurement.gyro_b"),
        time="measurement.imu_time", count=("measurement.imu_count", MESSAGES), required=MOCAP,
    ),
    _heard(
        "pose",
        Use("position_w", "measurement.pose_position_w"),
        Use("quat_wb", "measurement.pose_quat_wb"),
        time="measurement.pose_time", count=("measurement.pose_count", MESSAGES), required=MOCAP,
    ),
    _heard(
        "odometry",
        Use("position_w", "odometry.position_w"),
        Use("quat_wb", "odometry.quat_wb"),
        Use("velocity_w", "odometry.velocity_w"),
        Use("omega_b", "odometry.omega_b"),
        time="odometry.time", count=("has_odometry", NEW), required=LAB,
    ),
    _heard("state", Use("data", "flight_state"), time="flight_state_time", required=ALWAYS),
    _heard("voltage", Use("data", "health.voltage"), time="health.voltage_time"),
    _heard(
        "servos",
        Use("index"),
        Use("angle", "health.servo_angle"),
        Use("temperature", "health.servo_temperature"),
        Use("load", "health.servo_load"),
        Use("error", "health.servo_error"),
        time="health.servo_time", count=("health.servo_count", ENTRIES),
    ),
    _heard(
        "motors", Use("motor_value", "health.motor_output"),
        time="health.motor_time", count=("health.motor_count", ENTRIES),
    ),
    Port(
        _COMMANDS["four_axes/command"], (Use("base_thrust", "thrust"),), count=("has_thrust", NEW),
        doc="thrusts commanded by another node; ignored unless 8, and in a dry run while the runner drives",
    ),
    Port(ORDERS, (Use("data", "orders"),)),
    Port(
        _COMMANDS["four_axes/command"], (Use("angles", value=0.0), Use("base_thrust", "command.thrust")),
        action=Action.PUBLISH,
    ),
    Port(_COMMANDS["gimbals_ctrl"], (Use("position", "command.vectoring", "gimbals"),), action=Action.PUBLISH),
    Port(_COMMANDS["joints_ctrl"], (Use("position", "command.joint_position", "joints"),), action=Action.PUBLISH),
    Port(
        _COMMANDS["joints_torque_ctrl"], (Use("effort", "command.joint_torque_limit", "joints"),),
        action=Action.PUBLISH,
    ),
    Port(_COMMANDS["flight_config_cmd"], (Use("cmd", value=FORCE_LANDING),), action=Action.FORCE_LANDING),
)  # fmt: skip
"""Topics of the runner: those that it receives, then those that it publishes."""


def topics_file(robot: RobotSpec = ROBOT) -> bytes:
    """Return the file of an export for a robot; the same version gives the same bytes."""
    values = {
        "flight_state": {each.name: each.value for each in FlightState},
        "flight_config_cmd": {"ARM_ON": ARM_ON, "ARM_OFF": ARM_OFF, "FORCE_LANDING": FORCE_LANDING},
        "action": {each.name: each.value for each in Action},
    }
    model = {"name": MODEL_PARAMETER, "value": model_hash(robot)}
    lines = [
        FRONT.rstrip("\n"),
        f"version = {_toml(spidar_gym.__version__)}",
        f"interface = {_toml(runner_hash())} # `spidar-runner about`",
        f"namespace = {_toml(NAMESPACE)} # default",
        f"control_rate = {_toml(CONTROL_RATE)} # of the runner's ticks [Hz]",
        f"rate_tolerance = {_toml(RATE_TOLERANCE)} # largest deviation of a rate, as a share",
        f"parameter = {_toml(model)} # under the namespace, as text; the value is that of this export's robot",
        "",
        "[names] # joint_states has the joints, then the gimbals, in this order; modules are in the order of the links",
        *(f"{name} = {_toml(words)}" for name, words in NAMES.items()),
    ]
    for name, numbers in values.items():
        lines += ["", f"[values.{name}]", *(f"{word} = {number}" for word, number in numbers.items())]
    for port in PORTS:
        lines += ["", "[[topic]]", *_port_lines(port)]
    for kind in dict.fromkeys(port.topic.kind for port in PORTS):
        lines += ["", *_type_lines(kind)]
        if _differs(kind):
            lines += ["", *_type_lines(kind, head=True)]
    return ("\n".join(lines) + "\n").encode()


def topic_lines() -> list[list[str]]:
    """Return the table of the runner's topics: heading, then a line for each."""
    lines = [["topic (under the namespace)", "type", "what it holds", "fields", ""]]
    for port in PORTS:
        topic, columns = port.topic, _columns(port)
        fields = [f"`{_front(columns[use.column])}`{_unit(columns[use.column])}" for use in port.uses]
        words = ["out" if port.action else "in", *([] if port.action else [_WHEN[port.required]])]
        words += [f"{topic.rate:g} Hz"] if topic.rate else []
        words += ["only to land"] if port.action == Action.FORCE_LANDING else []
        kinds = [f"`{topic.name}`", f"`{topic.kind}`", port.doc or topic.doc]
        lines.append([*kinds, ", ".join(dict.fromkeys(fields)), ", ".join(filter(None, words))])
    return lines


_WHEN = {ALWAYS: "", MOCAP: "for `estimate mocap`", LAB: "for `estimate odometry`", NEVER: "optional"}


def _port_lines(port: Port) -> Iterator[str]:
    topic, struct = port.topic, OUTPUT if port.action else INPUT
    yield f"name = {_toml(topic.name)}"
    yield f"direction = {_toml('out' if port.action else 'in')}"
    yield f"type = {_toml(topic.kind)}"
    yield f"contents = {_toml(port.doc or topic.doc)}"
    if topic.rate:
        yield f"rate = {_toml(topic.rate)}"
    due = {name: rate for word, (name, rate) in TOPICS.items() if word not in HEALTH_TOPICS}.get(topic.name)
    if due:
        yield f"accepted = {_toml([round(due * (1.0 + sign * RATE_TOLERANCE), 9) for sign in (-1, 1)])}"
    if port.action:
        yield f"action = {_toml(port.action.name)}"
    else:
        yield f"required = {_toml(port.required)}"
    yield f"struct = {_toml(struct)}"
    stamp = dict.fromkeys(["path"], path) if (path := _stamp(topic.kind)) else {}
    if port.action and stamp:
        yield f"time = {_toml(stamp)} # of the command"
    if port.time:
        yield f"time = {_toml(stamp | {'member': port.time})}"
    if port.count:
        yield f"count = {_toml(dict(zip(('member', 'of'), port.count, strict=True)))}"
    yield "fields = ["
    for use in port.uses:
        yield f"    {_toml(_field(port, struct, use))},"
    yield "]"


def _field(port: Port, struct: str, use: Use) -> dict[str, Any]:
    """Return a field's keys and values."""
    kind, column = port.topic.kind, _columns(port)[use.column]
    head = [leaf.split("|")[1] for leaf in column.leaves if "|" in leaf]
    field: dict[str, Any] = {"paths": _paths(column), **({"paths_head": head} if head else {})}
    field |= {"type": leaf_types(kind)[_paths(column)[0]], "unit": column.unit, "contents": column.doc}
    if use.names:
        field["names"] = use.names
    if use.member:
        field |= {"member": use.member, **_size(member_type(struct, use.member))}
    if use.value is not None:
        field["value"] = use.value
    return field


def member_type(struct: str, member: str) -> Any:  # noqa: ANN401 - a numpy type
    """Return the numpy type of a member of a struct in C, by its path (`KeyError` if there is none)."""
    layout = log_layouts()[struct.removeprefix("sp_")]
    for name in member.split("."):
        layout = layout[name]
    return layout


def _stamp(kind: str) -> str:
    """Return the path of a type's time stamp, or an empty text."""
    return next((path for path in ("header.stamp", "stamp") if path in leaf_types(kind)), "")


def _size(member: Any) -> dict[str, int]:  # noqa: ANN401 - a numpy type
    return {"size": member.shape[0]} if member.shape else {}


def _columns(port: Port) -> dict[str, Column]:
    return {column.name: column for column in COLUMNS[port.topic.kind]}


def _paths(column: Column) -> list[str]:
    return [leaf.partition("|")[0] for leaf in column.leaves]


def _front(column: Column) -> str:
    """Return the path of a column, without the names of its components."""
    first, *others = _paths(column)
    return first.rpartition(".")[0] if others else first


def _unit(column: Column) -> str:
    return "" if column.unit in ("", "1") else f" [{column.unit}]"


def _differs(kind: str) -> bool:
    """Return whether a type has other names in the lab's present software."""
    return any("|" in leaf for column in COLUMNS[kind] for leaf in column.leaves)


def _type_lines(kind: str, *, head: bool = False) -> list[str]:
    return ["[[type]]", f"name = {_toml(kind)}", *(["head = true"] if head else []),
            f"md5 = {_toml(checksum(kind, head=head))}",
            f"definition = '''\n{definition(kind, head=head)}'''"]  # fmt: skip


def _toml(value: Any) -> str:  # noqa: ANN401 - a value of TOML
    """Format a value of TOML: texts, numbers and lists look as in JSON."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)
