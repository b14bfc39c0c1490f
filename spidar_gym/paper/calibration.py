"""The paper's experiments on any simulated robot: figures as the motion capture sees them, beside what was published.

Numbers are compared at the precision at which they were published. The paper's words are inequalities, which were
written down before any robot was fitted to them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.errors import InvalidValueError
from spidar_gym.paper.crawl import CRAWL_DISTANCE, LEGS_UP, LIMIT, TORSO_PHASES
from spidar_gym.paper.flight import (
    DEVIATION_WINDOW,
    FLIGHT_SECONDS,
    FORM1_WINDOW,
    FORM3_WINDOW,
    RMSE_WINDOW,
    UNRESTRICTED,
)
from spidar_gym.policies.rollout import rollout
from spidar_gym.sim.energy import endurance_min
from spidar_gym.sim.randomize import Randomization
from spidar_gym.sim.worlds import World
from spidar_gym.so3 import euler_angles, quat_to_matrix
from spidar_gym.tasks.start import FlightStart, FormGoal, draw_start

FLIGHT, CRAWL = "flight", "crawl"
"""The paper's experiments."""
PRELUDE = 20.0
"""Time of hovering in form ① before the experiment, in which the integrals settle from zero [s] [chosen]."""
FORM2_WINDOW = (7.0, 8.0)
"""Window around form ②, through which the legs pass at 6.6 s … 9.2 s [s]."""


@dataclass(frozen=True)
class Published:
    """A published number."""

    value: float
    """The number, in SI units."""
    half: float
    """Half of its last published digit."""
    words: str
    """How the paper states it."""

    def matches(self, low: float, high: float) -> bool:
        """Return whether a range overlaps the numbers that are published as this one."""
        return low <= self.value + self.half and high >= self.value - self.half


@dataclass(frozen=True)
class Worded:
    """A statement of the paper in words, as an inequality."""

    words: str
    """The paper's words."""
    rule: str
    """The inequality in words."""
    holds: Callable[[Mapping[str, float]], bool]
    """Figures of an experiment → whether it holds."""


