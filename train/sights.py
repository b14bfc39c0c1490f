"""Compare observation modes in Stable-Baselines3: CPU time of an update, and the result of a minute of learning.

    python -m train.sights

The minute is CPU time, so that the load of the machine has no effect. On crawls of 0.2 m in a random direction, SAC
learns a residual on the timing of the gait's phases. On flights of randomised robots in wind, PPO learns a residual
wrench.
"""

import time
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import tyro

from spidar_gym.arguments import Flag
from spidar_gym.benchmark.track import CRAWL, HOVER
from spidar_gym.cli.bench import machine
from spidar_gym.console import run_cli
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import require_above, require_least, require_name
from spidar_gym.files import json_text
from spidar_gym.text import format_table
from train.lib.run import FRAMEWORKS, require_frameworks

ROBOTS, JUDGED = 8, 16
"""Number of robots in training and in evaluation."""
JUDGED_SEED = 1000
"""Seed of the evaluation, different from all training seeds."""
CRAWLS = {"distance": 0.2, "schedule": "overlapped", "max_episode_steps": 400}
FLIGHTS = {
    "forms": "equal", "joint_speed": 0.6, "sensors": True, "randomization": 1.0, "disturbances": {"wind": 2.0},
    "max_episode_steps": 400,
}  # fmt: skip
HEADS = (
    "learner",
    "steps",
    "updates",
    "processor, ms an update",
    "the controller alone",
    "learned",
    "returns foreseen",
)


@dataclass(frozen=True)
class Case:
    """A learner and its environment."""

    env_id: str
    """Environment id."""
    options: dict[str, Any]
    """Arguments of the environment."""
    policy: str
    """Name of the policy, of Stable-Baselines3 or `AsymmetricPolicy`."""
    hindsight: bool = False
    """Whether the replay buffer relabels goals in hindsight (HER)."""


CASES = {
    "crawl, flat, SAC": Case(CRAWL, CRAWLS, "MlpPolicy"),
    "crawl, goal, SAC with HER": Case(
        CRAWL, CRAWLS | {"observation": "goal", "goal_reward": "dense"}, "MultiInputPolicy", hindsight=True
    ),
    "hover, flat, PPO": Case(HOVER, FLIGHTS, "MlpPolicy"),
    "hover, both see all, PPO": Case(HOVER, FLIGHTS | {"observation": "asymmetric"}, "MultiInputPolicy"),
    "hover, the critic sees more, PPO": Case(HOVER, FLIGHTS | {"observation": "asymmetric"}, "AsymmetricPolicy"),
}


@dataclass(frozen=True)
class Args:
    """Train each learner for a fixed CPU time, and report the CPU time of an update and the result."""

    only: tuple[str, ...] = ()
    """Names of the learners to train; all if not given."""
    seconds: float = 60.0
    """Training time of each learner [s of CPU time]."""
    seed: int = 0
    """Seed of the learners and their environments."""
    json: Flag = False
    """Print the results as JSON."""

    def __post_init__(self) -> None:
        require_above(unit="s", seconds=self.seconds)
        require_least(0, seed=self.seed)
        for name in self.only:
            require_name("learner", name, CASES)


def robots(case: Case, count: int) -> Any:  # noqa: ANN401 - its type needs torch
    """Create the robots of a case as a `VecEnv` of Stable-Baselines3."""
    from spidar_gym.plugins import StableVecEnv

    vector = gymnasium.make_vec(case.env_id, num_envs=count, autoreset_mode="SameStep", **case.options)
    assert isinstance(vector, NativeVectorEnv)
    return StableVecEnv(vector)


def make_learner(case: Case, env: Any, seed: int) -> Any:  # noqa: ANN401 - as above
    """Create SAC for a crawl or PPO for a flight, with small networks."""
    from stable_baselines3 import PPO, SAC, HerReplayBuffer

    from spidar_gym import plugins

    if case.env_id == CRAWL:
        own = {"replay_buffer_class": HerReplayBuffer, "replay_buffer_kwargs": {"n_sampled_goal": 4}}
        # Hindsight relabelling needs complete episodes in the buffer before learning starts.
        whole = (CRAWLS["max_episode_steps"] + 1) * ROBOTS
        return SAC(
            case.policy, env, learning_starts=whole, train_freq=8, gradient_steps=16, batch_size=128, seed=seed,
            buffer_size=200_000, device="cpu", policy_kwargs={"net_arch": [64, 64]}, **(own if case.hindsight else {}),
        )  # fmt: skip
    policy = getattr(plugins, case.policy, case.policy)
    kwargs = {"net_arch": [64, 64], "log_std_init": -2.0}
    return PPO(policy, env, n_steps=128, batch_size=128, seed=seed, device="cpu", policy_kwargs=kwargs)


