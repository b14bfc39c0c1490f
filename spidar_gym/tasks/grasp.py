"""The grasp: close the legs around an object, lift it, carry it and put it down at its goal."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.grasp.claw import NARROWEST, WIDEST
from spidar_gym.control.grasp.scene import GraspScene, parse_scene
from spidar_gym.control.locomotion.commands import OBJECTS
from spidar_gym.errors import InvalidValueError, require_name, require_within
from spidar_gym.native.draws import from_numpy, take_back
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.grasp_records import read_scene
from spidar_gym.native.library import load_core, pointer
from spidar_gym.tasks.robots import GraspRobots
from spidar_gym.tasks.task import Task, require_ranges, tolerance, write_constants

SHARES = {"box": 0.6, "cylinder": 0.4, "ball": 0.25}
"""Share of each shape relative to the others that are chosen."""
HALF_WIDTH, HALF_HEIGHT = (0.18, 0.34), (0.15, 0.28)
"""Ranges of half the width and half the height of an object [m]; beyond this width the outer batteries come near."""
OFF_CENTRE = 0.2
"""Largest offset of the centre of mass along each axis, as a share of the half size."""
DISTANCE, TURN = (1.0, 2.0), (-0.6, 0.6)
"""Ranges of the way from the start to the object: distance [m], direction from the heading [rad]."""
GOAL_DISTANCE, GOAL_TURN, GOAL_YAW = (2.0, 3.0), (-0.6, 0.6), (-0.7, 0.7)
"""Ranges of the way from the object to the goal: distance [m], turn from the way to the object [rad]; and of the turn
of the object [rad]."""
BIAS, NOISE, TURN_NOISE = 0.005, 0.001, 0.002
"""Largest error of the seen object's position along each axis [m]; standard deviations of its noise [m], [rad]."""
BEGIN_HEIGHT = 1.6
"""Height of the torso at the start [m]."""
RESERVE = 1.15
"""Reserve of the largest grip over the least that holds the object, in sampled scenes."""
DECIDE = 20
"""Control periods between decisions with `order`: 0.5 s."""
PLACED, TURNED, UPRIGHT, AT_REST = 0.1, math.radians(15.0), math.radians(15.0), 0.05
"""Largest error of the object's place [m], of its heading [rad], its tilt [rad] and its speed [m/s] of a success."""
CLEAR_OF, HIGH = 0.05, 0.5
"""Least distance of the feet from the object after the release [m], and least height of the lift of a success [m]."""
FIELD, CEILING = 8.0, 4.0
"""Largest distance from the start along x and y, and largest height of the torso [m]."""
DROPPED = 1.0
"""An object that falls faster than this is dropped [m/s]: 5 cm of free fall."""
BROKEN = 1.5
"""An object breaks when the mean force of a foot over a tenth of a second exceeds the one that it bears by this
factor."""
FORCE_TIME, TOUCH = 0.1, 0.2
"""Time of the mean of the forces of the feet [s], and mean force from which a foot touches the object [N]."""
MAX_TILT = 1.2
"""A larger tilt ends the episode [rad]."""
MOST_POWER = 8000.0
"""Electrical power at which the reward term `power` is 0 [W]."""
RANGES = {
    "off_centre": (0.0, 0.5, "1"),
    "joint_speed": (0.1, 2.0, "rad/s"),
    "pressure": (0.0, 10.0, "1"),
    "horizon_s": (1.0 / CONTROL_RATE, 1e9, "s"),
}
"""Least and largest value of each argument, and its unit."""
PAIRS = {
    "half_width": (NARROWEST, WIDEST, "m"),
    "half_height": (0.1, 0.5, "m"),
    "mass": (0.05, 20.0, "kg"),
    "friction": (0.0, 10.0, "1"),
    "most_force": (1.0, 1000.0, "N"),
    "stand": (0.0, 1.0, "m"),
    "floor": (0.0, 1.0, "m"),
}
"""Least and largest value of each argument that is a range, and its unit."""


