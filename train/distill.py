"""Learn from a teacher, in minutes: the allocator's knowledge in a network that has no controller and solves no QP.

    python -m train.distill hover --seed 0

A network commands thrusts, vectoring angles and joints, in torso axes; the tuned controller tells at every tick what it
would command in its place, and is imitated on the states that the network brings about (DAgger, Ross et al. 2011). Two
threads share the work: while one flies with the network of the round before, the other learns from all rounds so far.
"""

import copy
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spidar_gym.benchmark.track import HOVER, TRACKS, find_track
from spidar_gym.cli.console import kept, run_cli
from spidar_gym.errors import InvalidValueError, require_above, require_least
from spidar_gym.policies import torso
from spidar_gym.policies.artifact import Artifact
from spidar_gym.processes import Pool, cpu_count
from spidar_gym.robot import N_LEGS, N_ROTORS
from train.lib.config import TrackRecipe, parse
from train.lib.envs import ERRORS, Scaling, scaling_of, training_seed
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.report import report
from train.lib.run import Run, State, command_line, curve_line, require_frameworks
from train.lib.stages import Stages, scalars

if TYPE_CHECKING:
    import torch
    from torch.utils.tensorboard import SummaryWriter

    from train.lib.taught import Lessons, TaughtFlights

FORCE, NET_FORCE, NET_TORQUE = 2.0, 0.5, 0.1
"""Errors that count the same: of a rotor's force [N], the total force [N] and torque [Nm].

The joints go to their form by themselves: learned, changes of 5 mrad in a tick never became exact enough to reach it.
"""
OPPONENT = "paper"
"""Preset that the curves compare with; the row `qp`."""


@dataclass(frozen=True)
class StudyConfig:
    """The network, and how it learns."""

    hidden: int = 64
    """Width of the two hidden layers."""
    lr: float = 2e-3
    """Learning rate at the beginning; it falls to a fiftieth along a cosine."""
    batch: int = 1024
    """Lessons in a step of the optimiser."""
    first_updates: int = 1500
    """Steps of the optimiser on what the controller alone has flown."""
    updates: int = 120
    """Steps of the optimiser a round."""
    room: int = 1_000_000
    """Lessons that are kept; the oldest make room."""
    average: int = 500
    """Steps over which the weights are averaged."""
    symmetric: bool = True
    """Turned by 90° the robot is the same again, so the network is, too."""

    def __post_init__(self) -> None:
        require_least(1, hidden=self.hidden, batch=self.batch, updates=self.updates, room=self.room)
        require_least(1, first_updates=self.first_updates, average=self.average)
        require_above("1", lr=self.lr)
        if self.symmetric and self.hidden % N_LEGS:
            raise InvalidValueError("hidden", self.hidden, f"a multiple of {N_LEGS}: each leg has as many units")


