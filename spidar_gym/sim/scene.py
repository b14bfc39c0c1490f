"""The world as MuJoCo sees it: the robot over a floor, with or without what only pleases the eye."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import logging
from functools import cache

import mujoco

from spidar_gym.description import mjcf_path
from spidar_gym.sim.ground import TILE, TILE_DEPTH, TILES

# MuJoCo would write its warnings into a file of the working folder.
mujoco.set_mju_user_warning(logging.getLogger("spidar_gym.mujoco").warning)

TIMESTEP = 0.0025
"""Physics step [s], implicitfast."""
MAX_WIDTH, MAX_HEIGHT = 1920, 1080
"""Largest picture [px]."""


@cache
def scene(visual: bool, uneven: bool = False) -> mujoco.MjModel:
    """The robot over a floor; without `visual` the geoms that only please the eye are left out, a third of a step.

    With `uneven` there are tiles on the floor, which `GroundConfig.apply` lays.
    """
    spec = mujoco.MjSpec.from_file(str(mjcf_path()))
    if not visual:
        for geom in list(spec.geoms):
            if geom.contype == 0 and geom.conaffinity == 0:
                spec.delete(geom)
    world = spec.worldbody
    floor = world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    floor.contype, floor.conaffinity, floor.friction = 1, 0, [0.01, 0.005, 0.0001]
    tiles = []
    if uneven:
        for i in range(TILES):
            for j in range(TILES):
                tile = world.add_geom(name=f"tile{i}_{j}", type=mujoco.mjtGeom.mjGEOM_BOX)
                tile.size, tile.pos = [TILE / 2, TILE / 2, TILE_DEPTH], [i * TILE, j * TILE, -1.0]
                tile.contype, tile.conaffinity, tile.friction = 1, 0, floor.friction
                tiles.append(tile)
    if visual:
        spec.visual.headlight.ambient = [0.4, 0.4, 0.4]
        spec.visual.headlight.diffuse = [0.3, 0.3, 0.3]
        getattr(spec.visual, "global").offwidth = MAX_WIDTH
        getattr(spec.visual, "global").offheight = MAX_HEIGHT
        # Off-screen pictures are mostly drawn by the processor: a reflection, a large shadow map and multiple
        # sampling would each cost more than the robot.
        spec.visual.quality.shadowsize = 1024
        spec.visual.quality.offsamples = 0
        builtin = mujoco.mjtBuiltin
        spec.add_texture(
            name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=builtin.mjBUILTIN_GRADIENT,
            rgb1=[0.75, 0.83, 0.92], rgb2=[0.95, 0.96, 0.97], width=256, height=1536,
        )  # fmt: skip
        spec.add_texture(
            name="grid", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=builtin.mjBUILTIN_CHECKER,
            rgb1=[0.72, 0.74, 0.76], rgb2=[0.78, 0.80, 0.82], width=512, height=512,
            mark=mujoco.mjtMark.mjMARK_EDGE, markrgb=[0.6, 0.62, 0.65],
        )  # fmt: skip
        grid = spec.add_material(name="grid", texrepeat=[1, 1], texuniform=True)
        grid.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
        floor.material = "grid"
        for k, tile in enumerate(tiles):
            shade = 0.70 + 0.08 * ((k // TILES + k) % 2)
            tile.rgba = [shade, shade + 0.02, shade + 0.04, 1.0]
        world.add_light(
            pos=[0, 0, 5], dir=[0, 0, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            castshadow=True, diffuse=[0.45, 0.45, 0.45], specular=[0.2, 0.2, 0.2],
        )  # fmt: skip
    model = spec.compile()
    # A state that diverges must be seen, not silently reset.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model
