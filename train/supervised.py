"""Learn a residual wrench by regression, in minutes: it cancels the pose errors that the base controller leaves.

    python -m train.supervised hover-paper --seed 0

The pulse response of the pose to a residual wrench is measured. The base flies, and its pose errors are recorded. A
network is fitted whose wrench, convolved with the pulse response, cancels the recorded errors. Its inputs describe the
motion of the joints and contain no errors, so it closes no feedback loop. Further rounds fly with the network and fit
the remaining errors.
"""

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spidar_gym.benchmark.track import HOVER, find_track
from spidar_gym.console import kept, run_cli
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import layout
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.policies.artifact import Artifact, LearnedPolicy
from spidar_gym.policies.rollout import rollout
from spidar_gym.processes import Pool, cpu_count
from train.lib.config import TrackRecipe, parse
from train.lib.envs import FLIGHTS, Scaling, make_track_env, scaling_of, training_seed
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.learner import Layers
from train.lib.report import report
from train.lib.response import POSE, RESPONSE_TICKS, SETTLE, pose_error, pulse_response, respond
from train.lib.run import Run, State, curve_line, make_artifact, require_frameworks
from train.lib.stages import Stages, scalars

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter


@dataclass(frozen=True)
class FitConfig:
    """Network and optimisation."""

    posture: bool = True
    """Whether the network receives the joint positions in addition to the joints' motion."""
    updates: int = 2000
    """Optimiser steps per round."""
    batch: int = 4
    """Flights in an optimiser step."""
    hidden: int = 64
    """Width of the two hidden layers."""
    lr: float = 2e-3
    """Initial learning rate; it falls to 0 along a cosine."""
    decay: float = 0.1
    """Weight decay."""
    effort: float = 1e-3
    """Weight of the mean square action in the loss, relative to the squared errors in units of the base's."""

    def __post_init__(self) -> None:
        require_least(1, updates=self.updates, batch=self.batch, hidden=self.hidden)


