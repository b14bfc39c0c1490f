"""Compiles the library when the package is built or installed; hatchling loads it without the package."""

import os
import runpy
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

from hatchling.builders.hooks.plugin.interface import (  # pyright: ignore[reportMissingImports] - pip's while it builds
    BuildHookInterface,
)

# Importing it by name would import the package and its dependencies.
recipe = SimpleNamespace(**runpy.run_path(str(Path(__file__).with_name("recipe.py"))))
CORRECT = "a C99 compiler that is installed, with its arguments, such as gcc -O2, or no CC at all"


class NativeLibrary(BuildHookInterface):
    """Puts the library into the wheel, or beside its sources in an editable installation."""

    def dependencies(self) -> list[str]:
        """Require a compiler from PyPI where this machine has none."""
        return [] if self._compiler() else [recipe.ZIG]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the library and set the platform of the wheel."""
        root = Path(self.root)
        place = f"spidar_gym/native/{recipe.LIBRARY}"
        # In an editable installation in the target's folder: a library in use is replaced, never overwritten.
        self._folder = tempfile.TemporaryDirectory(dir=(root / place).parent if version == "editable" else None)
        made = Path(self._folder.name) / recipe.LIBRARY
        self._compile(made)
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"
        if version == "editable":
            os.replace(made, root / place)
        else:
            build_data["force_include"][str(made)] = place

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder."""
        self._folder.cleanup()

    def _compile(self, made: Path) -> None:
        command = self._compiler()
        if not command:
            self._refuse(f"no C compiler; valid: apt-get install gcc, or pip install '{recipe.ZIG}'")
        header = made.with_name("spidar_interface.h")
        header.write_text(recipe.interface_header(recipe.library_digest()), encoding="utf-8")
        words = [*command, *recipe.compile_words(made.parent), "-o", str(made)]
        try:
            done = subprocess.run(words, capture_output=True, text=True, errors="replace", check=False)
        except OSError as error:
            self._refuse(f"{command[0]} cannot be started: {error.strerror}; valid: {CORRECT}")
        if done.returncode:
            self._refuse(f"the library does not compile: {done.stderr[:4000]}")
        recipe.seal(made)

    def _compiler(self) -> list[str]:
        try:
            return recipe.find_compiler()
        except ValueError as error:
            self._refuse(f"CC = {error} is not valid; expected {CORRECT}")

    def _refuse(self, line: str) -> NoReturn:
        self.app.abort(line)
        raise SystemExit(1)
