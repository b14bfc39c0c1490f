"""Pins tests of the robot through the runner: excitations in a hover, headings, a bench test, and what ends them."""

import json
import math
import sys

import numpy as np
import pytest
from support.needs import needs_compiler
from support.runner import (
    ARM_ON,
    BENCH,
    DRIVING,
    FINE,
    FORCE_LANDING,
    HOLD,
    HOVER,
    NO_POSE,
    PUBLISH,
    RESTING,
    SILENT,
    STRAINED,
    Loop,
    check_bounds,
    played,
    read_mission,
    said,
)

from spidar_gym.robot import N_JOINTS, ROBOT
from spidar_gym.sitl.missions import HANGING, Mission, bench_mission, forms_mission, legs_mission, thrust_mission
from spidar_gym.so3 import euler_angles, quat_to_matrix

pytestmark = needs_compiler
FORM = "form 0 " + " ".join(["0"] * N_JOINTS)
SWINGS = (
    "excite thrust 3 sine 1 4 6 1.5", "excite thrust 8 square 2 4 -4 1", "excite joint 2 chirp 1 4 0.02 0.5 2",
)  # fmt: skip
ON_STAND = ("form 0 0.1 1.4 0 0 " + "0 1.4 0 0 " * 3, "excite joint 7 square 1 4 0.1 0.5", "end 5")


@pytest.fixture(scope="module")
def swung(library, runner, tmp_path_factory):
    """A hover with two swinging modules, a swinging joint and a turn."""
    lines = ["flight as_flown", FORM, *SWINGS, "heading 2 0.3", "deviation 0.3", "end 5"]
    mission = Mission("swung", "as_flown", "\n".join(lines), 5.0)
    return played(library, runner, tmp_path_factory.mktemp("swung") / "x", "swung", mission)


@pytest.fixture(scope="module")
def bench(library, runner, tmp_path_factory):
    """A bench test."""
    mission = Mission("bench", "", "\n".join(["bench", *ON_STAND]), 5.0, on_stand=True)
    return played(library, runner, tmp_path_factory.mktemp("bench") / "x", "bench", mission)


def test_lines_of_tests_are_read(library):
    m = read_mission(library, "\n".join(["flight steady", *SWINGS, "heading 2 -0.5", "deviation 0.2", "torque 3"]))
    assert m["excitation_count"] == 3
    assert m["heading_count"] == 1
    assert m["excitations"][0].item() == (1, 2, 0, 0, 1.0, 4.0, 6.0, 1.5, 1.5)
    assert m["excitations"][2].item() == (0, 1, 1, 0, 1.0, 4.0, 0.02, 0.5, 2.0)
    assert m["headings"][0].item() == (2.0, -0.5)
    assert [float(m["limits"][name]) for name in ("deviation", "torque")] == [0.2, 3.0]
    assert read_mission(library, "\n".join(["bench", *ON_STAND]))["kind"] == BENCH


@pytest.mark.parametrize(
    ("line", "valid"),
    [
        ("excite joint 1 sine 1 2 0.1", "excite joint or thrust, NUMBER, sine or square, BEGIN END"),
        ("excite joint 1 chirp 1 2 0.1 1", "excite joint or thrust"),
        ("excite leg 1 sine 1 2 0.1 1", "excite joint or thrust"),
        ("excite joint 1 saw 1 2 0.1 1", "excite joint or thrust"),
        ("excite joint 1 sine 1 nan 0.1 1", "excite joint or thrust"),
        ("excite joint 17 sine 1 2 0.1 1", "joints 1 … 16, modules 1 … 8"),
        ("excite thrust 0 sine 1 2 0.1 1", "joints 1 … 16, modules 1 … 8"),
        ("excite thrust 1.5 sine 1 2 0.1 1", "joints 1 … 16, modules 1 … 8"),
        ("excite thrust 1 sine 2 2 0.1 1", "an excitation that ends after its begin"),
        ("excite thrust 1 sine 1 2 10.5 1", "an amplitude within ± 0.3 rad or ± 10 N"),
        ("excite joint 1 square 1 2 0.31 1", "an amplitude within ± 0.3 rad or ± 10 N"),
        ("excite thrust 1 sine 1 2 1 11", "frequencies above 0, at most 10 Hz"),
        ("excite thrust 1 chirp 1 2 1 0 3", "frequencies above 0, at most 10 Hz"),
        ("excite joint 1 chirp 1 2 0.2 1 2", "within 1.62 rad/s, what the servos can do"),
        ("heading 1 4", "headings within ± 3.14159 rad"),
        ("heading 1", "heading SECONDS YAW"),
        ("heading 3 0.1\nheading 2 0.1", "heading SECONDS YAW [rad], in the order of their times"),
        ("heading 1 0\n" * 17, "at most 16 headings"),
        ("excite thrust 1 sine 1 2 1 1\n" * 65, "at most 64 excitations"),
        ("deviation 0", "a number above 0"),
        ("bench", "one flight, crawl, course or bench"),
    ],
)
def test_what_no_test_can_be_is_refused(library, line, valid):
    assert valid in read_mission(library, f"flight paper\n{line}")


