"""Learn a residual by regression, in minutes: what wrench would have cancelled the errors that the base makes.

    python -m train.supervised hover-paper --seed 0

The base flies, and its pose errors are recorded. How a pose answers to a residual wrench is measured by pulses. A
network that sees the motion of the joints and nothing of the errors, so that no loop is closed through it, is fitted
such that its wrench, sent through that answer, cancels what was recorded: a mismatch of demanded and produced wrench
counts as much as it moves the robot. Then the agent flies, and the rest is learned from what it left.
"""

import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from torch import nn
from tqdm import tqdm

from spidar_gym.benchmark.artifact import Artifact
from spidar_gym.benchmark.row import cores
from spidar_gym.benchmark.track import HOVER, find_track
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.core import core_path
from spidar_gym.control.observation import layout
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.terminal import speak_plainly
from train import presets
from train.kinds import Goal, Scaling, make_training_env, scaling_of, training_seed
from train.learner import Layers
from train.referee import Base, Referee
from train.report import evaluate_row
from train.response import POSE, RESPONSE_TICKS, answer, pose_error, pulse_response
from train.run import Run, State, curve_line, make_artifact


@dataclass(frozen=True)
class Args:
    """Learn a residual by regression."""

    name: str
    """Of the row: letters, digits, _ and -."""
    doc: str
    """What it is, in one line."""
    tracks: tuple[str, ...]
    """Tracks in whose kinds of flights it learns, and on whose validation scenarios it is judged."""
    base: str
    """Preset of the controller that it adds to."""
    seed: int = 0
    """Of everything that is drawn."""
    posture: bool = True
    """Whether the network sees the joints' positions beside their motion."""
    rounds: int = 2
    """How often it flies and learns; the base alone flies in the first round."""
    flights: int = 72
    """Flights a round."""
    updates: int = 2000
    """Steps of the optimiser a round."""
    batch: int = 4
    """Flights in a step."""
    hidden: int = 64
    """Width of the two hidden layers."""
    lr: float = 2e-3
    """Learning rate at the beginning; it falls to 0 along a cosine."""
    decay: float = 0.1
    """Weight decay."""
    effort: float = 1e-3
    """Weight of the mean square action beside the errors, each over the base's."""
    forms: int = 4
    """Forms in which the answer to a pulse is measured."""
    scenarios: int = 6
    """Validation scenarios of each track."""
    control: str = "core" if core_path().is_file() else "python"
    """python, or core: the compiled controller, several times faster; core where `spidar export --build` made it."""
    workers: int = cores()
    """Processes that fly."""
    out: Path = Path("out/train")
    """Folder for runs: NAME/seedK."""
    row: bool = True
    """Evaluate on the test scenarios in the end and write a row of this seed."""

    def __post_init__(self) -> None:
        """Refuse what cannot be learned."""
        least = ("rounds", "flights", "updates", "batch", "hidden", "forms", "scenarios", "workers")
        require_least(1, **{name: getattr(self, name) for name in least})
        require_least(0, seed=self.seed)
        for track in self.tracks:
            if not find_track(track).flies:
                raise InvalidValueError("tracks", track, "flights: a crawl has no pose to hold")

    @property
    def arguments(self) -> dict[str, Any]:
        """Of `gym.make`."""
        return {"action_mode": "residual_wrench", "preset": self.base}


POSTURE = ("joint_position",)
"""Pieces that enter the network beside `presets.MOTION`, where the base leaves errors at rest; never an error."""
SKIPPED = 20
"""Ticks at the beginning of a flight that do not count: its offset dies away."""


@dataclass(frozen=True)
class Flight:
    """What was recorded of a flight."""

    track: str
    """Whose kind it was."""
    observations: np.ndarray
    """Shape (ticks, observation)."""
    actions: np.ndarray
    """Residual wrench, shape (ticks, 6), in its own unit."""
    errors: np.ndarray
    """Pose errors after each tick, shape (ticks, 6) [m], [rad]."""


