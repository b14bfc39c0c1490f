"""Energy a metre: flight along a path, crawl at several joint speeds, and the take-off and landing between them."""

import math
import statistics
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium

from spidar_gym.benchmark.resume import finish
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.envs.registry import CRAWL, PATH
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.policies.rollout import rollout
from spidar_gym.studies.hops import HOP, Trip, manager_config

CRAWLERS = ("published", "robust_overlapped", "robust_retuned", "steady_crawl")
"""Default presets on the ground."""
FLIGHT = "steady"
"""Default preset in the air."""
JOINT_SPEEDS = (0.2, 0.4, 0.8)
"""Joint speeds of the crawl [rad/s]."""
SPEEDS = (0.3, 0.5, 1.0, 1.5)
"""Speeds along the path [m/s]."""
WAY = 0.6
"""Length of the crawl [m] [Zhao2025, Sec. Crawling Motion]."""
ROBOTS: dict[str, Any] = {"sensors": True, "randomization": 0.3}
"""Robots of both, as on the tracks of the ground."""
WARM_UP, MEASURED = 4.0, 16.0
"""Time of a flight before it is measured, and measured time [s]."""


@dataclass(frozen=True)
class Run:
    """One robot that flies or crawls, or takes off and lands."""

    preset: str
    """Preset of the controller."""
    gait: str
    """`fly`, `crawl` or `hop`."""
    speed: float
    """Speed along the path [m/s], or of the joints [rad/s]; 0 for a hop."""
    seed: int
    """Seed of robot and noise."""


def play(run: Run) -> dict[str, Any]:
    """Run one robot: energy [Wh], distance [m] and time [s], and what it missed of a success, empty for none."""
    if run.gait == "hop":
        trip = Trip(
            run.seed, strength=ROBOTS["randomization"], sense=True, manager=CoreManager(manager_config(run.preset))
        )
        seen = trip.fly(HOP)
        missed = "" if seen.done is not None and seen.phase[-1] == "lie" else "landing"
        return {"energy_wh": trip.plant.energy_wh, "distance_m": 0.0, "time_s": seen.time[-1], "missed": missed}
    if run.gait == "crawl":
        way = {"distance": WAY, "direction": 0.0, "turn": 0.0, "joint_speed": run.speed}
        env = gymnasium.make(CRAWL, preset=run.preset, **way, **ROBOTS)
        *_, last = rollout(env, None, seed=run.seed, until_finished=True)
        env.close()
        info = last.info
        missed = str(info["failure"] or info["shortfalls"])
        return {"energy_wh": info["energy_wh"], "distance_m": WAY, "time_s": info["time_s"], "missed": missed}
    horizon = WARM_UP + MEASURED
    env = gymnasium.make(
        PATH, preset=run.preset, path="lemniscate", speed=run.speed, forms="independent", horizon_s=horizon, **ROBOTS
    )
    steps = list(rollout(env, None, seed=run.seed))
    env.close()
    before, ticks, last = round(WARM_UP * CONTROL_RATE), len(steps), steps[-1].info
    missed = last["failure"] or ("" if ticks == round(horizon * CONTROL_RATE) else "duration")
    if ticks <= before:  # ended before it is measured: a miss, whose figures are those of the whole flight
        before, began = 0, 0.0
    else:
        began = steps[before - 1].info["energy_wh"]
    seconds = (ticks - before) / CONTROL_RATE
    return {
        "energy_wh": last["energy_wh"] - began, "distance_m": run.speed * seconds, "time_s": seconds, "missed": missed,
    }  # fmt: skip


def runs(crawlers: Iterable[str], flight: str, robots: int) -> list[list[Run]]:
    """Return the runs of every row of the table."""
    kinds = [(name, "crawl", speed) for name in crawlers for speed in JOINT_SPEEDS]
    kinds += [(flight, "fly", speed) for speed in SPEEDS]
    kinds.append((flight, "hop", 0.0))
    return [[Run(*kind, seed) for seed in range(robots)] for kind in kinds]


def energy_study(
    crawlers: Iterable[str], flight: str, robots: int, *, workers: int = 1, folder: Path | None = None,
    on_run: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Measure energy, distance and time of every gait; resumes from `folder`.

    Args:
        crawlers: Presets on the ground.
        flight: Preset in the air.
        robots: Number of robots of each row; seeds from 0.
        workers: Number of processes.
        folder: Folder for finished runs.
        on_run: Called after each run.

    Returns:
        One row for each gait and speed, with median, least and largest values over the robots that did not fail.

    Raises:
        UnknownNameError: For an unknown preset.
    """
    crawlers = tuple(crawlers)
    for name in crawlers:
        crawler_config(name)
    controller_config(flight)
    rows = runs(crawlers, flight, robots)
    flat = [run for row in rows for run in row]
    found = iter(finish(play, flat, workers=workers, folder=folder, on_done=lambda *_: on_run()))
    return [_row(row[0], [next(found) for _ in row]) for row in rows]


def _row(run: Run, played: list[dict[str, Any]]) -> dict[str, Any]:
    good = [one for one in played if not one["missed"]] or played

    def spread(values: list[float]) -> dict[str, float]:
        return {"median": statistics.median(values), "least": min(values), "most": max(values)}

    return {
        "preset": run.preset, "gait": run.gait, "speed": run.speed, "robots": len(played),
        "succeeded": sum(not one["missed"] for one in played),
        "missed": sorted({one["missed"] for one in played if one["missed"]}),
        "time_s": spread([one["time_s"] for one in good]), "energy_wh": spread([one["energy_wh"] for one in good]),
        "wh_per_m": spread([one["energy_wh"] / one["distance_m"] for one in good]) if run.gait != "hop" else None,
        "m_per_s": spread([one["distance_m"] / one["time_s"] for one in good]) if run.gait != "hop" else None,
    }  # fmt: skip


def break_even(row: Mapping[str, Any], rows: Iterable[Mapping[str, Any]]) -> float:
    """Return the length of a way from which on the best flight, with its hop, takes less energy [m]; inf if none."""
    rows = list(rows)
    hop = next(other["energy_wh"]["median"] for other in rows if other["gait"] == "hop")
    more = row["wh_per_m"]["median"] - min(other["wh_per_m"]["median"] for other in rows if other["gait"] == "fly")
    return float(hop / more) if more > 0.0 else math.inf


def energy_lines(rows: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return the table: one line for each gait and speed, with the range over robots."""
    rows = list(rows)
    lines = [
        ["gait", "preset", "speed", "succeeded", "m/s", "time [s]", "energy [Wh]", "Wh/m", "flight is better from"]
    ]
    units = {"crawl": "joints at {:g} rad/s", "fly": "{:g} m/s", "hop": "to 1 m and down"}
    for row in rows:
        missed = f" ({'; '.join(row['missed'])})" if row["missed"] else ""
        cells = [_range(row[key], digits) for key, digits in _COLUMNS]
        even = _length(break_even(row, rows)) if row["gait"] == "crawl" else "–"
        share = f"{row['succeeded']} of {row['robots']}{missed}"
        lines.append([row["gait"], f"`{row['preset']}`", units[row["gait"]].format(row["speed"]), share, *cells, even])
    return lines


def _length(even: float) -> str:
    return f"{even:.1f} m" if math.isfinite(even) else "never"


_COLUMNS = (("m_per_s", 3), ("time_s", 1), ("energy_wh", 2), ("wh_per_m", 2))


def _range(found: Mapping[str, float] | None, digits: int) -> str:
    return "–" if found is None else f"{found['least']:.{digits}f} … {found['most']:.{digits}f}"
