"""Tracks of the benchmark: task, duration and ranges of each, and the error of a scenario."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from spidar_gym.envs.registry import COURSE, CRAWL, GRASP, HOVER, PATH
from spidar_gym.errors import require_name
from spidar_gym.sim.randomize import Randomization
from spidar_gym.sim.worlds import World

ValueT = TypeVar("ValueT")
CAP = 5.0
"""Error of a failed scenario, and largest error of any scenario."""
SCENARIOS = 50
"""Number of scenarios per track and split."""
SECOND = "second"
"""Split with a second draw of the test scenarios of calibrated tracks and grasps: what the first draw decides."""
SPLITS = {"test": 0, "validation": 1, SECOND: 4}
"""Splits and their numbers in the scenarios' seeds: rows use `test`; `validation` is for the selection among the user's
policies. The search uses 2, the held-out conditions 3."""
SETTLE_S = 1.0
"""Time of an episode from which RMS errors are computed on most tracks [s]."""
REST_S = 1.0
"""Time for which a crawl or a course continues after it is finished [s]."""
POSITION_SCALE, ATTITUDE_SCALE = 0.05, 0.05
"""A flight with these RMS errors [m], [rad] has error 1: the limits of `is_success`."""
REST_SCALE, ENERGY_SCALE = 0.02, 20.0
"""A crawl with this final error [m, a radian counts 0.5 m] and this energy per metre [Wh/m] has error 1."""
TIME_SCALE, WAY_SCALE, MISS_SCALE, HIT_SCALE = 10.0, 5.0, 0.03, 20.0
"""A course with this time [s/m] and energy [Wh/m] per metre from start to goal, this final error [m, a radian counts
0.5 m] and this largest contact force [N] has error 1."""
GRASP_TIME_SCALE, GRASP_ENERGY_SCALE, PLACE_SCALE = 40.0, 45.0, 0.05
"""A grasp with this time [s], this energy [Wh], this final error of the object [m, a radian counts 0.5 m] and the
largest force of a foot that the object bears has error 1."""
FLIGHT, GROUND, BOTH, GRASPING = "flight", "ground", "course", "grasp"
"""World of a track: in the air, on the floor, both, or with an object."""
GROUPED = {HOVER: "flight", CRAWL: "ground", PATH: "path", COURSE: "course", GRASP: "grasp"}
"""Environment → group of its tracks. `flight` and `ground` have an overall score each."""
CALIBRATED = {FLIGHT: "calibrated flight", GROUND: "calibrated ground"}
"""World of a track → group of the tracks with robots of a calibrated world, with an overall score each."""
REFERENCES = {
    "calibrated flight": "qp", "calibrated ground": "qp", "flight": "qp", "ground": "qp", "path": "qp",
    "course": "course_rule", "grasp": "grasp_rule", "steps": "qp",
}  # fmt: skip
"""Group → reference row of its scores."""


@dataclass(frozen=True)
class Track:
    """One kind of task, with the same scenarios for every policy."""

    doc: str
    """Description of the task in one line."""
    env_id: str
    """Environment."""
    seconds: float
    """Length of an episode [s]."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the environment, the same in all scenarios."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Arguments of the environment that are sampled uniformly for each scenario: lower and upper bound."""
    disturbances: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Disturbances that are sampled uniformly for each scenario: lower and upper bound."""
    calm: float = 0.0
    """Share of the scenarios without disturbances."""
    apart: str = ""
    """Name of a separate group; the group of the environment if empty."""
    settle: float = SETTLE_S
    """Time from which RMS errors are computed [s]; a failure counts at any time."""

    @property
    def world(self) -> str:
        """World of the track: FLIGHT, GROUND, BOTH or GRASPING."""
        return {CRAWL: GROUND, COURSE: BOTH, GRASP: GRASPING}.get(self.env_id, FLIGHT)

    @property
    def flies(self) -> bool:
        """Whether the track is a flight."""
        return self.world == FLIGHT

    @property
    def group(self) -> str:
        """Group of the track, one of `REFERENCES`."""
        return self.apart or GROUPED[self.env_id]

    @property
    def is_calibrated(self) -> bool:
        """Whether the track is in one of the groups `CALIBRATED`."""
        return self.group in CALIBRATED.values()

    @property
    def folder(self) -> str:
        """Subfolder of the rows of the track's group."""
        return "calibrated" if self.is_calibrated else self.group

    @property
    def splits(self) -> tuple[str, ...]:
        """Splits of the track's scenarios; only calibrated tracks and grasps have a second draw."""
        return tuple(name for name in SPLITS if name != SECOND or self.is_calibrated or self.world == GRASPING)

    def robots(self, index: int) -> Randomization:
        """Return the randomisation of a scenario's robot; scenarios have the kinds of a calibrated world in turn.

        Args:
            index: Index of the scenario.

        Raises:
            UnknownNameError: For a calibrated world that does not exist.
        """
        return Randomization.parse(self.options.get("randomization", 0.0)).in_turn(index)

    @property
    def calibration(self) -> World | None:
        """Calibrated world of the robots; None for described and for randomised robots."""
        return self.robots(0).world

    @property
    def reference(self) -> str:
        """Reference row of the scores."""
        return REFERENCES[self.group]

    @property
    def formula(self) -> str:
        """Error of a scenario, as text."""
        if self.world == BOTH:
            return (
                f"¼ (time per metre / {TIME_SCALE:g} s/m + energy per metre / {WAY_SCALE:g} Wh/m + final error / "
                f"{MISS_SCALE:g} m + largest contact force / {HIT_SCALE:g} N), a radian counts 0.5 m"
            )
        if self.world == GRASPING:
            return (
                f"¼ (time / {GRASP_TIME_SCALE:g} s + energy / {GRASP_ENERGY_SCALE:g} Wh + final error of the object / "
                f"{PLACE_SCALE:g} m + largest force of a foot / force that the object bears), a radian counts 0.5 m"
            )
        if self.flies:
            late = "" if self.settle == SETTLE_S else f", RMS from {self.settle:g} s"
            return f"½ (position RMS / {POSITION_SCALE:g} m + attitude RMS / {ATTITUDE_SCALE:g} rad){late}"
        return f"½ (final error / {REST_SCALE:g} m + energy per metre / {ENERGY_SCALE:g} Wh/m), a radian counts 0.5 m"


