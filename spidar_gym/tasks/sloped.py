"""Rewards with a slope everywhere, for learning from nothing: the tasks of the other pages, with other reward terms.

In the air every term is positive and falls with the error at any distance; it ends with the episode, so that a fall
costs what the rest of the flight would have brought. On the floor a step is worth the way that it gains, so that lying
still is worth nothing, and a way back costs what the way there has brought.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from spidar_gym.control.flight.observation import Field
from spidar_gym.sim.ground import TILE, TILES
from spidar_gym.tasks.course import CourseTask
from spidar_gym.tasks.crawl import SHORTFALLS, CrawlTask
from spidar_gym.tasks.grasp import CLEAR_OF, GraspTask
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.path import PathTask
from spidar_gym.tasks.robots import CourseRobots, CrawlRobots, GraspRobots, HoverRobots
from spidar_gym.tasks.task import Task, length, require_ranges, tolerance

WIDE_POSITION, WIDE_ATTITUDE = 0.15, 0.15
"""Errors at which the wide terms of a flight are ½ [m], [rad]."""
WIDE_VELOCITY, WIDE_TURNING = 0.3, 0.5
"""Errors at which the terms of the velocities are ½ [m/s], [rad/s]; they tell a thrust's effect at the next tick."""
NARROW_POSITION, NARROW_ATTITUDE = 0.03, 0.03
"""Errors at which the narrow terms of a flight are ½ [m], [rad]."""
WHOLE = 100.0
"""Value of the whole way to the goal, and of the arrival there."""
FARTHEST = 3.0
"""Distance from the place of a grip at which a robot has gained nothing [m]."""
PER_WH = 1.0
"""Value of a watt-hour."""
ARRIVAL = {"arrival_position": (1e-3, 1.0, "m"), "arrival_yaw": (1e-3, 3.2, "rad")}
"""Least and largest value of each argument, and its unit."""
_FLIGHT: Mapping[str, tuple[float, str]] = {
    "position": (0.25, f"1 / (1 + ‖position error‖ / {WIDE_POSITION:g} m)"),
    "attitude": (0.15, f"1 / (1 + ‖attitude error‖ / {WIDE_ATTITUDE:g} rad)"),
    "velocity": (0.1, f"1 / (1 + ‖velocity error‖ / {WIDE_VELOCITY:g} m/s)"),
    "turning": (0.1, f"1 / (1 + ‖angular velocity error‖ / {WIDE_TURNING:g} rad/s)"),
    "still": (0.2, f"1 / (1 + (‖position error‖ / {NARROW_POSITION:g} m)²)"),
    "level": (0.1, f"1 / (1 + (‖attitude error‖ / {NARROW_ATTITUDE:g} rad)²)"),
    "action": (0.1, "1 − mean a²"),
}
_MEMORY = (("share", "f8", ()), ("gained", "f8", ()), ("energy_wh", "f8", ()), ("spent_wh", "f8", ()))


def slope(error: np.ndarray, width: float) -> np.ndarray:
    """Return 1 / (1 + error / width): 1 at no error, ½ at `width`, with a slope at any error ≥ 0."""
    return 1.0 / (1.0 + error / width)


def _flight_terms(robots: HoverRobots) -> Mapping[str, np.ndarray]:
    return {
        "position": slope(robots.distance, WIDE_POSITION),
        "attitude": slope(robots.angle, WIDE_ATTITUDE),
        "velocity": slope(length(robots.error["velocity_w"]), WIDE_VELOCITY),
        "turning": slope(length(robots.error["omega_b"]), WIDE_TURNING),
        "still": tolerance(robots.distance, NARROW_POSITION),
        "level": tolerance(robots.angle, NARROW_ATTITUDE),
        "action": 1.0 - robots.effort,
    }


