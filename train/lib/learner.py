"""Settings of a learner, PPO or SAC, and the layers that it learns; the learner itself is in `train/lib/agent.py`."""

from dataclasses import dataclass, field

import numpy as np

from spidar_gym.errors import InvalidValueError, require_least, require_name, require_within
from spidar_gym.robot import N_LEGS

ALGORITHMS = ("ppo", "sac")
"""Learners by name."""
ACTIVATIONS = ("tanh", "relu")
"""Activations by name."""
Layers = tuple[tuple[np.ndarray, np.ndarray], ...]
"""W (out, in) and b (out,) of every layer of an actor; behind the last W stands the matrix past the layers, if any."""


@dataclass(frozen=True)
class PPOConfig:
    """What only PPO has."""

    gae_lambda: float = 0.95
    """PPO: λ of the advantages."""
    n_steps: int = 256
    """PPO: decisions of each environment in a rollout."""
    epochs: int = 10
    """PPO: passes over a rollout."""
    clip_range: float = 0.2
    """PPO: clip of the probability ratio."""
    target_kl: float = 0.0
    """PPO: divergence at which a rollout's passes end; 0 is no limit."""
    entropy: float = 0.0
    """PPO: weight of the entropy."""

    def __post_init__(self) -> None:
        require_least(1, n_steps=self.n_steps)


@dataclass(frozen=True)
class SACConfig:
    """What only SAC has."""

    buffer: int = 200_000
    """SAC: size of the replay buffer."""
    warmup: int = 10_000
    """SAC: decisions of the base before learning begins."""
    updates: int = 4
    """SAC: steps of the optimiser after each step of all environments."""


@dataclass(frozen=True)
class LearnerConfig:
    """Networks, optimiser, and when the actor learns."""

    algorithm: str = "ppo"
    """Algorithm: ppo or sac."""
    hidden: int = 64
    """Width of the actor's two hidden layers."""
    activation: str = "tanh"
    """PPO: activation of the hidden layers, tanh or relu."""
    skip: bool = False
    """PPO: whether a matrix goes straight from what the actor sees to what it says, past the layers."""
    last_layer: bool = False
    """PPO: only the actor's last layer learns, with what goes past the others: a step of Adam in the others, however
    small `action_scale`, would be many times as large as a small exploration."""
    symmetric: bool = False
    """PPO in the torso's axes: turned by 90° the robot is the same again, so the network is, too."""
    enlarged: float = 1.0
    """In the torso's axes: errors enter the networks so many times as large as what scales them, which from nothing
    are falls: beside those a centimetre would be lost."""
    critic_hidden: int = 128
    """Width of the critic's two hidden layers."""
    action_scale: float = 1.0
    """What a 1 of the learner is of an action: steps of Adam are as large in units of one network as of another, and
    have to be small beside the exploration."""
    log_std: float = -2.0
    """Logarithm of the exploration's standard deviation at the beginning, in units of `action_scale`."""
    log_std_end: float | None = None
    """PPO: the same at the end; it changes evenly, segment by segment. None: it is learned."""
    lr: float = 5e-4
    """Learning rate at the beginning."""
    lr_end: float = 5e-5
    """Learning rate at the end; it changes evenly, segment by segment."""
    gamma: float = 0.97
    """Discount of a tick, or of the ticks that an action is held."""
    batch_size: int = 2048
    """Samples in a step of the optimiser."""
    critic_first: int = 16_384
    """Decisions in which only the critic learns."""
    average: float = 0.9
    """Fraction of the actor's averaged weights that a rollout leaves; 0 is no averaging."""
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
