"""Crawl study: other directions, speeds and floors, weak actuators and randomised robots, with several seeds."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.control.allocation.allocator import ANSWERED
from spidar_gym.control.presets import crawler_config
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.paper.crawl import LIMIT, crawl_robot
from spidar_gym.policies.rollout import rollout
from spidar_gym.text import format_table

AHEAD = {"distance": 0.6, "direction": 0.0, "turn": 0.0}
"""The paper's goal."""


@dataclass(frozen=True)
class Case:
    """Configuration of one case of the study."""

    name: str
    """Name of the case."""
    preset: str = "published"
    """Crawler preset."""
    options: dict[str, Any] = field(default_factory=lambda: AHEAD)
    """Arguments of the environment."""
    crawler: dict[str, Any] = field(default_factory=dict)
    """Changes of the crawler's configuration."""
    gait: dict[str, Any] = field(default_factory=dict)
    """Changes of the gait's configuration."""
    actuators: dict[str, Any] = field(default_factory=dict)
    """Changes of the robot's actuators."""
    body: dict[str, Any] = field(default_factory=dict)
    """Changes of the robot's body."""
    randomised: bool = False
    """Whether the robots are randomised at strength 1, instead of sampled by `crawl_robot`."""


def _way(distance: float, direction: float = 0.0, turn: float = 0.0) -> dict[str, Any]:
    return {"distance": distance, "direction": math.radians(direction), "turn": turn}


_HARD: tuple[tuple[str, dict[str, Any]], ...] = (
    ("slope 10°", {"options": AHEAD | {"slope": math.radians(10.0)}}),
    ("steps of 20 mm", {"options": AHEAD | {"steps": 0.02}}),
    ("foot friction 0.4", {"body": {"foot_friction": 0.4}}),
    ("thrust gain 0.85", {"actuators": {"thrust_gain": 0.85}}),
    ("servos of 5.5 Nm", {"actuators": {"max_joint_torque": 5.5}}),
)
_LOOSE = {"joint_kd": 1.0, "joint_damping": 0.1}
CASES: tuple[Case, ...] = (
    Case("the paper's way"),
    Case("… overlapped, 0.2 rad/s", "overlapped"),
    Case("… overlapped, 0.4 rad/s", "overlapped", AHEAD | {"joint_speed": 0.4}),
    Case("… robust", "robust"),
    Case("… power cost", crawler={"power": True}),
    Case("… power cost, 6 Nm", crawler={"power": True, "torque_limit": 6.0}),
    Case("… the lab's strides, home + S", gait={"stride": "home", "inner": -0.45, "outer": 1.18}),
    Case("2 m", options=_way(2.0)),
    Case("backwards", options=_way(0.6, 180.0)),
    Case("to the left", options=_way(0.6, 90.0)),
    Case("to the right", options=_way(0.6, -90.0)),
    Case("diagonal", options=_way(0.6, 45.0)),
    Case("arc of 0.45 m and 0.6 rad", options=_way(0.45, 0.0, 0.6)),
    Case("turn of 3 × 0.5 rad", options=_way(0.0, 0.0, 1.5)),
    *(Case(f"{name}, {preset}", preset, **change) for name, change in _HARD for preset in ("published", "robust")),
    Case("servos kd 1", actuators=_LOOSE),
    Case("servos kd 1, no feed-forward", actuators=_LOOSE, crawler={"feed_forward": 0.0}),
    Case("servos kd 1, damping by thrust", actuators=_LOOSE, crawler={"leg_damping": 2.0}),
    Case("servos kd 1, setpoints filtered", actuators=_LOOSE, crawler={"setpoint_filter": 0.2}),
)
"""Default cases."""
RANDOM_CASES = tuple(Case(f"randomised, {p}", p, {}, randomised=True) for p in ("published", "robust"))
"""Cases with robots and goals that are sampled from the seed."""


