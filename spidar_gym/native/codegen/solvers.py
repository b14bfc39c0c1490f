"""Generates OSQP's code for every pattern of the allocation, and the core's table of these solvers."""

import errno
import os
import re
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

import numpy as np
import osqp

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.control.allocation.modes import PROJECTION
from spidar_gym.control.allocation.problem import INFINITY
from spidar_gym.control.allocation.solver import SETTINGS, patterns, sparse
from spidar_gym.errors import SpidarError
from spidar_gym.files import scratch_folder
from spidar_gym.native.codegen.header import array, header
from spidar_gym.native.constants import ONBOARD_ITERATIONS, PROGRAMS, program_modes


def programs() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the patterns of P and A by name, in the core's order, each hard and soft."""
    found = {}
    for name, mode in program_modes().items():
        found[name] = patterns(mode)
        if name != PROJECTION.name:
            found[f"{name}_soft"] = patterns(mode, soft=True)
    return found


def generate_solvers() -> dict[str, str]:
    """Generate the solver's sources, a workspace for each pattern, and `spidar_solvers.h`: name → text."""
    found = programs()
    files: dict[str, str] = {}
    tables, entries = [], {}
    for name, (P_pattern, A_pattern) in found.items():
        m, n = A_pattern.shape
        P, A, P_at, A_at = sparse(P_pattern, A_pattern)
        wide = np.full(m, INFINITY)
        solver = osqp.OSQP(algebra="builtin")
        solver.setup(
            P, np.zeros(n), A, -wide, wide, eps_abs=AllocatorConfig().tolerance, max_iter=ONBOARD_ITERATIONS, **SETTINGS
        )
        # Generate right after setup: after a solution the code would start from it.
        with scratch_folder() as scratch:
            solver.codegen(
                str(scratch), parameters="matrices", force_rewrite=True, prefix=f"{name}_",
                extension_name=None,  # type: ignore[arg-type] - no Python extension; declared as a plain str
                use_float=False, printing_enable=False, profiling_enable=False, interrupt_enable=False,
            )  # fmt: skip
            files |= _collect(scratch)
        files |= _relocatable(name, files)
        tables += array("int32_t", f"{name}_P_AT", P_at.tolist()) + array("int32_t", f"{name}_A_AT", A_at.tolist())
        entries[name] = (
            f"{{&{name}_SPACE, sizeof {name}_SPACE, offsetof({name}_space, solver), {name}_POINTERS, "
            f"sizeof {name}_POINTERS / sizeof *{name}_POINTERS,\n      "
            f"{name}_P_AT, {name}_A_AT, {len(P_at)}, {len(A_at)}}}"
        )
    empty = "{NULL, 0, 0, NULL, 0, NULL, NULL, 0, 0}"
    lines = [
        f'#define SP_OSQP_VERSION "{version("osqp")}"',
        "",
        "/* A generated workspace of OSQP, the offsets of its solver and of its internal pointers, and the positions",
        " * of the entries of P's upper triangle and of A, column by column, in the dense matrices. */",
        "typedef struct {",
        "    const void *space;",
        "    size_t bytes, solver;",
        "    const uint32_t *pointers;",
        "    int32_t pointer_count;",
        "    const int32_t *P_at, *A_at;",
        "    int32_t P_count, A_count;",
        "} sp_pattern;",
        "",
        "#define SP_ALIGNED(bytes) (((bytes) + 63) / 64 * 64)",
        "/* Memory of all workspaces. */",
        "#define SP_SOLVERS_BYTES \\",
        *(f"    {'(' if k == 0 else ' '}SP_ALIGNED(sizeof({name}_space)){' + ' if k + 1 < len(found) else ')'}"
          f"{chr(92) if k + 1 < len(found) else ''}" for k, name in enumerate(found)),
        "",
        *tables,
        "static const struct {",
        "    sp_pattern hard, soft;",
        "} SP_PATTERNS[SP_PROGRAMS] = {",
        *(f"    {{{entries[kind]},\n     {entries.get(kind + '_soft', empty)}}}," for kind in PROGRAMS),
        "};",
    ]  # fmt: skip
    doc = "a workspace of OSQP for each pattern, and the positions of its numbers in the dense matrices."
    includes = ("<stddef.h>", "<stdint.h>", '"osqp.h"', *(f'"{name}_workspace.h"' for name in found))
    return {**files, "spidar_solvers.h": header("SPIDAR_SOLVERS", doc, lines, includes)}


