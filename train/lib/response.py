"""Pulse response of the pose error to a residual wrench, measured on the closed loop with any controller."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

import spidar_gym.envs.registry
from spidar_gym.benchmark.track import HOVER
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.policies.rollout import rollout
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import FlightStart, FormGoal, draw_start
from train.lib.envs import training_seed

if TYPE_CHECKING:
    import torch

SETTLE = 40
"""Ticks of hovering before a pulse."""
PULSE = 0.2
"""Size of a pulse, as a fraction of the action's range."""
POSE = 6
"""Entries of a pose error: three of position [m], three of attitude [rad]."""
RESPONSE_S = 5.0
"""Length of a response [s]; the remainder after it is small."""
RESPONSE_TICKS = round(RESPONSE_S * CONTROL_RATE)
"""Length of a response [control ticks]."""


def pose_error(info: Mapping[str, Any]) -> np.ndarray:
    """Return position error, world axes [m], and attitude error, torso axes [rad], shape (6,)."""
    return np.concatenate((info["position_error"], info["attitude_error"]))


def pulse_response(arguments: Mapping[str, Any], seed: int, ticks: int, control: str) -> np.ndarray:
    """Measure the change of the pose error after a one-tick pulse on each entry of the residual wrench.

    The robot hovers in a form sampled from the seed, once with each pulse and once without. The difference of the pose
    errors is divided by the size of the pulse.

    Args:
        arguments: Arguments of `gym.make`: action mode and controller.
        seed: Seed of the form and the episode.
        ticks: Length of the response [control ticks].
        control: `python` or `core`.

    Returns:
        Shape (6 errors, 6 entries, ticks): [m] and [rad] for an action of 1.
    """
    spidar_gym.envs.registry.register()
    env = gymnasium.make(
        HOVER, forms="independent", perturbation=0.0, control=control, disable_env_checker=True,
        max_episode_steps=10**9, **arguments,
    )  # fmt: skip
    form = draw_start(HoverTask(forms="independent"), np.random.Generator(np.random.PCG64(seed))).goals[0].joint_target
    start = FlightStart((FormGoal(0.0, 0.0, form),), np.zeros(3), np.zeros(3))
    found = []
    for pulse in np.vstack((np.zeros(POSE), PULSE * np.eye(POSE))):
        options = {"start": start}
        steps = rollout(env, _Pulse(pulse), seed=training_seed(seed, 2), options=options, ticks=SETTLE + ticks)
        found.append([pose_error(step.info) for step in steps])
    env.close()
    errors = np.array(found)
    return ((errors[1:] - errors[0]) / PULSE)[:, SETTLE:].transpose(2, 0, 1)


class _Pulse:
    """Policy of zero actions, except for a pulse of one tick after the robot has settled."""

    def __init__(self, pulse: np.ndarray) -> None:
        self._pulse, self._tick = pulse, 0

    def reset(self, seed: int) -> None:
        self._tick = 0

    def act(self, observation: np.ndarray) -> np.ndarray:
        action = self._pulse if self._tick == SETTLE else np.zeros(POSE)
        self._tick += 1
        return action


def respond(response: "torch.Tensor", wrench: "torch.Tensor") -> "torch.Tensor":
    """Convolve a residual wrench (ticks, 6) with the response: the pose error (ticks, 6) that it causes.

    Args:
        response: Pulse response of shape (6, 6, length), last tick first.
        wrench: Residual wrench as an action, within ± 1.
    """
    from torch.nn import functional  # imported late so that `--help` works without torch

    padded = functional.pad(wrench.T[None], (response.shape[2] - 1, 0))
    return functional.conv1d(padded, response)[0].T
