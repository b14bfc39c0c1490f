"""Compile the core with a learned policy, and the runner, for this machine; each version of the runner once."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from spidar_gym.files import scratch_folder, whole_file
from spidar_gym.native.compiler import compile_library, compiler, run_tool
from spidar_gym.native.recipe import FLAGS
from spidar_gym.onboard.export import EVERY, export_files, write_files
from spidar_gym.onboard.policy import policy_header
from spidar_gym.policies.artifact import read_artifact
from spidar_gym.policies.source import artifact_file

PARTS = ("core", "osqp", "runner")
"""Folders of an export with the runner's C sources, the core's included."""


def arguments(folder: Path) -> list[str]:
    """Return the compiler arguments for the runner of an exported folder: include paths and C sources."""
    sources = [str(path) for part in PARTS for path in sorted((folder / part).glob("*.c"))]
    return [*(f"-I{folder / part}" for part in (*PARTS, "generated")), *sources, "-lm"]


def build_core(path: Path, residual: Path) -> Path:
    """Compile the library with a learned policy in its core; returns `path`.

    Args:
        path: Path of the library.
        residual: Artifact of the policy.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: If it does not compile (with the compiler's output) or cannot be written.
    """
    return compile_library(path, {"spidar_policy.h": policy_header(read_artifact(artifact_file(residual)))})


def compile_runner(folder: Path, out: Path) -> Path:
    """Compile an exported folder's runner without ROS; returns `out`.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: If it does not compile, with the compiler's output.
    """
    run_tool([*compiler(), *FLAGS, *arguments(folder), "-o", str(out)], "the runner")
    return out


def build_runner(
    compile_: Callable[[Path, Path], Path] = compile_runner, name: str = "spidar-runner", residual: Path | None = None
) -> Path:
    """Compile the runner of the present sources unless it is in the user's cache; returns its path.

    Args:
        compile_: Function that compiles an exported folder to a program.
        name: Name of the program.
        residual: Artifact of a learned policy to include.
    """
    files = export_files(golden=False, residual=residual, presets=EVERY, fragile=True)
    digest = hashlib.sha256(b"".join(name.encode() + b"\0" + data for name, data in sorted(files.items())))
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "spidar_gym"
    path = cache / f"{name}-{digest.hexdigest()[:16]}"
    if path.is_file():
        return path
    with whole_file(path) as made, scratch_folder() as folder:
        write_files(files, folder)
        compile_(folder, made)
    return path
