"""Pins SO(3): exp and log invert each other at every angle, the group's axioms, quaternion orders, scipy's answers."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spidar_gym import so3

SMALL = (0.0, 1e-12, 1e-8, 1e-7, 1e-5, 1e-3, 1e-2)
ANGLES = (*SMALL, 0.5, 1.7, 3.0, *(math.pi - small for small in reversed(SMALL)))
AXIS_ROTATIONS = {0: so3.rotation_x, 2: so3.rotation_z}


def close(actual, desired, *, atol, rtol=0.0):
    np.testing.assert_allclose(actual, desired, rtol=rtol, atol=atol)


def axes(seed: int, count: int = 20) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return np.vstack([vectors / np.linalg.norm(vectors, axis=1)[:, None], np.eye(3), -np.eye(3)])


def quaternions(seed: int) -> np.ndarray:
    """Random unit quaternions, and special ones with one or three entries (nearly) zero."""
    rng = np.random.default_rng(seed)
    special = np.vstack([np.eye(4), -np.eye(4), np.eye(4) + 1e-9 * rng.normal(size=(4, 4)), [[0.0, 0.6, -0.8, 0.0]]])
    quats = np.vstack([rng.normal(size=(50, 4)), special])
    return quats / np.linalg.norm(quats, axis=1)[:, None]


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_of_log_is_the_rotation_at_every_angle(angle):
    for axis in axes(1):
        R = Rotation.from_rotvec(angle * axis).as_matrix()
        v = so3.log(R)
        close(so3.exp(v), R, atol=1e-9)
        assert abs(np.linalg.norm(v) - angle) < 1e-9


@pytest.mark.parametrize("angle", ANGLES[:-1])
def test_log_of_exp_is_the_rotation_vector_below_a_half_turn(angle):
    for axis in axes(2):
        v = angle * axis
        close(so3.log(so3.exp(v)), v, atol=1e-9)


def test_log_of_a_tiny_rotation_keeps_its_relative_precision():
    for axis in axes(3):
        v = 1e-12 * axis
        close(so3.log(so3.exp(v)), v, rtol=1e-9, atol=0.0)


def test_the_sign_of_a_half_turn_does_not_depend_on_the_sign_of_its_axis():
    for n in axes(4):
        v = so3.log(2.0 * np.outer(n, n) - np.eye(3))
        close(v, math.pi * n * np.sign(n[np.flatnonzero(n)[0]]), atol=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_scipys_at_every_angle(angle):
    for v in angle * axes(15):
        close(so3.exp(v), Rotation.from_rotvec(v).as_matrix(), atol=1e-14)


def test_exp_and_log_agree_with_scipy():
    for v in np.random.default_rng(5).uniform(-1.7, 1.7, size=(50, 3)):
        R = Rotation.from_rotvec(v)
        close(so3.exp(v), R.as_matrix(), atol=1e-14)
        close(so3.log(R.as_matrix()), R.as_rotvec(), atol=1e-13)


def test_exp_returns_proper_rotations_and_products_stay_in_the_group():
    rng = np.random.default_rng(6)
    product = np.eye(3)
    for v in rng.uniform(-4.0, 4.0, size=(50, 3)):
        product = product @ so3.exp(v)
        close(product @ product.T, np.eye(3), atol=1e-13)
        assert abs(np.linalg.det(product) - 1.0) < 1e-13


def test_rotations_about_one_axis_add_and_the_opposite_vector_is_the_inverse():
    rng = np.random.default_rng(7)
    for v in rng.normal(size=(20, 3)):
        s, t = rng.uniform(-3.0, 3.0, 2)
        close(so3.exp(s * v) @ so3.exp(t * v), so3.exp((s + t) * v), atol=1e-13)
        close(so3.exp(v) @ so3.exp(-v), np.eye(3), atol=1e-14)


def test_conjugation_rotates_the_axis():
    rng = np.random.default_rng(8)
    for u, v in rng.normal(size=(20, 2, 3)):
        R = so3.exp(u)
        close(R @ so3.exp(v) @ R.T, so3.exp(R @ v), atol=1e-13)


def test_skew_is_the_derivative_of_exp_at_the_identity():
    h = 1e-5
    for v in np.random.default_rng(9).normal(size=(10, 3)):
        close((so3.exp(h * v) - so3.exp(-h * v)) / (2 * h), so3.skew(v), atol=1e-9)


def test_skew_and_cross_table_are_numpys_cross_product():
    rng = np.random.default_rng(10)
    points, u = rng.normal(size=(7, 3)), rng.normal(size=3)
    expected = np.cross(points, u)
    close([so3.skew(p) @ u for p in points], expected, atol=1e-15)
    close((points @ so3.CROSS).reshape(7, 3, 3) @ u, expected, atol=1e-15)


def test_vee_inverts_skew_and_ignores_a_symmetric_part():
    rng = np.random.default_rng(11)
    v, M = rng.normal(size=3), rng.normal(size=(3, 3))
    close(so3.vee(so3.skew(v) + M + M.T), v, atol=1e-15)


def test_quaternion_and_matrix_invert_each_other():
    for quat in quaternions(12):
        R = so3.quat_to_matrix(quat)
        close(R @ R.T, np.eye(3), atol=1e-14)
        back = so3.matrix_to_quat(R)
        assert back[0] >= 0.0
        assert abs(back @ back - 1.0) < 1e-14
        close(back * np.sign(back @ quat), quat, atol=1e-14)


def test_scaled_and_opposite_quaternions_are_the_same_rotation():
    for quat in quaternions(13):
        close(so3.quat_to_matrix(-3.7 * quat), so3.quat_to_matrix(quat), atol=1e-14)


def test_quaternions_with_the_scalar_moved_last_are_scipys():
    for quat in quaternions(14):
        R = Rotation.from_quat(np.roll(quat, -1))
        close(so3.quat_to_matrix(quat), R.as_matrix(), atol=1e-14)
        back = np.roll(R.as_quat(), 1)
        close(abs(so3.matrix_to_quat(R.as_matrix()) @ back), 1.0, atol=1e-14)


@pytest.mark.parametrize("k", AXIS_ROTATIONS)
def test_axis_rotations_turn_the_next_axis_to_the_one_after(k):
    e, rotation = np.eye(3), AXIS_ROTATIONS[k]
    close(rotation(math.pi / 2) @ e[(k + 1) % 3], e[(k + 2) % 3], atol=1e-15)
    close(rotation(0.7), so3.exp(0.7 * e[k]), atol=1e-15)


def test_roll_pitch_and_yaw_turn_about_x_then_y_then_z():
    for roll, pitch, yaw in np.random.default_rng(8).uniform(-1.5, 1.5, (50, 3)).tolist():
        R = so3.rotation_z(yaw) @ so3.exp(np.array([0.0, pitch, 0.0])) @ so3.rotation_x(roll)
        close(so3.euler_angles(R), [roll, pitch, yaw], atol=1e-12)
    down = so3.exp(np.array([0.0, math.pi / 2, 0.0]))
    close(so3.euler_angles(down * (1.0 + 1e-15))[1], math.pi / 2, atol=1e-7)


def test_the_cross_product_equals_numpys_bit_for_bit():
    for a, b in np.random.default_rng(7).normal(size=(200, 2, 3)):
        np.testing.assert_array_equal(so3.cross(a, b), np.cross(a, b))
