"""Learn a residual with a memory: forces against external disturbances, estimated from the history of the flight.

    python -m train.memory hover --seed 0

The base flies on all tracks, also in wind and with randomised robots, and its true pose errors are recorded from the
simulation. The network receives low-passes, over a tenth of a second to several seconds, of the external force: the
part of the acceleration that the commands do not explain. It is fitted so that its wrench, convolved with the measured
pulse response of the closed loop, cancels the recorded errors. The commands include the residual, so the residual
hardly affects the external force, and the recorded errors remain valid for the fit. Calm flights have the same weight
as windy ones, and a larger weight where they get worse. Further rounds fly with the network and fit the remaining
errors.
"""

import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spidar_gym.benchmark.scenario import draw_scenario_from, reset_options
from spidar_gym.benchmark.track import HOVER, TRACKS, find_track
from spidar_gym.console import kept, run_cli
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import layout
from spidar_gym.errors import InvalidValueError, require_least
from spidar_gym.policies import external
from spidar_gym.policies.artifact import Artifact, LearnedPolicy
from spidar_gym.processes import Pool, cpu_count
from train.lib.config import TrackRecipe, parse
from train.lib.envs import training_seed
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.report import report
from train.lib.response import POSE, RESPONSE_TICKS, SETTLE, pulse_response
from train.lib.run import Run, State, command_line, curve_line, require_frameworks
from train.lib.stages import Stages, scalars

if TYPE_CHECKING:
    import torch
    from torch.utils.tensorboard import SummaryWriter

OBSERVATION = sum(piece.size for piece in layout(POSE))
"""Length of the artifact's observation, of which the network receives nothing directly."""
FORCES = 3
"""Number of outputs: forces; torques stay 0."""
SLACK = 0.01
"""Increase of a cell's relative mean square without penalty: half a percent of its RMS, the scatter of a batch."""
FLAT = 2.5
"""Bias with which a unit is nearly inactive: the slope of tanh there is a fortieth of its maximum."""
FIRST = 40
"""Control ticks at the beginning of a flight that are left out, as in the benchmark's errors."""


@dataclass(frozen=True)
class FitConfig:
    """Network and optimisation."""

    trace_times: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0)
    """Time constants of the low-passes (traces) of the external force [s]."""
    rotor_lag: float = 0.05
    """Assumed time constant of the rotors [s]."""
    hidden: int = 24
    """Units of the hidden layer, each with a mirrored copy."""
    updates: int = 2000
    """Optimiser steps per round."""
    batch: int = 8
    """Flights of every track in an optimiser step."""
    lr: float = 3e-3
    """Initial learning rate; it falls to 0 along a cosine."""
    decay: float = 0.01
    """Weight decay."""
    harm: float = 10.0
    """Additional weight of a cell's increase over the base's mean square error; a cell is one metric on one track."""

    def __post_init__(self) -> None:
        require_least(1, updates=self.updates, batch=self.batch, hidden=self.hidden)


