"""Films the robot: antialiased pictures with thrusts and wakes, from a camera that stands still or follows.

Pictures are mostly drawn by the processor, the floor's pixels cost most, and before a camera that stands still nothing
changes but the robot and its shadow: only the part of the picture that holds them is drawn anew.
"""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import math
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from mujoco.rendering.classic import gl_context

from spidar_gym.errors import require_name
from spidar_gym.robot import ROBOT, ROTOR_SITES, RobotSpec
from spidar_gym.robot.description import CAMERAS
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.renderer import Drawn, offscreen_library
from spidar_gym.sim.scene import scene

FIXED = "fixed"
"""Name of the camera that stands where it sees the whole way."""
VIEWS = (FIXED, *CAMERAS)
"""Cameras of a film."""
AZIMUTH, ELEVATION = math.radians(68.0), math.radians(-15.0)
"""Where the camera that stands still looks."""
ARROW_COLOR = np.array([0.84, 0.37, 0.0, 1.0], np.float32)
CONTACT_COLOR = np.array([0.0, 0.62, 0.45, 1.0], np.float32)
THRUST_LENGTH, CONTACT_LENGTH = 0.02, 0.012
"""Lengths of the arrows of thrusts and contact forces [m/N]."""
SHORTEST = 0.01
"""Arrows that would be shorter are left out: their heads would be drawn askew [m]."""
JET_COLOR = (0.25, 0.55, 0.95)
JET_LENGTH, JET_PIECES = 0.75, 3
"""How far a jet is drawn [m], and in how many pieces."""
MARGIN = 12
"""What is drawn anew goes so far beyond the robot [px]."""


