"""The three structs that cross every border: what the robot is, what it should do, what it is told.

Field order is part of the interface: the onboard core's structs follow it.
"""

from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import JointVector, Quaternion, RotorVector, Vector3, Vectoring


@dataclass(frozen=True, slots=True)
class RobotState:
    """What is known of the robot at one instant."""

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
    """λ [N]: what the modules deliver in the simulator, what they were last told on the robot."""
    joint_torque: JointVector
    """Torque of the joint servos [Nm]."""


@dataclass(frozen=True, slots=True)
class Reference:
    """What the robot should do at one instant."""

    position_w: Vector3
    """Desired position of the CoG in the world, r^d [m]."""
    quat_wb: Quaternion
    """Desired attitude of the torso, R^d (w, x, y, z)."""
    velocity_w: Vector3
    """Desired velocity of the CoG in the world [m/s]."""
    omega_b: Vector3
    """Desired angular velocity, in the desired torso axes [rad/s]."""
    joint_target: JointVector
    """Form to move to [rad]; the controller moves the commanded joints there at the joint speed."""
    mode: str = "flight"
    """Name of the allocation mode, see `spidar_gym.control.modes`."""


@dataclass(frozen=True, slots=True)
class Command:
    """What the actuators are told for one control period."""

    thrust: RotorVector
    """λ^d [N]."""
    vectoring: Vectoring
    """(φ^d, θ^d), unwrapped [rad]."""
    joint_position: JointVector
    """q^d [rad]."""
    joint_torque_limit: JointVector
    """Largest torque each joint servo may use [Nm]."""


_NO_WRENCH, _NO_OFFSET = np.zeros(6), np.zeros(16)
_NO_WRENCH.flags.writeable = _NO_OFFSET.flags.writeable = False


@dataclass(frozen=True, slots=True)
class Residual:
    """What a learned policy adds to the controller: the only door it gets. All zero changes nothing, bit for bit."""

    wrench: np.ndarray = field(default_factory=lambda: _NO_WRENCH)
    """Added to the desired wrench before the allocation, force [N] and torque [Nm], shape (6,)."""
    joint_offset: np.ndarray = field(default_factory=lambda: _NO_OFFSET)
    """Added to the joint targets [rad], shape (16,)."""
    joint_speed_scale: float = 1.0
    """Factor on the planned joint speed; the servo's own limit stays."""
    forces_l: np.ndarray | None = None
    """Added to the allocated rotor forces, link axes [N], shape (8, 3); the sum is moved to the nearest valid point."""


NO_RESIDUAL = Residual()
"""The paper's controller alone."""