@pytest.mark.parametrize(
    ("text", "valid"),
    [
        ("bench tuned", "bench alone"),
        (
            "bench\nexcite thrust 1 sine 1 2 1 1",
            "a bench test, excite thrust for a flight",
        ),
        ("crawl robust\nexcite joint 1 sine 1 2 0.1 1", "excite joint for a flight or a bench test"),
        ("bench\nheading 1 1", "heading for a flight"),
        ("bench\nunrestricted 1 2", "unrestricted for a flight"),
        ("bench\nmove 0.1 0 0 1", "move for a crawl"),
    ],
)
def test_what_does_not_belong_to_a_kind_is_refused(library, text, valid):
    assert valid in read_mission(library, text)


def test_thrusts_swing_about_the_allocated_ones_as_written(swung):
    out = swung.played.outputs[swung.drives :]
    out = out[out["stage"] == DRIVING]
    t = out["mission_time"]
    allocated = np.linalg.norm(out["forces_l"].reshape(-1, 8, 3), axis=2)
    added = out["command"]["thrust"] - allocated
    on = (t >= 1.0) & (t < 4.0)
    ramp = np.minimum(1.0, np.minimum(t - 1.0, 4.0 - t) / 0.75)
    sine = np.where(on, 6.0 * ramp * np.sin(2.0 * math.pi * 1.5 * (t - 1.0)), 0.0)
    square = np.where((t >= 2.0 - 1e-6) & (t < 4.0 - 1e-6), np.where((t - 2.0 + 1e-6) % 1.0 < 0.5, -4.0, 4.0), 0.0)
    np.testing.assert_allclose(added[:, 2], sine, atol=1e-6)
    np.testing.assert_allclose(added[:, 7], square, atol=1e-6)
    np.testing.assert_allclose(added[:, [0, 1, 3, 4, 5, 6]], 0.0, atol=1e-9)


def test_a_joint_swings_in_a_hover_and_the_robot_turns_to_the_heading(swung):
    rows = [row for row in swung.run.rows if row.time > swung.run.first_driven]
    yaw = np.array([euler_angles(quat_to_matrix(row.state.quat_wb))[2] for row in rows])
    joint = np.array([row.state.joint_position[1] for row in rows])
    times = np.array([row.time for row in rows]) - swung.run.first_driven
    assert np.ptp(joint[(times > 1.5) & (times < 4.0)]) > 0.015
    late = (times > 4.2) & (times < 5.0)
    assert yaw[late].mean() - yaw[times < 1.5].mean() == pytest.approx(0.3, abs=0.05)


def test_joints_on_a_stand_follow_their_forms_and_no_rotor_thrusts(bench):
    out = bench.played.outputs
    drives = out["stage"] == DRIVING
    t, joints = out["mission_time"][drives], out["command"]["joint_position"][drives]
    assert (out["command"]["thrust"][drives] == 0.0).all()
    check_bounds(out)
    assert np.abs(np.diff(joints, axis=0)).max() <= ROBOT.joint_speed / 40.0 + 1e-9
    seen = out["state"]["joint_position"][drives]
    late = (t > 4.9) & (t < 5.0)
    np.testing.assert_allclose(seen[late][:, 0], 0.1, atol=0.02)
    assert np.ptp(seen[(t > 1.0) & (t < 4.0)][:, 6]) > 0.1
    assert bench.run.status == 0
    torso = np.array([row.state.position_w for row in bench.run.rows if row.time > bench.run.first_driven])
    assert np.ptp(torso, axis=0).max() < 0.01


def begun(library, stream, text):
    """A loop of another mission that drives along a recorded run, and the inputs that follow."""
    loop = Loop(library, read_mission(library, text))
    assert loop.run(stream.inputs[: stream.drives + 20])[-1]["stage"] == DRIVING
    return loop, stream.inputs[stream.drives + 20 :]


