"""Programs which some tests need: a test is skipped where one is missing, and fails where it is required."""

import os
import shutil
from collections.abc import Callable

import pytest

PROGRAMS = {
    "cross": (
        ("aarch64-linux-gnu-gcc", "qemu-aarch64"),
        "apt-get install gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user",
    ),
    "ros": (
        ("rosmaster", "pkg-config", "g++", "cmake", "catkin_make"),
        "docs/onboard/sitl_and_faults.md lists the packages",
    ),
    "browser": (("chromium",), "apt-get install chromium"),
}


def marks(marker: str) -> list[pytest.MarkDecorator]:
    """A marker and a skip where its programs are missing; `SPIDAR_REQUIRE=cross,ros` disables the skip."""
    programs, install = PROGRAMS[marker]
    missing = [program for program in programs if not shutil.which(program)]
    required = marker in os.environ.get("SPIDAR_REQUIRE", "").split(",")
    skip = pytest.mark.skipif(bool(missing) and not required, reason=f"{', '.join(missing)} missing: {install}")
    return [getattr(pytest.mark, marker), skip]


def marked(marker: str) -> Callable:
    """Decorator of tests that need a marker's programs."""
    mark, skip = marks(marker)
    return lambda test: mark(skip(test))


needs_compiler = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")
