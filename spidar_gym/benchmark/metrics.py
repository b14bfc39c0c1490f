"""The numbers of an episode: what each means, and of which type and in which range it is wherever one is read."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from spidar_gym.benchmark.track import BOTH, CAP, FLIGHT, GROUND
from spidar_gym.errors import InvalidValueError

WORD = 200
"""Longest word on a failure, in characters."""


@dataclass(frozen=True)
class Metric:
    """One number of an episode; none is negative."""

    doc: str
    """Meaning."""
    kind: type
    """`float`, `int`, `bool`, or `str`: just this type."""
    most: float = 1.0
    """Largest value: far beyond what an episode can give, and near enough that no sum of them overflows."""
    worlds: tuple[str, ...] = (FLIGHT, GROUND, BOTH)
    """Where it has a meaning; elsewhere it is None in a flight and on the ground, and not told of a course."""
    least: float = 0.0
    """Smallest value: above 0 where others are divided by it."""
    spread: Mapping[str, float] = field(default_factory=dict)
    """How far rounding may move it in each world: see `METRICS`."""

    @property
    def expected(self) -> str:
        """What is valid, in words."""
        if self.kind is bool:
            return "true or false"
        if self.kind is str:
            return f"a line of at most {WORD} characters"
        return f"a {'whole ' if self.kind is int else ''}number within {self.least:g} … {self.most:g}"

    def odd(self, values: Sequence[object], failed: Sequence[bool], *, world: str) -> int | None:
        """Which value it cannot have, the first; None where it may have them all.

        Args:
            values: Its values in scenarios, all in one call, since the committed rows have half a million.
            failed: Which of these scenarios failed: a simulation that diverged leaves numbers that are none.
            world: A flight, the ground or a course.
        """
        kind, least, most, told = self.kind, self.least, self.most, world in self.worlds
        for k, value in enumerate(values):
            if not told or value is None:
                fits = value is None and (not told or (kind is float and failed[k]))
            elif not isinstance(value, kind) or isinstance(value, bool) != (kind is bool):
                fits = False
            elif isinstance(value, str):
                fits = len(value) <= WORD and value.isprintable()
            else:
                fits = isinstance(value, int | float) and least <= value <= most
            if not fits:
                return k
        return None


def _spread(flight: float = 0.0, ground: float = 0.0, course: float = 0.0) -> dict[str, float]:
    return {FLIGHT: flight, GROUND: ground, BOTH: course}


METRICS: dict[str, Metric] = {
    "error": Metric(
        "the track's error, on which the score rests", float, CAP, least=1e-300, spread=_spread(1e-06, 0.001, 0.02)
    ),
    "success": Metric("`info['is_success']` in the end", bool),
    "failed": Metric("ended early, late at a form, or not finished: costs the cap", bool),
    "failure": Metric("why, in words", str),
    "position_rms_m": Metric(
        "flight: RMS of ‖position error‖ after the first second", float, 10.0, (FLIGHT,), spread=_spread(1e-05, 0.0)
    ),
    "attitude_rms_rad": Metric(
        "RMS of ‖attitude error‖ after the first second; on the ground and on a course of the tilt",
        float,
        math.tau,
        spread=_spread(1e-05, 0.0003, 3e-4),
    ),
    "joint_rms_rad": Metric(
        "RMS over the joints of the scenario's plan − measured; ground: setpoint − measured",
        float,
        math.tau,
        (FLIGHT, GROUND),
        spread=_spread(2e-06, 5e-04),
    ),
    "late_forms": Metric("flight: forms not reached within 0.5 s after their deadline", int, 100.0, (FLIGHT,)),
    "final_error_m": Metric(
        "ground, course: distance from the goal in the end",
        float,
        100.0,
        (GROUND, BOTH),
        spread=_spread(0.0, 5e-05, 0.004),
    ),
    "final_yaw_rad": Metric(
        "ground, course: |heading error| in the end", float, math.tau, (GROUND, BOTH), spread=_spread(0.0, 1e-4, 0.004)
    ),
    "drift": Metric(
        "ground: final error over the way, a radian counting 0.5 m", float, 100.0, (GROUND,), spread=_spread(0.0, 1e-4)
    ),
    "slip_m": Metric(
        "ground: way of the worst foot's touching point on the floor",
        float,
        100.0,
        (GROUND,),
        spread=_spread(0.0, 0.003),
    ),
    "duration_s": Metric(
        "flown, or until the crawl or the course was finished", float, 1e3, spread=_spread(0.026, 0.026, 0.5)
    ),
    "energy_wh": Metric("electrical energy", float, 1e3, spread=_spread(1e-06, 0.04, 0.15)),
    "endurance_min": Metric("predicted from the mean power", float, 1e6, spread=_spread(1e-06, 0.1, 0.03)),
    "cost_of_transport": Metric(
        "ground: energy over weight times way", float, 1e6, (GROUND,), spread=_spread(0.0, 1.5)
    ),
    "thrust_mean": Metric("mean commanded Σλ over the weight", float, 10.0, spread=_spread(1e-07, 0.0003, 0.004)),
    "torque_share": Metric(
        "largest |joint torque| over the servo's limit", float, 10.0, spread=_spread(1e-05, 5e-05, 1e-3)
    ),
    "violations": Metric(
        "share of ticks with a static joint torque above the limit or a rotor that blows on another",
        float,
        worlds=(FLIGHT, GROUND),
        spread=_spread(0.0025, 0.0025),
    ),
    "unsolved": Metric("ticks whose QP had no optimum; of a course the last of every step counts", int, 1e5),
    "flown_s": Metric(
        "course: time with the weight on the rotors, or on its way there",
        float,
        1e3,
        (BOTH,),
        spread=_spread(course=0.5),
    ),
    "crawled_s": Metric("course: time of crawling", float, 1e3, (BOTH,), spread=_spread(course=0.5)),
    "hit_n": Metric(
        "course: largest force on anything but feet and pegs", float, 1e6, (BOTH,), spread=_spread(course=0.5)
    ),
}
"""Every number of an episode, by name, which ends in its unit where it has one.

