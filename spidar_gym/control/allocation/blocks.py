"""The cost and constraint terms of the paper, one class per equation; unknowns and scaling as in `problem.py`."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from spidar_gym.control.allocation.problem import (
    INFINITY,
    N_FORCES,
    N_UNKNOWNS,
    Constraint,
    Cost,
    Demand,
)
from spidar_gym.model.dynamics import Snapshot
from spidar_gym.robot import N_JOINTS, N_ROTORS


def torque_map(snapshot: Snapshot) -> np.ndarray:
    """Compute T, shape (16, 24): Σ J_rᵀ f of forces in link axes, the thrust's share of [Zhao2025, Eq. 5]."""
    T = snapshot.R_bl.transpose(0, 2, 1) @ snapshot.J_rotor
    return T.transpose(2, 0, 1).reshape(N_JOINTS, N_FORCES)


@dataclass(frozen=True)
class ThrustEffort(Cost):
    """w₁ Σ ‖f_i‖², the first term of [Zhao2025, Eq. 9]; the objective as a whole is divided by 2 λ̄²."""

    weight: float = 1.0
    """w₁ [1/N²]."""
    constant: ClassVar[bool] = True

    def add(self, demand: Demand, P: np.ndarray, q: np.ndarray) -> None:
        """W = √w₁ 1 and r = 0."""
        n = len(q)
        P.reshape(-1)[: N_FORCES * (n + 1) : n + 1] += self.weight


@dataclass(frozen=True)
class JointTorqueEffort(Cost):
    """w₂ ‖τ_q‖² with τ_q = g − T f, the second term of [Zhao2025, Eq. 9]."""

    weight: float = 1.0
    """w₂ [1/(Nm)²]."""

    def add(self, demand: Demand, P: np.ndarray, q: np.ndarray) -> None:
        """W = √w₂ T and r = √w₂ g / λ̄."""
        T = demand.torque_map
        if not demand.lifted.all():
            T = T * np.repeat(demand.lifted, 4)[:, None]
        P += self.weight * (T.T @ T)
        q -= (self.weight / demand.robot.max_thrust) * (demand.gravity_torque @ T)


@dataclass(frozen=True)
class WrenchBalance(Constraint):
    """Q f = w^d [Zhao2025, Eq. 10]."""

    soft: ClassVar[bool] = True
    pattern: ClassVar[np.ndarray] = np.ones((6, N_UNKNOWNS), bool)

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """Six equalities, in units of the weight."""
        robot = demand.robot
        np.multiply(demand.thrust_map, robot.max_thrust / robot.weight, out=A)
        np.divide(demand.wrench, robot.weight, out=l)
        u[:] = l


@dataclass(frozen=True)
class ThrustBox(Constraint):
    """−λ̄ ≤ f_{i,j} ≤ λ̄ [Zhao2025, Eq. 12]: the paper's cube, wider than the sphere ‖f‖ ≤ λ̄ at its corners.

    Differs from [Zhao2025, Eq. 12]: the cube has its edges along the link's axes, as flown on the robot, because its
    rows are constant in these axes.
    """

    limit: float = math.inf
    """λ̄ [N]; the robot's by default."""
    pattern: ClassVar[np.ndarray] = np.eye(N_FORCES, N_UNKNOWNS, dtype=bool)

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """24 bounds, one for each unknown; zero for the rotors that are lost."""
        A.reshape(-1)[:: A.shape[1] + 1] = 1.0
        unit = demand.robot.max_thrust
        limit = min(self.limit if math.isfinite(self.limit) else unit, demand.thrust_limit)
        u[:] = limit / unit
        l[:] = -limit / unit
        if demand.lost.any():
            gone = np.repeat(demand.lost, 3)
            l[gone] = u[gone] = 0.0


