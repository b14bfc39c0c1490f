"""The compilers of this machine: how they are called, and in one line what they said."""

import os
import re
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError
from spidar_gym.files import scratch_folder, whole_file
from spidar_gym.native import recipe

TELLING = re.compile(r"error|fatal|fail|cannot|denied|no such|no space|not found|undefined", re.IGNORECASE)
"""Lines of a compiler or linker that say why."""


def compiler() -> list[str]:
    """A C compiler, with the arguments that CC has.

    Raises:
        MissingDependencyError: When there is none.
        InvalidValueError: When CC is no command.
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
    """Compile the library from the sources beside this file; `path`, where it then lies.

    Args:
        path: Where it is to lie.
        headers: Name → text of headers that take the place of generated ones.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: When it does not compile, with the compiler's words, or cannot be written.
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
    """Call a compiler, linker or generator; what it printed.

    Args:
        command: With its arguments.
        what: What is being made, for the message.
        place: Folder to call it in.

    Raises:
        SpidarError: When it cannot be started or fails; with what it said.
    """
    english = {**os.environ, "LC_ALL": "C"}
    try:
        done = subprocess.run(
            command, cwd=place, env=english, capture_output=True, text=True, errors="replace", check=False
        )
    except OSError as error:
        said = f"cannot be started: {error.strerror}"
    else:
        if done.returncode == 0:
            return done.stdout
        lines = done.stderr.splitlines()
        telling = [line for line in lines if TELLING.search(line)] or lines
        said = " ".join(" / ".join(telling).split())[:400] or f"ended with status {done.returncode}"
    raise SpidarError(
        f"{what} does not compile: {Path(command[0]).name}: {said}; valid: compilers for C99 (CC) and, for ROS, C++11, "
        "and room on the disks of the output and of TMPDIR"
    )
