"""Learn what to add to a controller: PPO or SAC in the environments of the tracks' kinds, judged against the base.

    python -m train.residual hover-paper-ppo --seed 0

A run is a chain of segments. Each begins with fresh episodes and seeds of its own, so it depends on the state before
it and on nothing else: an interrupted run goes on with the same command, and ends as it would have ended.

Read `Args`, then `learn`; how the agent is made and what an update is stands in `train/lib/agent.py`.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from spidar_gym.benchmark.track import CRAWL, HOVER, TRACKS
from spidar_gym.cli.console import kept, run_cli
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies import torso
from spidar_gym.policies.artifact import Artifact, LearnedPolicy
from spidar_gym.processes import cpu_count
from spidar_gym.robot import N_ROTORS
from train.lib.config import CONTROL, EvaluationConfig, Recipe, ScheduleConfig, parse
from train.lib.envs import NOMINAL, EnvConfig, Scaling, training_seed
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.learner import Layers, LearnerConfig, PPOConfig
from train.lib.origin import find_origin, first_layers
from train.lib.report import report
from train.lib.rewards import RewardConfig
from train.lib.run import Run, State, curve_line, layer_arrays, make_artifact, require_frameworks
from train.lib.stages import Stages, scalars

if TYPE_CHECKING:
    from train.lib.agent import Agent
    from train.lib.vector import TrainingVec

Last = TypeVar("Last", float, float | None)


@dataclass(frozen=True)
class Args(Recipe):
    """Learn what to add to a controller."""

    env: EnvConfig
    reward: RewardConfig = field(default_factory=lambda: RewardConfig("pose"))
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    start: str = ""
    """Artifact whose network it begins as, and with which it is compared, {seed} standing for the run's; none: it
    begins as what adds nothing."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.learner.symmetric and not self.env.torso:
            raise InvalidValueError("symmetric", True, "False but in the torso's axes")


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
DIRECT_TRACKS = tuple(name for name, track in TRACKS.items() if track.flies)
"""All flights: a network without a controller is one for every track."""
JOINTS = tuple(range(3 * N_ROTORS, torso.ACTION))
"""Entries with which a network would lead joints off their form: they go there by themselves; shaking tells nothing."""
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
    "hover-direct": Args(
        "direct",
        "PPO from nothing: forces and joints in torso axes, no controller, no teacher.",
        EnvConfig(
            HOVER,
            DIRECT_TRACKS,
            "paper",
            "direct",
            ("flight-paper", "flight-forms", "flight-fast3"),
            still=JOINTS,
            torso=True,
            trace_times=(0.2, 1.0, 5.0),
        ),
        reward=RewardConfig(
            "pose",
            position=0.05,
            attitude=0.05,
            velocity=0.2,
            rate=0.5,
            # Wide terms beside the narrow ones: from nothing, errors are far beyond those.
            far_position=0.3,
            far_attitude=0.3,
            joint=0.1,
            penalty=0.0,
            # Nothing below 0: from nothing, whoever loses by flying on learns to fall.
            reward_scale=0.1,
        ),
        learner=LearnerConfig(
            hidden=128,
            skip=True,
            symmetric=True,
            # 2 N at first, enough to learn from falls; 0.4 N in the end, for millimetres are lost in more.
            action_scale=0.2,
            log_std=0.0,
            log_std_end=-1.6,
            lr=1e-3,
            lr_end=5e-5,
            gamma=0.98,
            batch_size=1792,
            critic_first=0,
            average=0.8,
            ppo=PPOConfig(n_steps=64, epochs=5, target_kl=0.06),
        ),
        schedule=ScheduleConfig(steps=6_021_120, first_steps=1_500_000, segment=286_720, envs=112),
        evaluation=EvaluationConfig(scenarios=4, select=False),
    ),
    "hover-distilled-ppo": Args(
        "distilled_ppo",
        "PPO: the network of `distilled`, improved on all flights.",
        EnvConfig(HOVER, DIRECT_TRACKS, "tuned", "direct", still=JOINTS, torso=True, trace_times=(0.2, 1.0, 5.0, 30.0)),
        # Each error in units of what is left of it, and an exploration that is not much larger.
        RewardConfig(
            "pose", position=0.003, attitude=0.003, velocity=0.01, rate=0.02, apart=True, penalty=0.0, reward_scale=0.2
        ),
        LearnerConfig(
            activation="relu",
            skip=True,
            symmetric=True,
            last_layer=True,
            # 0.1 N, ten times what a 1 of the learner is.
            action_scale=0.001,
            log_std=2.3,
            log_std_end=2.3,
            lr=3e-4,
            lr_end=3e-5,
            gamma=0.98,
            batch_size=3584,
            critic_first=143_360,
            average=0.8,
            ppo=PPOConfig(n_steps=128, epochs=4, target_kl=0.05),
        ),
        ScheduleConfig(steps=2_007_040, segment=200_704, envs=112),
        EvaluationConfig(scenarios=12),
        start="baselines/learned/distilled/seed{seed}.npz",
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
    args: Args,
    scaling: Scaling,
    relative_errors: Mapping[str, Sequence[float]] = MappingProxyType({}),
    tracks: Sequence[str] = (),
) -> "TrainingVec":
    """The robots to learn on; the tracks take turns.

    Args:
        args: Settings.
        scaling: Scaling of the observations.
        relative_errors: Those of `PairedEvaluator.relative_errors`; 1 where a track has none.
        tracks: Other tracks than the settings'.
    """
    # Loaded by those who learn, as torch is: whoever asks for help need not have it.
    from train.lib.vector import TrainingVec

    env = replace(args.env, tracks=tuple(tracks)) if tracks else args.env
    return TrainingVec(
        env, args.reward, args.schedule.envs, scaling=scaling, relative_errors=relative_errors,
        action_scale=args.learner.action_scale, threads=args.schedule.threads,
    )  # fmt: skip