@dataclass(frozen=True)
class Args(TrackRecipe):
    """Learn from a teacher."""

    action_mode = "direct"

    trace_times: tuple[float, ...] = (0.2, 1.0, 5.0, 30.0)
    """Time constants of the traces of the errors that the network sees [s]; none: a network without a memory."""
    robots: int = 8
    """Robots on each track."""
    first_ticks: int = 500
    """Ticks that the controller flies alone."""
    rounds: int = 100
    """How often it flies and learns."""
    ticks: int = 150
    """Ticks of every robot a round."""
    validations: int = 5
    """How often it is evaluated."""
    scenarios: int = 6
    """Validation scenarios of each track."""
    workers: int = cpu_count()
    """Processes that evaluate."""
    study: StudyConfig = field(default_factory=StudyConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        least = ("robots", "first_ticks", "rounds", "ticks", "validations", "scenarios", "workers")
        require_least(1, **{name: getattr(self, name) for name in least})
        for track in self.tracks:
            if find_track(track).env_id != HOVER:
                expected = "flights of Hover-v0: no controller of the ground gives advice, and a path is seen otherwise"
                raise InvalidValueError("tracks", track, expected)


PRESETS: dict[str, Args] = {
    "hover": Args(
        "distilled",
        "DAgger: a network that commands what `tuned` would, in torso axes; no controller, no QP.",
        tuple(name for name, track in TRACKS.items() if track.env_id == HOVER),
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


class Shelf:
    """Lessons that are kept, the oldest overwritten."""

    def __init__(self, room: int, first: "Lessons") -> None:
        """Make room, and put the first ones there."""
        self._columns = [np.zeros((room, *column.shape[1:]), np.float32) for column in _columns(first)]
        self._next, self.count = 0, 0
        self.add(first)

    def add(self, lessons: "Lessons") -> None:
        """Put more there."""
        room, rows = len(self._columns[0]), len(lessons.weights)
        ids = (self._next + np.arange(rows)) % room
        for column, new in zip(self._columns, _columns(lessons), strict=True):
            column[ids] = new
        self._next, self.count = int((self._next + rows) % room), min(room, self.count + rows)

    def draw(self, rng: np.random.Generator, count: int) -> list["torch.Tensor"]:
        """Some of them: inputs, answers, levers, weights."""
        import torch

        ids = rng.integers(0, self.count, count)
        return [torch.from_numpy(column[ids]) for column in self._columns]


def _columns(lessons: "Lessons") -> tuple[np.ndarray, ...]:
    return lessons.inputs, lessons.answers, lessons.levers, lessons.weights


def loss_of(said: "torch.Tensor", answers: "torch.Tensor", levers: "torch.Tensor", weights: "torch.Tensor") -> Any:  # noqa: ANN401 - torch's
    """What a network is taught by: errors of forces and of the total wrench, each in its unit.

    The wrench counts by itself, since a robot feels nothing else: errors of the forces that cancel each other cost
    thrust, those that add up move it. Far off it grows linearly, so that rare large errors do not outweigh all others.
    """
    import torch

    forces = torso.FORCE * (said - answers)[:, : 3 * N_ROTORS].reshape(levers.shape)
    torque = torch.cross(levers, forces, dim=-1).sum(1)
    total = (
        (forces**2).sum((1, 2)) / FORCE**2
        + (forces.sum(1) ** 2).sum(1) / NET_FORCE**2
        + (torque**2).sum(1) / NET_TORQUE**2
    )
    return (weights * (torch.sqrt(1.0 + total / 4.0) - 1.0)).mean()


class Student:
    """The network, its optimisers, and the average of its weights, with which it flies."""

    def __init__(self, config: StudyConfig, scaling: Scaling, answers: np.ndarray, updates: int) -> None:
        """Begin at the mean answer.

        Args:
            config: Network and optimiser.
            scaling: Of the inputs.
            answers: What the teacher said at first, (rows, 40).
            updates: Steps of the optimiser in all.
        """
        import torch
        from torch import nn

        from train.lib.symmetry import tie, tie_layers

        self._config, self._updates, self.done = config, updates, 0
        turn = torso.shown_turn(len(scaling.mean) - torso.FEATURES)
        self.scaling = scaling.alike(turn) if config.symmetric else scaling
        self._mean = torch.tensor(self.scaling.mean, dtype=torch.float32)
        self._deviation = torch.tensor(np.sqrt(self.scaling.variance), dtype=torch.float32)
        sizes = (len(scaling.mean), config.hidden, config.hidden, answers.shape[1])
        self.network: Any = nn.ModuleList([nn.Linear(n, m) for n, m in pairwise(sizes)])
        self.network.append(nn.Linear(sizes[0], sizes[-1], bias=False))
        *hidden, last, skip = self.network
        assert isinstance(last, nn.Linear)
        assert isinstance(skip, nn.Linear)
        with torch.no_grad():
            skip.weight.zero_()
            nn.init.normal_(last.weight, std=0.01)
            last.weight[3 * N_ROTORS :] = 0.0  # and nothing teaches them else
            last.bias.copy_(torch.from_numpy(answers.mean(axis=0)))
        if config.symmetric:
            tie_layers([*hidden, last], turn, torso.SAID_TURN)
            tie(skip.weight, torso.SAID_TURN, turn)
        matrices = [layer.weight for layer in (*hidden, last)]
        rest = [p for p in self.network.parameters() if all(p is not m for m in matrices)]
        # Steps of equal size in all directions of a matrix (Jordan et al. 2024): rare directions are learned, too.
        self._optimizers = [
            torch.optim.Muon(matrices, lr=config.lr, weight_decay=0.0, adjust_lr_fn="match_rms_adamw"),
            torch.optim.Adam(rest, lr=config.lr),
        ]
        self.average: Any = copy.deepcopy(self.network)

    def _say(self, layers: Any, inputs: "torch.Tensor") -> "torch.Tensor":  # noqa: ANN401 - torch's
        import torch

        x = ((inputs - self._mean) / self._deviation).clamp(-self.scaling.clip, self.scaling.clip)
        first, second, last, skip = layers
        return last(torch.relu(second(torch.relu(first(x))))) + skip(x)

    def learn(self, lessons: list["torch.Tensor"]) -> float:
        """A step of the optimiser; the loss before it."""
        import torch

        config = self._config
        lr = config.lr * max(0.02, 0.5 * (1.0 + np.cos(np.pi * self.done / self._updates)))
        inputs, answers, levers, weights = lessons
        loss = loss_of(self._say(self.network, inputs), answers, levers, weights)
        for optimizer in self._optimizers:
            for group in optimizer.param_groups:
                group["lr"] = lr
            optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        for optimizer in self._optimizers:
            optimizer.step()
        self.done += 1
        with torch.no_grad():
            share = 1.0 / min(self.done, config.average)
            for mean, now in zip(self.average.parameters(), self.network.parameters(), strict=True):
                mean.lerp_(now, share)
        return loss.item()

    def frozen(self) -> Callable[[np.ndarray], np.ndarray]:
        """The averaged network as it is now: inputs → what it says."""
        import torch

        layers = copy.deepcopy(self.average)

        def say(inputs: np.ndarray) -> np.ndarray:
            with torch.no_grad():
                return self._say(layers, torch.from_numpy(inputs)).numpy()

        return say

    def artifact(self, args: Args, state: State) -> Artifact:
        """The averaged network as the benchmark's artifact."""
        *layers, skip = [{k: v.numpy().copy() for k, v in layer.state_dict().items()} for layer in self.average]
        curve = [[entry["steps"], round(entry["score"], 5)] for entry in state.curve]
        traced = torso.entries(*ERRORS) if args.trace_times else np.zeros(0)
        return Artifact(
            args.name, "learned", args.doc, HOVER, args.arguments,
            tuple(layer["weight"] for layer in layers), tuple(layer["bias"] for layer in layers),
            self.scaling.mean, self.scaling.variance, self.scaling.clip, "relu", "torso",
            traced=traced.astype(float), trace_times=np.array(args.trace_times, float), skip=skip["weight"],
            training={
                "command": command_line(), "seed": args.seed, "steps": state.best_steps, "curve": curve,
            },
        )  # fmt: skip


def learn(args: Args) -> Path:
    """One run; the path of its artifact."""
    require_frameworks()
    import torch
    from torch.utils.tensorboard import SummaryWriter

    from train.lib.taught import TaughtFlights

    torch.manual_seed(training_seed(args.seed, 3))
    run, state = Run.of(args, HOVER, args.arguments), State()
    flights = TaughtFlights(args.tracks, args.base, args.robots, training_seed(args.seed, 2), args.trace_times)
    with (
        kept(lambda: f"the curve of {len(state.curve)} validations kept in {run.folder}; it begins anew"),
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
    """Fly, learn and evaluate; the path of the artifact."""
    began, study = time.perf_counter(), args.study
    draw, disturb = (np.random.Generator(np.random.PCG64(training_seed(args.seed, k))) for k in (4, 5))
    stages.begin("playing the opponent", len(args.tracks) * args.scenarios, "scenario", "validation")
    evaluator = PairedEvaluator(
        args.tracks, Base({"preset": OPPONENT}), args.scenarios, control=args.control, on_scenario=stages.count,
        each=pool.map,
    )  # fmt: skip
    state.base = evaluator.means

    total = study.first_updates + args.rounds * study.updates
    stages.begin("the teacher flies", total, "update", "flights")
    first = flights.fly(None, args.first_ticks, disturb)
    shelf = Shelf(study.room, first)
    student = Student(study, _scaling(first), first.answers, total)

    def learn_once() -> None:
        board.add_scalar("train/loss", student.learn(shelf.draw(draw, study.batch)), student.done)
        stages.count()

    stages.say("learning from the teacher's flights", "learner")
    for _ in range(study.first_updates):
        learn_once()
    due = np.linspace(0, args.rounds, args.validations + 1)[1:].round().astype(int).tolist()
    artifact = student.artifact(args, state)
    with ThreadPoolExecutor(1) as beside:
        for k in range(1, args.rounds + 1):
            words = f"round {k} of {args.rounds}, {np.mean(flights.led):.0%} led by the teacher"
            stages.say(words, "learner")
            flown = beside.submit(flights.fly, student.frozen(), args.ticks, disturb)
            for _ in range(study.updates):
                learn_once()
            stages.say(words, "flights")  # those that the learner waits for
            shelf.add(flown.result())
            if k in due:
                steps = flights.ticks
                stages.say(words, "validation")
                verdict = evaluator.evaluate(student.artifact(args, state))
                stages.evaluated(verdict)
                state.seconds, state.segment, state.best_steps = time.perf_counter() - began, k, steps
                state.curve.append(curve_line(steps, state.seconds, verdict))
                state.best_score = verdict.score
                artifact = student.artifact(args, state)
                run.write_curve(state)
                run.publish(artifact)
                for name, value in scalars(state.curve[-1]):
                    board.add_scalar(name, value, steps)
    return run.publish(artifact)


def _scaling(lessons: "Lessons") -> Scaling:
    """How inputs enter the network, by what the teacher's flights showed."""
    bound = np.maximum(np.abs(lessons.inputs).max(axis=0), 1.0)
    return scaling_of(lessons.inputs, bound)


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.distill", __doc__)
    report(learn(args), args, HOVER, args.tracks, OPPONENT, workers=args.workers)


if __name__ == "__main__":
    run_cli("train.distill", main)