_REAL = {"sensors": True, "randomization": 0.3}
_AHEAD = {"distance": 0.6, "direction": 0.0, "turn": 0.0}
_ANYWHERE = {"distance": (0.2, 0.6), "direction": (-math.pi, math.pi), "turn": (-0.5, 0.5)}
WORLD = "calibrated_1"
"""Calibrated world of the tracks."""
_WORLD = {"randomization": WORLD}
# Integrals begin at zero, as the world says. Within 10 s the paper's gains settle.
_SETTLED = {"apart": CALIBRATED[FLIGHT], "settle": 10.0}

TRACKS: dict[str, Track] = {
    "flight-calibrated": Track(
        "independent legs at the paper's 0.2 rad/s; robots of the calibrated world", HOVER, 30.0,
        {**_WORLD, "forms": "independent", "joint_speed": 0.2}, **_SETTLED,
    ),
    "flight-calibrated-fast": Track(
        "independent legs at 0.6 … 1.0 rad/s; robots of the calibrated world", HOVER, 30.0,
        {**_WORLD, "forms": "independent"}, {"joint_speed": (0.6, 1.0)}, **_SETTLED,
    ),
    "ground-calibrated": Track(
        "0.2 … 0.6 m in any direction, turning by up to ± 0.5 rad; robots of the calibrated world", CRAWL, 75.0,
        _WORLD, _ANYWHERE, apart=CALIBRATED[GROUND],
    ),
    "flight-paper": Track(
        "the paper's forms ① → ② → ③ at 0.2 rad/s with real sensors", HOVER, 16.0, {"forms": "paper", "sensors": True}
    ),
    "flight-forms": Track(
        "independent legs at the paper's 0.2 rad/s", HOVER, 20.0, {"forms": "independent", "joint_speed": 0.2}
    ),
    "flight-fast3": Track(
        "independent legs three times as fast", HOVER, 12.0, {"forms": "independent", "joint_speed": 0.6}
    ),
    "flight-fast5": Track(
        "independent legs five times as fast", HOVER, 12.0, {"forms": "independent", "joint_speed": 1.0}
    ),
    "flight-randomised": Track(
        "independent legs three times as fast; robots randomised at strength 1, real sensors", HOVER, 12.0,
        {"forms": "independent", "joint_speed": 0.6, "sensors": True, "randomization": 1.0},
    ),
    "flight-wind": Track(
        "independent legs at 0.2 rad/s, real sensors, turbulent wind of 1 … 3 m/s, pushes of 10 … 40 N", HOVER, 20.0,
        {"forms": "independent", "joint_speed": 0.2, "sensors": True},
        disturbances={"wind": (1.0, 3.0), "push": (10.0, 40.0)},
    ),
    "flight-narrow": Track(
        "forms near ③ that stack the rotors over each other, wake on", HOVER, 16.0,
        {"forms": "narrow", "joint_speed": 0.2},
    ),
    "ground-paper": Track(
        "the paper's 0.6 m straight ahead; robots randomised at strength 0.3, real sensors", CRAWL, 75.0,
        {**_REAL, **_AHEAD},
    ),
    "ground-directions": Track(
        "0.2 … 0.6 m in any direction, turning by up to ± 0.5 rad; robots as before", CRAWL, 75.0, _REAL, _ANYWHERE
    ),
    "ground-friction": Track(
        "0.4 m ahead with feet of friction 0.4 … 1.0 on a floor that slopes up to 10° in any direction", CRAWL, 75.0,
        {**_REAL, "distance": 0.4, "direction": 0.0, "turn": 0.0},
        {"friction": (0.4, 1.0), "slope": (0.0, math.radians(10.0)), "slope_direction": (-math.pi, math.pi)},
    ),
    "ground-uneven": Track(
        "0.4 m ahead over tiles of random heights up to 5 … 20 mm", CRAWL, 75.0,
        {**_REAL, "distance": 0.4, "direction": 0.0, "turn": 0.0}, {"steps": (0.005, 0.020)},
    ),
    "ground-randomised": Track(
        "0.2 … 0.6 m in any direction; robots randomised at strength 1, real sensors", CRAWL, 75.0,
        {"sensors": True, "randomization": 1.0}, _ANYWHERE,
    ),
    "flight-path": Track(
        "paths at 0.3 … 1.5 m/s, independent legs; robots randomised at strength 0.3, real sensors, half in wind",
        PATH, 20.0, {**_REAL, "forms": "independent", "joint_speed": 0.2},
        disturbances={"wind": (1.0, 3.0)}, calm=0.5,
    ),
    "ground-steps": Track(
        "0.8 m ahead over tiles of random heights up to 30 … 100 mm, or onto stairs as high; robots as before", CRAWL,
        150.0, {**_REAL, "distance": 0.8, "direction": 0.0, "turn": 0.0, "terrain": "mixed"},
        {"steps": (0.03, 0.1)}, apart="steps",
    ),
    "course-takeoff": Track(
        "take off, over a wall, land, crawl to the mark; robots randomised at strength 1, real sensors, wind of "
        "1 … 2 m/s",
        COURSE, 300.0,
        {"sensors": True, "randomization": 1.0, "gates": ("wall",), "floors": ("plain",), "count": (1, 1)},
        disturbances={"wind": (1.0, 2.0)},
    ),
    "course-gates": Track(
        "over walls and, in a narrow form, through slots; robots randomised at strength 0.3, real sensors", COURSE,
        300.0, {**_REAL, "gates": ("wall", "slot"), "floors": ("plain",), "count": (2, 3)},
    ),
    "course-mixed": Track(
        "walls, beams, slots, the goal on a plain floor, platform, tiles or slope; robots randomised at strength 1, "
        "real sensors", COURSE, 300.0, {"sensors": True, "randomization": 1.0},
    ),
    "grasp-claw": Track(
        "a ball of 0.25 m radius and 1 kg, friction 0.4 … 0.8, between blocks; robots of the calibrated world", GRASP,
        90.0, {**_WORLD, "shapes": ("ball",), "half_width": (0.25, 0.25), "mass": (1.0, 1.0), "friction": (0.4, 0.8)},
    ),
    "grasp-boxes": Track(
        "boxes and cylinders of 0.3 … 3 kg, friction 0.4 … 1; robots of the calibrated world, half in wind of "
        "1 … 2 m/s",
        GRASP, 90.0, _WORLD, disturbances={"wind": (1.0, 2.0)}, calm=0.5,
    ),
    "grasp-fragile": Track(
        "boxes and cylinders of 0.3 … 6 kg, friction 0.3 … 0.9, that bear 8 … 30 N a foot, on stands up to 0.4 m; "
        "robots of the calibrated world, half in wind of 1 … 2 m/s", GRASP, 90.0,
        {**_WORLD, "mass": (0.3, 6.0), "friction": (0.3, 0.9), "most_force": (8.0, 30.0), "stand": (0.0, 0.4),
         "floor": (0.0, 0.4)},
        disturbances={"wind": (1.0, 2.0)}, calm=0.5,
    ),
}  # fmt: skip
"""Every track by id."""


