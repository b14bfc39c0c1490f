"""The allocation as a quadratic program with a fixed pattern: blocks define costs and rows, `assemble` stacks them.

The unknowns are the rotor forces in link axes, divided by λ̄: x = f / λ̄, 24 numbers. If the feet carry the robot, 12
more follow: the forces of the floor on the four feet, floor axes, in the same unit. Rows and costs are scaled by
physical units of the robot (wrench / mΣ g, torque / τ̄_q), because the accuracy of a first-order solver depends mostly
on scaling, and because the solver's own scaling would make a tick depend on the previous one.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from spidar_gym.arrays import JointVector, LegMask, Matrix3, RotorMask, RotorVector, Vector3, Wrench, constant
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, ROBOT, RobotSpec

N_FORCES = 3 * N_ROTORS
"""Number of unknowns of a mode without foot forces."""
N_UNKNOWNS = N_FORCES + 3 * N_LEGS
"""Number of unknowns of a mode with foot forces."""
FORCE_SCALE = ROBOT.max_thrust
"""Unit of the unknowns for the nominal robot [N]; in general `demand.robot.max_thrust`."""
WRENCH_SCALE = ROBOT.weight
"""Unit of wrench rows for the nominal robot [N and Nm]; in general `demand.robot.weight`."""
TORQUE_SCALE = ROBOT.max_joint_torque
"""Unit of joint torque rows for the nominal robot [Nm]; in general `demand.robot.max_joint_torque`."""
INFINITY = 1e30
"""Value of an infinite bound, in the solver's convention."""


_NONE_LOST, _ALL_LIFTED = constant(False, N_ROTORS), constant(True, N_LEGS)
_LEVEL, _ORIGIN, _ALIKE = np.eye(3), constant(0.0, 3), constant(1.0, N_ROTORS)
_LEVEL.flags.writeable = False


@dataclass(frozen=True, slots=True)
class Demand:
    """Inputs of the allocation in one tick: everything that the blocks may read."""

    wrench: Wrench
    """Desired wrench w^d in {CoG} [N, Nm]; on the ground the wrench that holds the weight."""
    thrust_map: Float[np.ndarray, "6 n"]
    """Q: forces → wrench in {CoG}; 24 columns for the rotors in link axes, and 12 for the feet if they carry."""
    torque_map: Float[np.ndarray, "16 n"]
    """T: forces → joint torque that the forces provide; τ_q = g − T f."""
    gravity_torque: JointVector
    """g: joint torque that holds the links without thrust [Nm]."""
    locked: RotorMask
    """Rotors whose φ is held."""
    phi: RotorVector
    """Held φ of the locked rotors [rad]."""
    restricted: RotorMask
    """Rotors restricted by interference, 𝓘."""
    lower: RotorVector
    """Lower bounds of θ [rad], read where restricted."""
    upper: RotorVector
    """Upper bounds of θ [rad], read where restricted."""
    lost: RotorMask = field(default_factory=lambda: _NONE_LOST)
    """Rotors without force."""
    lifted: LegMask = field(default_factory=lambda: _ALL_LIFTED)
    """Legs whose joint torque is allocated; that of other legs depends on floor forces that are not modelled."""
    com_b: Vector3 = field(default_factory=lambda: _ORIGIN)
    """Position of the CoG from the torso's origin [m], which transforms a wrench from {CoG} to {B}."""
    R_bf: Matrix3 = field(default_factory=lambda: _LEVEL)
    """Rotation from floor axes to torso axes."""
    effort: RotorVector = field(default_factory=lambda: _ALIKE)
    """Weight of each rotor's ‖f‖² in the power cost."""
    thrust_limit: float = math.inf
    """λ̄ at the present voltage of the battery where it is below the robot's [N]."""
    robot: RobotSpec = ROBOT
    """The robot; its limits are the units of unknowns and rows, and default bounds of the blocks."""

    @property
    def max_thrust(self) -> float:
        """λ̄ of this tick [N]: the robot's, or less where the battery's voltage limits it."""
        return min(self.robot.max_thrust, self.thrust_limit)


_ROTORS, _JOINTS = np.zeros(N_ROTORS), np.zeros(N_JOINTS)
NO_DEMAND = Demand(
    wrench=np.zeros(6), thrust_map=np.zeros((6, N_FORCES)), torque_map=np.zeros((N_JOINTS, N_FORCES)),
    gravity_torque=_JOINTS, locked=_ROTORS > 0, phi=_ROTORS, restricted=_ROTORS > 0, lower=_ROTORS, upper=_ROTORS,
    lost=_ROTORS > 0,
)  # fmt: skip
"""A demand of zeros for constant blocks, which read only its robot."""


@runtime_checkable
class Cost(Protocol):
    """A term ½‖W x − r‖² of the objective."""

    constant: ClassVar[bool] = False
    """Whether the term is the same at every tick of a robot; then it is added once."""

    def add(self, demand: Demand, P: np.ndarray, q: np.ndarray) -> None:
        """Add WᵀW to P, shape (n, n), and −Wᵀr to q, shape (n,)."""


