"""OpenGL only where something is drawn: MuJoCo is imported without it where MUJOCO_GL names no library that is here."""

import importlib
import os
import subprocess
import sys
from functools import cache

from spidar_gym.errors import MissingDependencyError

INSTALL_GL = "apt-get install libegl1 libgl1 (then MUJOCO_GL=egl), or libosmesa6 (then MUJOCO_GL=osmesa)"
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Variables that name a screen; an empty one names none."""
_OPEN_WINDOW = """
import glfw
opened = glfw.init()
if opened:
    glfw.window_hint(glfw.VISIBLE, 0)
    opened = glfw.create_window(16, 16, "", None, None)
raise SystemExit(0 if opened else 1)
"""
"""GLFW ends its process, or leaves it without OpenGL, where it opens no window, so another process tries."""
_PATIENCE = 20.0
"""A screen that has not answered for so long shows nothing [s]."""


def import_mujoco() -> None:
    """Import MuJoCo, which binds the library that MUJOCO_GL names and fails where that is none, or is missing."""
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
    """Refuse to draw where MuJoCo was imported without OpenGL."""
    if not hasattr(importlib.import_module("mujoco.rendering.classic.gl_context"), "GLContext"):
        raise no_opengl()


def no_opengl() -> MissingDependencyError:
    """What to raise where nothing can be drawn; names MUJOCO_GL where it is set."""
    named = os.environ.get("MUJOCO_GL")
    given = (
        f"OpenGL by MUJOCO_GL={named!r} (valid: egl, osmesa, or glfw on a display)" if named else "an OpenGL library"
    )
    return MissingDependencyError(given, INSTALL_GL)


def has_display() -> bool:
    """Whether there is a screen on which a window can be opened; the first question takes 0.3 s where one is named."""
    named = tuple(os.environ.get(name, "") for name in SCREENS)
    return sys.platform != "linux" or (any(named) and _opens_window(named))


@cache
def _opens_window(screens: tuple[str, ...]) -> bool:
    """Whether GLFW opens a window where `SCREENS` say so."""
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
