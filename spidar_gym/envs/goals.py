"""Goals of the environments that have one, as `gymnasium_robotics` has them: what is wanted, what is, and their reward.

A goal is a row of numbers. The reward is a function of the wanted one and of what is, so that a learner may say of what
it has achieved that it was what it wanted (hindsight, HER).
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
    "sparse": "0 where the goal is reached, −1 elsewhere",
    "dense": "− distance to the goal",
}
"""Rewards of a goal, and what they are."""
JOINT_LENGTH = 0.1
"""A radian of the joint that is farthest from its form counts as this many metres where all is one number."""


class Goal(ABC):
    """What there is to reach; all arrays have a row for every robot."""

    fields: ClassVar[tuple[Field, ...]]
    """Its numbers."""
    left_out: ClassVar[tuple[str, ...]]
    """Fields of the flat observation that tell of the goal: with it they are not in `observation`."""
    reach: ClassVar[str]
    """When it is reached, in words."""
    far: ClassVar[str]
    """What its distance is, in words."""

    def __init__(self, reward: str) -> None:
        """Choose the reward (`UnknownNameError` lists `REWARDS`)."""
        require_name("goal_reward", reward, REWARDS)
        self._is_sparse = reward == "sparse"

    @staticmethod
    @abstractmethod
    def wanted(fleet: Fleet) -> np.ndarray:
        """What robots in the engine are to reach (N, size)."""

    @staticmethod
    @abstractmethod
    def achieved(state: np.ndarray, told: Callable[[str], np.ndarray], wanted: np.ndarray) -> np.ndarray:
        """What is (N, size), by the true state.

        Args:
            state: Records of `RobotState`'s fields (N,).
            told: What `info` tells of the robots, by name.
            wanted: What they are to reach.
        """

    @staticmethod
    @abstractmethod
    def distances(achieved: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far goals are (N,) [m], and whether they are reached (N,)."""

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:  # noqa: ANN401 - as there
        """Reward of having achieved one goal where another was wanted: that of `step`, bit for bit, for its own.

        Args:
            achieved_goal: What one robot has achieved (size,), or a row for each of many.
            desired_goal: What it was to achieve, likewise.
            info: Not looked at.

        Returns:
            A number, or one for each row.

        Raises:
            InvalidValueError: For what is no goal.
        """
        del info
        return self.reward(achieved_goal, desired_goal)

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:  # noqa: ANN401 - as above
        """Whether the robot has failed, by what `step` told: to reach a goal ends no episode; arguments as above."""
        del achieved_goal, desired_goal
        return has_failed(info)

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:  # noqa: ANN401 - as above
        """False: time is up by the wrapper that counts it, as there; arguments as above."""
        del desired_goal, info
        shape = np.shape(achieved_goal)[:-1]
        return np.zeros(shape, bool) if shape else False

    def reward(self, achieved: object, wanted: object) -> Any:  # noqa: ANN401 - a number, or an array of them
        """Rewards (…) of goals (…, size), in double precision; `InvalidValueError` for what is no goal."""
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
    """Where the torso is to lie."""

    fields = (
        Field("position", 2, 100.0, "m", "x, y of the torso, world"),
        Field("yaw", 1, 4.0, "rad", "of the torso"),
    )
    left_out = ("goal_position", "goal_heading", "joint_way", "steps_left")
    reach = f"the torso is within {1000 * SUCCESS_POSITION:g} mm and {SUCCESS_YAW:g} rad of it"
    far = f"the way to it [m], a radian counting {TURN_LENGTH:g} m"

    @staticmethod
    def wanted(fleet: Fleet) -> np.ndarray:
        """The goals of the crawls (N, 3)."""
        goal = fleet.robots["goal"]
        return np.stack((goal["x"], goal["y"], goal["yaw"]), axis=1)

    @staticmethod
    def achieved(state: np.ndarray, told: Callable[[str], np.ndarray], wanted: np.ndarray) -> np.ndarray:
        """Where the torsos are (N, 3)."""
        del told, wanted
        w, x, y, z = state["quat_wb"].T
        yaw = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
        return np.concatenate((state["position_w"][:, :2], yaw[:, None]), axis=1)

    @staticmethod
    def distances(achieved: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far poses (N, 3) are, and whether they are reached."""
        x, y, turn = (wanted - achieved).T
        way, turn = np.sqrt(x * x + y * y), np.abs(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi)
        return way + TURN_LENGTH * turn, (way <= SUCCESS_POSITION) & (turn <= SUCCESS_YAW)


class HoverGoal(Goal):
    """Where the CoG is to hover, how the torso is to be turned, and the form to take."""

    fields = (
        Field("com", 3, 100.0, "m", "CoG, world, by the description"),
        Field("attitude", 4, 1.0, "", "quaternion w, x, y, z of the torso, w at least 0"),
        Field("joints", N_JOINTS, 4.0, "rad", "q"),
    )
    left_out = ("position_error", "attitude_error", "joint_target_error", "next_form", "time_to_next_form")
    reach = (
        f"the CoG is within {1000 * HOVER_POSITION:g} mm, the attitude within {HOVER_ATTITUDE:g} rad and every joint "
        f"within {ARRIVAL_TOLERANCE:g} rad of it"
    )
    far = (
        f"that of the CoG [m], a radian of attitude counting {TURN_LENGTH:g} m, one of the farthest joint "
        f"{JOINT_LENGTH:g} m"
    )

    @staticmethod
    def wanted(fleet: Fleet) -> np.ndarray:
        """Place, attitude and form of the flights (N, 23)."""
        robots = fleet.robots
        form = fleet.goals[np.arange(len(robots)), robots["current"]]["joint_target"]
        return np.concatenate((robots["reference"]["position_w"], robots["reference"]["quat_wb"], form), axis=1)

    @staticmethod
    def achieved(state: np.ndarray, told: Callable[[str], np.ndarray], wanted: np.ndarray) -> np.ndarray:
        """Where the CoGs are, how the torsos are turned, and where the joints are (N, 23)."""
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
        """How far goals (N, 23) are, and whether they are reached."""
        x, y, z = (wanted - achieved).T[:3]
        place = np.sqrt(x * x + y * y + z * z)
        turn = np.minimum(_chord(achieved, wanted, -1.0), _chord(achieved, wanted, 1.0))
        angle = 4.0 * np.arcsin(np.minimum(0.5 * turn, 1.0))
        joint = np.abs(wanted[:, 7:] - achieved[:, 7:]).max(axis=1)
        is_reached = (place <= HOVER_POSITION) & (angle <= HOVER_ATTITUDE) & (joint <= ARRIVAL_TOLERANCE)
        return place + TURN_LENGTH * angle + JOINT_LENGTH * joint, is_reached


def _chord(achieved: np.ndarray, wanted: np.ndarray, sign: float) -> np.ndarray:
    """How far the quaternions of goals are apart (N,): q and −q are one attitude."""
    w, x, y, z = (wanted + sign * achieved).T[3:7]
    return np.sqrt(w * w + x * x + y * y + z * z)


def has_failed(info: object) -> Any:  # noqa: ANN401 - a flag, or an array of flags
    """Whether an episode is over because of a failure, by what `step` told, of one robot, a list or a vector."""
    if isinstance(info, Mapping):
        if "failure" in info:
            return info["failure"] != ""
        if "failure_code" in info:
            return np.asarray(info["failure_code"]) >= 0
    elif isinstance(info, list | tuple | np.ndarray):
        return np.array([has_failed(each) for each in info], bool)
    raise InvalidValueError("info", info, "what step told: with failure, or failure_code of a vector")
