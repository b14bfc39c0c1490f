"""The paper's experiments on many robots, beside everything that was published of them: numbers, and words."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.paper.calibration import (
    CRAWL_NUMBERS,
    CRAWL_WORDS,
    FLIGHT_NUMBERS,
    FLIGHT_WORDS,
    crawl_robot,
    fly_robot,
)
from spidar_gym.sim.randomize import Randomization

FLIGHT, CRAWL = "flight", "crawl"
"""The paper's experiments."""
EXPERIMENTS = ((FLIGHT, "as_flown_quasi"), (CRAWL, "published"), (CRAWL, "robust_overlapped"))
"""Experiments and their controllers."""
RMSE = ("rmse_x", "rmse_y", "rmse_z", "rmse_roll", "rmse_pitch", "rmse_yaw")
"""The flight's six errors."""


@dataclass(frozen=True)
class Run:
    """An experiment with one robot."""

    experiment: str
    """`FLIGHT` or `CRAWL`."""
    preset: str
    """Controller."""
    randomization: Randomization
    """Distribution of the robot."""
    seed: int
    """Seed of the robot and its noise."""


def play(run: Run) -> dict[str, float]:
    """Simulate an experiment, and return its figures."""
    call = fly_robot if run.experiment == FLIGHT else crawl_robot
    return call(run.preset, run.randomization, run.seed)


def measure(
    randomization: Randomization, *, robots: int, workers: int = 1, folder: Path | None = None,
    experiments: Sequence[tuple[str, str]] = EXPERIMENTS, on_run: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run every experiment with `robots` robots; resumes from `folder`.

    Returns:
        One row per experiment: see `summary`.
    """
    runs = [Run(*each, randomization, seed) for each in experiments for seed in range(robots)]
    found = finish(play, runs, workers=workers, folder=folder, on_done=lambda *_: on_run())
    return [
        {"experiment": name, "preset": preset, **summary(name, found[k * robots : (k + 1) * robots])}
        for k, (name, preset) in enumerate(experiments)
    ]


def summary(experiment: str, figures: Sequence[dict[str, float]]) -> dict[str, Any]:
    """Compare the figures of many robots with what was published.

    Returns:
        Number of robots and of those that fell. For each published number: median, limits of the central 60 % and of
        the central 90 % over robots, ratio of the latter, and whether the number is within the central 60 %. For each
        inequality the share of robots that keep it. For flights the share of robots whose six errors are nearer to
        their mean than the published ones, by the Mahalanobis distance of the logarithms.
    """
    numbers, words = (FLIGHT_NUMBERS, FLIGHT_WORDS) if experiment == FLIGHT else (CRAWL_NUMBERS, CRAWL_WORDS)
    standing = [each for each in figures if not each["failed"]]
    row: dict[str, Any] = {"robots": len(figures), "failed": len(figures) - len(standing), "numbers": {}, "words": {}}
    for name, published in numbers.items():
        values = np.array([each[name] for each in standing])
        low, least, middle, most, high = np.quantile(values, [0.05, 0.2, 0.5, 0.8, 0.95]).tolist()
        row["numbers"][name] = {
            "published": published.value, "median": middle, "central_60": [least, most], "central_90": [low, high],
            "ratio_90": high / low if low > 0.0 else None, "fits": published.matches(least, most),
        }  # fmt: skip
    for name, word in words.items():
        row["words"][name] = float(np.mean([word.holds(each) for each in figures]))
    if experiment == FLIGHT and len(standing) > len(RMSE):
        row["nearer"] = _nearer(np.log([[each[name] for name in RMSE] for each in standing]))
    return row


def _nearer(errors: np.ndarray) -> float:
    """Return the share of robots that are nearer to the mean than the published errors, in log space (robots, 6)."""
    middle, inverse = errors.mean(axis=0), np.linalg.inv(np.cov(errors.T))
    away = np.log([FLIGHT_NUMBERS[name].value for name in RMSE]) - middle
    own = np.einsum("ij,jk,ik->i", errors - middle, inverse, errors - middle)
    return float(np.mean(own < away @ inverse @ away))
