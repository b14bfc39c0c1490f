"""Flights of independent forms that controllers are tuned and compared on: same seeds, same forms, same robots."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import gymnasium
import numpy as np

import spidar_gym.envs.registry
from spidar_gym.control.controller import CONTROL_RATE, Controller, ControllerConfig
from spidar_gym.envs.hover import HoverEnv

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
    """Of forms, initial offset, robot, noise."""
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


@cache
def _environment(condition: str, joint_speed: float) -> HoverEnv:
    """One environment a process for each kind of trial."""
    spidar_gym.envs.registry.register()
    env = gymnasium.make(
        "spidar_gym/Hover-v0", forms="independent", joint_speed=joint_speed, perturbation=0.0, max_episode_steps=10**9,
        disable_env_checker=True, **CONDITIONS[condition],
    ).unwrapped  # fmt: skip
    assert isinstance(env, HoverEnv)
    return env


def fly(config: ControllerConfig, trial: Trial) -> Outcome:
    """Fly one trial with a controller; its joint speed becomes the trial's."""
    env = _environment(trial.condition, trial.joint_speed)
    env.controller = Controller(replace(config, joint_speed=trial.joint_speed), env.controller.model)
    env.reset(seed=trial.seed)
    action = np.zeros(env.action_space.shape or ())
    squares, softened, torque, failure = [], 0, 0.0, ""
    for _ in range(round(trial.seconds * CONTROL_RATE)):
        _, _, terminated, _, info = env.step(action)
        position, attitude = info["position_error"], info["attitude_error"]
        squares.append((float(position @ position), float(attitude @ attitude)))
        softened += info["qp_slack"] > 1e-6
        torque = max(torque, float(np.abs(info["joint_torque_allocated"]).max()))
        if terminated:
            failure = info["failure"]
            break
    counted = np.array(squares[round(SETTLE * CONTROL_RATE) :] or squares)
    late = len(env.progress.overdue())
    position, attitude = np.sqrt(counted.mean(axis=0)).tolist()
    return Outcome(position, attitude, softened, torque, late, failure)


def _fly(job: tuple[ControllerConfig, Trial]) -> Outcome:
    return fly(*job)


def fly_all(
    jobs: Iterable[tuple[ControllerConfig, Trial]],
    *,
    workers: int = 1,
    on_done: Callable[[], object] = lambda: None,
) -> list[Outcome]:
    """Fly many trials in `workers` processes; the outcomes come in the order of the jobs."""
    jobs = list(jobs)
    outcomes: list[Outcome] = []

    def collect(results: Iterator[Outcome]) -> None:
        for outcome in results:
            outcomes.append(outcome)
            on_done()

    if workers == 1:
        collect(map(_fly, jobs))
    else:
        with ProcessPoolExecutor(workers) as pool:
            collect(pool.map(_fly, jobs, chunksize=max(1, len(jobs) // (8 * workers))))
    return outcomes
