"""Pins planar poses: the group of their matrices, arcs of constant curvature that compose, transformed points."""

import math

import numpy as np
import pytest

from spidar_gym.control.crawl.pose2 import Pose2, torso_pose2
from spidar_gym.so3 import exp, rotation_x, rotation_z


def matrix(pose):
    """The pose as a homogeneous matrix."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return np.array([[c, -s, pose.x], [s, c, pose.y], [0.0, 0.0, 1.0]])


def numbers(pose):
    return np.array([pose.x, pose.y, pose.yaw])


def same(a, b, atol=1e-12):
    np.testing.assert_allclose(numbers(a), numbers(b), rtol=0, atol=atol)


def poses(seed, n, turn=3.0):
    """Random poses, every fourth with no turn and every fourth with a turn of at most 1e-6 rad."""
    rng = np.random.default_rng(seed)
    for k in range(n):
        yaw = (0.0, float(rng.uniform(-1e-6, 1e-6)), *rng.uniform(-turn, turn, 2).tolist())[k % 4]
        x, y = rng.uniform(-2.0, 2.0, 2).tolist()
        yield Pose2(x, y, yaw)


def test_composition_and_inverse_are_those_of_the_matrices():
    for a, b in zip(poses(0, 40), poses(1, 40), strict=True):
        np.testing.assert_allclose(matrix(a @ b), matrix(a) @ matrix(b), atol=1e-12)
        np.testing.assert_allclose(matrix(a.inverse()), np.linalg.inv(matrix(a)), atol=1e-12)
        assert (a @ b).yaw == pytest.approx(a.yaw + b.yaw, abs=1e-12), "turns add up and do not wrap"


def test_poses_are_a_group():
    for a, b, c in zip(poses(2, 40), poses(3, 40), poses(4, 40), strict=True):
        same((a @ b) @ c, a @ (b @ c))
        same(a @ a.inverse(), Pose2())
        same(a.inverse() @ a, Pose2())
        same((a @ b).inverse(), b.inverse() @ a.inverse())
        same(a @ Pose2(), a)
        same(Pose2() @ a, a)


def test_an_arc_begins_at_the_origin_and_ends_at_the_pose():
    for pose in poses(5, 40):
        same(pose.arc(1.0), pose, atol=1e-8)
        same(pose.arc(0.0), Pose2())


def test_a_share_of_an_arc_and_the_rest_are_the_arc():
    for pose in poses(6, 40):
        for share in (-0.5, 0.25, 0.5, 0.9, 1.5):
            along = pose.arc(share)
            same(along @ pose.arc(1.0 - share), pose, atol=1e-8)
            same(pose.arc(-share), along.inverse(), atol=1e-8)
            # The rest of an arc is an arc of the same curvature.
            rest = along.inverse() @ pose
            same(along @ rest.arc(0.5), pose.arc(0.5 + 0.5 * share), atol=1e-8)
            same(pose.arc(0.5).arc(share), pose.arc(0.5 * share), atol=1e-8)


def test_an_arc_is_the_motion_at_a_constant_velocity_seen_from_the_moving_pose():
    """Integrated numerically in small steps, independently of the closed form."""
    for pose in poses(7, 12):
        h, n = 1e-5, 2000
        first = pose.arc(h)
        velocity = numbers(first) / h
        here = np.zeros(3)
        for _ in range(n):
            heading = here[2] + 0.5 * velocity[2] / n
            c, s = math.cos(heading), math.sin(heading)
            here += np.array([c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2]]) / n
        np.testing.assert_allclose(here, numbers(pose), rtol=0, atol=1e-4)


def test_an_arc_has_the_curvature_of_the_circle_through_its_ends_everywhere():
    for pose in poses(8, 40):
        if abs(pose.yaw) < 1e-3:
            continue
        points = np.array([numbers(pose.arc(share))[:2] for share in np.linspace(0.0, 1.0, 41)])
        steps = np.diff(points, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        np.testing.assert_allclose(lengths, lengths[0], rtol=1e-9)
        cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
        turns = np.arctan2(cross, np.sum(steps[:-1] * steps[1:], axis=1))
        np.testing.assert_allclose(turns, pose.yaw / 40, rtol=1e-6)
        radius = 0.5 * pose.distance / abs(math.sin(0.5 * pose.yaw))
        np.testing.assert_allclose(lengths, 2.0 * radius * abs(math.sin(pose.yaw / 80)), rtol=1e-9)


def test_a_quarter_of_a_circle_to_the_left_is_walked_as_one():
    quarter = Pose2(1.0, 1.0, math.pi / 2)
    same(quarter.arc(0.5), Pose2(math.sqrt(0.5), 1.0 - math.sqrt(0.5), math.pi / 4))
    same(quarter.arc(2.0), Pose2(0.0, 2.0, math.pi))


def test_an_arc_without_a_turn_is_straight_and_one_without_a_displacement_turns_on_the_spot():
    for share in (-1.0, 0.3, 1.7):
        same(Pose2(0.4, -0.3).arc(share), Pose2(0.4 * share, -0.3 * share))
        same(Pose2(yaw=0.8).arc(share), Pose2(yaw=0.8 * share))


@pytest.mark.parametrize("yaw", [1e-12, 9e-10, 1.1e-9, 1e-7, 1e-5])
def test_an_arc_with_hardly_a_turn_is_hardly_bent(yaw):
    for share in (0.2, 0.5, 3.0):
        same(Pose2(0.3, -0.2, yaw).arc(share), Pose2(0.3 * share, -0.2 * share, yaw * share), atol=4.0 * yaw + 1e-12)


def test_distance_is_that_of_the_ends():
    assert Pose2(0.3, -0.4, 2.0).distance == pytest.approx(0.5)
    assert Pose2(yaw=1.0).distance == 0.0


def test_moved_points_are_those_of_the_matrix_and_keep_their_heights():
    rng = np.random.default_rng(9)
    for pose in poses(9, 20):
        points = rng.normal(size=(6, 3))
        moved = pose.move(points)
        flat = np.column_stack([points[:, :2], np.ones(6)])
        np.testing.assert_allclose(moved[:, :2], (matrix(pose) @ flat.T).T[:, :2], atol=1e-12)
        np.testing.assert_array_equal(moved[:, 2], points[:, 2])
        np.testing.assert_allclose(pose.inverse().move(moved), points, atol=1e-12)


def test_planar_pose_of_a_torso_is_where_it_is_and_where_its_x_axis_points_seen_from_above():
    rng = np.random.default_rng(10)
    for yaw in rng.uniform(-3.1, 3.1, 20).tolist():
        position_w = rng.normal(size=3)
        here = torso_pose2(position_w, rotation_z(yaw) @ exp(np.array([0.0, 0.3, 0.0])) @ rotation_x(-0.2))
        same(here, Pose2(float(position_w[0]), float(position_w[1]), yaw))
        R_wb = exp(rng.uniform(-0.8, 0.8, 3))
        forward = R_wb @ (1.0, 0.0, 0.0)
        here = torso_pose2(position_w, R_wb)
        assert math.hypot(forward[0], forward[1]) * math.cos(here.yaw) == pytest.approx(forward[0], abs=1e-12)
        assert math.hypot(forward[0], forward[1]) * math.sin(here.yaw) == pytest.approx(forward[1], abs=1e-12)
