"""Provenance of a result: versions of packages, the processor, hashes of files."""

import hashlib
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import spidar_gym

PACKAGES = ("mujoco", "numpy", "scipy", "pin", "osqp", "gymnasium")
"""Packages whose versions a row contains, besides Python and this package."""


def versions(*more: str) -> dict[str, str]:
    """Return the versions of Python, this package, `PACKAGES` and `more` packages."""
    found = {"python": platform.python_version(), "spidar-gym": spidar_gym.__version__}
    for package in (*PACKAGES, *more):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = ""
    return found


def processor() -> str:
    """Return the family of the processor, which determines the machine code that NumPy and its libraries select."""
    words = {}
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            words.setdefault(key.strip(), value.strip())
    except OSError:
        pass
    family = " ".join(words.get(key, "") for key in ("vendor_id", "cpu family", "model")).strip()
    wide = [flag for flag in ("avx2", "avx512f") if flag in words.get("flags", "").split()]
    kernel = os.environ.get("OPENBLAS_CORETYPE", "")  # NumPy's library then selects the code of another processor
    return " ".join([platform.machine(), family or platform.processor(), *wide, *([kernel] if kernel else [])]).strip()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file; empty if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