@dataclass(frozen=True)
class SlopedHover(HoverTask):
    """The hover, with wide terms beside narrow ones."""

    reward_terms = _FLIGHT

    def terms(self, robots: HoverRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward, in [0, 1]."""
        return _flight_terms(robots)


@dataclass(frozen=True)
class SlopedPath(PathTask):
    """The path, with wide terms beside narrow ones."""

    reward_terms = _FLIGHT

    def terms(self, robots: HoverRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward, in [0, 1]."""
        return _flight_terms(robots)


def _advance(robots: CrawlRobots | CourseRobots) -> None:
    """Note the share of the way that a step has gained, and the energy that it has spent."""
    memory = robots.memory
    share, energy = 1.0 - robots.distance / robots.initial_distance, robots.records["plant"]["energy_wh"]
    memory["gained"], memory["share"] = share - memory["share"], share
    memory["spent_wh"], memory["energy_wh"] = energy - memory["energy_wh"], energy


def _progress_terms(robots: CrawlRobots | CourseRobots, arrived: np.ndarray) -> Mapping[str, np.ndarray]:
    return {
        "progress": WHOLE * robots.memory["gained"],
        "arrival": np.where(arrived, WHOLE, 0.0),
        "energy": -PER_WH * robots.memory["spent_wh"],
    }


_WAY: Mapping[str, tuple[float, str]] = {
    "progress": (0.8, f"{WHOLE:g} × share of the way to the goal that the step has gained"),
    "arrival": (0.1, f"{WHOLE:g} in the step in which the robot arrives, which ends the episode"),
    "energy": (0.1, f"−{PER_WH:g} per Wh"),
}


@dataclass(frozen=True)
class SlopedCrawl(CrawlTask):
    """The crawl, by progress; it ends where the robot lies or stands at the goal."""

    arrival_position: float = 0.05
    """Largest position error of an arrival [m]."""
    arrival_yaw: float = 0.1
    """Largest yaw error of an arrival [rad]."""

    reward_terms = _WAY
    memory: ClassVar[tuple[tuple[Any, ...], ...]] = _MEMORY
    ends_with_success = True

    def __post_init__(self) -> None:
        """Validate the options."""
        super().__post_init__()
        require_ranges(self, ARRIVAL)

    def advance(self, robots: CrawlRobots) -> None:
        """Note the progress of a step."""
        _advance(robots)

    def terms(self, robots: CrawlRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward."""
        return _progress_terms(robots, self.succeeded(robots))

    def shortfalls(self, robots: CrawlRobots) -> Mapping[str, np.ndarray]:
        """Return which criteria of an arrival each robot misses; the others of `SHORTFALLS` are never missed."""
        return {
            **dict.fromkeys(SHORTFALLS, np.zeros(len(robots), bool)),
            "position": robots.position_error > self.arrival_position,
            "yaw": robots.yaw_error > self.arrival_yaw,
        }

    def succeeded(self, robots: CrawlRobots) -> np.ndarray:
        """Return which robots have arrived at the goal."""
        return (robots.position_error <= self.arrival_position) & (robots.yaw_error <= self.arrival_yaw)


_AHEAD = np.stack(np.meshgrid(0.25 * np.arange(-2, 5), 0.25 * np.arange(-2, 3), indexing="ij"), axis=-1).reshape(-1, 2)
"""Points at which heights are observed, from the torso along its heading and to its left (35, 2) [m]."""


@dataclass(frozen=True)
class SlopedSteps(SlopedCrawl):
    """The crawl over tiles, by progress, with the heights of the map in sight."""

    fields = (
        Field(
            "heights", len(_AHEAD), 0.5, "m",
            "of the map's tiles over the lowest: 0.5 m behind to 1 m ahead of the torso, at each 0.5 m right to left",
            scale=0.05,
        ),
    )  # fmt: skip

    def observe(self, robots: CrawlRobots) -> Mapping[str, np.ndarray]:
        """Return the heights around the torso, as far as the robot knows where it is; 0 beyond the map."""
        seen, tiles = robots.records["episode"]["seen"], robots.records["plant"]["config"]["ground"]["tiles"]
        w, x, y, z = np.moveaxis(seen["quat_wb"], -1, 0)
        yaw = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))[:, None]
        c, s = np.cos(yaw), np.sin(yaw)
        ahead, left = _AHEAD.T
        at_x = seen["position_w"][:, :1] + c * ahead - s * left
        at_y = seen["position_w"][:, 1:2] + s * ahead + c * left
        i, j = (np.floor(each / TILE) + TILES // 2 for each in (at_x, at_y))
        inside = (i >= 0) & (i < TILES) & (j >= 0) & (j < TILES)
        cell = np.where(inside, i * TILES + j, 0.0).astype(int)
        heights = np.take_along_axis(tiles.reshape(len(tiles), -1), cell, axis=1)
        return {"heights": np.where(inside, heights, 0.0)}


@dataclass(frozen=True)
class SlopedCourse(CourseTask):
    """The course, by progress; it ends where the robot lies at the goal."""

    reward_terms = _WAY
    memory: ClassVar[tuple[tuple[Any, ...], ...]] = _MEMORY
    ends_with_success = True

    def advance(self, robots: CourseRobots) -> None:
        """Note the progress of a step."""
        _advance(robots)

    def terms(self, robots: CourseRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward."""
        return _progress_terms(robots, self.succeeded(robots))


@dataclass(frozen=True)
class SlopedGrasp(GraspTask):
    """The grasp, by progress: to the object, around it, up, to the goal, and away from it."""

    reward_terms = {  # noqa: RUF012 - the form in which derived tasks write it
        "progress": (0.7, f"{WHOLE:g} × the gain of the step: ¼ of the way to the object, ¼ of the closing of the feet "
                          "and of the lift, ½ of the way to the goal"),
        "arrival": (0.25, f"{WHOLE:g} in the step in which the object stands at its goal, released"),
        "energy": (0.05, f"− {PER_WH:g} per watt-hour"),
    }  # fmt: skip
    memory: ClassVar[tuple[tuple[Any, ...], ...]] = _MEMORY
    ends_with_success = True

    def advance(self, robots: GraspRobots) -> None:
        """Note the progress of a step."""
        memory = robots.memory
        energy = robots.records["plant"]["energy_wh"]
        begins = robots.ticks <= 1
        delivered = robots.way <= 0.1
        near = np.where(delivered, 1.0, 1.0 - np.minimum(1.0, robots.reach / FARTHEST))
        lifted = np.clip(robots.lifted / 0.5, 0.0, 1.0)
        held = np.where(delivered, 1.0, 0.5 * robots.touching / 4.0 + 0.5 * lifted)
        away = np.where(delivered, np.clip(robots.clear / CLEAR_OF, 0.0, 1.0), 0.0)
        done = 0.9 * np.clip(1.0 - robots.way / robots.initial_way, 0.0, 1.0) + 0.1 * away
        share = 0.25 * near + 0.25 * held + 0.5 * done
        memory["gained"] = np.where(begins, 0.0, share - memory["share"])
        memory["spent_wh"] = np.where(begins, 0.0, energy - memory["energy_wh"])
        memory["share"], memory["energy_wh"] = share, energy

    def terms(self, robots: GraspRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward."""
        return {
            "progress": WHOLE * robots.memory["gained"],
            "arrival": np.where(self.succeeded(robots), WHOLE, 0.0),
            "energy": -PER_WH * robots.memory["spent_wh"],
        }


SLOPED: Mapping[type[Task[Any]], type[Task[Any]]] = {
    HoverTask: SlopedHover, PathTask: SlopedPath, CrawlTask: SlopedCrawl, CourseTask: SlopedCourse,
    GraspTask: SlopedGrasp,
}  # fmt: skip
"""Task with `reward="sloped"`, by the task without."""
REWARDS = ("narrow", "sloped")
"""Values of the argument `reward`."""
