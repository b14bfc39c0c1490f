"""Definitions shared by the runner and Python: messages, topics, and structs of missions, logs and links."""

from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from pathlib import Path

import numpy as np

from spidar_gym.control.allocation.problem import N_FORCES
from spidar_gym.native.constants import MAX_ACTION, MAX_WAYPOINTS, Enumeration, snake
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.structs import CStruct, dtypes, struct_of
from spidar_gym.onboard.health import HEALTH_STRUCTS, HEALTH_TOPICS
from spidar_gym.onboard.limits import Limits
from spidar_gym.robot import N_JOINTS, N_ROTORS, source_doc
from spidar_gym.sim.sensors import ENCODER_PERIOD, IMU_PERIOD, POSE_PERIOD

RUNNER = Path(__file__).resolve().parent / "runner"
"""Sources of the runner."""
MAGIC = "SPIDAR01"
"""First characters of a log."""
MAX_FORMS, MAX_WINDOWS, MAX_MOVES, MAX_HEADINGS, MAX_EXCITATIONS = 64, 8, 16, 16, 64
"""Largest numbers of forms, windows, moves, headings and excitations in a mission."""
MOST_EXCITATION = {"joint": 0.3, "thrust": 10.0}
"""Largest amplitude of an excitation, by what is excited [rad, N]."""
FASTEST_EXCITATION = 10.0
"""Largest frequency of an excitation: a quarter of the control rate [Hz]."""
ORDER_TEXT, MOST_ORDERS, REASON = 1024, 16, 160
"""Characters of the orders of one tick; their largest number, limited because checking the reach of a crawl takes time;
characters of the sentence that refuses them."""
DIGEST, NAME, MOST_PRESETS = 72, 32, 16
"""Characters of a hash and of a preset's name, the zero at their end included; largest number of flight presets, and of
crawl presets, in a parameter file and in an export."""
N_NAMES = N_JOINTS + 2 * N_ROTORS
"""Names of `joint_states`: joints, then gimbals."""
TOPICS = {
    "joints": ("joint_states", 1.0 / ENCODER_PERIOD), "imu": ("imu", 1.0 / IMU_PERIOD),
    "pose": ("mocap/pose", 1.0 / POSE_PERIOD), "odometry": ("uav/cog/odom", 100.0), "state": ("flight_state", 0.0),
    **HEALTH_TOPICS,
}  # fmt: skip
"""Topics that the runner subscribes to, in its order: name, and expected rate [Hz], 0 for any; those of health last."""
RATE_TOLERANCE = 0.3
"""Largest deviation of a topic's rate from the expected one, as a share of it; no rate of health is checked."""


class FlightState(IntEnum):
    """States of the robot's own flight stack; the last two replace the others when they are reported [JSK]."""

    ARM_OFF = 0
    START = 1
    ARM_ON = 2
    TAKEOFF = 3
    LAND = 4
    HOVER = 5
    STOP = 6
    LOW_BATTERY = 16
    FORCE_LANDING = 17


class MissionKind(IntEnum):
    """Kind of a mission."""

    FLIGHT = 0
    CRAWL = 1
    COURSE = 2
    BENCH = 3


class Excited(IntEnum):
    """What an excitation adds to: the target of a joint [rad], or the thrust of a module [N]."""

    JOINT = 0
    THRUST = 1


class Shape(IntEnum):
    """Shape of an excitation."""

    SINE = 0
    CHIRP = 1
    SQUARE = 2


class LogKind(IntEnum):
    """Kind of a log."""

    FLIGHT = 0
    CRAWL = 1
    RUN = 2


class Stage(IntEnum):
    """Stage of the runner: it drives once, and after release never again."""

    WAITING = 0
    DRIVING = 1
    HOLDING = 2
    LANDING = 3
    RELEASED = 4
    ENDING = 5
    RESTING = 6


STAGES = {
    "waiting": Stage.WAITING, "driving": Stage.DRIVING, "holding": Stage.HOLDING,
    "forcing the landing": Stage.LANDING, "released": Stage.RELEASED, "ending the mission": Stage.ENDING,
    "resting": Stage.RESTING,
}  # fmt: skip
"""Text that the runner prints → stage."""


class Heard(IntEnum):
    """Result of the orders received in a tick."""

    NOTHING = 0
    TAKEN = 1
    REFUSED = 2


