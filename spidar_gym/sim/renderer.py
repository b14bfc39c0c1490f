"""Draws the robot: off-screen pictures and depth images, or MuJoCo's window."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import copy
import ctypes.util
import importlib
import math
import os
import sys
import time
from typing import Any

import mujoco
import mujoco.viewer
import numpy as np
from mujoco.rendering.classic import gl_context

from spidar_gym.description import CAMERAS
from spidar_gym.errors import MissingDependencyError, SpidarError, UnknownNameError
from spidar_gym.robot import ROBOT, ROTOR_SITES
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.scene import MAX_HEIGHT, MAX_WIDTH, scene

ARROW_COLOR = np.array([0.85, 0.25, 0.10, 1.0], np.float32)
CONTACT_COLOR = np.array([0.10, 0.55, 0.25, 1.0], np.float32)
CONTACT_LENGTH = 0.012
"""Length of a contact force's arrow [m/N]."""
JET_COLOR = (0.25, 0.55, 0.95)
JET_LENGTH, JET_PIECES = 0.75, 3
"""How far a jet is drawn [m], and in how many pieces."""
INSTALL_GL = "apt-get install libegl1 libgl1 (then MUJOCO_GL=egl), or libosmesa6 (then MUJOCO_GL=osmesa)"


def has_display() -> bool:
    """Whether there is a screen to open windows on."""
    return sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys())


def require_display() -> None:
    """Refuse to go on without a screen: MuJoCo's viewer would end the whole process."""
    if not has_display():
        raise SpidarError("no display to open a window on; valid without one: render_mode rgb_array or depth_array")


def _choose_offscreen_library() -> None:
    """Without a screen, have MuJoCo draw with EGL or OSMesa, also where it was imported before anyone could say so."""
    if has_display() or "MUJOCO_GL" in os.environ:
        return
    for library, backend in (("EGL", "egl"), ("OSMesa", "osmesa")):
        if ctypes.util.find_library(library):
            gl_context.GLContext = importlib.import_module(f"mujoco.{backend}").GLContext
            return


class OffscreenRenderer:
    """Pictures of the robot from one of its cameras."""

    def __init__(
        self, camera: str = "chase", width: int = 640, height: int = 480, ground: GroundConfig | None = None
    ) -> None:
        """Open an OpenGL context over a floor (`MissingDependencyError` says what to install where there is none)."""
        if camera not in CAMERAS:
            raise UnknownNameError("camera", camera, CAMERAS)
        self._camera = camera
        ground = ground or GroundConfig()
        self._model = copy.copy(scene(visual=True, uneven=ground.uneven))
        ground.apply(self._model)
        self._data = mujoco.MjData(self._model)
        try:
            _choose_offscreen_library()
            self._renderer: Any = mujoco.Renderer(self._model, height, width)
        except ValueError as error:
            raise SpidarError(f"cannot render {width} × {height}; valid: up to {MAX_WIDTH} × {MAX_HEIGHT}") from error
        except Exception as error:  # every OpenGL binding fails in its own way, and all mean the same here
            raise MissingDependencyError("an OpenGL library", INSTALL_GL) from error
        self._options = mujoco.MjvOption()
        self._options.geomgroup[3] = 0
        self._rotors = [self._model.site(name).id for name in ROTOR_SITES]

    def render(
        self,
        qpos: np.ndarray,
        *,
        depth: bool = False,
        thrust: np.ndarray | None = None,
        contacts: np.ndarray | None = None,
    ) -> np.ndarray:
        """Picture (height, width, 3) uint8 of a configuration, or distances (height, width) float32 [m].

        Args:
            qpos: Configuration of the simulated robot.
            depth: Distances instead of colours.
            thrust: Thrusts (8,) [N] to draw as arrows, with the jets that they blow.
            contacts: Points and forces of the floor (k, 6) [m, N] to draw as arrows.
        """
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        if depth:
            self._renderer.enable_depth_rendering()
        self._renderer.update_scene(self._data, self._camera, self._options)
        if thrust is not None:
            for site, newtons in zip(self._rotors, thrust.tolist(), strict=True):
                self._draw_thrust(site, newtons)
        for row in () if contacts is None else contacts:
            arrow = mujoco.mjtGeom.mjGEOM_ARROW
            self._add(arrow, 0.012, row[:3], row[:3] + CONTACT_LENGTH * row[3:], CONTACT_COLOR)
        image = self._renderer.render().copy()
        if depth:
            self._renderer.disable_depth_rendering()
        return image

    def lay(self, ground: GroundConfig) -> None:
        """Draw another floor of the same kind from now on."""
        ground.apply(self._model)

    def _draw_thrust(self, site: int, newtons: float) -> None:
        """An arrow of 2 cm a newton, and below it the two jets, each as wide as where it blows half as fast."""
        frame = self._data.site_xmat[site].reshape(3, 3)
        centre, side, up = self._data.site_xpos[site], frame[:, 1], frame[:, 2]
        self._add(mujoco.mjtGeom.mjGEOM_ARROW, 0.02, centre, centre + 0.02 * newtons * up, ARROW_COLOR)
        speed = math.sqrt(max(newtons, 0.0) / ROBOT.hover_thrust)
        for y in (ROBOT.duct_offset_y, -ROBOT.duct_offset_y):
            exit_ = centre + y * side + ROBOT.duct_z[0] * up
            for k in range(JET_PIECES):
                near, far = JET_LENGTH * k / JET_PIECES, JET_LENGTH * (k + 1) / JET_PIECES
                radius = max(ROBOT.propeller_radius, 0.15 * near)
                color = np.array([*JET_COLOR, 0.16 * min(speed, 1.5) * (1.0 - near / JET_LENGTH)], np.float32)
                floor = float(exit_[2] - far * up[2])
                if floor > 0.0:
                    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
                    self._add(cylinder, radius, exit_ - near * up, exit_ - far * up, color)

    def _add(self, kind: Any, radius: float, start: np.ndarray, end: np.ndarray, color: np.ndarray) -> None:  # noqa: ANN401 - MuJoCo's enumeration
        """One more shape in the scene that is about to be drawn, if there is room."""
        picture = self._renderer.scene
        if picture.ngeom >= picture.maxgeom:
            return
        geom = picture.geoms[picture.ngeom]
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), color)
        mujoco.mjv_connector(geom, kind, radius, start, end)
        picture.ngeom += 1

    def close(self) -> None:
        """Give the OpenGL context back; a second call does nothing."""
        renderer, self._renderer = self._renderer, None
        if renderer is not None:
            renderer.close()


class Window:
    """MuJoCo's interactive viewer, which shows one configuration a `period` [s] of real time."""

    def __init__(self, period: float, ground: GroundConfig | None = None) -> None:
        """Open the window over a floor (`SpidarError` where there is no screen)."""
        self._period, self._due = period, 0.0
        require_display()
        ground = ground or GroundConfig()
        self._model = copy.copy(scene(visual=True, uneven=ground.uneven))
        ground.apply(self._model)
        self._data = mujoco.MjData(self._model)
        self._viewer: Any = mujoco.viewer.launch_passive(self._model, self._data, show_left_ui=False)
        self._viewer.opt.geomgroup[3] = 0

    def lay(self, ground: GroundConfig) -> None:
        """Draw another floor of the same kind from now on."""
        ground.apply(self._model)

    def render(self, qpos: np.ndarray) -> None:
        """Show a configuration; nothing happens any more once the user has closed the window."""
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
