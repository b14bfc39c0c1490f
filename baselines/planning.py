"""`planning`: the legs go from form to form on ways on which no rotor stands in a jet; the allocation knows of no jets.

After the lab's planning for DRAGON, whose motion keeps its rotors out of each other's wakes (IROS 2018, cited by
[Zhao2025]). A way is a Bézier curve of second order through joint space, q(s) = (1 − s)² q₀ + 2 s (1 − s) c + s² q₁. No
joint is faster on it than the one with the longest way is on the straight one, |c − q₀|, |q₁ − c| ≤ ½ max|q₁ − q₀|, so
it arrives as early. c is what the library `cma` finds to have the least overlap along the way, a generation a tick in
the second before the legs set off. Where a form itself stands in its own jets no way helps, and `plan` says so:

    python -m baselines.planning
"""

import sys
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from spidar_gym.arrays import JointVector, Vectoring
from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.flight.compensation import ramp_joints
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import TUNED
from spidar_gym.envs.hover.task import DRAWN_FORMS
from spidar_gym.errors import MissingDependencyError
from spidar_gym.model.dynamics import Model
from spidar_gym.model.interference import InterferenceConfig, find_interference, no_interference
from spidar_gym.model.rotor import nominal_vectoring
from spidar_gym.robot import FORMS, N_JOINTS, ROBOT
from spidar_gym.state import RobotState
from spidar_gym.text import format_table

SAMPLES = np.linspace(0.0, 1.0, 7)[1:-1]
"""Where a way is looked at."""
CLEAR = 0.05
"""A jet is clear of what is below it where it would not meet it if it were turned by so much [rad]."""
AHEAD = 1.0
"""So early the next form is asked for [s]."""
TRIALS = 6
"""Ways that are tried in a tick."""
SPREAD = 0.3
"""First spread of c, in halves of what it may be."""


DETOUR = 1e-4
"""Cost of a way that is bent as far as it may be [rad]."""
PAIRS = 40
"""So many pairs of forms are drawn as `flight-forms` draws them, to see how often a way has to be bent."""


class Plan(NamedTuple):
    """How a way between two forms fares."""

    straight: float
    """Overlap of the straight way, mean over it [rad]."""
    bent: float
    """Of the way that was found [rad]."""
    goal: float
    """Of the form at its end: above 0 no way is free to its end [rad]."""


@dataclass
class Way:
    """A way of the joints from one form to another."""

    begin: JointVector
    """q₀ [rad]."""
    end: JointVector
    """q₁ [rad]."""
    bend: JointVector
    """c [rad]."""
    gone: float = 0.0
    """How much of the longest joint's way is done [rad]."""
    speed: float = 0.0
    """How fast [rad/s]."""

    @property
    def length(self) -> float:
        """The longest joint's way [rad]."""
        return float(np.abs(self.end - self.begin).max())

    def at(self, s: float) -> JointVector:
        """q(s)."""
        return (1.0 - s) ** 2 * self.begin + 2.0 * s * (1.0 - s) * self.bend + s * s * self.end


def straight(begin: JointVector, end: JointVector) -> Way:
    """The straight way."""
    return Way(begin, end, 0.5 * (begin + end))


def overlap(model: Model, q: JointVector, guess: Vectoring, config: InterferenceConfig) -> tuple[float, Vectoring]:
    """By how much the jets of a level hover would have to turn, all rotors' together [rad], and the nominal vectoring.

    Args:
        model: The robot.
        q: Joint angles [rad].
        guess: Vectoring near by, which says on which branch [rad].
        config: What counts as a jet.
    """
    # Twice: where a rotor is depends on where it points, and the guess may be far off.
    nominal = nominal_vectoring(model.snapshot(q, np.eye(3), guess).R_bl, guess)
    found = find_interference(model.snapshot(q, np.eye(3), nominal), nominal, no_interference(), config=config)
    depth = np.maximum(found.lower - nominal[:, 1], nominal[:, 1] - found.upper) + CLEAR
    return float(np.where(found.restricted, np.maximum(depth, 0.0), 0.0).sum()), nominal


