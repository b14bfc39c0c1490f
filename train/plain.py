"""Train PPO of Stable-Baselines3 with its default settings, as in its documentation, and save a zip.

    python -m train.plain

The task is HoverResidual of the suite, a share of a wrench beside the paper's controller. At first the policy is worse
than the controller alone, because the default exploration noise is as large as the action; at the end it is better.
"""

from dataclasses import dataclass
from pathlib import Path

import gymnasium
import tyro

from spidar_gym.console import run_cli
from spidar_gym.envs.suite import SUITE
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import require_least
from spidar_gym.files import output_folder
from train.lib.run import require_frameworks

TASK = SUITE["HoverResidual"]
ROLLOUT = 2048
"""Length of a rollout [control ticks], summed over all robots; the default of Stable-Baselines3."""


@dataclass(frozen=True)
class Args:
    """Train a wrench residual with the defaults of Stable-Baselines3's PPO, and save its zip."""

    steps: int = 400_000
    """Length of training [control ticks], summed over all robots and rounded up to whole rollouts of 2048."""
    robots: int = 1
    """Number of robots; 1 uses `gymnasium.make`, more are simulated in parallel by `gymnasium.make_vec`."""
    seed: int = 0
    """Seed of the learner and the environments."""
    out: Path = Path("out/plain")
    """Folder for model.zip."""

    def __post_init__(self) -> None:
        require_least(1, steps=self.steps, robots=self.robots)
        require_least(0, seed=self.seed)


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.plain")
    require_frameworks()
    from stable_baselines3 import PPO  # imported late so that `--help` works without torch

    path = output_folder(args.out) / "model.zip"
    if args.robots == 1:
        model = PPO("MlpPolicy", TASK.id, seed=args.seed, verbose=1)
    else:
        from stable_baselines3.common.vec_env import VecMonitor

        from spidar_gym.plugins import StableVecEnv

        vector = gymnasium.make_vec(TASK.id, num_envs=args.robots, autoreset_mode="SameStep")
        assert isinstance(vector, NativeVectorEnv)
        ticks = max(2, ROLLOUT // args.robots)
        model = PPO("MlpPolicy", VecMonitor(StableVecEnv(vector)), n_steps=ticks, seed=args.seed, verbose=1)
    model.learn(args.steps)
    model.save(path)
    print(f"spidar suite {TASK.name} --policy {path} --trust")
    print(f"spidar run {TASK.id} --policy {path} --trust --out plain.mp4")


if __name__ == "__main__":
    run_cli("train.plain", main)
