"""Data of the crawler's allocation: memory between ticks and record of a step; the gait's memory is separate."""

from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import JointVector, RotorForces, RotorVector, Vectoring
from spidar_gym.control.allocation.allocator import Allocation
from spidar_gym.control.allocation.problem import Demand
from spidar_gym.control.rotors import ALL_FREE
from spidar_gym.model.rotor import Lock
from spidar_gym.robot import N_JOINTS, N_ROTORS


@dataclass(frozen=True, slots=True)
class CrawlMemory:
    """State of the allocation on the ground between ticks; the gait's memory is separate."""

    lock: Lock
    """State of the φ lock."""
    vectoring: Vectoring
    """(φ, θ) last commanded [rad]."""
    forces_l: RotorForces
    """Forces last commanded, link axes [N]."""
    joint_torque: JointVector
    """Feed-forward torque last commanded [Nm]."""
    joint_position: JointVector
    """q^d last commanded [rad]."""
    mode: str
    """Allocation mode of the last tick."""
    force_gap: RotorForces
    """Forces of the last mode minus those of the present one at the change of mode [N]."""
    torque_gap: JointVector
    """Feed-forward torque of the last mode minus that of the present one at the change of mode [Nm]."""
    gap: float
    """Remaining share of both gaps, 1 … 0."""
    effort: RotorVector
    """Weights of the power cost."""
    active: np.ndarray
    """Rows of the allocation that were active in the last tick, the first guess of the next."""


def fresh_crawl_memory(vectoring: Vectoring, joint_position: JointVector) -> CrawlMemory:
    """Return the memory before the first tick, for given angles [rad]: rotors off, no rotor locked."""
    zero = np.zeros((N_ROTORS, 3))
    return CrawlMemory(
        Lock(ALL_FREE, ALL_FREE, vectoring[:, 0]), vectoring, zero, np.zeros(N_JOINTS), joint_position, "rest", zero,
        np.zeros(N_JOINTS), 0.0, np.ones(N_ROTORS), np.zeros(0),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class CrawlRecord:
    """Record of one step, for plots and tests."""

    allocation: Allocation
    """Result of the allocation, before the hand-over."""
    forces_l: RotorForces
    """Commanded forces, link axes [N]."""
    mode: str
    """Allocation mode."""
    phase: str
    """Phase of the gait."""
    demand: Demand | None = None
    """Demand of the allocation; None if the step was computed by compiled code."""
