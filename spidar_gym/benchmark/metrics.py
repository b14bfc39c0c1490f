"""Metrics of an episode: meaning, type, valid range and tolerance of each."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from spidar_gym.benchmark.track import BOTH, CAP, FLIGHT, GRASPING, GROUND
from spidar_gym.errors import InvalidValueError

WORD = 200
"""Largest length of the reason of a failure [characters]."""


@dataclass(frozen=True)
class Metric:
    """One metric of an episode; no metric is negative."""

    doc: str
    """Meaning."""
    kind: type
    """Exact type: `float`, `int`, `bool` or `str`."""
    most: float = 1.0
    """Largest valid value: far above the values of episodes, but small enough that sums do not overflow."""
    worlds: tuple[str, ...] = (FLIGHT, GROUND, BOTH, GRASPING)
    """Worlds in which the metric is defined. Elsewhere it is None in flights and crawls, and absent from others."""
    least: float = 0.0
    """Smallest valid value; above 0 for divisors."""
    spread: Mapping[str, float] = field(default_factory=dict)
    """Tolerance for rounding in each world, see `METRICS`."""

    @property
    def expected(self) -> str:
        """Valid values, as text."""
        if self.kind is bool:
            return "true or false"
        if self.kind is str:
            return f"a line of at most {WORD} characters"
        return f"a {'whole ' if self.kind is int else ''}number within {self.least:g} … {self.most:g}"

    def odd(self, values: Sequence[object], failed: Sequence[bool], *, world: str) -> int | None:
        """Return the index of the first invalid value; None if all values are valid.

        Args:
            values: Values of the metric in scenarios, in one call because the committed rows have half a million.
            failed: Whether each scenario failed; after a diverged simulation a value may be None.
            world: A flight, the ground or a course.
        """
        kind, least, most, defined = self.kind, self.least, self.most, world in self.worlds
        for k, value in enumerate(values):
            if not defined or value is None:
                fits = value is None and (not defined or (kind is float and failed[k]))
            elif not isinstance(value, kind) or isinstance(value, bool) != (kind is bool):
                fits = False
            elif isinstance(value, str):
                fits = len(value) <= WORD and value.isprintable()
            else:
                fits = isinstance(value, int | float) and least <= value <= most
            if not fits:
                return k
        return None


def _spread(flight: float = 0.0, ground: float = 0.0, course: float = 0.0, grasp: float = 0.0) -> dict[str, float]:
    return {FLIGHT: flight, GROUND: ground, BOTH: course, GRASPING: grasp}


METRICS: dict[str, Metric] = {
    "error": Metric(
        "the track's error, from which the score is computed",
        float,
        CAP,
        least=1e-300,
        spread=_spread(1e-06, 0.001, 0.02, 0.15),
    ),
    "success": Metric("`info['is_success']` at the end", bool),
    "failed": Metric("ended early, late at a form, or not finished; the error is the cap", bool),
    "failure": Metric("reason of the failure, as text", str),
    "position_rms_m": Metric(
        "flight: RMS of ‖position error‖ after the settling time", float, 10.0, (FLIGHT,), spread=_spread(1e-05, 0.0)
    ),
    "attitude_rms_rad": Metric(
        "RMS of ‖attitude error‖ after the settling time; elsewhere RMS of the tilt",
        float,
        math.tau,
        spread=_spread(1e-05, 0.0003, 3e-4, 2e-4),
    ),
    "joint_rms_rad": Metric(
        "RMS over the joints of planned − measured angle; ground: setpoint − measured angle",
        float,
        math.tau,
        (FLIGHT, GROUND),
        spread=_spread(2e-06, 5e-04),
    ),
    "late_forms": Metric("flight: forms not reached within 0.5 s after their deadline", int, 100.0, (FLIGHT,)),
    "final_error_m": Metric(
        "ground, course: distance from the goal at the end; grasp: that of the object from its place",
        float,
        100.0,
        (GROUND, BOTH, GRASPING),
        spread=_spread(0.0, 5e-05, 0.004, 0.02),
    ),
    "final_yaw_rad": Metric(
        "|heading error| at the end, of the object in a grasp",
        float,
        math.tau,
        (GROUND, BOTH, GRASPING),
        spread=_spread(0.0, 1e-4, 0.004, 1e-3),
    ),
    "drift": Metric(
        "ground: final error over the distance from start to goal, a radian counting 0.5 m",
        float,
        100.0,
        (GROUND,),
        spread=_spread(0.0, 1e-4),
    ),
    "slip_m": Metric(
        "ground: slip of the worst foot on the floor",
        float,
        100.0,
        (GROUND,),
        spread=_spread(0.0, 0.003),
    ),
    "duration_s": Metric(
        "duration of the flight, or time until crawl, course or grasp was finished",
        float,
        1e3,
        spread=_spread(0.026, 0.026, 0.5, 0.1),
    ),
    "energy_wh": Metric("electrical energy", float, 1e3, spread=_spread(1e-06, 0.04, 0.15, 0.1)),
    "endurance_min": Metric(
        "endurance predicted from the mean power", float, 1e6, spread=_spread(1e-06, 0.1, 0.03, 0.003)
    ),
    "cost_of_transport": Metric(
        "ground: energy over weight times distance", float, 1e6, (GROUND,), spread=_spread(0.0, 1.5)
    ),
    "thrust_mean": Metric("mean commanded Σλ over the weight", float, 10.0, spread=_spread(1e-07, 0.0003, 0.004, 3e-4)),
    "torque_share": Metric(
        "largest |joint torque| over the servo's limit", float, 10.0, spread=_spread(1e-05, 5e-05, 1e-3, 0.005)
    ),
    "violations": Metric(
        "share of ticks with a static joint torque above the limit or a violated interference constraint",
        float,
        worlds=(FLIGHT, GROUND),
        spread=_spread(0.0025, 0.0025),
    ),
    "unsolved": Metric("ticks whose QP had no optimum; on courses only the last tick of every step counts", int, 1e5),
    "flown_s": Metric(
        "course: time with the weight on the rotors, or while it is shifted to them",
        float,
        1e3,
        (BOTH,),
        spread=_spread(course=0.5),
    ),
    "crawled_s": Metric("course: time of crawling", float, 1e3, (BOTH,), spread=_spread(course=0.5)),
    "hit_n": Metric(
        "course: largest contact force on any part other than feet and pegs",
        float,
        1e6,
        (BOTH,),
        spread=_spread(course=0.5),
    ),
    "lifted_m": Metric(
        "grasp: largest height of the object over its stand", float, 100.0, (GRASPING,), spread=_spread(grasp=1e-3)
    ),
    "force_n": Metric(
        "grasp: largest force of a foot on the object, mean over a tenth of a second",
        float,
        1e6,
        (GRASPING,),
        spread=_spread(grasp=15.0),
    ),
    "force_share": Metric(
        "grasp: that force over the force that the object bears", float, 1e6, (GRASPING,), spread=_spread(grasp=0.5)
    ),
    "tries": Metric("grasp: number of times that the rule has begun to grasp", int, 1e5, (GRASPING,)),
}
"""Metrics of an episode by name; names end in the unit.