@runtime_checkable
class Constraint(Protocol):
    """Rows l ≤ A x ≤ u. Their number and pattern never change; an idle row has infinite bounds."""

    pattern: ClassVar[np.ndarray]
    """Where A may be nonzero, shape (m, 36) of bool; modes without foot forces use its first 24 columns."""
    soft: ClassVar[bool] = False
    """Whether the fallback may violate these rows at a price."""
    constant: ClassVar[bool] = False
    """Whether the rows are the same at every tick of a robot; then they are written once."""

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """Write the rows into A, shape (m, n), l and u, shape (m,), which are idle before: zero and unbounded."""


@dataclass(frozen=True, slots=True)
class QuadraticProgram:
    """min ½ xᵀ P x + qᵀ x subject to l ≤ A x ≤ u."""

    P: Float[np.ndarray, "n n"]
    """Hessian, symmetric."""
    q: Float[np.ndarray, " n"]
    """Gradient at x = 0."""
    A: Float[np.ndarray, "m n"]
    """Rows."""
    l: Float[np.ndarray, " m"]
    """Lower bounds."""
    u: Float[np.ndarray, " m"]
    """Upper bounds."""
    radius: float = 1.0
    """Radius r of the thrust spheres ‖f_i‖ ≤ r, in units of λ̄."""

    def objective(self, x: Float[np.ndarray, " n"]) -> float:
        """Compute the value at x."""
        return float(x @ (0.5 * (self.P @ x) + self.q))

    def violation(self, x: Float[np.ndarray, " n"]) -> float:
        """Compute the largest violation of a row at x; 0 if all rows hold."""
        r = self.A @ x
        return float(max(np.max(self.l - r), np.max(r - self.u), 0.0))


@dataclass(frozen=True)
class Mode:
    """A locomotion mode: a tuple of costs and a tuple of constraints."""

    name: str
    """Name of the mode in a `Reference`."""
    costs: tuple[Cost, ...]
    """Terms of the objective."""
    constraints: tuple[Constraint, ...]
    """Blocks of rows."""
    avoid_interference: bool = True
    """Whether rotors are restricted by interference."""
    feet_carry: bool = False
    """Whether the forces on the feet are unknowns too."""

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return N_UNKNOWNS if self.feet_carry else N_FORCES

    @cached_property
    def pattern(self) -> Bool[np.ndarray, "m n"]:
        """Where A may be nonzero."""
        return np.vstack([block.pattern[:, : self.size] for block in self.constraints])

    @cached_property
    def _idle(self) -> dict[RobotSpec, tuple[np.ndarray, ...]]:
        """Results of `idle` by robot."""
        return {}

    def idle(self, robot: RobotSpec = ROBOT) -> tuple[np.ndarray, ...]:
        """Return P, q, A, l, u with the constant blocks of a robot; other rows are zero and unbounded."""
        if robot not in self._idle:
            self._idle[robot] = self._write_idle(replace(NO_DEMAND, robot=robot))
        return self._idle[robot]

    def _write_idle(self, nothing: Demand) -> tuple[np.ndarray, ...]:
        m, n = len(self.pattern), self.size
        P, q, A = np.zeros((n, n)), np.zeros(n), np.zeros((m, n))
        l, u = np.full(m, -INFINITY), np.full(m, INFINITY)
        for cost in self.costs:
            if cost.constant:
                cost.add(nothing, P, q)
        for block, rows in zip(self.constraints, self.slices, strict=True):
            if block.constant:
                block.write(nothing, A[rows], l[rows], u[rows])
        return P, q, A, l, u

    @cached_property
    def varying(self) -> tuple[tuple[Cost, ...], tuple[tuple[Constraint, slice], ...]]:
        """Costs and constraints (with their rows) that change from tick to tick."""
        blocks = zip(self.constraints, self.slices, strict=True)
        return (
            tuple(cost for cost in self.costs if not cost.constant),
            tuple((block, rows) for block, rows in blocks if not block.constant),
        )

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The rows of each constraint block."""
        ends = np.cumsum([0, *(len(block.pattern) for block in self.constraints)]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @cached_property
    def soft_rows(self) -> np.ndarray:
        """Indices of the rows that the fallback may violate."""
        soft = np.concatenate([np.full(len(block.pattern), block.soft) for block in self.constraints])
        return np.flatnonzero(soft)


def assemble(mode: Mode, demand: Demand) -> QuadraticProgram:
    """Assemble the program of one tick from the mode's blocks: [Zhao2025, Eq. 9] and its constraints."""
    P, q, A, l, u = (array.copy() for array in mode.idle(demand.robot))
    costs, constraints = mode.varying
    for cost in costs:
        cost.add(demand, P, q)
    for block, rows in constraints:
        block.write(demand, A[rows], l[rows], u[rows])
    return QuadraticProgram(P, q, A, l, u, min(1.0, demand.thrust_limit / demand.robot.max_thrust))


def soften(program: QuadraticProgram, rows: np.ndarray, *, price: float) -> QuadraticProgram:
    """Build a program whose `rows` may be violated by slacks s at the cost ½ `price` ‖s‖²; unknowns (x, s)."""
    n, k, m = len(program.q), len(rows), len(program.l)
    P = np.zeros((n + k, n + k))
    P[:n, :n] = program.P
    P[range(n, n + k), range(n, n + k)] = price
    A = np.zeros((m, n + k))
    A[:, :n] = program.A
    A[rows, range(n, n + k)] = 1.0
    return QuadraticProgram(P, np.concatenate([program.q, np.zeros(k)]), A, program.l, program.u, program.radius)
