"""What the flight controller makes of a state, remembers from tick to tick, and records of its last step."""

from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3, RotorForces, RotorMask, Vector3, Vectoring, Wrench
from spidar_gym.control.allocation.allocator import Allocation
from spidar_gym.control.allocation.problem import Demand
from spidar_gym.control.flight.centroidal import Integrals, MotionError
from spidar_gym.control.flight.compensation import CompensationMemory, fresh_compensation
from spidar_gym.control.rotors import RotorMemory, fresh_rotors
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.robot import N_JOINTS


@dataclass(frozen=True, slots=True)
class ControlState:
    """What the controller makes of a state."""

    R_wb: Matrix3
    """Attitude of the torso."""
    snapshot: Snapshot
    """Model quantities."""
    error: MotionError
    """Errors of the centroidal motion."""


@dataclass(frozen=True, slots=True)
class FlightMemory(RotorMemory):
    """All that the controller remembers from one tick to the next; a new one is a reset."""

    integrals: Integrals
    """Integrals of the errors."""
    joint_position: JointVector
    """q^d last commanded [rad]."""
    unallocated_w: Vector3
    """Force that the last tick could not allocate, world axes [N]."""
    unallocated_torque: Vector3
    """Torque that it could not allocate, torso axes [Nm]."""
    joint_velocity: JointVector
    """Rate of q^d in the last tick [rad/s]."""
    compensation: CompensationMemory
    """What the compensations remember."""


def fresh_memory(vectoring: Vectoring, forces_l: RotorForces, joint_position: JointVector) -> FlightMemory:
    """What the controller remembers before its first tick, at angles [rad] and forces [N]."""
    zero, rotors = np.zeros(3), fresh_rotors(vectoring, forces_l)
    return FlightMemory(
        rotors.lock, rotors.interference, rotors.vectoring, rotors.forces_l,
        integrals=Integrals(zero, zero),
        joint_position=joint_position,
        unallocated_w=zero,
        unallocated_torque=zero,
        joint_velocity=np.zeros(N_JOINTS),
        compensation=fresh_compensation(joint_position, np.zeros(6)),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class FlightRecord:
    """What one step did, for observations, plots and tests."""

    control_state: ControlState
    """Model quantities and errors."""
    wrench_desired: Wrench
    """w^d, residual included [N, Nm]."""
    allocation: Allocation
    """What the allocation answered."""
    joint_velocity: JointVector
    """Commanded joint velocity [rad/s]."""
    restricted: RotorMask
    """Rotors restricted by interference."""
    demand: Demand | None = None
    """What the allocation was asked; None where compiled code asked it."""