def make_agent(args: Args, envs: "TrainingVec", logs: str | None = None) -> "Agent":
    """An agent that adds nothing yet."""
    from train.lib.agent import build

    hidden, still = args.env.hidden_entries(), args.env.still_entries()
    turns = (args.env.shown_turn(), torso.SAID_TURN) if args.learner.symmetric else None
    return build(args.learner, envs, args.seed, logs=logs, hidden=hidden, still=still, turns=turns)


def make_scaling(args: Args, on_tick: Callable[[], object] = lambda: None) -> Scaling:
    """What the network is shown is scaled by what the baseline sees, once and for all.

    Without a controller it is scaled by what the network will see itself: the baseline's are nothing but falls, in
    which every error is far beyond those of a flight that is held level.
    """
    from train.lib.vector import baseline_scaling

    spread = 0.0 if args.env.adds else args.learner.action_scale * math.exp(args.learner.log_std)
    found = baseline_scaling(args.env, args.seed, args.schedule.scaling_ticks // args.env.hold, spread, on_tick)
    return found.alike(args.env.shown_turn()) if args.learner.symmetric else found


def artifact(args: Args, layers: Layers, scaling: Scaling, state: State) -> Artifact:
    """An actor as the benchmark's artifact."""
    env, ppo = args.env, args.learner.algorithm == "ppo"
    output = "torso" if env.torso else "clip" if ppo else "tanh"
    skip = np.zeros((0, 0), np.float32)
    *first, (weight, bias) = layers
    weight, bias = args.learner.action_scale * weight, args.learner.action_scale * bias
    if args.learner.skip:
        weight, skip = np.split(weight, [len(layers[-2][1])], axis=1)
    layers = (*first, (weight, bias))
    return make_artifact(
        layers, scaling, state, name=args.name, kind="residual" if env.adds else "learned", doc=args.doc,
        env_id=env.env_id, arguments=env.arguments, activation=args.learner.activation if ppo else "relu",
        output=output, washout=np.zeros(0) if env.torso else env.washout_times(), skip=skip,
        traced=env.traced.astype(float), trace_times=np.array(env.trace_times, float),
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
        Stages(f"{args.name} seed {args.seed}", state.parts) as stages,
    ):
        return _learn(args, run, state, stages, on_segment)


class Course:
    """The robots to learn on: first those of a few tracks, then those of all."""

    def __init__(self, args: Args, scaling: Scaling, relative_errors: Mapping[str, Sequence[float]]) -> None:
        """Take the settings; robots are made when they are asked for."""
        self._args, self._make = args, partial(make_robots, args, scaling, relative_errors)
        self._tracks: tuple[str, ...] = ()
        self._now: TrainingVec | None = None

    def robots(self, segment: int) -> "TrainingVec":
        """Those of a segment."""
        schedule, env = self._args.schedule, self._args.env
        tracks = env.first_tracks if segment * schedule.segment < schedule.first_steps else env.tracks
        if self._now is None or tracks != self._tracks:
            self.close()
            self._tracks, self._now = tracks, self._make(tracks)
        return self._now

    def close(self) -> None:
        """Stop their threads."""
        if self._now is not None:
            self._now.close()


def _first_scaling(args: Args, origin: Artifact | None, stages: Stages) -> Scaling:
    """How what is seen enters the network: as in the one that it begins as, else by what the baseline sees."""
    if origin is not None:
        return Scaling(origin.mean, origin.variance, origin.clip)
    ticks = len(args.env.tracks) * (args.schedule.scaling_ticks // args.env.hold)
    stages.begin("scaling the observations", ticks, "tick", "rest")
    return make_scaling(args, stages.count)


def _learn(
    args: Args, run: Run, state: State, stages: Stages, on_segment: Callable[[dict[str, Any]], object]
) -> Path:  # fmt: skip
    """Learn from a state on; the path of the artifact."""
    from train.lib import agent

    env, learner, schedule = args.env, args.learner, args.schedule
    segments = max(1, round(schedule.steps / schedule.segment))

    stages.begin("playing the base", len(env.tracks) * args.evaluation.scenarios, "scenario", "validation")
    origin = find_origin(args.start, args.seed, env, learner)
    base = Base(env.arguments if env.adds else {"preset": env.base}) if origin is None else LearnedPolicy(origin)
    evaluator = PairedEvaluator(env.tracks, base, args.evaluation.scenarios, control=CONTROL, on_scenario=stages.count)
    state.base = evaluator.means

    if not state.scaling:
        state.scaling = vars(_first_scaling(args, origin, stages))
    size = len(env.hidden_entries())
    run.require_alike(state.scaling, vars(Scaling(np.zeros(size), np.ones(size))))
    scaling = Scaling(**state.scaling)

    course = Course(args, scaling, evaluator.relative_errors(apart=args.reward.apart))
    model = make_agent(args, course.robots(state.segment), str(run.folder / "tensorboard"))
    if origin is not None:
        agent.set_actor(model, first_layers(origin, learner.action_scale))
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
        warm = model.num_timesteps >= learner.critic_first
        stages.say("learning" if warm else "warming up the critic", "policy")

    stages.begin("learning", segments * schedule.segment, "tick", "policy", state.segment * schedule.segment)
    actor = agent.ActorSchedule(learner, state.mean, on_steps)
    while state.segment < segments:
        began, done = time.perf_counter(), state.segment / segments
        robots = course.robots(state.segment)
        agent.learn_segment(
            model, robots, actor,
            steps=schedule.segment // env.hold,
            seed=training_seed(args.seed, 1, state.segment),
            lr=_between(learner.lr, learner.lr_end, done),
            first=state.segment == 0,
            log_std=_between(learner.log_std, learner.log_std_end, done),
        )  # fmt: skip
        stages.say("learning", "policy")
        stages.hand_over({**robots.spent(), "learner": actor.spent()})
        state.segment, state.mean, state.learner = state.segment + 1, actor.mean, agent.save_state(model)
        steps = state.segment * schedule.segment

        stages.say("playing against the base", "validation")
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
    course.close()
    run.write_curve(state)
    return run.publish(artifact(args, state.best, scaling, state))


def _between(first: float, last: Last, done: float) -> Last:
    """What changes evenly from `first` to `last`, when this fraction of the run is done; None where nothing does."""
    return last if last is None else first + (last - first) * done


def _reward(model: "Agent") -> float | None:
    """Training reward of a decision, mean over the last episodes."""
    episodes = [episode["r"] / episode["l"] for episode in model.ep_info_buffer or ()]
    return float(np.mean(episodes)) if episodes else None


def main() -> None:
    """Entry point."""
    args = parse(PRESETS, "python -m train.residual", __doc__)
    origin = find_origin(args.start, args.seed, args.env, args.learner)
    base = args.env.base if origin is None else origin.name
    report(learn(args), args, args.env.env_id, args.env.tracks, base, workers=cpu_count())


if __name__ == "__main__":
    run_cli("train.residual", main)
