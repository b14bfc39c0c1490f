"""Faults that are put between robot and runner, and what the runner has to do about each."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.onboard.runner_structs import FlightState
from spidar_gym.sitl.messages import Message

STALL, LONG_STALL = 0.2, 0.7
"""How long a stalled runner does not run [s]."""


@dataclass(frozen=True)
class Fault:
    """What goes wrong."""

    doc: str
    """In a line."""
    reaction: str
    """`flies on`, `lands` (the runner commands it), `board lands` (it has not heard the runner), as specified."""
    spoil: Callable[[Message, np.random.Generator], list[Message]] = lambda message, rng: [message]
    """What becomes of a message of the robot while the fault lasts."""
    seconds: float = np.inf
    """How long it lasts [s]."""
    process: str = ""
    """What happens to the processes, or the robot: `kill` (runner), `stall`, `long_stall`, `master`, `rotor`."""
    ros: bool = False
    """Whether it needs ROS."""
    sees: bool = False
    """Whether the runner sees as well as before: then it ends a course by itself."""
    only_course: bool = False
    """Whether only a course is asked; whatever else the runner does has then been taken from it."""


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
    "master": Fault("the ROS master is killed", "flies on", process="master", ros=True),
}
"""Faults by name."""
FLOOR_PHASES = ("lie", "crawl", "spool", "unload")
"""Phases of a course in which the floor carries the robot, or a part of it."""


def course_reaction(name: str, phase: str) -> str:
    """What a fault in a phase of a course has to lead to.

    `goes on`; `lands` (the manager does it, then it rests), `rests` (rotors fade, joints stay); `forced landing` (the
    runner commands the board's) and `board lands` (it has not heard the runner).
    """
    fault = FAULTS[name]
    if name == "rotor_dies":  # which nobody tells the runner: it flies on what is left, until it tilts too far
        return "goes on or forced landing"
    if fault.reaction != "lands":
        return {"flies on": "goes on"}.get(fault.reaction, fault.reaction)
    if name == "contended":
        return "forced landing"
    if phase in FLOOR_PHASES:
        return "rests"
    return "lands" if fault.sees else "forced landing"


@dataclass
class Injector:
    """A fault between the robot and the link, from a time on that counts from the take-over."""

    fault: Fault
    """What goes wrong."""
    after: float
    """How long after the take-over, or after the phase has begun [s]."""
    rng: np.random.Generator
    """Source of what is drawn."""
    phase: str = ""
    """Phase of a course; empty for the take-over."""
    start: float = np.inf
    """When, by the robot's clock; infinite before the take-over [s]."""
    done: bool = False
    """Whether the processes have had their share."""

    def apply(self, messages: list[Message], time: float) -> list[Message]:
        """What reaches the runner of what the robot says."""
        if not self.start <= time < self.start + self.fault.seconds:
            return messages
        return [kept for message in messages for kept in self.fault.spoil(message, self.rng)]

    def due(self, time: float) -> str:
        """What happens to the processes now; empty for nothing."""
        if self.done or time < self.start or not self.fault.process:
            return ""
        self.done = True
        return self.fault.process
