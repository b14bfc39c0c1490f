"""Pins the robot's numbers: mass, span, bodies of the measured robot, physically possible inertias, names, forms."""

import math
import re
from dataclasses import fields

import numpy as np
import pytest

from spidar_gym import robot
from spidar_gym.robot.inertial import Inertial, merge
from spidar_gym.robot.spec import PARTS, ROBOT, RobotSpec, spec_rows
from spidar_gym.so3 import rotation_x

AS_MEASURED = RobotSpec(described_mass=15.2108)
"""The robot with the total mass of its parts."""

# body: mass [kg], CoG [mm], inertia xx yy zz xy xz yz [kg mm²], number of parts; computed by Pinocchio from the lab's
# description. The fans' two marker links of 0.01 g each are not counted in the pitch module.
LUMPS = {
    "torso": (1.35459, (0.09, 6.54, 27.31), (10117, 9692, 17821, -5, 1, -52), 3),
    "inner_junction": (0.130, (22.18, 5.55, -13.05), (245, 261, 116, 12, -56, -14), 2),
    "inner_link": (0.940, (333.30, -1.11, -15.08), (1048, 29256, 28496, -327, 3609, -24), 2),
    "outer_junction": (0.122, (20.25, 3.11, -13.33), (232, 251, 96, 7, -52, -8), 2),
    "outer_link": (0.854, (318.15, 6.09, -19.04), (801, 25661, 25639, 232, 1447, -98), 3),
    "roll_module": (0.275, (14.58, -0.72, -21.90), (456, 504, 157, 3, -125, -9), 1),
    "pitch_module": (0.434, (0.0, -1.51, -1.09), (7595, 401, 7781, 0, 0, 10), 1),
}


def test_the_bodies_of_the_nominal_robot_weigh_16_kg():
    one = ROBOT.bodies["torso"].mass
    four = sum(ROBOT.bodies[f"{where}_{what}"].mass for where in ("inner", "outer") for what in ("junction", "link"))
    eight = ROBOT.bodies["roll_module"].mass + ROBOT.bodies["pitch_module"].mass
    assert abs(one + 4 * four + 8 * eight - 16.0) < 1e-12
    assert abs(8 * ROBOT.hover_thrust - 16.0 * 9.81) < 1e-12


def test_the_parts_add_up_to_the_measured_robot():
    count = {"torso": 1, "flight_controller": 1, "computer": 1}
    count |= dict.fromkeys(("peg", "battery", "roll_module", "pitch_module"), 8)
    assert abs(sum(count.get(name, 4) * part.mass for name, part in PARTS.items()) - 15.2108) < 5e-4


def test_flat_robot_spans_the_papers_diameter():
    assert abs(ROBOT.diameter - 2.701) < 0.002


def test_the_torso_is_nine_percent_of_the_mass():
    assert abs(ROBOT.bodies["torso"].mass / ROBOT.total_mass - 0.089) < 5e-4


@pytest.mark.parametrize("name", LUMPS)
def test_each_body_at_the_measured_mass_is_the_lump_of_the_labs_robot(name):
    mass, com, inertia, parts = LUMPS[name]
    body = AS_MEASURED.bodies[name]
    assert abs(body.mass - mass) < 2e-5
    np.testing.assert_allclose(1e3 * np.array(body.com), com, rtol=0, atol=0.01)
    # Both tables are rounded to 1 kg mm²: the tolerance is half a unit for the body and for each of its parts.
    np.testing.assert_allclose(1e6 * np.array(body.inertia), inertia, rtol=0, atol=0.5 * (1 + parts))


def test_scaling_to_the_total_mass_changes_density_only():
    factor = 16.0 / 15.2108
    for name, body in AS_MEASURED.bodies.items():
        scaled = ROBOT.bodies[name]
        assert scaled.com == body.com
        assert abs(scaled.mass / body.mass - factor) < 1e-12
        np.testing.assert_allclose(scaled.matrix, factor * body.matrix, rtol=1e-12)


@pytest.mark.parametrize(("name", "part"), [*PARTS.items(), *ROBOT.bodies.items()])
def test_every_inertia_belongs_to_a_real_mass_distribution(name, part):
    principal = np.linalg.eigvalsh(part.matrix)
    assert part.mass > 0.0
    assert principal[0] > 0.0, name
    assert principal[0] + principal[1] >= principal[2], name


