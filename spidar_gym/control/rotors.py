"""From a wrench to what the allocation is asked: rotors restricted by interference, locked, or lost."""

from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.arrays import RotorForces, RotorMask, Vectoring, Wrench, constant
from spidar_gym.control.allocation.blocks import torque_map
from spidar_gym.control.allocation.problem import Demand, Mode
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.model.interference import Interference, InterferenceConfig, find_interference, no_interference
from spidar_gym.model.rotor import Lock, LockConfig, nominal_vectoring, thrust_map, update_lock
from spidar_gym.robot import N_ROTORS

ALL_FREE = constant(False, N_ROTORS)
NARROW = 0.01
"""Half of the wedge that stands for the one direction of a module whose vectoring is stuck [rad]."""


@dataclass(frozen=True, slots=True)
class RotorMemory:
    """What is remembered of the rotors from one tick to the next."""

    lock: Lock
    """Held φ."""
    interference: Interference
    """Restricted rotors and chosen sides."""
    vectoring: Vectoring
    """(φ, θ) last commanded [rad]."""
    forces_l: RotorForces
    """Forces last allocated, link axes [N]."""


def fresh_rotors(vectoring: Vectoring, forces_l: RotorForces) -> RotorMemory:
    """The memory before a first tick, at angles [rad] and forces [N]: nothing held, nothing restricted."""
    return RotorMemory(Lock(ALL_FREE, ALL_FREE, vectoring[:, 0]), no_interference(), vectoring, forces_l)


def flight_demand(
    memory: RotorMemory, mode: Mode, snapshot: Snapshot, vectoring: Vectoring, wrench: Wrench, *,
    lost_thrust: RotorMask, lost_vectoring: RotorMask, interference_config: InterferenceConfig, lock_config: LockConfig,
) -> tuple[Demand, Lock, Interference]:  # fmt: skip
    """What the allocation is asked: the wrench, the maps, and the rotors that are locked or restricted.

    Args:
        memory: What the last tick left.
        mode: The allocation's mode; it says whether rotors avoid interference.
        snapshot: The model's quantities.
        vectoring: (φ, θ) as they are [rad]; a stuck module's thrust stays there.
        wrench: Desired wrench, see `Wrench`.
        lost_thrust: Modules that have no thrust.
        lost_vectoring: Modules whose φ and θ no longer move.
        interference_config: Thresholds.
        lock_config: When and how φ is held.
    """
    nominal = nominal_vectoring(snapshot.R_bl, memory.vectoring)
    bounds = find_interference(snapshot, nominal, memory.interference, config=interference_config)
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
        robot=snapshot.robot,
    )
    return demand, lock, bounds


def _without(
    gone: RotorMask, stuck: RotorMask, lock: Lock, bounds: Interference, vectoring: Vectoring
) -> tuple[Lock, Interference]:
    """Lock and bounds where modules are lost: no rows for those without thrust, one direction for those stuck."""
    lock = replace(lock, active=(lock.active | stuck) & ~gone, phi=np.where(stuck, vectoring[:, 0], lock.phi))
    bounds = replace(
        bounds,
        restricted=(bounds.restricted | stuck) & ~gone,
        lower=np.where(stuck, vectoring[:, 1] - NARROW, bounds.lower),
        upper=np.where(stuck, vectoring[:, 1] + NARROW, bounds.upper),
    )
    return lock, bounds
