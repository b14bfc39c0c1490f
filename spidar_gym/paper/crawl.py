"""Simulate the paper's crawl experiment, and compare its figures with the paper's."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spidar_gym.control.crawl.footsteps import Move
from spidar_gym.control.crawl.gait import nominal_time
from spidar_gym.control.crawl.pose2 import torso_pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import crawler_config
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.paper.flight import ExperimentLog, qp_figures, qp_lines, with_calibrated
from spidar_gym.policies.rollout import columns, rollout
from spidar_gym.robot import N_JOINTS, N_ROTORS
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.energy import endurance_min
from spidar_gym.so3 import euler_angles, quat_to_matrix
from spidar_gym.tasks.crawl import CrawlTask

CRAWL_DISTANCE = 0.6
"""Distance of the crawl experiment, in 3 cycles of 0.2 m [m] [Zhao2025, Sec. Crawling Motion]."""
LIMIT = 300.0
"""Largest duration: a crawl with a longer plan is refused, and a crawl that takes longer fails [s]."""
LEGS_UP = ("raise", "swing", "lower")
"""Phases in which the legs are lifted."""
TORSO_PHASES = ("up", "forward", "down")
"""Phases in which the torso moves."""
PAPER_CRAWL: dict[str, Any] = {
    "final_position_error_m": [0.010, 0.010, 0.005],
    "duration_s": 20.0,
    "duration_torso_s": 6.0,
    "thrust_fraction_below": 0.5,
    "endurance_min": 25.0,
    "qp": {"max_us": 5000.0},
}
"""Figures of the real robot [Zhao2025, Sec. Crawling Motion] [Zhao2025, Tab. 1]."""


@dataclass(frozen=True, kw_only=True)
class CrawlLog(ExperimentLog):
    """Log of a crawl, with one row per tick."""

    joint_speed: float
    """Joint speed [rad/s]."""
    phase: np.ndarray
    """Name of the phase, (n,)."""
    position_w: np.ndarray
    """Position of the torso's origin, world, (n, 3) [m]."""
    euler: np.ndarray
    """Roll, pitch, yaw of the torso, (n, 3) [rad]."""
    joint_torque: np.ndarray
    """Torque of the joint servos, (n, 16) [Nm]."""
    thrust_command: np.ndarray
    """Commanded thrust, (n, 8) [N]."""
    contacts: list[np.ndarray]
    """Contact points and forces of each tick, world: (k, 6) [m, N]; for figures and videos."""
    goal_error: np.ndarray
    """Goal − final pose of the torso: x, y [m], yaw [rad]."""
    info: dict[str, Any]
    """The environment's last `info`."""


def crawl_robot(rng: np.random.Generator) -> PlantConfig:
    """Sample a robot with noisy sensors, a delay of 25 ms, and errors of thrust gains and joint zeros.

    The errors are normally distributed with σ = 5 % and 10 mrad, and clipped to ± 2 σ.
    """
    spread = np.clip(rng.standard_normal(N_ROTORS), -2.0, 2.0)
    offset = np.clip(rng.standard_normal(N_JOINTS), -2.0, 2.0)
    return PlantConfig(
        sense=True,
        actuators=ActuatorConfig(delay=0.025, module_gain=1.0 + 0.05 * spread, joint_offset=0.010 * offset),
    )


def check_way(preset: str, *, distance: float, direction: float, turn: float, joint_speed: float | None) -> None:
    """Check that a goal is feasible, and planned within `LIMIT`; the arguments are those of `crawl_paper`.

    Raises:
        UnknownNameError: For a preset that does not exist.
        InvalidValueError: For a number out of range, or a goal whose planned duration exceeds `LIMIT`.
    """
    config = crawler_config(preset)
    task = CrawlTask(distance=distance, direction=direction, turn=turn, joint_speed=joint_speed)
    way = task.draw_way(np.random.Generator(np.random.PCG64(0)))
    seconds = nominal_time(
        config.gait, [Move(way)], joint_speed=task.joint_speed or config.joint_speed, dt=1.0 / CONTROL_RATE
    )
    if seconds > LIMIT:
        shorter = f"a goal within {LIMIT:g} s; the planned duration is {seconds:.0f} s"
        raise InvalidValueError("distance, turn", (distance, turn), shorter)


