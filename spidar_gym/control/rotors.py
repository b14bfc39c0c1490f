"""Builds the allocation's demand from a wrench: rotors restricted by interference, locked, or lost."""

import math
from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.arrays import RotorForces, RotorMask, Vectoring, Wrench, constant
from spidar_gym.control.allocation.blocks import torque_map
from spidar_gym.control.allocation.problem import Demand, Mode
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.model.interference import Disc, Interference, InterferenceConfig, find_interference, no_interference
from spidar_gym.model.rotor import Lock, LockConfig, nominal_vectoring, thrust_map, update_lock
from spidar_gym.robot import N_ROTORS

ALL_FREE = constant(False, N_ROTORS)
NARROW = 0.01
"""Half-width of the range of θ that represents the direction of a module with stuck vectoring [rad]."""


@dataclass(frozen=True, slots=True)
class RotorMemory:
    """State of the rotors kept from one tick to the next."""

    lock: Lock
    """State of the φ lock."""
    interference: Interference
    """Restricted rotors and chosen sides."""
    vectoring: Vectoring
    """(φ, θ) last commanded [rad]."""
    forces_l: RotorForces
    """Forces last allocated, link axes [N]."""


def fresh_rotors(vectoring: Vectoring, forces_l: RotorForces) -> RotorMemory:
    """Return the memory before the first tick, for given angles [rad] and forces [N]: no rotor locked or restricted."""
    return RotorMemory(Lock(ALL_FREE, ALL_FREE, vectoring[:, 0]), no_interference(), vectoring, forces_l)


def flight_demand(
    memory: RotorMemory, mode: Mode, snapshot: Snapshot, vectoring: Vectoring, wrench: Wrench, *,
    lost_thrust: RotorMask, lost_vectoring: RotorMask, interference_config: InterferenceConfig, lock_config: LockConfig,
    thrust_limit: float = math.inf, disc: Disc | None = None,
) -> tuple[Demand, Lock, Interference]:  # fmt: skip
    """Build the allocation's demand: the wrench, the maps, and the rotors that are locked or restricted.

    Args:
        memory: State after the last tick.
        mode: The allocation's mode, which specifies whether rotors avoid interference.
        snapshot: The model's quantities.
        vectoring: Present (φ, θ) [rad], at which the thrust of a stuck module stays.
        wrench: Desired wrench, see `Wrench`.
        lost_thrust: Modules that have no thrust.
        lost_vectoring: Modules whose φ and θ no longer move.
        interference_config: Thresholds of the interference test.
        lock_config: Thresholds and rates of the φ lock.
        thrust_limit: λ̄ at the present voltage [N].
        disc: The top of an object below, which jets avoid too.
    """
    nominal = nominal_vectoring(snapshot.R_bl, memory.vectoring)
    bounds = find_interference(snapshot, nominal, memory.interference, config=interference_config, disc=disc)
    if not mode.avoid_interference:
        bounds = replace(bounds, restricted=ALL_FREE)
    lock = update_lock(memory.lock, bounds.restricted, nominal, snapshot, memory.vectoring[:, 0], config=lock_config)
    if lost_thrust.any() or lost_vectoring.any():
        lock, bounds = _without(lost_thrust, lost_vectoring, lock, bounds, vectoring)
    demand = Demand(
        wrench=wrench,
        thrust_map=thrust_map(snapshot.R_bl, snapshot.rotor_c),
        torque_map=torque_map(snapshot),
        gravity_torque=snapshot.gravity_torque,
        locked=lock.active,
        phi=lock.phi,
        restricted=bounds.restricted,
        lower=bounds.lower,
        upper=bounds.upper,
        lost=lost_thrust,
        thrust_limit=thrust_limit,
        robot=snapshot.robot,
    )
    return demand, lock, bounds


def _without(
    gone: RotorMask, stuck: RotorMask, lock: Lock, bounds: Interference, vectoring: Vectoring
) -> tuple[Lock, Interference]:
    """Adapt lock and bounds to lost modules: no rows for modules without thrust, one direction for stuck modules."""
    lock = replace(lock, active=(lock.active | stuck) & ~gone, phi=np.where(stuck, vectoring[:, 0], lock.phi))
    bounds = replace(
        bounds,
        restricted=(bounds.restricted | stuck) & ~gone,
        lower=np.where(stuck, vectoring[:, 1] - NARROW, bounds.lower),
        upper=np.where(stuck, vectoring[:, 1] + NARROW, bounds.upper),
    )
    return lock, bounds
