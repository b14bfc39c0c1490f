"""Allocator: demand → forces, by the closed form if it is exact, OSQP, the thrust spheres, and named fallbacks."""

import math
import time
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from spidar_gym.arrays import FootForces, JointVector, RotorForces, RotorVector, Wrench, constant
from spidar_gym.control.allocation.cone import sphere_optimum
from spidar_gym.control.allocation.modes import PROJECTION
from spidar_gym.control.allocation.problem import (
    INFINITY,
    N_FORCES,
    Demand,
    Mode,
    QuadraticProgram,
    assemble,
    soften,
)
from spidar_gym.control.allocation.solver import MORE_ROUNDS, OTHER_RHO, RHO, Workspace, closed_form, patterns
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import N_LEGS, N_ROTORS

SIDE_TOLERANCE = 1e-5
"""A row this close to its bound may be active, in scaled units."""
LEAST_NORM = 1e-9
"""A force is divided by at least this norm [N]."""
SPHERE_TOLERANCE = 1e-9
"""Share of the largest thrust by which a force may exceed it due to rounding."""
_NO_FEET, _NO_GUESS = constant(0.0, N_LEGS, 3), constant(0.0, 0)


class AllocationStatus(StrEnum):
    """How the forces of a tick were computed, best first."""

    CLOSED_FORM = "closed_form"
    """The optimum: the closed form of a guessed set of active rows met all KKT conditions."""
    SOLVED = "solved"
    """The optimum: the solver converged and the rows were checked; refined by the closed form."""
    PROJECTED = "projected"
    """The optimum within the thrust spheres; that of the paper's cube lies outside them."""
    SOFTENED = "softened"
    """No forces within the spheres meet every row: wrench and torque rows were softened."""
    HELD = "held"
    """The softened program was not solved, or an input was not finite: the previous forces are held."""


ANSWERED = (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED, AllocationStatus.PROJECTED)
"""Statuses of forces that satisfy every row."""


MOST_ITERATIONS = 100_000
"""Largest iteration cap."""


@dataclass(frozen=True)
class AllocatorConfig:
    """Settings of the solver."""

    max_iter: int = 2000
    """Iteration cap: 2,000 in simulation, 300 on the robot's computer."""
    tolerance: float = 1e-7
    """Absolute tolerance of the solver, in scaled units."""
    check_tolerance: float = 1e-5
    """Largest allowed violation of a row in a solver's result, in scaled units (1.6 mN of lift, 0.07 mNm of torque)."""
    price: float = 1e3
    """Price of a violated row in the softened program, in scaled units."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for an iteration cap out of range."""
        cap = self.max_iter
        if not (type(cap) is int and 1 <= cap <= MOST_ITERATIONS):
            raise InvalidValueError("max_iter", cap, f"an iteration cap of at least 1 and at most {MOST_ITERATIONS}")


@dataclass(frozen=True, slots=True)
class Allocation:
    """The result of one tick: forces, and the thrusts λ = ‖f‖ [Zhao2025, Eq. 14]."""

    forces_l: RotorForces
    """Rotor forces in link axes, within the sphere ‖f‖ ≤ λ̄ [N]."""
    foot_forces_f: FootForces
    """Forces of the floor on the feet, floor axes [N]; zero in modes in which they are not unknowns."""
    thrust: RotorVector
    """λ = ‖f‖ [N]."""
    joint_torques: JointVector
    """Quasi-static joint torque of these forces, τ_q = g − T f [Nm]."""
    wrench: Wrench
    """Wrench that rotors and feet produce [N, Nm]."""
    unallocated_wrench: Wrench
    """Desired minus produced wrench [N, Nm]."""
    status: AllocationStatus
    """How the forces were computed."""
    iterations: int
    """Iterations of the solvers, all attempts together; 0 for the closed form."""
    active: np.ndarray
    """+1 where a row is at its upper bound, −1 at its lower, 0 elsewhere; empty if no guess was passed."""
    slack: float
    """Largest violation of a softened row by these forces, in units of the weight or of the joint torque limit."""
    solve_time: float
    """Wall-clock time of closed form and solver [s]; differs from run to run."""


class Optimum(NamedTuple):
    """Solution of a program."""

    x: np.ndarray | None
    """The unknowns, in units of λ̄; None if there is no solution."""
    status: AllocationStatus
    """How the solution was computed; `PROJECTED` if the thrust spheres have still to be enforced."""
    iterations: int
    """Iterations of the solvers, all attempts together."""
    slack: float = 0.0
    """Largest violation of a softened row, in scaled units."""


def _sides(program: QuadraticProgram, x: np.ndarray) -> np.ndarray:
    """Guess the active rows at x: +1 for rows at their upper bound, −1 at the lower, shape (m,)."""
    r = program.A @ x
    return (program.u - r < SIDE_TOLERANCE).astype(float) - (r - program.l < SIDE_TOLERANCE)