@dataclass(frozen=True)
class GraspTask(Task[GraspRobots]):
    """Grasp an object with the legs, lift it, carry it and put it down at its goal."""

    shapes: tuple[str, ...] = ("box", "cylinder")
    """Shapes to sample from: any of `box`, `cylinder`, `ball`; a ball stands between four blocks."""
    half_width: tuple[float, float] = HALF_WIDTH
    """Range of half the width of an object [m]."""
    half_height: tuple[float, float] = HALF_HEIGHT
    """Range of half its height [m]; a ball is as high as it is wide."""
    mass: tuple[float, float] = (0.3, 3.0)
    """Range of its mass [kg], whose logarithm is uniform; hidden."""
    friction: tuple[float, float] = (0.4, 1.0)
    """Range of its friction; hidden."""
    most_force: tuple[float, float] = (33.0, 33.0)
    """Range of the force that a foot may press it with [N]; observed."""
    off_centre: float = OFF_CENTRE
    """Largest offset of its centre of mass along each axis, as a share of the half size; hidden."""
    stand: tuple[float, float] = (0.0, 0.0)
    """Range of the height of the stand below it at the start [m]."""
    floor: tuple[float, float] = (0.0, 0.0)
    """Range of the height of the stand at the goal [m]."""
    pressure: float = 2.0
    """Pressure of jets on its faces over the dynamic pressure of the flow: 2 is full loss of normal momentum."""
    scene: GraspScene | None = None
    """Custom scene, the same in every episode: a `GraspScene`, or its numbers by name; sampled if None."""
    joint_speed: float = 0.4
    """Joint speed [rad/s]."""
    horizon_s: float = 75.0
    """Length of an episode [s]."""

    robots = GraspRobots
    reward_terms = {  # noqa: RUF012 - the form in which derived tasks write it
        "reach": (0.1, "1 / (1 + (distance of the torso from its place for the grip / 0.3 m)²), 1 once it was lifted"),
        "hold": (0.15, "share of the feet that touch the object; 1 once it is delivered"),
        "way": (
            0.3,
            "1 − distance of the object to its place at the goal / initial distance; a radian counts as 0.5 m",
        ),
        "place": (0.25, "1 / (1 + (that distance / 0.05 m)²) while the object rests and no foot is near, else 0"),
        "power": (0.1, "1 − electrical power / 8000 W"),
        "safety": (0.1, "1 / (1 + (force of a foot / force that the object bears)⁴)"),
    }
    failures = {  # noqa: RUF012 - as above
        "dropped": f"the object falls faster than {DROPPED:g} m/s",
        "broken": f"a foot presses with {BROKEN:g} times what the object bears, on average over a tenth of a second",
        "hit": "a part other than a foot touches the object, or one other than feet and pegs anything",
        "out": f"the torso is more than {FIELD:g} m from the start along x or y, or higher than {CEILING:g} m",
        "tilt": f"the torso tilts by more than {MAX_TILT:g} rad, or the rotors are cut in the air",
        "empty": "the battery's usable charge is used up",
        "diverged": "the simulation's state is no longer finite",
    }
    stops = {  # noqa: RUF012 - as above
        "fall": DROPPED, "pressed": BROKEN, "is_hit": 0.0, "is_outside": 0.0, "tilt": MAX_TILT, "is_cut": 0.0,
        "is_empty": 0.0,
    }  # fmt: skip

    def terms(self, robots: GraspRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward, in [0, 1]."""
        there = self.succeeded(robots)
        rests = (robots.object_speed <= AT_REST) & (robots.clear >= CLEAR_OF)
        pressed = robots.force / robots.records["scene"]["most_force"]
        return {
            "reach": np.where(robots.most_lifted > HIGH, 1.0, tolerance(robots.reach, 0.3)),
            "hold": np.where(there, 1.0, 0.25 * robots.touching),
            "way": np.maximum(0.0, 1.0 - robots.way / robots.initial_way),
            "place": np.where(rests, tolerance(robots.way, 0.05), 0.0),
            "power": np.maximum(0.0, 1.0 - robots.power / MOST_POWER),
            "safety": tolerance(pressed * pressed, 1.0),
        }

    def failed(self, robots: GraspRobots) -> Mapping[str, np.ndarray]:
        """Return the failures of each robot."""
        beyond = {name: getattr(robots, name) > limit for name, limit in self.stops.items()}
        return {
            "dropped": beyond["fall"], "broken": beyond["pressed"], "hit": beyond["is_hit"],
            "out": beyond["is_outside"], "tilt": beyond["tilt"] | beyond["is_cut"], "empty": beyond["is_empty"],
        }  # fmt: skip

    def succeeded(self, robots: GraspRobots) -> np.ndarray:
        """Return for which robots the object stands at its goal, released."""
        placed = (robots.position_error <= PLACED) & (robots.yaw_error <= TURNED) & (robots.object_tilt <= UPRIGHT)
        left = (robots.object_speed <= AT_REST) & (robots.clear >= CLEAR_OF)
        return placed & left & (robots.most_lifted >= HIGH)

    def __post_init__(self) -> None:
        """Validate the options."""
        require_ranges(self, RANGES)
        object.__setattr__(self, "scene", parse_scene(self.scene))
        given = self.shapes
        if not isinstance(given, str | tuple | list) or not given:
            raise InvalidValueError("shapes", given, f"any of {', '.join(OBJECTS)}")
        chosen = (given,) if isinstance(given, str) else tuple(given)
        for each in chosen:
            require_name("shape", each, OBJECTS)
        object.__setattr__(self, "shapes", chosen)
        for name, bounds in PAIRS.items():
            pair = getattr(self, name)
            if not isinstance(pair, tuple | list) or len(pair) != 2:
                raise InvalidValueError(name, pair, f"least and largest value [{bounds[2]}]")
            require_within(*bounds, **{f"{name}[0]": pair[0], f"{name}[1]": pair[1]})
            if pair[0] > pair[1]:
                raise InvalidValueError(name, tuple(pair), "the least value first")
            object.__setattr__(self, name, (float(pair[0]), float(pair[1])))

    @property
    def has_stands(self) -> bool:
        """Whether there are stands or blocks on the floor."""
        if self.scene is not None:
            return self.scene.shape == "ball" or max(self.scene.stand, self.scene.floor) > 0.0
        return "ball" in self.shapes or max(self.stand[1], self.floor[1]) > 0.0

    def draw_scene(self, rng: np.random.Generator) -> GraspScene:
        """Sample the scene of an episode as the engine does, advancing `rng` as the engine does."""
        if self.scene is not None:
            return self.scene
        generator, layouts = from_numpy(rng), engine_layouts()
        rules, scene = np.zeros((), layouts["grasp_rules"]), np.zeros((), layouts["grasp_scene"])
        self.write(rules)
        load_core().sp_draw_scene(pointer(rules), pointer(generator), pointer(scene))
        take_back(rng, generator)
        return read_scene(scene)

    def write(self, rules: Any) -> None:  # noqa: ANN401 - a record of `sp_grasp_rules`
        """Write the options and constants that the engine needs into `rules`."""
        shares = np.array([SHARES[shape] if shape in self.shapes else 0.0 for shape in OBJECTS])
        rules["shapes"] = shares / shares.sum()
        for name in ("half_width", "half_height", "mass", "friction", "most_force", "stand", "floor"):
            rules[name] = getattr(self, name)
        rules["off_centre"], rules["pressure"] = self.off_centre, self.pressure
        write_constants(
            rules, globals(),
            "distance turn goal_distance goal_turn goal_yaw bias noise turn_noise begin_height reserve decide "
            "placed turned upright at_rest clear_of high force_time touch field ceiling",
        )  # fmt: skip
