"""The crawl: reach a pose on the floor by lifting the legs, setting them forward, and moving the torso after them."""

import ctypes
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spidar_gym.arrays import constant
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import SCHEDULES
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.native.draws import from_numpy, take_back
from spidar_gym.native.engine_structs import MAX_OBSTACLES, engine_layouts
from spidar_gym.native.library import load_core, pointer
from spidar_gym.native.structs import fill
from spidar_gym.sim.ground import HIGHEST, MAX_SLOPE, STAIRS, TERRAINS, TILES, GroundConfig, require_blocks, with_blocks
from spidar_gym.tasks.robots import CrawlRobots
from spidar_gym.tasks.task import Task, require_ranges, tolerance, write_constants

PAPER_WAY = Pose2(0.6, 0.0, 0.0)
"""The paper's displacement of the goal, 0.6 m straight ahead [Zhao2025, Sec. Crawling Motion]."""
PAPER_SHARE = 0.25
"""Share of episodes with exactly the paper's displacement, by default."""
DISTANCES, TURN = (0.2, 0.6), 0.5
"""Range of the distance [m], in any direction, and largest turn [rad] of all other episodes, by default."""
TURN_LENGTH = 0.5
"""Length that a radian of heading counts as in a distance to the goal [m]."""
OBSTACLE_HEIGHT, GOAL_CLEARANCE = 0.15, 0.3
"""Height of an obstacle, and least distance of a goal from it [m]."""
SETTLE_TICKS = 40
"""Control periods in which the robot settles on a floor that is not a plane."""
MAX_TILT, MAX_ASTRAY = 0.5, 0.5
"""A larger tilt against the floor [rad], or a distance to the goal so much above the initial one [m], ends the
episode."""
MOST_POWER = 3000.0
"""Electrical power at which the reward term `power` is 0 [W]."""
SUCCESS_POSITION, SUCCESS_YAW = 0.010, 0.02
"""Largest position [m] and yaw error [rad] of a success."""
SUCCESS_AIRBORNE, SUCCESS_SLIP, SUCCESS_TIME = 0.95, 0.05, 1.25
"""Limits of a success: least share of a foot's swing off the ground, slip of a foot [m], and time as a multiple of the
preset's nominal time."""
REST_TIME = 0.25
"""Without a gait, in `direct`, a crawl is finished after the robot has rested for this long within the errors of a
success [s]. An unsupported torso falls by 0.3 m in that time."""
REST_SPEED, REST_TURN, REST_JOINT_SPEED = 0.01, 0.05, 0.05
"""Limits of a robot at rest: speed [m/s], angular velocity [rad/s], speed of every joint [rad/s]. Sliding at that speed
for `REST_TIME` takes a quarter of `SUCCESS_POSITION`; the joints of a swing are ten times as fast."""
REST_THRUST = 0.1
"""The thrust is off if the sum of all commands is below this share of the weight; idle motors are at 6 %."""
SATURATED = 0.01
"""A joint servo is saturated within this distance of its largest torque [Nm]."""
SHORTFALLS = ("unfinished", "position", "yaw", "airborne", "timeout", "slip", "duct", "time")
"""Criteria of a success that a crawl can miss, in the order of their bits in `info`."""
_BITS = 1 << np.arange(len(SHORTFALLS))
RANGES = {
    "distance": (0.0, 10.0, "m"),
    "direction": (-2.0 * math.pi, 2.0 * math.pi, "rad"),
    # During a turn on the spot by more than π, the heading error first grows beyond its initial value.
    "turn": (-math.pi - MAX_ASTRAY / TURN_LENGTH, math.pi + MAX_ASTRAY / TURN_LENGTH, "rad"),
    "joint_speed": (1e-3, 2.0, "rad/s"),
    "friction": (1e-3, 5.0, "1"),
    "slope": (-MAX_SLOPE, MAX_SLOPE, "rad"),
    "slope_direction": (-2.0 * math.pi, 2.0 * math.pi, "rad"),
    "steps": (0.0, 0.2, "m"),
    "horizon_s": (1.0 / CONTROL_RATE, 1e9, "s"),
}
"""Least and largest value of each argument, and its unit."""
SEARCHED = 1000
"""Largest number of goals that are sampled to find one that no obstacle covers."""


