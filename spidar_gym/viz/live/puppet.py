"""The robot as meshes: its parts and their poses, and the arrows and jets of its rotors; needs no browser."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import math
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from spidar_gym.robot import N_ROTORS, ROBOT, ROTOR_SITES
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.renderer import Drawn
from spidar_gym.sim.stage import CONTACT_LENGTH, JET_LENGTH, SHORTEST, THRUST_LENGTH
from spidar_gym.so3 import quat_to_matrix

SIDES, RINGS = 20, 10
"""Faces of a round shape around its axis, and rings of vertices from pole to pole."""
JETS = 2 * N_ROTORS
"""Number of jets, one below each duct."""
JET_SPREAD = 0.15
"""Radius over length of a jet, with the radius at which the speed is half that on the axis."""
JET_OPACITY = 0.12
"""Opacity of a hovering rotor's jet."""
MOST_CONTACTS = 32
"""Largest number of contact forces that are shown."""
OUT_OF_SIGHT = np.array([0.0, 0.0, -100.0])
"""Position of arrows that are not shown [m]."""


@dataclass(frozen=True)
class Mesh:
    """Vertices (n, 3) [m], triangles (m, 3), and the colour of each vertex (n, 4) in 0 … 255."""

    vertices: np.ndarray
    faces: np.ndarray
    colors: np.ndarray


@dataclass(frozen=True)
class Part:
    """Bodies with the same mesh."""

    name: str
    """Name of the first body."""
    mesh: Mesh
    """Mesh in the body's axes."""
    bodies: np.ndarray
    """Numbers of the bodies."""