FLIGHT_NUMBERS: dict[str, Published] = {
    "rmse_x": Published(0.038, 0.0005, "RMSE of the position, x [m]"),
    "rmse_y": Published(0.037, 0.0005, "RMSE of the position, y [m]"),
    "rmse_z": Published(0.043, 0.0005, "RMSE of the position, z [m]"),
    "rmse_roll": Published(0.016, 0.0005, "RMSE of the orientation, x [rad]"),
    "rmse_pitch": Published(0.016, 0.0005, "RMSE of the orientation, y [rad]"),
    "rmse_yaw": Published(0.016, 0.0005, "RMSE of the orientation, z [rad]"),
    "theta": Published(-0.4, 0.05, "θ of the upper rotors in form ③ [rad]"),
    "tau2": Published(2.0, 0.5, "τ₂ in form ③, around 2 [Nm]"),
    "thrust": Published(20.0, 0.5, "mean thrust of a module in form ① [N]"),
    "endurance": Published(9.0, 0.5, "flight time of Table 1, form ① [min]"),
}
"""Published numbers of the flight [Zhao2025, Sec. Flight] [Zhao2025, Tab. 1]."""
CRAWL_NUMBERS: dict[str, Published] = {
    "rest_x": Published(0.010, 0.0005, "final error, x, one run [m]"),
    "rest_y": Published(0.010, 0.0005, "final error, y, one run [m]"),
    "rest_z": Published(0.005, 0.0005, "final error, z, one run [m]"),
    "duration": Published(20.0, 0.5, "duration, approximately 20 [s]"),
    "torso": Published(6.0, 0.5, "duration of the torso's motion [s]"),
    "endurance": Published(25.0, 0.5, "crawl time of Table 1 [min]"),
}
"""Published numbers of the crawl [Zhao2025, Sec. Crawling Motion] [Zhao2025, Tab. 1]."""
FLIGHT_WORDS: dict[str, Worded] = {
    "within 5 cm": Worded(
        "the centroidal position errors along each axis was almost within 0.05 m",
        "at least 80 % of the errors of the three axes, 0–27 s, are within 0.05 m",
        lambda f: f["within_position"] >= 0.8,
    ),
    "within 50 mrad": Worded(
        "the errors were almost within 0.05 rad",
        "at least 95 % of the errors of the three axes, 0–27 s, are within 0.05 rad",
        lambda f: f["within_attitude"] >= 0.95,
    ),
    "deviation": Worded(
        "a large deviation during 4 s ~ 12 s", "the RMS of e_z from 4 to 12 s exceeds that of the rest of 0–27 s",
        lambda f: f["moving_z"] > f["resting_z"],
    ),
    "descent": Worded(
        "an instant descending", "e_z changes by at least 0.1 m in each window without the constraint, without contact",
        lambda f: f["sink"] >= 0.1,
    ),
    "recovery": Worded(
        "quickly recovered after switching back", "|e_z| falls below 0.1 m within 2.5 s after each window",
        lambda f: f["back"] <= 2.5,
    ),
    "thrusts": Worded(
        "the averages of both λ₁ and λ₂ became large than those under ① and ②",
        "in form ③ the means of λ₁ and of λ₂ exceed those of form ①", lambda f: f["rise"] > 0.0,
    ),
    "stays": Worded("the flight ended as planned", "the robot does not fall", lambda f: f["failed"] == 0.0),
}  # fmt: skip
"""The paper's words about the flight."""
CRAWL_WORDS: dict[str, Worded] = {
    "yaw": Worded(
        "a relatively large drift around the yaw axis when all legs were lifted",
        "yaw varies by at least 10 mrad, peak to peak, while legs are lifted", lambda f: f["yaw_drift"] >= 0.010,
    ),
    "pitch": Worded(
        "the pitch angle of torso was also unstable when all leg was lifted",
        "pitch varies by at least 5 mrad, peak to peak, while legs are lifted", lambda f: f["pitch_drift"] >= 0.005,
    ),
    "joints": Worded(
        "the joint angles, especially q₂, were unstable when related leg was lifted",
        "the RMS rate of q₂ in the swing, where its reference rests, is at least 50 mrad/s",
        lambda f: f["ripple"] >= 0.05,
    ),
    "thrust": Worded(
        "the total thrust required for crawling was less than half of that required for flight",
        "the mean of Σλ is less than half of the weight", lambda f: f["thrust_fraction"] < 0.5,
    ),
    "arrives": Worded(
        "the torso position reached the final goal", "the crawl ends, at most 20 mm from the goal",
        lambda f: f["rest"] <= 0.02,
    ),
}  # fmt: skip
"""The paper's words about the crawl."""


FLOWN = {"as_flown": "as_flown_quasi"}
"""Preset → the preset that calibrated robots fly in its place: what flew, with the estimator of the real robot."""


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
    call = fly_sampled if run.experiment == FLIGHT else crawl_sampled
    return call(run.preset, run.randomization, run.seed)


def calibrated_figures(
    experiment: str, preset: str, world: str, *, robots: int, workers: int = 1,
    on_run: Callable[[], object] = lambda: None,
) -> dict[str, Any]:  # fmt: skip
    """Simulate an experiment with robots of a calibrated world, its kinds in turn.

    Args:
        experiment: `FLIGHT` or `CRAWL`.
        preset: Controller; see `FLOWN`.
        world: Name or file of the world.
        robots: Number of robots.
        workers: Number of processes.
        on_run: Called after each robot.

    Returns:
        Preset, world, number of robots and of those that failed; the figures' medians and limits of the central 60 %;
        `lines`, label → figure of the experiment's table.
    """
    preset = FLOWN.get(preset, preset)
    kinds = require_world(world).kinds
    hows = [Randomization.parse(f"{world}:{kind}") for kind in kinds]
    runs = [Run(experiment, preset, hows[k % len(hows)], k) for k in range(robots)]
    done = finish(play, runs, workers=workers, on_done=lambda *_: on_run())
    standing = [each for each in done if not each["failed"]]
    figures = {
        name: np.quantile([each[name] for each in standing], [0.5, 0.2, 0.8]).tolist()
        for name in dict.fromkeys(name for names, *_ in LABELS[experiment].values() for name in names)
        if standing
    }
    lines = {label: _cell(figures, *how) for label, how in LABELS[experiment].items() if figures}
    return {
        "preset": preset, "world": world, "robots": robots, "failed": robots - len(standing), "figures": figures,
        "lines": lines,
    }  # fmt: skip


