"""Observation of a policy in a crawl: a named layout and one pure function; no contact forces, as on the robot."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import RotorVector
from spidar_gym.control.crawl.memory import CrawlMemory
from spidar_gym.control.crawl.phases import PHASES, GaitMemory
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.observation import Field
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import RobotState

CLOCK_TICKS = 80
"""Period of the clock [control ticks], 2 s: a step of a leg and its way back. Without a gait, a policy that observes no
time comes to rest where its action is constant."""


def crawl_layout(action_size: int, robot: RobotSpec = ROBOT, *, clock: bool = False) -> tuple[Field, ...]:
    """Return the fields of the observation in order.

    Args:
        action_size: Size of the action.
        robot: The robot.
        clock: Whether there is a clock, as for actions without a gait.
    """
    hand = (Field("clock", 2, 1.0, "", "sine and cosine of the time since the reset, of period 2 s"),) if clock else ()
    return (
        Field("goal_position", 2, 5.0, "m", "goal − torso along its heading and to its left", scale=0.15),
        Field("goal_heading", 2, 1.0, "", "sine and cosine of the heading still to turn", scale=0.3),
        Field("up", 3, 1.0, "", "vertical, torso axes", scale=0.3),
        Field("height", 1, 2.0, "m", "of the torso above its lying position", scale=0.03),
        Field("velocity", 3, 5.0, "m/s", "of the torso, torso axes", scale=0.1),
        Field("angular_velocity", 3, 10.0, "rad/s", "torso axes", scale=0.3),
        Field("joint_position", N_JOINTS, 2.0, "rad", "q", scale=0.3),
        Field("joint_velocity", N_JOINTS, 5.0, "rad/s", "q̇", scale=0.5),
        Field("joint_torque", N_JOINTS, 10.0, "Nm", "of the joint servos", scale=5.0),
        Field("joint_plan_error", N_JOINTS, 2.0, "rad", "planned joint angles − q", scale=0.05),
        Field(
            "joint_way", N_JOINTS, 4.0, "rad", "target of this phase or of the torso − planned joint angles", scale=0.5
        ),
        Field("vectoring_sine", 2 * N_ROTORS, 1.0, "", "sine of φ₁, θ₁, φ₂, θ₂ …"),
        Field("vectoring_cosine", 2 * N_ROTORS, 1.0, "", "cosine of φ₁, θ₁, φ₂, θ₂ …"),
        Field("thrust_command", N_ROTORS, robot.max_thrust, "N", "λ₁ … λ₈ of the last command", scale=5.0),
        Field("vectoring_command_sine", 2 * N_ROTORS, 1.0, "", "sine of the last commanded φ, θ"),
        Field("vectoring_command_cosine", 2 * N_ROTORS, 1.0, "", "cosine of the last commanded φ, θ"),
        Field("phase", len(PHASES), 1.0, "", "1 for the present phase of " + ", ".join(PHASES)),
        Field("phase_time", 1, 20.0, "s", "since it began", scale=5.0),
        Field("share", 1, 1.0, "", "planned share of the torso's displacement in this cycle"),
        Field("steps_left", 1, 50.0, "", "remaining gait cycles, including this one", scale=5.0),
        *hand,
        Field("previous_action", action_size, 1.0, "", "last action"),
    )


@dataclass(frozen=True, slots=True)
class CrawlObservables:
    """Inputs of an observation in addition to the memories of gait and crawler."""

    state: RobotState
    """Measured state."""
    goal: Pose2
    """Goal pose of the torso, world."""
    thrust_command: RotorVector
    """Thrust last commanded [N]."""
    previous_action: np.ndarray
    """The last action."""
    ticks: int = -1
    """Control ticks since the reset; negative for an observation without a clock."""


def observe_crawl(seen: CrawlObservables, gait: GaitMemory, memory: CrawlMemory, *, bound: np.ndarray) -> np.ndarray:
    """Compute the observation in the order of `crawl_layout`, clipped to ± `bound` (one per number), float32."""
    state, goal = seen.state, seen.goal
    R_wb = quat_to_matrix(state.quat_wb)
    heading = math.atan2(R_wb[1, 0], R_wb[0, 0])
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = goal.x - float(state.position_w[0]), goal.y - float(state.position_w[1])
    angles = np.concatenate((state.vectoring, memory.vectoring)).reshape(-1)
    sine, cosine, half = np.sin(angles), np.cos(angles), 2 * N_ROTORS
    turn = 2.0 * math.pi * (seen.ticks % CLOCK_TICKS) / CLOCK_TICKS
    phase = np.zeros(len(PHASES))
    phase[PHASES.index(gait.phase)] = 1.0
    values = np.concatenate(
        (
            (c * dx + s * dy, c * dy - s * dx, math.sin(goal.yaw - heading), math.cos(goal.yaw - heading)),
            R_wb[2],
            (float((state.position_w - gait.floor_w) @ gait.floor_R[:, 2]),),
            state.velocity_w @ R_wb,
            state.omega_b,
            state.joint_position,
            state.joint_velocity,
            state.joint_torque,
            gait.plan - state.joint_position,
            gait.target - gait.plan,
            sine[:half],
            cosine[:half],
            seen.thrust_command,
            sine[half:],
            cosine[half:],
            phase,
            (gait.time, gait.share, len(gait.steps)),
            (math.sin(turn), math.cos(turn)) if seen.ticks >= 0 else (),
            seen.previous_action,
        )
    )
    return np.minimum(np.maximum(values, -bound), bound).astype(np.float32)
