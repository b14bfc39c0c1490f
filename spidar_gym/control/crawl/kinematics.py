"""Kinematics of legs whose outer yaw joint is at 0: foot ↔ joint angles in closed form, for all four legs.

The paper solves q₄ₗ₋₃, q₄ₗ₋₂ and q₄ₗ analytically [Zhao2025, Sec. Crawling Gait]. Positive pitch lowers a leg, so the
knee is up where the outer pitch is positive.
"""

import math

import numpy as np

from spidar_gym.arrays import FootForces, JointVector
from spidar_gym.robot import N_LEGS, ROBOT, RobotSpec

YAW, INNER, OUTER = np.arange(N_LEGS) * 4, np.arange(N_LEGS) * 4 + 1, np.arange(N_LEGS) * 4 + 3
"""Indices of the three joints of each leg that the crawl moves; the outer yaw joints stay at 0."""
_AZIMUTH = [ROBOT.leg_azimuth(leg) for leg in range(N_LEGS)]
_DIRECTION = [(math.cos(a), math.sin(a)) for a in _AZIMUTH]


def leg_lengths(robot: RobotSpec) -> tuple[float, float]:
    """Return the distances from the inner to the outer pitch axis, and from there to the foot's centre [m]."""
    return robot.yaw_to_pitch + robot.pitch_to_yaw, robot.pitch_to_foot


def foot_positions(inner: float, outer: float, robot: RobotSpec = ROBOT) -> FootForces:
    """Compute the centres of the four feet, torso axes [m], if all legs have these pitch angles [rad] and yaw 0."""
    upper, lower = leg_lengths(robot)
    reach = robot.yaw_axis_radius + robot.yaw_to_pitch + upper * math.cos(inner) + lower * math.cos(inner + outer)
    z = robot.yaw_axis_z - upper * math.sin(inner) - lower * math.sin(inner + outer)
    return np.array([[reach * c, reach * s, z] for c, s in _DIRECTION])


def leg_angles(feet_b: FootForces, robot: RobotSpec = ROBOT) -> JointVector | None:
    """Solve the inverse kinematics of all legs, knees up, outer yaw 0 [Zhao2025, Sec. Crawling Gait].

    Args:
        feet_b: Centres of the foot spheres, torso axes [m].
        robot: The robot.

    Returns:
        q (16,) within the range of the joints, ± 90° [rad], or None if a foot is out of reach.
    """
    q = [0.0] * (4 * N_LEGS)
    (upper, lower), hip = leg_lengths(robot), robot.yaw_axis_radius
    for leg, (x, y, z) in enumerate(feet_b.tolist()):
        dx, dy = x - hip * _DIRECTION[leg][0], y - hip * _DIRECTION[leg][1]
        yaw = math.remainder(math.atan2(dy, dx) - _AZIMUTH[leg], 2.0 * math.pi)
        out, down = math.sqrt(dx * dx + dy * dy) - robot.yaw_to_pitch, robot.yaw_axis_z - z
        cosine = (out * out + down * down - upper * upper - lower * lower) / (2.0 * upper * lower)
        if not -1.0 <= cosine <= 1.0:
            return None
        outer = math.acos(cosine)
        inner = math.atan2(down, out) - math.atan2(lower * math.sin(outer), upper + lower * cosine)
        if max(abs(yaw), abs(inner), abs(outer)) > robot.joint_limit:
            return None
        q[4 * leg], q[4 * leg + 1], q[4 * leg + 3] = yaw, inner, outer
    return np.array(q)


def feet_at(q: JointVector, robot: RobotSpec = ROBOT) -> FootForces:
    """Compute the centres of the feet, torso axes [m], for any joint angles, including outer yaw."""
    feet = np.zeros((N_LEGS, 3))
    for leg in range(N_LEGS):
        yaw, inner, twist, outer = q[4 * leg : 4 * leg + 4].tolist()
        azimuth = robot.leg_azimuth(leg)
        # In the axes of the inner link: junction offset along x, then the outer link rotated by twist and outer pitch.
        reach = robot.yaw_to_pitch + robot.pitch_to_foot * math.cos(outer)
        x = robot.pitch_to_yaw + reach * math.cos(twist)
        y, z = reach * math.sin(twist), -robot.pitch_to_foot * math.sin(outer)
        out = robot.yaw_to_pitch + x * math.cos(inner) + z * math.sin(inner)
        down = -x * math.sin(inner) + z * math.cos(inner)
        c, s = math.cos(azimuth + yaw), math.sin(azimuth + yaw)
        hip_x, hip_y = (robot.yaw_axis_radius * f(azimuth) for f in (math.cos, math.sin))
        feet[leg] = hip_x + out * c - y * s, hip_y + out * s + y * c, robot.yaw_axis_z + down
    return feet
