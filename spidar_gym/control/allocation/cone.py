"""Primal-dual interior-point method: finds the optimum within the thrust spheres, or proves that there is none.

A pure function of the program: no state, a fixed start, a bounded number of steps. Every inequality is g(x) + s = c z
with s, z ≥ 0 and s z → 0, where g is a x − u or l − a x for the side of a row and ½ (‖f_i‖² − r²) for a sphere of the
program's radius r. A row with a compliance c > 0 may be violated by c z. Equalities are the same without s.
"""

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs  # pyright: ignore[reportAttributeAccessIssue] - compiled, without stubs

from spidar_gym.control.allocation.problem import INFINITY, N_FORCES, QuadraticProgram
from spidar_gym.robot import N_ROTORS

MAX_STEPS = 40
"""Largest number of Newton steps; ten are usual."""
ROWS, PRODUCT, GRADIENT = 1e-9, 1e-11, 1e-7
"""Tolerances of an optimum: rows and spheres, the mean of s z, the gradient of the Lagrangian."""
LOOSE = 300.0
"""Factor on the tolerances if rounding stops the iteration, as in feasible sets without interior."""
PROOF = 1e-9
"""A proof of infeasibility must hold by this share of the sum of its multipliers."""
FAR = 1e3
"""Largest force of the floor on a foot that is considered, in units of λ̄."""
SHORT = 0.995
"""Largest share of the distance to the boundary of s, z ≥ 0 that a step may cover."""
TINY = 1e-12
"""Compliance that regularises linearly dependent equalities."""
_NO_ROWS = np.zeros(0, int)
_FORCE, _ROTOR = np.arange(N_FORCES), np.arange(N_FORCES) // 3


def sphere_optimum(
    program: QuadraticProgram, soft: np.ndarray = _NO_ROWS, price: float = 1.0
) -> tuple[np.ndarray | None, int]:
    """Solve a program whose rotor forces must also stay within the spheres ‖f_i‖ ≤ r.

    Args:
        program: The program; its first 24 unknowns are the rotor forces in units of λ̄.
        soft: Rows that may be violated by v at the cost ½ `price` v².
        price: Price of a violation.

    Returns:
        x and the number of Newton steps; x is None if the program is infeasible or no optimum was found.
    """
    l, u, hard = program.l, program.u, np.ones(len(program.l), bool)
    hard[soft] = False
    far = _reach(
        program.A, program.radius
    )  # bounds that no forces within the spheres can reach are idle, such as the cube's
    if ((l > far) | (u < -far))[hard].any():
        return None, 0
    equal, upper, lower = (np.flatnonzero(side) for side in (l == u, (l != u) & (u < far), (l != u) & (-l < far)))
    E, b = program.A[equal], l[equal]
    G, h = np.concatenate((program.A[upper], -program.A[lower])), np.concatenate((u[upper], -l[lower]))
    # Unit of the cost in which the multipliers are of the order of one.
    largest = max(1.0, np.abs(b).max(initial=0.0), np.abs(h).max(initial=0.0))
    unit = max(1.0, np.abs(program.q).max(), 0.0 if hard.all() else price * largest)
    P, q, give = program.P / unit, program.q / unit, np.where(hard, 0.0, unit / price)
    yielding, c = give[equal], np.concatenate((give[upper], give[lower], np.zeros(N_ROTORS)))
    n, rows = len(q), len(h)
    J, g = np.concatenate((G, np.zeros((N_ROTORS, n)))), np.empty(len(c))
    x, y, z, s = np.zeros(n), np.zeros(len(b)), np.ones(len(c)), np.ones(len(c))
    s[:rows] = np.maximum(h, 1.0)
    K = np.zeros((n + len(b), n + len(b)))
    K[:n, n:], K[n:, :n] = E.T, E
    best, found, step = LOOSE, None, 0
    for step in range(MAX_STEPS):
        f = x[:N_FORCES].reshape(N_ROTORS, 3)
        g[:rows] = G @ x - h
        g[rows:] = 0.5 * (np.einsum("ij,ij->i", f, f) - program.radius**2)
        J[rows + _ROTOR, _FORCE] = x[:N_FORCES]
        pull = E.T @ y + G.T @ z[:rows]
        gradient = P @ x + q + pull + J[rows:].T @ z[rows:]
        off, miss, mean = E @ x - b - yielding * y, g + s - c * z, float(s @ z) / len(s)
        worst = max(np.abs(off).max(initial=0.0) / largest, np.abs(miss).max())
        left = max(worst / ROWS, mean / PRODUCT, np.abs(gradient).max() / GRADIENT)
        if left < best:
            best, found = left, x
        if best < 1.0 or not left < INFINITY:
            break
        # Farkas: a feasible x satisfies pull·x ≤ b·y + h·z; but within the spheres pull·x ≥ −r Σ ‖pull_i‖.
        proof = b @ y + h @ z[:rows] + _reach(pull[None], program.radius)[0]
        if hard.all() and proof < -PROOF * (np.abs(y).sum() + z[:rows].sum()):
            return None, step
        D = 1.0 / (s / z + c)
        K[:n, :n] = P + (J.T * D) @ J
        K[_FORCE, _FORCE] += np.repeat(z[rows:], 3)
        K[range(n, len(K)), range(n, len(K))] = -yielding - TINY
        factors, pivots, info = dgetrf(K)
        if info != 0:
            break
        product, d, dz, ds, length = s * z, q, z, s, 1.0
        for aimed in (False, True):  # predictor, then corrector: the predictor's length determines the centring
            push = D * (miss - product / z)
            d, _ = dgetrs(factors, pivots, np.concatenate((gradient + J.T @ push, off)))
            dz = push - D * (J @ d[:n])
            ds = -(product + s * dz) / z
            length = min(1.0, (SHORT if aimed else 1.0) / max((-dz / z).max(), (-ds / s).max(), SHORT))
            if not aimed:
                left_over = float((s + length * ds) @ (z + length * dz)) / len(s) / mean
                product = product - mean * left_over**3 + length**2 * ds * dz  # with length² to avoid cycling
        x, y, z, s = x - length * d[:n], y - length * d[n:], z + length * dz, s + length * ds
    return found, step


def _reach(A: np.ndarray, radius: float) -> np.ndarray:
    """Compute r Σ ‖a_i‖ of each row, shape (m,): the largest |a x| of forces within the spheres."""
    blocks = A[:, :N_FORCES].reshape(len(A), N_ROTORS, 3)
    return radius * np.sqrt(np.einsum("rij,rij->ri", blocks, blocks)).sum(axis=1) + FAR * np.abs(A[:, N_FORCES:]).sum(
        axis=1
    )