def fly(args: Args, layers: Layers | None, scaling: Scaling | None, number: int, round_: int) -> Flight:
    """One flight of the base, or of the agent; flights take turns among the kinds."""
    track = args.tracks[number % len(args.tracks)]
    env = make_training_env(track, args.arguments, Goal(), washout=np.zeros(0), control=args.control).unwrapped
    agent = None if layers is None or scaling is None else artifact(args, layers, scaling, State())
    observation, _ = env.reset(seed=training_seed(args.seed, 2, round_, number))
    seen, actions, errors = [], [], []
    for _ in range(round(find_track(track).seconds * CONTROL_RATE)):
        action = np.zeros(POSE) if agent is None else agent.act(observation)
        seen.append(observation)
        actions.append(action)
        observation, _, terminated, _, info = env.step(action)
        errors.append(pose_error(info))
        if terminated:
            break
    env.close()
    return Flight(track, np.array(seen), np.array(actions, np.float32), np.array(errors, np.float32))


def units(flights: Sequence[Flight]) -> dict[str, np.ndarray]:
    """RMS of position and attitude errors of each kind of flight, shape (6,): what an error is measured by."""
    found = {}
    for track in {flight.track for flight in flights}:
        errors = np.concatenate([f.errors[SKIPPED:] for f in flights if f.track == track])
        found[track] = np.repeat(np.sqrt((errors.reshape(-1, 2, 3) ** 2).mean(axis=(0, 2))), 3)
    return found


