"""The path environment: the hover environment with a moving reference."""

from spidar_gym.control.flight.observation import Field, path_layout
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.tasks.path import PathTask


class PathEnv(HoverEnv):
    """SPIDAR on a path through the air; `spidar list spidar_gym/Path-v0` prints its page."""

    task_type = PathTask
    goal_type = None
    no_goal = "its goal moves at every tick, so no achieved goal can replace it"

    @staticmethod
    def layout_of(action_size: int, robot: RobotSpec = ROBOT) -> tuple[Field, ...]:
        """Return the hover's layout with a preview of the next second of the path."""
        return path_layout(action_size, robot)