class Puppet(Drawn):
    """The robot over a floor, as meshes."""

    def __init__(self, ground: GroundConfig | None, thing: ObjectConfig | None = None) -> None:
        """Build the robot over a floor, which is a plane by default, with an object, if there is one."""
        super().__init__(ground, thing=thing, film=True)
        self._has_thing = thing is not None and thing.exists
        self.parts = tuple(self._parts())
        """Parts of the robot."""
        self._rotors = [self._model.site(name).id for name in ROTOR_SITES]
        self._thrust = np.zeros(N_ROTORS)

    def place(self, qpos: np.ndarray, thrust: np.ndarray) -> None:
        """Set the configuration, (39,) or with an object (46,), and the rotors' thrusts (8,) [N]."""
        self._place(qpos)
        self._thrust = thrust

    def poses(self, part: Part) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (k, 3) [m] and quaternions (w, x, y, z) (k, 4) of a part's bodies."""
        return self._data.xpos[part.bodies].copy(), self._data.xquat[part.bodies].copy()

    @property
    def com(self) -> np.ndarray:
        """The robot's centre of gravity (3,) [m]."""
        return self._data.subtree_com[1].copy()

    def arrows(self) -> np.ndarray:
        """Return start and end of each thrust's arrow (8, 2, 3) [m]."""
        centres, frames = self._rotor_frames()
        return arrows(centres, THRUST_LENGTH * self._thrust[:, None] * frames[:, :, 2])

    def jets(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the jets' exits (16, 3) [m], quaternions with z along the jet (16, 4), and lengths (16,) [m].

        A jet points against the thrust and ends on the floor.
        """
        centres, frames = self._rotor_frames()
        away = np.array([ROBOT.duct_offset_y, -ROBOT.duct_offset_y])
        exits = centres[:, None] + away[:, None] * frames[:, None, :, 1] + ROBOT.duct_z[0] * frames[:, None, :, 2]
        exits = exits.reshape(JETS, 3)
        quats = np.zeros((N_ROTORS, 4))
        # Half a turn about the rotor's x axis makes z point along the jet.
        turned = frames * np.array([1.0, -1.0, -1.0])
        for quat, frame in zip(quats, turned.reshape(-1, 9), strict=True):
            mujoco.mju_mat2Quat(quat, frame)
        floor = self._model.geom("floor").id
        normal = self._data.geom_xmat[floor].reshape(3, 3)[:, 2]
        falls = np.repeat(frames[:, :, 2] @ normal, 2)
        height = (exits - self._data.geom_xpos[floor]) @ normal
        lengths = np.where(falls > 0.0, np.minimum(JET_LENGTH, height / np.maximum(falls, 1e-3)), JET_LENGTH)
        return exits, np.repeat(quats, 2, axis=0), np.maximum(lengths, 1e-3)

    def jet_opacities(self) -> np.ndarray:
        """Return the opacity of each jet (16,), 0 … 1, in proportion to its speed."""
        return np.repeat(JET_OPACITY * np.minimum(np.sqrt(np.maximum(self._thrust, 0.0) / ROBOT.hover_thrust), 1.5), 2)

    def floor(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the pose of the floor's plane: position (3,) [m], quaternion (4,)."""
        geom = self._model.geom("floor").id
        return self._model.geom_pos[geom].copy(), self._model.geom_quat[geom].copy()

    def blocks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return tiles and boxes: positions (n, 3) [m], quaternions (n, 4), edges (n, 3) [m], colours (n, 3)."""
        model = self._model
        is_block = (model.geom_bodyid == 0) & (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
        some = np.flatnonzero(is_block & (model.geom_pos[:, 2] > -10.0))  # unused boxes lie far below the floor
        colors = (255.0 * model.geom_rgba[some, :3]).astype(np.uint8)
        return model.geom_pos[some].copy(), model.geom_quat[some].copy(), 2.0 * model.geom_size[some], colors

    @property
    def thing(self) -> Part | None:
        """The object with its present shape; None without one."""
        if not self._has_thing:
            return None
        geom, body = self._model.geom("object").id, self._model.body("object").id
        return Part("object", self._geom(geom), np.array([body]))

    def _rotor_frames(self) -> tuple[np.ndarray, np.ndarray]:
        return self._data.site_xpos[self._rotors], self._data.site_xmat[self._rotors].reshape(-1, 3, 3)

    def _parts(self) -> Iterator[Part]:
        model, alike = self._model, dict[bytes, tuple[Mesh, list[int]]]()
        for body in range(1, model.nbody - self._has_thing):  # the object's body is the last one
            geoms = np.flatnonzero((model.geom_bodyid == body) & (model.geom_group != 3))
            if not geoms.size:
                continue
            mesh = merged([self._geom(geom) for geom in geoms.tolist()])
            key = mesh.vertices.round(6).tobytes() + mesh.colors.tobytes()
            alike.setdefault(key, (mesh, []))[1].append(body)
        for mesh, bodies in alike.values():
            yield Part(model.body(bodies[0]).name, mesh, np.array(bodies))

    def _geom(self, geom: int) -> Mesh:
        """Return the mesh of a geom in its body's axes, with its colour."""
        model, kind = self._model, mujoco.mjtGeom(self._model.geom_type[geom])
        vertices, faces = _SHAPES[kind](model.geom_size[geom])
        material = model.geom_matid[geom]
        rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        turned = vertices @ quat_to_matrix(model.geom_quat[geom]).T + model.geom_pos[geom]
        return Mesh(turned, faces, np.tile((255.0 * rgba).astype(np.uint8), (len(vertices), 1)))


def arrows(points: np.ndarray, vectors: np.ndarray, count: int = 0) -> np.ndarray:
    """Return starts and ends of at least `count` arrows (n, 2, 3); arrows below a least length are out of sight."""
    found = np.broadcast_to(OUT_OF_SIGHT, (max(count, len(points)), 2, 3)).copy()
    long = np.flatnonzero(np.linalg.norm(vectors, axis=1) >= SHORTEST)
    found[long, 0], found[long, 1] = points[long], points[long] + vectors[long]
    return found


def contact_arrows(contacts: np.ndarray) -> np.ndarray:
    """Return the arrows of contact points and forces (k, 6) [m, N], padded to a fixed number (32, 2, 3)."""
    contacts = contacts[:MOST_CONTACTS]
    return arrows(contacts[:, :3], CONTACT_LENGTH * contacts[:, 3:], MOST_CONTACTS)


def jet_mesh() -> tuple[np.ndarray, np.ndarray]:
    """Build the mesh of an open jet of length 1 along z: as wide as the propeller at its exit, wider at its end [m]."""
    angles = np.linspace(0.0, math.tau, SIDES, endpoint=False)
    ring = np.column_stack((np.cos(angles), np.sin(angles)))
    near, far = ROBOT.propeller_radius, max(ROBOT.propeller_radius, JET_SPREAD * JET_LENGTH)
    rows = [np.column_stack((radius * ring, np.full(SIDES, z))) for radius, z in ((near, 0.0), (far, 1.0))]
    return np.vstack(rows), _strip(2)


def merged(meshes: list[Mesh]) -> Mesh:
    """Merge several meshes into one."""
    shifts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        np.vstack([mesh.vertices for mesh in meshes]),
        np.vstack([mesh.faces + shift for mesh, shift in zip(meshes, shifts.tolist(), strict=True)]),
        np.vstack([mesh.colors for mesh in meshes]),
    )


