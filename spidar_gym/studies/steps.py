"""How high a step each gait climbs: tiles and stairs of swept heights, with feet lifted as they are, and higher."""

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
"""Presets, or policies that are a controller."""
HEIGHTS = (0.02, 0.04, 0.06, 0.08, 0.1)
"""Heights of the stairs, and of the highest tiles [m]."""
TERRAINS = ("tiles", "stairs")
"""What has steps."""
FEET = ("as it does", "higher")
"""How high feet are lifted: as the gait does, or by `RAISE`, the torso by at least `LIFT`."""
RAISE, LIFT = 0.3, 0.08
"""Angle of the legs [rad]: a foot rises by some 0.2 m; height of the torso [m]."""
OPTIONS = {"distance": 0.8, "direction": 0.0, "turn": 0.0, "sensors": True, "randomization": 0.3, "horizon_s": 150.0}
"""The way, and the robots: those of the track `ground-steps`."""


@dataclass(frozen=True)
class Case:
    """One robot on one floor."""

    gait: str
    """A preset, or a policy that is a controller."""
    feet: str
    """One of `FEET`."""
    terrain: str
    """One of `TERRAINS`."""
    height: float
    """Height of the steps [m]."""
    seed: int
    """Seed of robot, noise and tiles."""


def controller_of(gait: str) -> dict[str, Any]:
    """What `gym.make` is told of a gait: `controller`, a `CrawlerConfig`, and a `law` where it has one of its own.

    Raises:
        InvalidValueError: For a policy that is no controller on the ground; names that lead nowhere are refused as
            everywhere.
    """
    if ":" not in gait:
        return {"controller": crawler_config(gait)}
    found = policy_arguments(load_policy(gait), CRAWL) or {}
    config = found.get("controller") or (crawler_config(found["preset"]) if "preset" in found else None)
    if not isinstance(config, CrawlerConfig) or not found.keys() <= {"preset", "controller", "law"}:
        raise InvalidValueError(
            "gaits", gait, "a preset of the crawl, or module:CLASS of a policy that is a controller"
        )
    return {"controller": config, **({"law": found["law"]} if "law" in found else {})}


def gait_name(gait: str) -> str:
    """What a gait is called: its preset, or its policy's name."""
    return policy_name(load_policy(gait)) if ":" in gait else gait


def higher(config: CrawlerConfig) -> CrawlerConfig:
    """The same gait with feet and torso lifted higher."""
    gait = config.gait
    lifted = replace(
        gait, raise_angle=max(gait.raise_angle, RAISE), lift_height=max(gait.lift_height, LIFT)
    )  # fmt: skip
    return replace(config, gait=lifted)


def play(case: Case) -> dict[str, Any]:
    """Crawl once: `failure`, empty for a success, largest `slip_m` of a foot [m], `time_s` [s]."""
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
    """Gait, feet, terrain and height of every cell of the sweep."""
    return [(g, feet, terrain, h) for g in gaits for feet in FEET for terrain in TERRAINS for h in HEIGHTS]


def sweep(
    gaits: Sequence[str] = GAITS, *, seeds: int = 4, workers: int = 1, folder: Path | None = None,
    on_run: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Every gait on every floor, with `seeds` drawn robots each; what an interrupted call has played is kept.

    Returns:
        One row a cell: gait, feet, terrain, height [m], runs, successes, what the others lacked, medians of slip [m]
        and time [s].
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
    """The rows as a table: a line a gait and terrain, a column a height."""
    heights = sorted({row["height"] for row in rows})
    lines = [["gait", "feet lifted", "terrain", *(f"{1e3 * h:.0f} mm" for h in heights), "what the others lack"]]
    for gait, feet, terrain in dict.fromkeys((row["gait"], row["feet"], row["terrain"]) for row in rows):
        own = {r["height"]: r for r in rows if (r["gait"], r["feet"], r["terrain"]) == (gait, feet, terrain)}
        failures = Counter[str]()
        for row in own.values():
            failures.update(row["failures"])
        cells = (f"{own[h]['successes']} of {own[h]['runs']}, {1e3 * own[h]['slip_m']:.0f} mm" for h in heights)
        lacks = ", ".join(f"{word} {count}" for word, count in failures.most_common())
        lines.append([f"`{gait}`", feet, terrain, *cells, lacks])
    return lines
