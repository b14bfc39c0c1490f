"""Faults that are injected between robot and runner, and the runner's specified reaction to each."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.onboard.health import HEALTH_TOPICS
from spidar_gym.onboard.messages import Message
from spidar_gym.onboard.runner_structs import FlightState

STALL, LONG_STALL = 0.2, 0.7
"""Durations for which a stalled runner does not run [s]."""


@dataclass(frozen=True)
class Fault:
    """A fault and the specified reaction to it."""

    doc: str
    """Description in one line."""
    reaction: str
    """Specified reaction: `flies on`, `ends` (the mission, the runner hovers), `lands` (the runner commands it), or
    `board lands` (the board receives no commands)."""
    spoil: Callable[[Message, np.random.Generator], list[Message]] = lambda message, rng: [message]
    """Function that returns the messages that replace one of the robot while the fault lasts."""
    seconds: float = np.inf
    """Duration of the fault [s]."""
    process: str = ""
    """Effect on processes or robot: `kill` (runner), `stall`, `long_stall`, `master`, `rotor`; empty for none."""
    ros: bool = False
    """Whether the fault needs ROS."""
    sees: bool = False
    """Whether the runner's state estimate is not affected: the manager then ends a course in a controlled way."""
    only_course: bool = False
    """Whether the fault applies to courses only, not to a hover."""
    lines: str = ""
    """Lines that are added to the mission, for limits that would take long to be exceeded."""


def _silence(*topics: str) -> Callable[[Message, np.random.Generator], list[Message]]:
    return lambda message, rng: [] if message.topic in topics else [message]


def _set(topic: str, name: str, value: float) -> Callable[[Message, np.random.Generator], list[Message]]:
    def spoil(message: Message, rng: np.random.Generator) -> list[Message]:
        if message.topic != topic:
            return [message]
        return [replace(message, values={**message.values, name: np.full_like(message.values[name], value)})]

    return spoil


def _lose(message: Message, rng: np.random.Generator) -> list[Message]:
    return [message] if rng.random() >= 0.1 else []


def _old(message: Message, rng: np.random.Generator) -> list[Message]:
    return [replace(message, stamp=message.stamp - 0.5)] if message.topic == "mocap/pose" else [message]


def _meddle(message: Message, rng: np.random.Generator) -> list[Message]:
    if message.topic != "flight_state":
        return [message]
    return [message, Message("four_axes/command", message.stamp, {"thrust": np.full(8, 15.0)})]


def _low(message: Message, rng: np.random.Generator) -> list[Message]:
    return (
        [replace(message, values={"data": int(FlightState.LOW_BATTERY)})]
        if message.topic == "flight_state"
        else [message]
    )


def _shift(message: Message, rng: np.random.Generator) -> list[Message]:
    if message.topic not in _POSES:
        return [message]
    off = {"position": message.values["position"] + np.array([0.5, 0.0, 0.0])}
    return [replace(message, values={**message.values, **off})]


