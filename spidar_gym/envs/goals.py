"""Desired and achieved goals and their reward, in the convention of `gymnasium_robotics`.

A goal is a row of numbers. The reward is a function of the desired and the achieved goal, so that a learner can replace
the desired goal by an achieved one (hindsight experience replay, HER).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from spidar_gym.control.flight.observation import Field
from spidar_gym.envs.fleet import Fleet
from spidar_gym.errors import InvalidValueError, require_array, require_name
from spidar_gym.robot import N_JOINTS
from spidar_gym.tasks.crawl import SUCCESS_POSITION, SUCCESS_YAW, TURN_LENGTH
from spidar_gym.tasks.hover import ARRIVAL_TOLERANCE
from spidar_gym.tasks.hover import SUCCESS_ATTITUDE as HOVER_ATTITUDE
from spidar_gym.tasks.hover import SUCCESS_POSITION as HOVER_POSITION

REWARDS = {
    "sparse": "0 if the goal is reached, else −1",
    "dense": "− distance to the goal",
}
"""Rewards of a goal by name, with their definitions."""
JOINT_LENGTH = 0.1
"""Length that a radian of the joint farthest from its target counts as in a distance [m]."""


class Goal(ABC):
    """Goal of a task; all arrays have a row for every robot."""

    fields: ClassVar[tuple[Field, ...]]
    """Numbers of a goal."""
    left_out: ClassVar[tuple[str, ...]]
    """Fields of the flat observation that depend on the goal; `observation` omits them."""
    reach: ClassVar[str]
    """Condition under which a goal is reached, in words."""
    far: ClassVar[str]
    """Definition of the distance to a goal, in words."""

    def __init__(self, reward: str) -> None:
        """Choose the reward (`UnknownNameError` lists `REWARDS`)."""
        require_name("goal_reward", reward, REWARDS)
        self._is_sparse = reward == "sparse"

    @staticmethod
    @abstractmethod
    def wanted(fleet: Fleet) -> np.ndarray:
        """Return the desired goals of robots in the engine (N, size)."""

    @staticmethod
    @abstractmethod
    def achieved(state: np.ndarray, told: Callable[[str], np.ndarray], wanted: np.ndarray) -> np.ndarray:
        """Return the achieved goals (N, size), from the true state.

        Args:
            state: Records of `RobotState`'s fields (N,).
            told: The robots' `info` by name.
            wanted: Desired goals (N, size).
        """

    @staticmethod
    @abstractmethod
    def distances(achieved: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distances to the goals (N,) [m], and whether they are reached (N,)."""

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:  # noqa: ANN401 - as in `gymnasium_robotics`
        """Return the reward of an achieved and a desired goal; for those of a step, bit for bit the reward of `step`.

        Args:
            achieved_goal: Achieved goal of one robot (size,), or a row for each of many.
            desired_goal: Desired goal, in the same shape.
            info: Not used.

        Returns:
            A number, or one for each row.

        Raises:
            InvalidValueError: For an array of another shape.
        """
        del info
        return self.reward(achieved_goal, desired_goal)

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:  # noqa: ANN401 - as above
        """Return whether `info` reports a failure; reaching a goal does not end an episode; arguments as above."""
        del achieved_goal, desired_goal
        return has_failed(info)

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:  # noqa: ANN401 - as above
        """Return False: a wrapper truncates episodes, as in `gymnasium_robotics`; arguments as above."""
        del desired_goal, info
        shape = np.shape(achieved_goal)[:-1]
        return np.zeros(shape, bool) if shape else False

    def reward(self, achieved: object, wanted: object) -> Any:  # noqa: ANN401 - a number, or an array of them
        """Return rewards (…) of goals (…, size) in double precision (`InvalidValueError` for other shapes)."""
        size = sum(f.size for f in self.fields)
        pair = []
        for name, given in (("achieved_goal", achieved), ("desired_goal", wanted)):
            each = require_array(name, given, f"numbers of shape (…, {size})")
            if each.ndim == 0 or each.shape[-1] != size:
                raise InvalidValueError(name, each.shape, f"an array of shape (…, {size})")
            pair.append(each)
        if pair[0].shape != pair[1].shape:
            raise InvalidValueError("desired_goal", pair[1].shape, f"the shape of achieved_goal, {pair[0].shape}")
        distance, is_reached = self.distances(*(each.reshape(-1, size) for each in pair))
        found = is_reached - 1.0 if self._is_sparse else -distance
        return found.reshape(pair[0].shape[:-1])[()]


