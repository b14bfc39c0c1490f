"""Presets of `train.residual` as YAML for rl-zoo.

python -m train.presets            # writes train/zoo/*.yml
python -m train.presets --check
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from spidar_gym.benchmark.track import find_track
from spidar_gym.cli.console import run_cli
from spidar_gym.files import refresh
from train.residual import PRESETS
from train.residual import Args as Settings

ZOO = {"ppo": ("hover-paper-ppo", "crawl-ppo"), "sac": ("hover-paper-sac",)}
"""Algorithm → presets of `train.residual` that rl-zoo gets, one an environment id."""
FOLDER = Path(__file__).parent / "zoo"
"""Folder of rl-zoo's files."""
HEAD = """\
# Presets of train.residual for rl-zoo, written by `python -m train.presets`; not edited by hand.
#
#   python -m rl_zoo3.train --algo {algorithm} --env {env_id} --gym-packages spidar_gym -conf train/zoo/{algorithm}.yml
#
# What rl-zoo cannot say, so that its agents are not those of train.residual:
# - the output layer that begins at zero, so that the agent begins as its base; ticks in which only the critic learns;
# - the washout of a residual wrench, and the training rewards: it learns from the environment's own;
# - what the actor does not see, and entries of the action that stay still;
# - a held action: n_steps, batch_size, gamma and gae_lambda are those of single ticks;
# - several kinds of environments side by side: it has the middle one; evaluations have the environment's own defaults
#   where --eval-env-kwargs says nothing else;
# - the scaling frozen before training: VecNormalize goes on adapting;
# - a learning rate that ends above 0; for SAC also the exploration's width and the base that fills its buffer.
"""
"""First lines of a file, which say what rl-zoo cannot."""


def zoo() -> dict[str, str]:
    """Algorithm → text of its YAML."""
    texts = {}
    for algorithm, names in ZOO.items():
        lines = [HEAD.format(algorithm=algorithm, env_id=PRESETS[names[0]].env.env_id)]
        for name in names:
            lines.append(f"\n# {name}\n{PRESETS[name].env.env_id}:\n")
            lines += [f"  {key}: {json.dumps(value)}\n" for key, value in hyperparameters(PRESETS[name]).items()]
        texts[algorithm] = "".join(lines)
    return texts


def hyperparameters(settings: Settings) -> dict[str, Any]:
    """What rl-zoo is told of a preset of `train.residual`, in its own names."""
    env, learner = settings.env, settings.learner
    ppo, sac = learner.algorithm == "ppo", learner.sac
    net = f"dict(pi={[learner.hidden] * 2}, {'vf' if ppo else 'qf'}={[learner.critic_hidden] * 2})"
    activation = "Tanh" if ppo else "ReLU"
    shared = {
        "env_kwargs": {**env.arguments, **find_track(env.tracks[len(env.tracks) // 2]).options},
        "normalize": "dict(norm_obs=True, norm_reward=False)",
        "n_envs": settings.schedule.envs,
        "n_timesteps": settings.schedule.steps,
        "policy": "MlpPolicy",
        "batch_size": learner.batch_size * env.hold,
        "gamma": round(learner.gamma ** (1.0 / env.hold), 6),
        "learning_rate": learner.lr if learner.lr_end == learner.lr else f"lin_{learner.lr}",
    }
    own = {
        "n_steps": learner.ppo.n_steps * env.hold,
        "n_epochs": learner.ppo.epochs,
        "gae_lambda": round(learner.ppo.gae_lambda ** (1.0 / env.hold), 6),
        "clip_range": learner.ppo.clip_range,
        "ent_coef": learner.ppo.entropy,
    } if ppo else {
        "buffer_size": sac.buffer,
        "learning_starts": sac.warmup,
        "train_freq": 1,
        "gradient_steps": sac.updates,
    }  # fmt: skip
    policy = f"dict(net_arch={net}, activation_fn=nn.{activation}, log_std_init={learner.log_std})"
    return {**shared, **own, "policy_kwargs": policy}


@dataclass(frozen=True)
class Args:
    """Write the presets as rl-zoo takes them."""

    check: bool = False
    """Write nothing; fail when a committed file is stale."""


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.presets", config=(tyro.conf.FlagCreatePairsOff,))
    files = {FOLDER / f"{algorithm}.yml": text for algorithm, text in zoo().items()}
    refresh(files, "python -m train.presets", check=args.check)
    for path in files:
        print(f"{path} is up to date")


if __name__ == "__main__":
    run_cli("train.presets", main)
