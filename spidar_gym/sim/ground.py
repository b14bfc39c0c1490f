"""The floor: flat, sloped or of uneven tiles, boxes on it, and the contacts, slip and duct clearance of a robot.

native/engine/floor.c determines the contacts. They are for rewards, metrics and tests only: controllers do not receive
them, because the robot has no touch sensors.
"""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco
import numpy as np

from spidar_gym.arrays import Matrix3, constant
from spidar_gym.errors import InvalidValueError, require_array, require_arrays
from spidar_gym.so3 import exp, matrix_to_quat

TILES = 16
"""Number of tiles per side of the uneven floor."""
TILE = 0.25
"""Edge of a tile [m]; the uneven floor is a square of 4 m round the origin."""
TILE_DEPTH = 0.05
"""Half the thickness of a tile [m]."""
TERRAINS = ("tiles", "stairs", "mixed")
"""Kinds of floors with steps."""
STAIR_ROW, STAIR_ROWS, STAIRS = 10, 3, 2
"""First row of tiles of the first stair, 0.5 m ahead of the origin; rows per stair, with the last stair up to the end
of the floor; number of stairs."""
HIGHEST = 0.2
"""Largest height of a tile [m]."""
BOXES = 64
"""Largest number of boxes."""
FARTHEST = 100.0
"""Limit of the boxes' coordinates and half sizes [m]."""
MAX_SLOPE = 0.6
"""Steepest slope, beyond which the robot's friction cannot hold it [rad]."""
FARTHEST_HEADING = 1e6
"""Limit of the direction in which a floor rises, so that ranges of it are finite [rad]."""

NOWHERE = (0.0, 0.0, -50.0, 0.01, 0.01, 0.01)
"""Position and half sizes of an unused box [m]."""


@dataclass(frozen=True)
class GroundConfig:
    """The floor under the robot."""

    slope: float = 0.0
    """Angle to the horizontal, by rotation about the origin [rad]."""
    heading: float = 0.0
    """Direction in which the floor rises [rad]."""
    tiles: np.ndarray = field(default_factory=lambda: constant(0.0, TILES, TILES))
    """Height of each tile over the plane [m]; all zero is a plane without tiles."""
    boxes: np.ndarray = field(default_factory=lambda: constant(0.0, BOXES, 7))
    """Boxes in the world: centre, half of length, width and height [m], downward pitch of the front [rad]; boxes of
    zero size are unused."""

    def __post_init__(self) -> None:
        """Validate the floor."""
        require_arrays(self)
        if abs(self.slope) > MAX_SLOPE:
            raise InvalidValueError("slope", self.slope, f"an angle within ± {MAX_SLOPE:g} rad")
        if abs(self.heading) > FARTHEST_HEADING:
            raise InvalidValueError("heading", self.heading, f"an angle within ± {FARTHEST_HEADING:g} rad")
        if not (np.abs(self.boxes) <= FARTHEST).all() or (self.boxes[:, 3:6] < 0.0).any():
            raise InvalidValueError("boxes", self.boxes.tolist(), f"half sizes from 0, nothing beyond {FARTHEST:g} m")
        if self.boxed and self.uneven:
            raise InvalidValueError("boxes", int(self.boxed), "a floor with either tiles or boxes")
        if (self.tiles < 0.0).any() or (self.tiles > HIGHEST).any():
            raise InvalidValueError("tiles", float(self.tiles.max()), f"heights within 0 … {HIGHEST:g} m")

    @property
    def uneven(self) -> bool:
        """Whether there are tiles."""
        return bool(self.tiles.any())

    @property
    def boxed(self) -> bool:
        """Whether there are boxes."""
        return bool(self.boxes[:, 3:6].any())

    @cached_property
    def highest_tile(self) -> float:
        """Height of the highest tile over the plane [m]."""
        return float(self.tiles.max())

    @cached_property
    def R_wf(self) -> Matrix3:
        """Attitude of the floor."""
        return exp(self.slope * np.array([math.sin(self.heading), -math.cos(self.heading), 0.0]))

    def apply(self, model: mujoco.MjModel) -> None:
        """Write the floor into a model of `scene(…, uneven=self.uneven, boxed=self.boxed)`."""
        R = self.R_wf
        quat = matrix_to_quat(R)
        floor = model.geom("floor").id
        if self.uneven:
            for i in range(TILES):
                for j in range(TILES):
                    x, y = ((k + 0.5 - TILES / 2) * TILE for k in (i, j))
                    tile = model.geom(f"tile{i}_{j}").id
                    model.geom_pos[tile] = R @ (x, y, self.tiles[i, j] - TILE_DEPTH)
                    model.geom_quat[tile] = quat
                    model.geom_sameframe[tile] = 0
            # MuJoCo's bounding volumes of the tiles are those of their previous positions.
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
        if self.boxed:
            for k, (*centre, a, b, c, pitch) in enumerate(self.boxes.tolist()):
                box = model.geom(f"box{k}").id
                is_one = a > 0.0 and b > 0.0 and c > 0.0
                half = np.array([a, b, c] if is_one else NOWHERE[3:])
                model.geom_pos[box] = centre if is_one else NOWHERE[:3]
                model.geom_quat[box] = math.cos(0.5 * pitch), 0.0, math.sin(0.5 * pitch), 0.0
                model.geom_size[box], model.geom_rbound[box] = half, np.linalg.norm(half)
                model.geom_aabb[box, 3:], model.geom_sameframe[box] = half, 0
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
        model.geom_pos[floor] = R @ (0.0, 0.0, -TILE_DEPTH if self.uneven else 0.0)
        model.geom_quat[floor] = quat
        # Otherwise MuJoCo would use the world's frame for the floor.
        model.geom_sameframe[floor] = 0

    def height(self, points_f: np.ndarray) -> np.ndarray:
        """Return the height of the floor under points (n, 3), floor axes [m]."""
        if not self.uneven:
            return np.zeros(len(points_f))
        cell = np.floor(points_f[:, :2] / TILE).astype(int) + TILES // 2
        inside = ((cell >= 0) & (cell < TILES)).all(axis=1)
        cell = np.clip(cell, 0, TILES - 1)
        return np.where(inside, self.tiles[cell[:, 0], cell[:, 1]], -TILE_DEPTH)


