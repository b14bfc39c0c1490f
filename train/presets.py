"""Presets by environment and method, and the same as YAML for rl-zoo.

python -m train.presets            # writes train/zoo/*.yml
python -m train.presets --check
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from spidar_gym.benchmark.track import CRAWL, HOVER, find_track
from spidar_gym.errors import StaleAssetError
from spidar_gym.files import has_text, write_text
from spidar_gym.terminal import speak_plainly

NOMINAL = ("flight-forms", "flight-fast3", "flight-fast5")
"""Kinds of flights to learn in: three speeds on the robot of the description."""
MOTION = ("joint_velocity", "joint_target_error", "joint_command_velocity", "leg_momentum", "leg_momentum_rate")
"""What an observation says of the joints' motion."""
MOMENTUM = ("leg_momentum", "leg_momentum_rate")
"""… and what of it turns the torso: six numbers, in which a gradient is not lost among the noise of two hundred."""
FLIGHT_PPO: Mapping[str, Any] = {
    # Velocities answer within two or three ticks, the pose after ten or twenty: with them a short horizon is enough.
    "velocity": 0.03,
    "rate": 0.06,
    "reward_shift": 0.5,
    "reward_scale": 0.5,
    "gamma": 0.88,
    # At 40 Hz most of the noise is lost in the rotors and servos; at 20 Hz less.
    "hold": 2,
    "envs": 24,
    "n_steps": 336,
    # Small batches: the critic needs many steps before its advantages mean anything.
    "batch_size": 504,
    "target_kl": 0.03,
    "segment": 48_384,
    "hidden": 32,
    "critic_first": 8064,
    "lr": 1e-3,
    "lr_end": 1e-4,
    "average": 0.8,
}
"""PPO in flight, whatever it adds to."""
RESIDUAL: dict[str, Mapping[str, Any]] = {
    "hover-paper-ppo": {
        "name": "ppo_paper",
        "doc": "PPO: a wrench residual with washout on the paper's gains.",
        "env_id": HOVER,
        "tracks": NOMINAL,
        "base": "paper",
        "action_mode": "residual_wrench",
        "sees": MOMENTUM,
        "washout": 1.0,
        "position": 0.01,
        "attitude": 0.015,
        **FLIGHT_PPO,
    },
    "hover-tuned-ppo": {
        "name": "ppo_tuned",
        "doc": "PPO: a residual torque with washout on `tuned`.",
        "env_id": HOVER,
        "tracks": NOMINAL,
        "base": "tuned",
        "action_mode": "residual_wrench",
        "sees": MOMENTUM,
        # Forces: what is left of the position's error is too small to be found among the noise of three more entries.
        "still": (0, 1, 2),
        "washout": 1.0,
        **FLIGHT_PPO,
        "position": 0.003,
        "attitude": 0.004,
        "velocity": 0.0,
        "average": 0.9,
    },
    "hover-paper-sac": {
        "name": "sac_paper",
        "doc": "SAC: a wrench residual with washout on the paper's gains.",
        "env_id": HOVER,
        "tracks": NOMINAL,
        "base": "paper",
        "action_mode": "residual_wrench",
        "algorithm": "sac",
        "washout": 2.0,
        "position": 0.01,
        "attitude": 0.015,
        "batch_size": 256,
        "lr": 3e-4,
        "lr_end": 3e-4,
    },
    "crawl-ppo": {
        "name": "ppo_crawl",
        "doc": "PPO: gait parameters and leg forces by phase on the crawler `robust_overlapped`.",
        "env_id": CRAWL,
        "tracks": ("ground-randomised",),
        "base": "robust_overlapped",
        "action_mode": "residual_gait_force",
        "sees": ("phase", "phase_time", "share", "steps_left", "goal_position", "goal_heading"),
        "still": (2,),  # the stride: what it changes of the way is missing at the goal
        "reward": "economy",
        "reward_scale": 10.0,
        "hold": 10,
        "gamma": 0.9,
        "gae_lambda": 0.9,
        "n_steps": 64,
        "batch_size": 128,
        "target_kl": 0.03,
        "log_std": -1.5,
        "critic_first": 2048,
        "segment": 40_960,
        "scenarios": 12,
        "lr": 1e-3,
        "lr_end": 1e-4,
        "average": 0.7,
    },
    "hover-direct-ppo": {
        "name": "ppo_direct",
        "doc": "PPO from nothing: thrust, vectoring angles and joint targets, no controller.",
        "env_id": HOVER,
        "tracks": ("flight-paper",),
        "base": "paper",
        "action_mode": "direct",
        "reward": "environment",
        "gamma": 0.99,
        "batch_size": 512,
        "target_kl": 0.03,
        "critic_first": 0,
        "select": False,
    },
}
"""Settings of `train.residual` by name: fields of its `Args`; the others have its defaults."""
FLIGHTS = (*NOMINAL, "flight-randomised")
"""… and drawn robots with real sensors."""
SUPERVISED: dict[str, Mapping[str, Any]] = {
    "hover-paper": {
        "name": "supervised_paper",
        "doc": "Regression: a wrench residual that foresees what moving joints do, on the paper's gains.",
        "tracks": FLIGHTS,
        "base": "paper",
    },
    "hover-tuned": {
        "name": "supervised_tuned",
        "doc": "Regression: a wrench residual that foresees what moving joints do, on `tuned`.",
        "tracks": FLIGHTS,
        "base": "tuned",
        "posture": False,
        "rounds": 1,
        "flights": 240,
        "updates": 4000,
    },
}
"""Settings of `train.supervised` by name."""
GAIT: dict[str, Mapping[str, Any]] = {
    "crawl": {
        "name": "learned_gait",
        "doc": "Random search: gait parameters and foot forces by phase on the crawler `robust_overlapped`.",
        "tracks": ("ground-randomised",),
        "base": "robust_overlapped",
    },
}
"""Settings of `train.gait` by name."""
ZOO = {"ppo": ("hover-paper-ppo", "crawl-ppo"), "sac": ("hover-paper-sac",)}
"""Algorithm → presets of `train.residual` that rl-zoo gets, one an environment id."""
FOLDER = Path(__file__).parent / "zoo"
"""Where rl-zoo's files lie."""
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
"""First lines of a file."""


