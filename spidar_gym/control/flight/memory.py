"""Data of the flight controller: model quantities and errors of a state, memory between ticks, record of a step."""

from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3, RotorForces, RotorMask, Vector3, Vectoring, Wrench
from spidar_gym.control.allocation.allocator import Allocation
from spidar_gym.control.allocation.problem import Demand
from spidar_gym.control.flight.centroidal import Integrals, MotionError
from spidar_gym.control.flight.compensation import CompensationMemory, fresh_compensation
from spidar_gym.control.flight.motion import MotionMemory, fresh_motion
from spidar_gym.control.rotors import RotorMemory, fresh_rotors
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.robot import N_JOINTS


@dataclass(frozen=True, slots=True)
class ControlState:
    """Model quantities and errors that the controller computes from a state."""

    R_wb: Matrix3
    """Attitude of the torso."""
    snapshot: Snapshot
    """Model quantities."""
    error: MotionError
    """Errors of the centroidal motion."""


@dataclass(frozen=True, slots=True)
class FlightMemory(RotorMemory):
    """Complete state of the controller between ticks; a reset replaces it."""

    integrals: Integrals
    """Integrals of the errors."""
    joint_position: JointVector
    """q^d last commanded [rad]."""
    unallocated_w: Vector3
    """Force that the last tick could not allocate, world axes [N]."""
    unallocated_torque: Vector3
    """Torque that the last tick could not allocate, torso axes [Nm]."""
    joint_velocity: JointVector
    """Rate of q^d in the last tick [rad/s]."""
    compensation: CompensationMemory
    """State of the compensations."""
    motion: MotionMemory
    """State of the observer of the whole robot's motion."""
    joint_lead: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """By how much the last joint setpoints led q^d, for springs of the servos that press on an object [rad]."""


def fresh_memory(vectoring: Vectoring, forces_l: RotorForces, joint_position: JointVector) -> FlightMemory:
    """Return the memory before the first tick, for given angles [rad] and forces [N]."""
    zero, rotors = np.zeros(3), fresh_rotors(vectoring, forces_l)
    return FlightMemory(
        rotors.lock, rotors.interference, rotors.vectoring, rotors.forces_l,
        integrals=Integrals(zero, zero),
        joint_position=joint_position,
        unallocated_w=zero,
        unallocated_torque=zero,
        joint_velocity=np.zeros(N_JOINTS),
        compensation=fresh_compensation(joint_position, np.zeros(6)),
        motion=fresh_motion(),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class FlightRecord:
    """Record of one step, for observations, plots and tests."""

    control_state: ControlState
    """Model quantities and errors."""
    wrench_desired: Wrench
    """w^d, residual included [N, Nm]."""
    allocation: Allocation
    """Result of the allocation."""
    joint_velocity: JointVector
    """Commanded joint velocity [rad/s]."""
    restricted: RotorMask
    """Rotors restricted by interference."""
    demand: Demand | None = None
    """Demand of the allocation; None if the step was computed by compiled code."""
