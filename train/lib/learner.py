"""Settings of PPO and SAC, and the type of an actor's layers; the agents are built in `train/lib/agent.py`."""

from dataclasses import dataclass, field

import numpy as np

from spidar_gym.errors import InvalidValueError, require_least, require_name, require_within
from spidar_gym.robot import N_LEGS

ALGORITHMS = ("ppo", "sac")
"""Learners by name."""
ACTIVATIONS = ("tanh", "relu")
"""Activations by name."""
Layers = tuple[tuple[np.ndarray, np.ndarray], ...]
"""W (out, in) and b (out,) of every layer of an actor; the last columns of the last W are the skip matrix, if any."""


@dataclass(frozen=True)
class PPOConfig:
    """Settings of PPO alone."""

    gae_lambda: float = 0.95
    """PPO: λ of the generalised advantage estimation."""
    n_steps: int = 256
    """PPO: length of a rollout [decisions of each robot]."""
    epochs: int = 10
    """PPO: number of passes over a rollout."""
    clip_range: float = 0.2
    """PPO: clipping range of the probability ratio."""
    target_kl: float = 0.0
    """PPO: KL divergence at which the passes over a rollout stop; 0 is no limit."""
    entropy: float = 0.0
    """PPO: weight of the entropy in the loss."""

    def __post_init__(self) -> None:
        require_least(1, n_steps=self.n_steps)


@dataclass(frozen=True)
class SACConfig:
    """Settings of SAC alone."""

    buffer: int = 200_000
    """SAC: size of the replay buffer [decisions]."""
    warmup: int = 10_000
    """SAC: number of decisions with the noisy base before learning begins."""
    updates: int = 4
    """SAC: optimiser steps after each step of all robots."""


@dataclass(frozen=True)
class LearnerConfig:
    """Networks, optimiser, exploration and schedule of the actor."""

    algorithm: str = "ppo"
    """Algorithm: ppo or sac."""
    hidden: int = 64
    """Width of the actor's two hidden layers."""
    activation: str = "tanh"
    """PPO: activation of the hidden layers, tanh or relu."""
    skip: bool = False
    """PPO: whether the actor has a skip matrix from its input to its output."""
    last_layer: bool = False
    """PPO: whether only the actor's last layer and skip matrix learn; steps of Adam in the other layers would change
    the action by much more than a small exploration does, whatever `action_scale` is."""
    symmetric: bool = False
    """PPO in torso axes: whether the network is equivariant to 90° rotations of the robot."""
    enlarged: float = 1.0
    """In torso axes: factor that enlarges the scaled errors, since the scaling is determined from the large errors of
    falls."""
    critic_hidden: int = 128
    """Width of the critic's two hidden layers."""
    action_scale: float = 1.0
    """Environment action that corresponds to a network output of 1; it keeps steps of Adam small relative to the
    exploration."""
    log_std: float = -2.0
    """Natural logarithm of the exploration's initial standard deviation, in units of `action_scale`."""
    log_std_end: float | None = None
    """PPO: final value of `log_std`, which changes linearly, segment by segment. None: it is learned."""
    lr: float = 5e-4
    """Initial learning rate."""
    lr_end: float = 5e-5
    """Final learning rate; it changes linearly, segment by segment."""
    gamma: float = 0.97
    """Discount factor per decision, which lasts `hold` control ticks."""
    batch_size: int = 2048
    """Samples in an optimiser step."""
    critic_first: int = 16_384
    """Number of decisions at the beginning in which only the critic learns."""
    average: float = 0.9
    """Fraction of the averaged weights that is kept after each rollout; 0 is no averaging."""
    ppo: PPOConfig = field(default_factory=PPOConfig)
    sac: SACConfig = field(default_factory=SACConfig)

    def __post_init__(self) -> None:
        require_name("algorithm", self.algorithm, ALGORITHMS)
        require_name("activation", self.activation, ACTIVATIONS)
        require_least(1, hidden=self.hidden, batch_size=self.batch_size)
        for name, width in (("hidden", self.hidden), ("critic_hidden", self.critic_hidden)):
            if self.symmetric and width % N_LEGS:
                raise InvalidValueError(name, width, f"a multiple of {N_LEGS}: each leg has as many units")
        require_within(0.0, 1.0, gamma=self.gamma, average=self.average)
        if self.average == 1.0:
            raise InvalidValueError("average", 1.0, "a number below 1")
