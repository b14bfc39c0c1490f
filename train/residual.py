"""Train a policy by PPO or SAC, usually as a residual on a controller, and compare it with that controller.

    python -m train.residual hover-paper-ppo --seed 0

A run is a chain of segments. Each begins with new episodes and its own seeds, so it depends only on the state before
it. The same command resumes an interrupted run, with the same result as without the interruption.

To read the code, begin with `Args` in `train/lib/settings.py`, then `learn`. The agent and its updates are in
`train/lib/agent.py`.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from spidar_gym.console import kept, run_cli
from spidar_gym.policies import torso
from spidar_gym.policies.artifact import Artifact, LearnedPolicy
from spidar_gym.processes import cpu_count
from train.lib.config import CONTROL, parse
from train.lib.envs import Scaling, training_seed
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.learner import Layers
from train.lib.origin import find_origin, first_layers
from train.lib.report import report
from train.lib.run import Run, State, curve_line, layer_arrays, make_artifact, require_frameworks
from train.lib.settings import PRESETS, Args
from train.lib.stages import Stages, scalars

if TYPE_CHECKING:
    from train.lib.agent import Agent
    from train.lib.vector import TrainingVec

Last = TypeVar("Last", float, float | None)


def make_robots(
    args: Args,
    scaling: Scaling,
    relative_errors: Mapping[str, Sequence[float]] = MappingProxyType({}),
    tracks: Sequence[str] = (),
) -> "TrainingVec":
    """Create the training robots, with the tracks assigned in turn.

    Args:
        args: Settings.
        scaling: Scaling of the observations.
        relative_errors: Errors from `PairedEvaluator.relative_errors`; 1 for tracks not listed.
        tracks: Tracks to use instead of those of the settings.
    """
    # Imported late so that `--help` works without torch.
    from train.lib.vector import TrainingVec

    env = replace(args.env, tracks=tuple(tracks)) if tracks else args.env
    return TrainingVec(
        env, args.reward, args.schedule.envs, scaling=scaling, relative_errors=relative_errors,
        action_scale=args.learner.action_scale, threads=args.schedule.threads,
    )  # fmt: skip


def make_agent(args: Args, envs: "TrainingVec", logs: str | None = None) -> "Agent":
    """Build an agent with a mean action of zero."""
    from train.lib.agent import build

    hidden, still = args.env.hidden_entries(), args.env.still_entries()
    turns = (args.env.shown_turn(), torso.SAID_TURN) if args.learner.symmetric else None
    return build(args.learner, envs, args.seed, logs=logs, hidden=hidden, still=still, turns=turns)


def make_scaling(args: Args, on_tick: Callable[[], object] = lambda: None) -> Scaling:
    """Determine the scaling of the observations from flights of the baseline; it stays constant during the run.

    Without a controller, random actions are used instead of zero actions, as the untrained network will explore.
    """
    from train.lib.vector import baseline_scaling

    spread = 0.0 if args.env.adds else args.learner.action_scale * math.exp(args.learner.log_std)
    found = baseline_scaling(args.env, args.seed, args.schedule.scaling_ticks // args.env.hold, spread, on_tick)
    if args.env.torso:
        found = args.env.enlarge_errors(found, args.learner.enlarged)
    return found.alike(args.env.shown_turn()) if args.learner.symmetric else found


def artifact(args: Args, layers: Layers, scaling: Scaling, state: State) -> Artifact:
    """Build the artifact of an actor."""
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
    """Start or resume a run.

    Args:
        args: Settings.
        on_segment: Called with each line of the curve.

    Returns:
        Path of the artifact.
    """
    require_frameworks()
    run = Run.of(args, args.env.env_id, args.env.arguments)
    state = run.load() or State()
    with (
        kept(lambda: f"{state.segment * args.schedule.segment} ticks kept in {run.folder}; the same command resumes"),
        Stages(f"{args.name} seed {args.seed}", state.parts) as stages,
    ):
        return _learn(args, run, state, stages, on_segment)


class Course:
    """Curriculum of training robots: first those of `first_tracks`, then those of all tracks."""

    def __init__(self, args: Args, scaling: Scaling, relative_errors: Mapping[str, Sequence[float]]) -> None:
        """Store the settings; robots are created on demand."""
        self._args, self._make = args, partial(make_robots, args, scaling, relative_errors)
        self._tracks: tuple[str, ...] = ()
        self._now: TrainingVec | None = None

    def robots(self, segment: int) -> "TrainingVec":
        """Return the robots of a segment."""
        schedule, env = self._args.schedule, self._args.env
        tracks = env.first_tracks if segment * schedule.segment < schedule.first_steps else env.tracks
        if self._now is None or tracks != self._tracks:
            self.close()
            self._tracks, self._now = tracks, self._make(tracks)
        return self._now

    def close(self) -> None:
        """Stop the threads of the robots."""
        if self._now is not None:
            self._now.close()


def _first_scaling(args: Args, origin: Artifact | None, stages: Stages) -> Scaling:
    """Return the scaling of the initial artifact if there is one; otherwise determine it from the baseline."""
    if origin is not None:
        return Scaling(origin.mean, origin.variance, origin.clip)
    ticks = len(args.env.tracks) * (args.schedule.scaling_ticks // args.env.hold)
    stages.begin("scaling the observations", ticks, "tick", "rest")
    return make_scaling(args, stages.count)


def _learn(
    args: Args, run: Run, state: State, stages: Stages, on_segment: Callable[[dict[str, Any]], object]
) -> Path:  # fmt: skip
    """Continue the run from a state; return the path of the artifact."""
    from train.lib import agent

    env, learner, schedule = args.env, args.learner, args.schedule
    segments = max(1, round(schedule.steps / schedule.segment))

    stages.begin("evaluating the base", len(env.tracks) * args.evaluation.scenarios, "scenario", "validation")
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
            artifact(args, layers, scaling, state)  # raises an error for invalid layers
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

        stages.say("comparing with the base", "validation")
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
    """Interpolate linearly from `first` to `last` at this fraction of the run; None if `last` is None."""
    return last if last is None else first + (last - first) * done


def _reward(model: "Agent") -> float | None:
    """Return the training reward per decision, averaged over the last episodes; None before the first one ends."""
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