@dataclass(frozen=True)
class CrawlTask(Task[CrawlRobots]):
    """Crawl to a pose on the floor: lift the legs, set them forward, move the torso after them."""

    distance: float | None = None
    """Distance to the goal [m]; sampled if None."""
    direction: float | None = None
    """Direction of the goal, 0 straight ahead, π/2 to the left [rad]; sampled if None."""
    turn: float | None = None
    """Turn of the heading [rad], sampled if None; the arc must lead less than 0.5 m away from the goal."""
    joint_speed: float | None = None
    """Joint speed [rad/s]; the preset's if None."""
    schedule: str | None = None
    """`sequential` or `overlapped` phases; the preset's if None."""
    friction: float | None = None
    """Sliding friction of the feet; the robot's if None."""
    slope: float = 0.0
    """Angle of the floor to the horizontal [rad]; a sample of the range `ground.slope` replaces it."""
    slope_direction: float = 0.0
    """Direction in which the floor rises [rad]; a sample of the range `ground.heading` replaces it."""
    steps: float = 0.0
    """Height of the steps of a floor of 25 cm tiles [m]; 0 is a plane."""
    terrain: str = "tiles"
    """Kind of steps: `tiles` with heights sampled up to `steps`, `stairs` of that height, at most 0.1 m, 0.5 and 1.25 m
    ahead of the start, or `mixed`, both equally often."""
    obstacles: tuple[tuple[float, float, float], ...] = ()
    """Blocks on the floor: (x, y, radius) from the start [m]; the tiles within are 15 cm high."""
    horizon_s: float = 75.0
    """Length of an episode [s]."""

    robots = CrawlRobots
    reward_terms = {  # noqa: RUF012 - the form in which derived tasks write it
        "progress": (0.5, "1 − distance to the goal / initial distance; a radian counts as 0.5 m"),
        "goal": (0.1, "1 / (1 + (distance to the goal / 0.01 m)²)"),
        "level": (0.1, "1 / (1 + (tilt against the floor / 0.03 rad)²)"),
        "slip": (0.1, "1 / (1 + (speed of the fastest touching point / 0.02 m/s)²)"),
        "power": (0.1, "1 − electrical power / 3000 W"),
        "action": (0.1, "1 − mean a²"),
    }
    failures = {  # noqa: RUF012 - as above
        "duct": "a duct touches the floor",
        "tilt": f"the torso tilts by more than {MAX_TILT:g} rad against the floor",
        "astray": f"the robot is {MAX_ASTRAY:g} m farther from the goal than at the start",
        "diverged": "the simulation's state is no longer finite",
    }
    stops = {"duct_touches": 0.0, "tilt": MAX_TILT}  # noqa: RUF012 - as above

    def terms(self, robots: CrawlRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward, in [0, 1]."""
        return {
            "progress": np.maximum(0.0, 1.0 - robots.distance / robots.initial_distance),
            "goal": tolerance(robots.distance, 0.01),
            "level": tolerance(robots.tilt, 0.03),
            "slip": tolerance(robots.slip, 0.02),
            "power": np.maximum(0.0, 1.0 - robots.power / MOST_POWER),
            "action": 1.0 - robots.effort,
        }

    def failed(self, robots: CrawlRobots) -> Mapping[str, np.ndarray]:
        """Return the failures of each robot."""
        return {
            "duct": robots.duct_touches > 0.0,
            "tilt": robots.tilt > MAX_TILT,
            "astray": robots.distance > robots.initial_distance + MAX_ASTRAY,
        }

    def shortfalls(self, robots: CrawlRobots) -> Mapping[str, np.ndarray]:
        """Return which criteria of a success each robot misses (N,), by the names in `SHORTFALLS`."""
        return {
            "unfinished": robots.finished == 0.0,
            "position": robots.position_error > SUCCESS_POSITION,
            "yaw": robots.yaw_error > SUCCESS_YAW,
            "airborne": robots.airborne < SUCCESS_AIRBORNE,
            "timeout": robots.timeouts > 0.0,
            "slip": robots.foot_slip >= SUCCESS_SLIP,
            "duct": robots.duct_touched > 0.0,
            "time": robots.finished > SUCCESS_TIME * robots.nominal_time,
        }

    def succeeded(self, robots: CrawlRobots) -> np.ndarray:
        """Return which robots have finished and miss no criterion of a success."""
        if not robots.finished.any():
            return robots.finished > 0.0
        return ~np.any(list(self.shortfalls(robots).values()), axis=0)

    def tell(self, robots: CrawlRobots) -> Mapping[str, np.ndarray]:
        """Return the missed criteria of a success as bits, an entry of `info`."""
        missed = self.shortfalls(robots)
        return {"shortfalls_code": _BITS @ np.array([missed[word] for word in SHORTFALLS])}

    def __post_init__(self) -> None:
        """Validate the options."""
        require_ranges(self, RANGES)
        if self.schedule is not None:
            require_name("schedule", self.schedule, SCHEDULES)
        require_name("terrain", self.terrain, TERRAINS)
        if self.terrain != "tiles" and self.steps > HIGHEST / STAIRS:
            raise InvalidValueError("steps", self.steps, f"stairs of at most {HIGHEST / STAIRS:g} m")
        object.__setattr__(self, "obstacles", require_blocks("obstacles", self.obstacles))
        if self.obstacles:
            self.draw_way(np.random.Generator(np.random.PCG64(0)))
        if self.distance == 0.0 and self.turn == 0.0:
            raise InvalidValueError("distance", 0.0, "a distance or a turn above 0")
        if self.turn is not None:
            astray = arc_astray(DISTANCES[1] if self.distance is None else self.distance, self.turn)
            if astray >= MAX_ASTRAY:
                raise InvalidValueError(
                    "turn", self.turn,
                    f"a smaller turn [rad] or a shorter distance: the arc leads {astray:.2f} m away from the goal, "
                    f"below {MAX_ASTRAY:g} m is valid",
                )  # fmt: skip

    def draw_way(self, rng: np.random.Generator) -> Pose2:
        """Sample the goal of an episode, relative to the start, as the engine does, advancing `rng` as the engine does.

        Raises:
            InvalidValueError: If obstacles cover all of `SEARCHED` sampled goals.
        """
        rules, way = (np.zeros((), engine_layouts()[name]) for name in ("crawl_rules", "pose2"))
        self.write(rules)
        generator = from_numpy(rng)
        if not load_core().sp_draw_way(pointer(rules), pointer(generator), ctypes.c_int64(SEARCHED), pointer(way)):
            where = f"obstacles that leave a goal {GOAL_CLEARANCE:g} m from each of them; the last goal tried is at"
            raise InvalidValueError("obstacles", self.obstacles, f"{where} ({way['x']:.3g}, {way['y']:.3g})")
        take_back(rng, generator)
        return Pose2(*way.tolist())

    def floor(self, base: GroundConfig) -> GroundConfig:
        """Return a floor like those of the episodes: `base` with this task's slope, obstacles and highest steps."""
        ground = GroundConfig(self.slope, self.slope_direction, base.tiles) if self.slope else base
        if self.steps:
            ground = replace(ground, tiles=constant(self.steps, TILES, TILES))
        return with_blocks(ground, self.obstacles, OBSTACLE_HEIGHT) if self.obstacles else ground

    def write(self, rules: Any) -> None:  # noqa: ANN401 - a record of `sp_crawl_rules`
        """Write the options and constants that the engine needs into `rules`.

        Raises:
            InvalidValueError: For more than `MAX_OBSTACLES` obstacles.
        """
        if len(self.obstacles) > MAX_OBSTACLES:
            raise InvalidValueError("obstacles", len(self.obstacles), f"at most {MAX_OBSTACLES} blocks")
        fill(rules["way"], PAPER_WAY)
        rules["share"], rules["distance"] = PAPER_SHARE, DISTANCES
        given = (self.distance, self.direction, self.turn)
        rules["is_given"], rules["given"] = [x is not None for x in given], [x or 0.0 for x in given]
        rules["steps"], rules["terrain"] = self.steps, TERRAINS.index(self.terrain)
        rules["obstacles"] = len(self.obstacles)
        rules["obstacle"][: len(self.obstacles)] = np.reshape(self.obstacles, (-1, 3))
        rests = "rest_time rest_speed rest_turn rest_joint_speed rest_thrust"
        counts = f"turn_length saturated success_position success_yaw {rests}"
        write_constants(rules, globals(), f"turn obstacle_height goal_clearance settle_ticks {counts}")


def arc_astray(distance: float, turn: float) -> float:
    """Return how far an arc leads away from its goal, beyond the initial distance [m]; a radian counts `TURN_LENGTH`.

    Args:
        distance: Length of the arc's chord [m].
        turn: Turn of the heading along the arc [rad].
    """
    turn = abs(turn)
    if turn <= math.pi:
        return 0.0
    # The goal is farthest where a turn of π remains: there the distance is the circle's diameter.
    diameter = distance / math.sin(0.5 * turn) if turn < 2.0 * math.pi else math.inf
    return diameter - distance + TURN_LENGTH * (turn - math.pi)
