"""Learn what to add to a controller: PPO or SAC in the environments of the tracks' kinds, judged against the base.

    python -m train.residual hover-paper-ppo --seed 0

A run is a chain of segments. Each begins with fresh episodes and seeds of its own, so it depends on the state before
it and on nothing else: an interrupted run goes on with the same command, and ends as it would have ended.

Read `Args`, then `learn`; how the agent is made and what an update is stands in `train/lib/agent.py`.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from spidar_gym.benchmark.track import CRAWL, HOVER
from spidar_gym.cli.console import kept, run_cli
from spidar_gym.errors import require_least
from spidar_gym.policies.artifact import Artifact
from spidar_gym.processes import cpu_count
from train.lib.config import CONTROL, Recipe, parse
from train.lib.envs import NOMINAL, EnvConfig, Scaling, training_seed
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.learner import Layers, LearnerConfig, PPOConfig
from train.lib.report import report
from train.lib.rewards import RewardConfig
from train.lib.run import Run, State, curve_line, layer_arrays, make_artifact, require_frameworks
from train.lib.stages import Stages, scalars

if TYPE_CHECKING:
    from train.lib.agent import Agent
    from train.lib.vector import TrainingVec


@dataclass(frozen=True)
class ScheduleConfig:
    """How long it learns, and in which portions."""

    steps: int = 500_000
    """Control ticks to learn from."""
    segment: int = 32_768
    """Ticks between two checkpoints, each with a validation."""
    envs: int = 16
    """Robots side by side."""
    threads: int = 2
    """Threads that carry them; no number depends on how many."""
    scaling_ticks: int = 2000
    """Ticks of the baseline in each kind of environment from which the observations' scaling is taken."""

    def __post_init__(self) -> None:
        require_least(1, **vars(self))


@dataclass(frozen=True)
class EvaluationConfig:
    """How agents are compared with the base, and which one is taken."""

    scenarios: int = 6
    """Validation scenarios of each track."""
    select: bool = True
    """Take the best admissible agent of all validations; else the last one."""

    def __post_init__(self) -> None:
        require_least(1, scenarios=self.scenarios)


@dataclass(frozen=True)
class Args(Recipe):
    """Learn what to add to a controller."""

    env: EnvConfig
    reward: RewardConfig = field(default_factory=lambda: RewardConfig("pose"))
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)


