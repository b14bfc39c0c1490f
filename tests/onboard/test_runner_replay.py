"""Pins the runner's tick as a function: commands within bounds for all inputs, the same bytes, logs that replay."""

import re
import shutil

import numpy as np
import pytest
from support.needs import needs_compiler
from support.runner import DRIVING, RELEASED, RESTING, Loop, check_bounds, said

from spidar_gym.onboard.runner_structs import log_layouts

pytestmark = needs_compiler


# Bounds.


WILD = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-300, 0.0, -0.0, 1e9, -1.0, 3.2, -39.0, 34.0, -199.0, 99.0])


def fuzzed(inputs, rng, odds=0.7):
    """Return inputs with wild doubles, random bytes and counts as the links produce them."""
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
        elif what == 1:  # numbers within the accepted ranges, but random
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


def sick(inputs, rng):
    """Return inputs whose messages about health are wild in one tick of ten; no servo reports an error."""
    for tick in np.flatnonzero(rng.random(len(inputs)) < 0.1):
        health = inputs["health"][tick]
        health[rng.choice(("voltage", "voltage_time", "servo_time", "motor_time"))] = rng.choice(WILD)
        health[rng.choice(("servo_count", "motor_count"))] = rng.integers(-(2**31), 2**31)
        name = rng.choice(("servo_angle", "servo_temperature", "servo_load", "motor_output"))
        health[name][rng.integers(8)] = rng.integers(-(2**31), 2**31)
    assert len(np.unique(inputs["health"]["servo_count"])) > 1
    return inputs


def tolerant(mission):
    """Return a mission without limits that would end it."""
    mission = mission.copy()
    limits = mission["limits"]
    limits["hold_ticks"], limits["tilt"], limits["fence_low"], limits["fence_high"] = 10**6, 4.0, -1e9, 1e9
    for name in ("pose_age", "imu_age", "joint_age", "gap"):
        limits[name] = 1e9
    health = limits["health"]
    health["voltage_low"] = health["voltage_critical"] = 0.0
    for name in ("temperature", "load", "output", "age"):
        health[name] = 1e9
    return mission


def wild_stream(stream, seed, ticks):
    """Return inputs with the unchanged wait, followed by repetitions of the drive with faults."""
    rng = np.random.default_rng(seed)
    wait, drive = stream.inputs[stream.hovers - 10 : stream.drives + 2], stream.inputs[stream.drives + 2 :][:90]
    parts, late = [wait], drive["time"][-1] - wait["time"][-1]
    for k in range(-(-ticks // len(drive))):
        again = drive.copy()
        for target, name in ((again, "time"), (again, "flight_state_time"), (again["measurement"], "time"),
                             (again["measurement"], "pose_time"), (again["measurement"], "imu_time"),
                             (again["measurement"], "encoder_time"), (again["health"], "voltage_time"),
                             (again["health"], "servo_time"), (again["health"], "motor_time")):  # fmt: skip
            target[name] += k * late
        again["flight_state"] = stream.wanted
        again["has_thrust"] = 0
        parts.append(sick(fuzzed(again, rng), np.random.default_rng([seed, k])))
    return np.concatenate(parts)


@pytest.mark.parametrize("easy", [False, True], ids=["as it is", "without limits"])
def test_the_command_is_within_its_bounds_for_all_inputs(library, stream, easy):
    drives = 0
    for seed in range(4):
        mission = tolerant(stream.mission) if easy else stream.mission
        out = Loop(library, mission).run(wild_stream(stream, seed, 450 if easy else 90))
        check_bounds(out)
        assert (out["stage"][:50] != RELEASED).all()
        drives += int(np.isin(out["stage"], (DRIVING, RESTING)).sum())
    assert drives > (300 if easy else 8), "too few ticks were driven"


@pytest.mark.slow
def test_sanitizers_find_nothing_in_spoilt_runs(library, checked, stream, tmp_path):
    for seed in range(2):
        mission = tolerant(stream.mission)
        inputs = wild_stream(stream, 10 + seed, 180)
        stream.write(tmp_path / "log", inputs, Loop(library, mission).run(inputs), mission)
        done = said(checked, "replay", tmp_path / "log", tmp_path / "out")
        assert done.returncode in (0, 2), done.stderr[-2000:]
        assert done.stderr in ("", "runner: the replay differs; valid: the runner that wrote the log\n")
        assert f"{len(inputs)} ticks of a run" in done.stdout


# The same bytes.


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
    assert done.stdout == f"{len(stream.inputs)} ticks of a run, 0 with other answers\n"
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
    assert done.stderr == "runner: the replay differs; valid: the runner that wrote the log\n"
    assert int(re.search(r", (\d+) with other", done.stdout)[1]) > 0


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
