"""Climbing limits of the gaits: a sweep of the heights of tiles and stairs, with default and higher foot lift."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.presets import crawler_config
from spidar_gym.envs.registry import CRAWL
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_arguments, policy_name
from spidar_gym.policies.rollout import rollout

GAITS = ("robust", "robust_overlapped", "baselines.walking:Walking")
"""Crawler presets, or policies that only select a controller."""
HEIGHTS = (0.02, 0.04, 0.06, 0.08, 0.1)
"""Heights of the steps of stairs, and of the highest tile [m]."""
TERRAINS = ("tiles", "stairs")
"""Floors with steps."""
FEET = ("as it does", "higher")
"""Foot lift: the gait's default, or at least `RAISE`, with a torso lift of at least `LIFT`."""
RAISE, LIFT = 0.3, 0.08
"""Angle by which the legs are raised [rad], which lifts a foot by about 0.2 m; lift of the torso [m]."""
OPTIONS = {"distance": 0.8, "direction": 0.0, "turn": 0.0, "sensors": True, "randomization": 0.3, "horizon_s": 150.0}
"""Goal and robots, as on the track `ground-steps`."""


@dataclass(frozen=True)
class Case:
    """One robot on one floor."""

    gait: str
    """Crawler preset, or policy that only selects a controller."""
    feet: str
    """One of `FEET`."""
    terrain: str
    """One of `TERRAINS`."""
    height: float
    """Height of the steps [m]."""
    seed: int
    """Seed of robot, noise and tiles."""


def controller_of(gait: str) -> dict[str, Any]:
    """Return a gait's arguments of `gym.make`: `controller`, a `CrawlerConfig`, and `law` for a custom control law.

    Raises:
        InvalidValueError: For a policy that does not only select a controller on the ground.
        UnknownNameError: For an unknown preset.
        PolicyError: For an unknown policy.
    """
    if ":" not in gait:
        return {"controller": crawler_config(gait)}
    found = policy_arguments(load_policy(gait), CRAWL) or {}
    config = found.get("controller") or (crawler_config(found["preset"]) if "preset" in found else None)
    if not isinstance(config, CrawlerConfig) or not found.keys() <= {"preset", "controller", "law"}:
        raise InvalidValueError(
            "gaits", gait, "a crawler preset, or module:CLASS of a policy that only selects a controller"
        )
    return {"controller": config, **({"law": found["law"]} if "law" in found else {})}


def gait_name(gait: str) -> str:
    """Return the name of a gait: its preset, or its policy's name."""
    return policy_name(load_policy(gait)) if ":" in gait else gait


def higher(config: CrawlerConfig) -> CrawlerConfig:
    """Return a gait with higher lift of feet and torso."""
    gait = config.gait
    lifted = replace(
        gait, raise_angle=max(gait.raise_angle, RAISE), lift_height=max(gait.lift_height, LIFT)
    )  # fmt: skip
    return replace(config, gait=lifted)


def play(case: Case) -> dict[str, Any]:
    """Run one episode: `failure`, empty for a success, largest `slip_m` of a foot [m], `time_s` [s]."""
    arguments = controller_of(case.gait)
    if case.feet == FEET[1]:
        arguments["controller"] = higher(arguments["controller"])
    env = gymnasium.make(CRAWL, steps=case.height, terrain=case.terrain, **arguments, **OPTIONS)
    *_, last = rollout(env, None, seed=case.seed, until_finished=True)
    env.close()
    info = last.info
    failure = info["failure"] or info["shortfalls"]
    return {"failure": failure, "slip_m": float(info["foot_slip_m"]), "time_s": float(info["time_s"])}


def cells(gaits: Sequence[str] = GAITS) -> list[tuple[str, str, str, float]]:
    """Return gait, foot lift, terrain and height of every cell of the sweep."""
    return [(g, feet, terrain, h) for g in gaits for feet in FEET for terrain in TERRAINS for h in HEIGHTS]


def sweep(
    gaits: Sequence[str] = GAITS, *, seeds: int = 4, workers: int = 1, folder: Path | None = None,
    on_run: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run every gait on every floor, with `seeds` randomised robots each.

    Finished runs are stored in `folder`, and an interrupted call resumes from them.


    Returns:
        One row per cell: gait, foot lift, terrain, height [m], number of runs and successes, failures, medians of slip
        [m] and time [s].
    """
    names = {gait: gait_name(gait) for gait in gaits}
    cases = [Case(*cell, seed) for cell in cells(gaits) for seed in range(seeds)]
    found = finish(play, cases, workers=workers, folder=folder, on_done=lambda *_: on_run())
    rows = []
    for k, (gait, feet, terrain, height) in enumerate(cells(gaits)):
        own = found[k * seeds : (k + 1) * seeds]
        failures = Counter(word for run in own if run["failure"] for word in run["failure"].split(", "))
        rows.append({
            "gait": names[gait], "feet": feet, "terrain": terrain, "height": height, "runs": seeds,
            "successes": sum(not run["failure"] for run in own), "failures": dict(sorted(failures.items())),
            "slip_m": float(np.median([run["slip_m"] for run in own])),
            "time_s": float(np.median([run["time_s"] for run in own])),
        })  # fmt: skip
    return rows


def step_lines(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Return the rows as a table, with one line per gait and terrain, and one column per height."""
    heights = sorted({row["height"] for row in rows})
    lines = [["gait", "feet lifted", "terrain", *(f"{1e3 * h:.0f} mm" for h in heights), "failures"]]
    for gait, feet, terrain in dict.fromkeys((row["gait"], row["feet"], row["terrain"]) for row in rows):
        own = {r["height"]: r for r in rows if (r["gait"], r["feet"], r["terrain"]) == (gait, feet, terrain)}
        failures = Counter[str]()
        for row in own.values():
            failures.update(row["failures"])
        cells = (f"{own[h]['successes']} of {own[h]['runs']}, {1e3 * own[h]['slip_m']:.0f} mm" for h in heights)
        lacks = ", ".join(f"{word} {count}" for word, count in failures.most_common())
        lines.append([f"`{gait}`", feet, terrain, *cells, lacks])
    return lines
