"""Pictures of an environment's robot; OpenGL is loaded at the first picture."""

from typing import Any

import gymnasium
import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.native.engine_structs import N_DOFS
from spidar_gym.native.structs import read
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.description import CAMERAS
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.scene import MAX_HEIGHT, MAX_WIDTH

RENDER_MODES = ("human", "rgb_array", "depth_array")
"""Modes of rendering: a window, a picture, distances."""


def fps(hold: int) -> int | float:
    """Return the frame rate in real time with one picture per step of `hold` control periods [1/s]."""
    rate = CONTROL_RATE / hold
    return int(rate) if rate.is_integer() else rate


class View:
    """Renderer of a robot in a window or off screen."""

    def __init__(self, mode: str | None, camera: str, width: int, height: int, robot: RobotSpec = ROBOT) -> None:
        """Store and check the settings.

        Args:
            mode: One of `RENDER_MODES`, or None for no pictures.
            camera: Camera of the pictures.
            width: Width of the pictures [px].
            height: Height of the pictures [px].
            robot: The robot.

        Raises:
            UnknownNameError: For a mode or camera that does not exist; it lists the valid ones.
            InvalidValueError: For a size out of range.
        """
        if mode is not None:
            require_name("render mode", mode, RENDER_MODES)
        require_name("camera", camera, CAMERAS)
        for name, size, most in (("width", width, MAX_WIDTH), ("height", height, MAX_HEIGHT)):
            if not (isinstance(size, int) and 1 <= size <= most):
                raise InvalidValueError(name, size, f"a whole number of pixels within 1 … {most}")
        self.mode, self._camera, self._size, self._robot = mode, camera, (width, height), robot
        self._renderer: Any = None
        self._ground: GroundConfig | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for a copy, which opens its own window or OpenGL context at its first picture."""
        return vars(self) | {"_renderer": None, "_ground": None}

    def draw(self, qpos: np.ndarray, ground: GroundConfig, period: float, thing: ObjectConfig | None = None) -> Any:  # noqa: ANN401 - as Gymnasium has it
        """Draw a robot.

        Args:
            qpos: Generalised positions of MuJoCo's model.
            ground: The floor under it.
            period: Time for which a window shows it [s].
            thing: The object, if there is one.

        Returns:
            A picture (height, width, 3) uint8, distances (height, width) [m], or None in the mode `human` and without a
            mode.
        """
        from spidar_gym.sim import renderer  # loads OpenGL

        if self.mode is None:
            gymnasium.logger.warn("render() without a render_mode; valid: " + ", ".join(RENDER_MODES))
            return None
        if self._renderer is None:
            is_shown = self.mode == "human"
            self._renderer = (
                renderer.Window(period, ground, self._robot, thing) if is_shown else
                renderer.OffscreenRenderer(self._camera, *self._size, ground, self._robot, thing)
            )  # fmt: skip
        elif ground is not self._ground:
            self._renderer.lay(ground, thing)
        self._ground = ground
        if self.mode == "human":
            return self._renderer.render(qpos)
        return self._renderer.render(qpos, depth=self.mode == "depth_array")

    def draw_plant(self, plant: np.ndarray | np.void) -> Any:  # noqa: ANN401 - as `draw`
        """Draw a robot in the engine, a record of `sp_plant`, on its own floor."""
        config = plant["config"]
        ground, thing = read(GroundConfig, config["ground"]), read(ObjectConfig, config["object"])
        end = 2 + N_DOFS + (7 if thing.exists else 0)
        return self.draw(plant["row"][1:end], ground, 1.0 / CONTROL_RATE, thing)

    def close(self) -> None:
        """Release the window or OpenGL context; a second call does nothing."""
        renderer, self._renderer = self._renderer, None
        if renderer is not None:
            renderer.close()
