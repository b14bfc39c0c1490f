"""Optional OpenGL: MuJoCo is imported without it if MUJOCO_GL names a library that is not installed."""

import importlib
import os
import subprocess
import sys
from functools import cache

from spidar_gym.errors import MissingDependencyError

INSTALL_GL = "apt-get install libegl1 libgl1 (then MUJOCO_GL=egl), or libosmesa6 (then MUJOCO_GL=osmesa)"
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Environment variables that name a display; an empty one names none."""
_OPEN_WINDOW = """
import glfw
opened = glfw.init()
if opened:
    glfw.window_hint(glfw.VISIBLE, 0)
    opened = glfw.create_window(16, 16, "", None, None)
raise SystemExit(0 if opened else 1)
"""
"""Test program for a separate process: if GLFW cannot open a window, it may end its process or break OpenGL there."""
_PATIENCE = 20.0
"""Time after which a display that has not responded counts as missing [s]."""


def import_mujoco() -> None:
    """Import MuJoCo, without OpenGL if the library that MUJOCO_GL names is invalid or missing."""
    try:
        importlib.import_module("mujoco")
    except Exception:  # every binding fails in its own way
        named = os.environ.get("MUJOCO_GL")
        if named is None:
            raise
        os.environ["MUJOCO_GL"] = "disable"
        try:
            importlib.import_module("mujoco")
        finally:
            os.environ["MUJOCO_GL"] = named


def require_opengl() -> None:
    """Raise `MissingDependencyError` if MuJoCo was imported without OpenGL."""
    if not hasattr(importlib.import_module("mujoco.rendering.classic.gl_context"), "GLContext"):
        raise no_opengl()


def no_opengl() -> MissingDependencyError:
    """Return the error for missing OpenGL, with the value of MUJOCO_GL if it is set."""
    named = os.environ.get("MUJOCO_GL")
    given = (
        f"OpenGL by MUJOCO_GL={named!r} (valid: egl, osmesa, or glfw on a display)" if named else "an OpenGL library"
    )
    return MissingDependencyError(given, INSTALL_GL)


def has_display() -> bool:
    """Return whether a window can be opened; the first call takes 0.3 s if a display is named."""
    named = tuple(os.environ.get(name, "") for name in SCREENS)
    return sys.platform != "linux" or (any(named) and _opens_window(named))


@cache
def _opens_window(screens: tuple[str, ...]) -> bool:
    """Return whether GLFW opens a window on the display that `SCREENS` name."""
    named = {name: screen for name, screen in zip(SCREENS, screens, strict=True) if screen}
    others = {name: value for name, value in os.environ.items() if name not in SCREENS}
    try:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", _OPEN_WINDOW],
            env=others | named, stdin=subprocess.DEVNULL, capture_output=True, timeout=_PATIENCE, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0
