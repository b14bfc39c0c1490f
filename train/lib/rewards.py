"""Rewards to learn from; rows are ranked by the tracks' own errors, whatever was rewarded."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from spidar_gym.benchmark.track import ENERGY_SCALE
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import require_name
from spidar_gym.tasks.crawl import SUCCESS_SLIP
from spidar_gym.tasks.task import length, tolerance


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
    apart: bool = False
    """In proportion to the base's error of the same kind, position or attitude; else to the mean of both."""
    far_position: float = 0.0
    """Position error that halves a second term of `pose` [m], the same on each track: where the others are next to
    nothing, it says which way is better; 0 is no such term."""
    far_attitude: float = 0.0
    """Attitude error that halves such a term [rad]."""
    joint: float = 0.0
    """Largest distance of a joint from the schedule that halves a term of its own of `pose` [rad]; 0: none."""
    change: float = 0.0
    """What a tick costs in which every number of an action is another one by 1; in proportion to its square."""
    penalty: float = 0.05
    """Fraction of the reward that the largest action costs."""
    reward_shift: float = 0.0
    """Constant that is subtracted from the reward of every tick, so that critics begin near the truth."""
    reward_scale: float = 1.0
    """Factor of the shifted reward."""

    def __post_init__(self) -> None:
        require_name("reward", self.reward, REWARDS)

    def __call__(self, tick: "Tick") -> np.ndarray:
        """Rewards of a tick, shifted and scaled (robots,)."""
        return self.reward_scale * (REWARDS[self.reward](self, tick) - self.reward_shift)


@dataclass
class Tick:
    """What the rewards of a tick are computed from; each array has an entry for every robot."""

    reward: np.ndarray
    """The environment's own reward."""
    info: Mapping[str, np.ndarray]
    """Info of this tick; of flights also `velocity_error` [m/s], `rate_error` [rad/s], `joint_error` [rad]; of crawls
    `remaining`, how far the goal is, and `way`, how far it was at the start [m]."""
    before: Mapping[str, np.ndarray]
    """The same of the tick before it."""
    action: np.ndarray
    """Actions that the environment was given, within ± 1."""
    change: np.ndarray
    """How far what was said is from what was said a tick before, root mean square over its numbers."""


def _effort(config: RewardConfig, tick: Tick) -> np.ndarray:
    """What actions of this size cost: the fraction for the largest."""
    return config.penalty * np.square(tick.action).mean(axis=1)


def _pose(config: RewardConfig, tick: Tick) -> np.ndarray:
    """Mean of 1/(1 + (e/e₀)²) over the terms, less the fraction for a large action; 0 where the flight is over."""
    terms = (
        ("position_error", config.position), ("attitude_error", config.attitude),
        ("velocity_error", config.velocity), ("rate_error", config.rate),
        ("position_error", config.far_position), ("attitude_error", config.far_attitude),
        ("joint_error", config.joint),
    )  # fmt: skip
    found = [tolerance(length(tick.info[name]), unit) for name, unit in terms if unit > 0.0]
    over = tick.info["failure_code"] >= 0
    gained = sum(found) / len(found) * (1.0 - _effort(config, tick)) - config.change * tick.change**2
    return np.where(over, 0.0, gained)


def _economy(config: RewardConfig, tick: Tick) -> np.ndarray:
    """Fraction of the distance that was made, less its energy (20 Wh/m cost as much as all of it) and slip; −1: failed.

    Nothing for a success: whether a goal is met within 10 mm is decided at the end of some 80 actions, and a critic
    that is to foresee it sees nothing else.
    """
    info, before, whole = tick.info, tick.before, tick.info["way"]
    energy = (info["energy_wh"] - before["energy_wh"]) / (ENERGY_SCALE * whole)
    slip = (info["foot_slip_m"] - before["foot_slip_m"]) / (2.0 * SUCCESS_SLIP)
    progress = (before["remaining"] - info["remaining"]) / whole
    return np.where(info["failure_code"] >= 0, -1.0, progress - energy - slip - _effort(config, tick) / CONTROL_RATE)


REWARDS: dict[str, Callable[[RewardConfig, Tick], np.ndarray]] = {
    "environment": lambda config, tick: tick.reward.copy(),
    "pose": _pose,
    "economy": _economy,
}
"""Training rewards by name."""
