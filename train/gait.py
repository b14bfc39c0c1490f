"""Learn the gait's parameters by phase: random search in pairs, judged against the crawler that they are added to.

    python -m train.gait crawl --seed 0

What is learned are 16 numbers: vertical force at the feet in every phase that moves, raise angle and lift height, once
for the last cycle, which decides where the robot ends, and once for those before it. (Phase rate and stride are
best as they are.) An episode's cost is known at its end alone; so the numbers are changed together, up and down one
direction on the very same robot, floor and goal, and moved along the directions by the differences of the costs
(augmented random search, Mania 2018).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.track import CRAWL, find_track
from spidar_gym.cli.console import kept, run_cli
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.actions import CRAWL_MODES, GAIT, find_action_mode
from spidar_gym.envs.crawl.task import SUCCESS_POSITION
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.policies.artifact import Artifact, LearnedPolicy
from spidar_gym.policies.rollout import rollout
from spidar_gym.processes import cpu_count
from train.lib.config import TrackRecipe, parse
from train.lib.envs import Scaling, make_track_env, training_seed
from train.lib.evaluate import Base, PairedEvaluator, Verdict
from train.lib.learner import Layers
from train.lib.report import report
from train.lib.run import Run, State, curve_line, make_artifact, require_frameworks
from train.lib.stages import Stages

ACTION_MODE = "residual_gait_force"
"""Action mode that the numbers are given to."""
MODE = find_action_mode(ACTION_MODE, CRAWL_MODES)
"""Its channels."""
MOVING = tuple(PHASES.index(name) for name in ("raise", "swing", "lower", "up", "forward", "down"))
"""Phases that have a force of their own; the others are over at once."""
CYCLES = 2
"""Kinds of cycles with numbers of their own: the last one, and those before it."""
SIZE = CYCLES * (len(MOVING) + 2)
"""How many numbers: forces, raise angle and lift height of the last cycle, then of the others."""


@dataclass(frozen=True)
class SearchConfig:
    """How the numbers are searched for."""

    steps: int = 500_000
    """Control ticks to learn from."""
    directions: int = 4
    """Directions between two updates, each with two crawls."""
    spread: float = 0.3
    """Standard deviation of a number's change along a direction."""
    rate: float = 0.04
    """Root mean square of an update's changes of the numbers at the beginning; it falls to 0 evenly."""
    momentum: float = 0.7
    """Fraction of the last update's direction that the next one keeps."""

    def __post_init__(self) -> None:
        require_least(1, steps=self.steps, directions=self.directions)


@dataclass(frozen=True)
class CostConfig:
    """What a crawl costs."""

    energy: float = 0.025
    """Cost of 1 Wh/m; the benchmark's error has the same."""
    hurry: float = 0.5
    """Cost of a crawl that takes the nominal time."""
    goal: float = 0.5
    """Largest cost of an error at the goal; 10 mm cost half of it, a radian counts 0.5 m."""
    failure: float = 0.6
    """Cost of what is no success, for whatever reason."""


@dataclass(frozen=True)
class EvaluationConfig:
    """How often, and on what, the numbers are compared with the gait as it is."""

    scenarios: int = 16
    """Validation scenarios of each track."""
    validations: int = 8
    """How often it is evaluated."""

    def __post_init__(self) -> None:
        require_least(1, scenarios=self.scenarios, validations=self.validations)