def _strip(rings: int) -> np.ndarray:
    """Return triangles between rings of `SIDES` vertices; they face outward where the rings are ordered along z."""
    faces = []
    for ring in range(rings - 1):
        a = ring * SIDES + np.arange(SIDES)
        b = ring * SIDES + (np.arange(SIDES) + 1) % SIDES
        faces += [np.column_stack((a, b, b + SIDES)), np.column_stack((a, b + SIDES, a + SIDES))]
    return np.vstack(faces)


def _turned(profile: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Build a body of revolution about z from its profile: radius and height of each ring (n, 2)."""
    angles = np.linspace(0.0, math.tau, SIDES, endpoint=False)
    rings = [np.column_stack((r * np.cos(angles), r * np.sin(angles), np.full(SIDES, z))) for r, z in profile]
    return np.vstack(rings), _strip(len(rings))


def _box(size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Build a box whose faces share no vertices, so that its edges are sharp."""
    vertices, faces = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            corners = [(-u - v), (u - v), (u + v), (-u + v)]
            vertices += [size * (sign * np.eye(3)[axis] + corner) for corner in corners]
            quad = len(vertices) - 4 + np.array([[0, 1, 2], [0, 2, 3]])
            faces += [*(quad if sign > 0.0 else quad[:, ::-1])]
    return np.array(vertices), np.array(faces)


def _cylinder(size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Build a cylinder whose side and ends share no vertices, so that its edges are sharp."""
    radius, half = float(size[0]), float(size[1])
    parts = [
        _turned(np.array(profile))
        for profile in (
            [(0.0, -half), (radius, -half)], [(radius, -half), (radius, half)], [(radius, half), (0.0, half)]
        )
    ]  # fmt: skip
    shift = len(parts[0][0])
    return np.vstack([vertices for vertices, _ in parts]), np.vstack([f + k * shift for k, (_, f) in enumerate(parts)])


def _sphere(size: np.ndarray, half: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Build a sphere, an ellipsoid, or, with its halves shifted by `half` up and down, a capsule."""
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, RINGS)  # an even number: no ring lies in the middle
    vertices, faces = _turned(np.column_stack((np.cos(angles), np.sin(angles))))
    shift = np.repeat(np.where(angles > 0.0, half, -half), SIDES)
    vertices = vertices * size
    vertices[:, 2] += shift
    return vertices, faces


_SHAPES = {
    mujoco.mjtGeom.mjGEOM_BOX: _box,
    mujoco.mjtGeom.mjGEOM_CYLINDER: _cylinder,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: _sphere,
    mujoco.mjtGeom.mjGEOM_SPHERE: lambda size: _sphere(np.full(3, size[0])),
    mujoco.mjtGeom.mjGEOM_CAPSULE: lambda size: _sphere(np.full(3, size[0]), float(size[1])),
}
