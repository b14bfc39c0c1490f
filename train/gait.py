"""Learn the gait's parameters by phase: a search in the engine, judged against the crawler that they are added to.

    python -m train.gait crawl --seed 0

What is learned are 30 numbers: phase rate and vertical force at the feet in every phase that moves, raise angle,
stride and lift height, once for the last cycle, which decides where the robot ends, and once for those before it. An
episode's cost is known at its end alone: so the numbers are tried together, all trials of a generation on the very
same robots, floors and goals, and `train/lib/search.py` says what follows from their costs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.track import CRAWL, TRACKS, find_track
from spidar_gym.cli.console import run_cli
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.actions import CRAWL_MODES, GAIT, find_action_mode
from spidar_gym.errors import InvalidValueError, require_least, require_name
from spidar_gym.policies.artifact import Artifact, LearnedPolicy
from spidar_gym.robot import GRAVITY, ROBOT
from spidar_gym.tasks.crawl import SUCCESS_POSITION
from train.lib.config import parse
from train.lib.envs import Scaling
from train.lib.evaluate import Base
from train.lib.learner import Layers
from train.lib.report import report
from train.lib.run import State, make_artifact
from train.lib.search import SearchConfig
from train.lib.trials import EvaluationConfig, Piece, Task, TrialRecipe, learn_by_trials

ACTION_MODE = "residual_gait_force"
"""Action mode that the numbers are given to."""
MODE = find_action_mode(ACTION_MODE, CRAWL_MODES)
"""Its channels."""
MOVING = tuple(PHASES.index(name) for name in ("raise", "swing", "lower", "up", "forward", "down"))
"""Phases that have numbers of their own; the others are over at once."""
CYCLES = 2
"""Kinds of cycles with numbers of their own: the last one, and those before it."""
BY_PHASE = ("rate", "force")
"""What has a number for each phase that moves."""
BY_CYCLE = ("raise", "stride", "lift")
"""What has one for each kind of cycles."""
COLUMNS = {"rate": 0, "raise": 1, "stride": 2, "lift": 3, "force": GAIT.size}
"""Name → column of a table of phases: the entries of the gait, then the force."""
GROUND = tuple(name for name, track in TRACKS.items() if track.group == "ground")
"""All crawls: a gait is one for every track."""


@dataclass(frozen=True)
class CostConfig:
    """What a crawl costs."""

    energy: float = 0.025
    """Cost of 1 Wh/m; the benchmark's error has the same."""
    hurry: float = 0.015
    """Cost of 1 s/m: in 0.6 m as much as the energy, roughly."""
    goal: float = 0.5
    """Largest cost of an error at the goal; 10 mm cost half of it, a radian counts 0.5 m."""
    failure: float = 0.6
    """Cost of what is no success, for whatever reason."""
    fall: float = 2.0
    """Cost of a crawl that ends early or does not arrive, all in all."""

    def __call__(self, metrics: Mapping[str, Any]) -> float:
        """Cost of a crawl with the benchmark's metrics."""
        if metrics["failed"]:
            return self.fall
        energy = metrics["cost_of_transport"] * ROBOT.total_mass * GRAVITY / 3600.0  # Wh/m
        way = metrics["energy_wh"] / energy
        # Bounded: the few large errors at the goal would decide everything.
        miss = (metrics["drift"] * way / SUCCESS_POSITION) ** 2
        failure = self.failure * (not metrics["success"])
        goal = self.goal * miss / (1.0 + miss)
        return self.energy * energy + self.hurry * metrics["duration_s"] / way + goal + failure