def test_a_joint_too_far_from_its_command_ends_a_bench_test_at_rest(library, bench):
    loop, inputs = begun(library, bench, "\n".join(["bench", *ON_STAND, "deviation 0.2"]))
    inputs = inputs[:20].copy()
    inputs["measurement"]["joint_position"][5:, 3] += 0.5
    out = loop.run(inputs)
    assert (out["stage"][:5] == DRIVING).all()
    assert (out["stage"][5:] == RESTING).all()
    assert (out["fault"][5:] == STRAINED).all()
    assert (out["aborted"] == [0] * 5 + [1] * 15).all()
    assert (out["action"] == PUBLISH).all()
    assert (np.diff(out["command"]["joint_position"][5:], axis=0) == 0.0).all()


def test_other_faults_end_a_bench_test_at_rest_and_another_commander_lands_it(library, bench):
    loop, inputs = begun(library, bench, "\n".join(["bench", *ON_STAND]))
    silent = inputs[:30].copy()
    silent["measurement"]["pose_count"] = 0
    out = loop.copy().run(silent)
    at = int(np.argmax(out["stage"] == RESTING))
    assert 0 < at < 30
    assert (out["stage"][at:] == RESTING).all()
    assert (out["fault"][at:] == NO_POSE).all()
    contended = inputs[:40].copy()
    contended["has_thrust"] = 1
    out = loop.run(contended)
    assert (out["action"][np.argmax(out["action"] == FORCE_LANDING) :][:HOLD] == FORCE_LANDING).all()
    assert out["action"][-1] == SILENT


def test_a_joint_too_far_from_its_command_ends_the_excitations_of_a_hover_and_it_hovers_on(library, swung):
    text = "\n".join(["flight as_flown", FORM, "excite thrust 3 sine 0 4 6 1.5", "deviation 0.2"])
    loop, inputs = begun(library, swung, text)
    inputs = inputs[:40].copy()
    inputs["measurement"]["joint_position"][10:, 3] += 0.5
    out = loop.run(inputs)
    added = out["command"]["thrust"][:, 2] - np.linalg.norm(out["forces_l"].reshape(-1, 8, 3), axis=2)[:, 2]
    assert (out["stage"] == DRIVING).all()
    assert (out["fault"] == FINE).all()
    at = int(np.argmax(out["aborted"]))
    assert 9 < at < 14  # the estimator filters the joints
    assert np.abs(added[:at]).max() > 1.0
    np.testing.assert_allclose(added[at:], 0.0, atol=1e-9)
    assert out["finished"][-1]


def test_logs_of_tests_replay_byte_for_byte(runner, swung, bench, tmp_path):
    for stream in (swung, bench):
        done = said(runner, "replay", stream.path, tmp_path / "again")
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "again").read_bytes() == stream.path.read_bytes()


def test_a_log_with_an_excitation_of_no_joint_is_refused(library, runner, bench, tmp_path):
    mission = bench.mission.copy()
    mission["excitations"]["index"][0] = 16
    inputs = bench.inputs[:3]
    bench.write(tmp_path / "log", inputs, bench.played.outputs[:3], mission)
    done = said(runner, "replay", tmp_path / "log", tmp_path / "out")
    assert done.returncode == 2
    assert "ends early" in done.stderr


@pytest.mark.parametrize("mission", [bench_mission(), thrust_mission(), legs_mission(), forms_mission()])
def test_the_written_tests_are_valid_and_within_two_minutes(library, mission):
    m = read_mission(library, mission.text)
    assert not isinstance(m, str), m
    assert m["end"] == mission.seconds <= 120.0
    assert isinstance(Loop.begin(library, m), Loop)


def test_the_states_in_which_tests_are_driven(bench, swung):
    assert (bench.wanted, swung.wanted) == (ARM_ON, HOVER)
    # Before, the robot's own software has commanded the measured angles again and again: the legs have sunk a little.
    np.testing.assert_allclose(bench.inputs["measurement"]["joint_position"][bench.drives], HANGING, atol=0.15)


def test_the_command_writes_missions_logs_and_figures_of_tests(runner, tmp_path):
    words = [sys.executable, "-m", "spidar_gym.cli.main", "sitl", "tests", "--link", "socket"]
    done = said(*words, "--only", "bench", "--world", "calibrated_1:build-damped", "--out", tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads((tmp_path / "tests.json").read_text())["bench"]
    assert found["seconds"] == pytest.approx(48.0, abs=0.05)
    assert 0.02 < found["deviation_rad"] < 0.3
    assert not found["aborted"]
    assert (tmp_path / "bench.txt").read_text() == bench_mission().text
    assert said(runner, "replay", tmp_path / "bench.log", tmp_path / "again").returncode in (0, 2)
    refused = said(*words, "--only", "stand", "--out", tmp_path / "x")
    assert refused.returncode == 2
    assert "unknown test 'stand'; valid: bench, thrust, legs, forms" in refused.stderr
