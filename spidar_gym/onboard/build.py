"""The runner compiled for this machine, once for every version of its sources."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from spidar_gym.files import scratch_folder, whole_file
from spidar_gym.native.compiler import FLAGS, compiler, run_tool
from spidar_gym.native.library import core_path
from spidar_gym.onboard.export import export_files, write_files

FOLDERS = ("core", "osqp", "runner")
"""Where the C sources of an export are."""
INCLUDES = ("core", "osqp", "generated", "runner")
"""Where its headers are."""


def compile_runner(folder: Path, out: Path) -> Path:
    """Compile an exported folder's runner without ROS; `out`.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: When it does not compile; with the compiler's words.
    """
    sources = [str(p) for part in FOLDERS for p in sorted((folder / part).glob("*.c"))]
    includes = [f"-I{folder / part}" for part in INCLUDES]
    run_tool([*compiler(), *FLAGS, *includes, *sources, "-lm", "-o", str(out)], "the runner")
    return out


def build_runner(
    compile_: Callable[[Path, Path], Path] = compile_runner, name: str = "spidar-runner", residual: Path | None = None
) -> Path:
    """The runner of the present sources, compiled where it is not yet; where it lies.

    Args:
        compile_: What turns an exported folder into a program.
        name: Of the program.
        residual: Artifact of a learned policy that it has with it.
    """
    files = export_files(golden=False, residual=residual)
    digest = hashlib.sha256(b"".join(name.encode() + b"\0" + data for name, data in sorted(files.items())))
    path = core_path().parent / f"{name}-{digest.hexdigest()[:16]}"
    if path.is_file():
        return path
    with whole_file(path) as made, scratch_folder() as folder:
        write_files(files, folder)
        compile_(folder, made)
    return path
