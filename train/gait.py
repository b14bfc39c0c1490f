"""Learn the gait's parameters by phase: random search in pairs, judged against the crawler that they are added to.

    python -m train.gait crawl --seed 0

What is learned is a table: phase rate, raise angle, lift height and the vertical force at the feet, for every phase of
a cycle, once for the cycles on the way and once for the last one, which decides where the robot ends. An episode's
cost is known at its end alone; so the table is changed as a whole, up and down one direction on the very same robot,
floor and way, and moved along the directions by the differences of the costs (augmented random search, Mania 2018).
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
from spidar_gym.benchmark.track import CRAWL, find_track, ground_error
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.core import core_path
from spidar_gym.control.crawl_observation import crawl_layout
from spidar_gym.control.phases import PHASES
from spidar_gym.envs.actions import CRAWL_MODES, GAIT, find_action_mode
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.terminal import speak_plainly
from train import presets
from train.kinds import Goal, Scaling, make_training_env, training_seed
from train.learner import Layers
from train.referee import Base, Referee
from train.report import evaluate_row
from train.run import Run, State, curve_line, make_artifact

MODE = find_action_mode("residual_gait_force", CRAWL_MODES)
"""What the table's entries do."""
CHANNELS = ("rate", "raise", "lift", "force")
"""Columns of the table: entries 0, 1 and 3 of the gait's action, and the vertical force of every leg."""
CONTEXTS = 2 * len(PHASES)
"""Rows of the table: every phase in the last cycle, then every phase in the cycles before it."""


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
    directions: int = 8
    """Directions between two updates, each with two crawls."""
    spread: float = 0.3
    """Standard deviation of an entry's change along a direction."""
    rate: float = 0.1
    """How far an update moves an entry of the table, root mean square, at the beginning; it falls to 0 evenly."""
    failure: float = 0.5
    """What it costs to miss the goal, beside an error of 0.5 or so."""
    hurry: float = 0.5
    """What a crawl as long as the base's costs."""
    scenarios: int = 12
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


def layers(table: np.ndarray) -> Layers:
    """A table as a network: a hidden unit for each of its rows that is 1 there and 0 elsewhere.

    Args:
        table: Shape (`CONTEXTS`, `CHANNELS`), within ± 1.
    """
    places, place = {}, 0
    for piece in crawl_layout(MODE.size):
        places[piece.name], place = place, place + piece.size
    n = len(PHASES)
    hidden = np.zeros((CONTEXTS, place), np.float32)
    for k in range(n):
        hidden[[k, n + k], places["phase"] + k] = 1.0
    hidden[:n, places["steps_left"]], hidden[n:, places["steps_left"]] = -0.5, 0.5
    last = np.zeros((MODE.size, CONTEXTS), np.float32)
    last[[0, 1, 3]] = table.T[:3]
    last[GAIT.size + 2 :: 3] = table.T[3]
    return (hidden, np.full(CONTEXTS, -0.5, np.float32)), (last, np.zeros(MODE.size, np.float32))


def artifact(args: Args, table: np.ndarray, state: State) -> Artifact:
    """A table as the benchmark's artifact."""
    return make_artifact(
        layers(table), scaling(), state, name=args.name, kind="residual", doc=args.doc, env_id=CRAWL,
        arguments=args.arguments, activation="relu",
        training={"seed": args.seed, "steps": state.learner.get("ticks", 0), "chosen_at": state.best_steps},
    )  # fmt: skip


class Course:
    """Crawls of the tracks' kinds: what a table costs on one of them."""

    def __init__(self, args: Args) -> None:
        """Make the environments."""
        self._args = args
        self._envs = [
            make_training_env(track, args.arguments, Goal(), washout=np.zeros(0), control=args.control).env
            for track in args.tracks
        ]

    def cost(self, table: np.ndarray, number: int, seed: int) -> tuple[float, int]:
        """Cost of a crawl, and its ticks; the kinds take turns.

        The benchmark's error, of which one crawl that fails counts for no more than four good ones, and beside it what
        time costs and what missing the goal does.
        """
        args, env = self._args, self._envs[number % len(self._envs)]
        inner: Any = env.unwrapped
        agent = artifact(args, table, State())
        observation, info = env.reset(seed=seed)
        ticks, terminated, truncated = 0, False, False
        while not (terminated or truncated or info["finished"]):
            observation, _, terminated, truncated, info = env.step(agent.act(observation))
            ticks += 1
        failed = not info["finished"]
        error = ground_error(inner.progress.rest, info["energy_wh"] / inner.progress.whole, failed=failed)
        hurry = args.hurry * ticks / CONTROL_RATE / inner.progress.nominal_time
        return min(2.0, error) + hurry + args.failure * (not info["is_success"]), ticks

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            env.close()


def update(
    args: Args, course: Course, table: np.ndarray, number: int, done: float, on_ticks: Callable[[int], object]
) -> tuple[np.ndarray, int]:
    """The table after one update, and the ticks it took.

    Args:
        args: Settings.
        course: Where it crawls.
        table: Before.
        number: Of the update; everything drawn in it depends on it and on the run's seed.
        done: Share of the run that is done.
        on_ticks: Called with the ticks of each crawl.
    """
    rng = np.random.Generator(np.random.PCG64(training_seed(args.seed, 5, number)))
    step, differences, whole = np.zeros_like(table), [], 0
    directions = rng.standard_normal((args.directions, *table.shape))
    for k, direction in enumerate(directions):
        seed, costs = training_seed(args.seed, 6, number, k), []
        for sign in (1.0, -1.0):
            tried = np.clip(table + sign * args.spread * direction, -1.0, 1.0)
            cost, ticks = course.cost(tried, number * args.directions + k, seed)
            costs.append(cost)
            whole += ticks
            on_ticks(ticks)
        differences.append(costs[0] - costs[1])
        step -= differences[-1] * direction
    size = float(np.sqrt(np.mean(step**2)))
    moved = table + args.rate * (1.0 - done) * step / size if size > 0.0 else table
    return np.clip(moved, -1.0, 1.0), whole


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
    table, best, ticks, number = (
        state.learner.get(name, zero)
        for name, zero in (("table", zeros()), ("best", zeros()), ("ticks", 0), ("number", 0))
    )
    if number == 0:
        referee.require_equal(artifact(args, table, state))
    bar.update(ticks)
    course = Course(args)
    while ticks < args.steps:
        began, judged = time.perf_counter(), state.segment
        table, more = update(args, course, table, number, ticks / args.steps, bar.update)
        number, ticks = number + 1, ticks + more
        state.learner = {"table": table, "best": best, "ticks": ticks, "number": number}
        if ticks >= args.steps * (judged + 1) / args.validations:
            verdict = referee.judge(artifact(args, table, state))
            if verdict.admissible and verdict.score < state.best_score:
                best, state.best_score, state.best_steps = table, verdict.score, ticks
                state.learner = {**state.learner, "best": best}
            state.segment, state.mean, state.best = judged + 1, layers(table), layers(best)
            bar.set_postfix_str(f"against the base {verdict.score:+.1%}, worst {verdict.worst:+.1%}")
            state.seconds += time.perf_counter() - began
            state.curve.append(curve_line(ticks, state.seconds, verdict))
        else:
            state.seconds += time.perf_counter() - began
        run.save(state)
    bar.close()
    course.close()
    run.write_curve(state)
    return run.publish(artifact(args, best, state))


def zeros() -> np.ndarray:
    """The table that adds nothing."""
    return np.zeros((CONTEXTS, len(CHANNELS)))


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