_POSES = ("mocap/pose", "uav/cog/odom")
VOLTAGE, SERVOS, MOTORS = (name for name, _ in HEALTH_TOPICS.values())
SHOCK = 0x10
"""Error bit of an electrical shock [ROBOTIS]."""
FAULTS: dict[str, Fault] = {
    "none": Fault("nothing", "flies on"),
    "pose_stops": Fault("motion capture falls silent", "lands", _silence(*_POSES)),
    "joints_stop": Fault("joint states stop", "lands", _silence("joint_states")),
    "imu_stops": Fault("the inertial unit stops", "lands", _silence("imu")),
    "state_stops": Fault("the flight state stops", "lands", _silence("flight_state"), sees=True),
    "pose_nan": Fault("poses are NaN", "lands", _set("mocap/pose", "position", np.nan)),
    "pose_nan_once": Fault("poses are NaN for 20 ms", "flies on", _set("mocap/pose", "position", np.nan), 0.02),
    "pose_far": Fault("poses are 10⁶ m away", "lands", _set("mocap/pose", "position", 1e6)),
    "pose_jumps": Fault("poses are half a metre off", "lands", _shift),
    "joints_nan": Fault("joint angles are NaN", "lands", _set("joint_states", "position", np.nan)),
    "gyro_far": Fault("the gyroscope says 100 rad/s", "lands", _set("imu", "gyro", 100.0)),
    "out_of_order": Fault("poses are stamped half a second earlier", "lands", _old),
    "low_battery": Fault("the flight state is LOW_BATTERY", "lands", _low, sees=True, only_course=True),
    "lossy": Fault("one message of ten is lost", "flies on", _lose),
    "contended": Fault("another node commands the rotors", "lands", _meddle),
    "stall": Fault("the runner stalls for 200 ms", "flies on", process="stall"),
    "long_stall": Fault("the runner stalls for 700 ms", "board lands", process="long_stall"),
    "killed": Fault("the runner is killed", "board lands", process="kill"),
    "rotor_dies": Fault("an outer rotor thrusts no more", "flies on", process="rotor", only_course=True),
    "voltage_low": Fault("the battery says 20.5 V", "ends", _set(VOLTAGE, "data", 20.5), sees=True),
    "voltage_critical": Fault("the battery says 18 V", "lands", _set(VOLTAGE, "data", 18.0), lines="voltage 20 20\n"),
    "voltage_nan": Fault("the battery's voltage is NaN", "ends", _set(VOLTAGE, "data", np.nan), sees=True),
    "servo_hot": Fault("servos have 58 °C", "ends", _set(SERVOS, "temp", 58.0), sees=True),
    "servo_loaded": Fault(
        "servos are loaded to 98 % of stall", "ends", _set(SERVOS, "load", 216.0), sees=True, lines="servos 57 0.95 1\n"
    ),
    "servo_error": Fault("servos report an electrical shock", "lands", _set(SERVOS, "error", float(SHOCK)), sees=True),
    "servos_stop": Fault("the states of the servos stop", "ends", _silence(SERVOS), sees=True),
    "motor_limit": Fault("motors are at their limit", "ends", _set(MOTORS, "motor_value", 1840.0), sees=True),
    "master": Fault("the ROS master is killed", "flies on", process="master", ros=True),
}
"""Faults by name."""
FLOOR_PHASES = ("lie", "crawl", "spool", "unload")
"""Phases of a course in which the floor carries at least part of the robot's weight."""


def course_reaction(name: str, phase: str) -> str:
    """Return the specified reaction to a fault in a phase of a course.

    `goes on`; `lands` (the manager lands, then the robot rests); `rests` (thrusts fade, joints hold their angles);
    `forced landing` (the runner commands the board's landing); `board lands` (the board receives no commands).
    """
    fault = FAULTS[name]
    if name == "rotor_dies":  # not reported to the runner: it flies with the remaining rotors until the tilt limit
        return "goes on or forced landing"
    if fault.reaction not in ("lands", "ends"):
        return {"flies on": "goes on"}.get(fault.reaction, fault.reaction)
    if name == "contended":
        return "forced landing"
    if phase in FLOOR_PHASES:
        return "rests"
    return "lands" if fault.sees else "forced landing"


@dataclass
class Injector:
    """A fault between the robot and the link, which starts at a given time after the take-over or within a phase."""

    fault: Fault
    """Fault that is injected."""
    after: float
    """Delay of the fault after the take-over, or after the start of the phase [s]."""
    rng: np.random.Generator
    """Random generator of the fault."""
    phase: str = ""
    """Phase of a course; empty to count from the take-over."""
    start: float = np.inf
    """Start of the fault by the robot's clock; infinite until it is determined [s]."""
    done: bool = False
    """Whether the effect on the processes has been applied."""

    def apply(self, messages: list[Message], time: float) -> list[Message]:
        """Return the messages that reach the runner from those of the robot."""
        if not self.start <= time < self.start + self.fault.seconds:
            return messages
        return [kept for message in messages for kept in self.fault.spoil(message, self.rng)]

    def due(self, time: float) -> str:
        """Return the effect on the processes that is due now, once; empty for none."""
        if self.done or time < self.start or not self.fault.process:
            return ""
        self.done = True
        return self.fault.process
