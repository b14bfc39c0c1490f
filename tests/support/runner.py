"""The compiled runner for tests: builds with and without sanitizers, its loop tick by tick, recorded runs."""

import ctypes
import subprocess
from dataclasses import replace

import numpy as np

from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.locomotion.commands import CrawlTo, FlyTo, Land, TakeOff
from spidar_gym.native.compiler import compiler
from spidar_gym.native.recipe import FLAGS
from spidar_gym.onboard.build import arguments, compile_runner
from spidar_gym.onboard.export import EVERY, export_files, write_files
from spidar_gym.onboard.runner_structs import log_layouts
from spidar_gym.robot import FORMS, GIMBAL_NAMES, JOINT_NAMES, ROBOT
from spidar_gym.sitl.missions import course_mission, crawl_mission, hover_mission
from spidar_gym.sitl.play import play

WAITING, DRIVING, HOLDING, LANDING, RELEASED, ENDING, RESTING = range(7)
SILENT, PUBLISH, FORCE_LANDING = range(3)
(FINE, LATE, NO_STATE, NO_POSE, NO_IMU, NO_JOINTS, NOT_FINITE, OUT_OF_RANGE, OUT_OF_ORDER, JUMPED, TILTED, OUTSIDE,
 CONTENDED, NO_ALLOCATION, BAD_COMMAND, LOW_BATTERY, STRAINED, VOLTAGE_LOW, VOLTAGE_CRITICAL, SERVO_HOT, SERVO_LOADED,
 SERVO_ERROR, MOTOR_LIMIT, HEALTH_STALE, HEALTH_INVALID) = range(25)  # fmt: skip
