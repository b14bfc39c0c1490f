"""The crawl's task for many robots at once, in NumPy: derive from it for a task of your own that a vector plays.

`CrawlTask` is the same page for one robot, `native/engine/crawling.c` in C; a test holds the three to each other.
"""

from collections.abc import Mapping

import numpy as np

from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.envs.batch import Robots, VectorTask, length, square, tolerance
from spidar_gym.envs.crawl.task import (
    CRAWL_FAILURES,
    CRAWL_REWARD_TERMS,
    GOAL_MARGIN,
    LEVEL_MARGIN,
    MAX_ASTRAY,
    MAX_TILT,
    MOST_POWER,
    SLIP_MARGIN,
    SUCCESS_AIRBORNE,
    SUCCESS_POSITION,
    SUCCESS_SLIP,
    SUCCESS_TIME,
    SUCCESS_YAW,
    CrawlTask,
)
from spidar_gym.envs.fleet import Fleet
from spidar_gym.robot import N_LEGS


class Walks(Robots):
    """What a task is told of N crawls; its arrays have an entry for every robot, and are not to be written.

    What an episode has cost so far, the fields of `CrawlProgress`, the engine counts: `robots["foot_slip"]` …
    """

    kind, counter = "crawling", "crawled"

    def __init__(self, fleet: Fleet, memory: np.ndarray, crawl: CrawlTask) -> None:
        """Look at them; `crawl` has the options of the environment."""
        super().__init__(fleet, memory)
        self.crawl = crawl

    @property
    def error(self) -> np.ndarray:
        """Goal − torso (N, 3): x, y [m], world, and yaw [rad]."""
        return self.robots["error"]

    @property
    def distance(self) -> np.ndarray:
        """Distance to the goal, a radian counting 0.5 m (N,) [m]."""
        return self.robots["distance"]

    @property
    def initial_distance(self) -> np.ndarray:
        """The same at the start (N,) [m]."""
        return self.robots["initial_distance"]

    @property
    def tilt(self) -> np.ndarray:
        """Angle of the torso against the floor (N,) [rad]."""
        return self.robots["tilt"]

    @property
    def finished(self) -> np.ndarray:
        """When the gait was done, or in `direct` the robot had rested at the goal; 0 before (N,) [s]."""
        return self.robots["finished"]

    @property
    def phase(self) -> np.ndarray:
        """Phase of the gait, a number of `PHASES` (N,)."""
        return self.robots["crawl"]["gait"]["phase"]

    def in_phase(self, *names: str) -> np.ndarray:
        """Whose gait is in one of these phases (N,)."""
        return np.isin(self.phase, [PHASES.index(name) for name in names])

    @property
    def slip(self) -> np.ndarray:
        """Speed of the touching points of the feet, then of the torso's pegs (N, 8) [m/s]."""
        return self.robots["touch"]["slip"]

    @property
    def feet_touch(self) -> np.ndarray:
        """Whether each foot touches the floor (N, 4)."""
        return self.robots["touch"]["balls"][:, :N_LEGS] != 0

    @property
    def ducts_touch(self) -> np.ndarray:
        """Whether a duct touches the floor (N,)."""
        return self.robots["touch"]["ducts"] != 0

    def begin(self, task: "WalkTask", ids: np.ndarray) -> None:
        """The engine has drawn the goal, and has counted nothing yet."""

    def aim(self, task: "WalkTask") -> None:
        """The gait goes to the goal."""


class WalkTask(VectorTask[Walks]):
    """Crawl to a pose: what a robot is to do. Where the goal is, the environment's options say."""

    robots = Walks
    reward_terms: Mapping[str, tuple[float, str]] = CRAWL_REWARD_TERMS
    """Weight and formula of each term; the weights add up to 1."""
    failures: Mapping[str, str] = CRAWL_FAILURES
    """Why an episode may be over, and what the words mean; `diverged` is the engine's own."""

    def advance(self, walks: Walks) -> None:
        """Count a tick: what `CrawlProgress` has, the engine has counted."""

    def terms(self, walks: Walks) -> Mapping[str, np.ndarray]:
        """Terms of the reward (N,) in [0, 1]; the reward is their sum weighted with `reward_terms`."""
        action = walks.action
        return {
            "progress": np.maximum(0.0, 1.0 - walks.distance / walks.initial_distance),
            "goal": tolerance(walks.distance, GOAL_MARGIN),
            "level": tolerance(walks.tilt, LEVEL_MARGIN),
            "slip": tolerance(walks.slip.max(axis=1), SLIP_MARGIN),
            "power": np.maximum(0.0, 1.0 - walks.power / MOST_POWER),
            "action": 1.0 - square(action) / action.shape[1],
        }

    def failed(self, walks: Walks) -> Mapping[str, np.ndarray]:
        """Whose episode is over why (N,), by word; the first that holds counts."""
        return {
            "duct": walks.ducts_touch,
            "tilt": walks.tilt > MAX_TILT,
            "astray": walks.distance > walks.initial_distance + MAX_ASTRAY,
        }

    def succeeded(self, walks: Walks) -> np.ndarray:
        """Who has arrived, in time, without a time-out, with feet that leave the floor and do not slide on it (N,)."""
        robots = walks.robots
        swings = np.maximum(robots["swing_ticks"], 1)
        airborne = np.where(robots["swing_ticks"] > 0, robots["airborne_ticks"].min(axis=1) / swings, 1.0)
        return (
            (walks.finished > 0.0)
            & (length(walks.error[:, :2]) <= SUCCESS_POSITION)
            & (np.abs(walks.error[:, 2]) <= SUCCESS_YAW)
            & (airborne >= SUCCESS_AIRBORNE)
            & (robots["timeouts"] == 0)
            & (robots["foot_slip"].max(axis=1) < SUCCESS_SLIP)
            & (robots["duct_contact"] == 0)
            & (walks.finished <= SUCCESS_TIME * robots["nominal_time"])
        )
