"""The helm: moves the reference to the user's goal within limits of speed and acceleration."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import Vector3
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Reference

SPEED, ACCELERATION = 0.5, 1.0
"""Largest speed [m/s] and acceleration [m/s²] of the reference."""
RATE, ANGULAR_ACCELERATION = 0.6, 1.2
"""Largest rate [rad/s] and angular acceleration [rad/s²] of its heading."""
EAGERNESS = 2.0
"""Speed over distance near the goal [1/s], so that the reference can brake in time."""
AHEAD = 0.5
"""Largest distance [m] and angle [rad] from reference to goal, so that motion stops soon after a key is released."""
LOWEST, HIGHEST, FARTHEST = -0.35, 2.0, 10.0
"""Limits of goals relative to the task's reference: below, above and to the sides [m]."""
AT_GOAL = 1e-4
"""Distance below which the goal is reached [m, rad]."""


@dataclass
class Helm:
    """Offset of the reference relative to the task's reference, and the goal of this offset."""

    goal: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Goal of the offset [m]."""
    goal_yaw: float = 0.0
    """Goal of the offset in heading [rad]."""
    place: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Present offset [m]."""
    velocity: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Velocity of the offset [m/s]."""
    acceleration: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Acceleration of the offset [m/s²]."""
    yaw: float = 0.0
    """Present offset in heading [rad]."""
    rate: float = 0.0
    """Rate of the heading [rad/s]."""
    angular_acceleration: float = 0.0
    """Angular acceleration of the heading [rad/s²]."""
    ticks: int = 0
    """Control periods that have passed."""

    def nudge(self, forward: float = 0.0, left: float = 0.0, up: float = 0.0, turn: float = 0.0) -> None:
        """Move the goal in the reference's heading frame [m], and turn it to the left [rad]."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        goal = self.goal + np.array([c * forward - s * left, s * forward + c * left, up])
        ahead = goal - self.place
        goal = self.place + ahead * min(1.0, AHEAD / max(float(np.linalg.norm(ahead)), AT_GOAL))
        self.goal = np.clip(goal, (-FARTHEST, -FARTHEST, LOWEST), (FARTHEST, FARTHEST, HIGHEST))
        self.goal_yaw = self.yaw + min(max(self.goal_yaw + turn - self.yaw, -AHEAD), AHEAD)

    def home(self) -> None:
        """Set the goal to the task's reference, with the nearest full turn."""
        self.goal, self.goal_yaw = np.zeros(3), math.tau * round(self.yaw / math.tau)

    def advance(self, ticks: int) -> None:
        """Advance the offset until `ticks` control periods have passed."""
        dt = 1.0 / CONTROL_RATE
        for _ in range(ticks - self.ticks):
            before, spun = self.velocity, self.rate
            self.velocity = _approach(self.goal - self.place, before, SPEED, ACCELERATION * dt)
            self.rate = float(
                _approach(np.array([self.goal_yaw - self.yaw]), np.array([spun]), RATE, ANGULAR_ACCELERATION * dt)[0]
            )
            self.acceleration, self.angular_acceleration = (self.velocity - before) / dt, (self.rate - spun) / dt
            self.place = self.place + self.velocity * dt if self.velocity.any() else self.goal
            self.yaw = self.yaw + self.rate * dt if self.rate else self.goal_yaw
        self.ticks = ticks

    @property
    def is_home(self) -> bool:
        """Whether the offset is zero and at rest."""
        return not (self.place.any() or self.velocity.any() or self.acceleration.any() or self.yaw or self.rate)

    def applied(self, reference: Reference) -> Reference:
        """Return the task's reference, moved and turned by the offset; unchanged where the offset is zero."""
        if self.is_home:
            return reference
        turned = exp(np.array([0.0, 0.0, self.yaw])) @ quat_to_matrix(reference.quat_wb)
        up = turned[2]
        return replace(
            reference,
            position_w=reference.position_w + self.place,
            velocity_w=reference.velocity_w + self.velocity,
            acceleration_w=reference.acceleration_w + self.acceleration,
            quat_wb=matrix_to_quat(turned),
            omega_b=reference.omega_b + self.rate * up,
            alpha_b=reference.alpha_b + self.angular_acceleration * up,
        )


def _approach(way: np.ndarray, velocity: np.ndarray, fastest: float, change: float) -> np.ndarray:
    """Return the next velocity for a goal at displacement `way`; it differs from `velocity` by at most `change`."""
    distance = float(np.linalg.norm(way))
    if distance < AT_GOAL and float(np.linalg.norm(velocity)) < EAGERNESS * AT_GOAL + change:
        return np.zeros_like(velocity)
    wanted = way * min(EAGERNESS, fastest / max(distance, AT_GOAL))
    step = wanted - velocity
    return velocity + step * min(1.0, change / max(float(np.linalg.norm(step)), 1e-12))
