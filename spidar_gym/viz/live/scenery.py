"""The scene of the page: the robot, its rotors' arrows and jets, floor and obstacles, reference and goal."""

import math
from typing import Any

import numpy as np

from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.stage import ARROW_COLOR, CONTACT_COLOR, JET_COLOR
from spidar_gym.viz.live.puppet import JETS, Part, Puppet, arrows, contact_arrows, jet_mesh
from spidar_gym.viz.live.session import Frame

FROM, FROM_BEHIND = np.array([0.60, -0.72, 0.35]), np.array([-0.68, -0.42, 0.60])
"""Initial direction from the point of view to the camera, without and with obstacles."""
LOOK_AT = np.array([0.0, 0.0, 0.7])
"""Point at which the camera looks, relative to the floor below the robot [m]."""
FIELD_OF_VIEW = math.radians(40.0)
NEAREST, NEAREST_BEHIND, HALF_WIDTH = 4.8, 7.5, 1.65
"""Least distance of the camera without and with obstacles, and visible width to either side of the robot [m]."""
RESIZED = 0.05
"""Relative change of the picture's aspect ratio above which the camera is placed again so that it sees the robot."""
NARROW, HIGHER = 0.6, 0.17
"""Aspect ratio below which the picture is that of a telephone, whose panel covers the lower half. The camera then looks
below the robot, by this multiple of its distance."""
PLAIN, LINE, FLOOR = (247, 249, 251), (196, 204, 212), (232, 236, 240)
WIND_COLOR = (0.34, 0.71, 0.91)
REFERENCE_COLOR, WAY_COLOR = (0, 158, 115), (0, 114, 178)
FLOOR_SIZE, CELL = 40.0, 0.5
"""Edge of the floor and of its cells [m]."""
WIND_LENGTH = 0.15
"""Length of the wind's arrow per speed [m/(m/s)]."""
WIND_AT = np.array([0.0, 0.0, 0.75])
"""Start of the wind's arrow, relative to the robot's centre of gravity [m]."""
Handle = Any
"""viser's handle of an element of the scene."""
LAYERS = 3
"""Number of layers of a jet, each shorter than the one before, so that jets fade along their length."""
SHOWN = ("thrust", "jets", "contact forces", "reference", "shadow")
"""Elements that can be hidden."""


def _rgb(color: Any) -> tuple[int, int, int]:  # noqa: ANN401 - three or more numbers in 0 … 1
    """Convert a colour in 0 … 1 to linear light in 0 … 255, as viser expects for batched shapes."""
    r, g, b = (round(255.0 * float(value) ** 2.2) for value in list(color)[:3])
    return r, g, b