def between(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    """The configuration at a share 0 … 1 of the way from one to another: attitudes turn, they are not averaged."""
    model = scene(visual=False)
    velocity, found = np.zeros(model.nv), first.copy()
    mujoco.mj_differentiatePos(model, velocity, 1.0, first, second)
    mujoco.mj_integratePos(model, found, velocity, share)
    return found


def cog(qpos: np.ndarray, robot: RobotSpec = ROBOT) -> np.ndarray:
    """Centre of gravity in each configuration (n, 39): (n, 3), world [m]."""
    return np.array([data.subtree_com[1].copy() for data in _placed(scene(visual=False, robot=robot), qpos)])


def extent(qpos: np.ndarray, robot: RobotSpec = ROBOT) -> np.ndarray:
    """Points (k, 3) round the robot in some configurations (n, 39), and on the floor under its torso [m]."""
    model = scene(visual=True, film=True, robot=robot)
    shown = _robot(model)
    reach = model.geom_rbound[shown][:, None]
    found = []
    for data in _placed(model, qpos):
        centres = data.geom_xpos[shown]
        found += [(centres - reach).min(axis=0), (centres + reach).max(axis=0)]
        found += [*centres, np.array([*data.qpos[:2], 0.0])]
    return np.array(found)


def _placed(model: mujoco.MjModel, qpos: np.ndarray) -> Iterator[mujoco.MjData]:
    """Bodies and centre of gravity of each configuration, in the same data."""
    data = mujoco.MjData(model)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        yield data


def standing(points: np.ndarray, aspect: float, window: tuple[float, float, float, float]) -> mujoco.MjvCamera:
    """The nearest camera that sees points (n, 3) [m] within a window of its picture.

    Args:
        points: What it must see.
        aspect: Width over height of the picture.
        window: Left, right, bottom, top of the window as shares of the picture, from its lower left corner.
    """
    ahead = np.array([
        math.cos(ELEVATION) * math.cos(AZIMUTH), math.cos(ELEVATION) * math.sin(AZIMUTH), math.sin(ELEVATION)
    ])  # fmt: skip
    right = np.array([math.sin(AZIMUTH), -math.cos(AZIMUTH), 0.0])
    up = np.cross(right, ahead)
    centre = points.mean(axis=0)
    depth = (points - centre) @ ahead
    slope = math.tan(math.radians(scene(visual=True, film=True).vis.global_.fovy) / 2.0)
    bounds = []
    for axis, half, low, high in ((right, slope * aspect, *window[:2]), (up, slope, *window[2:])):
        # A point at depth e is in the window where its place lies within low … high times e + the distance.
        low, high = half * (2.0 * low - 1.0), half * (2.0 * high - 1.0)
        place = (points - centre) @ axis
        bounds.append(((place - low * depth).min(), (place - high * depth).max(), low, high))
    distance = max((last - first) / (high - low) for first, last, low, high in bounds)
    shift = [(first - low * distance + last - high * distance) / 2.0 for first, last, low, high in bounds]
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation = math.degrees(AZIMUTH), math.degrees(ELEVATION)
    camera.lookat[:] = centre + shift[0] * right + shift[1] * up
    camera.distance = distance
    return camera


def _robot(model: mujoco.MjModel) -> np.ndarray:
    """Which geoms are drawn and move."""
    return np.flatnonzero((model.geom_bodyid > 0) & (model.geom_group != 3))


class Stage(Drawn):
    """Pictures of the robot, `width` × `height`, from one camera."""

    def __init__(
        self, camera: str | mujoco.MjvCamera, width: int, height: int, ground: GroundConfig | None = None,
        robot: RobotSpec = ROBOT,
    ) -> None:  # fmt: skip
        """Open an OpenGL context over a floor (`MissingDependencyError` says what to install where there is none).

        Args:
            camera: One that stands (see `standing`), or the name of one that follows the robot.
            width: Of the pictures [px].
            height: … [px].
            ground: The floor.
            robot: Which robot it is.
        """
        super().__init__(ground, robot, film=True)
        self._robot = robot
        self._size = width, height
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        self._camera, self._stands = camera, not isinstance(camera, str)
        if isinstance(camera, str):
            require_name("camera", camera, CAMERAS)
            self._camera = mujoco.MjvCamera()
            self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._camera.fixedcamid = self._model.camera(camera).id
        with offscreen_library():
            self._gl: Any = gl_context.GLContext(width, height)
            self._gl.make_current()
            self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._picture = mujoco.MjvScene(self._model, maxgeom=2000)
        self._options = mujoco.MjvOption()
        self._options.geomgroup[3] = 0
        self._rotors = [self._model.site(name).id for name in ROTOR_SITES]
        self._shown = _robot(self._model)
        self._level = ground is None or not (ground.uneven or ground.boxed or ground.slope)
        self._empty: np.ndarray | None = None

    def render(
        self,
        qpos: np.ndarray,
        *,
        thrust: np.ndarray | None = None,
        contacts: np.ndarray | None = None,
        whole: bool = False,
    ) -> np.ndarray:
        """Picture (height, width, 3) uint8 of a configuration.

        Args:
            qpos: Configuration of the simulated robot.
            thrust: Thrusts (8,) [N] to draw as arrows, with the jets that they blow.
            contacts: Points and forces of the floor (k, 6) [m, N] to draw as arrows.
            whole: Draw all of it anew, also where nothing moves.
        """
        self._gl.make_current()
        self._place(qpos)
        if self._stands and not whole and self._empty is None:
            self._update(mujoco.mjtCatBit.mjCAT_STATIC)
            self._empty = self._draw((0, 0, *self._size))
        self._update(mujoco.mjtCatBit.mjCAT_ALL)
        balls = [np.column_stack((self._data.geom_xpos[self._shown], self._model.geom_rbound[self._shown]))]
        if thrust is not None:
            balls += [self._draw_thrust(site, newtons) for site, newtons in zip(self._rotors, thrust, strict=True)]
        for row in () if contacts is None else contacts:
            end = row[:3] + CONTACT_LENGTH * row[3:]
            self._add_arrow(0.012, row[:3], end, CONTACT_COLOR)
            balls.append(np.array([[*row[:3], 0.03], [*end, 0.03]]))
        if self._empty is None or whole:
            return self._draw((0, 0, *self._size))
        left, low, right, top = part = self._part(np.concatenate(balls))
        image = self._empty.copy()
        height = self._size[1]
        image[height - top : height - low, left:right] = self._draw(part)
        return image

    def close(self) -> None:
        """Give the OpenGL context back; a second call does nothing."""
        gl, self._gl = self._gl, None
        if gl is not None:
            gl.make_current()
            self._context.free()
            gl.free()

    def _update(self, categories: Any) -> None:  # noqa: ANN401 - MuJoCo's enumeration
        mujoco.mjv_updateScene(
            self._model, self._data, self._options, None, self._camera, categories.value, self._picture
        )
        if self._level:
            return
        # Away from z = 0 the floor is, by rounding, deeper than in the shadow map, and would lie in its own shadow.
        for geom in (self._picture.geoms[k] for k in range(self._picture.ngeom)):
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and self._model.geom_bodyid[geom.objid] == 0:
                geom.category = mujoco.mjtCatBit.mjCAT_DECOR  # it is drawn, and throws no shadow

    def _part(self, balls: np.ndarray) -> tuple[int, int, int, int]:
        """Left, low, right, top [px, from below] of what holds balls (n, 4) and their shadows on the floor."""
        floor = self._model.geom("floor").id
        normal, light = self._data.geom_xmat[floor].reshape(3, 3)[:, 2], self._data.light_xdir[0]
        falls = (balls[:, :3] - self._data.geom_xpos[floor]) @ normal / (light @ normal)
        shadows = balls.copy()
        shadows[:, :3] -= falls[:, None] * light
        balls = np.concatenate((balls, shadows))
        eye = self._picture.camera[0]
        ahead, up = np.array(eye.forward), np.array(eye.up)
        seen = balls[:, :3] - (np.array(self._picture.camera[0].pos) + np.array(self._picture.camera[1].pos)) / 2.0
        width, height = self._size
        scale = height * eye.frustum_near / (eye.frustum_top - eye.frustum_bottom) / np.maximum(seen @ ahead, 0.1)
        x, y = width / 2 + scale * (seen @ np.cross(ahead, up)), height / 2 + scale * (seen @ up)
        # A ball away from the middle looks a little longer than wide.
        reach = 1.15 * scale * balls[:, 3] + MARGIN
        left, low = int(max(0.0, (x - reach).min())), int(max(0.0, (y - reach).min()))
        right, top = int(min(width, (x + reach).max())), int(min(height, (y + reach).max()))
        # Out of sight there is nothing to draw, but OpenGL wants a pixel.
        left, low = min(left, width - 1), min(low, height - 1)
        return left, low, max(right, left + 1), max(top, low + 1)

    def _draw(self, part: tuple[int, int, int, int]) -> np.ndarray:
        """Draw a part of the picture: left, low, right, top [px, from below]."""
        left, low, right, top = part
        width, height = self._size
        for eye in self._picture.camera:
            bottom, tall = eye.frustum_bottom, eye.frustum_top - eye.frustum_bottom
            half = tall * width / height / 2.0
            eye.frustum_center = half * ((left + right) / width - 1.0)
            eye.frustum_width = half * (right - left) / width
            eye.frustum_bottom, eye.frustum_top = bottom + tall * low / height, bottom + tall * top / height
        view = mujoco.MjrRect(0, 0, right - left, top - low)
        image = np.empty((view.height, view.width, 3), np.uint8)
        mujoco.mjr_render(view, self._picture, self._context)
        mujoco.mjr_readPixels(image, None, view, self._context)
        return image[::-1]

    def _draw_thrust(self, site: int, newtons: float) -> np.ndarray:
        """An arrow, and below it the two jets, each as wide as where it blows half as fast; balls that hold them."""
        frame = self._data.site_xmat[site].reshape(3, 3)
        centre, side, up = self._data.site_xpos[site], frame[:, 1], frame[:, 2]
        tip = centre + THRUST_LENGTH * newtons * up
        self._add_arrow(0.02, centre, tip, ARROW_COLOR)
        speed = math.sqrt(max(newtons, 0.0) / self._robot.hover_thrust)
        balls = [[*tip, 0.05]]
        for y in (self._robot.duct_offset_y, -self._robot.duct_offset_y):
            exit_ = centre + y * side + self._robot.duct_z[0] * up
            balls.append([*(exit_ - JET_LENGTH * up), 0.15 * JET_LENGTH])
            for k in range(JET_PIECES):
                near, far = JET_LENGTH * k / JET_PIECES, JET_LENGTH * (k + 1) / JET_PIECES
                radius = max(self._robot.propeller_radius, 0.15 * near)
                color = np.array([*JET_COLOR, 0.16 * min(speed, 1.5) * (1.0 - near / JET_LENGTH)], np.float32)
                if float(exit_[2] - far * up[2]) > 0.0:
                    self._add(mujoco.mjtGeom.mjGEOM_CYLINDER, radius, exit_ - near * up, exit_ - far * up, color)
        return np.array(balls)

    def _add_arrow(self, radius: float, start: np.ndarray, end: np.ndarray, color: np.ndarray) -> None:
        if np.linalg.norm(end - start) >= SHORTEST:
            self._add(mujoco.mjtGeom.mjGEOM_ARROW, radius, start, end, color)

    def _add(self, kind: Any, radius: float, start: np.ndarray, end: np.ndarray, color: np.ndarray) -> None:  # noqa: ANN401 - MuJoCo's enumeration
        """One more shape in the scene that is about to be drawn, if there is room."""
        picture = self._picture
        if picture.ngeom >= picture.maxgeom:
            return
        geom = picture.geoms[picture.ngeom]
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), color)
        mujoco.mjv_connector(geom, kind, radius, start, end)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR  # otherwise it throws shadows
        picture.ngeom += 1
