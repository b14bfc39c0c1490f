"""A leg with its outer yaw joint at 0: foot ↔ joint angles in closed form, for all four legs at once.

The paper solves q₄ₗ₋₃, q₄ₗ₋₂ and q₄ₗ analytically [Zhao2025, Sec. Crawling Gait]. Positive pitch lowers a leg, so the
knee is up where the outer pitch is positive.
"""

import math

import numpy as np

from spidar_gym.arrays import FootForces, JointVector
from spidar_gym.robot import N_LEGS, ROBOT

UPPER, LOWER = ROBOT.yaw_to_pitch + ROBOT.pitch_to_yaw, ROBOT.pitch_to_foot
"""From the inner to the outer pitch axis, and from there to the foot's centre [m]."""
HIP_Z = ROBOT.yaw_axis_z
YAW, INNER, OUTER = np.arange(N_LEGS) * 4, np.arange(N_LEGS) * 4 + 1, np.arange(N_LEGS) * 4 + 3
"""Indices of the three joints of each leg that the crawl moves; the outer yaw joints stay at 0."""
_AZIMUTH = [ROBOT.leg_azimuth(leg) for leg in range(N_LEGS)]
_HIP = [(ROBOT.yaw_axis_radius * math.cos(a), ROBOT.yaw_axis_radius * math.sin(a)) for a in _AZIMUTH]


def foot_positions(inner: float, outer: float) -> FootForces:
    """Centres of the four feet, torso axes [m], with straight legs that all have these pitch angles [rad]."""
    reach = ROBOT.yaw_axis_radius + ROBOT.yaw_to_pitch + UPPER * math.cos(inner) + LOWER * math.cos(inner + outer)
    z = HIP_Z - UPPER * math.sin(inner) - LOWER * math.sin(inner + outer)
    return np.array([[reach * math.cos(a), reach * math.sin(a), z] for a in _AZIMUTH])


def leg_angles(feet_b: FootForces) -> JointVector | None:
    """Joint angles that put the feet there, knees up, outer yaw 0; None out of reach [Zhao2025, Sec. Crawling Gait].

    Args:
        feet_b: Centres of the foot spheres seen from the torso [m].

    Returns:
        q (16,) within ± 90° [rad], or None.
    """
    q = [0.0] * (4 * N_LEGS)
    for leg, (x, y, z) in enumerate(feet_b.tolist()):
        dx, dy = x - _HIP[leg][0], y - _HIP[leg][1]
        yaw = math.remainder(math.atan2(dy, dx) - _AZIMUTH[leg], 2.0 * math.pi)
        out, down = math.sqrt(dx * dx + dy * dy) - ROBOT.yaw_to_pitch, HIP_Z - z
        cosine = (out * out + down * down - UPPER * UPPER - LOWER * LOWER) / (2.0 * UPPER * LOWER)
        if not -1.0 <= cosine <= 1.0:
            return None
        outer = math.acos(cosine)
        inner = math.atan2(down, out) - math.atan2(LOWER * math.sin(outer), UPPER + LOWER * cosine)
        if max(abs(yaw), abs(inner), abs(outer)) > ROBOT.joint_limit:
            return None
        q[4 * leg], q[4 * leg + 1], q[4 * leg + 3] = yaw, inner, outer
    return np.array(q)


def feet_at(q: JointVector) -> FootForces:
    """Centres of the feet, torso axes [m], outer yaw joints included."""
    feet = np.zeros((N_LEGS, 3))
    for leg in range(N_LEGS):
        yaw, inner, twist, outer = q[4 * leg : 4 * leg + 4].tolist()
        azimuth = ROBOT.leg_azimuth(leg)
        # In the axes of the inner link: junction offset along x, then the outer link turned by twist and outer pitch.
        reach = ROBOT.yaw_to_pitch + ROBOT.pitch_to_foot * math.cos(outer)
        x = ROBOT.pitch_to_yaw + reach * math.cos(twist)
        y, z = reach * math.sin(twist), -ROBOT.pitch_to_foot * math.sin(outer)
        out = ROBOT.yaw_to_pitch + x * math.cos(inner) + z * math.sin(inner)
        down = -x * math.sin(inner) + z * math.cos(inner)
        c, s = math.cos(azimuth + yaw), math.sin(azimuth + yaw)
        hip_x, hip_y = (ROBOT.yaw_axis_radius * f(azimuth) for f in (math.cos, math.sin))
        feet[leg] = hip_x + out * c - y * s, hip_y + out * s + y * c, ROBOT.yaw_axis_z + down
    return feet
