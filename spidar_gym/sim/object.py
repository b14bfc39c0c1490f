"""Parameters of a free object beside the robot, and the patches of its surface; native/engine/object.c simulates it."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np

from spidar_gym.arrays import constant
from spidar_gym.errors import InvalidValueError, require_arrays, require_name
from spidar_gym.robot.ranges import FACTORS, LENGTHS, MASSES, PLACES

SHAPES = ("none", "box", "cylinder", "ball")
"""Shapes of an object, `none` for a world without one."""
GEOM_TYPES = tuple(
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("BOX", "BOX", "CYLINDER", "SPHERE")
)  # fmt: skip
"""MuJoCo's geom type of each shape."""
FACE = 12
"""Patches along an edge of a face of the cube that is mapped onto the surface: beside 32, the force of jets differs by
1.3 % RMS."""
FACES, FACE_PATCHES = 6, FACE**2
N_PATCHES = FACES * FACE_PATCHES
"""Faces of the cube, patches of each, and of all."""
RESTING, STILL_AIR = 1e-3, 1e-3
"""Speeds below which a standing object is at rest [m/s], [rad/s], and the pressure of the air is neglected [m/s]."""
REST_SHARE, REST_LEVER = 0.5, 0.1
"""An object rests as long as the air pushes it with less than this share of the friction's limit, and moves the floor's
force by less than this share of its half width."""
PATCH = 7
"""Numbers of a patch: position, outward normal, area."""


def _box() -> np.ndarray:
    half_size = np.array([0.3, 0.3, 0.25])
    half_size.flags.writeable = False
    return half_size


@dataclass(frozen=True)
class ObjectConfig:
    """A free rigid object; its axes are those of its shape, with the origin in the shape's middle."""

    shape: str = "none"
    """`box`, `cylinder` with a vertical axis, `ball`, or `none` for a world without an object."""
    half_size: np.ndarray = field(default_factory=lambda: _box())
    """Half of length, width and height of a box; of a cylinder and a ball the first number is the radius, of a
    cylinder the last one half the height [m]."""
    mass: float = 1.5
    """Mass [kg]."""
    com: np.ndarray = field(default_factory=lambda: constant(0.0, 3))
    """Position of the centre of mass [m]."""
    inertia: float = 1.0
    """Factor on the inertia of a uniform solid about its centre of mass."""
    friction: float = 0.7
    """Sliding friction of its surface against everything."""
    pressure: float = 2.0
    """Pressure of air on a face over the dynamic pressure of the flow towards it: 2 where a jet loses all of its
    momentum along the normal, 1.1 is the drag of a bluff body."""

    def __post_init__(self) -> None:
        """Validate the object."""
        require_arrays(self)
        require_name("shape", self.shape, SHAPES)
        LENGTHS.require("half_size", *self.half_size.tolist())
        MASSES.require("mass", self.mass)
        PLACES.require("com", *self.com.tolist())
        FACTORS.require("inertia", self.inertia)
        for name in ("friction", "pressure"):
            if not 0.0 <= getattr(self, name) <= 10.0:
                raise InvalidValueError(name, getattr(self, name), "a number within 0 … 10")

    @property
    def exists(self) -> bool:
        """Whether there is an object."""
        return self.shape != "none"

    @property
    def scale(self) -> np.ndarray:
        """Half sizes of the box around the shape, (3,) [m]."""
        a, b, c = self.half_size.tolist()
        return np.array({"cylinder": (a, a, c), "ball": (a, a, a)}.get(self.shape, (a, b, c)))

    def apply(self, model: mujoco.MjModel) -> None:
        """Write the shape into a model of `scene(…, free=True)`, for pictures."""
        geom, (x, y, z) = model.geom("object"), self.scale.tolist()
        geom.type = GEOM_TYPES[SHAPES.index(self.shape)]
        geom.size = {"cylinder": (x, z, 0.0), "ball": (x, 0.0, 0.0)}.get(self.shape, (x, y, z))
        geom.rbound = math.hypot(x, y, z)

    @property
    def patches(self) -> np.ndarray:
        """Position [m], outward normal and area [m²] of each patch of the surface, (864, 7)."""
        unit, (x, y, z) = unit_patches()[SHAPES.index(self.shape)], self.scale.tolist()
        across = np.repeat([y * z, z * x, x * y], 2 * FACE**2)
        return np.column_stack([unit[:, :3] * (x, y, z), unit[:, 3:6], unit[:, 6] * across])