@dataclass(frozen=True)
class Args(TrackRecipe):
    """Learn a residual by regression."""

    action_mode = "residual_wrench"

    rounds: int = 2
    """Number of rounds of flying and fitting; the base flies alone in the first round."""
    flights: int = 72
    """Number of flights per round."""
    forms: int = 4
    """Number of forms in which the pulse response is measured."""
    scenarios: int = 6
    """Number of validation scenarios of each track."""
    workers: int = cpu_count()
    """Number of processes that fly."""
    fit: FitConfig = field(default_factory=FitConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        least = ("rounds", "flights", "forms", "scenarios", "workers")
        require_least(1, **{name: getattr(self, name) for name in least})
        for track in self.tracks:
            if find_track(track).env_id != HOVER:
                expected = "flights of Hover-v0: crawls and paths have no single pose to hold"
                raise InvalidValueError("tracks", track, expected)


PRESETS: dict[str, Args] = {
    "hover-paper": Args(
        "supervised_paper",
        "Regression: a wrench residual that foresees what moving joints do, on the paper's gains.",
        FLIGHTS,
        "paper",
    ),
    "hover-tuned": Args(
        "supervised_tuned",
        "Regression: a wrench residual that foresees what moving joints do, on `tuned`.",
        FLIGHTS,
        "tuned",
        rounds=1,
        flights=240,
        fit=FitConfig(posture=False, updates=4000),
    ),
}
"""Settings by name."""
MOTION = ("joint_velocity", "joint_target_error", "joint_command_velocity", "leg_momentum", "leg_momentum_rate")
"""Pieces of the observation that the network receives: the joints' motion, and no pose errors."""
POSTURE = ("joint_position",)
"""Further pieces that the network receives if the base leaves steady-state errors."""
SKIPPED = 20
"""Control ticks at the beginning of a flight that are left out, while the initial offset decays."""


@dataclass(frozen=True)
class Flight:
    """Record of a flight."""

    track: str
    """Track of the flight."""
    observations: np.ndarray
    """Observations, shape (ticks, observation)."""
    actions: np.ndarray
    """Residual wrench as an action within ± 1, shape (ticks, 6)."""
    errors: np.ndarray
    """Pose errors after each tick, shape (ticks, 6) [m], [rad]."""


def fly(args: Args, agent: Artifact | None, round_index: int, index: int) -> Flight:
    """Fly and record one flight of the agent, or of the base if `agent` is None; `index` selects the track in turn."""
    track = args.tracks[index % len(args.tracks)]
    env = make_track_env(track, args.arguments, args.control).unwrapped
    policy = None if agent is None else LearnedPolicy(agent)
    seed, ticks = training_seed(args.seed, 2, round_index, index), round(find_track(track).seconds * CONTROL_RATE)
    steps = list(rollout(env, policy, seed=seed, ticks=ticks))
    env.close()
    return Flight(
        track,
        np.array([step.observation for step in steps]),
        np.array([step.action for step in steps], np.float32),
        np.array([pose_error(step.info) for step in steps], np.float32),
    )


def error_units(flights: Sequence[Flight]) -> dict[str, np.ndarray]:
    """Compute the units of the errors: track → RMS position and attitude errors of its flights, shape (6,)."""
    found = {}
    for track in {flight.track for flight in flights}:
        errors = np.concatenate([f.errors[SKIPPED:] for f in flights if f.track == track])
        found[track] = np.repeat(np.sqrt((errors.reshape(-1, 2, 3) ** 2).mean(axis=(0, 2))), 3)
    return found


def visible_entries(config: FitConfig) -> np.ndarray:
    """Return the mask of the observation's entries that the network receives."""
    names = MOTION + (POSTURE if config.posture else ())
    return np.concatenate([np.full(field.size, field.name in names) for field in layout(POSE)])


def fit(
    config: FitConfig,
    flights: Sequence[Flight],
    units: dict[str, np.ndarray],
    response: np.ndarray,
    scaling: Scaling,
    on_update: Callable[[float], object],
) -> Layers:
    """Fit a network whose wrench, convolved with the pulse response, cancels the recorded errors.

    First the effect of the recorded residual is subtracted from the recorded errors. All tracks have the same weight,
    and so have position and attitude, as errors are divided by those of the base.

    Args:
        config: Network and optimisation.
        flights: All flights recorded so far.
        units: Track → units by which its errors are divided, shape (6,).
        response: Pulse response of the pose, shape (6 errors, 6 entries, ticks).
        scaling: Scaling of the observations.
        on_update: Called with the loss of every step.
    """
    # Imported late so that `--help` works without torch.
    import torch
    from torch import nn

    network = nn.Sequential(
        nn.Linear(len(scaling.mean), config.hidden), nn.Tanh(),
        nn.Linear(config.hidden, config.hidden), nn.Tanh(),
        nn.Linear(config.hidden, POSE),
    )  # fmt: skip
    linear = [module for module in network if isinstance(module, nn.Linear)]
    hidden = torch.tensor(~visible_entries(config))
    with torch.no_grad():
        linear[0].weight[:, hidden] = 0.0
        linear[-1].weight.zero_()
        linear[-1].bias.zero_()

    kernel = torch.tensor(response[:, :, ::-1].copy(), dtype=torch.float32)
    inputs, base_errors, weights = [], [], []
    for flight in flights:
        x = torch.tensor(scaling(flight.observations))
        x[:, hidden] = 0.0
        inputs.append(x)
        base_errors.append(torch.tensor(flight.errors) - respond(kernel, torch.tensor(flight.actions)))
        weights.append(torch.tensor(1.0 / units[flight.track], dtype=torch.float32))

    optimizer = torch.optim.AdamW(network.parameters(), lr=config.lr, weight_decay=config.decay)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.updates)
    for _ in range(config.updates):
        batch = torch.randint(0, len(flights), (config.batch,)).tolist()
        wrenches = network(torch.cat([inputs[k] for k in batch])).split([len(inputs[k]) for k in batch])
        loss = torch.zeros(())
        for k, wrench in zip(batch, wrenches, strict=True):
            error = (base_errors[k] + respond(kernel, wrench)) * weights[k]
            loss = loss + (error[SKIPPED:] ** 2).mean() + config.effort * (wrench**2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        on_update(loss.item())
    return tuple((m.weight.detach().numpy().copy(), m.bias.detach().numpy().copy()) for m in linear)


def weakened(layers: Layers, fraction: float) -> Layers:
    """Return the network with its output multiplied by a fraction."""
    *rest, (w, b) = layers
    return (*rest, (fraction * w, fraction * b))


def artifact(args: Args, layers: Layers, scaling: Scaling, state: State) -> Artifact:
    """Build the artifact of a network."""
    return make_artifact(
        layers, scaling, state, name=args.name, kind="residual", doc=args.doc, env_id=HOVER, arguments=args.arguments,
        training={"seed": args.seed, "steps": state.best_steps},
    )  # fmt: skip


def learn(args: Args) -> Path:
    """Perform a run; return the path of its artifact."""
    require_frameworks()
    import torch
    from torch.utils.tensorboard import SummaryWriter

    torch.manual_seed(training_seed(args.seed, 3))
    run = Run.of(args, HOVER, args.arguments)
    state = State()
    with (
        kept(lambda: f"the curve of {state.segment} of {args.rounds} rounds kept in {run.folder}; a rerun restarts it"),
        Pool(args.workers) as pool,
        Stages(f"{args.name} seed {args.seed}", state.parts) as stages,
        SummaryWriter(str(run.folder / "tensorboard")) as board,
    ):
        return _learn(args, run, state, pool, stages, board)


def _learn(args: Args, run: Run, state: State, pool: Pool, stages: Stages, board: "SummaryWriter") -> Path:
    """Fly, fit and evaluate, round by round; return the path of the artifact."""
    began, updates = time.perf_counter(), itertools.count()
    validations = len(args.tracks) * args.scenarios

    def on_update(loss: float) -> None:
        board.add_scalar("train/loss", loss, next(updates))
        stages.count()

    stages.begin("evaluating the base", validations, "scenario", "validation")
    evaluator = PairedEvaluator(
        args.tracks, Base(args.arguments), args.scenarios, control=args.control, on_scenario=stages.count,
        each=pool.map,
    )  # fmt: skip
    state.base = evaluator.means

    measure = partial(pulse_response, args.arguments, ticks=RESPONSE_TICKS, control=args.control)
    seeds = [training_seed(args.seed, 4, k) for k in range(args.forms)]
    measured = stages.each("measuring the response to pulses", pool.map(measure, seeds), args.forms, "form", "flights")
    response = np.mean(list(measured), axis=0)

    def fly_round(k: int, agent: Artifact | None) -> list[Flight]:
        flown = pool.map(partial(fly, args, agent, k), range(args.flights))
        return list(stages.each(f"round {k + 1} of {args.rounds}, flying", flown, args.flights, "flight", "flights"))

    flights = fly_round(0, None)
    bounds = np.concatenate([np.full(field.size, field.bound) for field in layout(POSE)])
    # The observations and errors of the base determine the scaling and the units of all rounds.
    scaling = scaling_of(np.concatenate([flight.observations for flight in flights]), bounds)
    units = error_units(flights)
    for k in range(args.rounds):
        if k > 0:
            flights += fly_round(k, artifact(args, state.mean, scaling, State()))

        stages.begin(f"round {k + 1} of {args.rounds}, fitting", args.fit.updates, "update", "learner")
        layers = fit(args.fit, flights, units, response, scaling, on_update)

        stages.begin(f"round {k + 1} of {args.rounds}, comparing with the base", validations, "scenario", "validation")
        verdict, fraction = evaluator.largest_fraction(
            lambda fraction, layers=layers: artifact(args, weakened(layers, fraction), scaling, state), stages.count
        )
        stages.evaluated(verdict)
        layers = weakened(layers, fraction)

        steps = args.forms * (1 + POSE) * (SETTLE + RESPONSE_TICKS) + sum(len(flight.errors) for flight in flights)
        state.seconds = time.perf_counter() - began
        state.segment, state.mean = k + 1, layers
        state.curve.append(curve_line(steps, state.seconds, verdict))
        if verdict.admissible and verdict.score < state.best_score:
            state.best, state.best_score, state.best_steps = layers, verdict.score, steps
        run.write_curve(state)
        for name, value in scalars(state.curve[-1]):
            board.add_scalar(name, value, steps)
    return run.publish(artifact(args, state.best or weakened(state.mean, 0.0), scaling, state))


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.supervised", __doc__)
    report(learn(args), args, HOVER, args.tracks, args.base, workers=args.workers)


if __name__ == "__main__":
    run_cli("train.supervised", main)