MOMENTUM = ("leg_momentum", "leg_momentum_rate")
"""What of the joints' motion turns the torso: six numbers, so that a gradient is not lost in the noise of two hundred
others."""
FLIGHT_REWARD = RewardConfig(
    "pose",
    # Velocities respond within two or three ticks, the pose after ten or twenty: with them a short horizon is enough.
    velocity=0.03,
    rate=0.06,
    reward_shift=0.5,
    reward_scale=0.5,
)
"""Reward of PPO in flight."""
FLIGHT_LEARNER = LearnerConfig(
    hidden=32,
    gamma=0.88,
    lr=1e-3,
    lr_end=1e-4,
    # Small batches: the critic needs many steps before its advantages mean anything.
    batch_size=504,
    critic_first=8064,
    average=0.8,
    ppo=PPOConfig(n_steps=336, target_kl=0.03),
)
"""PPO in flight, whatever it adds to."""
FLIGHT_SCHEDULE = ScheduleConfig(segment=48_384, envs=24)
"""Schedule of PPO in flight."""
FLIGHT_ENV = EnvConfig(
    HOVER,
    NOMINAL,
    "paper",
    "residual_wrench",
    sees=MOMENTUM,
    # At 40 Hz most of the noise is lost in the rotors and servos; at 20 Hz less.
    hold=2,
    washout=1.0,
)
"""Flights of PPO."""
PRESETS: dict[str, Args] = {
    "hover-paper-ppo": Args(
        "ppo_paper",
        "PPO: a wrench residual with washout on the paper's gains.",
        FLIGHT_ENV,
        replace(FLIGHT_REWARD, position=0.01, attitude=0.015),
        FLIGHT_LEARNER,
        FLIGHT_SCHEDULE,
    ),
    "hover-tuned-ppo": Args(
        "ppo_tuned",
        "PPO: a residual torque with washout on `tuned`.",
        # Forces stay still: what is left of the position's error is too small to be found in the noise of three more.
        replace(FLIGHT_ENV, base="tuned", still=(0, 1, 2)),
        replace(FLIGHT_REWARD, position=0.003, attitude=0.004, velocity=0.0),
        replace(FLIGHT_LEARNER, average=0.9),
        FLIGHT_SCHEDULE,
    ),
    "hover-paper-sac": Args(
        "sac_paper",
        "SAC: a wrench residual with washout on the paper's gains.",
        EnvConfig(HOVER, NOMINAL, "paper", "residual_wrench", washout=2.0),
        RewardConfig("pose", position=0.01, attitude=0.015),
        LearnerConfig("sac", lr=3e-4, lr_end=3e-4, batch_size=256),
    ),
    "crawl-ppo": Args(
        "ppo_crawl",
        "PPO: gait parameters and leg forces by phase on the crawler `robust_overlapped`.",
        EnvConfig(
            CRAWL,
            ("ground-randomised",),
            "robust_overlapped",
            "residual_gait_force",
            sees=("phase", "phase_time", "share", "steps_left", "goal_position", "goal_heading"),
            still=(2,),  # the stride: what it adds to the path is missing at the goal
            hold=10,
        ),
        RewardConfig("economy", reward_scale=10.0),
        LearnerConfig(
            log_std=-1.5,
            lr=1e-3,
            lr_end=1e-4,
            gamma=0.9,
            batch_size=128,
            critic_first=2048,
            average=0.7,
            ppo=PPOConfig(gae_lambda=0.9, n_steps=64, target_kl=0.03),
        ),
        ScheduleConfig(segment=40_960),
        EvaluationConfig(scenarios=12),
    ),
    "hover-direct-ppo": Args(
        "ppo_direct",
        "PPO from nothing: thrust, vectoring angles and joint targets, no controller.",
        EnvConfig(HOVER, ("flight-paper",), "paper", "direct"),
        RewardConfig("environment"),
        LearnerConfig(gamma=0.99, batch_size=512, critic_first=0, ppo=PPOConfig(target_kl=0.03)),
        evaluation=EvaluationConfig(select=False),
    ),
}
"""Settings by name."""


def make_robots(
    args: Args, scaling: Scaling, relative_errors: Mapping[str, float] = MappingProxyType({})
) -> "TrainingVec":
    """The robots to learn on; the tracks take turns.

    Args:
        args: Settings.
        scaling: Scaling of the observations.
        relative_errors: Those of `PairedEvaluator.relative_errors`; 1 where a track has none.
    """
    # Loaded by those who learn, as torch is: whoever asks for help need not have it.
    from train.lib.vector import TrainingVec

    return TrainingVec(
        args.env, args.reward, args.schedule.envs, scaling=scaling, relative_errors=relative_errors,
        threads=args.schedule.threads,
    )  # fmt: skip


def make_agent(args: Args, envs: "TrainingVec", logs: str | None = None) -> "Agent":
    """An agent that adds nothing yet."""
    from train.lib.agent import build

    hidden, still = args.env.hidden_entries(), args.env.still_entries()
    return build(args.learner, envs, args.seed, logs=logs, hidden=hidden, still=still)