class Bender:
    """The search for a way between two forms, a few trials at a time."""

    def __init__(self, model: Model, way: Way, guess: Vectoring, config: InterferenceConfig, seed: int = 0) -> None:
        """Begin at the straight way (`MissingDependencyError` without the library)."""
        try:
            import cma
        except ModuleNotFoundError as error:
            raise MissingDependencyError("cma", "pip install 'spidar-gym[tune]'") from error
        self._model, self._guess, self._config = model, guess, config
        self.way, reach = way, 0.5 * way.length
        # Where c may be, a box around the middle: joints that have far to go may hardly bend.
        self._room = reach - 0.5 * np.abs(way.end - way.begin)
        self._room = np.minimum(self._room, ROBOT.joint_limit - np.abs(way.bend))
        self.straight = self.least = self._cheapest = self.cost(way)
        self.goal = overlap(model, way.end, guess, config)[0]
        options = {
            "popsize": TRIALS, "seed": np.nan, "randn": np.random.RandomState(seed).randn, "verbose": -9,
            "CMA_diagonal": True, "bounds": [-1.0, 1.0],
        }  # fmt: skip
        self._search: Any = cma.CMAEvolutionStrategy(np.zeros(N_JOINTS), SPREAD, options)

    @property
    def plan(self) -> Plan:
        """How it fares by now."""
        return Plan(self.straight, self.least, self.goal)

    def cost(self, way: Way) -> float:
        """Mean overlap along a way [rad]."""
        guess, total = self._guess, 0.0
        for s in SAMPLES:
            depth, guess = overlap(self._model, way.at(s), guess, self._config)
            total += depth
        return total / len(SAMPLES)

    def go_on(self) -> None:
        """Try some more ways, where the best one is not free yet."""
        if self.least == 0.0:
            return
        middle = 0.5 * (self.way.begin + self.way.end)
        points = self._search.ask()
        costs = []
        for point in points:
            bent = Way(self.way.begin, self.way.end, middle + self._room * np.array(point))
            depth = self.cost(bent)
            # Of ways that are as free the one with the least detour.
            costs.append(depth + DETOUR * float(np.square(point).mean()))
            if costs[-1] < self._cheapest:
                self._cheapest, self.least, self.way = costs[-1], depth, bent
        self._search.tell(points, costs)


