"""Calls the compilers of this machine, and reports their errors in one line."""

import os
import re
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError
from spidar_gym.files import scratch_folder, whole_file
from spidar_gym.native import recipe

TELLING = re.compile(r"error|fatal|fail|cannot|denied|no such|no space|not found|undefined", re.IGNORECASE)
"""Pattern of the lines in which a compiler or linker states an error."""


def compiler() -> list[str]:
    """Return the command of a C compiler, with the arguments in CC.

    Raises:
        MissingDependencyError: When there is no compiler.
        InvalidValueError: When CC is not a command.
    """
    try:
        words = recipe.find_compiler()
    except ValueError as error:
        expected = "a C99 compiler that is installed, with its arguments, such as gcc -O2"
        raise InvalidValueError("CC", str(error), expected) from None
    if not words:
        raise MissingDependencyError("a C compiler", f"apt-get install gcc, or pip install '{recipe.ZIG}'")
    return words


def compile_library(path: Path, headers: Mapping[str, str] | None = None) -> Path:
    """Compile the library from the sources beside this file; return `path`.

    Args:
        path: Path of the library.
        headers: Name → text of headers that replace generated ones.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: When it does not compile, with the compiler's messages, or cannot be written.
    """
    command = compiler()
    interface = recipe.interface_header(recipe.library_digest())
    with whole_file(path) as made:
        with scratch_folder() as folder:
            for name, text in {"spidar_interface.h": interface, **(headers or {})}.items():
                (folder / name).write_text(text, encoding="utf-8")
            run_tool([*command, *recipe.compile_words(folder), "-o", str(made)], "the library")
        recipe.seal(made)
    return path


def run_tool(command: Sequence[str], what: str, place: Path | None = None) -> str:
    """Call a compiler, linker or generator; return what it printed.

    Args:
        command: Command with its arguments.
        what: Name of the product, for the error message.
        place: Working directory of the call.

    Raises:
        SpidarError: When it cannot be started or fails; with its messages.
    """
    english = {**os.environ, "LC_ALL": "C"}
    try:
        done = subprocess.run(
            command, cwd=place, env=english, capture_output=True, text=True, errors="replace", check=False
        )
    except OSError as error:
        reason = f"cannot be started: {error.strerror}"
    else:
        if done.returncode == 0:
            return done.stdout
        lines = done.stderr.splitlines()
        telling = [line for line in lines if TELLING.search(line)] or lines
        reason = " ".join(" / ".join(telling).split())[:400] or f"ended with status {done.returncode}"
    raise SpidarError(
        f"{what} does not compile: {Path(command[0]).name}: {reason}; valid: compilers for C99 (CC) and, for ROS,"
        " C++11, and room on the disks of the output and of TMPDIR"
    )