def fit(
    args: Args,
    flights: Sequence[Flight],
    unit: dict[str, np.ndarray],
    response: np.ndarray,
    scaling: Scaling,
    on_update: Callable[[], object],
) -> Layers:
    """Fit a network whose wrench, sent through the response, cancels the recorded errors.

    The recorded errors had the recorded residual in them; it is taken out first. Every kind of flight counts the same,
    position as much as attitude, each over the base's.
    """
    size = len(scaling.mean)
    first, middle, last = (
        nn.Linear(size, args.hidden), nn.Linear(args.hidden, args.hidden), nn.Linear(args.hidden, POSE)
    )  # fmt: skip
    network = nn.Sequential(first, nn.Tanh(), middle, nn.Tanh(), last)
    hidden = torch.tensor(~visible(args))
    with torch.no_grad():
        first.weight[:, hidden] = 0.0
        last.weight.zero_()
        last.bias.zero_()
    reversed_ = torch.tensor(response[:, :, ::-1].copy(), dtype=torch.float32)
    inputs, left, weights = [], [], []
    for flight in flights:
        x = torch.tensor(scaling(flight.observations))
        x[:, hidden] = 0.0
        inputs.append(x)
        left.append(torch.tensor(flight.errors) - answer(reversed_, torch.tensor(flight.actions)))
        weights.append(torch.tensor(1.0 / unit[flight.track], dtype=torch.float32))
    optimizer = torch.optim.AdamW(network.parameters(), lr=args.lr, weight_decay=args.decay)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, args.updates)
    for _ in range(args.updates):
        chosen = torch.randint(0, len(flights), (args.batch,)).tolist()
        wrenches = network(torch.cat([inputs[k] for k in chosen])).split([len(inputs[k]) for k in chosen])
        loss = torch.zeros(())
        for k, wrench in zip(chosen, wrenches, strict=True):
            error = (left[k] + answer(reversed_, wrench)) * weights[k]
            loss = loss + (error[SKIPPED:] ** 2).mean() + args.effort * (wrench**2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        on_update()
    return tuple((m.weight.detach().numpy().copy(), m.bias.detach().numpy().copy()) for m in (first, middle, last))


def visible(args: Args) -> np.ndarray:
    """Which numbers of the observation enter the network."""
    names = presets.MOTION + (POSTURE if args.posture else ())
    return np.concatenate([np.full(field.size, field.name in names) for field in layout(POSE)])


def weakened(layers: Layers, share: float) -> Layers:
    """The same network with a share of its output."""
    *rest, (w, b) = layers
    return (*rest, (share * w, share * b))


def artifact(args: Args, layers: Layers, scaling: Scaling, state: State) -> Artifact:
    """A network as the benchmark's artifact."""
    return make_artifact(
        layers, scaling, state, name=args.name, kind="residual", doc=args.doc, env_id=HOVER, arguments=args.arguments,
        training={"seed": args.seed, "steps": state.best_steps},
    )  # fmt: skip


def candidate(args: Args, layers: Layers, scaling: Scaling, state: State, share: float) -> Artifact:
    """A share of a network."""
    return artifact(args, weakened(layers, share), scaling, state)


def learn(args: Args) -> Path:
    """One run; the path of its artifact."""
    torch.set_num_threads(1)
    torch.manual_seed(training_seed(args.seed, 3))
    began = time.perf_counter()
    settings = {k: v for k, v in asdict(args).items() if k not in ("out", "row", "workers")}
    run = Run(args.out / args.name / f"seed{args.seed}", settings, HOVER, args.arguments)
    state, flights, layers, scaling = State(), [], None, None
    bounds = np.concatenate([np.full(field.size, field.bound) for field in layout(POSE)])
    judged = len(args.tracks) * args.scenarios
    total = args.forms + judged + args.rounds * (args.flights + args.updates + judged)
    with (
        ProcessPoolExecutor(args.workers) as pool,
        tqdm(total=total, desc=f"{args.name} seed {args.seed}", file=sys.__stderr__) as bar,
    ):
        bar.set_postfix_str("playing the base")
        referee = Referee(
            args.tracks, Base(args.arguments), args.scenarios, control=args.control, on_scenario=bar.update,
            each=pool.map,
        )  # fmt: skip
        state.base = referee.means
        bar.set_postfix_str("pulses")
        pulses = []
        for pulse in pool.map(
            partial(pulse_response, args.arguments, ticks=RESPONSE_TICKS, control=args.control),
            [training_seed(args.seed, 4, k) for k in range(args.forms)],
        ):
            pulses.append(pulse)
            bar.update()
        response = np.mean(pulses, axis=0)
        steps = args.forms * (1 + POSE) * (RESPONSE_TICKS + 40)
        unit: dict[str, np.ndarray] = {}
        for round_ in range(args.rounds):
            bar.set_postfix_str(f"round {round_ + 1}: flying")
            for flight in pool.map(partial(fly, args, layers, scaling, round_=round_), range(args.flights)):
                flights.append(flight)
                bar.update()
            if scaling is None:
                scaling = scaling_of(np.concatenate([f.observations for f in flights]), bounds)
                unit = units(flights)
            steps = steps + sum(len(f.errors) for f in flights[-args.flights :])
            bar.set_postfix_str(f"round {round_ + 1}: fitting")
            layers = fit(args, flights, unit, response, scaling, bar.update)
            bar.set_postfix_str(f"round {round_ + 1}: against the base")
            verdict, share = referee.strongest(partial(candidate, args, layers, scaling, state), bar.update)
            layers = weakened(layers, share)
            state.seconds = time.perf_counter() - began
            state.segment, state.mean = round_ + 1, layers
            state.curve.append(curve_line(steps, state.seconds, verdict))
            if verdict.admissible and verdict.score < state.best_score:
                state.best, state.best_score, state.best_steps = layers, verdict.score, steps
            run.write_curve(state)
        bar.set_postfix_str(f"against the base {state.best_score:+.1%}")
    assert scaling is not None
    return run.publish(artifact(args, state.best or weakened(layers or (), 0.0), scaling, state))


def main() -> None:
    """Entry point."""
    options = {name: (str(values["doc"]), Args(**values)) for name, values in presets.SUPERVISED.items()}
    args = tyro.extras.overridable_config_cli(options, description=__doc__, prog="python -m train.supervised")
    path = learn(args)
    print(f"{path}: {args.name}, seed {args.seed}")
    if args.row:
        print(evaluate_row(path, args.tracks, args.out / "scores", args.base, workers=args.workers))


if __name__ == "__main__":
    speak_plainly("train.supervised", main)
