"""A kinematic world in which the robot follows its gait, exactly or with errors, for the tests of the gait."""

import math
from itertools import groupby

import numpy as np
from support.states import model

from spidar_gym.control.crawl.footsteps import GaitConfig, Move, lying_pose
from spidar_gym.control.crawl.gait import Gait
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.robot import N_LEGS, ROBOT
from spidar_gym.so3 import rotation_z
from spidar_gym.state import NO_RESIDUAL

DT, SPEED = 0.025, 0.2
FORWARD = Move(Pose2(0.2))
LEVEL = np.eye(3)
EXACT = GaitConfig(trim_gain=0.0)
"""The plan alone: no feedback corrects its errors."""


def feet_of(q):
    """Centres of the feet, torso axes, by Pinocchio."""
    return model().contacts(q)[0][:N_LEGS]


class World:
    """Exact joints, feet that stay where they stand, and a torso that the floor stops; floor axes."""

    def __init__(
        self, config=EXACT, *, R_wf=LEVEL, start=(0.0, 0.0, 0.0), lost=0.0, rolling=False, floor=0.0, sink=9.0
    ):
        """`lost` is the fraction of every displacement that the torso misses, `sink` its fastest descent [m/s]."""
        self.config, self.R_wf, self.lost, self.rolling, self.floor, self.sink = (
            config,
            R_wf,
            lost,
            rolling,
            floor,
            sink,
        )
        self.gait = Gait(config, joint_speed=SPEED, dt=DT)
        self.q, self.slip, self.rows = lying_pose(config), 0.0, []
        self.lying = floor + ROBOT.peg_depth
        self.position, self.R = np.array([start[0], start[1], ROBOT.peg_depth]), rotation_z(start[2])
        self.origin = self.position
        self.gait.reset(*self.seen, self.q)
        self.start = self.planar

    @property
    def seen(self):
        """Position and attitude of the torso as passed to the gait, world axes."""
        return self.R_wf @ self.position, self.R_wf @ self.R

    @property
    def planar(self):
        position_w, R_wb = self.seen
        return Pose2(float(position_w[0]), float(position_w[1]), math.atan2(R_wb[1, 0], R_wb[0, 0]))

    @property
    def feet(self):
        return self.position + feet_of(self.q) @ self.R.T

    def servo(self, plan):
        return plan

    def tick(self, residual=NO_RESIDUAL):
        gait = self.gait
        standing = gait.mode == "stance"
        plan = gait.step(*self.seen, self.q, residual)
        if gait.mode == "stance" and not standing:
            self.stance, self.origin = self.feet, self.position
        before, self.q = self.q, self.servo(plan)
        if gait.mode == "stance":
            self._stand(before)
        height = self.position[2] - ROBOT.peg_depth
        self.rows.append((gait.memory.phase, plan.copy(), self.feet, height, self.planar, gait.mode, gait.lifted))

    def _stand(self, before):
        """Move the torso to the least-squares fit of all four feet, which stand still or roll."""
        if self.rolling:
            turned = (self.q - before).reshape(N_LEGS, 4)[:, (1, 3)].sum(axis=1)
            hips = ROBOT.yaw_axis_xy * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
            out = (feet_of(self.q)[:, :2] - hips) @ self.R[:2, :2].T
            self.stance[:, :2] += (ROBOT.foot_radius * turned / np.linalg.norm(out, axis=1))[:, None] * out
        feet_b = feet_of(self.q)
        centre_b, centre = feet_b.mean(axis=0), self.stance.mean(axis=0)
        U, _, Vt = np.linalg.svd((self.stance - centre).T @ (feet_b - centre_b))
        self.R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        position = centre - self.R @ centre_b
        self.slip = max(self.slip, float(np.abs(position + feet_b @ self.R.T - self.stance).max()))
        position[:2] -= self.lost * (position - self.origin)[:2]
        low = self.lying if self.gait.memory.phase == "down" else ROBOT.peg_depth
        position[2] = max(position[2], low, self.position[2] - self.sink * DT)
        self.position = position

    def run(self, *commands, residual=NO_RESIDUAL, ticks=20000):
        self.gait.command(commands)
        while not self.gait.done:
            self.tick(residual)
            ticks -= 1
            assert ticks > 0, f"stuck in {self.gait.memory.phase}"
        return self

    @property
    def phases(self):
        return [phase for phase, _ in groupby(row[0] for row in self.rows)]

    def during(self, *phases):
        return [row for row in self.rows if row[0] in phases]

    def missed(self, *ways):
        """Distance of the torso from the goal of these displacements: x, y [m], yaw [rad]."""
        goal = self.start
        for way in ways:
            goal = goal @ way
        here = self.planar
        return np.abs([here.x - goal.x, here.y - goal.y, math.remainder(here.yaw - goal.yaw, 2.0 * math.pi)])


WAYS = {
    "forward": [Pose2(0.2)],
    "backward": [Pose2(-0.45)],
    "sideways": [Pose2(0.0, 0.3)],
    "diagonal": [Pose2(0.15, -0.25)],
    "turn": [Pose2(yaw=0.9)],
    "back turn": [Pose2(yaw=-0.4)],
    "arc": [Pose2(0.4, 0.2, 0.8)],
    "path": [Pose2(0.25, 0.1), Pose2(yaw=-0.5), Pose2(0.2, 0.0, 0.4), Pose2(-0.1, -0.2)],
}
