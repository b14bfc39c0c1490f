"""MuJoCo's model of the world: the robot on a floor, with or without purely visual parts."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import logging
from functools import lru_cache

import mujoco

from spidar_gym.robot import N_LINKS, ROBOT, RobotSpec
from spidar_gym.robot.description import model_text
from spidar_gym.sim.ground import BOXES, NOWHERE, TILE, TILE_DEPTH, TILES

# By default MuJoCo writes its warnings into a file in the working folder.
mujoco.set_mju_user_warning(logging.getLogger("spidar_gym.mujoco").warning)

TIMESTEP = 0.0025
"""Physics step of the integrator `implicitfast` [s]."""
MAX_WIDTH, MAX_HEIGHT = 1920, 1080
"""Largest picture [px]."""


_UNSTABLE = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}")) for what in ("QPOS", "QVEL", "QACC", "CTRL")]


def quieten(data: mujoco.MjData) -> None:
    """Suppress MuJoCo's warnings of numbers that are not finite: it prints one only while its count is 0."""
    data.warning.number[_UNSTABLE] = 1


@lru_cache(maxsize=64)
def scene(
    visual: bool,
    uneven: bool = False,
    film: bool = False,
    boxed: bool = False,
    robot: RobotSpec = ROBOT,
    free: bool = False,
) -> mujoco.MjModel:
    """Build the model of a robot on a floor; without `visual`, purely visual geoms are omitted, a third of a step.

    With `uneven` the floor has tiles, with `boxed` boxes, which `GroundConfig.apply` places. With `free` there is an
    object, and rods and batteries collide with it, see `ObjectConfig`. `film` selects the look of films and figures.
    The plain look is fixed, because the environments' pictures, which may be observations, have it.
    """
    spec = mujoco.MjSpec.from_string(model_text(robot))
    if not visual:
        for geom in list(spec.geoms):
            if geom.contype == 0 and geom.conaffinity == 0:
                spec.delete(geom)
    world = spec.worldbody
    floor = world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    floor.contype, floor.conaffinity, floor.friction = 1, 0, [0.01, 0.005, 0.0001]
    if uneven:
        for i in range(TILES):
            for j in range(TILES):
                tile = world.add_geom(name=f"tile{i}_{j}", type=mujoco.mjtGeom.mjGEOM_BOX)
                tile.size, tile.pos = [TILE / 2, TILE / 2, TILE_DEPTH], [i * TILE, j * TILE, -1.0]
                tile.contype, tile.conaffinity, tile.friction = 1, 0, floor.friction
                shade = 0.70 + 0.08 * ((i + j) % 2)
                tile.rgba = [shade, shade + 0.02, shade + 0.04, 1.0]
    for k in range(BOXES if boxed else 0):
        box = world.add_geom(name=f"box{k}", type=mujoco.mjtGeom.mjGEOM_BOX)
        box.pos, box.size = NOWHERE[:3], NOWHERE[3:]
        box.contype, box.conaffinity, box.friction = 1, 0, floor.friction
        box.rgba = [0.78, 0.74, 0.68, 0.45 if film else 1.0]  # transparent in films
    if free:
        _add_object(spec, robot)
    if visual:
        getattr(spec.visual, "global").offwidth = MAX_WIDTH
        getattr(spec.visual, "global").offheight = MAX_HEIGHT
        (_light_film if film else _light_plainly)(spec)
        floor.material = "grid"
    model = spec.compile()
    # A diverging state must be detected, not reset by MuJoCo.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


def _add_object(spec: mujoco.MjSpec, robot: RobotSpec) -> None:
    """Add a free object, which `native/engine/object.c` shapes, and what it can touch: rods and batteries."""
    length, width, height = (edge / 2 for edge in robot.battery_size)
    for i in range(1, N_LINKS + 1):
        link, inner = spec.body(f"link{i}"), i % 2 == 1
        end = robot.pitch_to_yaw if inner else robot.pitch_to_foot
        rod = link.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, 0, end, 0, 0], size=[robot.rod_radius, 0, 0]
        )
        battery = link.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[length, height, width])
        battery.pos = robot.inner_battery if inner else robot.outer_battery
        for geom in (rod, battery):
            geom.contype, geom.conaffinity, geom.mass, geom.group = 0, 1, 0.0, 3
            geom.friction, geom.solref = [robot.peg_friction, 0.005, 0.0001], [0.006, 1.0]
    # The last body, so that all numbers of the robot's parts are those of a world without it. An off-centre mass keeps
    # MuJoCo from simplifications for bodies whose centre of mass is their origin.
    thing = spec.worldbody.add_body(name="object", mass=1.0, ipos=[0.01, 0.0, 0.0], inertia=[1.0, 1.0, 1.0])
    thing.explicitinertial = True
    thing.add_freejoint(name="object")
    geom = thing.add_geom(name="object", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1])
    # Its friction, not that of feet (priority 1), is that of its contacts; the rest are the feet's settings.
    geom.contype, geom.conaffinity, geom.condim, geom.priority = 1, 1, 4, 2
    geom.solref, geom.rgba = [0.006, 1.0], [0.86, 0.65, 0.13, 1.0]