@dataclass(frozen=True)
class Args(TrackRecipe):
    """Learn a residual with a memory."""

    action_mode = "residual_wrench"

    rounds: int = 1
    """Number of rounds of flying and fitting; the base flies alone in the first round. One is enough, as the errors in
    flight match those of the fit."""
    robots: int = 64
    """Number of flights on each track per round."""
    forms: int = 4
    """Number of forms in which the pulse response is measured."""
    scenarios: int = 12
    """Number of validation scenarios of each track."""
    workers: int = cpu_count()
    """Number of processes that fly."""
    fit: FitConfig = field(default_factory=FitConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        least = ("rounds", "robots", "forms", "scenarios", "workers")
        require_least(1, **{name: getattr(self, name) for name in least})
        for track in self.tracks:
            if find_track(track).env_id != HOVER:
                expected = "flights of Hover-v0: crawls and paths have no single pose to hold"
                raise InvalidValueError("tracks", track, expected)


PRESETS: dict[str, Args] = {
    "hover": Args(
        "memory",
        "Regression: forces against what pulls at the robot, remembered over seconds, on `tuned`.",
        tuple(name for name, track in TRACKS.items() if track.group == "flight"),
        "tuned",
    ),
}
"""Settings by name."""


@dataclass(frozen=True)
class Records:
    """Records of the flights on one track."""

    inputs: np.ndarray
    """Inputs of the network: external force and traces, (robots, ticks, inputs)."""
    actions: np.ndarray
    """Residual wrench as an action within ± 1, (robots, ticks, 6)."""
    errors: np.ndarray
    """True pose errors after each tick, (robots, ticks, 6) [m], [rad]."""

    def plus(self, other: "Records") -> "Records":
        """Concatenate these records with others of the same track."""
        return Records(*(np.concatenate(pair) for pair in zip(vars(self).values(), vars(other).values(), strict=True)))


def network_inputs(config: FitConfig) -> int:
    """Return the number of the network's inputs."""
    return external.SIZE + len(traced()) * len(config.trace_times)


def traced() -> np.ndarray:
    """Return the indices of the external force and its absolute values, which have traces."""
    return OBSERVATION + np.arange(2 * 3)


def fly(args: Args, agent: Artifact, round_index: int, track: str) -> Records:
    """Fly the agent on one track, in parallel; flights begin like scenarios, trimmed for their robot and wind."""
    from train.lib.vector import make_vector  # imported late: needs torch

    vector, policy = make_vector(track, args.arguments, args.robots), LearnedPolicy(agent)
    # A seed has the number of its track in the order in which the tracks were added: the calibrated ones came last.
    added = sorted(TRACKS, key=lambda name: TRACKS[name].is_calibrated)
    words = 2, round_index, added.index(track)
    rngs = [np.random.Generator(np.random.PCG64(training_seed(args.seed, *words, k))) for k in range(args.robots)]
    drawn = [draw_scenario_from(find_track(track), rng, k) for k, rng in enumerate(rngs)]
    options = [reset_options(scenario) for scenario in drawn]
    seeds = [scenario.seed for scenario in drawn]
    vector.reset(seed=seeds, options={name: [each[name] for each in options] for name in options[0]})
    policy.reset_batch(seeds)
    inputs, actions, errors = [], [], []
    for _ in range(round(find_track(track).seconds * CONTROL_RATE)):
        seen = policy.see(vector.buffers["observations"])
        action = agent.act(seen)
        vector.advance(action)
        inputs.append(seen[:, OBSERVATION:].astype(np.float32))
        actions.append(action.astype(np.float32))
        robots = vector.robots
        errors.append(np.concatenate([robots["position_error"], robots["attitude_error"]], axis=1, dtype=np.float32))
    vector.close()
    return Records(*(np.stack(column, axis=1) for column in (inputs, actions, errors)))


@dataclass(frozen=True)
class Weights:
    """Weights of the network h(x) − h(x′) + M x, where x′ is x with all forces reversed, so the output is odd in them.

    h is a hidden layer of tanh. The absolute values of the forces only modulate its slope.
    """

    hidden: np.ndarray
    """(units, inputs)."""
    bias: np.ndarray
    """(units,)."""
    last: np.ndarray
    """(3, units)."""
    skip: np.ndarray
    """M, (3, inputs)."""

    def weakened(self, fraction: float) -> "Weights":
        """Return the network with its output multiplied by a fraction."""
        return Weights(self.hidden, self.bias, fraction * self.last, fraction * self.skip)


def silent(config: FitConfig) -> Weights:
    """Return a network with zero output."""
    size, units = network_inputs(config), config.hidden
    return Weights(np.zeros((units, size)), np.zeros(units), np.zeros((FORCES, units)), np.zeros((FORCES, size)))


def turned(config: FitConfig) -> np.ndarray:
    """Return the signs of x′: −1 for inputs that are forces, 1 for their absolute values, (inputs,)."""
    pull = np.repeat([-1.0, 1.0], FORCES)
    return np.concatenate([pull, np.ones(FORCES), np.tile(pull, len(config.trace_times))])


def input_scale(records: Mapping[str, Records]) -> np.ndarray:
    """Compute the RMS of the inputs, averaged over the tracks, (inputs,); 0 for inputs that the network ignores.

    The network ignores the force of the current tick. It mostly consists of noise and of the rotors' lag of one or two
    ticks behind the last command, with which a response to it would form an unstable feedback loop.
    """
    squares = [np.square(own.inputs, dtype=float).mean(axis=(0, 1)) for own in records.values()]
    scale = np.sqrt(np.mean(squares, axis=0))
    scale[: len(traced())] = 0.0
    return scale


def fit(
    config: FitConfig,
    records: Mapping[str, Records],
    response: np.ndarray,
    scale: np.ndarray,
    seed: int,
    on_update: Callable[[float], object],
) -> Weights:
    """Fit a network whose forces, convolved with the pulse response, cancel the recorded errors.

    First the effect of the recorded residual is subtracted from the recorded errors. The loss of a cell, position or
    attitude of a track, is its mean square divided by that of the base, plus `harm` times its excess over 1 + `SLACK`.

    Args:
        config: Network and optimisation.
        records: Track → all flights recorded so far.
        response: Pulse response of the pose, shape (6 errors, 6 entries, ticks).
        scale: Scale by which each input is divided, (inputs,); 0 for ignored inputs.
        seed: Seed of the initial weights and the batches.
        on_update: Called with the loss of every step.
    """
    # Imported late so that `--help` works without torch.
    import torch
    from torch import nn

    torch.manual_seed(seed)
    rng = np.random.Generator(np.random.PCG64([seed, 1]))
    sent, seen = responder(response), np.where(scale > 0.0, 1.0 / np.where(scale > 0.0, scale, 1.0), 0.0)
    mirror = torch.tensor(turned(config), dtype=torch.float32)
    odd = (mirror < 0.0) & torch.tensor(seen > 0.0)
    hidden = nn.Linear(len(scale), config.hidden)
    last, skip = nn.Linear(config.hidden, FORCES, bias=False), nn.Linear(len(scale), FORCES, bias=False)
    with torch.no_grad():
        for layer in (last, skip):
            layer.weight.zero_()
        # Every other unit initially responds in wind only: nearly flat unless the first integral has a horizontal part.
        hidden.bias[::2] = FLAT
        hidden.weight[::2, 2 * FORCES : 2 * FORCES + 2] = -0.6 * FLAT
        hidden.weight.mul_(torch.tensor(seen > 0.0))
    skip.weight.register_hook(lambda gradient: gradient * odd)

    def answer(x: "torch.Tensor") -> "torch.Tensor":
        return last(torch.tanh(hidden(x)) - torch.tanh(hidden(mirror * x))) + skip(x)

    flown = {}
    for track, own in records.items():
        inputs = torch.tensor((own.inputs * seen).astype(np.float32))
        left = torch.tensor(own.errors) - sent(torch.tensor(own.actions[..., :FORCES]))
        flown[track] = inputs, left

    parameters = [p for layer in (hidden, last, skip) for p in layer.parameters()]
    optimizer = torch.optim.AdamW(parameters, lr=config.lr, weight_decay=config.decay)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.updates)
    for _ in range(config.updates):
        loss = torch.zeros(())
        for inputs, left in flown.values():
            ids = torch.from_numpy(rng.integers(0, len(inputs), config.batch))
            before = left[ids]
            after = before + sent(answer(inputs[ids]))
            for cell in (slice(0, 3), slice(3, 6)):
                share = (after[:, FIRST:, cell] ** 2).mean() / (before[:, FIRST:, cell] ** 2).mean()
                loss = loss + share + config.harm * torch.relu(share - 1.0 - SLACK)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        on_update(loss.item())
    found = (hidden.weight, hidden.bias, last.weight, skip.weight)
    return Weights(*(parameter.detach().numpy().astype(float) for parameter in found))


