"""Search for the parameters of the course rule (distances, heights, speeds), and compare the result with the rule.

    python -m train.course rule --seed 0

The policy commands a target twice a second. With parameters of 0 it equals `course_rule` bit for bit. A collision can
occur minutes after the decision that caused it, so an episode is one sample, as for the gait (`train/gait.py`). All
trials of a generation use the same courses and robots.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.track import TRACKS, find_track
from spidar_gym.console import run_cli
from spidar_gym.control.course.observation import course_layout
from spidar_gym.control.course.target import ACTION
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import COURSE
from spidar_gym.errors import InvalidValueError, require_above, require_least, require_name
from spidar_gym.policies.artifact import Artifact, LearnedPolicy
from spidar_gym.policies.course import RANGES, CoursePolicy
from train.lib.config import parse
from train.lib.envs import Scaling
from train.lib.report import report
from train.lib.run import State, make_artifact
from train.lib.search import SearchConfig
from train.lib.trials import EvaluationConfig, Piece, Task, TrialRecipe, learn_by_trials

ARGUMENTS = {"action_mode": "waypoint"}
"""Arguments of `gym.make`."""
SIZE = sum(piece.size for piece in course_layout(len(ACTION)))
"""Length of an observation."""
LEARNED = (
    "wall_passed", "wall_over", "wall_beneath", "wall_speed", "slot_before", "slot_passed", "slot_height", "slot_speed",
    "slot_aligned", "beam_before", "beam_passed", "above", "speed", "near", "formed",
)  # fmt: skip
"""Parameters of the rule that affect the time; the others determine where it waits and how it chooses the gait."""


class Rule(CoursePolicy):
    """The rule, computed from the observation alone."""

    presets = {COURSE: ARGUMENTS}  # noqa: RUF012 - never modified


@dataclass(frozen=True)
class CostConfig:
    """Cost of a course: its track's error, bounded so that a single failure does not dominate a generation."""

    failure: float = 2.5
    """Total cost of a course that is not finished, and the largest cost of any course."""

    def __post_init__(self) -> None:
        require_above("1", failure=self.failure)

    def __call__(self, metrics: Mapping[str, Any]) -> float:
        """Compute the cost of a course from the benchmark's metrics."""
        return self.failure if metrics["failed"] else min(self.failure, metrics["error"])


@dataclass(frozen=True)
class Args(TrialRecipe):
    """Search for the parameters of the course rule."""

    action_mode = ARGUMENTS["action_mode"]

    learned: tuple[str, ...] = LEARNED
    """Parameters of the rule to learn; the others keep their values."""
    courses: int = 1
    """Number of courses of a trial on each track."""
    cost: CostConfig = field(default_factory=CostConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_least(1, courses=self.courses)
        for name in self.learned:
            require_name("learned", name, RANGES)
        for track in self.tracks:
            if find_track(track).env_id != COURSE:
                raise InvalidValueError("tracks", track, f"tracks of {COURSE}")

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of `gym.make`: the rule has no preset."""
        return dict(ARGUMENTS)


PRESETS: dict[str, Args] = {
    "rule": Args(
        "learned_course",
        "CMA-ES: distances, heights and speeds of `course_rule` by obstacle.",
        tuple(name for name, track in TRACKS.items() if track.env_id == COURSE),
        "course_rule",
        search=SearchConfig(generations=20, population=12, spread=0.3),
        evaluation=EvaluationConfig(scenarios=12, validations=2),
    ),
}
"""Settings by name."""


def artifact(args: Args, numbers: np.ndarray, state: State) -> Artifact:
    """Build the artifact of parameters: a network with a constant output."""
    bias = np.zeros(len(RANGES), np.float32)
    bias[[list(RANGES).index(name) for name in args.learned]] = numbers
    layers = ((np.zeros((len(RANGES), SIZE), np.float32), bias),)
    return make_artifact(
        layers, scaling(), state, name=args.name, kind="learned", doc=args.doc, env_id=COURSE,
        arguments=args.arguments, output="rule",
        training={"seed": args.seed, "steps": state.learner.get("ticks", 0), "chosen_at": state.best_steps},
    )  # fmt: skip


def scaling() -> Scaling:
    """Return the identity scaling; the network's output does not depend on its input."""
    return Scaling(np.zeros(SIZE), np.ones(SIZE))


def go(args: Args, piece: Piece) -> tuple[float, int]:
    """Run a track's courses; return the mean cost and the simulated control ticks."""
    numbers, track, scenarios = piece
    policy = LearnedPolicy(artifact(args, numbers, State()))
    metrics = [each["metrics"] for each in play(policy, track, scenarios, control=args.control)]
    seconds = sum(each["duration_s"] or 0.0 for each in metrics)  # None if the simulation diverged
    return float(np.mean([args.cost(each) for each in metrics])), round(seconds * CONTROL_RATE)


def learn(args: Args) -> Path:
    """Start or resume a run; return the path of its artifact."""
    task = Task(
        COURSE, len(args.learned), args.courses, "courses", Rule(), scaling(), partial(artifact, args),
        partial(go, args),
    )  # fmt: skip
    return learn_by_trials(args, task)


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.course", __doc__)
    report(learn(args), args, COURSE, args.tracks, args.base, workers=args.workers)


if __name__ == "__main__":
    run_cli("train.course", main)