HOLD, LAND = 4, 10
"""Ticks."""
ARM_ON, HOVER, LOW = 2, 5, 16
FLIGHT, CRAWL, COURSE, BENCH = range(4)
NOTHING, TAKEN, REFUSED = range(3)
NAMES = (*JOINT_NAMES, *GIMBAL_NAMES)
TOPICS = ("joint_states", "imu", "mocap/pose", "uav/cog/odom", "flight_state")
RATES = (50.0, 200.0, 100.0, 100.0, 40.0)
ZEROS = " ".join(["0"] * 16)
CHECKED = ("-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def export(folder):
    write_files(export_files(golden=False, presets=EVERY, fragile=True), folder)
    return folder


def compile_(folder, out, *flags):
    """Compile all of the folder, the runner's `main` included."""
    command = [*compiler(), *FLAGS, *flags, *arguments(folder), "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]
    return out


def compile_as_shipped(folder):
    return compile_runner(folder, folder.parent / "runner")


def load(path):
    library = ctypes.CDLL(str(path))
    library.sp_loop_init.restype = ctypes.c_char_p
    return library


def address(record):
    return ctypes.c_void_p(record.ctypes.data)


def compiled(library):
    """The parameters that were compiled."""
    parameters = np.zeros((), log_layouts()["parameters"])
    library.sp_compiled_parameters(address(parameters))
    return parameters


def from_file(library, data):
    """The parameters of a file's bytes, or the message of its refusal."""
    parameters, reason = np.zeros((), log_layouts()["parameters"]), ctypes.create_string_buffer(384)
    text = ctypes.create_string_buffer(data)
    ok = library.sp_read_parameters(text, address(parameters), reason, ctypes.c_size_t(384))
    return parameters if ok else reason.value.decode(errors="replace")


def read_mission(library, text, parameters=None):
    """The mission, or the message of its refusal; with the compiled parameters if no others are given."""
    mission, reason = np.zeros((), log_layouts()["mission"]), ctypes.create_string_buffer(256)
    text = text if isinstance(text, bytes) else text.encode()
    parameters = compiled(library) if parameters is None else parameters
    ok = library.sp_read_mission(text, address(parameters), address(mission), reason, ctypes.c_size_t(256))
    return mission if ok else reason.value.decode(errors="replace")


class Loop:
    """The runner's loop; can be copied."""

    def __init__(self, library, mission):
        self.library, self.record = library, np.zeros((), log_layouts()["loop"])
        pointer = ctypes.c_void_p(self.record.ctypes.data)
        if mission is not None:
            assert self.library.sp_loop_init(pointer, ctypes.c_void_p(mission.ctypes.data)) is None

    @classmethod
    def begin(cls, library, mission):
        """A loop, or the message which refuses the mission."""
        loop = cls(library, None)
        why = library.sp_loop_init(*(ctypes.c_void_p(x.ctypes.data) for x in (loop.record, mission)))
        return loop if why is None else why.decode()

    def copy(self):
        other = Loop(self.library, None)
        other.record[...] = self.record
        return other

    def __call__(self, record):
        record, out = np.array(record), np.zeros((), log_layouts()["loop_output"])
        self.library.sp_loop_tick(*(ctypes.c_void_p(x.ctypes.data) for x in (self.record, record, out)))
        return out

    def run(self, inputs):
        return np.array([self(record) for record in inputs], log_layouts()["loop_output"])


class Stream:
    """A recorded run of the runner against the simulated robot: mission, inputs and outputs."""

    def __init__(self, library, path, played):
        self.path, self.run, self.played = path, played.run, played.log
        self.text = played.mission.text
        self.mission = read_mission(library, self.text)
        self.inputs = played.log.inputs.copy()
        size = [log_layouts()[name].itemsize for name in ("loop_input", "loop_output", "log_clock")]
        raw = path.read_bytes()[log_layouts()["log_head"].itemsize + self.mission.nbytes :]
        self.answers = [raw[at + size[0] : at + size[0] + size[1]] for at in range(0, len(raw), sum(size))]
        """Outputs, byte for byte."""
        self.wanted = HOVER if self.mission["kind"] == FLIGHT else ARM_ON
        self.hovers = int(np.argmax(self.inputs["flight_state"] == self.wanted))
        self.drives = int(np.argmax(played.log.outputs["stage"] == DRIVING))

    def write(self, path, inputs, outputs, mission=None):
        """A log of a run."""
        front = self.path.read_bytes()[: log_layouts()["log_head"].itemsize]
        clock = np.zeros((), log_layouts()["log_clock"]).tobytes()
        mission = self.mission if mission is None else mission
        ticks = [i.tobytes() + o.tobytes() + clock for i, o in zip(inputs, outputs, strict=True)]
        path.write_bytes(front + mission.tobytes() + b"".join(ticks))


def played(library, runner, folder, name, mission):
    path = folder.parent / f"{name}.log"
    return Stream(library, path, play(mission, runner=runner, log=path))


def fly(library, runner, folder):
    return played(library, runner, folder, "hover", hover_mission(seconds=3.0))


def walk(library, runner, folder):
    return played(library, runner, folder, "crawl", replace(crawl_mission(way=Pose2(0.05, 0.0, 0.0)), seconds=6.0))


SHORT = (
    TakeOff(0.5), FlyTo((0.4, 0.0, 0.9), FORMS["form2"], 0.5), Land(), CrawlTo(Pose2(0.5, 0.0, 0.0)),
)  # fmt: skip
"""A course with every phase."""


def go(library, runner, folder):
    return played(library, runner, folder, "course", course_mission(SHORT))


def nan_pose(record, k):
    record["measurement"]["pose_position_w"] = np.nan


def said(*words):
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, errors="replace", check=False)


def junk(rng):
    """A random mission of valid words, numbers and rubbish."""
    words = ["flight", "crawl", "course", "bench", "heading", "excite", "joint", "thrust", "sine", "chirp", "square",
             "deviation", "torque", "crawl_to", "take_off", "fly_to", "land", "gate", "goal", "wall", "beam",
             "slot", "tiles", "along", "room", "form", "move",
             "unrestricted", "estimate", "residual", "fence", "ages", "settle",
             "tilt", "speed", "end", "paper", "robust", "tuned", "odometry", "on", "0", "1", "-1", "1e300", "-1e-300",
             "nan", "0.1", "inf", "0x1p3", "#", "\t", "\r", "…", "2147483648", "%s%n", ZEROS]  # fmt: skip
    map_ = ["course tuned robust", "gate wall 2.3 2.5 0.5", "goal 4.1 0 0"]
    swings = ["flight paper", "excite thrust 3 sine 0 4 6 1.5", "excite joint 2 chirp 0 4 0.02 0.5 2", "heading 0 1"]
    heads = [["flight paper"], ["crawl published"], ["course tuned robust", "take_off 1"], map_, swings, []]
    head = heads[rng.integers(6)]
    lines = [" ".join(rng.choice(words, rng.integers(0, 26))) for _ in range(rng.integers(0, 12))]
    if rng.random() < 0.5:
        lines = ["move " + " ".join(rng.choice(["1e300", "0.2", "-1e9", "3", "0", "1e-300"], 4)) for _ in range(3)]
    text = "\n".join([*head, *lines]).encode()
    if rng.random() < 0.3:
        text = text[: rng.integers(len(text) + 1)] + rng.bytes(rng.integers(1, 60)) + b"x" * rng.integers(0, 1200)
    return text


def check_bounds(out):
    """Assert that published commands are finite and within the robot's limits."""
    command = out["command"][out["action"] == PUBLISH]
    for name in command.dtype.names:
        assert np.isfinite(command[name]).all(), name
    if len(command):
        assert command["thrust"].min() >= -1e-9
        assert command["thrust"].max() <= ROBOT.max_thrust + 1e-6
        assert np.abs(command["joint_position"]).max() <= ROBOT.joint_limit + 1e-6
        assert command["joint_torque_limit"].min() >= 0.0
        assert command["joint_torque_limit"].max() <= ROBOT.max_joint_torque
