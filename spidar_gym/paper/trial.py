"""Flights of independent forms that controllers are tuned and compared on: same seeds, same forms, same robots."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.control.flight.controller import CONTROL_RATE, ControllerConfig
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.policies.rollout import rollout

SETTLE = 1.0
"""Seconds of a flight that do not count: the flight starts on its reference, but its servos have not settled."""
CONDITIONS: dict[str, dict[str, Any]] = {
    "nominal": {},
    "randomised": {"randomization": 1.0, "sensors": True},
}
"""The robot of the description in its own wake; and one drawn at strength 1 with real sensors."""


@dataclass(frozen=True)
class Trial:
    """One flight."""

    condition: str
    """One of `CONDITIONS`."""
    joint_speed: float
    """[rad/s]."""
    seed: int
    """Seed of forms, initial offset, robot, noise."""
    seconds: float = 12.0
    """Length [s]."""


@dataclass(frozen=True)
class Outcome:
    """What one flight gave; RMS of norms, the first second left out."""

    position: float
    """[m]."""
    attitude: float
    """[rad]."""
    softened: int
    """Ticks whose allocation gave way: slack above 1e-6."""
    joint_torque: float
    """Largest torque of the allocation, feed-forward included [Nm]."""
    late: int
    """Forms that were not reached within the grace after their deadline."""
    failure: str
    """Why it ended early; empty if it did not."""


def make_env(config: ControllerConfig, trial: Trial) -> HoverEnv:
    """The environment of a trial with a controller; its joint speed is the trial's."""
    return HoverEnv(
        forms="independent", joint_speed=trial.joint_speed, perturbation=0.0, controller=config,
        **CONDITIONS[trial.condition],
    )  # fmt: skip


def fly(config: ControllerConfig, trial: Trial) -> Outcome:
    """Fly one trial with a controller; its joint speed becomes the trial's."""
    env = make_env(config, trial)
    squares, softened, torque, failure = [], 0, 0.0, ""
    for step in rollout(env, seed=trial.seed, ticks=round(trial.seconds * CONTROL_RATE)):
        info = step.info
        position, attitude = info["position_error"], info["attitude_error"]
        squares.append((float(position @ position), float(attitude @ attitude)))
        softened += info["qp_slack"] > 1e-6
        torque = max(torque, float(np.abs(info["joint_torque_allocated"]).max()))
        failure = info["failure"]
    counted = np.array(squares[round(SETTLE * CONTROL_RATE) :] or squares)
    late = len(env.progress.overdue())
    position, attitude = np.sqrt(counted.mean(axis=0)).tolist()
    return Outcome(position, attitude, softened, torque, late, failure)


def _fly(job: tuple[ControllerConfig, Trial]) -> dict[str, Any]:
    return asdict(fly(*job))


def fly_all(
    jobs: Iterable[tuple[ControllerConfig, Trial]],
    *,
    workers: int = 1,
    folder: Path | None = None,
    on_done: Callable[[], object] = lambda: None,
) -> list[Outcome]:
    """Fly many trials in `workers` processes; the outcomes come in the order of the jobs.

    Those of an interrupted call are in `folder`, and are not flown again.
    """
    found = finish(_fly, jobs, workers=workers, folder=folder, on_done=lambda *_: on_done())
    return [Outcome(**outcome) for outcome in found]