@dataclass(frozen=True)
class Args(TrialRecipe):
    """Learn the gait's parameters by phase."""

    action_mode = ACTION_MODE

    learned: tuple[str, ...] = (*BY_PHASE, *BY_CYCLE)
    """What is learned, of rate, force, raise, stride and lift; the rest stays as the crawler has it."""
    crawls: int = 1
    """Crawls of a trial on each track."""
    cost: CostConfig = field(default_factory=CostConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_least(1, crawls=self.crawls)
        for name in self.learned:
            require_name("learned", name, COLUMNS)
        for track in self.tracks:
            if find_track(track).flies:
                raise InvalidValueError("tracks", track, "crawls: a flight has no gait")


PRESETS: dict[str, Args] = {
    "crawl": Args(
        "gait",
        "CMA-ES: rates and foot forces by phase on the crawler `robust_overlapped`.",
        GROUND,
        "robust_overlapped",
        # Strides stay as searched: 15 % more or less cost a third of the time. Low lifts and raises let ducts touch the
        # floor in one crawl of ten, which a search that sees ten a trial does not find out.
        learned=BY_PHASE,
        crawls=2,
        # Mishaps count little here: by chance one of ten outweighs what a generation could tell, and the validation
        # counts them in full.
        cost=CostConfig(goal=0.3, failure=0.2, fall=1.0),
        search=SearchConfig(generations=8, population=12, spread=0.2),
        evaluation=EvaluationConfig(scenarios=16, validations=2),
    ),
    "crawl-pairs": Args(
        "learned_gait",
        "Random search: gait parameters and foot forces by phase on the crawler `robust_overlapped_v1`.",
        ("ground-randomised",),
        "robust_overlapped_v1",
        learned=("force", "raise", "lift"),
        search=SearchConfig("pairs", generations=90, population=8, spread=0.3),
    ),
}
"""Settings by name."""


def scaling() -> Scaling:
    """What enters the network: phases as they are, and −1 in the last cycle, 1 before it."""
    pieces = crawl_layout(MODE.size)
    mean = np.concatenate([np.full(p.size, 1.5 if p.name == "steps_left" else 0.0) for p in pieces])
    variance = np.concatenate([np.full(p.size, 1e-6 if p.name == "steps_left" else 1.0) for p in pieces])
    return Scaling(mean, variance, 1.0)


def places(learned: Sequence[str]) -> list[tuple[int, tuple[int, ...], int]]:
    """Kind of cycles, phases and column of every number, in their order."""
    found = []
    for kind in range(CYCLES):
        for name in learned:
            # What belongs to a cycle counts in the tick in which a leg begins to rise, or the torso.
            phases = [(k,) for k in MOVING] if name in BY_PHASE else [tuple(range(len(PHASES)))]
            found += [(kind, own, COLUMNS[name]) for own in phases]
    return found


def phase_table(learned: Sequence[str], numbers: np.ndarray) -> np.ndarray:
    """The gait's entries and the force in every phase of the last cycle, then of the others, shape (2 phases, 5)."""
    table = np.zeros((CYCLES, len(PHASES), len(COLUMNS)))
    for (kind, phases, column), number in zip(places(learned), numbers, strict=True):
        table[kind, phases, column] = number
    return table.reshape(-1, len(COLUMNS))


def layers(table: np.ndarray) -> Layers:
    """A table of phases as a network: two hidden units for each phase."""
    starts, start = {}, 0
    for piece in crawl_layout(MODE.size):
        starts[piece.name], start = start, start + piece.size
    n = len(PHASES)
    hidden = np.zeros((CYCLES * n, start), np.float32)
    for k in range(n):
        hidden[[k, n + k], starts["phase"] + k] = 1.0
    hidden[:n, starts["steps_left"]], hidden[n:, starts["steps_left"]] = -0.5, 0.5
    last = np.zeros((MODE.size, CYCLES * n), np.float32)
    last[: GAIT.size] = table.T[: GAIT.size]
    last[GAIT.size + 2 :: 3] = table.T[GAIT.size]
    return (hidden, np.full(CYCLES * n, -0.5, np.float32)), (last, np.zeros(MODE.size, np.float32))


def artifact(args: Args, numbers: np.ndarray, state: State) -> Artifact:
    """The numbers as the benchmark's artifact."""
    return make_artifact(
        layers(phase_table(args.learned, numbers)), scaling(), state, name=args.name, kind="residual", doc=args.doc,
        env_id=CRAWL, arguments=args.arguments, activation="relu",
        training={"seed": args.seed, "steps": state.learner.get("ticks", 0), "chosen_at": state.best_steps},
    )  # fmt: skip


def crawl(args: Args, piece: Piece) -> tuple[float, int]:
    """Cost of numbers on a track's scenarios, mean, and the ticks that it took."""
    numbers, track, scenarios = piece
    played = play(LearnedPolicy(artifact(args, numbers, State())), track, scenarios, control=args.control)
    metrics = [each["metrics"] for each in played]
    seconds = sum(each["duration_s"] or 0.0 for each in metrics)  # None where it diverged
    return float(np.mean([args.cost(each) for each in metrics])), round(seconds * CONTROL_RATE)


def learn(args: Args) -> Path:
    """One run, from its beginning or from where it was interrupted; the path of its artifact."""
    task = Task(
        CRAWL, len(places(args.learned)), args.crawls, "crawls", Base(args.arguments), scaling(),
        partial(artifact, args), partial(crawl, args),
    )  # fmt: skip
    return learn_by_trials(args, task)


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.gait", __doc__)
    report(learn(args), args, CRAWL, args.tracks, args.base, workers=args.workers)


if __name__ == "__main__":
    run_cli("train.gait", main)
