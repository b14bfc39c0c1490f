"""`pinv`: the pseudo-inverse of the thrust map, clamped: what most drone simulators allocate with."""

import numpy as np

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control import Allocation, AllocationStatus, Allocator, Demand
from spidar_gym.robot import N_ROTORS


class PseudoInverse(Allocator):
    """f = Q⁺ w^d, each ‖f_i‖ clamped to λ̄: no joint torque, no interference; a held φ keeps its plane."""

    def allocate(
        self, demand: Demand, mode: str, previous_l: np.ndarray, guess: np.ndarray | None = None
    ) -> Allocation:
        """The forces of one tick; the iteration count and slack of a solver stay 0."""
        if not (np.isfinite(demand.wrench).all() and np.isfinite(demand.thrust_map).all()):
            return self._answer(demand, previous_l.reshape(-1), AllocationStatus.HELD, 0, 0.0, 0.0)
        # The servo of a locked φ stands still: only forces in its plane can be asked for.
        across = np.stack([np.zeros(N_ROTORS), np.cos(demand.phi), np.sin(demand.phi)], axis=1)
        across[~demand.locked] = 0.0
        plane = np.eye(3) - across[:, :, None] * across[:, None, :]
        Q = np.einsum("irj,rjk->irk", demand.thrust_map.reshape(6, N_ROTORS, 3), plane).reshape(6, -1)
        f = np.linalg.pinv(Q) @ demand.wrench
        return self._answer(demand, f, AllocationStatus.CLOSED_FORM, 0, 0.0, 0.0)


class Pinv(PresetPolicy):
    """The paper's controller with the clamped pseudo-inverse in place of the QP; flights only."""

    presets = {HOVER: {"preset": "paper", "allocator": PseudoInverse, "avoid_interference": False}}  # noqa: RUF012
