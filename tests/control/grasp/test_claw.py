"""Pins the claw: where its feet are, which faces they press on, and which objects it refuses."""

import math

import numpy as np
import pytest
from support.states import model

from spidar_gym.control.grasp.claw import KNEE, OPEN, PRESS, claw_form, claw_height, plan_contact
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import ROBOT

WIDTHS = (0.15, 0.2, 0.26, 0.3, 0.36, 0.4)


def feet(form):
    return model().contacts(form)[0][:4]


@pytest.mark.parametrize("radius", [0.2, 0.3, 0.4, 0.55])
def test_the_feet_stand_on_a_circle_at_a_height(radius):
    height = claw_height(min(radius, 0.45))
    position = feet(claw_form(radius, height))
    np.testing.assert_allclose(np.hypot(position[:, 0], position[:, 1]), radius, atol=1e-12)
    np.testing.assert_allclose(position[:, 2], height, atol=1e-12)


@pytest.mark.parametrize("half", WIDTHS)
@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5, 7.0])
def test_each_foot_faces_the_middle_of_a_side(half, yaw):
    turned = 0.3
    quat = np.array([math.cos(turned / 2), 0.0, 0.0, math.sin(turned / 2)])
    plan = plan_contact("box", np.array([half, half, 0.2]), quat, yaw)
    assert abs(math.remainder(plan.yaw - turned, math.pi / 2)) == pytest.approx(math.pi / 4)
    assert abs(plan.yaw - yaw) <= math.pi / 4 + 1e-9  # the nearest of four
    for form, gap in ((plan.open, OPEN), (plan.closed, 0.0), (plan.pressed, -PRESS)):
        position = feet(form)
        c, s = math.cos(plan.yaw - turned), math.sin(plan.yaw - turned)
        in_box = position[:, :2] @ np.array([[c, s], [-s, c]])
        reach = np.abs(in_box).max(axis=1)
        np.testing.assert_allclose(reach, half + ROBOT.foot_radius + gap, atol=1e-12)
        np.testing.assert_allclose(np.abs(in_box).min(axis=1), 0.0, atol=1e-12)
        np.testing.assert_allclose(position[:, 2] + plan.height, 0.0, atol=1e-12)
        assert np.abs(form).max() < ROBOT.joint_limit
    assert plan.pressed[3] <= KNEE + 1e-9  # what is left of the range is for the setpoint of a torque


def test_a_round_object_is_grasped_at_the_present_heading():
    assert plan_contact("ball", np.array([0.25, 0.25, 0.25]), np.array([1.0, 0, 0, 0]), 1.234).yaw == 1.234


@pytest.mark.parametrize(
    ("shape", "half", "reason"),
    [
        ("box", (0.3, 0.2, 0.2), "equal length and width"),
        ("box", (0.1, 0.1, 0.2), "half a width within 0.14 … 0.42"),
        ("ball", (0.5, 0.5, 0.5), "half a width within 0.14 … 0.42"),
    ],
)
def test_what_it_cannot_hold_is_refused_with_the_reason(shape, half, reason):
    with pytest.raises(InvalidValueError, match=reason):
        plan_contact(shape, np.array(half), np.array([1.0, 0.0, 0.0, 0.0]))


def test_feet_out_of_reach_are_refused():
    with pytest.raises(InvalidValueError, match="within reach"):
        claw_form(0.3, -0.3)
