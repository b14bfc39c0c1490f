"""Learning by trials: numbers that a search tries on episodes, the same for all trials of a generation."""

import time
import zlib
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path

import numpy as np

from spidar_gym.benchmark.scenario import Scenario, draw_scenario_from
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.cli.console import kept
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
"""Numbers, a track, and scenarios of it that they are tried on."""


@dataclass(frozen=True)
class EvaluationConfig:
    """How often, and on what, the numbers are compared with what they begin as."""

    scenarios: int = 12
    """Validation scenarios of each track."""
    validations: int = 6
    """How often it is evaluated."""

    def __post_init__(self) -> None:
        require_least(1, scenarios=self.scenarios, validations=self.validations)


@dataclass(frozen=True)
class TrialRecipe(TrackRecipe):
    """What the settings of a recipe that learns by trials have."""

    _: KW_ONLY
    workers: int = cpu_count()
    """Processes that play."""
    search: SearchConfig = field(default_factory=SearchConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_least(1, workers=self.workers)


@dataclass(frozen=True)
class Task:
    """What is learned by trials."""

    env_id: str
    """Environment."""
    size: int
    """How many numbers, all 0 at the beginning."""
    episodes: int
    """Episodes of a trial on each track."""
    unit: str
    """What an episode is called, more than one."""
    base: Policy
    """What zeros are."""
    scaling: Scaling
    """How observations enter the network."""
    artifact: Callable[[np.ndarray, State], Artifact]
    """Numbers as the benchmark's artifact."""
    cost: Callable[[Piece], tuple[float, int]]
    """Mean cost of numbers on scenarios, and the ticks that it took; in any process."""


def draw_scenarios(args: TrialRecipe, generation: int, episodes: int) -> list[tuple[str, list[Scenario]]]:
    """The episodes of a generation, the same for all its trials: scenarios of each track, of no split."""
    found = []
    for name in args.tracks:
        seeds = [training_seed(args.seed, 6, generation, zlib.crc32(name.encode()), k) for k in range(episodes)]
        rngs = [np.random.Generator(np.random.PCG64(seed)) for seed in seeds]
        found.append((name, [draw_scenario_from(TRACKS[name], rng, k) for k, rng in enumerate(rngs)]))
    return found


def learn_by_trials(args: TrialRecipe, task: Task) -> Path:
    """One run, from its beginning or from where it was interrupted; the path of its artifact."""
    require_frameworks()
    run = Run.of(args, task.env_id, args.arguments)
    state = run.load() or State()
    with (
        kept(lambda: f"{state.learner.get('ticks', 0)} ticks kept in {run.folder}; the same command goes on"),
        Pool(args.workers) as pool,
        Stages(f"{args.name} seed {args.seed}", state.parts) as stages,
    ):
        return _learn(args, task, run, state, pool, stages)


def _learn(args: TrialRecipe, task: Task, run: Run, state: State, pool: Pool, stages: Stages) -> Path:
    """Learn from a state on; the path of the artifact."""
    config, evaluation, size, artifact = args.search, args.evaluation, task.size, task.artifact
    stages.begin("playing the base", len(args.tracks) * evaluation.scenarios, "scenario", "validation")
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
            stages.say("playing against the base", "validation")
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
        # All of it made something worse at every validation; perhaps less of it does not.
        stages.say("playing less of it against the base", "validation")
        verdict, fraction = evaluator.largest_fraction(lambda fraction: artifact(fraction * search.mean, state))
        if verdict.admissible and verdict.score < 0.0:
            choose(verdict, fraction * search.mean)
            state.curve.append(curve_line(learner["ticks"], state.seconds, verdict))
    run.write_curve(state)
    return run.publish(artifact(learner["best"], state))
