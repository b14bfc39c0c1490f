"""Rewards to learn from; rows are ranked by the tracks' own errors, whatever was rewarded."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.benchmark.track import ENERGY_SCALE
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.crawl.task import SUCCESS_SLIP
from spidar_gym.envs.rewards import norm, tolerance
from spidar_gym.errors import require_name


@dataclass(frozen=True)
class RewardConfig:
    """What a learner is rewarded for."""

    reward: str = "environment"
    """Reward of a tick: environment, pose, or economy."""
    position: float = 0.01
    """Position error that halves its term of the reward `pose` [m], on the mean track. On each track this and the next
    three are in proportion to the base's own errors, so that no track is learned at another one's cost."""
    attitude: float = 0.02
    """Attitude error that halves its term of `pose` [rad]."""
    velocity: float = 0.0
    """Velocity that halves a term of its own of `pose` [m/s]; 0 is no such term."""
    rate: float = 0.0
    """Angular velocity that halves a term of its own of `pose` [rad/s]; 0 is no such term."""
    penalty: float = 0.05
    """Fraction of the reward that the largest action costs."""
    reward_shift: float = 0.0
    """Constant that is subtracted from the reward of every tick, so that critics begin near the truth."""
    reward_scale: float = 1.0
    """Factor of the shifted reward."""

    def __post_init__(self) -> None:
        require_name("reward", self.reward, REWARDS)

    def __call__(self, tick: "Tick") -> float:
        """Reward of a tick, shifted and scaled."""
        return self.reward_scale * (REWARDS[self.reward](self, tick) - self.reward_shift)


@dataclass
class Tick:
    """What the reward of a tick is computed from."""

    reward: float
    """The environment's own reward."""
    info: Mapping[str, Any]
    """Info of this tick."""
    before: Mapping[str, Any]
    """Info of the tick before it."""
    env: Any
    """The environment."""
    action: np.ndarray
    """Action that the environment was given, within ± 1."""


def _pose(config: RewardConfig, tick: Tick) -> float:
    """Mean of 1/(1 + (e/e₀)²) over the terms, less the fraction for a large action; 0 where the flight is over."""
    if tick.info["failure"]:
        return 0.0
    error = tick.env.truth.error
    terms = (
        (tick.info["position_error"], config.position),
        (tick.info["attitude_error"], config.attitude),
        (error.velocity_w, config.velocity),
        (error.omega_b, config.rate),
    )
    found = [tolerance(norm(value), unit) for value, unit in terms if unit > 0.0]
    return sum(found) / len(found) * (1.0 - config.penalty * float(tick.action @ tick.action) / len(tick.action))


def _economy(config: RewardConfig, tick: Tick) -> float:
    """Fraction of the distance that was made, less its energy (20 Wh/m cost as much as all of it) and slip; −1: failed.

    Nothing for a success: whether a goal is met within 10 mm is decided at the end of some 80 actions, and a critic
    that is to foresee it sees nothing else.
    """
    info, before, whole = tick.info, tick.before, tick.env.progress.initial_distance
    if info["failure"]:
        return -1.0
    energy = (info["energy_wh"] - before["energy_wh"]) / (ENERGY_SCALE * whole)
    slip = (info["foot_slip_m"] - before["foot_slip_m"]) / (2.0 * SUCCESS_SLIP)
    progress = (before["remaining"] - info["remaining"]) / whole
    effort = config.penalty * float(tick.action @ tick.action) / len(tick.action) / CONTROL_RATE
    return progress - energy - slip - effort


REWARDS: dict[str, Callable[[RewardConfig, Tick], float]] = {
    "environment": lambda config, tick: tick.reward,
    "pose": _pose,
    "economy": _economy,
}
"""Training rewards by name."""
