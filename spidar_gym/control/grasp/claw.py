"""The claw: the form in which four feet stand on a circle below the torso, and the plan of a contact with an object."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, Quaternion, Vector3
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import N_LEGS, ROBOT, RobotSpec

HIGHEST = -0.78
"""Greatest height of the feet from the torso's origin [m]: above it the inner ducts come near the object."""
KNEE = 1.5
"""Largest angle of a knee that presses [rad]: the rest of the joint's range is for the setpoint of a torque."""
OPEN, PRESS = 0.16, 0.005
"""Distance of open feet from the faces, and depth to which closed feet press before the grip [m]."""
NARROWEST, WIDEST = 0.14, 0.42
"""Half widths that the claw can hold [m]."""


def claw_form(radius: float, height: float, robot: RobotSpec = ROBOT) -> JointVector:
    """Return the joint angles with all feet on a circle, knees outside, yaw joints at zero [rad].

    Args:
        radius: Distance of the centres of the feet from the torso's axis [m].
        height: Their height from the torso's origin, negative below [m].
        robot: The robot.

    Raises:
        InvalidValueError: For feet out of reach.
    """
    hip = math.sqrt(2.0) * robot.yaw_axis_xy + robot.yaw_to_pitch
    inner, outer = robot.pitch_to_yaw + robot.yaw_to_pitch, robot.pitch_to_foot
    out, down = radius - hip, robot.yaw_axis_z - height
    bend = (out**2 + down**2 - inner**2 - outer**2) / (2.0 * inner * outer)
    knee = math.acos(min(1.0, max(-1.0, bend)))
    pitch = math.atan2(down, out) - math.atan2(outer * math.sin(knee), inner + outer * math.cos(knee))
    if not (abs(bend) <= 1.0 and max(abs(pitch), knee) <= robot.joint_limit):
        raise InvalidValueError("claw", (radius, height), "feet within reach of the legs [m]")
    return np.tile([0.0, pitch, 0.0, knee], N_LEGS)


def claw_height(radius: float, robot: RobotSpec = ROBOT) -> float:
    """Return the height of feet on a circle from the torso's origin, negative below [m]."""
    inner, outer = robot.pitch_to_yaw + robot.yaw_to_pitch, robot.pitch_to_foot
    out = radius - math.sqrt(2.0) * robot.yaw_axis_xy - robot.yaw_to_pitch
    square = inner**2 + outer**2 + 2.0 * inner * outer * math.cos(KNEE) - out**2
    return min(HIGHEST, robot.yaw_axis_z - math.sqrt(max(square, 0.0)))


@dataclass(frozen=True, slots=True)
class Contact:
    """Where and in which forms an object is held."""

    open: JointVector
    """Form around the object [rad]."""
    closed: JointVector
    """Form in which the feet touch it [rad]."""
    pressed: JointVector
    """Form in which the feet press a little [rad]."""
    height: float
    """Height of the torso's origin over the object's [m]."""
    yaw: float
    """Heading of the torso [rad]."""


def require_holdable(shape: str, half_size: Vector3, robot: RobotSpec = ROBOT) -> None:
    """Raise `InvalidValueError` for an object that the claw cannot hold, with the reason.

    Args:
        shape: `box`, `cylinder` or `ball`.
        half_size: As in `ObjectConfig` [m].
        robot: The robot.
    """
    a, b, _ = half_size.tolist()
    if shape == "box" and abs(a - b) > 0.02:
        raise InvalidValueError("half_size", (a, b), "a box with equal length and width: all feet move alike [m]")
    if not NARROWEST <= a <= WIDEST:
        raise InvalidValueError("half_size", a, f"half a width within {NARROWEST:g} … {WIDEST:g} m")
    foot = a + robot.foot_radius
    for off in (OPEN, -PRESS):
        claw_form(foot + off, claw_height(foot - PRESS, robot), robot)


def plan_contact(
    shape: str, half_size: Vector3, quat_wo: Quaternion, yaw: float = 0.0, robot: RobotSpec = ROBOT
) -> Contact:
    """Plan a contact in the middle of the object's height.

    Args:
        shape: `box`, `cylinder` or `ball`.
        half_size: As in `ObjectConfig` [m].
        quat_wo: Attitude of the object; it stands upright.
        yaw: Present heading of the torso: of the equal ones the nearest is chosen [rad].
        robot: The robot.

    Raises:
        InvalidValueError: For an object that the claw cannot hold, with the reason.
    """
    require_holdable(shape, half_size, robot)
    a = float(half_size[0])
    w, _, _, z = quat_wo.tolist()
    facing = 2.0 * math.atan2(z, w) + 0.25 * math.pi  # legs, at 45° to the torso's axes, towards the faces
    turn = 0.5 * math.pi
    heading = facing + turn * round((yaw - facing) / turn) if shape == "box" else yaw
    foot = a + robot.foot_radius
    height = claw_height(foot - PRESS, robot)
    forms = [claw_form(foot + off, height, robot) for off in (OPEN, 0.0, -PRESS)]
    return Contact(*forms, height=-height, yaw=heading)
