"""The compilers of this machine: how they are called, and in one line what they said."""

import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
"""Compiler flags of what goes to the robot: without contraction every machine rounds alike."""
LIBRARY_FLAGS = ("-std=c99", "-O3", "-ffp-contract=off")
"""Those of the library that simulates: the same bits, a fifth of the time less."""
TELLING = re.compile(r"error|fatal|fail|cannot|denied|no such|no space|not found|undefined", re.IGNORECASE)
"""Lines of a compiler or linker that say why."""


def compiler() -> list[str]:
    """A C compiler, with the arguments that CC has.

    Raises:
        MissingDependencyError: When there is none.
        InvalidValueError: When CC is no command.
    """
    given = os.environ.get("CC", "").strip()
    if not given:
        found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
        if not found:
            raise MissingDependencyError("a C compiler", "apt-get install gcc")
        return [found]
    try:
        words = shlex.split(given)
    except ValueError:  # a quotation that does not end
        words = []
    if not words or not shutil.which(words[0]):
        raise InvalidValueError("CC", given, "a C99 compiler that is installed, with its arguments, such as gcc -O2")
    return words


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
