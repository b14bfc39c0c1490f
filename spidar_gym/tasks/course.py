"""The course: reach a pose behind walls, beams and slots, in the air and on the floor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.control.course.gates import FLOORS, GATES, HALF_WIDTH, KINDS, MAX_GATES, Course
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.native.course_records import read_course
from spidar_gym.native.draws import from_numpy, take_back
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.library import load_core, pointer
from spidar_gym.tasks.robots import CourseRobots
from spidar_gym.tasks.task import Task, require_ranges, tolerance, write_constants

PLAIN = "plain"
"""The empty floor."""
SIZES = {
    "wall": (0.4, 1.0),
    "beam": (0.55, 0.7),
    "slot": (1.3, 2.2),
    "platform": (0.1, 0.4),
    "tiles": (0.005, 0.02),
    "slope": (math.radians(3.0), math.radians(10.0)),
}
"""Range of each kind's size: height, clearance, width, height of the platform, highest tile [m], angle [rad]."""
DEPTHS = {"wall": 0.2, "beam": 0.4, "slot": 0.3}
"""Length of each gate along the course [m]."""
FIRST_GAP, GAP, FLOOR_GAP, FLOOR_LENGTH = (2.2, 2.6), (3.0, 3.4), 2.6, 3.5
"""Gaps from the start to the first gate, between gates, and from the last gate to the goal's floor [m]; length of the
goal's floor [m]."""
MIDDLE = 0.8
"""Largest lateral offset of a slot's middle [m]."""
GOAL_WAY, GOAL_SIDE, GOAL_YAW = (1.5, 1.9), 0.4, 0.4
"""Distance of the goal behind the beginning of its floor [m], its largest lateral offset [m] and yaw [rad]."""
CHARGE = (0.6, 1.0)
"""Range of the battery's charge at the start."""
DECIDE = 20
"""Control periods between decisions about the target: 0.5 s."""
MAX_HIT, MAX_TILT = 20.0, 1.2
"""A larger force on parts other than feet and pegs [N], or a larger tilt [rad], ends the episode."""
LIES, AT_REST, CARRIED = 0.06, 0.05, 0.1
"""The robot lies if its torso is less than this above its height on the pegs [m], it moves slower than this [m/s], and
its rotors carry less than this share of its weight."""
TURN_LENGTH = 0.5
"""Length that a radian of heading counts as in a distance to the goal [m]."""
MOST_POWER = 3000.0
"""Electrical power at which the reward term `power` is 0 [W]."""
SUCCESS_POSITION, SUCCESS_YAW = 0.03, 0.05
"""Largest position [m] and yaw error [rad] of a success."""
RANGES = {
    "charge": (1e-3, 1.0, "1"),
    "joint_speed": (0.1, 2.0, "rad/s"),
    "crawl_speed": (0.05, 2.0, "rad/s"),
    "horizon_s": (1.0 / CONTROL_RATE, 1e9, "s"),
}
"""Least and largest value of each argument, and its unit."""