def crawl_paper(
    preset: str = "published",
    *,
    distance: float = CRAWL_DISTANCE,
    direction: float = 0.0,
    turn: float = 0.0,
    joint_speed: float | None = None,
    power: bool = False,
    noise: bool = False,
    seed: int = 0,
    on_tick: Callable[[int], object] = lambda _: None,
) -> CrawlLog:
    """Simulate the paper's crawl, or a crawl to another goal.

    Args:
        preset: Crawler (`UnknownNameError` lists the valid ones).
        distance: Distance to the goal [m].
        direction: Direction of the goal, 0 straight ahead [rad].
        turn: Change of heading from start to goal [rad].
        joint_speed: Joint speed; the preset's if None [rad/s].
        power: Minimise electrical power instead of Σ ‖f‖².
        noise: Use `crawl_robot` instead of the nominal robot with true states.
        seed: Seed of `crawl_robot` and of its noise.
        on_tick: Called after every tick with the planned number of ticks, for progress bars.

    Raises:
        InvalidValueError: For an infeasible goal, or a planned duration above `LIMIT`.
        SpidarError: If the crawl fails or does not end within `LIMIT`.
    """
    check_way(preset, distance=distance, direction=direction, turn=turn, joint_speed=joint_speed)
    config = replace(crawler_config(preset), power=power)
    env = CrawlEnv(
        distance=distance,
        direction=direction,
        turn=turn,
        joint_speed=joint_speed,
        controller=config,
        plant=crawl_robot(np.random.Generator(np.random.PCG64(seed))) if noise else None,
        horizon_s=LIMIT,
        control="python",  # measures the time of the QP
    )
    rows: list[dict[str, Any]] = []
    contacts: list[np.ndarray] = []
    info: dict[str, Any] = {}
    for step in rollout(env, seed=seed):
        info = step.info
        if step.terminated or env.ticks >= env.horizon:
            raise SpidarError(f"the crawl ended after {info['time_s']:.2f} s: {info['failure'] or 'out of time'}")
        tick, state = env.controller.last_step, env.state
        assert tick is not None
        rows.append(
            {
                "time": len(rows) / CONTROL_RATE + 1.0 / CONTROL_RATE,
                "phase": tick.phase,
                "position_w": state.position_w,
                "euler": euler_angles(quat_to_matrix(state.quat_wb)),
                "joint_position": state.joint_position,
                "joint_torque": state.joint_torque,
                "vectoring": state.vectoring,
                "thrust": state.thrust,
                "thrust_command": info["thrust_command"],
                "power": info["power_w"],
                "solve_time": tick.allocation.solve_time,
                "status": info["qp_status"],
                "qpos": env.plant.data.qpos.copy(),
            }
        )
        contacts.append(env.plant.contact_forces())
        on_tick(round(env.progress.nominal_time * CONTROL_RATE))
    goal, reached = env.progress.goal, torso_pose2(env.state.position_w, quat_to_matrix(env.state.quat_wb))
    error = np.array([goal.x - reached.x, goal.y - reached.y, math.remainder(goal.yaw - reached.yaw, 2.0 * math.pi)])
    return CrawlLog(
        preset, joint_speed=env.controller.config.joint_speed, noise=noise, **columns(rows), contacts=contacts,
        goal_error=error, info=info,
    )  # fmt: skip


def crawl_figures(log: CrawlLog, overlapped: CrawlLog | None = None) -> dict[str, Any]:
    """Compute the experiment's figures for JSON; the units are in the keys.

    Args:
        log: The crawl.
        overlapped: Crawl to the same goal with the preset `overlapped`, for its duration.
    """
    legs, torso = np.isin(log.phase, LEGS_UP), np.isin(log.phase, TORSO_PHASES)
    roll_pitch = np.abs(log.euler[:, :2]).max(axis=1)
    height = float(log.position_w[-1, 2] - log.position_w[0, 2])
    info, command = log.info, log.thrust_command.sum(axis=1)
    return {
        "preset": log.preset,
        "joint_speed_rad_s": log.joint_speed,
        "noise": log.noise,
        "final_position_error_m": [float(log.goal_error[0]), float(log.goal_error[1]), height],
        "yaw_final_rad": float(log.goal_error[2]),
        "yaw_peak_to_peak_rad": float(np.ptp(log.euler[legs, 2])),
        "roll_pitch_legs_up_rad": float(roll_pitch[legs].max()),
        "roll_pitch_torso_rad": float(roll_pitch[torso].max()),
        "duration_s": float(info["time_s"]),
        "duration_torso_s": float(torso.sum() / CONTROL_RATE),
        "duration_overlapped_s": None if overlapped is None else float(overlapped.info["time_s"]),
        "thrust_fraction_mean": float(info["thrust_fraction_mean"]),
        "thrust_fraction_peak": float(info["thrust_fraction_peak"]),
        "thrust_step_n": float(np.abs(np.diff(command)).max()),
        "foot_slip_m": float(info["foot_slip_m"]),
        "peg_slip_m": float(info["peg_slip_m"]),
        "airborne_share": float(info["airborne_share"]),
        "duct_clearance_m": float(info["duct_clearance_m"]),
        "saturation_share": float(info["saturation_share"]),
        "timeouts": int(info["timeouts"]),
        "power_w": float(log.power.mean()),
        "energy_wh": float(info["energy_wh"]),
        "cost_of_transport": float(info["cost_of_transport"]),
        "endurance_min": endurance_min(float(log.power.mean())),
        "joint_rate_swing_rad_s": _ripple(log),
        "is_success": bool(info["is_success"]),
        "qp": qp_figures(log.solve_time, log.status),
    }


