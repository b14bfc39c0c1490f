"""Rendering of films: antialiased pictures with thrusts and wakes, from a fixed camera or one that follows the robot.

Pictures are mostly drawn by the CPU, and the floor's pixels take the most time. With a fixed camera only the robot and
its shadow change, so that only the part of the picture around them is redrawn.
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
from spidar_gym.robot import N_JOINTS, ROBOT, ROTOR_SITES, RobotSpec
from spidar_gym.robot.description import CAMERAS
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.renderer import Drawn, offscreen_library
from spidar_gym.sim.scene import scene

FIXED = "fixed"
"""Name of the fixed camera, placed to see the whole motion."""
VIEWS = (FIXED, *CAMERAS)
"""Cameras of a film."""
AZIMUTH, ELEVATION = math.radians(68.0), math.radians(-15.0)
"""Viewing direction of the fixed camera [rad]."""
ARROW_COLOR = np.array([0.84, 0.37, 0.0, 1.0], np.float32)
CONTACT_COLOR = np.array([0.0, 0.62, 0.45, 1.0], np.float32)
THRUST_LENGTH, CONTACT_LENGTH = 0.02, 0.012
"""Lengths of the arrows of thrusts and contact forces [m/N]."""
SHORTEST = 0.01
"""Shortest arrow that is drawn; MuJoCo distorts the heads of shorter ones [m]."""
JET_COLOR = (0.25, 0.55, 0.95)
JET_LENGTH, JET_PIECES = 0.75, 3
"""Drawn length of a jet [m], and the number of its pieces."""
ROBOT_QPOS = 7 + 2 * N_JOINTS
"""Numbers of a robot's configuration; those of an object follow."""
FADED, EASE = 0.1, 0.12
"""Opacity of a box between the camera and the robot, and the share by which each picture approaches it."""
MARGIN = 12
"""Margin of the redrawn part around the robot [px]."""


