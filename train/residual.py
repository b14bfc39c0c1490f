"""Learn what to add to a controller: PPO or SAC in the environments of the tracks' kinds, judged against the base.

    python -m train.residual hover-paper-ppo --seed 0

A run is a chain of segments. Each begins with fresh episodes and seeds of its own, so it depends on the state before
it and on nothing else: an interrupted run goes on with the same command, and ends as it would have ended.
"""

import math
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
import tyro
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv
from tqdm import tqdm

from spidar_gym.benchmark.artifact import Artifact
from spidar_gym.benchmark.row import cores
from spidar_gym.benchmark.track import HOVER
from spidar_gym.control.core import core_path
from spidar_gym.control.crawl_observation import crawl_layout
from spidar_gym.control.observation import Field, layout
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES, ActionMode, find_action_mode
from spidar_gym.errors import InvalidValueError, require_least, require_name
from spidar_gym.terminal import speak_plainly
from train import presets
from train.kinds import Goal, Scaling, TrainingEnv, baseline_scaling, make_training_env, training_seed
from train.learner import ALGORITHMS, Coach, Layers, actor_layers, build, learn_segment, load_state, save_state
from train.referee import Base, Referee
from train.report import evaluate_row
from train.run import Run, State, curve_line, make_artifact


@dataclass(frozen=True)
class Args:
    """Learn what to add to a controller."""

    name: str
    """Of the row: letters, digits, _ and -."""
    doc: str
    """What it is, in one line."""
    env_id: str
    """Environment, with version."""
    tracks: tuple[str, ...]
    """Tracks in whose kinds of environments it learns, and on whose validation scenarios it is judged."""
    base: str
    """Preset of the controller that it adds to."""
    action_mode: str
    """What the action means; `direct` has no controller."""
    sees: tuple[str, ...] = ()
    """Pieces of the observation that the actor sees, by name, while the critic sees all; all if none is given."""
    still: tuple[int, ...] = ()
    """Entries of the action that stay 0."""
    algorithm: str = "ppo"
    """ppo or sac."""
    seed: int = 0
    """Of everything that is drawn."""
    steps: int = 500_000
    """Control ticks to learn from."""
    segment: int = 32_768
    """Ticks between two checkpoints, each with a validation."""
    envs: int = 16
    """Environments side by side."""
    control: str = "core" if core_path().is_file() else "python"
    """python, or core: the compiled controller, several times faster; core where `spidar export --build` made it."""
    scenarios: int = 6
    """Validation scenarios of each track."""
    scaling_ticks: int = 2000
    """Ticks of the baseline in each kind of environment from which the observations' scaling is taken."""
    hold: int = 1
    """Ticks for which the learner holds an action."""
    washout: float = 0.0
    """Time constant with which a constant residual wrench fades [s]; 0 lets it stay."""
    reward: str = "pose"
    """environment, pose, or economy."""
    position: float = 0.01
    """Position error that halves its term of the reward `pose` [m]: like the next three that of the mean track, on the
    others in proportion to the base's own errors, so that no track is learned at another one's cost."""
    attitude: float = 0.02
    """Attitude error that halves its term [rad]."""
    velocity: float = 0.0
    """Velocity that halves a term of its own [m/s]; 0 is no such term."""
    rate: float = 0.0
    """Angular velocity that halves a term of its own [rad/s]; 0 is no such term."""
    penalty: float = 0.05
    """Share of the reward that the largest action costs."""
    reward_shift: float = 0.0
    """Taken off the reward of every tick."""
    reward_scale: float = 1.0
    """Factor of the rest."""
    hidden: int = 64
    """Width of the actor's two hidden layers."""
    critic_hidden: int = 128
    """Width of the critic's."""
    lr: float = 5e-4
    """Learning rate at the beginning."""
    lr_end: float = 5e-5
    """… and at the end."""
    gamma: float = 0.97
    """Discount of a tick, or of the ticks that an action is held."""
    gae_lambda: float = 0.95
    """PPO: λ of the advantages."""
    n_steps: int = 256
    """PPO: decisions of each environment in a rollout."""
    batch_size: int = 2048
    """Samples in a step of the optimiser."""
    epochs: int = 10
    """PPO: passes over a rollout."""
    clip_range: float = 0.2
    """PPO: clip of the probability ratio."""
    target_kl: float = 0.0
    """PPO: a rollout's passes end at this divergence; 0 is no limit."""
    entropy: float = 0.0
    """PPO: weight of the entropy."""
    log_std: float = -2.0
    """Logarithm of the exploration's standard deviation at the beginning."""
    buffer: int = 200_000
    """SAC: size of the replay buffer."""
    warmup: int = 10_000
    """SAC: decisions of the base before learning begins."""
    updates: int = 4
    """SAC: steps of the optimiser after each step of all environments."""
    critic_first: int = 16_384
    """Decisions in which only the critic learns."""
    average: float = 0.9
    """Share of the actor's averaged weights that a rollout leaves; 0 is no averaging."""
    select: bool = True
    """Take the best admissible agent of all validations; else the last one."""
    out: Path = Path("out/train")
    """Folder for runs: NAME/seedK."""
    row: bool = True
    """Evaluate on the test scenarios in the end and write a row of this seed."""

    def __post_init__(self) -> None:
        """Refuse what cannot be learned."""
        require_name("algorithm", self.algorithm, ALGORITHMS)
        least = ("steps", "segment", "envs", "scenarios", "scaling_ticks", "hold", "hidden", "n_steps", "batch_size")
        require_least(1, **{name: getattr(self, name) for name in least})
        require_least(0, seed=self.seed)
        if not self.tracks:
            raise InvalidValueError("tracks", self.tracks, "at least one track")
        for name in ("gamma", "average"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InvalidValueError(name, getattr(self, name), "a number within 0 … 1")
        if self.average == 1.0:
            raise InvalidValueError("average", 1.0, "a number below 1")

    @property
    def arguments(self) -> dict[str, Any]:
        """Of `gym.make`."""
        return {"action_mode": self.action_mode, "preset": self.base}

    @property
    def adds(self) -> bool:
        """Whether there is a controller to add to."""
        return self.action_mode != "direct"


def make_env(args: Args, track: str, scaling: Scaling | None = None, share: float = 1.0) -> TrainingEnv:
    """An environment to learn in; `share` is how large the base's errors are there, over their mean on all tracks."""
    goal = Goal(
        args.reward, share * args.position, share * args.attitude, share * args.velocity, share * args.rate,
        args.penalty, shift=args.reward_shift, scale=args.reward_scale,
    )  # fmt: skip
    return make_training_env(
        track,
        args.arguments,
        goal,
        washout=washout(args),
        still=still(args),
        hold=args.hold,
        scaling=scaling,
        control=args.control,
    )


def make_envs(args: Args, scaling: Scaling, shares: Mapping[str, float] = MappingProxyType({})) -> DummyVecEnv:
    """The environments side by side; the kinds take turns. `shares` are those of `Referee.shares`."""

    def monitored(track: str) -> Monitor:
        return Monitor(make_env(args, track, scaling, shares.get(track, 1.0)))

    return DummyVecEnv([partial(monitored, args.tracks[k % len(args.tracks)]) for k in range(args.envs)])


def hidden(args: Args) -> np.ndarray:
    """Which numbers of the observation the actor does not see (`UnknownNameError` for a piece that there is not)."""
    fields = pieces(args)
    for name in args.sees:
        require_name("piece of the observation", name, [field.name for field in fields])
    return np.concatenate([np.full(f.size, bool(args.sees) and f.name not in args.sees) for f in fields])


def still(args: Args) -> np.ndarray:
    """Which entries of the action stay 0."""
    size = mode(args).size
    for entry in args.still:
        if not 0 <= entry < size:
            raise InvalidValueError("still", entry, f"entries within 0 … {size - 1}")
    return np.isin(np.arange(size), args.still)


def washout(args: Args) -> np.ndarray:
    """Time constant of every entry of the action [s]: only a wrench has integrals that own its constant part."""
    channels = mode(args).channels
    return np.concatenate([np.full(c.size, args.washout if c.name == "wrench" else 0.0) for c in channels])


def mode(args: Args) -> ActionMode:
    """What the action means."""
    return find_action_mode(args.action_mode, ACTION_MODES if args.env_id == HOVER else CRAWL_MODES)


def pieces(args: Args) -> tuple[Field, ...]:
    """Pieces of the observation."""
    return (layout if args.env_id == HOVER else crawl_layout)(mode(args).size)


def artifact(args: Args, layers: Layers, scaling: Scaling, state: State) -> Artifact:
    """An actor as the benchmark's artifact."""
    ppo = args.algorithm == "ppo"
    return make_artifact(
        layers, scaling, state, name=args.name, kind="residual" if args.adds else "learned", doc=args.doc,
        env_id=args.env_id, arguments=args.arguments, activation="tanh" if ppo else "relu",
        output="clip" if ppo else "tanh", washout=washout(args),
        training={"seed": args.seed, "steps": state.segment * args.segment, "chosen_at": state.best_steps},
    )  # fmt: skip


def learn(args: Args, *, on_segment: Callable[[dict[str, Any]], object] = lambda _: None) -> Path:
    """One run, from its beginning or from where it was interrupted.

    Args:
        args: Settings.
        on_segment: Called with each line of the curve.

    Returns:
        The path of the artifact.
    """
    torch.set_num_threads(1)
    settings = {k: v for k, v in asdict(args).items() if k not in ("out", "row")}
    run = Run(args.out / args.name / f"seed{args.seed}", settings, args.env_id, args.arguments)
    state = run.load() or State()
    segments = max(1, round(args.steps / args.segment))

    bar = tqdm(total=segments * args.segment, unit="tick", unit_scale=True, file=sys.__stderr__)
    bar.set_description(f"{args.name} seed {args.seed}")
    bar.set_postfix_str("playing the base")
    referee = Referee(
        args.tracks, Base(args.arguments if args.adds else {"preset": args.base}), args.scenarios, control=args.control
    )

    state.base = referee.means

    # What the network is shown is scaled by what the baseline sees, once and for all; without one, by what it will
    # see itself: nothing but falls, in which every error is far beyond those of a flight that is held level.
    if not state.scaling:
        kinds = [make_env(args, track) for track in args.tracks]
        spread = 0.0 if args.adds else math.exp(args.log_std)
        state.scaling = vars(baseline_scaling(kinds, args.seed, args.scaling_ticks // args.hold, spread))
    scaling = Scaling(**state.scaling)

    envs = make_envs(args, scaling, referee.shares())
    model = build(args, envs, str(run.folder / "tensorboard"), hidden(args), still(args))
    if state.learner:
        load_state(model, state.learner)
    else:
        state.mean = state.best = actor_layers(model)
        if args.adds:
            referee.require_equal(artifact(args, state.mean, scaling, state))

    bar.update(state.segment * args.segment)
    coach = Coach(args.average, args.critic_first, state.mean, lambda n: bar.update(n * args.hold))
    while state.segment < segments:
        began, share = time.perf_counter(), state.segment / segments
        learn_segment(
            model, envs, coach, steps=args.segment // args.hold, seed=training_seed(args.seed, 1, state.segment),
            lr=args.lr + (args.lr_end - args.lr) * share, first=state.segment == 0,
        )  # fmt: skip
        state.segment, state.mean, state.learner = state.segment + 1, coach.mean, save_state(model)
        steps = state.segment * args.segment
        verdict = referee.judge(artifact(args, state.mean, scaling, state))
        if not args.select or (verdict.admissible and verdict.score < state.best_score):
            state.best, state.best_score, state.best_steps = state.mean, verdict.score, steps
        state.seconds += time.perf_counter() - began
        state.curve.append(curve_line(steps, state.seconds, verdict, _reward(model)))
        _log(model, state.curve[-1])
        run.save(state)
        bar.set_postfix_str(f"against the base {verdict.score:+.1%}, worst {verdict.worst:+.1%}")
        on_segment(state.curve[-1])
    bar.close()
    envs.close()
    run.write_curve(state)
    return run.publish(artifact(args, state.best, scaling, state))


def _reward(model: BaseAlgorithm) -> float | None:
    """Training reward of a decision, mean over the last episodes."""
    episodes = [episode["r"] / episode["l"] for episode in model.ep_info_buffer or ()]
    return float(np.mean(episodes)) if episodes else None


def _log(model: BaseAlgorithm, line: dict[str, Any]) -> None:
    """The validation, for TensorBoard."""
    for name in ("score", "worst", "success"):
        model.logger.record(f"validation/{name}", line[name])
    for track, cell in line["cells"].items():
        for metric, value in cell.items():
            model.logger.record(f"validation/{track}/{metric}", value)
    model.logger.dump(model.num_timesteps)


def main() -> None:
    """Entry point."""
    options = {name: (str(values["doc"]), Args(**values)) for name, values in presets.RESIDUAL.items()}
    args = tyro.extras.overridable_config_cli(options, description=__doc__, prog="python -m train.residual")
    path = learn(args)
    print(f"{path}: {args.name}, seed {args.seed}")
    if args.row:
        print(evaluate_row(path, args.tracks, args.out / "scores", args.base, workers=cores()))


if __name__ == "__main__":
    speak_plainly("train.residual", main)
