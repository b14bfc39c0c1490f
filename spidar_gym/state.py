"""Structs shared by all parts: state of the robot, measurement, reference, command, residual.

Field order is part of the interface: the onboard core's structs follow it.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import JointVector, Quaternion, RotorMask, RotorVector, Vector3, Vectoring, constant

POSE_FRAMES, IMU_SAMPLES = 4, 8
"""Largest numbers of motion capture frames and of inertial unit samples in a measurement."""
LEAST_QUATERNION = 0.25
"""A quaternion is a valid attitude only if its squared norm is above this."""
_NONE_LOST, _STEADY = constant(False, 8), constant(0.0, 3)


@dataclass(frozen=True, slots=True)
class RobotState:
    """State of the robot at one instant, true or estimated."""

    time: float
    """Time since the start [s]."""
    position_w: Vector3
    """Origin of the torso in the world [m]."""
    quat_wb: Quaternion
    """Attitude of the torso (w, x, y, z)."""
    velocity_w: Vector3
    """Velocity of the torso's origin in the world [m/s]."""
    omega_b: Vector3
    """Angular velocity of the torso, torso axes [rad/s]."""
    joint_position: JointVector
    """q [rad]."""
    joint_velocity: JointVector
    """q̇ [rad/s]."""
    vectoring: Vectoring
    """(φ, θ) of each rotor, unwrapped [rad]."""
    vectoring_velocity: Vectoring
    """Rates of (φ, θ) [rad/s]."""
    thrust: RotorVector
    """λ [N]: delivered by the modules in the simulator, last commanded on the robot."""
    joint_torque: JointVector
    """Torque of the joint servos [Nm]."""

    @classmethod
    def at_rest(cls, joint_position: JointVector, vectoring: Vectoring | None = None) -> "RobotState":
        """Return the state of a level robot at rest at the world's origin, its rotors idle.

        Args:
            joint_position: q [rad].
            vectoring: (φ, θ) of each rotor [rad]; zero if not given.
        """
        return cls(
            0.0, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3), joint_position, np.zeros(16),
            np.zeros((8, 2)) if vectoring is None else vectoring, np.zeros((8, 2)), np.zeros(8), np.zeros(16),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Measurement:
    """Sensor data received since the last control tick; the counts give the number of valid rows."""

    time: float
    """Time of the control tick [s]."""
    pose_count: int
    """Number of received motion capture frames, which are the first rows of the three arrays below."""
    pose_time: np.ndarray
    """Time at which each frame was taken, shape (4,) [s]."""
    pose_position_w: np.ndarray
    """Origin of the flight controller in the world, shape (4, 3) [m]."""
    pose_quat_wb: np.ndarray
    """Attitude of the torso (w, x, y, z), shape (4, 4)."""
    imu_count: int
    """Number of samples of the flight controller's inertial unit, oldest first."""
    imu_time: np.ndarray
    """Time of each sample, shape (8,) [s]."""
    gyro_b: np.ndarray
    """Angular velocity, torso axes, shape (8, 3) [rad/s]."""
    specific_force_b: np.ndarray
    """Acceleration minus gravity at the flight controller, torso axes, shape (8, 3) [m/s²]."""
    encoder_time: float
    """Time at which the servos were read last [s]."""
    joint_position: JointVector
    """Indicated q [rad]."""
    joint_torque: JointVector
    """Torque reported by the joint servos [Nm]."""
    vectoring: Vectoring
    """Indicated (φ, θ) [rad]."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Desired motion of the robot at one instant."""

    position_w: Vector3
    """Desired position of the CoG in the world, r^d [m]."""
    quat_wb: Quaternion
    """Desired attitude of the torso, R^d (w, x, y, z)."""
    velocity_w: Vector3
    """Desired velocity of the CoG in the world [m/s]."""
    omega_b: Vector3
    """Desired angular velocity, in the desired torso axes [rad/s]."""
    joint_target: JointVector
    """Target form [rad]; the controller moves the commanded joints there at the joint speed."""
    mode: str = "flight"
    """Name of the allocation mode, see `spidar_gym.control.allocation.modes`."""
    lost_thrust: RotorMask = field(default_factory=lambda: _NONE_LOST)
    """Modules reported to have no thrust; the allocation sets their forces to zero."""
    lost_vectoring: RotorMask = field(default_factory=lambda: _NONE_LOST)
    """Modules whose φ and θ no longer move; the allocation uses their thrust in its present direction."""
    acceleration_w: Vector3 = field(default_factory=lambda: _STEADY)
    """Desired acceleration of the CoG in the world [m/s²]."""
    alpha_b: Vector3 = field(default_factory=lambda: _STEADY)
    """Desired angular acceleration, in the desired torso axes [rad/s²]."""
    support: float = 0.0
    """Share of the weight that the floor carries, 0 … 1: the rotor forces are scaled by 1 − support. Above 0 the
    integrals and the observer are not updated."""


