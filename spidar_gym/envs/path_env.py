"""The path environment: the hover's, whose reference moves."""

from spidar_gym.control.flight.observation import Field, path_layout
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.tasks.path import PathTask


class PathEnv(HoverEnv):
    """SPIDAR on its way through the air; `spidar list spidar_gym/Path-v0` prints its page."""

    task_type = PathTask
    goal_type = None
    no_goal = "its goal moves on at every tick, so nothing that was achieved can stand in its place"

    @staticmethod
    def layout_of(action_size: int, robot: RobotSpec = ROBOT) -> tuple[Field, ...]:
        """The hover's, and the next second of the path."""
        return path_layout(action_size, robot)