def measure(case: Case, seconds: float, seed: int) -> dict[str, Any]:
    """Train one learner, and evaluate it and the controller alone."""
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.utils import explained_variance
    from stable_baselines3.common.vec_env import VecNormalize

    env = VecNormalize(robots(case, ROBOTS), norm_reward=False)
    model = make_learner(case, env, seed)
    spent, explained, began = [0.0, 0.0], list[float](), time.process_time()
    learn = model.train

    def train(*args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - Stable-Baselines3's
        if case.env_id == HOVER:  # explained variance of the critic on a new rollout, before the update
            rollout = model.rollout_buffer
            explained.append(float(explained_variance(rollout.values.ravel(), rollout.returns.ravel())))
        begin = time.process_time(), time.perf_counter()
        learn(*args, **kwargs)
        spent[0] += time.process_time() - begin[0]
        spent[1] += time.perf_counter() - begin[1]

    class Stop(BaseCallback):
        def _on_step(self) -> bool:
            return time.process_time() - began < seconds

    model.train = train
    model.learn(10**9, callback=Stop())
    updates = model._n_updates
    if case.env_id == HOVER:
        updates *= model.n_steps * ROBOTS // model.batch_size
    judged = VecNormalize(robots(case, JUDGED), norm_reward=False, training=False)
    judged.obs_rms = env.obs_rms
    alone, learned = (judge(judged, act) for act in (None, partial(model.predict, deterministic=True)))
    env.close()
    judged.close()
    return {
        "steps": model.num_timesteps, "updates": updates, "alone": alone, "learned": learned,
        "explained": float(np.mean(explained[-5:])) if explained else None,
        "processor_ms": 1e3 * spent[0] / max(updates, 1), "wall_ms": 1e3 * spent[1] / max(updates, 1),
    }  # fmt: skip


def judge(env: Any, act: Any) -> dict[str, float]:  # noqa: ANN401 - as above
    """Run an episode of each robot; return mean reward per step, success rate, and arrival time of crawls [s]."""
    env.seed(JUDGED_SEED)
    seen, vector, count = env.reset(), env.venv.vector, env.num_envs
    over, arrived, success = np.zeros(count, bool), np.full(count, np.nan), np.zeros(count, bool)
    total, steps = np.zeros(count), np.zeros(count)
    while not over.all():
        action = np.zeros((count, *env.action_space.shape)) if act is None else act(seen)[0]
        seen, rewards, done, told = env.step(action)
        held = vector.buffers
        infos = np.where(done, held["final_infos"], held["infos"])
        total += np.where(over, 0.0, rewards)
        steps += ~over
        if "finished" in infos.dtype.names:
            arrived = np.where(over, arrived, np.where(infos["finished"], infos["time_s"], np.nan))
        for k in np.flatnonzero(done & ~over):
            success[k] = told[k]["is_success"]
        over |= done
    found = {"reward": float((total / steps).mean()), "success": float(success.mean())}
    if np.isfinite(arrived).any():
        found["arrives_s"] = float(np.nanmean(arrived))
    return found


def _words(found: dict[str, float]) -> str:
    arrives = f", {found['arrives_s']:.2f} s" if "arrives_s" in found else ""
    return f"{found['reward']:.4f}, {found['success']:.0%}{arrives}"


def lines(result: dict[str, Any]) -> list[list[str]]:
    """Return the table of results: the header, and a row for each learner."""
    rows = [
        [
            name, str(row["steps"]), str(row["updates"]), f"{row['processor_ms']:.2f}", _words(row["alone"]),
            _words(row["learned"]), "–" if row["explained"] is None else f"{row['explained']:.2f}",
        ]
        for name, row in result["learners"].items()
    ]  # fmt: skip
    return [list(HEADS), *rows]


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.sights")
    require_frameworks()
    import torch

    torch.set_num_threads(1)
    learners = {name: measure(CASES[name], args.seconds, args.seed) for name in args.only or CASES}
    result = {"machine": machine(*FRAMEWORKS), "seconds": args.seconds, "learners": learners}
    print(json_text(result) if args.json else format_table(lines(result)))


if __name__ == "__main__":
    run_cli("train.sights", main)
