"""Pins the runner: when it drives and when it gives back, what every fault leads to, its mission, contract, words."""

import ctypes
import re
import shutil
import subprocess
import threading
from dataclasses import replace

import numpy as np
import pytest
from needs import needs_compiler

from spidar_gym.benchmark.row import model_hash
from spidar_gym.control.planar import Planar
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.control.structs import fill, interface_hash
from spidar_gym.deploy.export import FLAGS, compiler, export_files, write_files
from spidar_gym.deploy.golden import log_layouts
from spidar_gym.deploy.runner import compile_runner
from spidar_gym.deploy.solvers import ONBOARD_ITERATIONS
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, ROBOT
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import crawl_mission, hover_mission
from spidar_gym.sitl.play import play

pytestmark = needs_compiler
WAITING, DRIVING, HOLDING, LANDING, RELEASED = range(5)
SILENT, PUBLISH, FORCE_LANDING = range(3)
(FINE, LATE, NO_STATE, NO_POSE, NO_IMU, NO_JOINTS, NOT_FINITE, OUT_OF_RANGE, OUT_OF_ORDER, JUMPED, TILTED, OUTSIDE,
 CONTENDED, NO_ALLOCATION, BAD_COMMAND) = range(15)  # fmt: skip
HOLD, LAND = 4, 10
"""Ticks."""
ARM_ON, HOVER = 2, 5
NAMES = (*JOINT_NAMES, *GIMBAL_NAMES)
TOPICS = ("joint_states", "imu", "mocap/pose", "uav/cog/odom", "flight_state")
RATES = (50.0, 200.0, 100.0, 100.0, 40.0)
ZEROS = " ".join(["0"] * 16)
CHECKED = ("-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def compile_(folder, out, *flags):
    """All of the folder, the runner's `main` included."""
    sources = [str(p) for part in ("core", "osqp", "runner") for p in sorted((folder / part).glob("*.c"))]
    includes = [f"-I{folder / part}" for part in ("core", "osqp", "generated", "runner")]
    command = [compiler(), *FLAGS, *flags, *includes, *sources, "-lm", "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("runner") / "onboard"
    write_files(export_files(golden=False), path)
    return path


@pytest.fixture(scope="module")
def runner(folder):
    return compile_runner(folder, folder.parent / "runner")


@pytest.fixture(scope="module")
def checked(folder):
    """The runner with sanitizers, not optimised."""
    return compile_(folder, folder.parent / "checked", *CHECKED)


@pytest.fixture(scope="module")
def library(folder):
    library = ctypes.CDLL(str(compile_(folder, folder.parent / "librunner.so", "-O1", "-fPIC", "-shared")))
    library.sp_loop_init.restype = ctypes.c_char_p
    return library


def read_mission(library, text):
    """The mission, or the sentence that refuses it."""
    mission, reason = np.zeros((), log_layouts()["mission"]), ctypes.create_string_buffer(256)
    text = text if isinstance(text, bytes) else text.encode()
    ok = library.sp_read_mission(text, ctypes.c_void_p(mission.ctypes.data), reason, ctypes.c_size_t(256))
    return mission if ok else reason.value.decode()


class Loop:
    """The runner's loop; can be copied."""

    def __init__(self, library, mission):
        self.library, self.record = library, np.zeros((), log_layouts()["loop"])
        pointer = ctypes.c_void_p(self.record.ctypes.data)
        if mission is not None:
            assert self.library.sp_loop_init(pointer, ctypes.c_void_p(mission.ctypes.data)) is None

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
    """A drive of the runner against the simulated robot: mission, what came in, what it answered."""

    def __init__(self, library, path, played):
        self.path, self.run, self.played = path, played.run, played.log
        self.mission = read_mission(library, played.mission.text)
        self.inputs = played.log.inputs.copy()
        size = [log_layouts()[name].itemsize for name in ("loop_input", "loop_output", "log_clock")]
        raw = path.read_bytes()[log_layouts()["log_head"].itemsize + self.mission.nbytes :]
        self.answers = [raw[at + size[0] : at + size[0] + size[1]] for at in range(0, len(raw), sum(size))]
        """What it answered, byte for byte."""
        self.wanted = ARM_ON if self.mission["crawls"] else HOVER
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


@pytest.fixture(scope="module")
def hover(library, runner, folder):
    return played(library, runner, folder, "hover", hover_mission(seconds=3.0))


@pytest.fixture(scope="module")
def crawl(library, runner, folder):
    return played(library, runner, folder, "crawl", replace(crawl_mission(way=Planar(0.05, 0.0, 0.0)), seconds=6.0))


@pytest.fixture(params=["hover", "crawl"])
def stream(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def driving(library, hover):
    """A loop that has driven for 0.75 s, and what comes in then; the loop is to be copied."""
    loop = Loop(library, hover.mission)
    last = loop.run(hover.inputs[: hover.drives + 30])[-1]
    assert last["stage"] == DRIVING
    return loop, hover.inputs[hover.drives + 30 :]


# When it drives.


def test_it_drives_after_good_samples_for_settle_seconds_and_says_nothing_before(library, stream):
    out = Loop(library, stream.mission).run(stream.inputs)
    times = stream.inputs["time"]
    assert times[stream.drives] - times[stream.hovers] == pytest.approx(1.0, abs=0.026)
    assert (out["stage"][: stream.drives] == WAITING).all()
    assert (out["action"][: stream.drives] == SILENT).all()
    assert (out["action"][stream.drives : stream.drives + 80] == PUBLISH).all()
    np.testing.assert_array_equal(out["mission_time"][: stream.drives], 0.0)
    on = np.flatnonzero(out["stage"] == DRIVING)
    np.testing.assert_allclose(out["mission_time"][on], times[on] - times[stream.drives], atol=1e-9)


@pytest.mark.parametrize("state", [*range(18), 255, -1])
def test_no_other_flight_state_is_driven_in(library, stream, state):
    inputs = stream.inputs[stream.hovers : stream.hovers + 60].copy()
    inputs["flight_state"] = state
    out = Loop(library, stream.mission).run(inputs)
    assert (out["action"] == SILENT).all() == (state != stream.wanted)
    assert (out["stage"] == WAITING).all() == (state != stream.wanted)


@pytest.mark.parametrize("state", [*range(5), *range(6, 18), 255, -1])
def test_what_takes_the_robot_back_has_it_for_good(driving, state):
    loop, inputs = driving
    loop, inputs = loop.copy(), inputs[:60].copy()
    inputs["flight_state"][10:12] = state
    out = loop.run(inputs)
    assert (out["action"][:10] == PUBLISH).all()
    assert (out["action"][10:] == SILENT).all()
    assert (out["stage"][10:] == RELEASED).all()


def nan_pose(record, k):
    record["measurement"]["pose_position_w"] = np.nan


def test_a_fault_during_the_wait_restarts_it(library, hover):
    for at in (0, 20, 38):
        inputs = hover.inputs[hover.hovers - 5 :].copy()
        nan_pose(inputs[5 + at], 0)
        out = Loop(library, hover.mission).run(inputs)
        first = int(np.argmax(out["stage"] == DRIVING))
        assert inputs["time"][first] - inputs["time"][5 + at] == pytest.approx(1.0, abs=1e-6)
        assert out["fault"][5 + at] == NOT_FINITE


def test_settle_is_the_missions(library, hover):
    mission = hover.mission.copy()
    mission["limits"]["settle"] = 0.25
    out = Loop(library, mission).run(hover.inputs[: hover.drives])
    assert int(np.argmax(out["stage"] == DRIVING)) - hover.hovers == pytest.approx(10, abs=1)


def test_a_runner_that_is_started_in_hover_waits_too(library, stream):
    out = Loop(library, stream.mission).run(stream.inputs[stream.hovers + 4 :][:60])
    assert (out["action"][:39] == SILENT).all()
    assert out["stage"][42] == DRIVING


@pytest.mark.parametrize("at", [-10, 10], ids=["before", "in the wait"])
@pytest.mark.parametrize("time", [np.nan, np.inf, -np.inf])
def test_a_clock_that_is_no_number_starts_no_drive(library, stream, time, at):
    inputs = stream.inputs[: stream.hovers + 25].copy()
    inputs["time"][stream.hovers + at] = time
    out = Loop(library, stream.mission).run(inputs)
    assert (out["action"] == SILENT).all()
    assert (out["stage"] == WAITING).all()


# Faults.


def put(field, value, of=slice(None)):
    def spoil(record, k):
        target = record["measurement"][field]
        if np.ndim(target):
            target[of] = value
        else:
            record["measurement"][field] = value

    return spoil


def move(field, by):
    def spoil(record, k):
        record["measurement"][field] += by

    return spoil


def tell(**values):
    def spoil(record, k):
        for name, value in values.items():
            record[name] = value

    return spoil


def tip(record, k):
    q = record["measurement"]["pose_quat_wb"].reshape(4, 4)
    w, x, y, z = q.T.copy()
    c, s = np.cos(0.5), np.sin(0.5)  # by 1 rad about x
    q[...] = np.stack([c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y], 1)


def drift(record, k):
    record["measurement"]["pose_position_w"].reshape(4, 3)[:, 0] += 0.08 * k + 0.04 * np.arange(1, 5)


def old_state(record, k):
    record["flight_state_time"] = record["time"] - 0.51


AT_ONCE = {
    **{
        f"{name} {value}": (put(name, value, of), NOT_FINITE)
        for name, of in {
            "pose_position_w": 1, "pose_quat_wb": 3, "pose_time": 0, "gyro_b": 2, "specific_force_b": 14, "imu_time": 4,
            "encoder_time": 0, "joint_position": 15, "vectoring": 0,
        }.items()
        for value in (np.nan, np.inf, -np.inf)
    },
    "time nan": (tell(time=np.nan), NOT_FINITE),
    "time inf": (tell(time=np.inf), NOT_FINITE),
    "pose far": (put("pose_position_w", 101.0, 0), OUT_OF_RANGE),
    "pose far below": (put("pose_position_w", -1e300, 0), OUT_OF_RANGE),
    "attitude of zeros": (put("pose_quat_wb", 0.0), OUT_OF_RANGE),
    "attitude too long": (put("pose_quat_wb", 1.1), OUT_OF_RANGE),
    "gyro": (put("gyro_b", 35.1, 0), OUT_OF_RANGE),
    "accelerometer": (put("specific_force_b", -201.0, 3), OUT_OF_RANGE),
    "joint": (put("joint_position", 3.31, 7), OUT_OF_RANGE),
    "vectoring": (put("vectoring", -40.1, 7), OUT_OF_RANGE),
    **{f"{name} back": (move(name, -0.5), OUT_OF_ORDER) for name in ("pose_time", "imu_time", "encoder_time")},
    **{f"{name} ahead": (move(name, 0.5), OUT_OF_ORDER) for name in ("pose_time", "imu_time", "encoder_time")},
    "state stale": (old_state, NO_STATE),
    "state never": (tell(flight_state_time=-np.inf), NO_STATE),
    "state time nan": (tell(flight_state_time=np.nan), NO_STATE),
    "state ahead": (tell(flight_state_time=1e6), NO_STATE),
    "pose jumps": (move("pose_position_w", 0.5), JUMPED),
    "contended": (tell(has_thrust=1), CONTENDED),
}  # fmt: skip
IN_TIME = {
    "pose stale": (put("pose_count", 0), NO_POSE, 0.2),
    "imu stale": (put("imu_count", 0), NO_IMU, 0.06),
    "joints stale": (put("encoder_time", 0.0), NO_JOINTS, 0.15),
    "joints told no more": (None, NO_JOINTS, 0.15),
    "tips over": (tip, TILTED, 1.5),
    "leaves the fence": (drift, OUTSIDE, 1.2),
}
"""Spoiler, fault, when [s]."""


def spoilt(inputs, spoil):
    inputs = inputs.copy()
    for k, record in enumerate(inputs):
        spoil(record, k)
    return inputs


def check_landing(out, before, fault):
    """Hold, force the landing, silence: from the first tick of `out` on."""
    stages = [HOLDING] * HOLD + [LANDING] * LAND + [RELEASED] * (len(out) - HOLD - LAND)
    assert out["stage"].tolist() == stages
    actions = {HOLDING: PUBLISH, LANDING: FORCE_LANDING, RELEASED: SILENT}
    assert out["action"].tolist() == [actions[stage] for stage in stages]
    assert set(out["fault"].tolist()) == {fault}
    assert all(command.tobytes() == before.tobytes() for command in out["command"][:HOLD])


@pytest.mark.parametrize(("spoil", "fault"), AT_ONCE.values(), ids=AT_ONCE)
def test_a_fault_is_held_then_landed_then_silence(driving, spoil, fault):
    loop, inputs = driving
    loop = loop.copy()
    before = loop.run(inputs[:2])[-1]
    out = loop.run(spoilt(inputs[2:22], spoil))
    check_landing(out, before["command"], fault)
    out = loop.run(inputs[22:40])
    assert (out["action"] == SILENT).all(), "for good"


@pytest.mark.parametrize(("spoil", "fault", "seconds"), IN_TIME.values(), ids=IN_TIME)
def test_what_goes_stale_or_drifts_away_lands(driving, spoil, fault, seconds):
    loop, inputs = driving
    loop, inputs = loop.copy(), inputs.copy()
    if spoil is None:  # what was heard last, again and again
        for name in ("encoder_time", "joint_position", "vectoring"):
            inputs["measurement"][name] = inputs["measurement"][name][0]
    else:
        inputs = spoilt(inputs, spoil)
    out = loop.run(inputs[:80])
    first = int(np.argmax(out["stage"] != DRIVING))
    assert 0 < first <= np.ceil(seconds * 40.0) + 1
    if seconds < 0.5:
        assert first >= seconds * 40.0 - 2
    check_landing(out[first : first + 20], out["command"][first - 1], fault)


@pytest.mark.parametrize("ticks", [1, HOLD])
@pytest.mark.parametrize(("spoil", "fault"), AT_ONCE.values(), ids=AT_ONCE)
def test_a_short_fault_is_survived_and_forgotten(driving, spoil, fault, ticks):
    loop, inputs = driving
    loop = loop.copy()
    second = 2 * ticks + 2
    for start in (0, second):  # after as many good ticks the second has as long a hold as the first
        inputs = inputs.copy()
        for k in range(ticks):
            spoil(inputs[start + k], k)
    out = loop.run(inputs[:30])
    bad = [k for k in range(30) if k < ticks or second <= k < second + ticks]
    assert np.flatnonzero(out["stage"] == HOLDING).tolist() == bad
    assert (np.delete(out["stage"], bad) == DRIVING).all()
    assert set(out["fault"][bad].tolist()) == {fault}
    assert (np.delete(out["fault"], bad) == FINE).all()
    assert (out["action"] == PUBLISH).all()
    commands = out["command"]["thrust"][second + ticks :]
    assert (np.abs(np.diff(commands, axis=0)).max(1) > 0.0).all(), "it goes on"


def test_ticks_that_come_late_are_faults(driving):
    loop, inputs = driving
    one = loop.copy()
    out = one.run(np.delete(inputs, slice(10, 14))[:30])  # 125 ms
    assert np.flatnonzero(out["stage"] == HOLDING).tolist() == [10]
    assert out["fault"][10] == LATE
    # Old commands are in force between late ticks: two of them are 150 ms.
    many = loop.copy()
    many(inputs[0])
    out = many.run(inputs[5::5][:16])
    assert out["stage"][:2].tolist() == [HOLDING, LANDING]
    assert out["fault"][0] == LATE
    assert out["stage"][-1] == RELEASED


def test_a_fault_that_comes_and_goes_ends_in_the_landing_too(driving):
    loop, inputs = driving
    loop, inputs = loop.copy(), inputs[:60].copy()
    inputs["measurement"]["joint_position"][np.arange(60) % 3 < 2, 0] = np.nan
    out = loop.run(inputs)
    assert (out["stage"] == LANDING).any()
    assert out["stage"][-1] == RELEASED


@pytest.mark.parametrize(("field", "value"), [("joint_position", np.nan), ("vectoring", 1e4), ("joint_position", 7.0)])
def test_a_command_out_of_bounds_never_leaves(driving, field, value):
    loop, inputs = driving
    loop = loop.copy()
    before = loop(inputs[0])
    loop.record["flight"]["memory"][field] = value
    out = loop.run(inputs[1:21])
    check_bounds(out)
    if value != 7.0:
        check_landing(out, before["command"], BAD_COMMAND)


def test_without_an_allocation_it_holds_and_lands(driving):
    loop, inputs = driving
    loop = loop.copy()
    loop.record["flight"]["memory"]["position_integral_w"] = np.nan
    out = loop.run(inputs[:20])
    check_bounds(out)
    assert out["stage"].tolist() == [HOLDING] * HOLD + [LANDING] * LAND + [RELEASED] * 6
    assert set(out["fault"].tolist()) == {NO_ALLOCATION}


def test_contention_is_none_right_after_the_take_over(library, hover):
    inputs = hover.inputs[: hover.drives + 30].copy()
    inputs["has_thrust"][hover.drives :] = 1
    out = Loop(library, hover.mission).run(inputs)[hover.drives :]
    assert (out["fault"][:21] == FINE).all()
    assert (out["fault"][22:] == CONTENDED).all()


@pytest.mark.parametrize("thrust", [np.nan, np.inf, -5.0, 1e6])
def test_what_others_tell_the_rotors_is_never_taken_over_where_it_is_no_thrust(library, hover, thrust):
    inputs = hover.inputs[: hover.drives + 30].copy()
    inputs["thrust"][hover.drives - 20 :, 3] = thrust
    out = Loop(library, hover.mission).run(inputs)
    check_bounds(out)
    assert not (out["action"] == FORCE_LANDING).any()
    told = hover.inputs["thrust"][hover.drives].sum()
    assert out["command"]["thrust"][out["stage"] == DRIVING][0].sum() == pytest.approx(told, rel=0.02)


# Bounds, purity.


def check_bounds(out):
    """Of what is published."""
    command = out["command"][out["action"] == PUBLISH]
    for name in command.dtype.names:
        assert np.isfinite(command[name]).all(), name
    if len(command):
        assert command["thrust"].min() >= -1e-9
        assert command["thrust"].max() <= ROBOT.max_thrust + 1e-6
        assert np.abs(command["joint_position"]).max() <= ROBOT.joint_limit + 1e-6
        assert command["joint_torque_limit"].min() >= 0.0
        assert command["joint_torque_limit"].max() <= ROBOT.max_joint_torque


WILD = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-300, 0.0, -0.0, 1e9, -1.0, 3.2, -39.0, 34.0, -199.0, 99.0])


def fuzzed(inputs, rng, odds=0.7):
    """Inputs with wild doubles, random bytes and counts as the links leave them."""
    inputs = inputs.copy()
    for record in inputs:
        if rng.random() > odds:
            continue
        m = record["measurement"]
        what = rng.integers(4)
        names = ("pose_time", "pose_position_w", "pose_quat_wb", "imu_time", "gyro_b", "specific_force_b",
                 "joint_position", "vectoring", "joint_torque")  # fmt: skip
        if what == 0:  # wild numbers
            for _ in range(rng.integers(1, 6)):
                target = m[rng.choice(names)]
                target[rng.integers(len(target))] = rng.choice(WILD)
        elif what == 1:  # numbers that are accepted, and mean nothing
            m["joint_position"] = rng.uniform(-3.3, 3.3, 16)
            m["vectoring"] = rng.uniform(-40.0, 40.0, 16)
            m["joint_torque"] = rng.choice(WILD, 16)
            m["gyro_b"] = rng.uniform(-35.0, 35.0, 24)
            m["specific_force_b"] = rng.uniform(-200.0, 200.0, 24)
        elif what == 2:  # attitudes
            q = rng.normal(size=(4, 4))
            m["pose_quat_wb"] = (q / np.linalg.norm(q, axis=1, keepdims=True)).reshape(-1)
        else:  # bytes
            raw = bytearray(m.tobytes())
            at = rng.integers(len(raw) - 8)
            raw[at : at + 8] = rng.bytes(8)
            record["measurement"] = np.frombuffer(bytes(raw), m.dtype)[0]
        m["pose_count"], m["imu_count"] = rng.integers(0, 5), rng.integers(0, 9)
    return inputs


def tolerant(mission):
    """A mission that nothing ends."""
    mission = mission.copy()
    limits = mission["limits"]
    limits["hold_ticks"], limits["tilt"], limits["fence_low"], limits["fence_high"] = 10**6, 4.0, -1e9, 1e9
    for name in ("pose_age", "imu_age", "joint_age", "gap"):
        limits[name] = 1e9
    return mission


def wild_stream(stream, seed, ticks):
    """The wait as it was, then the drive spoilt, again and again."""
    rng = np.random.default_rng(seed)
    wait, drive = stream.inputs[stream.hovers - 10 : stream.drives + 2], stream.inputs[stream.drives + 2 :][:90]
    parts, late = [wait], drive["time"][-1] - wait["time"][-1]
    for k in range(-(-ticks // len(drive))):
        again = drive.copy()
        for target, name in ((again, "time"), (again, "flight_state_time"), (again["measurement"], "time"),
                             (again["measurement"], "pose_time"), (again["measurement"], "imu_time"),
                             (again["measurement"], "encoder_time")):  # fmt: skip
            target[name] += k * late
        again["flight_state"] = stream.wanted
        again["has_thrust"] = 0
        parts.append(fuzzed(again, rng))
    return np.concatenate(parts)


@pytest.mark.parametrize("easy", [False, True], ids=["as it is", "without limits"])
def test_the_command_is_within_its_bounds_whatever_comes_in(library, stream, easy):
    drives = 0
    for seed in range(4):
        mission = tolerant(stream.mission) if easy else stream.mission
        out = Loop(library, mission).run(wild_stream(stream, seed, 450 if easy else 90))
        check_bounds(out)
        assert (out["stage"][:50] != RELEASED).all()
        drives += int((out["stage"] == DRIVING).sum())
    assert drives > (300 if easy else 8), "it was driven through"


@pytest.mark.slow
def test_sanitizers_find_nothing_in_spoilt_runs(library, checked, stream, tmp_path):
    for seed in range(2):
        mission = tolerant(stream.mission)
        inputs = wild_stream(stream, 10 + seed, 180)
        stream.write(tmp_path / "log", inputs, Loop(library, mission).run(inputs), mission)
        done = said(checked, "replay", tmp_path / "log", tmp_path / "out")
        assert done.returncode in (0, 2), done.stderr[-2000:]
        assert done.stderr in ("", "runner: the run replays otherwise; valid: the runner that wrote it\n")
        assert f"{len(inputs)} ticks of a run" in done.stdout


def said(*words):
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, errors="replace", check=False)


def test_the_same_inputs_give_the_same_bytes(library, stream):
    a, b = Loop(library, stream.mission), Loop(library, stream.mission)
    one = [a(record).tobytes() for record in stream.inputs]
    assert one == stream.answers
    a = Loop(library, stream.mission)
    rest = wild_stream(stream, 7, 90)
    for k, (record, expected) in enumerate(zip(stream.inputs, one, strict=True)):
        b(rest[k % len(rest)])  # another robot's ticks in between
        assert a(record).tobytes() == expected


@pytest.mark.parametrize("program", ["runner", "checked"])
def test_a_run_replays_to_its_very_bytes_and_without_optimisation(request, stream, tmp_path, program):
    done = said(request.getfixturevalue(program), "replay", stream.path, tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{len(stream.inputs)} ticks of a run, 0 answered otherwise than then\n"
    assert (tmp_path / "out").read_bytes() == stream.path.read_bytes()


def test_a_log_with_another_input_is_reported(hover, runner, tmp_path):
    tick = sum(log_layouts()[name].itemsize for name in ("loop_input", "loop_output", "log_clock"))
    data = bytearray(hover.path.read_bytes())
    front = len(data) - tick * len(hover.inputs)
    at = log_layouts()["loop_input"].fields["measurement"][1] + log_layouts()["measurement"].fields["joint_position"][1]
    data[front + tick * (hover.drives + 40) + at + 5] ^= 16
    (tmp_path / "log").write_bytes(data)
    done = said(runner, "replay", tmp_path / "log", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr == "runner: the run replays otherwise; valid: the runner that wrote it\n"
    assert int(re.search(r", (\d+) answered", done.stdout)[1]) > 0


@pytest.mark.parametrize("part", ["clock", "output", "input", "mission", "head", "magic"])
def test_a_truncated_log_is_refused_in_one_line(hover, runner, tmp_path, part):
    size = {name: log_layouts()[name].itemsize for name in ("log_head", "mission", "loop_input", "loop_output")}
    data = hover.path.read_bytes()
    first = size["log_head"] + size["mission"]
    keep = {
        "clock": len(data) - 5, "output": len(data) - 500, "input": first + 100, "mission": 1000, "head": 44, "magic": 3
    }[part]  # fmt: skip
    (tmp_path / "log").write_bytes(data[:keep])
    done = said(runner, "replay", tmp_path / "log", tmp_path / "out")
    assert done.returncode == 2
    assert re.fullmatch(r"runner: (the log ends early|no log); valid: .+\n", done.stderr)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("field", "count"), [("pose_count", 5), ("pose_count", -1), ("imu_count", 9)])
def test_a_log_with_counts_that_no_link_makes_is_refused(library, hover, checked, tmp_path, field, count):
    inputs = hover.inputs[:50].copy()
    out = Loop(library, hover.mission).run(inputs)
    inputs["measurement"][field][40] = count
    hover.write(tmp_path / "log", inputs, out)
    done = said(checked, "replay", tmp_path / "log", tmp_path / "out")
    assert (done.returncode, done.stderr) == (2, "runner: the log ends early; valid: a whole one\n")


def test_a_log_is_not_replayed_onto_itself(hover, runner, tmp_path):
    shutil.copyfile(hover.path, tmp_path / "log")
    done = said(runner, "replay", tmp_path / "log", tmp_path / "log")
    assert done.returncode == 2
    assert (tmp_path / "log").is_file()
    assert (tmp_path / "log").read_bytes() == hover.path.read_bytes()


@pytest.mark.parametrize("share", [0.9, 1.0, 1.05, 1.1])
def test_it_takes_over_with_the_thrust_that_the_robots_own_stack_told(library, hover, share):
    inputs = hover.inputs[: hover.drives + 1].copy()
    inputs["thrust"] *= share
    told = inputs["thrust"][-1].sum()
    out = Loop(library, hover.mission).run(inputs)[-1]
    assert out["stage"] == DRIVING
    assert out["command"]["thrust"].sum() == pytest.approx(told, rel=0.02)


# The mission.


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_every_kind_of_line_is_read(library, end):
    form = " ".join(f"{0.05 * k - 0.4:g}" for k in range(16))
    lines = [
        "# a flight", "", "  flight   tuned  # a comment", f"form 0 {ZEROS}", f"\tform 2.5\t{form}", "   ",
        "unrestricted 3 4.5", "unrestricted 6 7", "estimate odometry", "residual on", "fence -1 -2 -0.5 1 2 2.5",
        "ages 0.1 0.05 0.2 0.4", "settle 2", "tilt 0.5", "speed 0.7", "end 12.5",
    ]  # fmt: skip
    m = read_mission(library, end.join(lines))
    assert not isinstance(m, str), m
    assert [int(m[name]) for name in ("crawls", "odometry", "residual")] == [0, 1, 1]
    assert [int(m[f"{name}_count"]) for name in ("form", "window", "move")] == [2, 2, 0]
    np.testing.assert_array_equal(m["forms"]["start"][:2], [0.0, 2.5])
    np.testing.assert_allclose(m["forms"]["joint_target"][1], 0.05 * np.arange(16) - 0.4, atol=1e-12)
    assert m["windows"][:2].tolist() == [(3.0, 4.5), (6.0, 7.0)]
    limits = m["limits"]
    np.testing.assert_array_equal(limits["fence_low"], [-1.0, -2.0, -0.5])
    np.testing.assert_array_equal(limits["fence_high"], [1.0, 2.0, 2.5])
    ages = [float(limits[f"{name}_age"]) for name in ("pose", "imu", "joint", "state")]
    assert ages == [0.1, 0.05, 0.2, 0.4]
    assert [float(limits[name]) for name in ("settle", "tilt")] == [2.0, 0.5]
    assert [float(m["controller"]["joint_speed"]), float(m["end"])] == [0.7, 12.5]
    crawl = read_mission(library, end.join(["crawl robust", "move 0.1 -0.2 0.3 4", "move 0.2 0 0 0", "speed 0.4"]))
    assert [int(crawl["crawls"]), int(crawl["move_count"])] == [1, 2]
    assert crawl["moves"][0].item()[:2] == ((0.1, -0.2, 0.3), 4)
    assert crawl["crawler"]["joint_speed"] == 0.4
    assert limits["hold_ticks"] == crawl["limits"]["hold_ticks"] == HOLD
    assert limits["landing_ticks"] == LAND


@pytest.mark.parametrize(
    ("kind", "name", "config"),
    [("flight", name, config) for name, config in PRESETS.items()]
    + [("crawl", name, config) for name, config in CRAWL_PRESETS.items()],
)
def test_presets_are_the_simulators_with_the_robots_iteration_cap(library, kind, name, config):
    m = read_mission(library, f"{kind} {name}\n")
    field = "crawler" if kind == "crawl" else "controller"
    expected = np.zeros((), log_layouts()[f"{field}_config"])
    fill(expected, replace(config, allocator=replace(config.allocator, max_iter=ONBOARD_ITERATIONS)))
    assert m[field].tobytes() == expected.tobytes()
    assert m[field]["allocator"]["max_iter"] == 300


REFUSED = {
    "": "line 0; valid: flight PRESET or crawl PRESET first",
    "# nothing\n\n": "flight PRESET or crawl PRESET first",
    "end 3\nflight paper": "line 1; valid: flight PRESET or crawl PRESET first",
    "flight paper\nflight paper": "line 2; valid: one flight or one crawl",
    "flight paper\ncrawl robust": "line 2; valid: one flight or one crawl",
    "flight": "flight and one of paper, as_flown, tuned",
    "flight robust": "line 1; valid: flight and one of paper, as_flown, tuned",
    "crawl tuned": "crawl and one of published, overlapped, robust",
    "flight paper tuned": "flight and one of",
    "flight paper\nform 0 1 2": "line 2; valid: form SECONDS and 16 angles",
    f"flight paper\nform 0 {ZEROS} 0": "form SECONDS and 16 angles",
    f"flight paper\nform -1 {ZEROS}": "form SECONDS and 16 angles",
    f"flight paper\nform nan {ZEROS}": "form SECONDS and 16 angles",
    f"flight paper\nform 0x {ZEROS}": "form SECONDS and 16 angles",
    f"flight paper\nform 0 1.6 {ZEROS[2:]}": "form angles within ± 90 degrees",
    f"flight paper\nform 2 {ZEROS}\nform 1 {ZEROS}": "line 3; valid: at most 64 forms, in the order of their times",
    f"flight paper\n{f'form 1 {ZEROS}{chr(10)}' * 65}": "line 66; valid: at most 64 forms",
    "flight paper\n" + "unrestricted 1 2\n" * 9: "line 10; valid: at most 8 windows",
    "flight paper\nunrestricted 2 2": "unrestricted START END",
    "crawl robust\n" + "move 0.1 0 0 0\n" * 17: "line 18; valid: at most 16 moves",
    "crawl robust\nmove 0.1 0 0": "move X Y [m] YAW [rad] CYCLES",
    "crawl robust\nmove 0.1 0 0 1.5": "move X Y [m] YAW [rad] CYCLES",
    "crawl robust\nmove 0.1 0 0 -1": "move X Y [m] YAW [rad] CYCLES",
    "crawl robust\nmove inf 0 0 1": "move X Y [m] YAW [rad] CYCLES",
    "crawl robust\nmove 0.1 0 0 1e9": "move X Y [m] YAW [rad] CYCLES",
    f"crawl robust\nform 0 {ZEROS}": "form, unrestricted, end for a flight; move for a crawl",
    "crawl robust\nunrestricted 1 2": "form, unrestricted, end for a flight; move for a crawl",
    "flight paper\nmove 0.1 0 0 1": "form, unrestricted, end for a flight; move for a crawl",
    "flight paper\nestimate": "line 2; valid: estimate mocap, or estimate odometry",
    "flight paper\nestimate gps": "estimate mocap, or estimate odometry",
    "flight paper\nresidual yes": "residual on, or residual off",
    "flight paper\nfence 1 1 1 2 2": "fence, then x y z of its low and of its high corner",
    "flight paper\nfence 1 1 1 2 1 2": "a fence whose low corner is below its high one",
    "flight paper\nages 0.1 0.1 0.1": "ages of pose, inertial unit, joints, flight state",
    "flight paper\nages 0.1 0.1 0.1 0.6": "ages within 0 … 0.5 s",
    "flight paper\nages 0.1 0 0.1 0.1": "ages within 0 … 0.5 s",
    "flight paper\nsettle": "one number after settle, tilt, speed, end",
    "flight paper\nsettle 0": "a number above 0",
    "flight paper\ntilt -1": "a number above 0",
    "flight paper\ntilt 1.01": "tilt within 0 … 1 rad",
    "flight paper\nspeed fast": "one number after settle, tilt, speed, end",
    "flight paper\nend 1 2": "one number after settle, tilt, speed, end",
    "flight paper\nhover 3": "line 2; valid: flight, crawl, form, move, unrestricted, estimate, residual, fence, ages,",
    "flight paper\nFORM 3": "flight, crawl, form, move",
    "flight paper\nend" + " 1" * 30: "line 2; valid: fewer words",
    "flight paper\n#" + "x" * 1100: "line 2; valid: a line of at most 1023 characters",
}


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_a_wrong_line_is_named_with_what_would_be_valid(library, text):
    reason = read_mission(library, text)
    assert isinstance(reason, str)
    assert re.match(r"mission, line \d+; valid: ", reason)
    assert REFUSED[text] in reason


@pytest.mark.parametrize(
    "text",
    [
        "flight paper\n#" + "x" * 1022,
        "flight paper\n" + f"form 1 {ZEROS}\n" * 64,
        "flight paper\n" + "unrestricted 1 2\n" * 8,
        "crawl robust\n" + "move 0.1 0 0 0\n" * 16,
        f"flight paper\nform 1 {ZEROS}\nform 1 {ZEROS}",
        f"flight paper\nform 0 1.5708 -1.5708 {ZEROS[4:]}",
        "\n\n#\n  crawl published",
        "flight\tpaper",
    ],
    ids=range(8),
)
def test_what_is_just_valid_is_read(library, text):
    m = read_mission(library, text)
    assert not isinstance(m, str), m
    assert np.abs(m["forms"]["joint_target"]).max() <= ROBOT.joint_limit


def junk(rng):
    """A mission of words that it knows, numbers, and rubbish."""
    words = ["flight", "crawl", "form", "move", "unrestricted", "estimate", "residual", "fence", "ages", "settle",
             "tilt", "speed", "end", "paper", "robust", "tuned", "odometry", "on", "0", "1", "-1", "1e300", "-1e-300",
             "nan", "0.1", "inf", "0x1p3", "#", "\t", "\r", "…", "2147483648", "%s%n", ZEROS]  # fmt: skip
    head = [["flight paper"], ["crawl published"], []][rng.integers(3)]
    lines = [" ".join(rng.choice(words, rng.integers(0, 26))) for _ in range(rng.integers(0, 12))]
    if rng.random() < 0.5:
        lines = ["move " + " ".join(rng.choice(["1e300", "0.2", "-1e9", "3", "0", "1e-300"], 4)) for _ in range(3)]
    text = "\n".join([*head, *lines]).encode()
    if rng.random() < 0.3:
        text = text[: rng.integers(len(text) + 1)] + rng.bytes(rng.integers(1, 60)) + b"x" * rng.integers(0, 1200)
    return text


def test_junk_is_read_or_refused(library):
    rng, kinds = np.random.default_rng(5), set()
    for _ in range(1500):
        answer = read_mission(library, junk(rng).replace(b"\0", b""))
        kinds.add(type(answer))
        if isinstance(answer, str):
            assert re.match(r"mission, line \d+; valid: ", answer)
        else:
            assert answer["limits"]["tilt"] <= 1.0
            assert np.isfinite(answer["forms"]["joint_target"]).all()
    assert len(kinds) == 2


@pytest.mark.slow
def test_sanitizers_find_nothing_in_junk(checked, tmp_path):
    rng = np.random.default_rng(6)
    for _ in range(60):
        (tmp_path / "mission").write_bytes(junk(rng))
        done = said(checked, "sim", "127.0.0.1:1", tmp_path / "mission")
        assert done.returncode == 2
        assert done.stderr.startswith("runner: ")
        assert done.stderr.count("\n") == 1


def test_a_move_out_of_reach_is_refused_before_anybody_is_asked(runner, tmp_path):
    (tmp_path / "mission").write_text("crawl published\nmove 5 0 0 1\n")
    done = said(runner, "sim", "127.0.0.1:1", tmp_path / "mission")
    assert (done.returncode, done.stderr) == (2, "runner: a move of the mission is out of reach; valid: shorter ones\n")


@pytest.mark.parametrize("size", [70_000, 200_000])
def test_a_mission_that_is_too_long_is_not_cut(runner, tmp_path, size):
    text = "flight paper\n" + ("#" + "x" * 998 + "\n") * (size // 1000) + "nonsense\n"
    (tmp_path / "mission").write_text(text)
    done = said(runner, "sim", "127.0.0.1:1", tmp_path / "mission")
    assert done.returncode == 2
    assert "mission" in done.stderr, "not that nobody answers there"


# The contract.


class Robot(ctypes.Structure):
    """sp_robot."""

    _fields_ = [
        ("model", ctypes.c_char_p), ("name_count", ctypes.c_int32), ("names", ctypes.POINTER(ctypes.c_char_p)),
        ("rates", ctypes.c_double * 5),
    ]  # fmt: skip


def agree(library, odometry=0, model=None, names=NAMES, **rates):
    """What the contract has against a robot; nothing against the right one."""
    found = (ctypes.c_double * 5)(*(rates.get(t, rate) for t, rate in zip(TOPICS, RATES, strict=True)))
    words = (ctypes.c_char_p * len(names))(*(name.encode() for name in names))
    robot, reason = Robot((model or model_hash()).encode(), len(names), words, found), ctypes.create_string_buffer(256)
    ok = library.sp_agree(ctypes.byref(robot), odometry, reason, ctypes.c_size_t(256))
    assert bool(ok) == (not reason.value)
    return reason.value.decode()


@pytest.mark.parametrize("odometry", [0, 1])
def test_the_right_robot_is_accepted(library, odometry):
    assert agree(library, odometry) == ""
    unused = ["imu", "mocap/pose"] if odometry else ["uav/cog/odom"]
    assert agree(library, odometry, **dict.fromkeys(unused, 0.0)) == "", "topics that nobody needs"
    for factor in (0.75, 1.25):
        rates = {t: factor * rate for t, rate in zip(TOPICS, RATES, strict=True)}
        assert agree(library, odometry, **rates) == ""
    assert agree(library, odometry, flight_state=3.0) == "", "its state may come as it likes"


@pytest.mark.parametrize("odometry", [0, 1])
@pytest.mark.parametrize("topic", TOPICS)
def test_each_topic_and_its_rate_is_asked_for(library, odometry, topic):
    if topic in (("imu", "mocap/pose") if odometry else ("uav/cog/odom",)):
        return
    for rate in (0.0, np.nan, -1.0):
        assert agree(library, odometry, **{topic: rate}).startswith(f"nothing comes on {topic}; valid: ")
    if topic != "flight_state":
        due = RATES[TOPICS.index(topic)]
        for rate in (0.69 * due, 1.31 * due, np.inf):
            words = agree(library, odometry, **{topic: rate})
            assert words == f"{topic} comes at {rate:.0f} Hz; valid: {0.7 * due:.0f} … {1.3 * due:.0f}"


def swapped(a, b):
    names = list(NAMES)
    names[a], names[b] = names[b], names[a]
    return tuple(names)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (NAMES[:-1], "joint_states names 31 angles; valid: 16 joints, then 16 gimbals"),
        ((), "joint_states names 0 angles"),
        ((*NAMES, "tail"), "joint_states names 33 angles"),
        (swapped(3, 4), f"joint_states has {NAMES[4]} in place 4; valid: {NAMES[3]}"),
        (swapped(15, 16), f"joint_states has {NAMES[16]} in place 16; valid: {NAMES[15]}"),
        ((*NAMES[:-1], "other"), f"joint_states has other in place 32; valid: {NAMES[-1]}"),
    ],
    ids=["missing", "none", "one more", "permuted", "across", "other"],
)
def test_other_joints_are_refused(library, runner, tmp_path, names, words):
    assert agree(library, names=names).startswith(words)
    refused(runner, tmp_path, words, names=names)


def test_another_model_is_refused(library, runner, tmp_path):
    words = f"the robot's model is {'0' * 12}; valid: {model_hash()[:12]}, that of this export"
    assert agree(library, model="0" * 64).startswith(words)
    assert agree(library, model=model_hash()[:-1] + "x").startswith("the robot's model is")
    robot = Robot(None, 32, (ctypes.c_char_p * 32)(*(name.encode() for name in NAMES)), (ctypes.c_double * 5)(*RATES))
    reason = ctypes.create_string_buffer(256)
    assert not library.sp_agree(ctypes.byref(robot), 0, reason, ctypes.c_size_t(256))
    assert b"not told" in reason.value
    refused(runner, tmp_path, words, model="0" * 64)


def refused(runner, tmp_path, words, **robot):
    """End to end: one line, and status 2."""
    (tmp_path / "mission").write_text("flight paper\n")
    link = SocketLink(**robot)

    def greet():
        link.accept()
        link.close()  # who is satisfied with the robot waits no longer

    robot_side = threading.Thread(target=greet)
    robot_side.start()
    done = said(runner, "sim", link.place, tmp_path / "mission")
    robot_side.join()
    assert done.returncode == 2
    assert done.stderr.startswith(f"runner: {words}")
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def ask(runner, tmp_path, inputs, hello=None, log=None, seconds=3.0):
    """The runner's answers to inputs over the socket, and what it said."""
    (tmp_path / "mission").write_text(hover_mission(seconds=seconds).text)
    link = SocketLink()
    if hello is not None:
        link._hello[...] = hello(link._hello)
    program = subprocess.Popen(
        [str(runner), "sim", link.place, str(tmp_path / "mission"), *(["--log", str(log)] if log else [])],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    link.accept()
    answers = []
    for record in inputs:
        link._peer.sendall(record.tobytes())
        data = b""
        while part := link._peer.recv(link.answer.dtype.itemsize - len(data)):
            data += part
            if len(data) == link.answer.dtype.itemsize:
                break
        answers.append(data)
    link.close()
    out, words = program.communicate(timeout=20)
    return answers, program.returncode, out, words


def test_a_simulator_with_another_interface_is_refused(runner, tmp_path):
    def other(hello):
        hello["interface"][3] ^= 1
        return hello

    _, status, _, words = ask(runner, tmp_path, [], other)
    assert (status, words) == (2, "runner: the simulator speaks another interface; valid: one of this export\n")


@pytest.mark.parametrize(("field", "count"), [("pose_count", 10**6), ("imu_count", 9), ("pose_count", -3)])
def test_counts_over_the_socket_that_no_link_makes_read_no_memory(checked, hover, tmp_path, field, count):
    inputs = hover.inputs[:10].copy()
    inputs["measurement"][field][5] = count
    _, status, _, words = ask(checked, tmp_path, inputs[:6])
    assert status in (0, 2), words[-2000:]
    assert "Sanitizer" not in words
    assert "runtime error" not in words


# Words and figures.


def test_the_deadline_statistics_add_up(runner, hover, tmp_path):
    answers, status, out, words = ask(runner, tmp_path, hover.inputs, log=tmp_path / "log")
    assert answers == hover.answers
    assert status == 0
    line = re.search(r"computing a tick +(\d+) +median < +(\d+) +p99 < +(\d+) +worst +([\d.]+) us", out)
    assert int(line[1]) == len(answers)
    assert 0 < int(line[2]) <= int(line[3]) <= 4000
    assert "tick after its due time" not in out, "lock-step has no due time"
    assert f"{len(answers)} ticks, 0 later than a period; released; last fault: none\n" in out
    assert re.search(r"^runner: [\d.]+ s: driving$", words, re.M)
    assert (tmp_path / "log").stat().st_size == hover.path.stat().st_size


def test_a_fault_that_lands_is_named_and_is_the_exit_status(runner, hover, tmp_path):
    inputs = hover.inputs[: hover.drives + 60].copy()
    for record in inputs[hover.drives + 30 :]:
        nan_pose(record, 0)
    _, status, out, words = ask(runner, tmp_path, inputs, seconds=0.5)
    assert status == 1
    assert re.search(r"^runner: [\d.]+ s: the mission is over$", words, re.M)
    assert "released; landing forced: a sample is not finite\n" in out
    stages = re.findall(r"s: ([a-z ]+)(?:, a sample is not finite)?$", words, re.M)
    assert stages == ["driving", "the mission is over", "holding", "forcing the landing", "released"]


@pytest.mark.parametrize(
    "words",
    [
        [], ["fly"], ["replay", "a"], ["replay", "a", "b", "c"], ["compare", "a"], ["bench"], ["about", "x"], ["sim"],
        ["sim", "127.0.0.1:1"], ["sim", "127.0.0.1:1", "m", "--log"], ["sim", "127.0.0.1:1", "m", "--colour"], ["ros1"],
        ["sim", "127.0.0.1:1", "m", "extra"], ["-h"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_wrong_words_are_answered_with_the_usage(runner, words):
    done = said(runner, *words)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("usage: runner replay IN OUT | compare")


def test_what_cannot_be_read_written_or_reached_is_refused_in_one_line(runner, tmp_path):
    mission, sim = tmp_path / "mission", ("sim", "127.0.0.1:1")
    mission.write_text("flight paper\n")
    for words, expected in (
        (
            (*sim, tmp_path / "none"),
            f"{tmp_path / 'none'}: no mission; valid: a text file of at most 65535 characters, see README.md",
        ),
        ((*sim, tmp_path), "valid: "),
        ((*sim, mission, "--log", tmp_path / "no" / "log"), f"{tmp_path / 'no' / 'log'}: cannot be written; valid: "),
        ((*sim, mission, "--log", tmp_path), f"{tmp_path}: cannot be written; valid: "),
        ((*sim, mission, "--log", "/dev/full"), "/dev/full: cannot be written; valid: "),
        ((*sim, mission), "nobody answers there; valid: "),
        (("sim", "nowhere", mission), "nobody answers there; valid: "),
        (("sim", "a" * 300 + ":1", mission), "nobody answers there; valid: "),
        (("ros1", mission), "compiled without ROS 1; valid: "),
        (("replay", tmp_path / "none", tmp_path / "out"), "no log; valid: "),
        (("replay", mission, tmp_path / "out"), "no log; valid: "),
    ):
        done = said(runner, *words)
        assert done.returncode == 2, words
        assert done.stderr.startswith("runner: "), words
        assert expected in done.stderr
        assert done.stderr.count("\n") == 1
        assert done.stdout == ""


def test_about_says_what_it_was_compiled_for(runner):
    assert said(runner, "about").stdout == f"interface {interface_hash()}\nmodel {model_hash()}\n"


# The lab's own estimate.


@pytest.mark.slow
def test_with_the_labs_estimate_it_sees_the_robot_where_it_is(library, runner, folder):
    stream = played(library, runner, folder, "odometry", hover_mission(seconds=1.5, odometry=True))
    assert stream.mission["odometry"] == 1
    truth = {round(row.time, 6): row.state for row in stream.run.rows}
    on = np.flatnonzero(stream.played.outputs["stage"] == DRIVING)
    assert len(on) > 50
    where, fast = [], []
    for tick in on:
        seen, state = stream.played.outputs["state"][tick], truth[round(float(stream.inputs["time"][tick]), 6)]
        where.append(np.abs(seen["position_w"] - state.position_w).max())
        fast.append(np.abs(seen["velocity_w"] - state.velocity_w).max())
    assert max(where) < 0.02
    assert max(fast) < 0.1
