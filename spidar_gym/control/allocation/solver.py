"""Two solvers of a quadratic program: OSQP in a persistent, cold-started workspace, and a certified closed form.

Both are pure functions of the program. The workspace starts cold, with the same ρ, and without OSQP's scaling, whose
state would make a tick depend on the previous one.
"""

from typing import NamedTuple

import numpy as np
import osqp
import scipy.sparse as sp
from scipy.linalg.lapack import dgesv  # pyright: ignore[reportAttributeAccessIssue] - compiled, without stubs

from spidar_gym.control.allocation.problem import INFINITY, N_FORCES, N_UNKNOWNS, Mode, QuadraticProgram

DUAL_TOLERANCE = 1e-7
"""A row whose multiplier is larger than this counts as active, in scaled units."""
OSQP_SOLVED, OSQP_INFEASIBLE, OSQP_MAX_ITER = 1, 3, 7
"""Status values of the solver; the tests compare them with `osqp.SolverStatus`."""
RHO, OTHER_RHO = 1.0, 10.0
"""Initial step sizes of the solver for the first and for the second attempt."""
SETTINGS = {
    "verbose": False, "scaling": 0, "warm_starting": False, "polishing": False, "rho": RHO, "adaptive_rho": True,
    "adaptive_rho_interval": 25, "check_termination": 25, "eps_rel": 0.0,
}  # fmt: skip
"""The solver's settings in simulation and on the robot, except tolerance and iteration cap."""
ROUNDS, MORE_ROUNDS = 3, 8
"""Largest number of systems that the closed form solves: for a guess, and after a solver."""
ROW_TOLERANCE = 1e-9
"""Largest violation of a row by the closed form, in scaled units."""


class Solution(NamedTuple):
    """Result of the solver."""

    x: np.ndarray
    """The unknowns, in scaled units."""
    solved: bool
    """Whether the solver converged to the optimum."""
    iterations: int
    """Number of iterations."""
    duals: np.ndarray
    """Multipliers of the rows; zero if the solver found none."""
    infeasible: bool
    """Whether the solver proved that there is no solution."""


class Workspace:
    """An OSQP instance for one pattern; the result of `solve` depends only on its arguments."""

    def __init__(self, P_pattern: np.ndarray, A_pattern: np.ndarray, *, max_iter: int, tolerance: float) -> None:
        """Factorise a program with the given patterns.

        Args:
            P_pattern: True where P may be nonzero.
            A_pattern: True where A may be nonzero.
            max_iter: Iteration cap.
            tolerance: Absolute tolerance.
        """
        m, n = A_pattern.shape
        P, A, self._P_at, self._A_at = sparse(P_pattern, A_pattern)
        ext = osqp.ext_builtin  # pyright: ignore[reportAttributeAccessIssue] - compiled, without stubs
        settings = ext.OSQPSettings()
        ext.osqp_set_default_settings(settings)
        for name, value in (SETTINGS | {"eps_abs": tolerance, "max_iter": max_iter}).items():
            setattr(settings, name, value)
        wide = np.full(m, INFINITY)
        self._matrices = ext.CSC(P), ext.CSC(A)
        self._solver = ext.OSQPSolver(self._matrices[0], np.zeros(n), self._matrices[1], -wide, wide, m, n, settings)

    def solve(self, program: QuadraticProgram, *, rho: float = RHO) -> Solution:
        """Solve a program from a cold start with the initial step size `rho`."""
        solver, nothing = self._solver, np.zeros(len(program.l))
        if solver.update_data_vec(q=program.q, l=program.l, u=program.u) or solver.update_data_mat(
            P_x=program.P.take(self._P_at), P_i=None, A_x=program.A.take(self._A_at), A_i=None
        ):
            return Solution(np.zeros(len(program.q)), False, 0, nothing, False)
        if rho != RHO:
            solver.update_rho(rho)
        solver.solve()
        info, solution = solver.info, solver.solution
        status = info.status_val
        if rho != RHO or info.rho_updates or status != OSQP_SOLVED:
            solver.update_rho(RHO)
        # Without a solution the duals are OSQP's NaN, which is a large finite number.
        duals = solution.y.copy() if status in (OSQP_SOLVED, OSQP_MAX_ITER) else nothing
        return Solution(solution.x.copy(), status == OSQP_SOLVED, info.iter, duals, status == OSQP_INFEASIBLE)


