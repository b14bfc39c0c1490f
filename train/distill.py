"""Imitate a controller, in minutes: a network that flies without a controller and without solving a QP.

    python -m train.distill hover --seed 0

The network commands thrusts, vectoring angles and joints, in torso axes. At every tick the tuned controller computes
the command that it would send. The network learns to imitate this command in the states that the network itself reaches
(DAgger, Ross et al. 2011). Two threads share the work: one flies with the network of the previous round, the other
learns from all previous rounds.
"""

import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spidar_gym.benchmark.track import HOVER, TRACKS, find_track
from spidar_gym.console import kept, run_cli
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.files import output_folder
from spidar_gym.policies import torso
from spidar_gym.policies.artifact import Artifact
from spidar_gym.processes import Pool, cpu_count
from train.lib.config import TrackRecipe, parse
from train.lib.envs import ERRORS, Scaling, generator_words, set_generator, training_seed
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.report import report
from train.lib.run import Run, State, command_line, curve_line, require_frameworks
from train.lib.stages import Stages, scalars
from train.lib.student import Shelf, Student, StudyConfig, scaling_for

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

    from train.lib.taught import Lessons, TaughtFlights

OPPONENT = "paper"
"""Preset that the learning curves compare with; row `qp` of the leaderboard."""


@dataclass(frozen=True)
class Args(TrackRecipe):
    """Train a network by imitating a controller."""

    action_mode = "direct"

    trace_times: tuple[float, ...] = (0.2, 1.0, 5.0, 30.0)
    """Time constants of the low-passes (traces) of the errors that the network receives [s]; none: no memory."""
    robots: int = 8
    """Number of robots on each track."""
    first_ticks: int = 500
    """Control ticks per robot that the controller flies before the first round."""
    rounds: int = 100
    """Number of rounds of flying and learning."""
    ticks: int = 150
    """Control ticks per robot and round."""
    validations: int = 5
    """Number of validations, evenly spaced over the rounds."""
    scenarios: int = 6
    """Number of validation scenarios of each track."""
    workers: int = cpu_count()
    """Number of processes that evaluate."""
    study: StudyConfig = field(default_factory=StudyConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        least = ("robots", "first_ticks", "rounds", "ticks", "validations", "scenarios", "workers")
        require_least(1, **{name: getattr(self, name) for name in least})
        for track in self.tracks:
            if find_track(track).env_id != HOVER:
                expected = "flights of Hover-v0: crawlers compute no advice, and paths have another observation"
                raise InvalidValueError("tracks", track, expected)

    @property
    def updates(self) -> int:
        """Total number of optimiser steps."""
        return self.study.first_updates + self.rounds * self.study.updates


PRESETS: dict[str, Args] = {
    "hover": Args(
        "distilled",
        "DAgger: a network that commands what `tuned` would, in torso axes; no controller, no QP.",
        tuple(name for name, track in TRACKS.items() if track.group == "flight"),
        "tuned",
    ),
    "first": Args(
        "first",
        "A first agent: a network that flies through forms, without a controller, after some minutes.",
        ("flight-forms", "flight-fast3"),
        "tuned",
        robots=12,
        first_ticks=300,
        rounds=60,
        validations=3,
        scenarios=4,
        study=StudyConfig(first_updates=1000, updates=100),
    ),
}
"""Settings by name."""


def artifact(args: Args, student: Student, state: State) -> Artifact:
    """Build the artifact of the averaged network."""
    *layers, skip = [{k: v.numpy().copy() for k, v in layer.state_dict().items()} for layer in student.average]
    curve = [[entry["steps"], round(entry["score"], 5)] for entry in state.curve]
    traced = torso.entries(*ERRORS) if args.trace_times else np.zeros(0)
    return Artifact(
        args.name, "learned", args.doc, HOVER, args.arguments,
        tuple(layer["weight"] for layer in layers), tuple(layer["bias"] for layer in layers),
        student.scaling.mean, student.scaling.variance, student.scaling.clip, "relu", "torso",
        traced=traced.astype(float), trace_times=np.array(args.trace_times, float), skip=skip["weight"],
        training={
            "command": command_line(), "seed": args.seed, "steps": state.best_steps, "curve": curve,
        },
    )  # fmt: skip


def learn(args: Args) -> Path:
    """Start a run or resume it at the interrupted round; return the path of its artifact."""
    require_frameworks()
    import torch
    from torch.utils.tensorboard import SummaryWriter

    from train.lib.taught import TaughtFlights

    torch.manual_seed(training_seed(args.seed, 3))
    run = Run.of(args, HOVER, args.arguments)
    state = run.load() or State()
    flights = TaughtFlights(args.tracks, args.base, args.robots, training_seed(args.seed, 2), args.trace_times)
    with (
        kept(lambda: f"{state.segment} of {args.rounds} rounds kept in {run.folder}; the same command resumes"),
        Pool(args.workers) as pool,
        Stages(f"{args.name} seed {args.seed}", state.parts) as stages,
        SummaryWriter(str(run.folder / "tensorboard")) as board,
    ):
        try:
            return _learn(args, run, state, flights, pool, stages, board)
        finally:
            flights.close()


def _learn(
    args: Args, run: Run, state: State, flights: "TaughtFlights", pool: Pool, stages: Stages, board: "SummaryWriter"
) -> Path:
    """Fly, learn and evaluate, round by round; return the path of the artifact."""
    began = time.perf_counter() - state.seconds
    stages.begin("evaluating the paper's controller", len(args.tracks) * args.scenarios, "scenario", "validation")
    evaluator = PairedEvaluator(
        args.tracks, Base({"preset": OPPONENT}), args.scenarios, control=args.control, on_scenario=stages.count,
        each=pool.map,
    )  # fmt: skip
    state.base = evaluator.means
    done = args.study.first_updates + state.segment * args.study.updates if state.learner else 0
    stages.begin("the teacher flies", args.updates, "update", "flights", done)
    lessons = Taught(args, run, state, flights)

    def learn_once() -> None:
        board.add_scalar("train/loss", lessons.learn_once(), lessons.student.done)
        stages.count()

    def keep() -> None:
        state.seconds = time.perf_counter() - began
        lessons.keep()

    if not state.learner:
        stages.say("learning from the teacher's flights", "learner")
        for _ in range(args.study.first_updates):
            learn_once()
        keep()
    due = np.linspace(0, args.rounds, args.validations + 1)[1:].round().astype(int).tolist()
    with ThreadPoolExecutor(1) as beside:
        for k in range(state.segment + 1, args.rounds + 1):
            words = f"round {k} of {args.rounds}, {np.mean(flights.led):.0%} led by the teacher"
            stages.say(words, "learner")
            flown = beside.submit(flights.fly, lessons.student.frozen(), args.ticks, lessons.disturb)
            for _ in range(args.study.updates):
                learn_once()
            stages.say(words, "flights")  # the learner waits for the flights
            lessons.add(k, flown.result())
            if k in due:
                steps = flights.ticks
                stages.say(words, "validation")
                verdict = evaluator.evaluate(artifact(args, lessons.student, state))
                stages.evaluated(verdict)
                state.best_steps, state.best_score = steps, verdict.score
                state.curve.append(curve_line(steps, time.perf_counter() - began, verdict))
                run.publish(artifact(args, lessons.student, state))
                for name, value in scalars(state.curve[-1]):
                    board.add_scalar(name, value, steps)
            state.segment = k
            keep()
    path = run.publish(artifact(args, lessons.student, state))
    lessons.clear()
    return path


class Taught:
    """Student, flights and lessons: the complete state between rounds, with its checkpoints."""

    def __init__(self, args: Args, run: Run, state: State, flights: "TaughtFlights") -> None:
        """Start with flights of the teacher, or resume from the state of a run."""
        self._args, self._run, self._state, self._flights = args, run, state, flights
        self._folder = output_folder(run.folder / "lessons")
        self._draw, self.disturb = (np.random.Generator(np.random.PCG64(training_seed(args.seed, k))) for k in (4, 5))
        if state.learner:
            self._resume()
            return
        first = flights.fly(None, args.first_ticks, self.disturb)
        first.write(self._file(0))
        scaling = scaling_for(args.study, first)
        state.scaling = vars(scaling)
        self.student = Student(args.study, scaling, first.answers.mean(axis=0), args.updates)
        self._shelf = Shelf(args.study.room, first)

    def _file(self, k: int) -> Path:
        """Return the file with the lessons of a round, kept until the run is done; round 0 is the teacher's flights."""
        return self._folder / f"{k:04d}.npz"

    def _resume(self) -> None:
        from train.lib.taught import Lessons

        args, run, state, flights = self._args, self._run, self._state, self._flights
        size = torso.FEATURES + len(torso.entries(*ERRORS)) * len(args.trace_times)
        run.require_alike(state.scaling, vars(Scaling(np.zeros(size), np.ones(size))))
        self.student = Student(args.study, Scaling(**state.scaling), np.zeros(torso.ACTION, np.float32), args.updates)
        run.require_alike(state.learner, self._all())
        parts = {
            head: {name.removeprefix(head): value for name, value in state.learner.items() if name.startswith(head)}
            for head in ("student/", "flights/")
        }
        self.student.restore(parts["student/"])
        flights.restore(parts["flights/"])
        for generator, name in ((self._draw, "draw"), (self.disturb, "disturb")):
            set_generator(generator, state.learner[name])
        if state.segment < args.rounds:  # the lessons of a completed run have been removed
            self._shelf = Shelf(args.study.room, Lessons.read(self._file(0), size, flights.count * args.first_ticks))
            for k in range(1, state.segment + 1):
                self._shelf.add(Lessons.read(self._file(k), size, flights.count * args.ticks))

    def _all(self) -> dict[str, Any]:
        parts = {"student": self.student.save(), "flights": self._flights.save()}
        found = {f"{part}/{name}": value for part, own in parts.items() for name, value in own.items()}
        return found | {"draw": generator_words(self._draw), "disturb": generator_words(self.disturb)}

    def learn_once(self) -> float:
        """Take an optimiser step; return the loss before it."""
        return self.student.learn(self._shelf.draw(self._draw, self._args.study.batch))

    def add(self, k: int, lessons: "Lessons") -> None:
        """Write the lessons of a round and add them to the buffer."""
        lessons.write(self._file(k))
        self._shelf.add(lessons)

    def keep(self) -> None:
        """Write the checkpoint."""
        self._state.learner = self._all()
        self._run.save(self._state)

    def clear(self) -> None:
        """Remove the lesson files of a completed run, which take hundreds of megabytes."""
        shutil.rmtree(self._folder, ignore_errors=True)


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.distill", __doc__)
    report(learn(args), args, HOVER, args.tracks, OPPONENT, workers=args.workers)


if __name__ == "__main__":
    run_cli("train.distill", main)
