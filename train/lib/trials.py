"""Gradient-free learning: a search tries parameters on episodes, the same for all trials of a generation."""

import time
import zlib
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path

import numpy as np

from spidar_gym.benchmark.scenario import Scenario, draw_scenario_from
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.console import kept
from spidar_gym.errors import require_least
from spidar_gym.policies.artifact import Artifact
from spidar_gym.policies.policy import Policy
from spidar_gym.processes import Pool, cpu_count
from train.lib.config import TrackRecipe
from train.lib.envs import Scaling, training_seed
from train.lib.evaluate import PairedEvaluator, Verdict
from train.lib.run import Run, State, curve_line, require_frameworks
from train.lib.search import SearchConfig, make_search
from train.lib.stages import Stages

Piece = tuple[np.ndarray, str, list[Scenario]]
"""Parameters, a track, and the scenarios of the track to evaluate them on."""


@dataclass(frozen=True)
class EvaluationConfig:
    """Validation of the parameters against their initial values."""

    scenarios: int = 12
    """Number of validation scenarios of each track."""
    validations: int = 6
    """Number of validations, evenly spaced over the generations."""

    def __post_init__(self) -> None:
        require_least(1, scenarios=self.scenarios, validations=self.validations)


@dataclass(frozen=True)
class TrialRecipe(TrackRecipe):
    """Settings common to recipes of gradient-free learning."""

    _: KW_ONLY
    workers: int = cpu_count()
    """Number of processes that run episodes."""
    search: SearchConfig = field(default_factory=SearchConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_least(1, workers=self.workers)


@dataclass(frozen=True)
class Task:
    """Definition of a learning task."""

    env_id: str
    """Environment id."""
    size: int
    """Number of parameters, all initially 0."""
    episodes: int
    """Number of episodes of a trial on each track."""
    unit: str
    """Plural noun for the episodes."""
    base: Policy
    """Policy that parameters of zero correspond to."""
    scaling: Scaling
    """Scaling of the observations."""
    artifact: Callable[[np.ndarray, State], Artifact]
    """Builds the artifact of parameters."""
    cost: Callable[[Piece], tuple[float, int]]
    """Returns the mean cost of parameters on scenarios and the control ticks simulated; can run in any process."""


def draw_scenarios(args: TrialRecipe, generation: int, episodes: int) -> list[tuple[str, list[Scenario]]]:
    """Sample the episodes of a generation, the same for all its trials: scenarios of each track, of no split."""
    found = []
    for name in args.tracks:
        seeds = [training_seed(args.seed, 6, generation, zlib.crc32(name.encode()), k) for k in range(episodes)]
        rngs = [np.random.Generator(np.random.PCG64(seed)) for seed in seeds]
        found.append((name, [draw_scenario_from(TRACKS[name], rng, k) for k, rng in enumerate(rngs)]))
    return found


def learn_by_trials(args: TrialRecipe, task: Task) -> Path:
    """Start or resume a run; return the path of its artifact."""
    require_frameworks()
    run = Run.of(args, task.env_id, args.arguments)
    state = run.load() or State()
    with (
        kept(lambda: f"{state.learner.get('ticks', 0)} ticks kept in {run.folder}; the same command resumes"),
        Pool(args.workers) as pool,
        Stages(f"{args.name} seed {args.seed}", state.parts) as stages,
    ):
        return _learn(args, task, run, state, pool, stages)


def _learn(args: TrialRecipe, task: Task, run: Run, state: State, pool: Pool, stages: Stages) -> Path:
    """Continue the run from a state; return the path of the artifact."""
    config, evaluation, size, artifact = args.search, args.evaluation, task.size, task.artifact
    stages.begin("evaluating the base", len(args.tracks) * evaluation.scenarios, "scenario", "validation")
    evaluator = PairedEvaluator(
        args.tracks, task.base, evaluation.scenarios, control=args.control, on_scenario=stages.count, each=pool.map,
    )  # fmt: skip
    state.base, state.scaling = evaluator.means, vars(task.scaling)
    fresh = {"costs": np.zeros((0, config.population)), "best": np.zeros(size), "ticks": 0}
    learner = dict(state.learner) or fresh
    run.require_alike(learner, fresh)
    if not state.learner:
        evaluator.require_same_as_base(artifact(np.zeros(size), state))
    search = make_search(config, size, args.seed)
    for costs in learner["costs"]:
        search.ask()
        search.tell(costs)

    def choose(verdict: Verdict, numbers: np.ndarray) -> None:
        learner["best"], state.best_score, state.best_steps = numbers, verdict.score, learner["ticks"]

    stages.begin("learning", config.generations, "generation", task.unit, len(learner["costs"]))
    while (generation := len(learner["costs"])) < config.generations:
        began = time.perf_counter()
        stages.say("learning", task.unit)
        trials, drawn = search.ask(), draw_scenarios(args, generation, task.episodes)
        found = list(pool.map(task.cost, [(numbers, *own) for numbers in trials for own in drawn]))
        costs = np.array([cost for cost, _ in found]).reshape(len(trials), len(drawn)).mean(axis=1)
        search.tell(costs)
        learner["costs"] = np.concatenate([learner["costs"], costs[None]])
        learner["ticks"] += sum(ticks for _, ticks in found)
        stages.count()
        verdict = None
        if (generation + 1) * evaluation.validations >= config.generations * (state.segment + 1):
            stages.say("comparing with the base", "validation")
            verdict = evaluator.evaluate(artifact(search.mean, state))
            stages.evaluated(verdict)
            if verdict.admissible and verdict.score < state.best_score:
                choose(verdict, search.mean)
            state.segment += 1
        state.learner = dict(learner)
        state.seconds += time.perf_counter() - began
        if verdict is not None:
            state.curve.append(curve_line(learner["ticks"], state.seconds, verdict))
        run.save(state)
    if not state.best_steps:
        # No validation was admissible and better: try fractions of the learned parameters.
        stages.say("comparing a fraction with the base", "validation")
        verdict, fraction = evaluator.largest_fraction(lambda fraction: artifact(fraction * search.mean, state))
        if verdict.admissible and verdict.score < 0.0:
            choose(verdict, fraction * search.mean)
            state.curve.append(curve_line(learner["ticks"], state.seconds, verdict))
    run.write_curve(state)
    return run.publish(artifact(learner["best"], state))