def _ripple(log: CrawlLog) -> float:
    """Return the RMS rate of the four inner pitch joints in the swing phase, where their references rest [rad/s]."""
    rate = np.diff(log.joint_position[:, 1::4], axis=0) * CONTROL_RATE
    swing = log.phase[1:] == "swing"
    return float(np.sqrt((rate[swing] ** 2).mean())) if swing.any() else 0.0


LINES: tuple[tuple[str, str, float, str, str], ...] = (
    ("final yaw [mrad]", "yaw_final_rad", 1e3, ".1f", "–"),
    ("yaw, peak to peak, legs up [mrad]", "yaw_peak_to_peak_rad", 1e3, ".1f", "“relatively large drift”"),
    ("roll and pitch, legs up [mrad]", "roll_pitch_legs_up_rad", 1e3, ".1f", "“unstable”"),
    ("roll and pitch, torso moves [mrad]", "roll_pitch_torso_rad", 1e3, ".1f", "–"),
    ("duration [s]", "duration_s", 1.0, ".1f", "about 20"),
    ("duration of the torso's motion [s]", "duration_torso_s", 1.0, ".1f", "6"),
    ("duration, preset overlapped [s]", "duration_overlapped_s", 1.0, ".1f", "–"),
    ("Σλ / mg, mean", "thrust_fraction_mean", 1.0, ".3f", "below 0.5"),
    ("Σλ / mg, peak", "thrust_fraction_peak", 1.0, ".3f", "–"),
    ("largest step of Σλ in a tick [N]", "thrust_step_n", 1.0, ".1f", "–"),
    ("legs in the air during the swing", "airborne_share", 1.0, ".1%", "–"),
    ("largest slip of a foot [mm]", "foot_slip_m", 1e3, ".1f", "–"),
    ("lowest duct over the floor [mm]", "duct_clearance_m", 1e3, ".0f", "–"),
    ("saturated joint-time", "saturation_share", 1.0, ".2%", "–"),
    ("power, mean [W]", "power_w", 1.0, ".0f", "–"),
    ("endurance (predicted) [min]", "endurance_min", 1.0, ".1f", "25"),
    ("cost of transport", "cost_of_transport", 1.0, ".0f", "–"),
)
"""Lines of the table: label, figure, factor, format, and the paper's figure."""


def crawl_lines(
    figures: dict[str, Any], noisy: dict[str, Any] | None = None, calibrated: dict[str, Any] | None = None
) -> list[list[str]]:
    """Return the table of our figures beside the paper's; arguments as in `flight_lines`."""
    lines = _crawl_rows(figures)
    if noisy:
        lines = [[*line[:2], own[1], line[2]] for line, own in zip(lines, _crawl_rows(noisy), strict=True)]
        lines[0][1:3] = "nominal", "with noise"
    return with_calibrated(lines, calibrated)


def _crawl_rows(figures: dict[str, Any]) -> list[list[str]]:
    """Return label, our figure and the paper's; the first is the heading."""
    title = f"crawl, {figures['preset']}, {figures['joint_speed_rad_s']:g} rad/s"
    x, y, z = (1000.0 * v for v in figures["final_position_error_m"])
    lines = [
        [title + (", with noise" if figures["noise"] else ""), "simulated", "paper"],
        ["final position error x y z [mm]", f"{x:.1f}  {y:.1f}  {z:.1f}", "10  10  5"],
    ]
    for label, name, factor, form, paper in LINES:
        value = figures[name]
        lines.append([label, "–" if value is None else f"{factor * value:{form}}", paper])
    return lines + qp_lines(figures["qp"])
