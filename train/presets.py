"""Presets by environment and method, and the same as YAML for rl-zoo.

python -m train.presets            # writes train/zoo/*.yml
python -m train.presets --check
"""

from collections.abc import Mapping
from typing import Any

from spidar_gym.benchmark.track import CRAWL, HOVER

NOMINAL = ("flight-forms", "flight-fast3", "flight-fast5")
"""Kinds of flights to learn in: three speeds on the robot of the description."""
MOTION = ("joint_velocity", "joint_target_error", "joint_command_velocity", "leg_momentum", "leg_momentum_rate")
"""What an observation says of the joints' motion."""
ERRORS = ("position_error", "velocity_error", "attitude_error", "angular_velocity_error")
"""… and of the errors."""
PREVIEW = ("next_form", "time_to_next_form")
"""… and of the form after this one."""
RESIDUAL: dict[str, Mapping[str, Any]] = {
    "hover-paper-ppo": {
        "name": "ppo_paper",
        "doc": "PPO: a wrench residual with washout on the paper's gains.",
        "env_id": HOVER,
        "tracks": NOMINAL,
        "base": "paper",
        "action_mode": "residual_wrench",
        "sees": MOTION + ERRORS,
        "washout": 1.0,
        "position": 0.01,
        "attitude": 0.015,
        "velocity": 0.03,
        "rate": 0.06,
        "reward_shift": 0.5,
        "reward_scale": 0.1,
        "gamma": 0.93,
        "envs": 24,
        "n_steps": 340,
        "batch_size": 4080,
        "segment": 40_800,
        "lr": 2e-4,
        "lr_end": 2e-5,
    },
    "hover-tuned-ppo": {
        "name": "ppo_tuned",
        "doc": "PPO: joint targets, joint speed and a wrench residual with washout on `tuned`.",
        "env_id": HOVER,
        "tracks": NOMINAL,
        "base": "tuned",
        "action_mode": "residual",
        "washout": 1.0,
        "position": 0.0015,
        "attitude": 0.003,
        "log_std": -3.0,
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
        "doc": "PPO: gait parameters and leg forces by phase on the crawler `overlapped`.",
        "env_id": CRAWL,
        "tracks": ("ground-randomised",),
        "base": "overlapped",
        "action_mode": "residual_gait_force",
        "sees": ("phase", "phase_time", "share", "steps_left", "goal_position", "goal_heading"),
        "still": (2,),  # the stride: what it changes of the way is missing at the goal
        "reward": "economy",
        "hold": 10,
        "gamma": 0.98,
        "n_steps": 64,
        "batch_size": 1024,
        "log_std": -1.2,
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
        "log_std": -1.0,
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
