"""The helm: where people want the reference, and how it goes there, within a speed and an acceleration."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import Vector3
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Reference

SPEED, ACCELERATION = 0.5, 1.0
"""The reference moves no faster than this [m/s], and gathers speed no faster [m/s²]."""
RATE, ANGULAR_ACCELERATION = 0.6, 1.2
"""The same of its heading [rad/s], [rad/s²]."""
EAGERNESS = 2.0
"""Near its goal it goes at so many times the distance a second [1/s]: no faster than it can brake."""
AHEAD = 0.5
"""A goal is never farther from the reference [m]: who holds a key down and lets go is not carried on for long."""
LOWEST, HIGHEST, FARTHEST = -0.35, 2.0, 10.0
"""Goals lie within this: below and above where the task has the reference, and how far from it to the side [m]."""
AT_GOAL = 1e-4
"""Nearer than this it is there [m, rad]."""


@dataclass
class Helm:
    """Where the reference is to go, seen from where the task has it, and how far it has come."""

    goal: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Where it is to be [m]."""
    goal_yaw: float = 0.0
    """How it is to be turned [rad]."""
    place: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Where it is [m]."""
    velocity: Vector3 = field(default_factory=lambda: np.zeros(3))
    """[m/s]."""
    acceleration: Vector3 = field(default_factory=lambda: np.zeros(3))
    """[m/s²]."""
    yaw: float = 0.0
    """How it is turned [rad]."""
    rate: float = 0.0
    """[rad/s]."""
    angular_acceleration: float = 0.0
    """[rad/s²]."""
    ticks: int = 0
    """Control periods that have passed."""

    def nudge(self, forward: float = 0.0, left: float = 0.0, up: float = 0.0, turn: float = 0.0) -> None:
        """Move the goal, seen from where the reference looks [m], and turn it to the left [rad]."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        goal = self.goal + np.array([c * forward - s * left, s * forward + c * left, up])
        ahead = goal - self.place
        goal = self.place + ahead * min(1.0, AHEAD / max(float(np.linalg.norm(ahead)), AT_GOAL))
        self.goal = np.clip(goal, (-FARTHEST, -FARTHEST, LOWEST), (FARTHEST, FARTHEST, HIGHEST))
        self.goal_yaw = self.yaw + min(max(self.goal_yaw + turn - self.yaw, -AHEAD), AHEAD)

    def home(self) -> None:
        """Have the reference go back to where the task has it."""
        self.goal, self.goal_yaw = np.zeros(3), math.tau * round(self.yaw / math.tau)

    def advance(self, ticks: int) -> None:
        """Let time pass until so many control periods have."""
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
        """Whether the reference is where the task has it, at rest."""
        return not (self.place.any() or self.velocity.any() or self.acceleration.any() or self.yaw or self.rate)

    def applied(self, reference: Reference) -> Reference:
        """The task's reference, moved and turned; the very same where it is home."""
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
    """The next velocity of something that is still `way` from its goal and may change its velocity by `change`."""
    distance = float(np.linalg.norm(way))
    if distance < AT_GOAL and float(np.linalg.norm(velocity)) < EAGERNESS * AT_GOAL + change:
        return np.zeros_like(velocity)
    wanted = way * min(EAGERNESS, fastest / max(distance, AT_GOAL))
    step = wanted - velocity
    return velocity + step * min(1.0, change / max(float(np.linalg.norm(step)), 1e-12))
