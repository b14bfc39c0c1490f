"""The generated C that is committed, so that a clone needs a C compiler only."""

import re
from functools import cache
from importlib.metadata import version
from pathlib import Path

from spidar_gym.errors import StaleAssetError
from spidar_gym.native.codegen.engine import engine_headers
from spidar_gym.native.codegen.header import constants_header, modes_header, structs_header
from spidar_gym.native.codegen.solvers import generate_solvers
from spidar_gym.native.recipe import GENERATED, SHARED_HEADERS, source_bytes

OSQP = "osqp"
"""Folder of OSQP's sources."""


@cache
def shared_headers() -> dict[str, str]:
    """Return the texts of `SHARED_HEADERS`, on which a compiled library and this package must agree."""
    texts = constants_header(), structs_header(), modes_header(), *engine_headers().values()
    return dict(zip(SHARED_HEADERS, texts, strict=True))


def committed_files() -> dict[str, str]:
    """Generate path under `GENERATED` → text; OSQP's sources are those of the installed version."""
    solvers = {f"{OSQP}/{name}": text for name, text in generate_solvers().items()}
    return shared_headers() | solvers


def osqp_files() -> dict[str, bytes]:
    """Read OSQP's committed sources: name → content (`StaleAssetError` where they are missing)."""
    files = {file.name: source_bytes(file) for file in sorted((GENERATED / OSQP).glob("*.[ch]"))}
    if "spidar_solvers.h" not in files:
        raise StaleAssetError(GENERATED / OSQP)
    return files


def osqp_version() -> str:
    """Return the version of OSQP that generated the committed sources."""
    found = re.search(rb'SP_OSQP_VERSION "(.*)"', osqp_files()["spidar_solvers.h"])
    return found[1].decode() if found else "unknown"


def other_osqp() -> str:
    """Return a one-line note if the installed OSQP did not generate the committed sources; else ""."""
    ours, installed = osqp_version(), version("osqp")
    if ours == installed:
        return ""
    return f"not compared: OSQP's sources, which are those of osqp {ours}; osqp {installed} is installed here"


def leftovers(files: dict[str, str]) -> list[Path]:
    """Return C files under `GENERATED` that are no longer generated; they would be compiled with the others."""
    return sorted(set(GENERATED.rglob("*.[ch]")) - {GENERATED / name for name in files})