def responder(response: np.ndarray) -> Callable[["torch.Tensor"], "torch.Tensor"]:
    """Return a function: forces as actions (robots, ticks, 3) → pose errors that they cause (robots, ticks, 6).

    Args:
        response: Pulse response of the pose, shape (6 errors, 6 entries, length).
    """
    import torch

    kernel = torch.tensor(response[:, :FORCES], dtype=torch.float32)

    def sent(forces: "torch.Tensor") -> "torch.Tensor":
        # A product of spectra; a direct convolution takes five times as long as everything else together.
        ticks = forces.shape[1]
        size = 1 << (ticks + kernel.shape[2] - 1).bit_length()
        spectra = torch.fft.rfft(forces.transpose(1, 2), size)
        caused = torch.einsum("eif,rif->ref", torch.fft.rfft(kernel, size), spectra)
        return torch.fft.irfft(caused, size)[..., :ticks].transpose(1, 2)

    return sent


def artifact(args: Args, weights: Weights, scale: np.ndarray, state: State) -> Artifact:
    """Build the artifact of a network, with zero weights for the observation itself."""
    inputs, unseen, rest = OBSERVATION + network_inputs(args.fit), OBSERVATION, POSE - FORCES
    mirror = turned(args.fit)
    hidden = np.concatenate([weights.hidden, weights.hidden * mirror])
    last = np.pad(np.concatenate([weights.last, -weights.last], axis=1), ((0, rest), (0, 0)))
    curve = [[entry["steps"], round(entry["score"], 5)] for entry in state.curve]
    return Artifact(
        args.name, "residual", args.doc, HOVER, args.arguments,
        (np.pad(hidden, ((0, 0), (unseen, 0))).astype(np.float32), last.astype(np.float32)),
        (np.tile(weights.bias, 2).astype(np.float32), np.zeros(POSE, np.float32)),
        np.zeros(inputs), np.concatenate([np.ones(unseen), np.where(scale > 0.0, scale, 1.0) ** 2]),
        rotor_lag=np.array([args.fit.rotor_lag]), traced=traced().astype(float),
        trace_times=np.array(args.fit.trace_times),
        skip=np.pad(weights.skip, ((0, rest), (unseen, 0))).astype(np.float32),
        training={
            "command": command_line(), "seed": args.seed, "steps": state.best_steps, "curve": curve,
        },
    )  # fmt: skip