Its `spread` is some thirty times the largest difference that rounding made in 274 scenarios of all 14 rows, and one
tick of control for times and shares of ticks, which did not move at all; nor did a success, a failure, or a count. Rows
of a processor with AVX2 were played again on one with AVX-512 (120), there with numpy and OpenBLAS held to SSE3 (46,
`NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL" OPENBLAS_CORETYPE=Prescott`), and with the other controller (108);
`spidar leaderboard verify --sample 80 [--control python]` does the like and says the largest ones. They were, in a
flight and on the ground: error 1.5e-9, 3.3e-5; position 3.5e-7 m; attitude 2.5e-7, 7.8e-6 rad; joints 3.7e-8,
1.6e-5 rad; end of a crawl 1.7e-6 m, 2.2e-6 rad; drift 2.1e-6; slip 9.9e-5 m; energy 2.9e-9, 1.3e-3 Wh; endurance
2.6e-8, 3.1e-3 min; cost of transport 0.049; thrust 5.2e-12, 8.0e-6; torque 4.2e-8, 1.5e-6.

On courses, minutes long, it is some ten times what the other controller made of 14 scenarios of `course_rule`: error
2.2e-3; end 0.41 mm, 0.44 mrad; time 0.075 s, three ticks of crawling; energy 0.016 Wh; endurance 3.2e-3 min; tilt
2.5e-5 rad; thrust 4.1e-4; torque 1.3e-8. Nothing was hit.
"""


def told_in(world: str) -> dict[str, Metric]:
    """What is told of an episode there: rows of flights and crawls have all that either of them knows."""
    others = (FLIGHT, GROUND) if world in (FLIGHT, GROUND) else (world,)
    return {name: metric for name, metric in METRICS.items() if set(others) & set(metric.worlds)}


def differences(then: Mapping[str, Any], now: Mapping[str, Any], *, world: str) -> dict[str, float]:
    """How far each metric that is not equal has moved, as a share of its `spread`; infinity where none is allowed."""
    found = {}
    for name, metric in told_in(world).items():
        a, b = then[name], now[name]
        if a != b:
            spread = metric.spread.get(world, 0.0)
            numbers = isinstance(a, float) and isinstance(b, float) and spread > 0.0
            found[name] = abs(a - b) / spread if numbers else math.inf
    return found


def check_metrics(metrics: Mapping[str, Any], *, world: str) -> None:
    """Refuse what no episode of a flight, of a crawl or of a course can have given.

    Raises:
        InvalidValueError: For a metric that is missing, too many, of another type, out of its range, or at odds with
            the others.
    """
    if (found := find_odd({name: [value] for name, value in metrics.items()}, world=world)) is not None:
        raise found[1]


def find_odd(run: Mapping[str, Sequence[Any]], *, world: str) -> tuple[int, InvalidValueError] | None:
    """The first scenario that no episode can have given, and why; None where all of them may have been.

    Args:
        run: Metric → its value in each scenario.
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
