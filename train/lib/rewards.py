"""Training rewards; leaderboard rows are ranked by the errors of the tracks, independent of the reward."""

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
    """Training reward and its units."""

    reward: str = "environment"
    """Reward of a control tick: environment, pose or economy."""
    position: float = 0.01
    """Position error that halves its term of the reward `pose` [m], averaged over the tracks. On each track this and
    the next three units are scaled by the base's errors, so that all tracks count alike."""
    attitude: float = 0.02
    """Attitude error that halves its term of `pose` [rad], averaged over the tracks."""
    velocity: float = 0.0
    """Velocity error that halves its term of `pose` [m/s]; 0 omits the term."""
    rate: float = 0.0
    """Angular velocity error that halves its term of `pose` [rad/s]; 0 omits the term."""
    apart: bool = False
    """Whether to scale units by the base's error of the same kind, position or attitude; else by the mean of both."""
    far_position: float = 0.0
    """Position error that halves a second, wider term of `pose` [m], the same on each track: it guides the learner
    where the other terms are nearly 0. 0 omits the term."""
    far_attitude: float = 0.0
    """Attitude error that halves a second, wider term of `pose` [rad]; 0 omits the term."""
    joint: float = 0.0
    """Largest joint error from the schedule that halves its term of `pose` [rad]; 0 omits the term."""
    change: float = 0.0
    """Cost in `pose` of a change of all entries of the action by 1 per step; it grows with the square of the change."""
    penalty: float = 0.05
    """Penalty on the mean square action, as a fraction of the reward; reached at the largest action."""
    reward_shift: float = 0.0
    """Constant subtracted from the reward of every tick, so that the critic's initial values are nearly correct."""
    reward_scale: float = 1.0
    """Factor applied to the shifted reward."""

    def __post_init__(self) -> None:
        require_name("reward", self.reward, REWARDS)

    def __call__(self, tick: "Tick") -> np.ndarray:
        """Compute the rewards of a tick, shifted and scaled (robots,)."""
        return self.reward_scale * (REWARDS[self.reward](self, tick) - self.reward_shift)


@dataclass
class Tick:
    """Inputs of the reward of a tick; each array has an entry for every robot."""

    reward: np.ndarray
    """Reward of the environment."""
    info: Mapping[str, np.ndarray]
    """`info` of this tick; for flights also `velocity_error` [m/s], `rate_error` [rad/s], `joint_error` [rad]; for
    crawls also `remaining`, the distance to the goal [m], and `way`, that distance at the start [m]."""
    before: Mapping[str, np.ndarray]
    """`info` of the previous tick, with the same entries."""
    action: np.ndarray
    """Actions passed to the environment, within ± 1."""
    change: np.ndarray
    """Root mean square difference between the policy's action and its previous one."""


def _effort(config: RewardConfig, tick: Tick) -> np.ndarray:
    """Compute the cost of the actions: `penalty` for the largest ones."""
    return config.penalty * np.square(tick.action).mean(axis=1)


def _pose(config: RewardConfig, tick: Tick) -> np.ndarray:
    """Compute the mean of 1/(1 + (e/e₀)²) over the terms, reduced by the action's costs; 0 after a failure."""
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
    """Compute the covered fraction of the distance, minus the costs of energy, slip and action; −1 for a failure.

    An energy of 20 Wh/m costs as much as the whole distance gains. A success is not rewarded: it depends on the last of
    about 80 actions (10 mm at the goal), and its reward would dominate what the critic has to predict.
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
