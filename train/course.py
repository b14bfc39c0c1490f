"""Learn the numbers of the rule on courses: distances, heights, speeds by obstacle, judged against the rule.

    python -m train.course rule --seed 0

The policy sees what every policy on a course sees, and says twice a second where to go; with numbers of 0 it is
`course_rule` bit for bit. Whether a robot gets through shows minutes after what decided it: so as with the gait
(`train/gait.py`), an episode is one sample, and all trials of a generation go the very same courses with the very same
robots.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.track import TRACKS, find_track
from spidar_gym.cli.console import run_cli
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
"""What of the rule's numbers costs time: the others only say where it waits, or between which gaits it chooses."""


class Rule(CoursePolicy):
    """The rule, as a policy from what it sees."""

    presets = {COURSE: ARGUMENTS}  # noqa: RUF012 - nobody writes it


@dataclass(frozen=True)
class CostConfig:
    """What a course costs: its track's error, but no mishap outweighs all else that a generation tells."""

    failure: float = 2.5
    """Cost of a course that is not finished, all in all."""

    def __post_init__(self) -> None:
        require_above("1", failure=self.failure)

    def __call__(self, metrics: Mapping[str, Any]) -> float:
        """Cost of a course with the benchmark's metrics."""
        return self.failure if metrics["failed"] else min(self.failure, metrics["error"])


@dataclass(frozen=True)
class Args(TrialRecipe):
    """Learn the numbers of the rule on courses."""

    action_mode = ARGUMENTS["action_mode"]

    learned: tuple[str, ...] = LEARNED
    """Which of the rule's numbers are learned; the others stay as they are."""
    courses: int = 1
    """Courses of a trial on each track."""
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
    """The numbers as the benchmark's artifact: a network that says the same whatever it sees."""
    bias = np.zeros(len(RANGES), np.float32)
    bias[[list(RANGES).index(name) for name in args.learned]] = numbers
    layers = ((np.zeros((len(RANGES), SIZE), np.float32), bias),)
    return make_artifact(
        layers, scaling(), state, name=args.name, kind="learned", doc=args.doc, env_id=COURSE,
        arguments=args.arguments, output="rule",
        training={"seed": args.seed, "steps": state.learner.get("ticks", 0), "chosen_at": state.best_steps},
    )  # fmt: skip


def scaling() -> Scaling:
    """What is seen enters as it is: nothing of it is weighed."""
    return Scaling(np.zeros(SIZE), np.ones(SIZE))


def go(args: Args, piece: Piece) -> tuple[float, int]:
    """Cost of numbers on a track's courses, mean, and the ticks that it took."""
    numbers, track, scenarios = piece
    policy = LearnedPolicy(artifact(args, numbers, State()))
    metrics = [each["metrics"] for each in play(policy, track, scenarios, control=args.control)]
    seconds = sum(each["duration_s"] or 0.0 for each in metrics)  # None where it diverged
    return float(np.mean([args.cost(each) for each in metrics])), round(seconds * CONTROL_RATE)


def learn(args: Args) -> Path:
    """One run, from its beginning or from where it was interrupted; the path of its artifact."""
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
