"""The pilot: converts targets, given at any rate, into commands of the manager of both gaits.

A source of targets, for example a policy that acts every half second, need not observe the manager's phase. The pilot
takes off if the target flies and the robot lies, lands if the target does not fly, and ignores a target that equals the
last one.
"""

import math

import numpy as np

from spidar_gym.control.course.gates import Course
from spidar_gym.control.course.target import Target
from spidar_gym.control.crawl.pose2 import Pose2, torso_pose2
from spidar_gym.control.flight.path import wrap
from spidar_gym.control.locomotion.commands import CrawlTo, FlyTo, Land, TakeOff
from spidar_gym.control.locomotion.orders import Orders
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import RobotState

FLY_LOWEST = 0.8
"""Lowest height of a target in flight above the floor at the target and above the take-off floor [m]."""
LEAST_RISE = 0.6
"""Smallest height of a take-off [m]."""
SAME_PLACE, SAME_FORM, SAME_SPEED = 0.05, 0.02, 0.05
"""A flight continues if its target changes by no more than this [m], [rad], [m/s]."""
SAME_STEP, SAME_TURN = 0.02, 0.02
"""A crawl continues if its target changes by no more than this [m], [rad]."""
THERE, THERE_TURN = 0.008, 0.015
"""A lying robot does not move if it is this close to its target [m], [rad]."""


class Pilot:
    """Follows targets by commands to a manager."""

    def __init__(self, manager: Orders) -> None:
        """Set the manager that receives the commands."""
        self.manager = manager
        self.reset()

    def reset(self) -> None:
        """Clear the last target."""
        self.last: Target | None = None
        """The target that is followed."""

    def follow(self, target: Target, state: RobotState, course: Course) -> None:
        """Command the manager to follow a target.

        Args:
            target: The target.
            state: Measured state of the robot.
            course: Map, for the heights of floors.
        """
        phase, last = self.manager.phase, self.last
        if target.flies:
            self._fly(target, phase, last, course.floor_at(target.x))
        elif phase in ("lie", "crawl"):
            self._crawl(target, phase, last, state)
        elif self.manager.airborne and phase != "descend" and not isinstance(self.manager.last, Land):
            self.manager.interrupt([Land(course.floor_at(float(state.position_w[0])))])
            self.last = target

    def _fly(self, target: Target, phase: str, last: Target | None, floor: float) -> None:
        manager = self.manager
        if phase in ("lie", "crawl", "unload"):
            manager.interrupt([TakeOff(max(LEAST_RISE, target.z - manager.floor))])
            self.last = None
        elif phase in ("hover", "form", "fly", "descend") and not _is_same_flight(target, last):
            z = max(target.z, max(floor, manager.floor) + FLY_LOWEST)
            manager.interrupt([FlyTo((target.x, target.y, z), target.form, target.speed, at_once=True)])
            self.last = target

    def _crawl(self, target: Target, phase: str, last: Target | None, state: RobotState) -> None:
        if phase == "lie":
            here = torso_pose2(state.position_w, quat_to_matrix(state.quat_wb))
            same = _is_same_pose(target, here, THERE, THERE_TURN)
        else:
            same = last is not None and _is_same_pose(target, Pose2(last.x, last.y, last.yaw), SAME_STEP, SAME_TURN)
        if not same:
            self.manager.interrupt([CrawlTo(Pose2(target.x, target.y, target.yaw))])
            self.last = target


def _is_same_flight(target: Target, last: Target | None) -> bool:
    if last is None or not last.flies:
        return False
    off = math.sqrt((target.x - last.x) ** 2 + (target.y - last.y) ** 2 + (target.z - last.z) ** 2)
    turned = float(np.abs(target.form - last.form).max())
    return off <= SAME_PLACE and turned <= SAME_FORM and abs(target.speed - last.speed) <= SAME_SPEED


def _is_same_pose(target: Target, pose: Pose2, step: float, turn: float) -> bool:
    return math.hypot(target.x - pose.x, target.y - pose.y) <= step and abs(wrap(target.yaw - pose.yaw)) <= turn