def with_boxes(ground: GroundConfig, boxes: Sequence[Sequence[float]]) -> GroundConfig:
    """Return the floor with boxes on it, each x, y, z, half length, half width, half height [m], pitch [rad]."""
    if len(boxes) > BOXES:
        raise InvalidValueError("boxes", len(boxes), f"at most {BOXES}")
    rows = np.zeros((BOXES, 7))
    if boxes:
        rows[: len(boxes)] = boxes
    return replace(ground, boxes=rows)


def with_blocks(ground: GroundConfig, blocks: tuple[tuple[float, float, float], ...], height: float) -> GroundConfig:
    """Return the floor with tiles raised to `height` [m] if their centres are within r of (x, y) of a block [m]."""
    centres = (np.arange(TILES) + 0.5 - TILES / 2) * TILE
    tiles = ground.tiles.copy()
    for x, y, r in blocks:
        tiles[np.hypot(centres[:, None] - x, centres[None, :] - y) <= r] = height
    return replace(ground, tiles=tiles)


def require_blocks(name: str, blocks: object) -> tuple[tuple[float, ...], ...]:
    """Return the blocks of `with_blocks` as tuples of numbers (`InvalidValueError` for other values)."""
    expected = "a list of (x, y, radius) in metres, within ± 100 m, radius within 0 … 2"
    found = require_array(name, blocks, expected)
    if found.shape == (0,):
        return ()
    if found.ndim != 2 or found.shape[1] != 3:
        raise InvalidValueError(name, blocks, expected)
    for x, y, radius in found.tolist():
        if not (abs(x) <= 100.0 and abs(y) <= 100.0 and 0.0 < radius <= 2.0):
            raise InvalidValueError(name, (x, y, radius), expected)
    return tuple(map(tuple, found.tolist()))


def uneven(ground: GroundConfig, rng: np.random.Generator, steps: float, terrain: str = "tiles") -> GroundConfig:
    """Return a slope with steps on it.

    Args:
        ground: The slope.
        rng: Random generator.
        steps: Height of the steps [m].
        terrain: `tiles` of heights uniform in 0 … `steps`, `stairs` ahead, each `steps` higher than the one before, or
            `mixed`, both equally often.
    """
    if terrain == "mixed":
        terrain = "stairs" if rng.random() < 0.5 else "tiles"
    if terrain == "tiles":
        return replace(ground, tiles=rng.uniform(0.0, steps, (TILES, TILES)))
    stair = np.clip((np.arange(TILES) - STAIR_ROW) // STAIR_ROWS + 1, 0, STAIRS)
    return replace(ground, tiles=np.repeat(stair[:, None] * steps, TILES, axis=1))


@dataclass(frozen=True, slots=True)
class Touch:
    """Contacts with the floor at one instant."""

    feet: np.ndarray
    """Whether each foot touches the floor (4,)."""
    pegs: np.ndarray
    """Whether each peg touches the floor, those of the torso first (8,)."""
    ducts: bool
    """Whether a duct touches the floor."""
    foot_slip: np.ndarray
    """Speed of each foot's touching point along the floor, 0 in the air (4,) [m/s]."""
    peg_slip: np.ndarray
    """Speed of the touching point of each of the torso's pegs along the floor, 0 in the air (4,) [m/s]."""
    duct_clearance: float
    """Height of the lowest duct over the floor below its centre [m]."""
    hit: float = 0.0
    """Largest force since the last command on parts other than feet and pegs, on a floor with boxes [N]."""