def _light_plainly(spec: mujoco.MjSpec) -> None:
    """Set the plain look: a chequered floor under a light from above, fast to draw for image observations."""
    spec.visual.headlight.ambient = [0.4, 0.4, 0.4]
    spec.visual.headlight.diffuse = [0.3, 0.3, 0.3]
    # Off-screen pictures are mostly drawn by the CPU: a reflection, a large shadow map and multisampling would each
    # take longer than the robot.
    spec.visual.quality.shadowsize = 1024
    spec.visual.quality.offsamples = 0
    builtin = mujoco.mjtBuiltin
    _add_sky(spec, [0.75, 0.83, 0.92], [0.95, 0.96, 0.97])
    spec.add_texture(
        name="grid", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=builtin.mjBUILTIN_CHECKER,
        rgb1=[0.72, 0.74, 0.76], rgb2=[0.78, 0.80, 0.82], width=512, height=512,
        mark=mujoco.mjtMark.mjMARK_EDGE, markrgb=[0.6, 0.62, 0.65],
    )  # fmt: skip
    _add_grid(spec, 1.0)
    _add_light(spec, [0.0, 0.0, -1.0], 0.45, castshadow=True)


def _light_film(spec: mujoco.MjSpec) -> None:
    """Set the look of films: a pale floor with lines every half metre, fading at the horizon, lit mainly from above."""
    horizon = [0.93, 0.95, 0.97]
    getattr(spec.visual, "global").fovy = 30
    spec.visual.headlight.ambient = [0.42, 0.43, 0.45]
    spec.visual.headlight.diffuse = [0.12, 0.12, 0.12]
    spec.visual.headlight.specular = [0, 0, 0]
    spec.visual.rgba.haze = [*horizon, 1]
    spec.visual.map.haze, spec.visual.map.zfar = 0.5, 20
    spec.visual.quality.shadowsize = 1024
    spec.visual.quality.offsamples = 4
    # Sufficiently round at the resolution of a film, at a third of the CPU time of MuJoCo's defaults.
    spec.visual.quality.numslices, spec.visual.quality.numstacks, spec.visual.quality.numquads = 16, 8, 1
    _add_sky(spec, [0.36, 0.56, 0.80], horizon)
    spec.add_texture(
        name="grid", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=[0.83, 0.85, 0.87], width=512, height=512, mark=mujoco.mjtMark.mjMARK_EDGE, markrgb=[0.55, 0.59, 0.64],
    )  # fmt: skip
    _add_grid(spec, 2.0)
    # Vertical light: the shadow is directly below the robot, and the floor casts none on itself.
    _add_light(spec, [0.0, 0.0, -1.0], 0.45, castshadow=True)
    _add_light(spec, [0.8, 0.3, -0.3], 0.25, castshadow=False)


def _add_sky(spec: mujoco.MjSpec, zenith: list[float], horizon: list[float]) -> None:
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=zenith, rgb2=horizon, width=256, height=1536,
    )  # fmt: skip


def _add_grid(spec: mujoco.MjSpec, repeat: float) -> None:
    """Add the floor's material, with `repeat` copies of its texture per metre."""
    grid = spec.add_material(name="grid", texrepeat=[repeat, repeat], texuniform=True)
    grid.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"


def _add_light(spec: mujoco.MjSpec, direction: list[float], strength: float, *, castshadow: bool) -> None:
    spec.worldbody.add_light(
        pos=[0, 0, 5], dir=direction, type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=castshadow, diffuse=[strength] * 3, specular=[0.2] * 3,
    )  # fmt: skip
