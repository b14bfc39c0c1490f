"""Pins missions with calibrated robots: the robot is one of the world's kind, and a failed course is reported."""

from dataclasses import replace

import pytest
from support.needs import needs_compiler

from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.paper.calibration import require_robots
from spidar_gym.sitl.course_drive import courses_in_process
from spidar_gym.sitl.course_faults import play_course_faults
from spidar_gym.sitl.missions import course_mission, crawl_mission, hover_mission
from spidar_gym.sitl.play import make_robot, play_faults

WORLD = "calibrated_1"


def config(mission, kind, seed=0):
    return make_robot(mission, seed, require_robots(f"{WORLD}:{kind}")).plant.config


@pytest.mark.parametrize("mission", [hover_mission(), crawl_mission(), course_mission()])
def test_the_robot_is_one_of_the_named_kind(mission):
    described, damped = (config(mission, f"wake-{variant}") for variant in ("described", "damped"))
    assert described.actuators.joint_kd == 8.0
    assert described.actuators.joint_damping == 0.9
    assert 0.55 <= damped.actuators.joint_kd <= 1.4
    assert damped.actuators.joint_damping == 0.0
    assert described.sense
    assert damped.sense
    again, other = config(mission, "wake-damped"), config(mission, "wake-damped", seed=1)
    assert again.actuators.joint_kd == damped.actuators.joint_kd != other.actuators.joint_kd
    assert (damped.ground.slope > 0.0) != mission.is_course, "floors are level under courses only"


def test_faults_meet_the_kinds_in_turn():
    robots = require_robots(WORLD)
    kinds = [robots.in_turn(k).name for k in range(7)]
    assert kinds == [f"{WORLD}:{kind}" for kind in (*robots.world.kinds, robots.world.kinds[0])]
    one = require_robots(f"{WORLD}:build-damped")
    assert one.in_turn(3) == one
    assert require_robots("").in_turn(3) == require_robots("")


@needs_compiler
def test_a_fault_on_a_calibrated_robot_has_the_specified_reaction():
    (row,) = play_faults("socket", ("pose_nan_once",), robots=require_robots(f"{WORLD}:capture-damped"))
    (nominal,) = play_faults("socket", ("pose_nan_once",))
    assert row["as_specified"]
    assert row["peak_tilt_rad"] > 2.0 * nominal["peak_tilt_rad"]


@needs_compiler
def test_measurements_that_stop_in_a_descent_do_not_lift_the_robot():
    # Without the mean of Σλ as a limit of held commands, the robot rises by metres and falls at 6 m/s.
    (row,) = play_course_faults("socket", [("imu_stops", "descend")], robots=require_robots(f"{WORLD}:build-damped"))
    assert row["as_specified"]
    assert row["touchdown_m_s"] < 1.5


def test_a_course_that_a_calibrated_robot_does_not_complete_is_a_failure_of_this_robot():
    late = replace(course_mission(), seconds=-29.5)
    one, two = courses_in_process(late, 2, require_robots(WORLD))
    assert one["failure"].startswith("the course does not end within 0.5 s")
    assert (one["kind"], two["kind"]) == (f"{WORLD}:wake-described", f"{WORLD}:wake-damped")
    with pytest.raises(SpidarError, match="does not end within"):
        courses_in_process(late, 1)


def test_another_randomisation_is_refused_in_one_line():
    for given in ("nonsense", "calibrated_1:nonsense"):
        with pytest.raises(SpidarError, match="valid: "):
            require_robots(given)


def test_a_file_of_ranges_is_no_world(tmp_path):
    (tmp_path / "ranges.toml").write_text("strength = 0.5\n")
    with pytest.raises(InvalidValueError, match="the name or file of a calibrated world"):
        require_robots(str(tmp_path / "ranges.toml"))