def patterns(mode: Mode, *, soft: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Compute where P and A of a mode's program, or of its softened program, may be nonzero."""
    # The two rotors and the foot of a leg share its joints, others do not.
    block = np.concatenate((np.arange(N_FORCES) // 6, np.arange(N_UNKNOWNS - N_FORCES) // 3))[: mode.size]
    P, A = block[:, None] == block[None], mode.pattern
    if soft:
        k, n = len(mode.soft_rows), mode.size
        P = np.block([[P, np.zeros((n, k), bool)], [np.zeros((k, n), bool), np.eye(k, dtype=bool)]])
        A = np.hstack([A, np.zeros((len(A), k), bool)])
        A[mode.soft_rows, n + np.arange(k)] = True
    return P, A


class SparseProgram(NamedTuple):
    """The initial program of a workspace, and the indices of its entries in the dense matrices."""

    P: sp.csc_matrix
    """Upper triangle of the identity."""
    A: sp.csc_matrix
    """Ones."""
    P_at: np.ndarray
    """Flat indices of the entries of P in the dense matrix (n, n)."""
    A_at: np.ndarray
    """Flat indices of the entries of A in the dense matrix (m, n)."""


def sparse(P_pattern: np.ndarray, A_pattern: np.ndarray) -> SparseProgram:
    """Build the initial program of a workspace for these patterns."""
    m, n = A_pattern.shape
    P_rows, P_columns = _by_columns(np.triu(P_pattern))
    A_rows, A_columns = _by_columns(A_pattern)
    identity = (P_rows == P_columns).astype(float)
    P = sp.csc_matrix((identity, (P_rows, P_columns)), shape=(n, n))
    A = sp.csc_matrix((np.ones(len(A_rows)), (A_rows, A_columns)), shape=(m, n))
    return SparseProgram(P, A, n * P_rows + P_columns, n * A_rows + A_columns)


def _by_columns(pattern: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the nonzeros, column after column, as the solver stores them."""
    columns, rows = np.nonzero(pattern.T)
    return rows, columns


def closed_form(
    program: QuadraticProgram, duals: np.ndarray | None = None, *, rounds: int = ROUNDS
) -> np.ndarray | None:
    """Compute the optimum from a guess of the active rows; None if no guess meets the KKT conditions.

    Solves the KKT system of the rows assumed active. A point that satisfies every row, with multipliers of the right
    sign on the active rows, satisfies all KKT conditions and is the optimum, up to rounding. Otherwise violated rows
    are added to the active rows, rows whose multiplier has the wrong sign are removed, and the system is solved again.

    Args:
        program: The program.
        duals: First guess of the rows' multipliers, of which only the signs are used; None for the equalities alone.
        rounds: Largest number of systems to solve.
    """
    P, q, A, l, u = program.P, program.q, program.A, program.l, program.u
    n = len(q)
    rows = np.flatnonzero(l == u)
    target = l.take(rows)
    signs: np.ndarray | None = None
    if duals is not None:
        active = np.flatnonzero((np.abs(duals) > DUAL_TOLERANCE) & (l != u))
        signs = np.concatenate((np.zeros(len(rows)), np.sign(duals[active])))
        target = np.concatenate((target, np.where(duals[active] > 0.0, u[active], l[active])))
        rows = np.concatenate((rows, active))
    for _ in range(rounds):
        size = n + len(rows)
        if size > 2 * n:
            return None
        active = A.take(rows, axis=0)
        K = np.zeros((size, size))
        K[:n, :n] = P
        K[n:, :n] = active
        K[:n, n:] = active.T
        right = np.empty(size)
        np.negative(q, out=right[:n])
        right[n:] = target
        # K is symmetric: its transpose is the same matrix in LAPACK's order, which saves a copy.
        _, _, solution, info = dgesv(K.T, right, overwrite_a=1, overwrite_b=1)
        if info != 0:
            return None
        x = solution[:n]
        r = A @ x
        excess = np.maximum(l - r, r - u)
        right_sign = None if signs is None else signs * solution[n:] >= 0.0
        if excess.max() <= ROW_TOLERANCE and (right_sign is None or right_sign.all()):  # False for NaN
            return x
        violated = np.flatnonzero(~(excess <= ROW_TOLERANCE))
        above = r[violated] > u[violated]
        if right_sign is None or signs is None:
            right_sign, signs = np.ones(len(rows), bool), np.zeros(len(rows))
        rows = np.concatenate((rows[right_sign], violated))
        target = np.concatenate((target[right_sign], np.where(above, u[violated], l[violated])))
        signs = np.concatenate((signs[right_sign], np.where(above, 1.0, -1.0)))
    return None
