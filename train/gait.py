"""Learn the gait's parameters by phase: random search in pairs, judged against the crawler that they are added to.

    python -m train.gait crawl --seed 0

What is learned are 16 numbers: vertical force at the feet in every phase that moves, raise angle and lift height, once
for the cycles on the way and once for the last one, which decides where the robot ends. (Phase rate and stride are
best as they are.) An episode's cost is known at its end alone; so the numbers are changed together, up and down one
direction on the very same robot, floor and way, and moved along the directions by the differences of the costs
(augmented random search, Mania 2018).
"""

import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from tqdm import tqdm

from spidar_gym.benchmark.artifact import Artifact
from spidar_gym.benchmark.row import cores
from spidar_gym.benchmark.track import CRAWL, find_track
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.core import core_path
from spidar_gym.control.crawl_observation import crawl_layout
from spidar_gym.control.phases import PHASES
from spidar_gym.envs.actions import CRAWL_MODES, GAIT, find_action_mode
from spidar_gym.envs.crawl_task import SUCCESS_POSITION
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.terminal import speak_plainly
from train import presets
from train.kinds import Goal, Scaling, make_training_env, training_seed
from train.learner import Layers
from train.referee import Base, Referee
from train.report import evaluate_row
from train.run import Run, State, curve_line, make_artifact

MODE = find_action_mode("residual_gait_force", CRAWL_MODES)
"""What the numbers do."""
MOVING = tuple(PHASES.index(name) for name in ("raise", "swing", "lower", "up", "forward", "down"))
"""Phases that have a force of their own; the others are over at once."""
CYCLES = 2
"""The last cycle, and those before it."""
SIZE = CYCLES * (len(MOVING) + 2)
"""How many numbers: forces, raise angle and lift height of the last cycle, then of the others."""


@dataclass(frozen=True)
class Args:
    """Learn the gait's parameters by phase."""

    name: str
    """Of the row: letters, digits, _ and -."""
    doc: str
    """What it is, in one line."""
    tracks: tuple[str, ...]
    """Tracks in whose kinds of crawls it learns, and on whose validation scenarios it is judged."""
    base: str
    """Preset of the crawler that it adds to."""
    seed: int = 0
    """Of everything that is drawn."""
    steps: int = 500_000
    """Control ticks to learn from."""
    directions: int = 4
    """Directions between two updates, each with two crawls."""
    spread: float = 0.3
    """Standard deviation of a number's change along a direction."""
    rate: float = 0.04
    """How far an update moves a number, root mean square, at the beginning; it falls to 0 evenly."""
    momentum: float = 0.7
    """Share of the last update's direction that the next one keeps."""
    energy: float = 0.025
    """Cost of 1 Wh/m; the benchmark's error has the same."""
    hurry: float = 0.5
    """Cost of a crawl that takes the nominal time."""
    goal: float = 0.5
    """Cost of an error at the goal at the most; 10 mm are half of it, a radian counts 0.5 m."""
    failure: float = 0.6
    """Cost of what is no success, for whatever reason."""
    scenarios: int = 16
    """Validation scenarios of each track."""
    validations: int = 8
    """How often it is judged."""
    control: str = "core" if core_path().is_file() else "python"
    """python, or core: the compiled controller, several times faster; core where `spidar export --build` made it."""
    out: Path = Path("out/train")
    """Folder for runs: NAME/seedK."""
    row: bool = True
    """Evaluate on the test scenarios in the end and write a row of this seed."""

    def __post_init__(self) -> None:
        """Refuse what cannot be learned."""
        least = ("steps", "directions", "scenarios", "validations")
        require_least(1, **{name: getattr(self, name) for name in least})
        require_least(0, seed=self.seed)
        for track in self.tracks:
            if find_track(track).flies:
                raise InvalidValueError("tracks", track, "crawls: a flight has no gait")

    @property
    def arguments(self) -> dict[str, Any]:
        """Of `gym.make`."""
        return {"action_mode": "residual_gait_force", "preset": self.base}


def scaling() -> Scaling:
    """What enters the network: phases as they are, and −1 in the last cycle, 1 before it."""
    pieces = crawl_layout(MODE.size)
    mean = np.concatenate([np.full(p.size, 1.5 if p.name == "steps_left" else 0.0) for p in pieces])
    variance = np.concatenate([np.full(p.size, 1e-6 if p.name == "steps_left" else 1.0) for p in pieces])
    return Scaling(mean, variance, 1.0)


def table(numbers: np.ndarray) -> np.ndarray:
    """Raise, lift and force in every phase of the last cycle, then of the others, shape (2 phases, 3)."""
    whole = np.zeros((CYCLES, len(PHASES), 3))
    for rows, own in zip(whole, numbers.reshape(CYCLES, -1), strict=True):
        rows[MOVING, 2] = own[: len(MOVING)]
        # What counts is the tick in which a leg begins to rise, or the torso.
        rows[:, :2] = own[len(MOVING) :]
    return whole.reshape(-1, 3)


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
    columns = table(numbers).T
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
        self._envs = [
            make_training_env(track, args.arguments, Goal(), washout=np.zeros(0), control=args.control).env
            for track in args.tracks
        ]

    def cost(self, numbers: np.ndarray, number: int, seed: int) -> tuple[float, int]:
        """Cost of a crawl, and its ticks; the kinds take turns."""
        args, env = self._args, self._envs[number % len(self._envs)]
        inner: Any = env.unwrapped
        agent = artifact(args, numbers, State())
        observation, info = env.reset(seed=seed)
        ticks, terminated, truncated = 0, False, False
        while not (terminated or truncated or info["finished"]):
            observation, _, terminated, truncated, info = env.step(agent.act(observation))
            ticks += 1
        progress = inner.progress
        # Bounded: the few large errors at the goal would decide everything.
        miss = (progress.rest / SUCCESS_POSITION) ** 2
        cost = (
            args.energy * info["energy_wh"] / progress.whole + args.hurry * ticks / CONTROL_RATE / progress.nominal_time
        )
        return cost + args.goal * miss / (1.0 + miss) + args.failure * (not info["is_success"]), ticks

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            env.close()