@dataclass(frozen=True)
class Args(TrackRecipe):
    """Learn the gait's parameters by phase."""

    action_mode = ACTION_MODE

    search: SearchConfig = field(default_factory=SearchConfig)
    cost: CostConfig = field(default_factory=CostConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        for track in self.tracks:
            if find_track(track).flies:
                raise InvalidValueError("tracks", track, "crawls: a flight has no gait")


PRESETS: dict[str, Args] = {
    "crawl": Args(
        "learned_gait",
        "Random search: gait parameters and foot forces by phase on the crawler `robust_overlapped`.",
        ("ground-randomised",),
        "robust_overlapped",
    ),
}
"""Settings by name."""


def scaling() -> Scaling:
    """What enters the network: phases as they are, and −1 in the last cycle, 1 before it."""
    pieces = crawl_layout(MODE.size)
    mean = np.concatenate([np.full(p.size, 1.5 if p.name == "steps_left" else 0.0) for p in pieces])
    variance = np.concatenate([np.full(p.size, 1e-6 if p.name == "steps_left" else 1.0) for p in pieces])
    return Scaling(mean, variance, 1.0)


def phase_table(numbers: np.ndarray) -> np.ndarray:
    """Raise, lift and force in every phase of the last cycle, then of the others, shape (2 phases, 3)."""
    table = np.zeros((CYCLES, len(PHASES), 3))
    for rows, own in zip(table, numbers.reshape(CYCLES, -1), strict=True):
        rows[MOVING, 2] = own[: len(MOVING)]
        # What counts is the tick in which a leg begins to rise, or the torso.
        rows[:, :2] = own[len(MOVING) :]
    return table.reshape(-1, 3)


def layers(numbers: np.ndarray) -> Layers:
    """The numbers, shape (`SIZE`,), within ± 1, as a network: two hidden units for each phase."""
    places, place = {}, 0
    for piece in crawl_layout(MODE.size):
        places[piece.name], place = place, place + piece.size
    n = len(PHASES)
    hidden = np.zeros((CYCLES * n, place), np.float32)
    for k in range(n):
        hidden[[k, n + k], places["phase"] + k] = 1.0
    hidden[:n, places["steps_left"]], hidden[n:, places["steps_left"]] = -0.5, 0.5
    columns = phase_table(numbers).T
    last = np.zeros((MODE.size, CYCLES * n), np.float32)
    last[[1, 3]] = columns[:2]
    last[GAIT.size + 2 :: 3] = columns[2]
    return (hidden, np.full(CYCLES * n, -0.5, np.float32)), (last, np.zeros(MODE.size, np.float32))


def artifact(args: Args, numbers: np.ndarray, state: State) -> Artifact:
    """The numbers as the benchmark's artifact."""
    return make_artifact(
        layers(numbers), scaling(), state, name=args.name, kind="residual", doc=args.doc, env_id=CRAWL,
        arguments=args.arguments, activation="relu",
        training={"seed": args.seed, "steps": state.learner.get("ticks", 0), "chosen_at": state.best_steps},
    )  # fmt: skip


class Course:
    """Crawls of the tracks' kinds: what a gait costs on one of them."""

    def __init__(self, args: Args) -> None:
        """Make the environments."""
        self._args = args
        self._envs = [make_track_env(track, args.arguments, args.control) for track in args.tracks]

    def cost(self, numbers: np.ndarray, index: int, seed: int) -> tuple[float, int]:
        """Cost of a crawl, and its ticks; the tracks take turns."""
        config, env = self._args.cost, self._envs[index % len(self._envs)]
        inner: Any = env.unwrapped
        info, ticks = {}, 0
        for step in rollout(env, LearnedPolicy(artifact(self._args, numbers, State())), seed=seed):
            info, ticks = step.info, ticks + 1
        progress = inner.progress
        # Bounded: the few large errors at the goal would decide everything.
        miss = (progress.distance / SUCCESS_POSITION) ** 2
        energy = config.energy * info["energy_wh"] / progress.initial_distance
        duration = config.hurry * ticks / CONTROL_RATE / progress.nominal_time
        failure = config.failure * (not info["is_success"])
        return energy + duration + config.goal * miss / (1.0 + miss) + failure, ticks

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            env.close()


def update(
    args: Args, course: Course, numbers: np.ndarray, direction: np.ndarray, index: int, progress: float,
    on_ticks: Callable[[int], object],
) -> tuple[np.ndarray, np.ndarray, int]:  # fmt: skip
    """The numbers after one update, its direction, and the ticks it took.

    Args:
        args: Settings.
        course: Environments that it crawls in.
        numbers: Numbers before the update.
        direction: Direction of the last update.
        index: Index of the update; everything drawn in it depends on it and on the run's seed.
        progress: Fraction of the run that is done.
        on_ticks: Called with the ticks of each crawl.
    """
    search, total = args.search, 0
    rng = np.random.Generator(np.random.PCG64(training_seed(args.seed, 5, index)))
    direction = search.momentum * direction
    for k, tried in enumerate(rng.standard_normal((search.directions, SIZE))):
        seed, costs = training_seed(args.seed, 6, index, k), []
        for sign in (1.0, -1.0):
            cost, ticks = course.cost(
                np.clip(numbers + sign * search.spread * tried, -1.0, 1.0), index * search.directions + k, seed
            )
            costs.append(cost)
            total += ticks
            on_ticks(ticks)
        direction = direction - (costs[0] - costs[1]) * tried
    size = float(np.sqrt(np.mean(direction**2)))
    if size > 0.0:
        numbers = numbers + search.rate * (1.0 - progress) * direction / size
    return np.clip(numbers, -1.0, 1.0), direction, total


def learn(args: Args) -> Path:
    """One run, from its beginning or from where it was interrupted; the path of its artifact."""
    require_frameworks()
    run = Run.of(args, CRAWL, args.arguments)
    state = run.load() or State()
    with (
        kept(lambda: f"{state.learner.get('ticks', 0)} ticks kept in {run.folder}; the same command goes on"),
        Stages(f"{args.name} seed {args.seed}", state.parts) as stages,
    ):
        return _learn(args, run, state, stages)


def _learn(args: Args, run: Run, state: State, stages: Stages) -> Path:
    """Learn from a state on; the path of the artifact."""
    steps, evaluation = args.search.steps, args.evaluation
    stages.begin("playing the base", len(args.tracks) * evaluation.scenarios, "scenario", "validation")
    evaluator = PairedEvaluator(
        args.tracks, Base(args.arguments), evaluation.scenarios, control=args.control, on_scenario=stages.count
    )
    state.base, state.scaling = evaluator.means, vars(scaling())
    # In the file, `way` is the direction of the last update.
    fresh = {**{name: np.zeros(SIZE) for name in ("numbers", "way", "best")}, "ticks": 0, "updates": 0}
    learner = dict(state.learner) or fresh
    run.require_alike(learner, fresh)
    if not state.learner:
        evaluator.require_same_as_base(artifact(args, learner["numbers"], state))

    def choose(verdict: Verdict, numbers: np.ndarray) -> None:
        learner["best"], state.best_score, state.best_steps = numbers, verdict.score, learner["ticks"]

    stages.begin("learning", steps, "tick", "crawls", learner["ticks"])
    course = Course(args)
    while learner["ticks"] < steps:
        began = time.perf_counter()
        stages.say("learning", "crawls")
        learner["numbers"], learner["way"], ticks = update(
            args, course, learner["numbers"], learner["way"], learner["updates"], learner["ticks"] / steps, stages.count
        )
        learner["ticks"], learner["updates"] = learner["ticks"] + ticks, learner["updates"] + 1
        state.learner = dict(learner)
        verdict = None
        if learner["ticks"] >= steps * (state.segment + 1) / evaluation.validations:
            stages.say("playing against the base", "validation")
            verdict = evaluator.evaluate(artifact(args, learner["numbers"], state))
            stages.evaluated(verdict)
            if verdict.admissible and verdict.score < state.best_score:
                choose(verdict, learner["numbers"])
            state.learner, state.segment = dict(learner), state.segment + 1
        state.seconds += time.perf_counter() - began
        if verdict is not None:
            state.curve.append(curve_line(learner["ticks"], state.seconds, verdict))
        run.save(state)
    if not state.best_steps:
        # All of it made something worse at every validation; perhaps less of it does not.
        stages.say("playing less of it against the base", "validation")
        verdict, fraction = evaluator.largest_fraction(
            lambda fraction: artifact(args, fraction * learner["numbers"], state)
        )
        if verdict.admissible and verdict.score < 0.0:
            choose(verdict, fraction * learner["numbers"])
    course.close()
    run.write_curve(state)
    return run.publish(artifact(args, learner["best"], state))


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.gait", __doc__)
    report(learn(args), args, CRAWL, args.tracks, args.base, workers=cpu_count())


if __name__ == "__main__":
    run_cli("train.gait", main)
