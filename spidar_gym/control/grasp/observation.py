"""Observation of a policy that grasps: state of the robot, the object as it is seen, the goal, and the phase."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, RotorVector
from spidar_gym.control.flight.observation import Field
from spidar_gym.control.grasp.phases import GRASP_PHASES, Seen, heading_of
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.control.locomotion.commands import OBJECTS
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import RobotState

FAR = 10.0
"""Largest observed distance [m]."""


def grasp_layout(action_size: int, robot: RobotSpec = ROBOT) -> tuple[Field, ...]:
    """Return the fields of the observation in order."""
    return (
        Field("up", 3, 1.0, "", "the vertical in torso axes", scale=0.3),
        Field("height", 1, FAR, "m", "of the torso's origin"),
        Field("velocity", 3, 5.0, "m/s", "of the torso, torso axes", scale=0.3),
        Field("angular_velocity", 3, 10.0, "rad/s", "torso axes", scale=0.3),
        Field("joint_position", N_JOINTS, 2.0, "rad", "q"),
        Field("joint_velocity", N_JOINTS, 5.0, "rad/s", "q̇", scale=0.3),
        Field("joint_command", N_JOINTS, 2.0, "rad", "q^d of the last command"),
        Field("joint_torque", N_JOINTS, 20.0, "Nm", "of the servos", scale=4.0),
        Field("vectoring_sine", 2 * N_ROTORS, 1.0, "", "sine of φ₁, θ₁, φ₂, θ₂ …"),
        Field("vectoring_cosine", 2 * N_ROTORS, 1.0, "", "cosine of φ₁, θ₁, φ₂, θ₂ …"),
        Field("thrust_command", N_ROTORS, robot.max_thrust, "N", "λ₁ … λ₈ of the last command", scale=10.0),
        Field("object", 3, FAR, "m", "the object's middle − torso, torso axes"),
        Field("object_up", 3, 1.0, "", "the object's vertical axis in torso axes", scale=0.3),
        Field("object_heading", 2, 1.0, "", "sine and cosine of the object's − torso's heading"),
        Field("object_shape", len(OBJECTS), 1.0, "", f"1 of {', '.join(OBJECTS)}"),
        Field("half_size", 3, 1.0, "m", "of the object", scale=0.3),
        Field("most_force", 1, 100.0, "N", "that a foot may press it with", scale=20.0),
        Field("goal", 3, FAR, "m", "the object's middle at the goal − the object's middle, torso axes"),
        Field("goal_heading", 2, 1.0, "", "sine and cosine of the goal's − object's heading"),
        Field("feet", 3 * N_LEGS, FAR, "m", "each foot − the object's middle, torso axes", scale=0.5),
        Field("grip", 1, 100.0, "N", "force of each foot that the controller plans", scale=20.0),
        Field("payload", 1, 20.0, "kg", "mass that the controller carries", scale=2.0),
        Field("phase", len(GRASP_PHASES), 1.0, "", f"of the grasp: 1 of {', '.join(GRASP_PHASES)}"),
        Field("charge", 1, 1.0, "", "of the battery, 1 is full"),
        Field("time_left", 1, 1.0, "", "share of the episode"),
        Field("previous_action", action_size, 1.0, "", "last action"),
    )


@dataclass(frozen=True, slots=True)
class GraspObservables:
    """Inputs of an observation."""

    state: RobotState
    """Measured state."""
    scene: GraspScene
    """Object and goal; what is hidden is not observed."""
    seen: Seen
    """The object as it is seen."""
    grip: float
    """Force of each foot that the controller plans [N]."""
    payload: float
    """Mass that it carries [kg]."""
    phase: str
    """Phase of the grasp, one of `GRASP_PHASES`."""
    thrust_command: RotorVector
    """Thrust last commanded [N]."""
    joint_command: JointVector
    """q^d last commanded [rad]."""
    charge: float
    """Charge of the battery, 0 … 1."""
    time_left: float
    """Remaining share of the episode's time."""
    previous_action: np.ndarray
    """The last action."""


def observe_grasp(observed: GraspObservables, model: Model, *, bound: np.ndarray) -> np.ndarray:
    """Compute the observation in the order of `grasp_layout`, clipped to ± `bound` (one per number), float32."""
    state, scene, seen = observed.state, observed.scene, observed.seen
    R_wb, R_wo = quat_to_matrix(state.quat_wb), quat_to_matrix(seen.quat_wo)
    own, its = math.atan2(R_wb[1, 0], R_wb[0, 0]), heading_of(seen.quat_wo)
    middle_b = R_wb.T @ (seen.position_w - state.position_w)
    goal_w = np.array([scene.goal.x, scene.goal.y, scene.floor + scene.top])
    feet_b = model.stance(state.joint_position, R_wb, state.vectoring)[1].position_b
    values = np.concatenate((
        R_wb[2], state.position_w[2:], R_wb.T @ state.velocity_w, state.omega_b,
        state.joint_position, state.joint_velocity, observed.joint_command, state.joint_torque,
        np.sin(state.vectoring).reshape(-1), np.cos(state.vectoring).reshape(-1), observed.thrust_command,
        middle_b, R_wb.T @ R_wo[:, 2], (math.sin(its - own), math.cos(its - own)),
        [float(scene.shape == shape) for shape in OBJECTS], scene.half_size, (scene.most_force,),
        R_wb.T @ (goal_w - seen.position_w), (math.sin(scene.goal.yaw - its), math.cos(scene.goal.yaw - its)),
        (feet_b - middle_b).reshape(-1), (observed.grip, observed.payload),
        [float(observed.phase == phase) for phase in GRASP_PHASES], (observed.charge, observed.time_left),
        observed.previous_action,
    ))  # fmt: skip
    return np.minimum(np.maximum(values, -bound), bound).astype(np.float32)