@dataclass(frozen=True, slots=True)
class Command:
    """Setpoints of the actuators for one control period."""

    thrust: RotorVector
    """λ^d [N]."""
    vectoring: Vectoring
    """(φ^d, θ^d), unwrapped [rad]."""
    joint_position: JointVector
    """q^d [rad]."""
    joint_torque_limit: JointVector
    """Largest torque each joint servo may use [Nm]."""


_NO_WRENCH, _NO_OFFSET = constant(0.0, 6), constant(0.0, 16)


@dataclass(frozen=True, slots=True)
class Residual:
    """Additions of a learned policy to the controller. A zero residual changes nothing, bit for bit."""

    wrench: np.ndarray = field(default_factory=lambda: _NO_WRENCH)
    """Added to the desired wrench before the allocation, force [N] and torque [Nm], shape (6,)."""
    joint_offset: np.ndarray = field(default_factory=lambda: _NO_OFFSET)
    """Added to the joint targets [rad], shape (16,)."""
    joint_speed_scale: float = 1.0
    """Factor on the planned joint speed, on the ground the rate of the phases; the servo's own limit stays."""
    forces_l: np.ndarray | None = None
    """Added to the allocated rotor forces, link axes [N], shape (8, 3); the sum is moved to the nearest valid point."""
    leg_forces_b: np.ndarray | None = None
    """On the ground: force added to each leg, torso axes [N], shape (4, 3); the two rotors of a leg share it."""
    raise_scale: float = 1.0
    """On the ground: factor on the height to which the next step raises the legs."""
    stride_scale: float = 1.0
    """On the ground: factor on the next stride, within the reach."""
    lift_scale: float = 1.0
    """On the ground: factor on the lift of the next torso motion."""


NO_RESIDUAL = Residual()
"""The paper's controller alone."""


def valid_state(state: RobotState) -> bool:
    """Whether every number of the state that the controller reads is finite and the attitude is valid."""
    numbers = np.concatenate(
        (
            state.position_w, state.quat_wb, state.velocity_w, state.omega_b, state.joint_position,
            state.joint_velocity, state.vectoring.reshape(-1),
        )
    )  # fmt: skip
    # A tracking system that has lost the robot may send a quaternion of zeros.
    return math.isfinite(float(numbers @ numbers)) and float(state.quat_wb @ state.quat_wb) > LEAST_QUATERNION


def valid_reference(reference: Reference) -> bool:
    """Whether every number is finite and the attitude is valid."""
    numbers = np.concatenate(
        (
            reference.position_w, reference.quat_wb, reference.velocity_w, reference.omega_b, reference.joint_target,
            reference.acceleration_w, reference.alpha_b, (reference.support,),
        )
    )  # fmt: skip
    return math.isfinite(float(numbers @ numbers)) and float(reference.quat_wb @ reference.quat_wb) > LEAST_QUATERNION


def valid_residual(residual: Residual) -> bool:
    """Whether every number is finite."""
    square = float(residual.wrench @ residual.wrench) + float(residual.joint_offset @ residual.joint_offset)
    for forces in (residual.forces_l, residual.leg_forces_b):
        if forces is not None:
            square += float(np.vdot(forces, forces))
    scales = residual.joint_speed_scale + residual.raise_scale + residual.stride_scale + residual.lift_scale
    return math.isfinite(square + scales)