def camera(aspect: float, *, behind: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return the camera's position and the point it looks at, for an aspect ratio: two points (3,) [m]."""
    least, way = (NEAREST_BEHIND, FROM_BEHIND) if behind else (NEAREST, FROM)
    distance = max(least, HALF_WIDTH / (math.tan(0.5 * FIELD_OF_VIEW) * aspect))
    at = LOOK_AT - np.array([0.0, 0.0, HIGHER * distance if aspect < NARROW else 0.0])
    return at + distance * way, at


def _linear(colors: np.ndarray) -> np.ndarray:
    """Convert colours (n, 4) from sRGB to linear light, both in 0 … 255."""
    linear = (255.0 * (colors / 255.0) ** 2.2).round().astype(np.uint8)
    linear[:, 3] = colors[:, 3]
    return linear


class Scenery:
    """Contents of a server's scene."""

    def __init__(
        self,
        server: Handle,
        trimesh: Any,  # noqa: ANN401 - imported late
        ground: GroundConfig,
        thing: ObjectConfig,
        *,
        flies: bool,
    ) -> None:
        """Build the scene.

        Args:
            server: viser's server.
            trimesh: The module, whose meshes viser uses.
            ground: The floor; later floors must have tiles, or boxes, exactly where this one has them.
            thing: The object, if there is one; later ones may have other shapes.
            flies: Whether there is a reference.
        """
        self._scene, self._trimesh = server.scene, trimesh
        self.follows = True
        """Whether the robot stays in the middle while the world moves below it."""
        self._boxed = ground.boxed
        server.initial_camera.position, server.initial_camera.look_at = camera(1.0, behind=self._boxed)
        server.initial_camera.fov = FIELD_OF_VIEW
        server.on_client_connect(self._look)
        self._scene.world_axes.visible = False
        self._scene.configure_environment_map(hdri=None)
        self._scene.configure_default_lights(enabled=False)
        self._scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(150, 155, 165), intensity=2.2)
        self._sun = self._scene.add_light_directional(
            "/sun", color=(255, 252, 245), intensity=1.2, position=(1.5, -2.0, 5.0), cast_shadow=True
        )
        self._scene.set_background_image(np.full((2, 2, 3), PLAIN, np.uint8))
        self._world = self._scene.add_frame("/world", show_axes=False)
        self._puppet = Puppet(ground, thing)
        self._robot = [(part, self._add_part(part)) for part in self._puppet.parts]
        self._thrust = self._add_arrows("/world/thrust", np.zeros((8, 2, 3)), _rgb(ARROW_COLOR))
        nothing = contact_arrows(np.zeros((0, 6)))
        self._contacts = self._add_arrows("/world/contacts", nothing, _rgb(CONTACT_COLOR))
        self._wind = self._add_arrows("/world/wind", nothing[:1], _rgb(WIND_COLOR))
        self._jets = self._add_jets()
        self._com = self._scene.add_icosphere("/world/com", 0.025, color=(34, 34, 34), cast_shadow=False)
        self._reference = self._scene.add_icosphere(
            "/world/reference", 0.06, color=REFERENCE_COLOR, opacity=0.45, cast_shadow=False
        )
        self._goal = self._scene.add_frame("/world/goal", axes_length=0.25, axes_radius=0.012)
        self._flies, self._hidden = flies, set[str]()
        self._static: list[Handle] = []
        self._thing: Handle | None = None
        self._laid: tuple[GroundConfig, ObjectConfig] | None = None
        self.hide("", is_hidden=False)

    def _look(self, client: Handle) -> None:
        """Place the camera of a new browser so that it sees the whole robot, also after changes of the aspect ratio."""
        shape, (first, _) = [math.inf], camera(1.0, behind=self._boxed)

        def look(view: Handle) -> None:
            aspect = float(view.aspect)
            position, look_at = camera(aspect, behind=self._boxed)
            # A browser may apply the server's initial camera after its own was set.
            is_lost = np.allclose(view.position, first, atol=1e-3) and not np.allclose(position, first, atol=1e-3)
            if is_lost or abs(aspect / shape[0] - 1.0) > RESIZED:
                shape[0] = aspect
                view.position, view.look_at = position, look_at

        client.camera.on_update(look)
        look(client.camera)

    def lay(
        self, ground: GroundConfig, thing: ObjectConfig, way: np.ndarray | None,
        goal: tuple[float, float, float] | None,
    ) -> None:  # fmt: skip
        """Show the floor, the object, the path and the goal of an episode."""
        if self._laid is None or ground is not self._laid[0] or thing is not self._laid[1]:
            self._puppet.lay(ground, thing)
            self._laid = ground, thing
        if self._thing is not None:
            self._thing.remove()
        part = self._puppet.thing
        self._thing = None if part is None else self._add_part(part)
        for handle in self._static:
            handle.remove()
        position, wxyz = self._puppet.floor()
        self._static = [
            self._scene.add_grid(
                "/world/floor", width=FLOOR_SIZE, height=FLOOR_SIZE, cell_size=CELL, section_size=CELL,
                cell_color=LINE, section_color=LINE, plane_color=FLOOR, plane_opacity=1.0, fade_distance=25.0,
                shadow_opacity=0.2, position=position, wxyz=wxyz,
            )
        ]  # fmt: skip
        at, turned, edges, colors = self._puppet.blocks()
        if len(at):
            vertices, faces = _cube()
            self._static.append(
                self._scene.add_batched_meshes_simple(
                    "/world/blocks", vertices, faces, batched_positions=at, batched_wxyzs=turned,
                    batched_scales=edges, batched_colors=colors, opacity=0.4 if ground.boxed else None,
                    flat_shading=True, lod="off", cast_shadow=False,
                )
            )  # fmt: skip
        if way is not None:
            pieces = np.stack((way[:-1], way[1:]), axis=1)
            self._static.append(self._scene.add_line_segments("/world/way", pieces, WAY_COLOR))
        self._goal.visible = goal is not None
        if goal is not None:
            x, y, yaw = goal
            self._goal.position = (x, y, 0.02)
            self._goal.wxyz = (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))

    def hide(self, what: str, is_hidden: bool) -> None:
        """Hide one of `SHOWN`, or show it again."""
        (self._hidden.add if is_hidden else self._hidden.discard)(what)
        self._thrust.visible = "thrust" not in self._hidden
        for handle in self._jets:
            handle.visible = "jets" not in self._hidden
        self._contacts.visible = "contact forces" not in self._hidden
        self._sun.cast_shadow = "shadow" not in self._hidden
        shows = "reference" not in self._hidden
        self._reference.visible, self._com.visible = shows and self._flies, shows

    def show(self, frame: Frame) -> None:
        """Show a frame."""
        puppet = self._puppet
        puppet.place(frame.qpos, frame.thrust)
        for part, handle in self._robot:
            handle.batched_positions, handle.batched_wxyzs = puppet.poses(part)
        if self._thing is not None and (part := puppet.thing) is not None:
            self._thing.batched_positions, self._thing.batched_wxyzs = puppet.poses(part)
        self._thrust.points = puppet.arrows()
        exits, quats, lengths = puppet.jets()
        opacities = puppet.jet_opacities()
        for layer, handle in enumerate(self._jets):
            handle.batched_positions, handle.batched_wxyzs = exits, quats
            scales = np.ones((JETS, 3), np.float32)
            scales[:, 2] = lengths * (1.0 - layer / LAYERS)
            handle.batched_scales, handle.batched_opacities = scales, opacities
        self._contacts.points = contact_arrows(frame.contacts)
        com = puppet.com
        self._com.position = com
        self._wind.points = arrows((com + WIND_AT)[None], WIND_LENGTH * frame.wind_w[None], 1)
        if frame.reference_w is not None:
            self._reference.position = frame.reference_w
        if self.follows:
            self._world.position = (-com[0], -com[1], 0.0)

    def _add_part(self, part: Part) -> Handle:
        visual = self._trimesh.visual
        # The default material is metal, which shows reflections only.
        look = visual.TextureVisuals(material=visual.material.PBRMaterial(metallicFactor=0.0, roughnessFactor=0.7))
        look.vertex_attributes["color"] = _linear(part.mesh.colors)
        mesh = self._trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, visual=look, process=False)
        count = len(part.bodies)
        return self._scene.add_batched_meshes_trimesh(
            f"/world/robot/{part.name}", mesh, batched_positions=np.zeros((count, 3)),
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), lod="off", receive_shadow=False,
        )  # fmt: skip

    def _add_arrows(self, name: str, points: np.ndarray, color: tuple[int, int, int]) -> Handle:
        return self._scene.add_arrows(name, points, color, shaft_radius=0.011, head_radius=0.028, head_length=0.07)

    def _add_jets(self) -> list[Handle]:
        vertices, faces = jet_mesh()
        unturned = np.tile([1.0, 0.0, 0.0, 0.0], (JETS, 1))
        return [
            self._scene.add_batched_meshes_simple(
                f"/world/jets/{layer}", vertices, faces, batched_positions=np.zeros((JETS, 3)),
                batched_wxyzs=unturned, batched_scales=np.ones((JETS, 3)), batched_colors=np.array(JET_COLOR),
                batched_opacities=np.zeros(JETS), opacity=0.99, lod="off", cast_shadow=False,
                receive_shadow=False,
            )
            for layer in range(LAYERS)
        ]  # fmt: skip


def _cube() -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of a cube of edge 1 centred at the origin."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
