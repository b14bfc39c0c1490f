"""Flight studies beyond the paper: error over joint speed, and the effect of each compensation."""

from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.statistics import Change, compare
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.presets import controller_config
from spidar_gym.paper.trial import CONDITIONS, Outcome, Trial, fly_all

SPEEDS = (0.2, 0.6, 1.0)
"""Joint speeds of the ablation [rad/s]."""
MANY_SPEEDS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Joint speeds of the figure [rad/s]."""
FIRST_SEED = 10_000
"""First seed of the flights."""
OFF: dict[str, Any] = {
    "no feed-forward": {"momentum_gain": 0.0},
    "no lead": {"vectoring_lead": 0.0},
    "no observer": {"observer_gain": 0.0},
    "no ramp of the joints": {"joint_ramp": 0.0},
}
"""Changes of `tuned` that switch off one option each."""


def controllers(ablation: bool) -> dict[str, ControllerConfig]:
    """Return the compared controllers: `paper` and `tuned`, and for an ablation `tuned` without each of its options.

    An ablation also has three combinations of the gains of one controller with options of the other.
    """
    tuned = controller_config("tuned")
    paper = controller_config("paper")
    found = {"paper": paper, "tuned": tuned}
    if not ablation:
        return found
    return {
        **found,
        **{name: replace(tuned, compensation=replace(tuned.compensation, **change)) for name, change in OFF.items()},
        "gains alone": replace(tuned, compensation=CompensationConfig()),
        "options on the paper's gains": replace(tuned, centroidal=paper.centroidal),
        "ramp on the paper's controller": replace(
            paper, compensation=CompensationConfig(joint_ramp=tuned.compensation.joint_ramp)
        ),
    }


def speed_study(
    *,
    speeds: tuple[float, ...] = SPEEDS,
    count: int = 24,
    ablation: bool = False,
    workers: int = 1,
    folder: Path | None = None,
    on_flight: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:
    """Simulate every controller in the same scenarios at every speed, nominal and randomised.

    Finished flights are stored in `folder`, and an interrupted call resumes from them.

    Returns:
        One row per controller and cell: errors, changes against `paper`, softened ticks, torque, late forms, losses.
    """
    configs = controllers(ablation)
    cells = list(product(CONDITIONS, speeds))
    jobs = [
        (config, Trial(condition, speed, FIRST_SEED + k))
        for condition, speed in cells
        for config in configs.values()
        for k in range(count)
    ]
    outcomes = iter(fly_all(jobs, workers=workers, folder=folder, on_done=on_flight))
    rng = np.random.Generator(np.random.PCG64(0))
    rows: list[dict[str, Any]] = []
    for condition, speed in cells:
        flown = {name: list(islice(outcomes, count)) for name in configs}
        for name in configs:
            rows.append({"condition": condition, "joint_speed": speed, "controller": name, **_row(flown, name, rng)})
    return rows


def _row(flown: dict[str, list[Outcome]], name: str, rng: np.random.Generator) -> dict[str, Any]:
    own = flown[name]

    def change(metric: str) -> Change:
        before, after = (np.array([getattr(o, metric) for o in outcomes]) for outcomes in (flown["paper"], own))
        return compare(before, after[None], rng)

    position, attitude = change("position"), change("attitude")
    return {
        "position_mm": 1e3 * position.after,
        "attitude_mrad": 1e3 * attitude.after,
        "position": asdict(position),
        "attitude": asdict(attitude),
        "softened_ticks": sum(o.softened for o in own),
        "max_joint_torque_nm": max(o.joint_torque for o in own),
        "late_forms": sum(o.late for o in own),
        "lost": sum(o.failure != "" for o in own),
        "flights": len(own),
    }


def speed_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the rows as a table; all columns except the first three are numbers."""

    def change(values: dict[str, float]) -> str:
        return f"{values['relative']:+.0%} [{values['low']:+.0%}, {values['high']:+.0%}]"

    heads = "condition", "rad/s", "controller", "position", "change", "attitude", "change", "soft", "τ max", "late"
    lines = [[*heads, "lost"]]
    for row in rows:
        same = row["controller"] == "paper"
        lines.append(
            [
                row["condition"],
                f"{row['joint_speed']:.1f}",
                row["controller"],
                f"{row['position_mm']:.1f} mm",
                "" if same else change(row["position"]),
                f"{row['attitude_mrad']:.1f} mrad",
                "" if same else change(row["attitude"]),
                f"{row['softened_ticks']}",
                f"{row['max_joint_torque_nm']:.2f} Nm",
                f"{row['late_forms']}",
                f"{row['lost']}/{row['flights']}",
            ]
        )
    return lines