@dataclass(frozen=True, slots=True)
class ObjectState:
    """State of an object, and what acts on it."""

    position_w: np.ndarray
    """Origin, world (3,) [m]."""
    quat_wo: np.ndarray
    """Attitude (w, x, y, z)."""
    velocity_w: np.ndarray
    """Velocity of the origin, world (3,) [m/s]."""
    omega_o: np.ndarray
    """Angular velocity, object axes (3,) [rad/s]."""
    foot_force_w: np.ndarray
    """Force of each foot on it in the last physics step, world (4, 3) [N]."""
    floor_force_w: np.ndarray
    """Force of floor and boxes on it in that step, world (3,) [N]."""
    air_force_w: np.ndarray
    """Force of the air on it, world (3,) [N]."""
    air_torque_w: np.ndarray
    """Torque of the air about its origin, world (3,) [Nm]."""
    is_hit: bool
    """Whether parts of the robot other than feet have touched it since the reset."""


def unit_patches() -> np.ndarray:
    """Return the patches of the four shapes with half sizes of 1: position, normal, area; (4, 864, 7).

    The faces of a cube, ± x, ± y, ± z, are divided into equal squares, which are mapped onto the other shapes. Scaled,
    the positions are multiplied by the half sizes, the areas by those across the axis of the face.
    """
    edges = np.linspace(-1.0, 1.0, FACE + 1)
    a, b = (each.reshape(-1) for each in np.meshgrid(0.5 * (edges[:-1] + edges[1:]), 0.5 * (edges[:-1] + edges[1:])))
    small = 4.0 / FACE**2
    shapes = []
    for shape in SHAPES:
        rows = []
        for axis in range(3):
            for sign in (1.0, -1.0):
                place, normal, area = np.zeros((len(a), 3)), np.zeros((len(a), 3)), np.full(len(a), small)
                place[:, axis], normal[:, axis] = sign, sign
                place[:, (axis + 1) % 3], place[:, (axis + 2) % 3] = a, b
                if shape == "ball":
                    place, area = _on_ball(edges, axis, sign)
                    normal = place.copy()
                elif shape == "cylinder" and axis == 2:
                    place[:, :2], area[:] = _in_disc(a, b), math.pi / FACE**2
                elif shape == "cylinder":
                    along = a if axis == 0 else b  # of the horizontal direction
                    angle = 0.25 * math.pi * along + (0.0 if sign > 0.0 else math.pi) + 0.5 * math.pi * axis
                    place = np.column_stack([np.cos(angle), np.sin(angle), b if axis == 0 else a])
                    normal = np.column_stack([place[:, :2], np.zeros(len(a))])
                    area[:] = 0.25 * math.pi * small
                rows.append(np.column_stack([place, normal, area]))
        shapes.append(np.concatenate(rows))
    return np.array(shapes)


def _in_disc(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Map points of a square onto the unit disc, areas kept up to a factor (concentric map of Shirley and Chiu)."""
    wide = abs(a) >= abs(b)
    r = np.where(wide, a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.where(wide, 0.25 * math.pi * b / a, 0.5 * math.pi - 0.25 * math.pi * a / b)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


def _on_ball(edges: np.ndarray, axis: int, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Return middles and areas of the patches of a cube's face, projected onto the unit ball at equal angles."""
    tangent = np.tan(0.25 * math.pi * edges)
    corner = np.arctan2(
        np.multiply.outer(tangent, tangent), np.sqrt(1.0 + np.add.outer(tangent**2, tangent**2))
    )  # solid angle from the middle to a corner
    solid = corner[1:, 1:] - corner[1:, :-1] - corner[:-1, 1:] + corner[:-1, :-1]
    middle = np.tan(0.125 * math.pi * (edges[:-1] + edges[1:]))
    a, b = (each.reshape(-1) for each in np.meshgrid(middle, middle))
    place = np.empty((len(a), 3))
    place[:, axis], place[:, (axis + 1) % 3], place[:, (axis + 2) % 3] = sign, a, b
    return place / np.linalg.norm(place, axis=1, keepdims=True), solid.T.reshape(-1)
