"""The runner compiled for this machine, once for every version of its sources."""

import hashlib
import os
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

from spidar_gym.control.core import core_path
from spidar_gym.deploy.export import FLAGS, compiler, export_files, write_files
from spidar_gym.errors import SpidarError
from spidar_gym.files import output_folder

FOLDERS = ("core", "osqp", "runner")
"""Where its C sources are."""
INCLUDES = ("core", "osqp", "generated", "runner")
"""… and its headers."""


def compile_runner(folder: Path, out: Path) -> Path:
    """Compile an exported folder's runner without ROS; `out`.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: When it does not compile; with the compiler's first words.
    """
    sources = [str(p) for part in FOLDERS for p in sorted((folder / part).glob("*.c"))]
    includes = [f"-I{folder / part}" for part in INCLUDES]
    command = [compiler(), *FLAGS, *includes, *sources, "-lm", "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SpidarError(f"the runner does not compile: {done.stderr.strip()[:300]}; valid: a C99 compiler in CC")
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
    output_folder(path.parent)
    with tempfile.TemporaryDirectory() as scratch:
        folder, made = Path(scratch), path.with_name(f".{path.name}.{os.getpid()}")
        write_files(files, folder)
        compile_(folder, made)
        os.replace(made, path)
    return path