class Action(IntEnum):
    """Action of the link after a tick of the runner."""

    SILENT = 0
    PUBLISH = 1
    FORCE_LANDING = 2


FAULTS = {
    "FINE": "none",
    "LATE": "the tick came late",
    "NO_STATE": "the flight state is stale",
    "NO_POSE": "the pose is stale",
    "NO_IMU": "the inertial unit is stale",
    "NO_JOINTS": "the joint states are stale",
    "NOT_FINITE": "a sample is not finite",
    "OUT_OF_RANGE": "a sample is out of range",
    "OUT_OF_ORDER": "a sample is out of order",
    "JUMPED": "the pose jumps",
    "TILTED": "the torso tilts too far",
    "OUTSIDE": "the robot is outside its fence",
    "CONTENDED": "another node commands the rotors",
    "NO_ALLOCATION": "no allocation for too long",
    "BAD_COMMAND": "a command is out of bounds",
    "LOW_BATTERY": "the battery is low",
    "STRAINED": "a joint is too far from its command",
    "VOLTAGE_LOW": "the battery's voltage is low",
    "VOLTAGE_CRITICAL": "the battery's voltage is critical",
    "SERVO_HOT": "a servo is too hot",
    "SERVO_LOADED": "a servo is loaded too much for too long",
    "SERVO_ERROR": "a servo reports an error",
    "MOTOR_LIMIT": "a motor's output is at its limit for too long",
    "HEALTH_STALE": "a message about the robot's health is stale",
    "HEALTH_INVALID": "a value of the robot's health is not finite or out of range",
}
"""Faults, and the runner's message for each."""


def _of(kind: type[IntEnum], prefix: str = "") -> Enumeration:
    return Enumeration(
        snake(kind.__name__), source_doc(kind).partition("\n")[0], tuple(each.name for each in kind), prefix,
        tuple(each.value for each in kind),
    )  # fmt: skip


