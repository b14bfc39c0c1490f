"""Blocks for the ground: limits of the forces on pegs and feet, and a power cost. Unknowns as in `problem.py`."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from spidar_gym.arrays import Wrench
from spidar_gym.control.allocation.problem import (
    INFINITY,
    N_FORCES,
    N_UNKNOWNS,
    Constraint,
    Cost,
    Demand,
)
from spidar_gym.robot import N_LEGS, ROBOT, RobotSpec
from spidar_gym.so3 import skew

LEAST_THRUST = 1.0
"""The weights of the power cost stop growing below this thrust [N]."""


@dataclass(frozen=True)
class PowerEffort(Cost):
    """w₁ Σ e_i ‖f_i‖²: with e_i = ‖f_i‖^−½ of the last tick it becomes Σ ‖f_i‖^1.5, which is electrical power.

    Not in the paper. The weights are iterated from tick to tick (iteratively reweighted least squares) by
    `effort_weights`.
    """

    weight: float = 1.0
    """w₁ [1/N²]."""

    def add(self, demand: Demand, P: np.ndarray, q: np.ndarray) -> None:
        """W = √(w₁ e) and r = 0."""
        n = len(q)
        P.reshape(-1)[: N_FORCES * (n + 1) : n + 1] += self.weight * np.repeat(demand.effort, 3)


@dataclass(frozen=True)
class FootEffort(Cost):
    """w_c Σ ‖f_c‖²: a very small cost that makes the foot forces unique. Not in the paper."""

    weight: float = 1e-3
    """w_c [1/N²]."""
    constant: ClassVar[bool] = True

    def add(self, demand: Demand, P: np.ndarray, q: np.ndarray) -> None:
        """W = √w_c 1 and r = 0 for the foot forces."""
        n = len(q)
        P.reshape(-1)[N_FORCES * (n + 1) :: n + 1] += self.weight


def contact_wrench_bounds(friction: float, min_normal: float, robot: RobotSpec = ROBOT) -> tuple[Wrench, Wrench]:
    """Compute w̲ and w̄ in {B}: a box of wrenches that the four pegs can transmit [Zhao2025, Eq. 36].

    The pegs are at (± a, ± a, −d). Their normal forces add up to N ≥ N_min.

    - Friction transmits a force and a twist together. A peg with the normal force n transmits at most μ n. Half of it
      is reserved for the force along the floor: ‖f_xy‖ ≤ ½ μ N, as a box f̄_xy = μ N_min / (2 √2). A quarter is
      reserved for the twist; the lever of every peg is a √2, so τ̄_z = ¼ μ N_min a √2. If the centre of pressure is off
      the middle, the friction forces of a twist do not add up to zero; the remaining quarter covers this (μ ≥ 0.1).
    - The centre of pressure may be anywhere in the square: about its centre on the floor |τ_x|, |τ_y| ≤ a N. Only half
      is used, so that no peg is close to lifting off. About the torso's origin, d higher, the friction force adds
      up to d f̄_xy: τ̄_xy = ½ a N_min − d f̄_xy.
    - f_z ≥ N_min, where the paper has 0: a peg without normal force has no friction. Upwards there is no bound.

    Args:
        friction: Planned friction μ of the pegs.
        min_normal: N_min [N].
        robot: The robot.
    """
    a, d = robot.yaw_axis_xy, robot.peg_depth
    f_xy = friction * min_normal / (2.0 * math.sqrt(2.0))
    tau_xy = 0.5 * a * min_normal - d * f_xy
    tau_z = 0.25 * friction * min_normal * a * math.sqrt(2.0)
    low = np.array([-f_xy, -f_xy, min_normal, -tau_xy, -tau_xy, -tau_z])
    return low, np.array([f_xy, f_xy, math.inf, tau_xy, tau_xy, tau_z])


def most_peg_friction(robot: RobotSpec) -> float:
    """Compute the planned friction of the pegs at which τ̄_xy is 0, because the force along the floor tips the torso."""
    return math.sqrt(2.0) * robot.yaw_axis_xy / robot.peg_depth


@dataclass(frozen=True)
class ContactWrenchRange(Constraint):
    """w̲ ≤ w_c ≤ w̄ for the wrench w_c that the pegs have to transmit: [Zhao2025, Eq. 34, 35, 37].

    The torso is at rest, w = 0 in [Zhao2025, Eq. 34], so the pegs transmit the part of the weight that the rotors do
    not carry, w_c = − Σ Ĵ_rᵀ f − Σ Ĵ_sᵀ m_s g. Bounds by `contact_wrench_bounds`.
    """

    friction: float = 0.5 * ROBOT.peg_friction
    """Planned friction of the pegs."""
    min_normal: float = 10.0
    """Smallest normal force of all pegs together [N]."""
    soft: ClassVar[bool] = True
    pattern: ClassVar[np.ndarray] = np.array([[c < N_FORCES for c in range(N_UNKNOWNS)]] * 6)

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """Six rows in {B}: X w − w̄ ≤ X Q f ≤ X w − w̲, where X transforms a wrench from {CoG} to {B}."""
        robot = demand.robot
        low, high = contact_wrench_bounds(self.friction, self.min_normal, robot)
        lever = skew(demand.com_b)
        Q, w = demand.thrust_map, demand.wrench
        A[:3], A[3:] = Q[:3], Q[3:] + lever @ Q[:3]
        A *= robot.max_thrust / robot.weight
        weight = np.concatenate((w[:3], w[3:] + lever @ w[:3]))
        np.divide(weight - low, robot.weight, out=u)
        l[:] = np.where(np.isinf(high), -INFINITY, (weight - np.where(np.isinf(high), 0.0, high)) / robot.weight)


@dataclass(frozen=True)
class FrictionPyramid(Constraint):
    """|f_x|, |f_y| ≤ μ f_z and f_z ≥ f_min for each foot, floor axes: feet press and do not slide.

    Not in the paper, whose earlier walk leaves the foot forces free. Without these rows the optimum pulls the feet
    inwards with more force than friction can hold.
    """

    friction: float = 0.6 * ROBOT.foot_friction
    """Planned friction μ."""
    min_normal: float = 0.5
    """f_min [N]."""
    constant: ClassVar[bool] = True
    soft: ClassVar[bool] = True
    pattern: ClassVar[np.ndarray] = np.array(
        # Rows of foot k: 5k … 5k + 4.
        [
            [c - N_FORCES == 3 * (r // 5) + 2 or (r % 5 < 4 and c - N_FORCES == 3 * (r // 5) + r % 5 // 2)
             for c in range(N_UNKNOWNS)]
            for r in range(5 * N_LEGS)
        ]
    )  # fmt: skip

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """Five rows per foot: μ f_z ± f_x ≥ 0, μ f_z ± f_y ≥ 0, f_z ≥ f_min."""
        for leg in range(N_LEGS):
            x = N_FORCES + 3 * leg
            for row, (axis, sign) in enumerate(((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0))):
                A[5 * leg + row, x + axis] = sign
                A[5 * leg + row, x + 2] = self.friction
                l[5 * leg + row] = 0.0
            A[5 * leg + 4, x + 2] = 1.0
            l[5 * leg + 4] = self.min_normal / demand.robot.max_thrust


def effort_weights(
    thrust: np.ndarray, previous: np.ndarray, share: float, hover_thrust: float = ROBOT.hover_thrust
) -> np.ndarray:
    """Filter the weights e_i of `PowerEffort`: e ← e + share (√(λ₀ / max(λ, 1 N)) − e), λ₀ = mg/8.

    Args:
        thrust: λ last allocated (8,) [N].
        previous: Weights of the last tick (8,).
        share: Share of the change per tick; 0 keeps the weights, and all ones is the paper's cost.
        hover_thrust: λ₀ [N].
    """
    return previous + share * (np.sqrt(hover_thrust / np.maximum(thrust, LEAST_THRUST)) - previous)
