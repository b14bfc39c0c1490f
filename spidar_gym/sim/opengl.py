"""OpenGL only where something is drawn: MuJoCo is imported without it where MUJOCO_GL names no library that is here."""

import importlib
import os

from spidar_gym.errors import MissingDependencyError

INSTALL_GL = "apt-get install libegl1 libgl1 (then MUJOCO_GL=egl), or libosmesa6 (then MUJOCO_GL=osmesa)"


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
        named = os.environ.get("MUJOCO_GL", "")
        raise MissingDependencyError(
            f"OpenGL by MUJOCO_GL={named!r} (valid: egl, osmesa, or glfw on a display)", INSTALL_GL
        )