@dataclass(frozen=True)
class CourseTask(Task[CourseRobots]):
    """Reach a pose on the floor behind walls, beams and slots: fly over, crawl under, fly through in a narrow form."""

    gates: tuple[str, ...] = GATES
    """Kinds of gates to sample from: any of `wall`, `beam`, `slot`."""
    floors: tuple[str, ...] = (PLAIN, *FLOORS)
    """Floors of the goal to sample from: any of `plain`, `platform`, `tiles`, `slope`."""
    count: tuple[int, int] = (2, 3)
    """Least and largest number of gates."""
    course: Course | None = None
    """Custom course, the same in every episode: a `Course`, or `{"gates": [[kind, begin, end, size, middle], …],
    "goal": [x, y, yaw], "tiles": […]}`; sampled if None."""
    charge: float | None = None
    """Charge of the battery at the start, 0 … 1; sampled from 0.6 … 1 if None."""
    joint_speed: float = 0.6
    """Joint speed in flight [rad/s]."""
    crawl_speed: float = 0.4
    """Joint speed on the floor [rad/s]."""
    horizon_s: float = 300.0
    """Length of an episode [s]."""

    robots = CourseRobots
    reward_terms = {  # noqa: RUF012 - the form in which derived tasks write it
        "progress": (0.6, "1 − distance to the goal / initial distance; a radian counts as 0.5 m"),
        "goal": (0.2, "1 / (1 + (distance to the goal / 0.03 m)²) while the robot lies, else 0"),
        "power": (0.1, "1 − electrical power / 3000 W"),
        "safety": (0.1, "1 / (1 + (largest force on ducts and links / 5 N)²)"),
    }
    failures = {  # noqa: RUF012 - as above
        "hit": f"a force of more than {MAX_HIT:g} N acts on a part other than feet and pegs",
        "out": f"the robot leaves the field, ± {HALF_WIDTH:g} m wide, from the floor to the ceiling, from behind the "
        "start to past the goal",
        "tilt": f"the torso tilts by more than {MAX_TILT:g} rad, or the rotors are cut in the air",
        "empty": "the battery's usable charge is used up",
        "diverged": "the simulation's state is no longer finite",
    }
    stops = {  # noqa: RUF012 - as above
        "hit": MAX_HIT, "is_outside": 0.0, "tilt": MAX_TILT, "is_cut": 0.0, "is_empty": 0.0,
    }  # fmt: skip

    def terms(self, robots: CourseRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward, in [0, 1]."""
        return {
            "progress": np.maximum(0.0, 1.0 - robots.distance / robots.initial_distance),
            "goal": np.where(robots.lies > 0.0, tolerance(robots.distance, 0.03), 0.0),
            "power": np.maximum(0.0, 1.0 - robots.power / MOST_POWER),
            "safety": tolerance(robots.hit, 5.0),
        }

    def failed(self, robots: CourseRobots) -> Mapping[str, np.ndarray]:
        """Return the failures of each robot."""
        beyond = {name: getattr(robots, name) > limit for name, limit in self.stops.items()}
        return {
            "hit": beyond["hit"], "out": beyond["is_outside"], "tilt": beyond["tilt"] | beyond["is_cut"],
            "empty": beyond["is_empty"],
        }  # fmt: skip

    def succeeded(self, robots: CourseRobots) -> np.ndarray:
        """Return which robots lie at the goal."""
        near = (robots.position_error <= SUCCESS_POSITION) & (robots.yaw_error <= SUCCESS_YAW)
        return near & (robots.lies > 0.0)

    def __post_init__(self) -> None:
        """Validate the options."""
        require_ranges(self, RANGES)
        for name, kind, valid in (("gates", "gate", GATES), ("floors", "floor", (PLAIN, *FLOORS))):
            given = getattr(self, name)
            if not isinstance(given, str | tuple | list):
                raise InvalidValueError(name, given, f"any of {', '.join(valid)}")
            chosen = (given,) if isinstance(given, str) else tuple(given)
            for each in chosen:
                require_name(kind, each, valid)
            object.__setattr__(self, name, chosen)
        count = self.count
        whole = isinstance(count, tuple | list) and len(count) == 2 and all(isinstance(n, int) for n in count)
        if not (whole and 0 <= count[0] <= count[1] < MAX_GATES):
            raise InvalidValueError("count", count, f"two whole numbers within 0 … {MAX_GATES - 1}, the least first")
        if not self.floors or (count[1] and not self.gates):
            raise InvalidValueError("gates", self.gates, "at least one kind of gate, and one of floors")
        object.__setattr__(self, "count", tuple(count))

    def draw_course(self, rng: np.random.Generator) -> Course:
        """Sample the course of an episode as the engine does, advancing `rng` as the engine does."""
        if self.course is not None:
            return self.course
        generator, layouts = from_numpy(rng), engine_layouts()
        rules, course = np.zeros((), layouts["course_rules"]), np.zeros((), layouts["course"])
        self.write(rules)
        load_core().sp_draw_course(pointer(rules), pointer(generator), pointer(course))
        take_back(rng, generator)
        return read_course(course)

    def write(self, rules: Any) -> None:  # noqa: ANN401 - a record of `sp_course_rules`
        """Write the options and constants that the engine needs into `rules`."""
        floors = [len(KINDS) if floor == PLAIN else KINDS.index(floor) for floor in self.floors]
        rules["kinds"][: len(self.gates)] = [KINDS.index(gate) for gate in self.gates]
        rules["floors"][: len(floors)] = floors
        rules["kind_count"], rules["floor_count"], rules["count"] = len(self.gates), len(floors), self.count
        rules["size"], rules["depth"] = [SIZES[kind] for kind in KINDS], [DEPTHS.get(kind, 0.0) for kind in KINDS]
        rules["charge"] = CHARGE if self.charge is None else self.charge
        places = "first_gap gap goal_way floor_gap floor_length middle goal_side goal_yaw"
        counts = "lies at_rest carried turn_length success_position success_yaw"
        write_constants(rules, globals(), f"{places} decide {counts}")