def between(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    """Interpolate between two configurations at a share 0 … 1; attitudes are interpolated by rotation."""
    model = scene(visual=False, free=len(first) > ROBOT_QPOS)
    velocity, found = np.zeros(model.nv), first.copy()
    mujoco.mj_differentiatePos(model, velocity, 1.0, first, second)
    mujoco.mj_integratePos(model, found, velocity, share)
    return found


def cog(qpos: np.ndarray, robot: RobotSpec = ROBOT) -> np.ndarray:
    """Return the robot's centre of gravity in each configuration (n, 39 or 46): (n, 3), world [m]."""
    placed = _placed(scene(visual=False, robot=robot), qpos[:, :ROBOT_QPOS])
    return np.array([data.subtree_com[1].copy() for data in placed])


def extent(qpos: np.ndarray, robot: RobotSpec = ROBOT) -> np.ndarray:
    """Return points (k, 3) that enclose robot, object and the floor below the torso in configurations (n, 39 or 46)."""
    model = scene(visual=True, film=True, robot=robot, free=qpos.shape[1] > ROBOT_QPOS)
    shown = _robot(model)
    reach = model.geom_rbound[shown][:, None]
    found = []
    for data in _placed(model, qpos):
        centres = data.geom_xpos[shown]
        found += [(centres - reach).min(axis=0), (centres + reach).max(axis=0)]
        found += [*centres, np.array([*data.qpos[:2], 0.0])]
    return np.array(found)


def _placed(model: mujoco.MjModel, qpos: np.ndarray) -> Iterator[mujoco.MjData]:
    """Yield MuJoCo's data with bodies and centre of gravity of each configuration; the object is reused."""
    data = mujoco.MjData(model)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        yield data


def standing(points: np.ndarray, aspect: float, window: tuple[float, float, float, float]) -> mujoco.MjvCamera:
    """Return the nearest fixed camera that sees points (n, 3) [m] within a window of its picture.

    Args:
        points: Points to be seen.
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
        # A point at depth e is in the window if its place lies within low … high times e + the distance.
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


def hidden(
    eye: np.ndarray, points: np.ndarray, centre: np.ndarray, axes: np.ndarray, half: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Return which boxes (k,) are between an eye (3,) and any of some points (n, 3), world [m].

    Args:
        eye: Position of the camera.
        points: Points that may be hidden.
        centre: Centres of the boxes (k, 3).
        axes: Axes of the boxes as columns (k, 3, 3).
        half: Half sizes of the boxes (k, 3) [m].
    """
    start = np.einsum("kji,kj->ki", axes, eye - centre)[:, None]
    way = np.einsum("kji,nj->kni", axes, points - eye)
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = np.stack(((-half[:, None] - start) / way, (half[:, None] - start) / way))
    enters, leaves = np.nanmax(bounds.min(axis=0), axis=2), np.nanmin(bounds.max(axis=0), axis=2)
    return ((enters < np.minimum(leaves, 1.0)) & (leaves > 0.0)).any(axis=1)


def _robot(model: mujoco.MjModel) -> np.ndarray:
    """Return the indices of the geoms that are drawn and move."""
    return np.flatnonzero((model.geom_bodyid > 0) & (model.geom_group != 3))


class Stage(Drawn):
    """Pictures of the robot, `width` × `height`, from one camera."""

    def __init__(
        self, camera: str | mujoco.MjvCamera, width: int, height: int, ground: GroundConfig | None = None,
        robot: RobotSpec = ROBOT, thing: ObjectConfig | None = None,
    ) -> None:  # fmt: skip
        """Open an OpenGL context (`MissingDependencyError` with what to install if there is none).

        Args:
            camera: A fixed camera (see `standing`), or the name of one that follows the robot.
            width: Width of the pictures [px].
            height: Height of the pictures [px].
            ground: The floor; a plane by default.
            robot: The robot.
            thing: The object, if there is one.
        """
        super().__init__(ground, robot, thing, film=True)
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
        self._boxes = np.flatnonzero(
            (self._model.geom_bodyid == 0) & (self._model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
        )
        self._opacity: dict[int, float] = {}

    def render(
        self,
        qpos: np.ndarray,
        *,
        thrust: np.ndarray | None = None,
        contacts: np.ndarray | None = None,
        whole: bool = False,
    ) -> np.ndarray:
        """Return a picture (height, width, 3) uint8 of a configuration.

        Args:
            qpos: Configuration of the simulated robot.
            thrust: Thrusts (8,) [N] to draw as arrows, with their jets.
            contacts: Points and forces of the floor (k, 6) [m, N] to draw as arrows.
            whole: Whether to redraw the whole picture.
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
        """Release the OpenGL context; a second call does nothing."""
        gl, self._gl = self._gl, None
        if gl is not None:
            gl.make_current()
            self._context.free()
            gl.free()

    def _update(self, categories: Any) -> None:  # noqa: ANN401 - MuJoCo's enumeration
        mujoco.mjv_updateScene(
            self._model, self._data, self._options, None, self._camera, categories.value, self._picture
        )
        if not self._stands:
            self._fade()
        if self._level:
            return
        # Away from z = 0, rounding puts the floor below its depth in the shadow map: it would shadow itself.
        for geom in (self._picture.geoms[k] for k in range(self._picture.ngeom)):
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and self._model.geom_bodyid[geom.objid] == 0:
                geom.category = mujoco.mjtCatBit.mjCAT_DECOR  # drawn without casting a shadow

    def _fade(self) -> None:
        """Gradually make boxes of a course transparent while they hide the robot from a following camera."""
        if not len(self._boxes):
            return
        eyes = self._picture.camera
        eye = (np.array(eyes[0].pos) + np.array(eyes[1].pos)) / 2.0
        hides = hidden(
            eye, self._data.geom_xpos[self._shown], self._data.geom_xpos[self._boxes],
            self._data.geom_xmat[self._boxes].reshape(-1, 3, 3), self._model.geom_size[self._boxes],
        )  # fmt: skip
        for box, hide in zip(self._boxes.tolist(), hides.tolist(), strict=True):
            wanted = FADED if hide else 1.0
            before = self._opacity.get(box, wanted)  # the first picture begins with what is wanted
            self._opacity[box] = before + EASE * (wanted - before)
        for geom in (self._picture.geoms[k] for k in range(self._picture.ngeom)):
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and geom.objid in self._opacity:
                geom.rgba[3] *= self._opacity[geom.objid]

    def _part(self, balls: np.ndarray) -> tuple[int, int, int, int]:
        """Return the bounds left, low, right, top [px, from below] of balls (n, 4) and their shadows on the floor."""
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
        # Perspective elongates a ball away from the centre of the picture.
        reach = 1.15 * scale * balls[:, 3] + MARGIN
        left, low = int(max(0.0, (x - reach).min())), int(max(0.0, (y - reach).min()))
        right, top = int(min(width, (x + reach).max())), int(min(height, (y + reach).max()))
        # OpenGL needs at least one pixel, even if the robot is out of sight.
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
        """Draw an arrow and two jets, as wide as their half-speed radius; return balls that enclose them."""
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
        """Add a shape to the scene, unless the scene is full."""
        picture = self._picture
        if picture.ngeom >= picture.maxgeom:
            return
        geom = picture.geoms[picture.ngeom]
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), color)
        mujoco.mjv_connector(geom, kind, radius, start, end)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR  # without shadows
        picture.ngeom += 1
