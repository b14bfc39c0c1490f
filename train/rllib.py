"""Train PPO of RLlib on `spidar_gym/Hover-v0`, through Gymnasium's interface alone.

RLlib requires one exact version of Gymnasium (Ray 2.60 requires 1.2.2, this package 1.2 or newer). Install it in a
separate Python environment:

    python3 -m venv .venv-rllib
    .venv-rllib/bin/pip install 'torch<2.14'
    .venv-rllib/bin/pip install -e . 'ray[rllib]'
    .venv-rllib/bin/python -m train.rllib --iterations 5
"""

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import tyro

from spidar_gym.console import run_cli
from spidar_gym.errors import MissingDependencyError, require_least

FRACTION = 0.1
"""Factor applied to actions, as RLlib's Gaussian has an initial standard deviation of about 1."""


@dataclass(frozen=True)
class Args:
    """Train a wrench residual with RLlib's PPO, and print its mean return and that of the controller alone."""

    iterations: int = 5
    """Number of iterations, each a rollout and an update."""
    batch: int = 2000
    """Length of a rollout [control ticks]."""
    ticks: int = 200
    """Length of an episode [control ticks]."""
    runners: int = 0
    """Number of processes that run episodes; 0 uses this process."""
    seed: int = 0
    """Seed of the learner and the environments."""

    def __post_init__(self) -> None:
        require_least(1, iterations=self.iterations, batch=self.batch, ticks=self.ticks)
        require_least(0, runners=self.runners, seed=self.seed)


def make(config: dict[str, Any]) -> gymnasium.Env:
    """Make a flight environment; Gymnasium imports the package named before the colon in every process."""
    env = gymnasium.make("spidar_gym:spidar_gym/Hover-v0", forms="independent", max_episode_steps=config["ticks"])
    return gymnasium.wrappers.TransformAction(env, lambda action: FRACTION * action, env.action_space)


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.rllib")
    try:
        from ray.rllib.algorithms.ppo import PPOConfig
        from ray.tune import register_env
    except ImportError as error:
        raise MissingDependencyError("RLlib", "pip install -e . 'ray[rllib]'") from error
    env = make({"ticks": args.ticks})
    env.reset(seed=args.seed)
    alone = sum(float(env.step(np.zeros(env.action_space.shape or ()))[1]) for _ in range(args.ticks))
    print(f"Gymnasium {gymnasium.__version__}; return of the controller alone: {alone:.1f} of {args.ticks}")
    register_env("hover", make)
    config = PPOConfig().environment("hover", env_config={"ticks": args.ticks}).debugging(seed=args.seed)
    config.env_runners(num_env_runners=args.runners).training(
        train_batch_size=args.batch, minibatch_size=min(256, args.batch), num_epochs=10, gamma=0.97, lr=3e-4
    )
    algorithm = config.build_algo()
    for k in range(args.iterations):
        mean = algorithm.train()["env_runners"].get("episode_return_mean", float("nan"))
        print(f"iteration {k + 1}: mean return {mean:.1f}", flush=True)
    algorithm.stop()


if __name__ == "__main__":
    run_cli("train.rllib", main)