class PlanningController(FlightController):
    """`tuned`'s law; the joints go the way that was planned, where the form was known in time, and else straight."""

    def reset(
        self, state: RobotState, joint_position: JointVector | None = None, trim: np.ndarray | None = None
    ) -> None:
        """Forget everything."""
        super().reset(state, joint_position, trim)
        self.plans: list[Plan] = []
        self._way: Way | None = None
        self._bender: Bender | None = None

    def compute_joints(self, target: JointVector, speed_scale: float) -> tuple[JointVector, JointVector]:
        """Next joint command along the way, and its rate."""
        command = self.memory.joint_position
        target = np.clip(target, -ROBOT.joint_limit, ROBOT.joint_limit)
        if self._way is not None and not np.array_equal(self._way.end, target):
            self._way = None
        if self._way is None and np.abs(target - command).max() > 1e-9:
            self._set_off(command, target)
        if self._way is None:
            self._look_ahead(command, target)
            return super().compute_joints(target, speed_scale)
        following = self._advance(self._way, min(1.0, max(0.0, speed_scale)))
        return following, (following - command) / self.dt

    def _set_off(self, command: JointVector, target: JointVector) -> None:
        """Take the way that was planned for this, if it was."""
        bender, self._bender = self._bender, None
        if bender is None or not np.array_equal(bender.way.end, target):
            return
        if np.abs(bender.way.begin - command).max() < 1e-9:
            self.plans.append(bender.plan)
            self._way = bender.way

    def _look_ahead(self, command: JointVector, target: JointVector) -> None:
        """Plan on for the form that comes next."""
        if self.preview is None or np.abs(target - command).max() > 1e-9:
            return
        coming = np.clip(self.preview(AHEAD).joint_target, -ROBOT.joint_limit, ROBOT.joint_limit)
        if np.abs(coming - target).max() < 1e-9:
            return
        if self._bender is None or not np.array_equal(self._bender.way.end, coming):
            way = straight(command.copy(), coming)
            self._bender = Bender(self.model, way, self.memory.vectoring, self.config.interference, len(self.plans))
        self._bender.go_on()

    def _advance(self, way: Way, speed_scale: float) -> JointVector:
        """Go on along a way for a tick; the form is exact at its end."""
        speed, ramp = self.config.joint_speed * speed_scale, self.config.compensation.joint_ramp
        if ramp > 0.0:
            gone, rate = ramp_joints(
                np.array([way.gone]), np.array([way.speed]), np.array([way.length]), speed=max(speed, 1e-6), ramp=ramp,
                dt=self.dt,
            )  # fmt: skip
            way.gone, way.speed = float(gone[0]), float(rate[0])
        else:
            way.gone = min(way.length, way.gone + speed * self.dt)
        if way.gone >= way.length - 1e-9:
            self._way = None
            return way.end.copy()
        return way.at(way.gone / way.length)


def plan_between(begin: JointVector, end: JointVector, trials: int = 40 * TRIALS) -> Plan:
    """How a way between two forms fares, planned for as long as a second's ticks.

    Args:
        begin: q₀ [rad].
        end: q₁ [rad].
        trials: How many ways are tried.
    """
    model, config = Model(), InterferenceConfig()
    guess = FlightController(TUNED).rest_vectoring(begin)
    bender = Bender(model, straight(begin, end), guess, config)
    for _ in range(trials // TRIALS):
        bender.go_on()
    return bender.plan


def drawn_pairs(count: int = PAIRS, seed: int = 0) -> str:
    """A sentence on how forms of independent legs fare, and the straight ways between them."""
    (least, most), legs = DRAWN_FORMS["independent"]
    rng = np.random.Generator(np.random.PCG64(seed))
    forms = rng.uniform(np.tile(least, legs), np.tile(most, legs), (count, 2, N_JOINTS))
    model, config, rest = Model(), InterferenceConfig(), FlightController(TUNED).rest_vectoring
    own, needed = 0, 0
    for begin, end in forms:
        guess = rest(begin)
        bender = Bender(model, straight(begin, end), guess, config)
        ends = overlap(model, begin, guess, config)[0] > 0.0, bender.goal > 0.0
        own += sum(ends)
        needed += not any(ends) and bender.straight > 0.0
    return (
        f"of {2 * count} drawn forms {own} stand in their own jets; of {count} ways between two of them {needed} "
        "join free ones and are not free"
    )


def main() -> None:
    """Print how the ways between the paper's forms fare."""
    lines = [["from", "to", "straight way", "bent way", "at its end", ""]]
    for a, begin in FORMS.items():
        for b, end in FORMS.items():
            if a != b:
                plan = plan_between(begin, end)
                words = "free" if plan.bent == 0.0 else "no free way: the form is in its own jets" if plan.goal else ""
                lines.append([a, b, *(f"{value:.3f} rad" for value in plan), words])
    sys.stdout.write(f"{format_table(lines)}\n\n{drawn_pairs()}\n")


class Planning(PresetPolicy):
    """Joint motion bent around each rotor's jets, allocation without interference rows; flights only."""

    presets = {HOVER: {"controller": TUNED, "law": PlanningController, "avoid_interference": False}}  # noqa: RUF012 - nobody writes it


if __name__ == "__main__":
    main()