class CrawlGoal(Goal):
    """Pose at which the torso is to lie."""

    fields = (
        Field("position", 2, 100.0, "m", "x, y of the torso, world"),
        Field("yaw", 1, 4.0, "rad", "of the torso"),
    )
    left_out = ("goal_position", "goal_heading", "joint_way", "steps_left")
    reach = f"the torso is within {1000 * SUCCESS_POSITION:g} mm and {SUCCESS_YAW:g} rad of it"
    far = f"the distance of the torso [m], a radian of yaw counting {TURN_LENGTH:g} m"

    @staticmethod
    def wanted(fleet: Fleet) -> np.ndarray:
        """Return the desired poses (N, 3)."""
        goal = fleet.robots["goal"]
        return np.stack((goal["x"], goal["y"], goal["yaw"]), axis=1)

    @staticmethod
    def achieved(state: np.ndarray, told: Callable[[str], np.ndarray], wanted: np.ndarray) -> np.ndarray:
        """Return the poses of the torsos (N, 3)."""
        del told, wanted
        w, x, y, z = state["quat_wb"].T
        yaw = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
        return np.concatenate((state["position_w"][:, :2], yaw[:, None]), axis=1)

    @staticmethod
    def distances(achieved: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distances to poses (N, 3), and whether they are reached."""
        x, y, turn = (wanted - achieved).T
        way, turn = np.sqrt(x * x + y * y), np.abs(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi)
        return way + TURN_LENGTH * turn, (way <= SUCCESS_POSITION) & (turn <= SUCCESS_YAW)


class HoverGoal(Goal):
    """Position of the CoG, attitude of the torso and form of a hover."""

    fields = (
        Field("com", 3, 100.0, "m", "CoG of the described robot, world"),
        Field("attitude", 4, 1.0, "", "quaternion w, x, y, z of the torso, w at least 0"),
        Field("joints", N_JOINTS, 4.0, "rad", "q"),
    )
    left_out = ("position_error", "attitude_error", "joint_target_error", "next_form", "time_to_next_form")
    reach = (
        f"the CoG is within {1000 * HOVER_POSITION:g} mm, the attitude within {HOVER_ATTITUDE:g} rad and every joint "
        f"within {ARRIVAL_TOLERANCE:g} rad of it"
    )
    far = (
        f"the distance of the CoG [m], a radian of attitude counting {TURN_LENGTH:g} m, one of the farthest joint "
        f"{JOINT_LENGTH:g} m"
    )

    @staticmethod
    def wanted(fleet: Fleet) -> np.ndarray:
        """Return the desired positions, attitudes and forms (N, 23)."""
        robots = fleet.robots
        form = fleet.goals[np.arange(len(robots)), robots["current"]]["joint_target"]
        return np.concatenate((robots["reference"]["position_w"], robots["reference"]["quat_wb"], form), axis=1)

    @staticmethod
    def achieved(state: np.ndarray, told: Callable[[str], np.ndarray], wanted: np.ndarray) -> np.ndarray:
        """Return the positions of the CoGs, attitudes of the torsos and joint angles (N, 23)."""
        quat = state["quat_wb"]
        return np.concatenate(
            (
                wanted[:, :3] - told("position_error"),
                np.where(quat[:, :1] < 0.0, -quat, quat),
                state["joint_position"],
            ),
            axis=1,
        )

    @staticmethod
    def distances(achieved: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distances to goals (N, 23), and whether they are reached."""
        x, y, z = (wanted - achieved).T[:3]
        place = np.sqrt(x * x + y * y + z * z)
        turn = np.minimum(_chord(achieved, wanted, -1.0), _chord(achieved, wanted, 1.0))
        angle = 4.0 * np.arcsin(np.minimum(0.5 * turn, 1.0))
        joint = np.abs(wanted[:, 7:] - achieved[:, 7:]).max(axis=1)
        is_reached = (place <= HOVER_POSITION) & (angle <= HOVER_ATTITUDE) & (joint <= ARRIVAL_TOLERANCE)
        return place + TURN_LENGTH * angle + JOINT_LENGTH * joint, is_reached


def _chord(achieved: np.ndarray, wanted: np.ndarray, sign: float) -> np.ndarray:
    """Return the distance of the goals' quaternions for one sign (N,): q and −q are the same attitude."""
    w, x, y, z = (wanted + sign * achieved).T[3:7]
    return np.sqrt(w * w + x * x + y * y + z * z)


def has_failed(info: object) -> Any:  # noqa: ANN401 - a flag, or an array of flags
    """Return whether `info` reports a failure, for one robot, a list or a vector."""
    if isinstance(info, Mapping):
        if "failure" in info:
            return info["failure"] != ""
        if "failure_code" in info:
            return np.asarray(info["failure_code"]) >= 0
    elif isinstance(info, list | tuple | np.ndarray):
        return np.array([has_failed(each) for each in info], bool)
    raise InvalidValueError("info", info, "info of a step, with failure or, from a vector, failure_code")
