"""The hover: hold the CoG and a level attitude while the joints go through a sequence of forms."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from spidar_gym.arrays import Vector3
from spidar_gym.errors import InvalidValueError, require_flag, require_name, require_windows
from spidar_gym.model.dynamics import Model
from spidar_gym.native.engine_structs import DRAWN, MAX_WINDOWS, SEQUENCES
from spidar_gym.robot import FORMS, N_LEGS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.tasks.robots import HoverRobots
from spidar_gym.tasks.start import FlightStart
from spidar_gym.tasks.task import Task, require_ranges, tolerance, write_constants

CLEARANCE = 0.5
"""Height of the feet of form ③ over the floor [m], which defines the default height of the CoG."""
OFFSET = 0.03, 0.05
"""Largest initial offset of position [m] and attitude [rad] per axis at a perturbation of 1."""
MIXTURE = 0.25, 0.55
"""Cumulative shares of `mixed`: the paper's forms, then also forms with equal legs; all others are independent."""
PAPER_PAUSE, PAUSE = 4.0, (1.0, 2.5)
"""Time from the paper's first form to its second; range of the pause between two sampled forms [s]."""
DRAWN_FORMS = {
    "equal": (((-0.5, -0.2, -0.5, 0.0), (0.5, 0.8, 0.5, 1.4)), 1),
    "independent": (((-0.5, -0.2, -0.5, 0.0), (0.5, 0.8, 0.5, 1.4)), N_LEGS),
    # Near form ③, outer rotor under the inner one: the jet of every inner rotor hits another rotor.
    "narrow": (((-0.25, 0.65, -0.15, 1.35), (0.25, 0.9, 0.15, 1.57)), N_LEGS),
}
"""Least and largest angles of a leg's joints (yaw, pitch, yaw, pitch from the torso on) [rad], and the number of legs
that are sampled. With one, all legs are alike, with a common twist of the yaw joints."""
MAX_TILT, MAX_DISTANCE = 1.0, 1.0
"""A larger tilt [rad] [JSK], or a larger distance of the CoG from its reference [m], ends the episode."""
SUCCESS_POSITION, SUCCESS_ATTITUDE = 0.05, 0.05
"""Limits of a success's RMS errors [m], [rad]."""
ARRIVAL_GRACE, ARRIVAL_TOLERANCE = 0.5, 0.05
"""Time after its deadline within which a form must be reached [s], and the largest error of a joint there [rad]."""
RANGES = {
    "joint_speed": (1e-6, 1e3, "rad/s"),
    # All forms are sampled before the episode begins; those of a day take about a second.
    "horizon_s": (1e-3, 86400.0, "s"),
    "perturbation": (0.0, 1e3, "1"),
    "altitude": (0.0, 1e3, "m"),
}
"""Least and largest value of each argument, and its unit."""


