"""Rotations: cross-product matrices, exponential and logarithm of SO(3), quaternions in the order w, x, y, z."""

import math

import numpy as np

from spidar_gym.arrays import Matrix3, Quaternion, Vector3

SMALL_ANGLE = 1e-7
"""Below this angle the exponential is its second-order series [rad]."""
SMALL_SINE = 1e-6
"""Below this sine of the angle the skew-symmetric part is too small to determine the logarithm."""


def skew(v: Vector3) -> Matrix3:
    """Matrix [v]ₓ with [v]ₓ u = v × u."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(a: Vector3, b: Vector3) -> Vector3:
    """Cross product a × b, bit for bit that of `numpy.cross`, in a twentieth of its time."""
    a0, a1, a2 = a.tolist()
    b0, b1, b2 = b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


CROSS = np.array([skew(axis).reshape(-1) for axis in np.eye(3)])
"""points @ CROSS, reshaped to (k, 3, 3), are the matrices [p]ₓ of k points."""


def vee(M: Matrix3) -> Vector3:
    """Vector of the skew-symmetric part of M: the inverse of `skew`."""
    return 0.5 * np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])


def exp(v: Vector3) -> Matrix3:
    """Rotation by |v| [rad] about v (Rodrigues)."""
    angle = math.sqrt(float(v @ v))
    K = skew(v)
    if angle < SMALL_ANGLE:
        return np.eye(3) + K + 0.5 * (K @ K)
    return np.eye(3) + (math.sin(angle) / angle) * K + ((1.0 - math.cos(angle)) / angle**2) * (K @ K)


def log(R: Matrix3) -> Vector3:
    """Rotation vector [rad] of R, of length 0 … π; at π its sign is the one with the first nonzero entry positive."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    x, y, z = 0.5 * (h - f), 0.5 * (c - g), 0.5 * (d - b)
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (a + e + i - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > SMALL_SINE or cosine > 0.0:
        stretch = angle / sine if sine > SMALL_SINE else 1.0
        return np.array([stretch * x, stretch * y, stretch * z])
    # Close to a half turn the skew part vanishes, and the symmetric part is 2 n nᵀ − 1: n is a column of it plus 1.
    outer = 0.25 * (R + R.T) + 0.5 * np.eye(3)
    n = outer[:, int(np.argmax(np.diag(outer)))]
    n = n / math.sqrt(float(n @ n))
    sign = math.copysign(1.0, float(n @ (x, y, z))) if sine > 0.0 else math.copysign(1.0, n[np.flatnonzero(n)[0]])
    return sign * angle * n


def quat_to_matrix(quat: Quaternion) -> Matrix3:
    """Rotation matrix of the quaternion (w, x, y, z); it need not be normalised."""
    w, x, y, z = quat.tolist()
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    )


def matrix_to_quat(R: Matrix3) -> Quaternion:
    """Unit quaternion (w, x, y, z) with w ≥ 0 of the rotation matrix."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    # Each row is the quaternion times four times one of its entries; the longest row is the best conditioned.
    rows = np.array(
        [
            [1.0 + a + e + i, h - f, c - g, d - b],
            [h - f, 1.0 + a - e - i, d + b, c + g],
            [c - g, d + b, 1.0 - a + e - i, h + f],
            [d - b, c + g, h + f, 1.0 - a - e + i],
        ]
    )
    quat = rows[int(np.argmax(np.diag(rows)))]
    quat = quat / math.sqrt(float(quat @ quat))
    return -quat if quat[0] < 0.0 else quat


def euler_angles(R: Matrix3) -> Vector3:
    """Roll, pitch, yaw (z-y-x) of an attitude [rad]."""
    return np.array(
        [math.atan2(R[2, 1], R[2, 2]), math.asin(max(-1.0, min(1.0, -R[2, 0]))), math.atan2(R[1, 0], R[0, 0])]
    )


def rotation_x(angle: float) -> Matrix3:
    """Rotation about x by `angle` [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_z(angle: float) -> Matrix3:
    """Rotation about z by `angle` [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
