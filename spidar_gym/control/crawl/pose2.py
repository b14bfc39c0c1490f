"""Poses in the plane (x, y, yaw) and motions along arcs, for the crawl."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import Vector3

STRAIGHT = 1e-9
"""An arc that turns by less than this is a straight line [rad]."""


@dataclass(frozen=True, slots=True)
class Pose2:
    """A pose in the plane, or a motion from one to another along an arc."""

    x: float = 0.0
    """Forward [m]."""
    y: float = 0.0
    """To the left [m]."""
    yaw: float = 0.0
    """Counter-clockwise [rad]."""

    def __matmul__(self, other: "Pose2") -> "Pose2":
        """Compose this pose with `other`, which is relative to it."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y, self.yaw + other.yaw)

    def inverse(self) -> "Pose2":
        """Return the pose of the origin relative to this pose."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)

    def arc(self, fraction: float) -> "Pose2":
        """Return the pose after a fraction of the arc of constant curvature from the origin to this pose."""
        yaw = self.yaw
        if abs(yaw) < STRAIGHT:
            return Pose2(fraction * self.x, fraction * self.y, fraction * yaw)
        # Velocity of the arc: V(yaw)⁻¹ p with V(a) = [sin a, cos a − 1; 1 − cos a, sin a] / a.
        half = 0.5 * yaw
        k = half / math.tan(half)
        vx, vy = k * self.x + half * self.y, -half * self.x + k * self.y
        a = fraction * yaw
        s, c = math.sin(a) / yaw, (1.0 - math.cos(a)) / yaw
        return Pose2(s * vx - c * vy, c * vx + s * vy, a)

    @property
    def distance(self) -> float:
        """Straight distance from the origin [m]."""
        return math.hypot(self.x, self.y)

    def move(self, points: np.ndarray) -> np.ndarray:
        """Transform points (n, 3) from the axes of this pose to those of the origin; heights stay."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        R = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return points @ R + (self.x, self.y, 0.0)


def torso_pose2(position_w: Vector3, R_wb: np.ndarray) -> Pose2:
    """Compute the pose of the torso in the plane of the world."""
    return Pose2(float(position_w[0]), float(position_w[1]), math.atan2(R_wb[1, 0], R_wb[0, 0]))