def run_case(case: Case, seed: int) -> dict[str, Any]:
    """Simulate one case with one seed; return its figures, and the reasons of a failure."""
    config = crawler_config(case.preset)
    config = replace(config, **case.crawler, gait=replace(config.gait, **case.gait))
    robot: dict[str, Any] = {"sensors": True, "randomization": 1.0}
    if not case.randomised:
        plant = crawl_robot(np.random.Generator(np.random.PCG64(seed)))
        plant = replace(plant, body=replace(plant.body, **case.body))
        robot = {"plant": replace(plant, actuators=replace(plant.actuators, **case.actuators))}
    env = CrawlEnv(**case.options, **robot, controller=config, horizon_s=LIMIT)
    power, rates, unsolved, largest, last, named = [], [], 0, 0.0, 0.0, True
    info: dict[str, Any] = {}
    for step in rollout(env, seed=seed, ticks=env.horizon):
        info = step.info
        power.append(info["power_w"])
        unsolved += info["qp_status"] not in ANSWERED
        named = named and info["qp_status"] != "none"
        thrust = float(info["thrust_command"].sum())
        largest, last = max(largest, abs(thrust - last)), thrust
        if info["phase"] == "swing":
            rates.append(env.state.joint_velocity[1::4])
    x, y, yaw = info["goal_error"].tolist()
    return {
        "case": case.name,
        "preset": case.preset,
        "seed": seed,
        "success": bool(info["is_success"]),
        "shortfalls": info["failure"] or info["shortfalls"],
        "duration_s": float(info["time_s"]),
        "error_x_m": x,
        "error_y_m": y,
        "error_m": math.hypot(x, y),
        "yaw_rad": abs(yaw),
        "roll_pitch_legs_rad": env.progress.tilt_legs,
        "roll_pitch_torso_rad": env.progress.tilt_torso,
        "slip_m": info["foot_slip_m"],
        "peg_slip_m": info["peg_slip_m"],
        "saturation": info["saturation_share"],
        "thrust_mean": info["thrust_fraction_mean"],
        "thrust_peak": info["thrust_fraction_peak"],
        "thrust_step_n": largest,
        "airborne": info["airborne_share"],
        "duct_m": info["duct_clearance_m"],
        "timeouts": info["timeouts"],
        "power_w": float(np.mean(power)),
        "energy_wh": info["energy_wh"],
        "ripple_rad_s": float(np.sqrt(np.mean(np.square(rates)))) if rates else 0.0,
        "unsolved": unsolved,
        "named": named,
    }


def _run(job: tuple[Case, int]) -> dict[str, Any]:
    return run_case(*job)


def run_cases(
    cases: Sequence[Case],
    seeds: Sequence[int],
    *,
    workers: int = 1,
    folder: Path | None = None,
    on_run: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:
    """Simulate every case with every seed in `workers` processes; the rows are in this order.

    Finished runs are stored in `folder`, and an interrupted call resumes from them.
    """
    jobs = [(case, seed) for case in cases for seed in seeds]
    return finish(_run, jobs, workers=workers, folder=folder, on_done=lambda *_: on_run())


def _worst(values: list[float]) -> float:
    return max(map(abs, values))


COLUMNS: dict[str, tuple[str, Callable[[list[float]], float], float, tuple[str, ...]]] = {
    "T [s]": ("{:.1f}", np.median, 1.0, ("duration_s",)),
    "|x|,|y| mm": ("{:.1f}, {:.1f}", _worst, 1e3, ("error_x_m", "error_y_m")),
    "yaw": ("{:.4f}", _worst, 1.0, ("yaw_rad",)),
    "tilt legs/torso": ("{:.3f}/{:.3f}", _worst, 1.0, ("roll_pitch_legs_rad", "roll_pitch_torso_rad")),
    "slip mm": ("{:.0f}", _worst, 1e3, ("slip_m",)),
    "sat.": ("{:.1%}", _worst, 1.0, ("saturation",)),
    "Σλ/mg": ("{:.3f}", np.median, 1.0, ("thrust_mean",)),
    "peak": ("{:.3f}", _worst, 1.0, ("thrust_peak",)),
    "air": ("{:.0%}", min, 1.0, ("airborne",)),
    "duct mm": ("{:.0f}", min, 1e3, ("duct_m",)),
    "W": ("{:.0f}", np.median, 1.0, ("power_w",)),
    "ripple": ("{:.0f}", np.median, 1e3, ("ripple_rad_s",)),
    "ΔΣλ N": ("{:.1f}", _worst, 1.0, ("thrust_step_n",)),
}
"""Columns of the table by heading: format, statistic over the seeds of a case, factor, and figures."""


def study_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the table with one line per case.

    Duration, mean thrust, power and ripple are medians over the seeds; all other columns show the worst seed.
    """
    lines = [["case", "success", *COLUMNS]]
    for name in dict.fromkeys(row["case"] for row in rows):
        own = [row for row in rows if row["case"] == name]
        cells = [
            form.format(*(factor * taken([row[key] for row in own]) for key in keys))
            for form, taken, factor, keys in COLUMNS.values()
        ]
        lines.append([name, f"{sum(row['success'] for row in own)}/{len(own)}", *cells])
    return lines


def study_table(rows: list[dict[str, Any]]) -> str:
    """Return the table of the cases as text, followed by the unsuccessful runs."""
    misses = [f"{row['case']}, seed {row['seed']}: {row['shortfalls']}" for row in rows if not row["success"]]
    unsolved = sum(row["unsolved"] for row in rows)
    remarks = [f"ticks without an optimum, all runs: {unsolved}"]
    remarks += [f"unsuccessful: {'; '.join(misses)}"] if misses else []
    return "\n".join([format_table(study_lines(rows), left=1), "", *remarks])
