"""OSQP's generated code for every pattern of the allocation, and the table that the core finds them in."""

import tempfile
from pathlib import Path

import numpy as np
import osqp
import scipy.sparse as sp

from spidar_gym.control.blocks import SPHERE_PATTERN
from spidar_gym.control.modes import ALLOCATIONS, PROJECTION, ground_modes
from spidar_gym.control.qp import INFINITY, N_FORCES, N_UNKNOWNS, Mode
from spidar_gym.control.solver import RHO

ONBOARD_ITERATIONS = 300
"""Iteration cap of the robot's computer: what fits into 5 ms there."""


def programs() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Patterns of P and A by name, in the order of the core's `sp_program_kind`, each hard and soft."""
    ground = ground_modes(
        power=False, torque_weight=1.0, torque_limit=5.0, foot_friction=0.6, peg_friction=0.3, min_normal=10.0
    )
    modes = {
        "paper": ALLOCATIONS["paper"]["flight"], "as_flown": ALLOCATIONS["as_flown"]["flight"],
        "projection": PROJECTION, "rest": ground["rest"], "leg": ground["leg"], "legs": ground["legs"],
        "stance": ground["stance"],
    }  # fmt: skip
    found = {}
    for name, mode in modes.items():
        P, A = patterns(mode)
        if name == "projection":
            A = np.vstack([A, SPHERE_PATTERN])
        found[name] = P, A
        if name != "projection":
            found[f"{name}_soft"] = softened(P, A, mode.soft_rows)
    return found


def patterns(mode: Mode) -> tuple[np.ndarray, np.ndarray]:
    """Where P and A of a mode may be nonzero."""
    block = np.concatenate((np.arange(N_FORCES) // 6, np.arange(N_UNKNOWNS - N_FORCES) // 3))[: mode.size]
    return block[:, None] == block[None], mode.pattern


def softened(P: np.ndarray, A: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Patterns of the softened program."""
    k, n = len(rows), len(P)
    P = np.block([[P, np.zeros((n, k), bool)], [np.zeros((k, n), bool), np.eye(k, dtype=bool)]])
    A = np.hstack([A, np.zeros((len(A), k), bool)])
    A[rows, n + np.arange(k)] = True
    return P, A


def _by_columns(pattern: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    columns, rows = np.nonzero(pattern.T)
    return rows, columns


def generate_solvers() -> dict[str, str]:
    """The solver's sources, a workspace for each pattern, and `spidar_solvers.h`: name → text."""
    kinds = ("paper", "as_flown", "projection", "rest", "leg", "legs", "stance")
    found = programs()
    files: dict[str, str] = {}
    tables, entries = [], {}
    for name, (P_pattern, A_pattern) in found.items():
        m, n = A_pattern.shape
        P_rows, P_columns = _by_columns(np.triu(P_pattern))
        A_rows, A_columns = _by_columns(A_pattern)
        P = sp.csc_matrix(((P_rows == P_columns).astype(float), (P_rows, P_columns)), shape=(n, n))
        A = sp.csc_matrix((np.ones(len(A_rows)), (A_rows, A_columns)), shape=(m, n))
        wide = np.full(m, INFINITY)
        solver = osqp.OSQP(algebra="builtin")
        solver.setup(
            P, np.zeros(n), A, -wide, wide, verbose=False, scaling=0, warm_starting=False, polishing=False, rho=RHO,
            adaptive_rho=True, adaptive_rho_interval=25, check_termination=25, eps_abs=1e-7, eps_rel=0.0,
            max_iter=ONBOARD_ITERATIONS,
        )  # fmt: skip
        # Right after setup: code that is generated after a solution would begin with it.
        with tempfile.TemporaryDirectory() as scratch:
            solver.codegen(
                scratch, parameters="matrices", force_rewrite=True, prefix=f"{name}_",
                extension_name=None,  # type: ignore[arg-type] - no Python extension; declared as a plain str
                use_float=False, printing_enable=False, profiling_enable=False, interrupt_enable=False,
            )  # fmt: skip
            files |= _collect(Path(scratch))
        P_at, A_at = n * P_rows + P_columns, n * A_rows + A_columns
        for what, at in (("P", P_at), ("A", A_at)):
            numbers = ", ".join(map(str, at.tolist()))
            tables.append(f"static const int32_t {name}_{what}[{len(at)}] = {{{numbers}}};")
        entries[name] = f"{{&{name}_solver, {name}_P, {name}_A, {len(P_at)}, {len(A_at)}}}"
    empty = "{NULL, NULL, NULL, 0, 0}"
    lines = [
        "/* Generated: a workspace of OSQP for each pattern, and where its numbers stand in the dense matrices. */",
        "#ifndef SPIDAR_SOLVERS_H",
        "#define SPIDAR_SOLVERS_H",
        "",
        "#include <stddef.h>",
        '#include "osqp.h"',
        *(f'#include "{name}_workspace.h"' for name in found),
        "",
        "typedef struct {",
        "    OSQPSolver *solver;",
        "    const int32_t *P_at, *A_at; /* entries of P's upper triangle and of A, column by column */",
        "    int32_t P_count, A_count;",
        "} sp_solver;",
        "",
        *tables,
        "static const struct {",
        "    sp_solver hard, soft;",
        "} SP_SOLVERS[SP_PROGRAMS] = {",
        *(f"    {{{entries[kind]}, {entries.get(kind + '_soft', empty)}}}," for kind in kinds),
        "};",
        "",
        "#endif",
        "",
    ]
    return {**files, "spidar_solvers.h": "\n".join(lines)}


def _collect(scratch: Path) -> dict[str, str]:
    """Sources and headers, without the line that holds the date."""
    files = {}
    for file in sorted(scratch.rglob("*.[ch]")):
        if file.name == "emosqp.c":  # an example's main
            continue
        lines = file.read_text(encoding="utf-8").splitlines()
        files[file.name] = "\n".join(line for line in lines if "autogenerated" not in line) + "\n"
    return files
