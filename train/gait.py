"""Search for a crawler's gait parameters by phase, and compare the result with the crawler.

    python -m train.gait crawl --seed 0

There are up to 30 parameters, added to those of the crawler: phase rate and vertical foot force in each of six phases
that move, raise angle, stride and lift height. The last cycle, which determines the final pose, has its own set. The
cost of an episode is known only at its end, so the search (`train/lib/search.py`) varies all parameters at once. All
trials of a generation use the same robots, floors and goals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.track import CRAWL, TRACKS, find_track
from spidar_gym.console import run_cli
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
"""Action mode that the parameters are entries of."""
MODE = find_action_mode(ACTION_MODE, CRAWL_MODES)
"""Definition of this action mode, with its channels."""
MOVING = tuple(PHASES.index(name) for name in ("raise", "swing", "lower", "up", "forward", "down"))
"""Indices of the phases with parameters; the other phases end immediately."""
CYCLES = 2
"""Sets of parameters: one for the last cycle, one for the cycles before it."""
BY_PHASE = ("rate", "force")
"""Parameters with a value for each phase that moves."""
BY_CYCLE = ("raise", "stride", "lift")
"""Parameters with one value in each set."""
COLUMNS = {"rate": 0, "raise": 1, "stride": 2, "lift": 3, "force": GAIT.size}
"""Name → column of the phase table: the entries of the gait, then the force."""
GROUND = tuple(name for name, track in TRACKS.items() if track.group == "ground")
"""All crawling tracks: one gait is learned for all of them."""


@dataclass(frozen=True)
class CostConfig:
    """Cost of a crawl."""

    energy: float = 0.025
    """Cost of 1 Wh/m, as in the benchmark's error."""
    hurry: float = 0.015
    """Cost of 1 s/m; over 0.6 m roughly that of the energy."""
    goal: float = 0.5
    """Largest cost of the error at the goal; 10 mm cost half of it, and 1 rad counts like 0.5 m."""
    failure: float = 0.6
    """Additional cost of a crawl that is not a success."""
    fall: float = 2.0
    """Total cost of a crawl that fails or does not arrive."""

    def __call__(self, metrics: Mapping[str, Any]) -> float:
        """Compute the cost of a crawl from the benchmark's metrics."""
        if metrics["failed"]:
            return self.fall
        energy = metrics["cost_of_transport"] * ROBOT.total_mass * GRAVITY / 3600.0  # Wh/m
        way = metrics["energy_wh"] / energy
        # Bounded, or a few large errors at the goal would dominate the cost.
        miss = (metrics["drift"] * way / SUCCESS_POSITION) ** 2
        failure = self.failure * (not metrics["success"])
        goal = self.goal * miss / (1.0 + miss)
        return self.energy * energy + self.hurry * metrics["duration_s"] / way + goal + failure


@dataclass(frozen=True)
class Args(TrialRecipe):
    """Search for gait parameters by phase."""

    action_mode = ACTION_MODE

    learned: tuple[str, ...] = (*BY_PHASE, *BY_CYCLE)
    """Parameters to learn, of rate, force, raise, stride and lift; the others keep the crawler's values."""
    crawls: int = 1
    """Number of crawls of a trial on each track."""
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
        # Strides keep the tuned values: 15 % more or less costs a third of the time. With low lifts and raises, ducts
        # touch the floor in one crawl of ten, which ten crawls per trial do not reveal reliably.
        learned=BY_PHASE,
        crawls=2,
        # Failures have a low cost here: one chance failure in ten crawls would mask all other differences. The
        # validation counts failures in full.
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
    """Return the input scaling: phases unchanged, the remaining steps as −1 in the last cycle and 1 before it."""
    pieces = crawl_layout(MODE.size)
    mean = np.concatenate([np.full(p.size, 1.5 if p.name == "steps_left" else 0.0) for p in pieces])
    variance = np.concatenate([np.full(p.size, 1e-6 if p.name == "steps_left" else 1.0) for p in pieces])
    return Scaling(mean, variance, 1.0)


def places(learned: Sequence[str]) -> list[tuple[int, tuple[int, ...], int]]:
    """Return set, phases and column of every parameter, in order."""
    found = []
    for kind in range(CYCLES):
        for name in learned:
            # Values of a cycle take effect in the tick in which a leg or the torso begins to rise.
            phases = [(k,) for k in MOVING] if name in BY_PHASE else [tuple(range(len(PHASES)))]
            found += [(kind, own, COLUMNS[name]) for own in phases]
    return found


def phase_table(learned: Sequence[str], numbers: np.ndarray) -> np.ndarray:
    """Build the phase table: parameters by phase in the last cycle, then before it, shape (2 · phases, 5)."""
    table = np.zeros((CYCLES, len(PHASES), len(COLUMNS)))
    for (kind, phases, column), number in zip(places(learned), numbers, strict=True):
        table[kind, phases, column] = number
    return table.reshape(-1, len(COLUMNS))


def layers(table: np.ndarray) -> Layers:
    """Convert a phase table to a network with two hidden units for each phase."""
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
    """Build the artifact of parameters."""
    return make_artifact(
        layers(phase_table(args.learned, numbers)), scaling(), state, name=args.name, kind="residual", doc=args.doc,
        env_id=CRAWL, arguments=args.arguments, activation="relu",
        training={"seed": args.seed, "steps": state.learner.get("ticks", 0), "chosen_at": state.best_steps},
    )  # fmt: skip


def crawl(args: Args, piece: Piece) -> tuple[float, int]:
    """Run a track's scenarios; return the mean cost and the simulated control ticks."""
    numbers, track, scenarios = piece
    played = play(LearnedPolicy(artifact(args, numbers, State())), track, scenarios, control=args.control)
    metrics = [each["metrics"] for each in played]
    seconds = sum(each["duration_s"] or 0.0 for each in metrics)  # None if the simulation diverged
    return float(np.mean([args.cost(each) for each in metrics])), round(seconds * CONTROL_RATE)


def learn(args: Args) -> Path:
    """Start or resume a run; return the path of its artifact."""
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