def weakened(args: Args, weights: Weights, scale: np.ndarray, state: State, fraction: float) -> Artifact:
    """Build the artifact of a network with its output multiplied by a fraction."""
    return artifact(args, weights.weakened(fraction), scale, state)


def learn(args: Args) -> Path:
    """Perform a run; return the path of its artifact."""
    require_frameworks()
    from torch.utils.tensorboard import SummaryWriter

    run, state = Run.of(args, HOVER, args.arguments), State()
    with (
        kept(lambda: f"the curve of {state.segment} of {args.rounds} rounds kept in {run.folder}; a rerun restarts it"),
        Pool(args.workers) as pool,
        Stages(f"{args.name} seed {args.seed}", state.parts) as stages,
        SummaryWriter(str(run.folder / "tensorboard")) as board,
    ):
        return _learn(args, run, state, pool, stages, board)


def _learn(args: Args, run: Run, state: State, pool: Pool, stages: Stages, board: "SummaryWriter") -> Path:
    """Fly, fit and evaluate, round by round; return the path of the artifact."""
    began, updates, ticks = time.perf_counter(), itertools.count(), 0
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
    ticks += args.forms * (1 + POSE) * (SETTLE + RESPONSE_TICKS)

    weights = chosen = silent(args.fit)
    scale = np.zeros(network_inputs(args.fit))
    records: dict[str, Records] = {}
    for k in range(args.rounds):
        agent = artifact(args, weights, scale, State())
        flown = pool.map(partial(fly, args, agent, k), args.tracks)
        new = stages.each(f"round {k + 1} of {args.rounds}, flying", flown, len(args.tracks), "track", "flights")
        for track, own in zip(args.tracks, list(new), strict=True):
            records[track] = records[track].plus(own) if k else own
            ticks += own.actions.shape[0] * own.actions.shape[1]
        if k == 0:
            scale = input_scale(records)  # the base's flights determine the scale of all rounds
        stages.begin(f"round {k + 1} of {args.rounds}, fitting", args.fit.updates, "update", "learner")
        weights = fit(args.fit, records, response, scale, training_seed(args.seed, 3, k), on_update)

        stages.begin(f"round {k + 1} of {args.rounds}, comparing with the base", validations, "scenario", "validation")
        verdict, fraction = evaluator.largest_fraction(partial(weakened, args, weights, scale, state), stages.count)
        stages.evaluated(verdict)
        weights = weights.weakened(fraction)
        state.seconds, state.segment = time.perf_counter() - began, k + 1
        state.curve.append(curve_line(ticks, state.seconds, verdict))
        if verdict.admissible and verdict.score < state.best_score:
            chosen, state.best_score, state.best_steps = weights, verdict.score, ticks
        run.write_curve(state)
        for name, value in scalars(state.curve[-1]):
            board.add_scalar(name, value, ticks)
    return run.publish(artifact(args, chosen, scale, state))


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.memory", __doc__)
    report(learn(args), args, HOVER, args.tracks, args.base, workers=args.workers)


if __name__ == "__main__":
    run_cli("train.memory", main)