@dataclass(frozen=True)
class JointTorqueLimit(Constraint):
    """−τ̄_q ≤ τ_q ≤ τ̄_q with the quasi-static τ_q = g − T f [Zhao2025, Eq. 11, 13]."""

    limit: float = math.inf
    """τ̄_q [Nm]; the robot's by default."""
    soft: ClassVar[bool] = True
    pattern: ClassVar[np.ndarray] = np.array(
        # A rotor loads the joints between the torso and its link: two for an inner link, all four for an outer one. A
        # foot loads the four joints of its leg.
        [
            [c // 6 == j // 4 and (c // 3 % 2 == 1 or j % 4 < 2) for c in range(N_FORCES)]
            + [c // 3 == j // 4 for c in range(N_UNKNOWNS - N_FORCES)]
            for j in range(N_JOINTS)
        ]
    )

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """The rows g − τ̄ ≤ T f ≤ g + τ̄, in units of the servo's limit."""
        unit = demand.robot.max_joint_torque
        np.multiply(demand.torque_map, demand.robot.max_thrust / unit, out=A)
        bound = (self.limit if math.isfinite(self.limit) else unit) / unit
        np.divide(demand.gravity_torque, unit, out=l)
        np.add(l, bound, out=u)
        l -= bound
        if not demand.lifted.all():
            standing = ~np.repeat(demand.lifted, 4)
            A[standing], l[standing], u[standing] = 0.0, -INFINITY, INFINITY


@dataclass(frozen=True)
class VectoringLock(Constraint):
    """The force stays in the plane that θ sweeps while φ is held: {φ}f_y = 0 [Zhao2025, Eq. 32].

    The same row serves the rotors restricted by interference and those locked near a vertical link.
    """

    pattern: ClassVar[np.ndarray] = np.array(
        [[c // 3 == i and c % 3 > 0 for c in range(N_UNKNOWNS)] for i in range(N_ROTORS)]
    )

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """The rows cos φ f_y + sin φ f_z = 0 for each locked rotor."""
        locked = demand.locked.tolist()
        if not any(locked):
            return
        for i, phi in enumerate(demand.phi.tolist()):
            if locked[i]:
                A[i, 3 * i + 1 : 3 * i + 3] = math.cos(phi), math.sin(phi)
                l[i] = u[i] = 0.0


@dataclass(frozen=True)
class InterferenceBound(Constraint):
    """μ̲ ≤ θ ≤ μ̄ as two linear rows per rotor, {inf}f_x ≥ 0 and {sup}f_x ≤ 0 [Zhao2025, Eq. 28-31].

    {inf} and {sup} have their z axes along the bounds, so {μ}f_x = ‖f‖ sin(θ − μ). Differs from [Zhao2025, Eq. 30, 31]:
    the paper prints the opposite signs, with which the forbidden side would be the admissible one.
    """

    pattern: ClassVar[np.ndarray] = np.array(
        [[c // 3 == i % N_ROTORS and c < N_FORCES for c in range(N_UNKNOWNS)] for i in range(2 * N_ROTORS)]
    )

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """Eight {inf} rows, then eight {sup} rows, for the restricted rotors."""
        restricted = demand.restricted.tolist()
        if not any(restricted):
            return
        phi, lower, upper = demand.phi.tolist(), demand.lower.tolist(), demand.upper.tolist()
        for i in range(N_ROTORS):
            if restricted[i]:
                # {μ}f_x = cos μ f_x − sin μ {φ}f_z, with {φ}f_z = −sin φ f_y + cos φ f_z
                s, c = math.sin(phi[i]), math.cos(phi[i])
                inf, sup = math.sin(lower[i]), math.sin(upper[i])
                A[i, 3 * i : 3 * i + 3] = math.cos(lower[i]), inf * s, -inf * c
                A[N_ROTORS + i, 3 * i : 3 * i + 3] = math.cos(upper[i]), sup * s, -sup * c
                l[i] = 0.0
                u[N_ROTORS + i] = 0.0