def find_track(name: str) -> Track:
    """Return a track by id (`UnknownNameError` lists the valid ids)."""
    require_name("track", name, TRACKS)
    return TRACKS[name]


def by_group(of_worlds: Mapping[str, ValueT]) -> dict[str, ValueT]:
    """Map each group of tracks to the entry of its world, so that separate groups need no entries."""
    return {
        group: next(of_worlds[track.world] for track in TRACKS.values() if track.group == group) for group in REFERENCES
    }


def flight_error(position_rms: float, attitude_rms: float, *, failed: bool) -> float:
    """Compute the error of a flight: ½ (position RMS / 0.05 m + attitude RMS / 0.05 rad), at most `CAP`.

    Args:
        position_rms: RMS of ‖position error‖ [m].
        attitude_rms: RMS of ‖attitude error‖ [rad].
        failed: Whether it ended early or a form was not reached within 0.5 s after its deadline; the error is `CAP`.
    """
    error = 0.5 * (position_rms / POSITION_SCALE + attitude_rms / ATTITUDE_SCALE)
    return CAP if failed else min(CAP, error)


def ground_error(rest: float, energy_per_m: float, *, failed: bool) -> float:
    """Compute the error of a crawl: ½ (final error / 0.02 m + energy per metre / 20 Wh/m), at most `CAP`.

    Args:
        rest: Distance from the goal in the end, a radian counting 0.5 m [m].
        energy_per_m: Energy over the distance from start to goal, a radian counting 0.5 m [Wh/m].
        failed: Whether it ended early or was not finished in time; the error is `CAP`.
    """
    return CAP if failed else min(CAP, 0.5 * (rest / REST_SCALE + energy_per_m / ENERGY_SCALE))