class Allocator:
    """Computes forces from demands for the modes of one preset; owns one workspace per mode."""

    def __init__(self, modes: dict[str, Mode], config: AllocatorConfig | None = None) -> None:
        """Set the modes by name and the solver's settings."""
        self.config = config or AllocatorConfig()
        self.modes = modes
        self._workspaces: dict[tuple[str, bool], Workspace] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return everything but the workspaces, which have no state between ticks."""
        return vars(self) | {"_workspaces": {}}

    def allocate(
        self, demand: Demand, mode: str, previous_l: RotorForces, guess: np.ndarray | None = None
    ) -> Allocation:
        """Compute the optimal forces of one tick, or a bounded fallback with its status.

        Args:
            demand: Wrench, maps and limits of the tick.
            mode: Name of the mode.
            previous_l: Forces of the last tick, held if everything else fails [N].
            guess: `Allocation.active` of a similar demand. If the same rows are active again, the closed form finds the
                optimum without a solver. The optimum does not depend on the guess, up to rounding.

        Returns:
            The allocation. Never raises on numbers: if an input is not finite, the previous forces are held.
        """
        start = time.perf_counter()
        with np.errstate(all="ignore"):  # numbers that are not finite lead to `HELD`, without warnings
            rows = self.mode(mode)
            try:
                program = assemble(rows, demand)
            except ValueError:  # the sine of infinity
                return self._hold(demand, previous_l, 0, start)
            optimum = self._cube_optimum(rows, program, guess)
            if optimum.status is AllocationStatus.PROJECTED:
                optimum = self._within_spheres(rows, program, optimum)
            if optimum.x is None:
                return self._hold(demand, previous_l, optimum.iterations, start)
            allocation = self._answer(demand, demand.robot.max_thrust * optimum.x, *optimum[1:], start)
            return allocation if guess is None else replace(allocation, active=_sides(program, optimum.x))

    def mode(self, name: str) -> Mode:
        """Return a mode by name (`UnknownNameError` lists the valid ones)."""
        if name not in self.modes:
            raise UnknownNameError("mode", name, self.modes)
        return self.modes[name]

    @staticmethod
    def _answer(
        demand: Demand, f: np.ndarray, status: AllocationStatus, iterations: int, slack: float, start: float
    ) -> Allocation:
        """Build the allocation of these forces [N], scaled to the thrust spheres if rounding violates them.

        Custom allocators call it too (baselines/pinv.py), so its arguments must not change.
        """
        solve_time = time.perf_counter() - start
        forces, feet = f[:N_FORCES].reshape(N_ROTORS, 3), f[N_FORCES:]
        if demand.lost.any():
            forces = np.where(demand.lost[:, None], 0.0, forces)  # the rows hold only up to rounding
        norms = [math.sqrt(x * x + y * y + z * z) for x, y, z in forces.tolist()]
        thrust = np.array(norms)
        most = demand.max_thrust
        if max(norms) > most:
            forces = forces * np.minimum(1.0, most / np.maximum(thrust, LEAST_NORM))[:, None]
            thrust = np.minimum(thrust, most)
        f = np.concatenate((forces.reshape(-1), feet)) if len(feet) else forces.reshape(-1)
        wrench = demand.thrust_map @ f
        return Allocation(
            forces_l=forces,
            foot_forces_f=feet.reshape(N_LEGS, 3) if len(feet) else _NO_FEET,
            thrust=thrust,
            joint_torques=demand.gravity_torque - demand.torque_map @ f,
            wrench=wrench,
            unallocated_wrench=demand.wrench - wrench,
            active=_NO_GUESS,
            status=status,
            iterations=iterations,
            slack=slack,
            solve_time=solve_time,
        )

    def _cube_optimum(self, mode: Mode, program: QuadraticProgram, guess: np.ndarray | None = None) -> Optimum:
        """Solve the program; the status is `PROJECTED` if no optimum is found or it violates the thrust spheres."""
        x = None
        if guess is not None and len(guess) == len(program.l):
            x = closed_form(program, guess)
        if x is None:
            x = closed_form(program)
        status, iterations = AllocationStatus.CLOSED_FORM, 0
        if x is None and not _finite(program):
            return Optimum(None, AllocationStatus.HELD, 0)
        for rho in (RHO, OTHER_RHO):
            if x is not None:
                break
            y, solved, more, duals, infeasible = self.solver(mode).solve(program, rho=rho)
            iterations += more
            solved = solved and program.violation(y) <= self.config.check_tolerance
            x = closed_form(program, duals, rounds=MORE_ROUNDS)
            if x is None and not solved:
                x = closed_form(program, _sides(program, y), rounds=MORE_ROUNDS)
            if solved:
                x, status = y if x is None else x, AllocationStatus.SOLVED
            if infeasible:
                break
        within = x is not None and _largest_thrust(x) <= program.radius + SPHERE_TOLERANCE
        return Optimum(x, status if within else AllocationStatus.PROJECTED, iterations)

    def _within_spheres(self, mode: Mode, program: QuadraticProgram, cube: Optimum) -> Optimum:
        """Compute the optimum within the spheres, with softened rows if necessary, when that of the `cube` fails."""
        x, steps = sphere_optimum(program)
        iterations = cube.iterations + steps
        if x is not None:
            missed = (
                cube.x is None and _largest_thrust(x) < program.radius - SIDE_TOLERANCE
            )  # then it is also the cube's optimum
            return Optimum(x, AllocationStatus.SOLVED if missed else AllocationStatus.PROJECTED, iterations)
        if cube.x is None:
            soft = soften(program, mode.soft_rows, price=self.config.price)
            y, solved, more, duals, _ = self.solver(mode, soft=True).solve(soft)
            iterations += more
            exact = closed_form(soft, duals, rounds=MORE_ROUNDS)
            if exact is not None:
                y = exact
            found = exact is not None or (solved and soft.violation(y) <= self.config.check_tolerance)
            if found and _largest_thrust(y) <= program.radius + SPHERE_TOLERANCE:
                slack = float(np.abs(y[mode.size :]).max())
                return Optimum(y[: mode.size], AllocationStatus.SOFTENED, iterations, slack)
        x, steps = sphere_optimum(program, mode.soft_rows, self.config.price)
        slack = 0.0 if x is None else program.violation(x)
        return Optimum(x, AllocationStatus.SOFTENED, iterations + steps, slack)

    def _hold(self, demand: Demand, previous_l: RotorForces, iterations: int, start: float) -> Allocation:
        """Hold the previous forces, clipped to the spheres; foot forces are set to zero."""
        feet = demand.thrust_map.shape[1] - N_FORCES
        held = np.concatenate((_bounded(previous_l, demand.max_thrust).reshape(-1), np.zeros(feet)))
        unmet = np.abs(demand.wrench - demand.thrust_map @ held).max() / demand.robot.weight
        slack = float(unmet) if np.isfinite(unmet) else INFINITY
        return self._answer(demand, held, AllocationStatus.HELD, iterations, slack, start)

    def solver(self, mode: Mode, *, soft: bool = False) -> Workspace:
        """Return the OSQP workspace of a mode's program, or of its softened program."""
        key = (mode.name, soft)
        if key not in self._workspaces:
            self._workspaces[key] = Workspace(
                *patterns(mode, soft=soft), max_iter=self.config.max_iter, tolerance=self.config.tolerance
            )
        return self._workspaces[key]

    def project(self, demand: Demand, forces_l: RotorForces, previous_l: RotorForces) -> Allocation:
        """Find the valid forces nearest to `forces_l`: [Zhao2025, Eq. 12, 13, 30-32] and the thrust spheres hold.

        The desired wrench (Eq. 10) is not enforced.

        Args:
            demand: The tick's demand; `unallocated_wrench` of the result refers to its wrench.
            forces_l: Desired forces in link axes [N].
            previous_l: Forces to hold if no forces are valid or a number is not finite [N].
        """
        start = time.perf_counter()
        with np.errstate(all="ignore"):
            try:
                program = replace(assemble(PROJECTION, demand), q=-forces_l.reshape(-1) / demand.robot.max_thrust)
            except ValueError:
                return self._hold(demand, previous_l, 0, start)
            optimum = self._cube_optimum(PROJECTION, program)
            if optimum.status is AllocationStatus.PROJECTED:  # here the spheres are part of the problem
                x, steps = sphere_optimum(program)
                optimum = Optimum(x, AllocationStatus.SOLVED, optimum.iterations + steps)
            if optimum.x is None:
                return replace(self._hold(demand, previous_l, optimum.iterations, start), slack=0.0)
            return self._answer(demand, demand.robot.max_thrust * optimum.x, *optimum[1:], start)


def _largest_thrust(x: np.ndarray) -> float:
    """Compute the largest ‖f_i‖, in units of λ̄."""
    f = x.tolist()  # a third of numpy's time for so few numbers
    return math.sqrt(max([f[i] * f[i] + f[i + 1] * f[i + 1] + f[i + 2] * f[i + 2] for i in range(0, N_FORCES, 3)]))


def _bounded(forces_l: RotorForces, most: float) -> RotorForces:
    """Replace numbers that are not finite by zeros and clip the forces to the sphere."""
    finite = np.where(np.isfinite(forces_l), forces_l, 0.0)
    norm = np.linalg.norm(finite, axis=1)
    return finite * np.minimum(1.0, most / np.maximum(norm, LEAST_NORM))[:, None]


def _finite(program: QuadraticProgram) -> bool:
    """Whether every number is finite; an idle row's bounds are large, not infinite."""
    return bool(np.isfinite(program.P.sum() + program.q.sum() + program.A.sum() + program.l.sum() + program.u.sum()))