LABELS: dict[str, dict[str, tuple[tuple[str, ...], float, str]]] = {
    FLIGHT: {
        "RMSE position x y z, 0–27 s [m]": (("rmse_x", "rmse_y", "rmse_z"), 1.0, ".4f"),
        "RMSE attitude x y z, 0–27 s [rad]": (("rmse_roll", "rmse_pitch", "rmse_yaw"), 1.0, ".4f"),
        "θ of rotors 1 3 5 7, form ③ [rad]": (("theta",), 1.0, ".3f"),
        "allocated τ₂, form ③ [Nm]": (("tau2",), 1.0, ".2f"),
        "thrust λ₁ … λ₈, form ① [N]": (("thrust",), 1.0, ".1f"),
        "endurance in form ① (calibrated) [min]": (("endurance",), 1.0, ".1f"),
    },
    CRAWL: {
        "final position error x y z [mm]": (("rest_x", "rest_y", "rest_z"), 1e3, ".1f"),
        "duration [s]": (("duration",), 1.0, ".1f"),
        "duration of the torso's motion [s]": (("torso",), 1.0, ".1f"),
        "Σλ / mg, mean": (("thrust_fraction",), 1.0, ".3f"),
        "endurance (predicted) [min]": (("endurance",), 1.0, ".1f"),
    },
}
"""Experiment → label of its table → figures, factor and format."""


def _cell(figures: Mapping[str, Sequence[float]], names: Sequence[str], factor: float, form: str) -> str:
    return "  ".join(f"{factor * figures[name][0]:{form}}" for name in names)


def require_world(given: str) -> World:
    """Return a calibrated world by name or file (`InvalidValueError` for another randomisation)."""
    found = require_robots(given).world
    if found is None:
        raise InvalidValueError("world", given, "the name or file of a calibrated world")
    return found


def require_robots(given: str) -> Randomization:
    """Return the robots of a calibrated world, by name, kind or file; those without randomisation if it is empty.

    Raises:
        InvalidValueError: For another randomisation.
    """
    found = Randomization.parse(given) if given else Randomization()
    if given and found.world is None:
        raise InvalidValueError("world", given, "the name or file of a calibrated world")
    return found


# ---- the flight ----


def fly_sampled(preset: str, randomization: Randomization, seed: int) -> dict[str, float]:
    """Simulate the paper's flight with a sampled robot, after `PRELUDE` in form ①, and return its figures.

    Errors are those of the state that the controller estimates from the sensors, as the robot's software logs them;
    those of the position are in torso axes, which differ from the world's by the errors of the attitude.

    Args:
        preset: Controller (`UnknownNameError` lists the valid ones).
        randomization: Distribution of the robot.
        seed: Seed of the robot and its noise.
    """
    windows = tuple((a + PRELUDE, b + PRELUDE) for a, b in UNRESTRICTED)
    env = HoverEnv(
        forms="paper", preset=preset, perturbation=0.0, unrestricted=windows, sensors=True,
        randomization=randomization, horizon_s=FLIGHT_SECONDS + PRELUDE,
    )  # fmt: skip
    first, *others = draw_start(env.task, np.random.Generator(np.random.PCG64(0))).goals
    later = [FormGoal(g.start + PRELUDE, g.deadline + PRELUDE, g.joint_target) for g in others]
    start = FlightStart((first, *later), np.zeros(3), np.zeros(3), trim=np.zeros(6))
    rows: list[tuple[Any, ...]] = []
    failed = False
    for step in rollout(env, seed=seed, options={"start": start}, ticks=env.horizon):
        seen, info = step.observation, step.info
        torque, thrust = info["joint_torque_allocated"][1], info["thrust_command"]
        rows.append((*seen[0:3], *seen[6:9], torque, *thrust, *info["vectoring"][::2, 1], info["power_w"]))
        failed = bool(step.terminated)
    env.close()
    found = np.array(rows, float)
    return _flight_figures((np.arange(len(found)) + 1) / CONTROL_RATE - PRELUDE, found, failed=failed)


