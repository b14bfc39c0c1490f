"""The frontier of error against margin: flight controllers, as they are and slower or faster, on calibrated robots."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.resume import finish
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import CALIBRATED, FLIGHT, TRACKS
from spidar_gym.errors import InvalidValueError
from spidar_gym.margins import WORLD, arguments_of, flight_law, flight_mode, leg_margins, robots_of
from spidar_gym.policies.presets import OwnController
from spidar_gym.tune.flight import scaled

CONTROLLERS = (
    "paper", "tuned_v1", "tuned", "retuned", "steady", "baselines.adrc:Adrc", "baselines.indi:Indi",
    "baselines.compensation:Compensation", "baselines.steady_rivals:AdrcSteady", "baselines.steady_rivals:IndiSteady",
    "baselines.steady_rivals:CompensationSteady",
)  # fmt: skip
"""Presets and rivals whose gains can be scaled."""
SCALES = (0.6, 0.8, 1.0, 1.2)
"""Factors on the bandwidth: a controller that is f times as fast has f² times the proportional, f³ times the integral
and f times the differential gains."""
SCENARIOS = 24
"""Number of scenarios of each track."""
SPLIT = "validation"
"""Split of the scenarios; no row and no search uses it."""


@dataclass(frozen=True)
class Point:
    """A controller with scaled gains."""

    controller: str
    """Preset, or `module:Class`."""
    scale: float
    """Factor on its bandwidth."""


def scalable(name: str) -> dict[str, Any]:
    """Return the arguments of `gym.make` of a controller whose gains can be scaled.

    Raises:
        SpidarError: For a controller that does not exist, or is no configuration of the package's flight controller.
    """
    arguments = dict(arguments_of(name))
    if "law" in arguments:
        raise InvalidValueError("controllers", name, "controllers with gains: presets, or policies without a law")
    return arguments


def measure(point: Point) -> dict[str, Any]:
    """Compute the worst margins of a controller, and its errors and failures on the calibrated tracks of flight."""
    arguments = scalable(point.controller)
    arguments["controller"] = scaled(flight_law(arguments).config, point.scale)
    margins = leg_margins(flight_law(arguments), robots_of(WORLD), mode=flight_mode(arguments))
    tracks = [name for name, track in TRACKS.items() if track.group == CALIBRATED[FLIGHT]]
    played = [play(OwnController(arguments), track, load_scenarios(track, SPLIT)[0][:SCENARIOS]) for track in tracks]
    errors = np.array([[one["metrics"]["error"] for one in runs] for runs in played])
    failed = sum(one["metrics"]["failed"] for runs in played for one in runs)
    return {
        "controller": point.controller, "scale": point.scale, "gain": margins.gain, "delay": margins.delay,
        "ringing": margins.ringing, "error": float(np.exp(np.log(errors.mean(axis=1)).mean())),
        "error_described": float(errors[:, ::2].mean()), "failed": failed / errors.size,
    }  # fmt: skip


def frontier_study(
    controllers: Sequence[str], scales: Sequence[float], *, workers: int = 1, folder: Path | None = None,
    on_done: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Measure controllers at every scale; resumes from `folder` (errors as `scalable`)."""
    for name in controllers:
        scalable(name)
    points = [Point(name, scale) for name in controllers for scale in scales]
    return finish(measure, points, workers=workers, folder=folder, on_done=lambda *_: on_done())


def frontier_lines(rows: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return the table: one line for each controller and scale."""
    lines = [["controller", "bandwidth", "gain margin", "delay margin", "error", "on described robots", "failed"]]
    for row in rows:
        lines.append([
            row["controller"], f"× {row['scale']:g}", f"{row['gain']:.2f}", f"{1e3 * row['delay']:.0f} ms",
            f"{row['error']:.3f}", f"{row['error_described']:.3f}", f"{row['failed']:.0%}",
        ])  # fmt: skip
    return lines
