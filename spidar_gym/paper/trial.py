"""Trials for the comparison of controllers: flights with independent legs, with the same seeds, forms and robots."""

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
"""Initial time that is excluded from the errors, since the servos have to settle [s]."""
CONDITIONS: dict[str, dict[str, Any]] = {
    "nominal": {},
    "randomised": {"randomization": 1.0, "sensors": True},
}
"""Conditions: the nominal robot, and a robot that is randomised at strength 1 and has noisy sensors."""


@dataclass(frozen=True)
class Trial:
    """Definition of one flight."""

    condition: str
    """One of `CONDITIONS`."""
    joint_speed: float
    """Joint speed [rad/s]."""
    seed: int
    """Seed of forms, robot and noise."""
    seconds: float = 12.0
    """Length [s]."""


@dataclass(frozen=True)
class Outcome:
    """Result of one flight; errors are RMS of norms without the first `SETTLE` seconds."""

    position: float
    """Position error [m]."""
    attitude: float
    """Attitude error [rad]."""
    softened: int
    """Number of ticks whose allocation has a slack above 1e-6."""
    joint_torque: float
    """Largest torque of the allocation, feed-forward included [Nm]."""
    late: int
    """Number of forms that were not reached within the grace time after their deadline."""
    failure: str
    """Reason of an early end; empty if the flight did not end early."""


def make_env(config: ControllerConfig, trial: Trial) -> HoverEnv:
    """Build the environment of a trial; the trial's joint speed replaces the controller's."""
    return HoverEnv(
        forms="independent", joint_speed=trial.joint_speed, perturbation=0.0, controller=config,
        **CONDITIONS[trial.condition],
    )  # fmt: skip


def fly(config: ControllerConfig, trial: Trial) -> Outcome:
    """Simulate one trial with a controller; the trial's joint speed replaces the controller's."""
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
    """Simulate many trials in `workers` processes; the outcomes are in the order of the jobs.

    Finished trials are stored in `folder`, and an interrupted call resumes from them.
    """
    found = finish(_fly, jobs, workers=workers, folder=folder, on_done=lambda *_: on_done())
    return [Outcome(**outcome) for outcome in found]