def _flight_figures(time: np.ndarray, rows: np.ndarray, *, failed: bool) -> dict[str, float]:
    """Compute the figures of a flight: rows of e_r, e_R, τ₂, λ₁ … λ₈, θ₁ θ₃ θ₅ θ₇, power."""

    def within(window: tuple[float, float]) -> np.ndarray:
        return (time >= window[0]) & (time <= window[1])

    def rms(values: np.ndarray) -> Any:  # noqa: ANN401 - a number of one column, an array of several
        return np.sqrt((values**2).mean(axis=0)) if len(values) else np.full(values.shape[1:], math.nan)

    def mean(values: np.ndarray) -> float:
        return float(values.mean()) if values.size else math.nan

    error, z = rows[:, :6], rows[:, 2]
    flown, moving, form1, form3 = map(within, (RMSE_WINDOW, DEVIATION_WINDOW, FORM1_WINDOW, FORM3_WINDOW))
    names = ("rmse_x", "rmse_y", "rmse_z", "rmse_roll", "rmse_pitch", "rmse_yaw")
    figures = dict(zip(names, rms(error[flown]).tolist(), strict=True))
    figures |= {
        "within_position": mean(np.abs(error[flown, :3]) < 0.05),
        "within_attitude": mean(np.abs(error[flown, 3:]) < 0.05),
        "moving_z": float(rms(z[moving])), "resting_z": float(rms(z[flown & ~moving])),
        "tau2": mean(rows[form3, 6]), "theta": mean(rows[form3, 15:19]),
        "thrust": mean(rows[form1, 7:15]), "endurance": endurance_min(mean(rows[form1, 19])),
        "rise": min(mean(rows[form3, 7 + k]) - mean(rows[form1, 7 + k]) for k in range(2)),
        "failed": float(failed),
    }  # fmt: skip
    sinks, backs = [], []
    for (begin, end), last in zip(UNRESTRICTED, (UNRESTRICTED[1][0], FLIGHT_SECONDS), strict=True):
        window, after = z[within((begin, end))], np.abs(z[within((end, last))])
        sinks.append(float(abs(window[-1] - window[0])) if len(window) else 0.0)
        near = np.flatnonzero(after < 0.1)
        backs.append(near[0] / CONTROL_RATE if len(near) else math.inf)
    return figures | {"sink": min(sinks), "back": max(backs)}


# ---- the crawl ----


def crawl_sampled(preset: str, randomization: Randomization, seed: int) -> dict[str, float]:
    """Simulate the paper's crawl with a sampled robot, and return its figures.

    Args:
        preset: Crawler (`UnknownNameError` lists the valid ones).
        randomization: Distribution of the robot, and the world's floor.
        seed: Seed of the robot, its floor and its noise.
    """
    env = CrawlEnv(
        distance=CRAWL_DISTANCE,
        direction=0.0,
        turn=0.0,
        preset=preset,
        randomization=randomization,
        sensors=True,
        horizon_s=LIMIT,
    )
    rows, info, words = [], {}, []
    for step in rollout(env, seed=seed):
        info, seen = step.info, env.seen
        euler = euler_angles(quat_to_matrix(env.state.quat_wb))
        rows.append((*euler, *env.state.joint_velocity[1::4], info["power_w"], *seen.position_w))
        words.append(info["phase"])
        if step.terminated or info["finished"]:
            break
    found, phase = np.array(rows, float), np.array(words)
    legs, torso, swing = np.isin(phase, LEGS_UP), np.isin(phase, TORSO_PHASES), phase == "swing"
    goal, end = env.progress.goal, env.seen.position_w
    figures = {
        "rest": math.hypot(goal.x - end[0], goal.y - end[1]) if info["finished"] else math.inf,
        "rest_x": abs(goal.x - end[0]), "rest_y": abs(goal.y - end[1]), "rest_z": abs(found[-1, -1] - found[0, -1]),
        "duration": len(found) / CONTROL_RATE, "torso": torso.sum() / CONTROL_RATE,
        "endurance": endurance_min(float(found[:, 7].mean())), "thrust_fraction": info["thrust_fraction_mean"],
        "yaw_drift": float(np.ptp(found[legs, 2])) if legs.any() else 0.0,
        "pitch_drift": float(np.ptp(found[legs, 1])) if legs.any() else 0.0,
        "ripple": float(np.sqrt((found[swing, 3:7] ** 2).mean())) if swing.any() else 0.0,
        "failed": float(not info["finished"]),
    }  # fmt: skip
    env.close()
    return {name: float(value) for name, value in figures.items()}
