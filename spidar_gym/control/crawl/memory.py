"""What the crawler's allocation remembers from tick to tick, and records of its last step; the gait has its own."""

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
    """All that the allocation on the ground remembers; the gait has its own."""

    lock: Lock
    """Held φ."""
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
    """What the last mode gave beyond the present one when it gave way [N]."""
    torque_gap: JointVector
    """What the last mode gave of feed-forward torque beyond the present one when it gave way [Nm]."""
    gap: float
    """How much of both gaps is left, 1 … 0."""
    effort: RotorVector
    """Weights of the power cost."""
    active: np.ndarray
    """Rows of the allocation that were active in the last tick, the first guess of the next."""


def fresh_crawl_memory(vectoring: Vectoring, joint_position: JointVector) -> CrawlMemory:
    """What is remembered before a first tick, at angles [rad]: rotors off, nothing held."""
    zero = np.zeros((N_ROTORS, 3))
    return CrawlMemory(
        Lock(ALL_FREE, ALL_FREE, vectoring[:, 0]), vectoring, zero, np.zeros(N_JOINTS), joint_position, "rest", zero,
        np.zeros(N_JOINTS), 0.0, np.ones(N_ROTORS), np.zeros(0),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class CrawlRecord:
    """What one step did, for plots and tests."""

    allocation: Allocation
    """What the allocation answered, before the hand-over."""
    forces_l: RotorForces
    """Forces that were commanded, link axes [N]."""
    mode: str
    """Allocation mode."""
    phase: str
    """Phase of the gait."""
    demand: Demand | None = None
    """What the allocation was asked; None where compiled code asked it."""
