"""Settings of `train.residual` and its presets: environment, reward, learner and schedule."""

from dataclasses import dataclass, field, replace

from spidar_gym.benchmark.track import CRAWL, HOVER, TRACKS
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies import torso
from spidar_gym.robot import N_ROTORS
from train.lib.config import EvaluationConfig, Recipe, ScheduleConfig
from train.lib.envs import NOMINAL, EnvConfig
from train.lib.learner import LearnerConfig, PPOConfig
from train.lib.rewards import RewardConfig


@dataclass(frozen=True)
class Args(Recipe):
    """Train a policy by PPO or SAC, usually as a residual on a controller."""

    env: EnvConfig
    reward: RewardConfig = field(default_factory=lambda: RewardConfig("pose"))
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    start: str = ""
    """Artifact that initialises the network and is the base of the comparison; {seed} is replaced by the run's seed.
    If empty, the initial action is zero."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.learner.symmetric and not self.env.torso:
            raise InvalidValueError("symmetric", True, "False but in the torso's axes")


MOMENTUM = ("leg_momentum", "leg_momentum_rate")
"""Entries of the observation that describe how joint motion turns the torso: only six, since with all two hundred the
gradient's signal is lost in noise."""
FLIGHT_REWARD = RewardConfig(
    "pose",
    # Velocities respond within two or three ticks, the pose after ten to twenty. Rewarding them allows a short horizon.
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
    # Small batches: the critic needs many optimiser steps before its advantages are informative.
    batch_size=504,
    critic_first=8064,
    average=0.8,
    ppo=PPOConfig(n_steps=336, target_kl=0.03),
)
"""Learner of PPO in flight, for every base controller."""
FLIGHT_SCHEDULE = ScheduleConfig(segment=48_384, envs=24)
"""Schedule of PPO in flight."""
FLIGHT_ENV = EnvConfig(
    HOVER,
    NOMINAL,
    "paper",
    "residual_wrench",
    sees=MOMENTUM,
    # Rotors and servos filter out most of the exploration noise at 40 Hz, but less at 20 Hz.
    hold=2,
    washout=1.0,
)
"""Environment of PPO in flight."""
DIRECT_TRACKS = tuple(name for name, track in TRACKS.items() if track.group == "flight")
"""All tracks of Hover-v0: a policy without a controller is trained for all of them at once."""
JOINTS = tuple(range(3 * N_ROTORS, torso.ACTION))
"""Entries of the action that move joint targets off their form; they stay 0, as exploring them teaches nothing."""
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
        # Forces stay 0: the remaining position error is too small to be found in the noise of three more entries.
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
            still=(2,),  # the stride: a change of the stride causes an error at the goal
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
            trace_times=(0.2, 1.0, 5.0, 30.0),
        ),
        reward=RewardConfig(
            "pose",
            position=0.03,
            attitude=0.03,
            velocity=0.1,
            rate=0.25,
            # Wide terms in addition: the errors of an untrained network are far beyond the narrow ones.
            far_position=0.15,
            far_attitude=0.15,
            joint=0.1,
            penalty=0.0,
            # No negative rewards: an untrained policy that loses reward by flying on learns to fall.
            reward_scale=0.1,
        ),
        learner=LearnerConfig(
            hidden=128,
            skip=True,
            symmetric=True,
            enlarged=12.0,
            # Exploration of 2 N initially, enough to learn from falls; 0.3 N at the end, as more hides millimetres.
            action_scale=0.2,
            log_std=0.0,
            log_std_end=-2.0,
            lr=1e-3,
            lr_end=5e-5,
            gamma=0.98,
            batch_size=1792,
            critic_first=0,
            average=0.8,
            ppo=PPOConfig(n_steps=64, epochs=5, target_kl=0.06),
        ),
        schedule=ScheduleConfig(steps=9_175_040, first_steps=860_160, segment=286_720, envs=112),
        evaluation=EvaluationConfig(scenarios=4, select=False),
    ),
    "hover-distilled-ppo": Args(
        "distilled_ppo",
        "PPO: the network of `distilled`, improved on all flights.",
        EnvConfig(HOVER, DIRECT_TRACKS, "tuned", "direct", still=JOINTS, torso=True, trace_times=(0.2, 1.0, 5.0, 30.0)),
        # Each error is scaled by its remaining size; the exploration is not much larger.
        RewardConfig(
            "pose", position=0.003, attitude=0.003, velocity=0.01, rate=0.02, apart=True, penalty=0.0, reward_scale=0.2
        ),
        LearnerConfig(
            activation="relu",
            skip=True,
            symmetric=True,
            last_layer=True,
            # 0.3 N: about the size of the remaining errors.
            action_scale=0.03,
            log_std=0.0,
            log_std_end=0.0,
            lr=1.5e-4,
            lr_end=1.5e-5,
            # A torque takes effect within ten ticks; later its gain is lost in the noise of the other actions explored.
            gamma=0.92,
            batch_size=7168,
            critic_first=143_360,
            average=0.95,
            ppo=PPOConfig(gae_lambda=0.9, n_steps=128, epochs=4, target_kl=0.05),
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
