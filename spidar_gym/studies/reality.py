"""The paper's experiments on many robots, beside everything that was published of them: numbers, and words."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.paper.calibration import (
    CRAWL,
    CRAWL_NUMBERS,
    CRAWL_WORDS,
    FLIGHT,
    FLIGHT_NUMBERS,
    FLIGHT_WORDS,
    Run,
    play,
    require_world,
)
from spidar_gym.sim.randomize import Randomization

ALL = "all"
"""Group of all robots."""
EXPERIMENTS = ((FLIGHT, "as_flown_quasi"), (CRAWL, "published"), (CRAWL, "robust_overlapped"))
"""Experiments and their controllers."""
RMSE = ("rmse_x", "rmse_y", "rmse_z", "rmse_roll", "rmse_pitch", "rmse_yaw")
"""The flight's six errors."""


def measure(
    world: str, *, robots: int, workers: int = 1, folder: Path | None = None,
    experiments: Sequence[tuple[str, str]] = EXPERIMENTS, on_run: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run every experiment with `robots` robots of each mixture of a calibrated world; resumes from `folder`.

    Args:
        world: Name or file of the world. Its variants fly in turn.
        robots: Number of robots of each mixture.
        workers: Number of processes.
        folder: Folder for finished runs.
        experiments: Experiments with their controllers.
        on_run: Called after each run.

    Returns:
        For each experiment one row per mixture, one per variant, and one of all: see `summary`.
    """
    found = require_world(world)
    mixtures, variants = [name for name, _ in found.mixtures], [name for name, _ in found.variants]
    kinds = [(mixture, variants[k % len(variants)], k) for mixture in mixtures for k in range(robots)]
    hows = {(m, v): Randomization.parse(f"{world}:{m}-{v}") for m in mixtures for v in variants}
    runs = [Run(*each, hows[m, v], seed) for each in experiments for m, v, seed in kinds]
    done = finish(play, runs, workers=workers, folder=folder, on_done=lambda *_: on_run())
    rows = []
    for k, (name, preset) in enumerate(experiments):
        own = done[k * len(kinds) : (k + 1) * len(kinds)]
        for group in (*mixtures, *variants, ALL):
            members = [figures for figures, kind in zip(own, kinds, strict=True) if group in (*kind[:2], ALL)]
            rows.append({"experiment": name, "preset": preset, "robots of": group, **summary(name, members)})
    return rows


def reality_lines(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Return the tables of all experiments, a line per number and per inequality: the robots' beside the paper's."""
    lines = list[list[str]]()
    for experiment, preset in dict.fromkeys((row["experiment"], row["preset"]) for row in rows):
        own = [row for row in rows if (row["experiment"], row["preset"]) == (experiment, preset)]
        numbers, words = (FLIGHT_NUMBERS, FLIGHT_WORDS) if experiment == FLIGHT else (CRAWL_NUMBERS, CRAWL_WORDS)
        lines.append([f"{experiment}, {preset}", "paper", *(row["robots of"] for row in own)])
        for name, published in numbers.items():
            shown = [_shown(row["numbers"][name]) for row in own]
            lines.append([published.words, f"{published.value:g}", *shown])
        for name, word in words.items():
            lines.append([word.rule, f"“{word.words}”", *(f"{row['words'][name]:.0%}" for row in own)])
        if experiment == FLIGHT:
            widest = [max(row["numbers"][name]["ratio_90"] for name in RMSE) for row in own]
            lines.append(["largest ratio 95 % / 5 % of the six errors", "–", *(f"{w:.2f}" for w in widest)])
            nearer = [f"{row['nearer']:.0%}" if "nearer" in row else "–" for row in own]
            lines.append(["robots nearer to the centre than the paper's errors", "–", *nearer])
        lines.append(["failed", "0 of 1", *(f"{row['failed']} of {row['robots']}" for row in own)])
    return lines


def _shown(number: dict[str, Any]) -> str:
    low, high = number["central_60"]
    return f"{number['median']:.3g} [{low:.3g}, {high:.3g}]" + ("" if number["fits"] else " ✗")


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