def test_merging_is_the_sum_over_the_mass_points_of_the_parts():
    """Six mass points replace each part with equal mass, CoG and inertia; the merged body consists of all points."""

    def points(part: Inertial) -> tuple[np.ndarray, np.ndarray]:
        principal, axes = np.linalg.eigh(part.matrix)
        second_moments = 0.5 * principal.sum() - principal
        arms = axes * np.sqrt(3.0 * second_moments / part.mass)
        return np.full(6, part.mass / 6), np.array(part.com) + np.vstack([arms.T, -arms.T])

    parts = [PARTS["torso"], PARTS["computer"].placed((0.1, -0.2, 0.3), 0.7), PARTS["outer_link"]]
    masses, positions = (np.concatenate(stack) for stack in zip(*map(points, parts), strict=True))
    com = masses @ positions / masses.sum()
    arms = positions - com
    second_moment = arms.T @ (masses[:, None] * arms)
    merged = merge(*parts)
    assert abs(merged.mass - masses.sum()) < 1e-14
    np.testing.assert_allclose(merged.com, com, rtol=0, atol=1e-14)
    expected = np.trace(second_moment) * np.eye(3) - second_moment
    np.testing.assert_allclose(merged.matrix, expected, rtol=0, atol=1e-14)


def test_placing_a_part_turns_its_inertia_with_it():
    part, roll = PARTS["inner_link"], 0.4
    placed, R = part.placed((1.0, 2.0, 3.0), roll), rotation_x(roll)
    np.testing.assert_allclose(placed.com, np.array([1.0, 2.0, 3.0]) + R @ part.com, rtol=0, atol=1e-14)
    spin = np.random.default_rng(1).normal(size=3)
    assert abs((R @ spin) @ placed.matrix @ (R @ spin) - spin @ part.matrix @ spin) < 1e-14


def test_joints_and_gimbals_are_named_in_the_papers_order():
    assert robot.JOINT_NAMES[:5] == ("joint1_yaw", "joint1_pitch", "joint2_yaw", "joint2_pitch", "joint3_yaw")
    assert robot.GIMBAL_NAMES[:3] == ("gimbal1_roll", "gimbal1_pitch", "gimbal2_roll")
    assert robot.JOINT_NAMES[-1] == "joint8_pitch"
    assert robot.GIMBAL_NAMES[-1] == "gimbal8_pitch"
    assert len(robot.JOINT_NAMES) == len(robot.GIMBAL_NAMES) == robot.N_JOINTS == 16
    assert [int(name.removeprefix("thrust")) for name in robot.ROTOR_SITES] == list(range(1, 9))
    assert len(set(robot.CONTACT_SITES)) == 12


def test_legs_point_to_the_four_diagonals_from_front_left_to_the_left():
    azimuths = [ROBOT.leg_azimuth(leg) for leg in range(4)]
    np.testing.assert_allclose(np.sign(np.cos(azimuths)), [1, -1, -1, 1])
    np.testing.assert_allclose(np.sign(np.sin(azimuths)), [1, 1, -1, -1])
    np.testing.assert_allclose(np.abs(np.tan(azimuths)), 1.0, rtol=1e-12)
    assert abs(ROBOT.yaw_axis_radius - 0.1730) < 5e-5


@pytest.mark.parametrize(("form", "inner", "outer"), [("form1", 0, 0), ("form2", 30, 60), ("form3", 45, 90)])
def test_forms_pitch_every_leg_alike_and_leave_the_yaw_joints_at_zero(form, inner, outer):
    by_name = dict(zip(robot.JOINT_NAMES, np.degrees(robot.FORMS[form]), strict=True))
    for name, angle in by_name.items():
        odd = int(re.findall(r"\d", name)[0]) % 2
        assert abs(angle - (0 if "yaw" in name else inner if odd else outer)) < 1e-12


def test_forms_are_the_papers_three():
    assert set(robot.FORMS) == {"form1", "form2", "form3"}


def test_every_number_of_the_robot_has_a_documented_value_and_source():
    rows = spec_rows()
    assert [name for name, _, _ in rows] == [
        f.name for f in fields(RobotSpec) if f.name not in ("part_masses", "payloads")
    ]
    for name, value, doc in rows:
        assert value == str(getattr(ROBOT, name))
        assert re.search(r"\[(JSK|estimate|Dynamixel|Zhao2025, (Tab\. 1|Sec\. [\w ]+))\]", doc), name


def test_the_table_of_numbers_shows_the_robot_it_is_asked_for():
    rows = {name: value for name, value, _ in spec_rows(RobotSpec(joint_kp=123.5))}
    assert rows["joint_kp"] == "123.5"
    assert rows["joint_kd"] == str(ROBOT.joint_kd)


def test_limits_are_the_papers_specification():
    assert (ROBOT.max_thrust, ROBOT.max_vectoring_torque) == (42.0, 1.5)
    assert (ROBOT.max_joint_torque, ROBOT.joint_speed) == (7.0, 0.2)
    assert abs(math.degrees(ROBOT.joint_limit) - 90.0) < 1e-12
    assert ROBOT.joint_limit < ROBOT.joint_stop
