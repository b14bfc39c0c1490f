"""Pins the legs' kinematics in closed form: both directions against MuJoCo and Pinocchio, and the limits of reach."""

import math
from functools import cache

import mujoco
import numpy as np
import pytest
from support.states import model

from spidar_gym.control.crawl.footsteps import GaitConfig, lying_pose
from spidar_gym.control.crawl.kinematics import (
    INNER,
    OUTER,
    YAW,
    feet_at,
    foot_positions,
    leg_angles,
    leg_lengths,
)
from spidar_gym.robot import FORMS, JOINT_NAMES, N_LEGS, ROBOT
from spidar_gym.sim.scene import scene

QUARTER = math.pi / 2
UPPER, LOWER = leg_lengths(ROBOT)


@cache
def engine():
    return scene(visual=False), mujoco.MjData(scene(visual=False))


def mujoco_feet(q):
    """Centres of the feet with the torso at the origin."""
    world, data = engine()
    data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    for name, angle in zip(JOINT_NAMES, q, strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(world, data)
    return np.array([data.site(f"foot{leg}").xpos for leg in range(1, N_LEGS + 1)])


def pinocchio_feet(q):
    return model().contacts(q)[0][:N_LEGS]


def bent_legs(rng, n):
    """Joint angles within ± 90° with the outer yaw at 0, the knee up and the foot outside the hip's axis."""
    while n:
        inner, outer = rng.uniform(-1.5, 1.5, N_LEGS), rng.uniform(0.01, 1.55, N_LEGS)
        if np.all(ROBOT.yaw_to_pitch + UPPER * np.cos(inner) + LOWER * np.cos(inner + outer) > 0.02):
            q = np.zeros(16)
            q[YAW], q[INNER], q[OUTER] = rng.uniform(-1.5, 1.5, N_LEGS), inner, outer
            n -= 1
            yield q


def with_first_foot(out, z):
    """Feet of the lying pose with the first at yaw 0, `out` from its inner pitch axis, at height `z` [m]."""
    feet = mujoco_feet(lying_pose(GaitConfig()))
    feet[0, :2] = ROBOT.yaw_axis_xy + (ROBOT.yaw_to_pitch + out) * math.sqrt(0.5)
    feet[0, 2] = z
    return feet


@pytest.mark.parametrize("feet_of", [feet_at, pinocchio_feet], ids=["closed form", "Pinocchio"])
def test_feet_are_where_mujoco_has_them_for_any_joint_angles_outer_yaw_included(feet_of):
    rng = np.random.default_rng(0)
    for limit in (QUARTER, ROBOT.joint_stop):
        for q in rng.uniform(-limit, limit, (40, 16)):
            np.testing.assert_allclose(feet_of(q), mujoco_feet(q), rtol=0, atol=1e-9)


def test_angles_of_random_reachable_feet_are_the_ones_that_put_them_there():
    for q in bent_legs(np.random.default_rng(1), 300):
        angles = leg_angles(mujoco_feet(q))
        assert angles is not None
        np.testing.assert_allclose(angles, q, rtol=0, atol=1e-6)


def test_angles_found_have_the_knees_up_the_outer_yaw_at_zero_and_stay_within_90_degrees():
    rng, found = np.random.default_rng(2), 0
    home = mujoco_feet(lying_pose(GaitConfig()))
    for _ in range(600):
        feet = home + rng.uniform(-1.0, 1.0, (N_LEGS, 3)) * rng.choice([0.1, 0.3, 0.6])
        q = leg_angles(feet)
        if q is None:
            continue
        found += 1
        np.testing.assert_allclose(mujoco_feet(q), feet, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(q[2::4], np.zeros(N_LEGS))
        assert np.all(q[OUTER] >= 0.0)
        assert np.abs(q).max() <= QUARTER
    assert 100 < found < 550


def test_feet_that_no_angles_within_90_degrees_reach_have_none():
    """Compared with a grid over the first leg's joint angles."""
    inner, outer = np.meshgrid(np.linspace(-QUARTER, QUARTER, 500), np.linspace(0.0, QUARTER, 250))
    out = UPPER * np.cos(inner) + LOWER * np.cos(inner + outer)
    z = ROBOT.yaw_axis_z - UPPER * np.sin(inner) - LOWER * np.sin(inner + outer)
    rng, seen = np.random.default_rng(3), {True: 0, False: 0}
    for _ in range(200):
        foot = rng.uniform((0.0, -1.1), (1.1, 1.1))
        gap = float(np.hypot(out - foot[0], z - foot[1]).min())
        if 0.002 < gap < 0.02:
            continue  # too close to the limit of reach for the grid
        reachable = gap <= 0.002
        seen[reachable] += 1
        assert (leg_angles(with_first_foot(*foot)) is not None) == reachable
    assert min(seen.values()) > 30


@pytest.mark.parametrize("edge", ["knee straight", "knee square", "left", "right", "thigh down", "thigh up"])
def test_reach_ends_where_the_knee_is_straight_or_a_joint_is_at_90_degrees(edge):
    def first_leg(inside):
        """Yaw, inner and outer pitch of a leg just inside or outside the limit of reach."""
        limit = QUARTER - (1e-6 if inside else -1e-6)
        return {
            "knee square": (0.0, -0.5, limit),
            "left": (limit, 0.2, 0.6),
            "right": (-limit, 0.2, 0.6),
            "thigh down": (0.0, limit, 0.05),
            "thigh up": (0.0, -limit, 0.6),
        }[edge]

    for inside in (True, False):
        if edge == "knee straight":
            feet = with_first_foot(UPPER + LOWER - (1e-6 if inside else -1e-6), ROBOT.yaw_axis_z)
        else:
            q = lying_pose(GaitConfig())
            q[[0, 1, 3]] = first_leg(inside)
            feet = mujoco_feet(q)
        assert (leg_angles(feet) is not None) == inside


def test_one_foot_out_of_reach_is_enough():
    home = mujoco_feet(lying_pose(GaitConfig()))
    assert leg_angles(home) is not None
    for leg in range(N_LEGS):
        for away in ((3.0, 0.0, 0.0), (0.0, 0.0, -2.0)):
            feet = home.copy()
            feet[leg] += away
            assert leg_angles(feet) is None


@pytest.mark.parametrize("form", FORMS)
def test_straight_legs_with_equal_pitches_put_the_feet_where_mujoco_has_them(form):
    _, inner, _, outer = FORMS[form][:4]
    np.testing.assert_allclose(foot_positions(inner, outer), mujoco_feet(FORMS[form]), rtol=0, atol=1e-9)


def test_equal_pitches_of_any_size_put_the_feet_where_mujoco_has_them():
    for inner, outer in np.random.default_rng(4).uniform(-QUARTER, QUARTER, (40, 2)):
        q = np.tile([0.0, inner, 0.0, outer], N_LEGS)
        np.testing.assert_allclose(foot_positions(inner, outer), mujoco_feet(q), rtol=0, atol=1e-9)