def update(
    args: Args, course: Course, numbers: np.ndarray, way: np.ndarray, number: int, done: float,
    on_ticks: Callable[[int], object],
) -> tuple[np.ndarray, np.ndarray, int]:  # fmt: skip
    """The numbers after one update, its direction, and the ticks it took.

    Args:
        args: Settings.
        course: Where it crawls.
        numbers: Before.
        way: Direction of the last update.
        number: Of the update; everything drawn in it depends on it and on the run's seed.
        done: Share of the run that is done.
        on_ticks: Called with the ticks of each crawl.
    """
    rng = np.random.Generator(np.random.PCG64(training_seed(args.seed, 5, number)))
    directions, whole = rng.standard_normal((args.directions, SIZE)), 0
    way = args.momentum * way
    for k, direction in enumerate(directions):
        seed, costs = training_seed(args.seed, 6, number, k), []
        for sign in (1.0, -1.0):
            tried = np.clip(numbers + sign * args.spread * direction, -1.0, 1.0)
            cost, ticks = course.cost(tried, number * args.directions + k, seed)
            costs.append(cost)
            whole += ticks
            on_ticks(ticks)
        way = way - (costs[0] - costs[1]) * direction
    size = float(np.sqrt(np.mean(way**2)))
    moved = numbers + args.rate * (1.0 - done) * way / size if size > 0.0 else numbers
    return np.clip(moved, -1.0, 1.0), way, whole


def learn(args: Args) -> Path:
    """One run, from its beginning or from where it was interrupted; the path of its artifact."""
    torch.set_num_threads(1)
    settings = {k: v for k, v in asdict(args).items() if k not in ("out", "row")}
    run = Run(args.out / args.name / f"seed{args.seed}", settings, CRAWL, args.arguments)
    state = run.load() or State()
    bar = tqdm(total=args.steps, unit="tick", unit_scale=True, file=sys.__stderr__)
    bar.set_description(f"{args.name} seed {args.seed}")
    bar.set_postfix_str("playing the base")
    referee = Referee(args.tracks, Base(args.arguments), args.scenarios, control=args.control)
    state.base, state.scaling = referee.means, vars(scaling())
    learner = dict(state.learner) or {"numbers": zeros(), "way": zeros(), "best": zeros(), "ticks": 0, "updates": 0}
    if not state.learner:
        referee.require_equal(artifact(args, learner["numbers"], state))
    bar.update(learner["ticks"])
    course = Course(args)
    while learner["ticks"] < args.steps:
        began = time.perf_counter()
        learner["numbers"], learner["way"], ticks = update(
            args,
            course,
            learner["numbers"],
            learner["way"],
            learner["updates"],
            learner["ticks"] / args.steps,
            bar.update,
        )
        learner["ticks"], learner["updates"] = learner["ticks"] + ticks, learner["updates"] + 1
        state.learner = dict(learner)
        verdict = None
        if learner["ticks"] >= args.steps * (state.segment + 1) / args.validations:
            verdict = referee.judge(artifact(args, learner["numbers"], state))
            if verdict.admissible and verdict.score < state.best_score:
                learner["best"], state.best_score, state.best_steps = (
                    learner["numbers"],
                    verdict.score,
                    learner["ticks"],
                )
            state.learner, state.segment = dict(learner), state.segment + 1
            bar.set_postfix_str(f"against the base {verdict.score:+.1%}, worst {verdict.worst:+.1%}")
        state.seconds += time.perf_counter() - began
        if verdict is not None:
            state.curve.append(curve_line(learner["ticks"], state.seconds, verdict))
        run.save(state)
    if not state.best_steps:
        # All of it made something worse at every validation; perhaps less of it does not.
        verdict, share = referee.strongest(lambda share: artifact(args, share * learner["numbers"], state))
        if verdict.admissible and verdict.score < 0.0:
            learner["best"], state.best_score, state.best_steps = (
                share * learner["numbers"],
                verdict.score,
                learner["ticks"],
            )
    bar.close()
    course.close()
    run.write_curve(state)
    return run.publish(artifact(args, learner["best"], state))


def zeros() -> np.ndarray:
    """The gait as it is."""
    return np.zeros(SIZE)


def main() -> None:
    """Entry point."""
    options = {name: (str(values["doc"]), Args(**values)) for name, values in presets.GAIT.items()}
    args = tyro.extras.overridable_config_cli(options, description=__doc__, prog="python -m train.gait")
    path = learn(args)
    print(f"{path}: {args.name}, seed {args.seed}")
    if args.row:
        print(evaluate_row(path, args.tracks, args.out / "scores", args.base, workers=cores()))


if __name__ == "__main__":
    speak_plainly("train.gait", main)