ENUMERATIONS = (
    _of(FlightState, "STATE_"), _of(MissionKind, "MISSION_"), _of(LogKind, "LOG_"), _of(Stage), _of(Heard, "HEARD_"),
    _of(Action), _of(Excited, "EXCITED_"), _of(Shape, "SHAPE_"),
    Enumeration("fault", "Faults.", tuple(FAULTS), count="FAULTS"),
    Enumeration("topic", "Topics that the runner subscribes to.", tuple(TOPICS), "TOPIC_", count="TOPICS"),
)  # fmt: skip
RUNNER_STRUCTS: Sequence[CStruct] = (
    *HEALTH_STRUCTS,
    CStruct("form", "A form to fly to.", (
        ("start", "f8", (), "since the take-over [s]"),
        ("joint_target", "f8", (N_JOINTS,), "[rad]"),
    )),
    CStruct("window", "Interval without interference rows.", (
        ("start end", "f8", (), "since the take-over [s]"),
    )),
    CStruct("move", "A move on the ground.", (
        ("way", "pose2", (), "displacement relative to its start"),
        ("cycles unused", "i4", (), "cycles: 0 for as many as necessary"),
    )),
    CStruct("heading", "A heading to turn to.", (
        ("start yaw", "f8", (), "since the take-over [s]; relative to the heading at the take-over [rad]"),
    )),
    CStruct("excitation", "A signal that is added to the target of a joint or to the thrust of a module.", (
        ("excited index shape unused", "i4", (), "sp_excited; of the joint or module, from 0; sp_shape"),
        ("start end", "f8", (), "since the take-over [s]"),
        ("amplitude", "f8", (), "[rad] or [N]"),
        ("frequency last_frequency", "f8", (), "at the start, and of a chirp at the end [Hz]"),
    )),
    struct_of(Limits()),
    CStruct("flight_preset", "A flight preset.", (
        ("name", "u1", (NAME,), "zero-terminated"),
        ("config", "controller_config", (), ""),
    )),
    CStruct("crawl_preset", "A crawl preset.", (
        ("name", "u1", (NAME,), "zero-terminated"),
        ("config", "crawler_config", (), ""),
    )),
    CStruct("parameters", "Robot, gains and limits: those of the export, or of a parameter file.", (
        ("model", "u1", (DIGEST,), "SHA-256 of the robot's model, zero-terminated"),
        ("sha256", "u1", (DIGEST,), "of the file, or of the one that the export wrote; zero-terminated"),
        ("robot", "robot", (), ""),
        ("limits", "limits", (), "of a mission that states no other"),
        ("estimator", "estimator_config", (), ""),
        ("manager", "manager_config", (), "without its two controller configurations: a mission's presets"),
        ("flight_count crawl_count", "i4", (), ""),
        ("flights", "flight_preset", (2 * MOST_PRESETS,), "those of a file first"),
        ("crawls", "crawl_preset", (2 * MOST_PRESETS,), "likewise"),
    )),
    CStruct("mission", "A mission: what the runner does while it drives, and its limits.", (
        ("kind", "i4", (), "sp_mission_kind: a flight begins in HOVER, all others in ARM_ON"),
        ("odometry", "i4", (), "1: use the lab's estimate `uav/cog/odom`; 0: estimate from mocap and inertial unit"),
        ("residual", "i4", (), "1: use the exported policy"),
        ("trim", "i4", (), "flight: 1: integrals begin from the rotor commands of the robot's own software; 0: empty"),
        ("form_count window_count move_count order_count heading_count excitation_count", "i4", (), ""),
        ("has_goal unused", "i4", (), "course: whether it follows the map instead of orders"),
        ("limits", "limits", (), ""),
        ("controller", "controller_config", (), ""),
        ("crawler", "crawler_config", (), ""),
        ("manager", "manager_config", (), "course; its two controller configurations are those above"),
        ("estimator", "estimator_config", (), ""),
        ("forms", "form", (MAX_FORMS,), ""),
        ("windows", "window", (MAX_WINDOWS,), ""),
        ("moves", "move", (MAX_MOVES,), ""),
        ("headings", "heading", (MAX_HEADINGS,), ""),
        ("excitations", "excitation", (MAX_EXCITATIONS,), ""),
        ("orders", "waypoint", (MAX_WAYPOINTS,), "course"),
        ("map", "course", (), "course; of its tiles only the height is known"),
        ("end", "f8", (), "of the flight, since the take-over; then it hovers [s]"),
        ("robot", "robot", (), ""),
    )),
    CStruct("log_head", "Head of a log; see runner.h for what follows it.", (
        ("magic", "u1", (len(MAGIC),), "SP_LOG_MAGIC"),
        ("interface", "u1", (32,), "SP_RUNNER_INTERFACE"),
        ("model", "u1", (DIGEST,), "SHA-256 of the robot's model, zero-terminated"),
        ("parameters", "u1", (DIGEST,), "SHA-256 of a run's parameters, zero-terminated"),
        ("kind ticks", "i4", (), "sp_log_kind; of a run 0 ticks: to the end of the file"),
    )),
    CStruct("log_start", "Flight log: data after the configuration.", (
        ("state", "robot_state", (), ""),
        ("joint_position", "f8", (N_JOINTS,), "initial q^d [rad]"),
        ("has_trim unused", "i4", (), ""),
        ("trim", "f8", (6,), "known hover wrench beyond the weight [N, Nm]"),
    )),
    CStruct("log_input", "One tick of input.", (
        ("state", "robot_state", (), ""),
        ("reference", "reference", (), "not used by a crawl"),
        ("has_residual unused", "i4", (), ""),
        ("residual", "residual", (), ""),
    )),
    CStruct("log_output", "One tick of output.", (
        ("command", "command", (), ""),
        ("forces_l", "f8", (N_FORCES,), "allocated [N]"),
        ("status iterations", "i4", (), "sp_status; of the solvers"),
    )),
    CStruct("log_clock", "Delay of a tick of a run (negative without a clock), and its computing time.", (
        ("wait_us compute_us", "f8", (), "[us]"),
    )),
    CStruct("odometry", "The lab's own estimate, `uav/cog/odom`.", (
        ("time", "f8", (), "[s]"),
        ("position_w", "f8", (3,), "of the CoG [m]"),
        ("quat_wb", "f8", (4,), "attitude of the torso (w, x, y, z)"),
        ("velocity_w omega_b", "f8", (3,), "of the CoG in the world; torso axes"),
    )),
    CStruct("loop_input", "Messages received since the last tick; samples are not checked yet.", (
        ("time", "f8", (), "now, by the clock of the samples' stamps [s]"),
        ("flight_state_time", "f8", (), "time of the last flight state [s]"),
        ("flight_state", "i4", (), "sp_flight_state; −1 before the first"),
        ("has_odometry", "i4", (), "whether a new one was received"),
        ("has_thrust", "i4", (), "whether another node commanded the rotors"),
        ("unused", "i4", (), ""),
        ("thrust", "f8", (N_ROTORS,), "last command of another node [N]"),
        ("odometry", "odometry", (), ""),
        ("measurement", "measurement", (), ""),
        ("health", "health_input", (), ""),
        ("orders", "u1", (ORDER_TEXT,), "lines for the present course, zero-terminated; empty for none"),
    )),
    CStruct("loop_output", "Output of a tick of the runner.", (
        ("action", "i4", (), "sp_action"),
        ("stage", "i4", (), "sp_stage"),
        ("fault", "i4", (), "sp_fault"),
        ("status", "i4", (), "sp_status of the allocation"),
        ("iterations finished", "i4", (), "of the solver; whether the mission is over"),
        ("phase timeouts", "i4", (), "gait: sp_phase, and number of phases ended by time-out"),
        ("manager_phase to_do", "i4", (), "course: sp_manager_phase, and number of pending orders"),
        ("heard aborted", "i4", (), "sp_heard; whether a joint was too far from its command"),
        ("mission_time", "f8", (), "since the take-over [s]"),
        ("command", "command", (), ""),
        ("state", "robot_state", (), ""),
        ("reference", "reference", (), ""),
        ("joint_torques", "f8", (N_JOINTS,), "allocated [Nm]"),
        ("forces_l", "f8", (N_FORCES,), "allocated [N]"),
        ("policy_action", "f8", (MAX_ACTION,), "of the learned policy, 0 if off"),
    )),
    CStruct("sense", "Memory of the checks and of the estimate.", (
        ("started has_pose", "i4", (), ""),
        ("pose_time imu_time joint_time", "f8", (), "of the newest good samples [s]"),
        ("pose_position_w", "f8", (3,), ""),
        ("pose_quat_wb", "f8", (4,), ""),
        ("odometry", "odometry", (), ""),
        ("estimator", "estimator", (), ""),
        ("state", "robot_state", (), ""),
    )),
    CStruct("loop", "Memory of the runner.", (
        ("mission", "mission", (), ""),
        ("sense", "sense", (), ""),
        ("health", "health", (), ""),
        ("flight", "flight", (), ""),
        ("crawl", "crawl", (), ""),
        ("manager", "manager", (), "course"),
        ("pilot", "pilot", (), "course with a map"),
        ("policy", "policy", (), ""),
        ("goal", "f8", (3,), "crawl: x, y [m], yaw [rad], world"),
        ("reference", "reference", (), ""),
        ("form", "f8", (N_JOINTS,), "target of the joints without excitations [rad]"),
        ("first_yaw yaw", "f8", (), "heading at the take-over, and of the reference [rad]"),
        ("command", "command", (), ""),
        ("answer", "loop_output", (), "last output"),
        ("last good_since taken_over", "f8", (), "[s]"),
        ("held", "f8", (), "how long old commands have been in force [s]"),
        ("carried", "f8", (), "course: mean Σλ of the last second in the air [N]"),
        ("trim", "f8", (6,), "hover wrench of the robot's own stack beyond the weight [N, Nm]"),
        ("left", "f8", (), "remaining share of the thrust at the start of the rest"),
        ("has_last stage fault landing has_trim finished", "i4", (), ""),
        ("ending told", "i4", (), "sp_fault that ends the mission; course: whether it had orders or reached its goal"),
        ("by_map undecided", "i4", (), "whether the map is followed; ticks until the next decision"),
        ("aborted unused", "i4", (), "whether the excitations were ended"),
        ("reason", "u1", (REASON,), "why the last orders were refused"),
    )),
    CStruct("sim_hello", "First message of the simulator.", (
        ("interface", "u1", (32,), "SP_RUNNER_INTERFACE"),
        ("model", "u1", (DIGEST,), "SHA-256 of the robot's model"),
        ("names", "u1", (N_NAMES, 24), "of `joint_states`"),
        ("name_count unused", "i4", (), ""),
        ("rates", "f8", (len(TOPICS),), "by sp_topic [Hz]"),
    )),
)  # fmt: skip
"""Structs of missions, logs and links; nested structs come first."""


@cache
def log_layouts() -> dict[str, np.dtype]:
    """Return the structs of the core, the runner and its logs as NumPy types, by name."""
    return dtypes(RUNNER_STRUCTS, core_layouts())