def make_scaling(args: Args, on_tick: Callable[[], object] = lambda: None) -> Scaling:
    """What the network is shown is scaled by what the baseline sees, once and for all.

    Without a controller it is scaled by what the network will see itself: the baseline's are nothing but falls, in
    which every error is far beyond those of a flight that is held level.
    """
    from train.lib.vector import baseline_scaling

    spread = 0.0 if args.env.adds else math.exp(args.learner.log_std)
    return baseline_scaling(args.env, args.seed, args.schedule.scaling_ticks // args.env.hold, spread, on_tick)


def artifact(args: Args, layers: Layers, scaling: Scaling, state: State) -> Artifact:
    """An actor as the benchmark's artifact."""
    env, ppo = args.env, args.learner.algorithm == "ppo"
    return make_artifact(
        layers, scaling, state, name=args.name, kind="residual" if env.adds else "learned", doc=args.doc,
        env_id=env.env_id, arguments=env.arguments, activation="tanh" if ppo else "relu",
        output="clip" if ppo else "tanh", washout=env.washout_times(),
        training={"seed": args.seed, "steps": state.segment * args.schedule.segment, "chosen_at": state.best_steps},
    )  # fmt: skip


def learn(args: Args, *, on_segment: Callable[[dict[str, Any]], object] = lambda _: None) -> Path:
    """One run, from its beginning or from where it was interrupted.

    Args:
        args: Settings.
        on_segment: Called with each line of the curve.

    Returns:
        The path of the artifact.
    """
    require_frameworks()
    run = Run.of(args, args.env.env_id, args.env.arguments)
    state = run.load() or State()
    with (
        kept(lambda: f"{state.segment * args.schedule.segment} ticks kept in {run.folder}; the same command goes on"),
        Stages(f"{args.name} seed {args.seed}") as stages,
    ):
        return _learn(args, run, state, stages, on_segment)


def _learn(
    args: Args, run: Run, state: State, stages: Stages, on_segment: Callable[[dict[str, Any]], object]
) -> Path:  # fmt: skip
    """Learn from a state on; the path of the artifact."""
    from train.lib import agent

    env, learner, schedule = args.env, args.learner, args.schedule
    segments = max(1, round(schedule.steps / schedule.segment))

    stages.begin("playing the base", len(env.tracks) * args.evaluation.scenarios, "scenario")
    base = Base(env.arguments if env.adds else {"preset": env.base})
    evaluator = PairedEvaluator(env.tracks, base, args.evaluation.scenarios, control=CONTROL, on_scenario=stages.count)
    state.base = evaluator.means

    if not state.scaling:
        ticks = len(env.tracks) * (schedule.scaling_ticks // env.hold)
        stages.begin("scaling the observations", ticks, "tick")
        state.scaling = vars(make_scaling(args, stages.count))
    size = len(env.hidden_entries())
    run.require_alike(state.scaling, vars(Scaling(np.zeros(size), np.ones(size))))
    scaling = Scaling(**state.scaling)

    envs = make_robots(args, scaling, evaluator.relative_errors())
    model = make_agent(args, envs, str(run.folder / "tensorboard"))
    if state.learner:
        for name, layers in (("mean", state.mean), ("best", state.best)):
            run.require_alike(layer_arrays(name, layers), layer_arrays(name, agent.actor_layers(model)))
            artifact(args, layers, scaling, state)  # it refuses what is no network
        run.require_alike(state.learner, agent.save_state(model))
        agent.load_state(model, state.learner)
    else:
        state.mean = state.best = agent.actor_layers(model)
        if env.adds:
            evaluator.require_same_as_base(artifact(args, state.mean, scaling, state))

    def on_steps(decisions: int) -> None:
        stages.count(decisions * env.hold)
        stages.say("learning" if model.num_timesteps >= learner.critic_first else "warming up the critic")

    stages.begin("learning", segments * schedule.segment, "tick", state.segment * schedule.segment)
    actor = agent.ActorSchedule(learner, state.mean, on_steps)
    while state.segment < segments:
        began = time.perf_counter()
        agent.learn_segment(
            model, envs, actor,
            steps=schedule.segment // env.hold,
            seed=training_seed(args.seed, 1, state.segment),
            lr=learner.lr + (learner.lr_end - learner.lr) * (state.segment / segments),
            first=state.segment == 0,
        )  # fmt: skip
        state.segment, state.mean, state.learner = state.segment + 1, actor.mean, agent.save_state(model)
        steps = state.segment * schedule.segment

        stages.say("playing against the base")
        verdict = evaluator.evaluate(artifact(args, state.mean, scaling, state))
        stages.evaluated(verdict)
        if not args.evaluation.select or (verdict.admissible and verdict.score < state.best_score):
            state.best, state.best_score, state.best_steps = state.mean, verdict.score, steps

        state.seconds += time.perf_counter() - began
        line = curve_line(steps, state.seconds, verdict, _reward(model))
        state.curve.append(line)
        for name, value in scalars(line):
            model.logger.record(name, value)
        model.logger.dump(model.num_timesteps)
        run.save(state)
        on_segment(line)
    envs.close()
    run.write_curve(state)
    return run.publish(artifact(args, state.best, scaling, state))


def _reward(model: "Agent") -> float | None:
    """Training reward of a decision, mean over the last episodes."""
    episodes = [episode["r"] / episode["l"] for episode in model.ep_info_buffer or ()]
    return float(np.mean(episodes)) if episodes else None


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.residual", __doc__)
    report(learn(args), args, args.env.env_id, args.env.tracks, args.env.base, workers=cpu_count())


if __name__ == "__main__":
    run_cli("train.residual", main)