`spread` is about thirty times the largest difference due to rounding in 274 scenarios of all 14 rows. For times and
shares of ticks, which did not change at all, it is one control tick. Successes, failures and counts did not change.
Rows from a processor with AVX2 were re-run on a processor with AVX-512 (120 scenarios), on the latter with NumPy and
OpenBLAS limited to SSE3 (46, `NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL" OPENBLAS_CORETYPE=Prescott`), and
with the Python controller (108). `spidar leaderboard verify --sample 80 [--control python]` repeats such a check and
prints the largest differences. They were, in flights and on the ground: error 1.5e-9, 3.3e-5; position 3.5e-7 m;
attitude 2.5e-7, 7.8e-6 rad; joints 3.7e-8, 1.6e-5 rad; end of a crawl 1.7e-6 m, 2.2e-6 rad; drift 2.1e-6; slip
9.9e-5 m; energy 2.9e-9, 1.3e-3 Wh; endurance 2.6e-8, 3.1e-3 min; cost of transport 0.049; thrust 5.2e-12, 8.0e-6;
torque 4.2e-8, 1.5e-6.

On courses, which last minutes, `spread` is about ten times the difference between the two controllers in 14 scenarios
of `course_rule`: error 2.2e-3; final error 0.41 mm, 0.44 mrad; time 0.075 s, three ticks of crawling; energy 0.016 Wh;
endurance 3.2e-3 min; tilt 2.5e-5 rad; thrust 4.1e-4; torque 1.3e-8. There were no contacts.

In grasps it is three to four times the largest difference between the two controllers in 14 scenarios of four rows. In
nine of them the errors differ by less than 1e-8; in five a foot slips, which amplifies rounding: error 0.042; peak of a
foot's force 4.3 N, its share 0.16; final error 4.8 mm; time 0.025 s; energy 0.025 Wh; endurance 6.1e-4 min; tilt 3.6e-5
rad; thrust 8.0e-5; torque 1.5e-3; lift 0.19 mm.
"""


def told_in(world: str) -> dict[str, Metric]:
    """Return the metrics of an episode in a world; flights and crawls both have the metrics of either."""
    others = (FLIGHT, GROUND) if world in (FLIGHT, GROUND) else (world,)
    return {name: metric for name, metric in METRICS.items() if set(others) & set(metric.worlds)}


def differences(then: Mapping[str, Any], now: Mapping[str, Any], *, world: str) -> dict[str, float]:
    """Return the difference of each unequal metric as a share of its `spread`; infinity without a tolerance."""
    found = {}
    for name, metric in told_in(world).items():
        a, b = then[name], now[name]
        if a != b:
            spread = metric.spread.get(world, 0.0)
            numbers = isinstance(a, float) and isinstance(b, float) and spread > 0.0
            found[name] = abs(a - b) / spread if numbers else math.inf
    return found


def check_metrics(metrics: Mapping[str, Any], *, world: str) -> None:
    """Refuse metrics that no episode in the world can have.

    Raises:
        InvalidValueError: For a metric that is missing, unknown, of another type, out of range, or inconsistent with
            the other metrics.
    """
    if (found := find_odd({name: [value] for name, value in metrics.items()}, world=world)) is not None:
        raise found[1]


def find_odd(run: Mapping[str, Sequence[Any]], *, world: str) -> tuple[int, InvalidValueError] | None:
    """Return the first scenario with invalid metrics and the error; None if all are valid.

    Args:
        run: Metric → value in each scenario.
        world: A flight, the ground or a course.
    """
    known = told_in(world)
    if set(run) != set(known):
        odd = sorted(set(run) ^ set(known))[:3]
        return 0, InvalidValueError("metrics", odd, f"all of {', '.join(known)}, and no others")
    failed = [value is True for value in run["failed"]]
    found = []
    for name, metric in known.items():
        if (k := metric.odd(run[name], failed, world=world)) is not None:
            found.append((k, InvalidValueError(name, run[name][k], metric.expected)))
    for k, (error, success) in enumerate(zip(run["error"], run["success"], strict=True)):
        if failed[k] and (success or error != CAP):
            expected = f"{CAP:g} and no success where a scenario failed"
            found.append((k, InvalidValueError("error", error, expected)))
    return min(found, key=lambda each: each[0], default=None)