MEMBERS = {
    "OSQPSolution": "x y prim_inf_cert dual_inf_cert",
    "OSQPCscMatrix": "m n p i x nzmax nz",
    "OSQPMatrix": "csc symmetry",
    "OSQPVectorf": "values length",
    "OSQPVectori": "values length",
    "OSQPData": "n m P A q l u",
    "qdldl_solver": "type name solve update_settings warm_start update_matrices update_rho_vec nthreads L Dinv P bp "
    "sol rho_inv_vec sigma rho_inv n m KKT PtoKKT AtoKKT rhotoKKT D etree Lnz iwork bwork fwork",
    "OSQPWorkspace": "data linsys_solver rho_vec rho_inv_vec constr_type x y z xz_tilde xtilde_view ztilde_view x_prev "
    "z_prev Ax Px Aty xtPx qtx SC scaled_dual_gap delta_y Atdelta_y delta_x Pdelta_x Adelta_x D_temp D_temp_A E_temp",
    "OSQPSolver": "settings solution info work",
}
"""Members of OSQP's structs in the order of the generated initialisers, up to the last pointer."""
_DEFINITION = re.compile(r"^(\w+)\s+(\w+)(\[\d+\])?(?: = \{\n(.*?)\n\})?;$", re.MULTILINE | re.DOTALL)


def _relocatable(name: str, files: Mapping[str, str]) -> dict[str, str]:
    """Convert OSQP's workspace from generated globals to one copyable constant with a table of its pointers.

    Raises:
        SpidarError: When OSQP's generator writes an unknown structure.
    """
    source, prefix = files[f"{name}_workspace.c"], f"{name}_"
    kinds = {title: kind for kind, title, _, _ in _DEFINITION.findall(source)}
    members, values, pointers = [], [], []
    for kind, title, size, text in _DEFINITION.findall(source):
        own = title.removeprefix(prefix)
        members.append(f"    {kind} {own}{size};")
        if not text:
            continue
        items = text.rstrip(",").split(",\n")
        for k, item in enumerate(items):
            found = re.search(rf"&?\b({prefix}\w+)", item)
            if found is None:
                continue
            target = found[1]
            if target not in kinds or len(MEMBERS.get(kind, "").split()) <= k:
                raise SpidarError(f"OSQP generates {item.strip()!r} in a {kind}; valid: osqp>=1.1,<2")
            pointers.append(f"offsetof({prefix}space, {own}) + offsetof({kind}, {MEMBERS[kind].split()[k]})")
            address = f"({kinds[target]} *)&{prefix}SPACE.{target.removeprefix(prefix)}"
            items[k] = item.replace(found[0], address)
        values.append(f"    .{own} = {{\n" + ",\n".join(items) + "\n    },")
    opening = source[source.index("#include") : source.index("/* Define the settings")]
    body = [f"/* The workspace of OSQP for {name}. */", opening.rstrip(), f'#include "{name}_workspace.h"', "",
            f"const {prefix}space {prefix}SPACE = {{", *values, "};"]  # fmt: skip
    table = array("uint32_t", f"{prefix}POINTERS", pointers)
    lines = ["typedef struct {", *members, f"}} {prefix}space;", f"extern const {prefix}space {prefix}SPACE;", *table]
    includes = ("<stddef.h>", "<stdint.h>", '"types.h"', '"algebra_impl.h"', '"qdldl_interface.h"')
    return {
        f"{name}_workspace.h": header(
            f"{name}_WORKSPACE".upper(), f"the workspace of OSQP for {name}.", lines, includes
        ),
        f"{name}_workspace.c": "\n".join([*body, ""]),
    }


def _collect(scratch: Path) -> dict[str, str]:
    """Read the generated sources and headers, without the line with the date (`OSError` for an incomplete file)."""
    files = {}
    for file in sorted(scratch.rglob("*.[ch]")):
        if file.name == "emosqp.c":  # main function of an example
            continue
        lines = file.read_text(encoding="utf-8").splitlines()
        if not "".join(lines[-1:]).startswith(("#endif", "}")):  # OSQP does not check whether its writes succeed
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        files[file.name] = "\n".join(line for line in lines if "autogenerated" not in line) + "\n"
    return files