@dataclass(frozen=True)
class HoverTask(Task[HoverRobots]):
    """Hold the CoG and a level attitude while the joints go through a sequence of forms."""

    forms: str = "mixed"
    """Sequence of forms: `paper` (① at the start, ② from 4 s on, then ③ without a pause), one of the forms throughout,
    `equal` legs with a common twist, `independent` legs with yaw, `narrow` forms near ③, or `mixed` (25 % `paper`,
    30 % `equal`, 45 % `independent`)."""
    joint_speed: float = ROBOT.joint_speed
    """Joint speed [rad/s]."""
    horizon_s: float = 20.0
    """Length of an episode [s]; the sequence of forms is as long."""
    perturbation: float = 1.0
    """Scale of the initial offset: 1 is ± 3 cm and ± 0.05 rad per axis, at rest; 0 is none."""
    avoid_interference: bool = True
    """Whether rotors whose jets hit others are restricted; False is the paper's baseline method."""
    unrestricted: Sequence[Sequence[float]] = ()
    """Time windows `(start, end)` in which no rotor is restricted [s], as in the paper's flight."""
    altitude: float | None = None
    """Height of the CoG [m]; if None, the feet of form ③ are half a metre above the floor."""

    robots = HoverRobots
    reward_terms = {  # noqa: RUF012 - the form in which derived tasks write it
        "position": (0.4, "1 / (1 + (‖position error‖ / 0.02 m)²)"),
        "attitude": (0.4, "1 / (1 + (‖attitude error‖ / 0.03 rad)²)"),
        "joints": (0.1, "1 / (1 + (max |planned − measured joint angle| / 0.1 rad)²)"),
        "action": (0.1, "1 − mean a²"),
    }
    failures = {  # noqa: RUF012 - as above
        "contact": "a part of the robot touches the floor",
        "tilt": f"the torso tilts by more than {MAX_TILT:g} rad",
        "position": f"the CoG is more than {MAX_DISTANCE:g} m from its reference",
        "diverged": "the simulation's state is no longer finite",
    }

    stops = {"in_contact": 0.0, "tilt": MAX_TILT, "distance": MAX_DISTANCE}  # noqa: RUF012 - as above

    def __post_init__(self) -> None:
        """Validate the options."""
        require_name("form sequence", self.forms, SEQUENCES)
        require_ranges(self, RANGES)
        require_flag(avoid_interference=self.avoid_interference)
        object.__setattr__(self, "unrestricted", require_windows("unrestricted", self.unrestricted))

    def terms(self, robots: HoverRobots) -> Mapping[str, np.ndarray]:
        """Terms of the reward, in [0, 1]."""
        return {
            "position": tolerance(robots.distance, 0.02),
            "attitude": tolerance(robots.angle, 0.03),
            "joints": tolerance(robots.joint_error, 0.1),
            "action": 1.0 - robots.effort,
        }

    def failed(self, robots: HoverRobots) -> Mapping[str, np.ndarray]:
        """Return the failures of each robot."""
        return {
            "contact": robots.in_contact > 0.0,
            "tilt": robots.tilt > MAX_TILT,
            "position": robots.distance > MAX_DISTANCE,
        }

    def succeeded(self, robots: HoverRobots) -> np.ndarray:
        """Return which robots have flown the whole horizon within the RMS limits and reached every due form in time."""
        done = robots.ticks >= robots.horizon
        if done.any():
            done &= (robots.position_rms < SUCCESS_POSITION) & (robots.attitude_rms < SUCCESS_ATTITUDE)
            done &= robots.overdue == 0
        return done

    def start(self, rng: np.random.Generator) -> FlightStart | None:
        """Return the initial state, forms and path of a robot's episode; with None the engine samples them.

        `draw_start(task, rng)` returns the start that the engine would sample.
        """
        del rng
        return None

    def reference(self, robots: HoverRobots) -> np.ndarray:
        """Return the controllers' current references: records of `Reference`'s fields, with modes as numbers.

        By default these are the schedule's: a level hover or the path, the form that is due, and the fault that is
        reported to the controller. A derived task changes the fields that differ.
        """
        return robots.scheduled["reference"]

    def preview(self, robots: HoverRobots) -> np.ndarray:
        """Return the policy's preview of the schedule: records of the current and the next form and the path ahead."""
        return robots.scheduled["preview"]

    @property
    def position_w(self) -> Vector3:
        """Desired position of the CoG [m]."""
        return np.array([0.0, 0.0, hover_height() if self.altitude is None else self.altitude])

    @property
    def most_goals(self) -> int:
        """Largest number of forms of an episode: they are at least a second apart."""
        return math.ceil(self.horizon_s) + 3

    @property
    def most_knots(self) -> int:
        """Largest number of knots of an episode's path."""
        return 0

    def write(self, rules: Any) -> None:  # noqa: ANN401 - a record of `sp_hover_rules`
        """Write the options and constants that the engine needs into `rules`.

        Raises:
            InvalidValueError: For more than `MAX_WINDOWS` time windows.
        """
        if len(self.unrestricted) > MAX_WINDOWS:
            raise InvalidValueError("unrestricted", len(self.unrestricted), f"at most {MAX_WINDOWS} windows of time")
        for name in ("position_w", "joint_speed", "perturbation", "horizon_s"):
            rules[name] = getattr(self, name)
        rules["avoids"], rules["windows"] = self.avoid_interference, len(self.unrestricted)
        rules["window"][: len(self.unrestricted)] = np.reshape(self.unrestricted, (-1, 2))
        rules["form"] = list(FORMS.values())
        for k, name in enumerate(DRAWN):
            rules["range"][k], rules["drawn_legs"][k] = DRAWN_FORMS[name]
        write_constants(rules, globals(), "offset mixture paper_pause pause arrival_grace arrival_tolerance")


@lru_cache(maxsize=64)
def hover_height(robot: RobotSpec = ROBOT) -> float:
    """Return the height of the CoG at which the feet of form ③ are `CLEARANCE` above the floor [m]."""
    model, q, level = Model(robot), FORMS["form3"], np.zeros((N_ROTORS, 2))
    com_z = model.snapshot(q, np.eye(3), level).com_b[2]
    feet_z = model.contacts(q)[0][:N_LEGS, 2].min()
    return float(CLEARANCE + robot.foot_radius + com_z - feet_z)
