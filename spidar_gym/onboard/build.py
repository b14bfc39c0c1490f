"""The library and the runner compiled for this machine, the runner once for every version of its sources."""

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

from spidar_gym.files import scratch_folder, whole_file
from spidar_gym.native.codegen.engine import engine_files
from spidar_gym.native.compiler import FLAGS, LIBRARY_FLAGS, compiler, run_tool
from spidar_gym.native.library import core_path, seal
from spidar_gym.onboard.export import export_files, write_files

CORE = ("core", "osqp")
"""Where the C sources of the core are in an export."""
RUNNER = (*CORE, "runner")
"""Where those of the runner are, the core's included."""
LIBRARY = (*CORE, "engine")
"""Where those of the library are: the engine does not go to the robot."""


def arguments(folder: Path, parts: Sequence[str]) -> list[str]:
    """What a compiler is told of some parts of an exported folder: where headers are, and the C sources."""
    sources = [str(p) for part in parts for p in sorted((folder / part).glob("*.c"))]
    return [*(f"-I{folder / part}" for part in (*parts, "generated")), *sources, "-lm"]


def build_core(path: Path | None = None, *, residual: Path | None = None) -> Path:
    """Compile core and engine as a shared library; where it lies.

    Args:
        path: Where it is to lie; where environments look for it by default.
        residual: Artifact of a learned policy that it has with it.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: When it does not compile, with the compiler's words, or cannot be written.
    """
    path, command = path or core_path(), [*compiler(), *LIBRARY_FLAGS, "-DSPIDAR_SHARED", "-fPIC", "-shared"]
    with whole_file(path) as made:
        with scratch_folder() as folder:
            write_files(export_files(golden=False, residual=residual) | engine_files(), folder)
            run_tool([*command, *arguments(folder, LIBRARY), "-o", str(made)], "the core")
        seal(made)
    return path


def compile_runner(folder: Path, out: Path) -> Path:
    """Compile an exported folder's runner without ROS; `out`.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: When it does not compile; with the compiler's words.
    """
    run_tool([*compiler(), *FLAGS, *arguments(folder, RUNNER), "-o", str(out)], "the runner")
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