def zoo() -> dict[str, str]:
    """Algorithm → text of its YAML."""
    texts = {}
    for algorithm, names in ZOO.items():
        env_id = RESIDUAL[names[0]]["env_id"]
        lines = [HEAD.format(algorithm=algorithm, env_id=env_id)]
        for name in names:
            lines.append(f"\n# {name}\n{RESIDUAL[name]['env_id']}:\n")
            lines += [f"  {key}: {json.dumps(value)}\n" for key, value in hyperparameters(name).items()]
        texts[algorithm] = "".join(lines)
    return texts


def hyperparameters(name: str) -> dict[str, Any]:
    """What rl-zoo is told of a preset of `train.residual`, in its own names."""
    # Here, since train.residual reads this file.
    from train import residual

    args = residual.Args(**RESIDUAL[name])
    ppo = args.algorithm == "ppo"
    net = f"dict(pi={[args.hidden] * 2}, {'vf' if ppo else 'qf'}={[args.critic_hidden] * 2})"
    kind = find_track(args.tracks[len(args.tracks) // 2])
    shared = {
        "env_kwargs": {**args.arguments, **kind.options},
        "normalize": "dict(norm_obs=True, norm_reward=False)",
        "n_envs": args.envs,
        "n_timesteps": args.steps,
        "policy": "MlpPolicy",
        "batch_size": args.batch_size * args.hold,
        "gamma": round(args.gamma ** (1.0 / args.hold), 6),
        "learning_rate": args.lr if args.lr_end == args.lr else f"lin_{args.lr}",
    }
    if not ppo:
        return shared | {
            "buffer_size": args.buffer,
            "learning_starts": args.warmup,
            "train_freq": 1,
            "gradient_steps": args.updates,
            "policy_kwargs": f"dict(net_arch={net}, activation_fn=nn.ReLU, log_std_init={args.log_std})",
        }
    return shared | {
        "n_steps": args.n_steps * args.hold,
        "n_epochs": args.epochs,
        "gae_lambda": round(args.gae_lambda ** (1.0 / args.hold), 6),
        "clip_range": args.clip_range,
        "ent_coef": args.entropy,
        "policy_kwargs": f"dict(net_arch={net}, activation_fn=nn.Tanh, log_std_init={args.log_std})",
    }


@dataclass(frozen=True)
class Args:
    """Write the presets as rl-zoo takes them."""

    check: bool = False
    """Write nothing; fail when a committed file is stale."""


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.presets", config=(tyro.conf.FlagCreatePairsOff,))
    for algorithm, text in zoo().items():
        path = FOLDER / f"{algorithm}.yml"
        if not has_text(path, text):
            if args.check:
                raise StaleAssetError(path, "python -m train.presets")
            write_text(path, text)
        print(f"{path} is up to date")


if __name__ == "__main__":
    speak_plainly("train.presets", main)
