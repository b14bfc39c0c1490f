"""Rendering of the robot: off-screen pictures and depth images, or MuJoCo's window."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import copy
import ctypes.util
import importlib
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import mujoco.viewer
import numpy as np
from mujoco.rendering.classic import gl_context

from spidar_gym.errors import SpidarError, require_name
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.description import CAMERAS
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.opengl import SCREENS, has_display, no_opengl, require_opengl
from spidar_gym.sim.scene import MAX_HEIGHT, MAX_WIDTH, scene
from spidar_gym.turn import Turn

_DRAWING = Turn()
"""Lock of all drawing: the threads' contexts share one display."""
_OPENED: set[int] = set()
"""Ids of those processes, among this one and its ancestors by fork, that have opened OpenGL."""
_LOST: list[Any] = []
"""Renderers that a forked process cannot release."""


def _is_lost() -> bool:
    """Return whether OpenGL was opened before this process was forked; its threads are missing, so it would hang."""
    return bool(_OPENED - {os.getpid()})


def _require_here() -> None:
    """Raise `SpidarError` if OpenGL is lost; else record it as opened."""
    if _is_lost():
        raise SpidarError(
            "OpenGL was opened before this process was forked; valid: the start method spawn, or a fork before the "
            "first picture"
        )
    _OPENED.add(os.getpid())


def require_display() -> None:
    """Raise `SpidarError` without a display, because MuJoCo's viewer would end the process."""
    if not has_display():
        named = ", ".join(f"{name}={os.environ[name]!r}" for name in SCREENS if os.environ.get(name))
        raise SpidarError(
            f"no display to open a window on{' by ' * bool(named)}{named}; valid without one: render_mode "
            "rgb_array or depth_array, on the command line `spidar run --out FILE.mp4` or `spidar view --web`"
        )


@contextmanager
def offscreen_library() -> Iterator[None]:
    """Select an OpenGL library without windows for the block (`MissingDependencyError` with what to install).

    Without a display MuJoCo draws with EGL or OSMesa, even if it was imported before this module.
    """
    require_opengl()
    try:
        named = os.environ.get("MUJOCO_GL", "").lower()
        if named not in ("egl", "osmesa") and not has_display():
            if named in ("glfw", "glx"):
                raise no_opengl()
            for library, backend in (("EGL", "egl"), ("OSMesa", "osmesa")):
                if ctypes.util.find_library(library):
                    gl_context.GLContext = importlib.import_module(f"mujoco.{backend}").GLContext
                    break
            else:
                raise no_opengl()
        yield
    except Exception as error:  # each OpenGL binding raises its own errors
        raise no_opengl() from error


def require_pictures() -> None:
    """Open and close an OpenGL context (`MissingDependencyError` if nothing can be drawn)."""
    with _DRAWING.lock, offscreen_library():
        context = gl_context.GLContext(16, 16)
        try:
            context.make_current()
        finally:
            context.free()


def _leave(context: Any) -> None:  # noqa: ANN401 - MuJoCo's, of any library
    """Make no context current on this thread, so that other threads can draw with `context`."""
    library = type(context).__mro__[1].__module__
    if library == "mujoco.egl":
        importlib.import_module(library).EGL.eglReleaseThread()
    elif library == "mujoco.glfw":
        importlib.import_module("glfw").make_context_current(None)


class Drawn:
    """Model and data of a robot on a floor, for drawing."""

    def __init__(
        self, ground: GroundConfig | None, robot: RobotSpec = ROBOT, thing: ObjectConfig | None = None, *, film: bool
    ) -> None:
        """Build the model with a floor, a plane by default, and an object, if there is one.

        `film` selects the look of films and figures.
        """
        ground, thing = ground or GroundConfig(), thing or ObjectConfig()
        self._model = copy.copy(scene(
            visual=True, uneven=ground.uneven, film=film, boxed=ground.boxed, robot=robot, free=thing.exists
        ))  # fmt: skip
        self._data = mujoco.MjData(self._model)
        self.lay(ground, thing)

    def lay(self, ground: GroundConfig, thing: ObjectConfig | None = None) -> None:
        """Replace floor and object by others of the same kind."""
        ground.apply(self._model)
        if thing is not None and thing.exists:
            thing.apply(self._model)

    def _place(self, qpos: np.ndarray) -> None:
        """Set a configuration: bodies, centres of mass, cameras and lights."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)


class OffscreenRenderer(Drawn):
    """Pictures of the robot from one of its cameras."""

    def __init__(
        self, camera: str, width: int, height: int, ground: GroundConfig | None = None, robot: RobotSpec = ROBOT,
        thing: ObjectConfig | None = None,
    ) -> None:  # fmt: skip
        """Open an OpenGL context (`MissingDependencyError` with what to install if there is none)."""
        require_name("camera", camera, CAMERAS)
        if width > MAX_WIDTH or height > MAX_HEIGHT:
            raise SpidarError(f"cannot render {width} × {height}; valid: up to {MAX_WIDTH} × {MAX_HEIGHT}")
        super().__init__(ground, robot, thing, film=False)
        self._camera = mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self._model.camera(camera).id
        _require_here()
        with _DRAWING.lock, offscreen_library():
            self._renderer: Any = mujoco.Renderer(self._model, height, width)
            _leave(self._renderer._gl_context)
        self._options = mujoco.MjvOption()
        self._options.geomgroup[3] = 0

    def render(self, qpos: np.ndarray, *, depth: bool = False) -> np.ndarray:
        """Return a picture (height, width, 3) uint8 of a configuration, or distances (height, width) float32 [m].

        Args:
            qpos: Configuration of the simulated robot.
            depth: Whether to return distances instead of colours.
        """
        _require_here()
        with _DRAWING.lock, self._renderer._gl_context.as_current():
            self._place(qpos)
            if depth:
                self._renderer.enable_depth_rendering()
            # MuJoCo draws infinite planes around the camera position of the previous scene.
            mujoco.mjv_updateCamera(self._model, self._data, self._camera, self._renderer.scene)
            self._renderer.update_scene(self._data, self._camera, self._options)
            image = self._renderer.render().copy()
            if depth:
                self._renderer.disable_depth_rendering()
            return image

    def close(self) -> None:
        """Release the OpenGL context; a second call does nothing."""
        renderer, self._renderer = self._renderer, None
        if renderer is not None and _is_lost():
            _LOST.append(renderer)
        elif renderer is not None:
            with _DRAWING.lock:
                renderer.close()


class Window(Drawn):
    """MuJoCo's interactive viewer, which shows one configuration per `period` [s] of real time."""

    def __init__(
        self, period: float, ground: GroundConfig | None = None, robot: RobotSpec = ROBOT,
        thing: ObjectConfig | None = None,
    ) -> None:  # fmt: skip
        """Open the window (`SpidarError` without a display)."""
        require_display()
        super().__init__(ground, robot, thing, film=True)
        self._period, self._due = period, 0.0
        self._viewer: Any = mujoco.viewer.launch_passive(self._model, self._data, show_left_ui=False)
        self._viewer.opt.geomgroup[3] = 0

    def render(self, qpos: np.ndarray) -> None:
        """Show a configuration; do nothing after the user has closed the window."""
        if not self._viewer.is_running():
            return
        self._data.qpos[:] = qpos
        mujoco.mj_forward(self._model, self._data)
        time.sleep(max(0.0, self._due - time.perf_counter()))
        self._due = max(self._due, time.perf_counter() - self._period) + self._period
        self._viewer.sync()

    def close(self) -> None:
        """Close the window; a second call does nothing."""
        viewer, self._viewer = self._viewer, None
        if viewer is not None:
            viewer.close()
