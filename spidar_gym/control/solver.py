"""Two ways to solve a quadratic program: OSQP in a persistent, cold-started workspace, and a certified closed form.

Both are pure functions of the program: the workspace starts cold, with the same ρ, and without the solver's own
scaling, whose state would otherwise leak from one tick into the next.
"""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import numpy as np
import osqp
import scipy.sparse as sp
from scipy.linalg.lapack import dgesv

from spidar_gym.control.qp import INFINITY, QuadraticProgram

DUAL_TOLERANCE = 1e-7
"""A row whose multiplier is larger than this counts as active, in scaled units."""
OSQP_SOLVED, OSQP_INFEASIBLE, OSQP_MAX_ITER = 1, 3, 7
"""The solver's own words; the tests hold them against `osqp.SolverStatus`."""
RHO, OTHER_RHO = 1.0, 10.0
"""First step size of the solver, and the one it is given for a second attempt."""


class Workspace:
    """An OSQP instance for one pattern; `solve` depends on its arguments only."""

    def __init__(self, P_pattern: np.ndarray, A_pattern: np.ndarray, *, max_iter: int, tolerance: float) -> None:
        """Factorise a program with the given patterns.

        Args:
            P_pattern: True where P may be nonzero.
            A_pattern: True where A may be nonzero.
            max_iter: Iteration cap.
            tolerance: Absolute tolerance.
        """
        m, n = A_pattern.shape
        P_rows, P_columns = _by_columns(np.triu(P_pattern))
        A_rows, A_columns = _by_columns(A_pattern)
        self._P_at, self._A_at = n * P_rows + P_columns, n * A_rows + A_columns
        identity = (P_rows == P_columns).astype(float)
        P = sp.csc_matrix((identity, (P_rows, P_columns)), shape=(n, n))
        A = sp.csc_matrix((np.ones(len(A_rows)), (A_rows, A_columns)), shape=(m, n))
        ext = osqp.ext_builtin
        settings = ext.OSQPSettings()
        ext.osqp_set_default_settings(settings)
        settings.verbose = 0
        settings.scaling = 0
        settings.warm_starting = 0
        settings.polishing = 0
        settings.rho = RHO
        settings.adaptive_rho = 1
        settings.adaptive_rho_interval = 25
        settings.check_termination = 25
        settings.eps_abs = tolerance
        settings.eps_rel = 0.0
        settings.max_iter = max_iter
        wide = np.full(m, INFINITY)
        self._matrices = ext.CSC(P), ext.CSC(A)
        self._solver = ext.OSQPSolver(self._matrices[0], np.zeros(n), self._matrices[1], -wide, wide, m, n, settings)

    def solve(self, program: QuadraticProgram, *, rho: float = RHO) -> tuple[np.ndarray, bool, int, np.ndarray, bool]:
        """One cold-started solution with the first step size `rho`.

        Returns:
            x, whether the solver says solved, its iterations, the multipliers of the rows (zero where it found none),
            and whether it proved that there is no solution.
        """
        solver, nothing = self._solver, np.zeros(len(program.l))
        # Vectors first: with the solver's scaling off the order no longer matters, but it once did.
        if solver.update_data_vec(q=program.q, l=program.l, u=program.u) or solver.update_data_mat(
            P_x=program.P.take(self._P_at), P_i=None, A_x=program.A.take(self._A_at), A_i=None
        ):
            return np.zeros(len(program.q)), False, 0, nothing, False
        if rho != RHO:
            solver.update_rho(rho)
        solver.solve()
        info, solution = solver.info, solver.solution
        status = info.status_val
        if rho != RHO or info.rho_updates or status != OSQP_SOLVED:
            solver.update_rho(RHO)
        # Where it found none, the solver's NaN is a large finite number.
        duals = solution.y.copy() if status in (OSQP_SOLVED, OSQP_MAX_ITER) else nothing
        return solution.x.copy(), status == OSQP_SOLVED, info.iter, duals, status == OSQP_INFEASIBLE


def _by_columns(pattern: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the nonzeros, column after column, as the solver stores them."""
    columns, rows = np.nonzero(pattern.T)
    return rows, columns


def closed_form(
    program: QuadraticProgram, duals: np.ndarray | None = None, *, rounds: int = 3, tolerance: float = 1e-9
) -> np.ndarray | None:
    """The optimum where a good guess of the active rows is enough, else None.

    Solves the KKT system of the rows taken for active. A point that satisfies every row, with multipliers of the right
    sign on those rows, satisfies all KKT conditions: it is the optimum, to rounding. If it does not, the rows that it
    violates are taken for active, those whose multiplier has the wrong sign for idle, and the system is solved again.

    Args:
        program: The program.
        duals: First guess of the rows' multipliers, of which the signs count; without it, the equalities alone.
        rounds: How many systems are solved before giving up.
        tolerance: Largest violation of a row, in scaled units.
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
        # K is symmetric: its transpose is the same matrix in LAPACK's own order, which saves a copy.
        _, _, solution, info = dgesv(K.T, right, overwrite_a=1, overwrite_b=1)
        if info != 0:
            return None
        x = solution[:n]
        r = A @ x
        excess = np.maximum(l - r, r - u)
        right_sign = None if signs is None else signs * solution[n:] >= 0.0
        if excess.max() <= tolerance and (right_sign is None or right_sign.all()):  # a NaN is not
            return x
        violated = np.flatnonzero(~(excess <= tolerance))
        above = r[violated] > u[violated]
        if right_sign is None or signs is None:
            right_sign, signs = np.ones(len(rows), bool), np.zeros(len(rows))
        rows = np.concatenate((rows[right_sign], violated))
        target = np.concatenate((target[right_sign], np.where(above, u[violated], l[violated])))
        signs = np.concatenate((signs[right_sign], np.where(above, 1.0, -1.0)))
    return None
