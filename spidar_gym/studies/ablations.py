"""Ablations of the best controllers: one part switched off at a time, on every track of flight and ground."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.resume import finish
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.statistics import (
    Numbers,
    Strata,
    named_generator,
    overall_score,
    stratified_bootstrap,
)
from spidar_gym.benchmark.track import SCENARIOS, TRACKS
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import GaitConfig
from spidar_gym.control.flight.centroidal import CentroidalConfig, Gains
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.policies.presets import OwnController

BEST = {"flight": "retuned", "ground": "robust_retuned"}
"""Preset whose parts are removed, by group of tracks."""
WHOLE = "all of it"
"""Name of the complete controller."""
OVERALL = "overall"
"""Name of the geometric mean over the tracks."""


def _without_integral(gains: tuple[Gains, ...]) -> tuple[Gains, ...]:
    return tuple((p, 0.0, d) for p, _, d in gains)


def flights() -> dict[str, dict[str, Any]]:
    """Return the best flight controller, complete and without each part: name → arguments of `gym.make`."""
    best = controller_config(BEST["flight"])
    gains, options = best.centroidal, best.compensation

    def less(**off: Any) -> ControllerConfig:  # noqa: ANN401 - fields of several types
        return replace(best, compensation=replace(options, **off))

    found = {
        "no feed-forward of the legs": less(momentum_gain=0.0),
        "no lead of the vectoring": less(vectoring_lead=0.0),
        "no lead compensator": less(lead_gain=0.0),
        "no observer": less(observer_gain=0.0),
        "one observer for force and torque": less(
            torque_observer_gain=0.0, torque_observer_time=0.0, torque_observer_lag=0.0
        ),
        "no ramp of the joints": less(joint_ramp=0.0),
        "no integrals": replace(
            best,
            centroidal=replace(
                gains,
                position_gains=_without_integral(gains.position_gains),
                attitude_gains=_without_integral(gains.attitude_gains),
            ),
        ),
        "the paper's gains": replace(best, centroidal=CentroidalConfig()),
        "gains alone": replace(best, compensation=ControllerConfig().compensation),
    }
    return {name: {"controller": config} for name, config in {WHOLE: best, **found}.items()} | {
        "no rows against interference": {"controller": best, "avoid_interference": False}
    }


def crawls() -> dict[str, dict[str, Any]]:
    """Return the best crawler, complete and without each part: name → arguments of `gym.make`."""
    best, plain = crawler_config(BEST["ground"]), CrawlerConfig()
    gait = best.gait

    def less(**off: Any) -> CrawlerConfig:  # noqa: ANN401 - fields of several types
        return replace(best, gait=replace(gait, **off))

    phases = ("swing_at", "lower_at", "forward_at", "down_at")
    rests = ("start_time", "spool_time", "settle_time", "leg_touch_time", "torso_touch_time")
    heights, strides = ("lift_height", "raise_angle"), ("max_distance", "inner", "outer")

    def papers(names: tuple[str, ...]) -> dict[str, Any]:
        return {name: getattr(GaitConfig(), name) for name in names}

    found = {
        "least power in place of ‖f‖²": replace(best, power=True),
        "no answer to the legs' errors": replace(best, leg_stiffness=0.0, leg_damping=0.0),
        "no feed-forward of joint torque": replace(best, feed_forward=0.0),
        "feet that do not roll": less(rolling=False),
        "no trim of the torso's way": less(trim_gain=0.0),
        "phases one after the other": less(**papers(phases)),
        "the paper's rests": less(**papers(rests)),
        "the paper's heights": less(**papers(heights)),
        "the paper's strides": less(**papers(strides)),
        "the paper's torque limit": replace(best, torque_limit=plain.torque_limit),
        "the paper's friction": replace(best, foot_friction=plain.foot_friction),
    }
    return {name: {"controller": config} for name, config in {WHOLE: best, **found}.items()}


PARTS: Mapping[str, Callable[[], dict[str, dict[str, Any]]]] = {"flight": flights, "ground": crawls}
"""Group of tracks → function that returns its controllers."""


@dataclass(frozen=True)
class Job:
    """Evaluation of one controller on one track."""

    group: str
    """Group of the track."""
    name: str
    """Key of `PARTS[group]()`."""
    track: str
    """Track."""
    scenarios: int
    """Number of test scenarios, from the first."""


def play_job(job: Job) -> dict[str, Any]:
    """Evaluate a job: errors and success of the scenarios."""
    arguments = PARTS[job.group]()[job.name]
    played = play(OwnController(arguments), job.track, load_scenarios(job.track)[0][: job.scenarios])
    metrics = [one["metrics"] for one in played]
    return {"error": [m["error"] for m in metrics], "success": [bool(m["success"]) for m in metrics]}


def jobs(scenarios: int = SCENARIOS) -> list[Job]:
    """Return the jobs of the study."""
    return [
        Job(group, name, track, scenarios)
        for group, parts in PARTS.items()
        for track in TRACKS
        if TRACKS[track].group == group
        for name in parts()
    ]


def study(
    *, scenarios: int = SCENARIOS, workers: int = 1, folder: Path | None = None,
    on_job: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Evaluate every controller on every track of its group, paired with the complete controller.

    Finished jobs are stored in `folder`, and an interrupted call resumes from them.

    Returns:
        One row per controller and track, and one for all tracks together (`OVERALL`): `group`, `name` and `track`;
        `factor`, the error over that of the complete controller; `low` and `high`, its 95 % interval; `success`, the
        share of successes.
    """
    work = jobs(scenarios)
    played = finish(play_job, work, workers=workers, folder=folder, on_done=lambda *_: on_job())
    of = {(job.group, job.name, job.track): one for job, one in zip(work, played, strict=True)}
    rows = list[dict[str, Any]]()
    for group, parts in PARTS.items():
        tracks = [track for track in TRACKS if TRACKS[track].group == group]
        for name in parts():
            for place, own in [(OVERALL, tracks), *((track, [track]) for track in tracks)]:
                strata = [
                    (np.array(of[group, WHOLE, t]["error"]), np.array(of[group, name, t]["error"])[None]) for t in own
                ]
                success = float(np.mean([of[group, name, t]["success"] for t in own]))
                factor = stratified_bootstrap(strata, _factor, named_generator(group, name, place))
                figures = {"factor": factor.value, "low": factor.low, "high": factor.high, "success": success}
                rows.append({"group": group, "name": name, "track": place, **figures})
    return rows


def _factor(strata: Strata) -> Numbers:
    """Return the error over that of the complete controller, as geometric mean over the tracks."""
    return 1.0 / overall_score(strata)


def ablation_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the table, with one line per controller, one column per track, and the groups one below the other."""
    lines = list[list[str]]()
    for own in PARTS:
        ours = [row for row in rows if row["group"] == own]
        tracks = list(dict.fromkeys(row["track"] for row in ours))
        heading = [f"error over that of {BEST[own]}", *(track.removeprefix(f"{own}-") for track in tracks)]
        lines.append(heading)
        for name in dict.fromkeys(row["name"] for row in ours):
            cells = {row["track"]: _cell(row) for row in ours if row["name"] == name}
            lines.append([name, *(cells[track] for track in tracks)])
    width = max(map(len, lines))
    return [[*line, *[""] * (width - len(line))] for line in lines]


def _cell(row: dict[str, Any]) -> str:
    share = row["success"]
    lost = "" if share == 1.0 else f", {share:.1%}" if share > 0.99 else f", {share:.0%}"
    if row["name"] == WHOLE:
        return f"1{lost}"
    return f"{row['factor']:.2f} [{row['low']:.2f}, {row['high']:.2f}]{lost}"
