"""Topics of a record: their arrays with unit and frame, and the ROS 1 messages that hold them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

from spidar_gym.logs.ros1 import VARIABLE, Field, parse
from spidar_gym.native.constants import MAX_ACTION
from spidar_gym.onboard import message_types
from spidar_gym.onboard.message_types import Column
from spidar_gym.onboard.messages import COMMANDS, FEEDBACK, ORDERS, STATE_NAMES
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS, field_docs
from spidar_gym.state import Reference, RobotState

PACKAGE = "spidar_gym"
"""Package of this project's message types."""


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
COLUMNS = message_types.COLUMNS | {f"{PACKAGE}/{name}": columns for name, (_, columns) in OWN.items()}
"""ROS type → columns."""


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


def definition(kind: str, *, head: bool = False) -> str:
    """Return the whole definition of a type, with those that it uses, as in bags.

    Args:
        kind: ROS type.
        head: Whether `spinal/Imu` is that of the lab's present software.
    """
    package, _, name = kind.partition("/")
    if package != PACKAGE:
        return message_types.definition(kind, head=head)
    doc, columns = OWN[name]
    lines = [f"# {doc}", "time stamp"]
    for column in columns:
        size = int(np.prod(column.shape or (), dtype=int))
        lines += [f"# {column.words}", f"{column.kind}{f'[{size}]' if column.shape else ''} {column.name}"]
    return "\n".join(lines) + "\n"


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
