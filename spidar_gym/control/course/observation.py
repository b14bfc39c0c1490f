"""Observation of a policy on a course: state of the robot, phase, goal, and the next gates of the map."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, RotorVector, Vectoring
from spidar_gym.control.course.gates import KINDS, Course
from spidar_gym.control.course.target import Target
from spidar_gym.control.flight.observation import Field
from spidar_gym.control.locomotion.orders import COURSE_PHASES
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import RobotState

AHEAD = 3
"""Number of observed gates and floors, the next first."""
SEEN = 2.0
"""A gate is observed until the torso is this far behind its end [m]."""
FAR = 20.0
"""Largest observed distance [m]."""


def course_layout(action_size: int, robot: RobotSpec = ROBOT) -> tuple[Field, ...]:
    """Return the fields of the observation in order; positions and velocities are in world axes, as a target's."""
    gates = tuple(
        Field(f"gate{k + 1}", len(KINDS) + 4, FAR, "1, m or rad",
              f"one of {', '.join(KINDS)} as 1 of {len(KINDS)}; torso → begin, torso → end, size, torso → middle to "
              "the left; all zero if there is none", scale=3.0)
        for k in range(AHEAD)
    )  # fmt: skip
    return (
        Field(
            "goal", 5, FAR, "m, 1", "goal − torso, x, y, z [m]; sine and cosine of goal's − torso's heading", scale=3.0
        ),
        Field("place", 2, FAR, "m", "torso to the left of the course's middle, and over its floor's origin"),
        Field("heading", 2, 1.0, "", "sine and cosine"),
        Field("up", 3, 1.0, "", "the vertical in torso axes", scale=0.3),
        Field("velocity", 3, 5.0, "m/s", "of the torso", scale=0.5),
        Field("angular_velocity", 3, 10.0, "rad/s", "torso axes", scale=0.3),
        Field("joint_position", N_JOINTS, 2.0, "rad", "q"),
        Field("joint_velocity", N_JOINTS, 5.0, "rad/s", "q̇", scale=0.5),
        Field("joint_command", N_JOINTS, 2.0, "rad", "q^d of the last command"),
        Field("vectoring_sine", 2 * N_ROTORS, 1.0, "", "sine of φ₁, θ₁, φ₂, θ₂ …"),
        Field("vectoring_cosine", 2 * N_ROTORS, 1.0, "", "cosine of φ₁, θ₁, φ₂, θ₂ …"),
        Field("thrust_command", N_ROTORS, robot.max_thrust, "N", "λ₁ … λ₈ of the last command", scale=10.0),
        Field("vectoring_command_sine", 2 * N_ROTORS, 1.0, "", "sine of the last commanded φ, θ"),
        Field("vectoring_command_cosine", 2 * N_ROTORS, 1.0, "", "cosine of the last commanded φ, θ"),
        Field("phase", len(COURSE_PHASES), 1.0, "", f"of the manager: 1 of {', '.join(COURSE_PHASES)}"),
        Field("target", 5, FAR, "1, m", "whether there is one, whether it flies, target − torso, x, y, z", scale=3.0),
        Field("charge", 1, 1.0, "", "of the battery, 1 is full"),
        Field("time_left", 1, 1.0, "", "share of the episode"),
        *gates,
        Field("previous_action", action_size, 1.0, "", "last action"),
    )


@dataclass(frozen=True, slots=True)
class CourseObservables:
    """Inputs of an observation."""

    state: RobotState
    """Measured state."""
    course: Course
    """The map."""
    phase: str
    """Phase of the manager."""
    target: Target | None
    """Target that the pilot follows, if there is one."""
    thrust_command: RotorVector
    """Thrust last commanded [N]."""
    vectoring_command: Vectoring
    """(φ, θ) last commanded [rad]."""
    joint_command: JointVector
    """q^d last commanded [rad]."""
    charge: float
    """Charge of the battery, 0 … 1."""
    time_left: float
    """Remaining share of the episode's time."""
    previous_action: np.ndarray
    """The last action."""


def observe_course(seen: CourseObservables, *, bound: np.ndarray, robot: RobotSpec = ROBOT) -> np.ndarray:
    """Compute the observation in the order of `course_layout`, clipped to ± `bound` (one per number), float32."""
    state, course, goal, target = seen.state, seen.course, seen.course.goal, seen.target
    x, y, z = state.position_w.tolist()
    R_wb = quat_to_matrix(state.quat_wb)
    yaw = math.atan2(R_wb[1, 0], R_wb[0, 0])
    over = course.floor_at(goal.x) + robot.peg_depth - z
    whither = (0.0,) * 5 if target is None else (1.0, float(target.flies), target.x - x, target.y - y, target.z - z)
    gates = np.zeros((AHEAD, len(KINDS) + 4))
    for row, gate in zip(gates, [g for g in course.gates if x < g.end + SEEN], strict=False):
        row[KINDS.index(gate.kind)] = 1.0
        row[len(KINDS) :] = gate.begin - x, gate.end - x, gate.size, gate.middle - y
    values = np.concatenate((
        (goal.x - x, goal.y - y, over, math.sin(goal.yaw - yaw), math.cos(goal.yaw - yaw)),
        (y, z, math.sin(yaw), math.cos(yaw)), R_wb[2],
        state.velocity_w, state.omega_b, state.joint_position, state.joint_velocity, seen.joint_command,
        np.sin(state.vectoring).reshape(-1), np.cos(state.vectoring).reshape(-1), seen.thrust_command,
        np.sin(seen.vectoring_command).reshape(-1), np.cos(seen.vectoring_command).reshape(-1),
        [float(seen.phase == phase) for phase in COURSE_PHASES], whither, (seen.charge, seen.time_left),
        gates.reshape(-1), seen.previous_action,
    ))  # fmt: skip
    return np.minimum(np.maximum(values, -bound), bound).astype(np.float32)