def grasp_error(seconds: float, energy_wh: float, rest: float, pressed: float, *, failed: bool) -> float:
    """Compute the error of a grasp: ¼ (time / 40 s + energy / 45 Wh + final error / 0.05 m + force share).

    Args:
        seconds: Time until the object was delivered [s].
        energy_wh: Energy until then [Wh].
        rest: Distance of the object from its place in the end, a radian counting 0.5 m [m].
        pressed: Largest force of a foot over the force that the object bears.
        failed: Whether it ended early, as with a dropped object, or the object was not delivered in time.

    Returns:
        The error, at most `CAP`, and `CAP` for a failed grasp.
    """
    error = 0.25 * (seconds / GRASP_TIME_SCALE + energy_wh / GRASP_ENERGY_SCALE + rest / PLACE_SCALE + pressed)
    return CAP if failed else min(CAP, error)


def course_error(seconds_per_m: float, energy_per_m: float, rest: float, hit: float, *, failed: bool) -> float:
    """Compute the error of a course: ¼ (time / 10 s/m + energy / 5 Wh/m + final error / 0.03 m + contact / 20 N).

    Args:
        seconds_per_m: Time over the distance from start to goal, a radian counting 0.5 m [s/m].
        energy_per_m: Energy over this distance [Wh/m].
        rest: Distance from the goal in the end, a radian counting 0.5 m [m].
        hit: Largest contact force on any part other than feet and pegs [N].
        failed: Whether it ended early or did not lie at the goal in time.

    Returns:
        The error, at most `CAP`, and `CAP` for a failed course.
    """
    error = 0.25 * (seconds_per_m / TIME_SCALE + energy_per_m / WAY_SCALE + rest / MISS_SCALE + hit / HIT_SCALE)
    return CAP if failed else min(CAP, error)
