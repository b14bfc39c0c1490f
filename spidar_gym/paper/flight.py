"""Simulate the paper's flight experiment, and compare its figures with the paper's."""

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from spidar_gym.control.allocation.allocator import ANSWERED
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.errors import SpidarError
from spidar_gym.policies.rollout import columns, rollout
from spidar_gym.robot import N_ROTORS, ROBOT
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.energy import endurance_min

FLIGHT_SECONDS = 40.0
"""Length of the flight experiment [s]."""
FLIGHT_TICKS = round(FLIGHT_SECONDS * CONTROL_RATE)
"""Length of the flight experiment in control periods."""
RMSE_WINDOW = (0.0, 27.0)
"""Window of the RMSE [s] [Zhao2025, Sec. Flight]."""
FORM1_WINDOW = (2.0, 4.0)
"""Window of the hover in form ① [s]."""
FORM_CHANGE = (4.0, 11.9)
"""Window in which the legs move from form ① through ② to ③ [s]."""
DEVIATION_WINDOW = (4.0, 12.0)
"""Window in which the paper reports a large deviation in z [s] [Zhao2025, Sec. Flight]."""
FORM3_WINDOW = (14.0, 27.0)
"""Window of the hover in form ③ [s]."""
UNRESTRICTED = ((28.5, 30.0), (35.0, 36.5))
"""Windows without the interference constraints [s] [Zhao2025, Sec. Flight]."""
RECOVERED = 0.05
"""Limit of the position error below which the flight has recovered [m]."""
UPPER_ROTORS = (0, 2, 4, 6)
"""Indices of rotors 1, 3, 5, 7, which are above the others in form ③."""

PAPER_FLIGHT: dict[str, Any] = {
    "rmse_position_m": [0.038, 0.037, 0.043],
    "rmse_attitude_rad": [0.016, 0.016, 0.016],
    "theta_form3_rad": [-0.4, -0.4, -0.4, -0.4],
    "phi_form3_rad": [0.0, 0.0, 0.0, 0.0],
    "tau2_form3_nm": 2.0,
    "qp": {"max_us": 5000.0},
}
"""Figures of the real robot [Zhao2025, Sec. Flight]."""


@dataclass(frozen=True)
class ExperimentLog:
    """Log of an experiment, a flight or a crawl, with one row per tick."""

    preset: str
    """Controller preset."""
    _: KW_ONLY
    noise: bool = False
    """Whether the robot had noisy sensors, delay and unequal rotors."""
    time: np.ndarray
    """Time, (n,) [s]."""
    joint_position: np.ndarray
    """Joint positions, (n, 16) [rad]."""
    vectoring: np.ndarray
    """Measured vectoring angles φ, θ, (n, 8, 2) [rad]."""
    thrust: np.ndarray
    """Measured thrust, (n, 8) [N]."""
    solve_time: np.ndarray
    """Time of the allocation, (n,) [s]."""
    status: np.ndarray
    """Status of the allocation, (n,)."""
    power: np.ndarray
    """Electrical power, (n,) [W]."""
    qpos: np.ndarray
    """Configuration of the simulated robot, (n, 39); for figures and videos."""


@dataclass(frozen=True, kw_only=True)
class FlightLog(ExperimentLog):
    """Log of a flight, with one row per tick."""

    position_error: np.ndarray
    """Position error of the CoG, desired − actual, world, (n, 3) [m]."""
    attitude_error: np.ndarray
    """Attitude error, torso axes, (n, 3) [rad]."""
    joint_torque: np.ndarray
    """Allocated joint torque, (n, 16) [Nm]."""
    air_force: np.ndarray
    """Force of the air besides the thrust in still air, world, (n, 3) [N]."""

    def window(self, values: np.ndarray, window: tuple[float, float]) -> np.ndarray:
        """Return the rows of `values` within a window [s]."""
        return values[(self.time >= window[0]) & (self.time <= window[1])]


def noisy_robot(rng: np.random.Generator) -> PlantConfig:
    """Sample a robot with noisy sensors, a delay of 20 ms, and rotors and ducts that differ from each other."""
    return PlantConfig(
        sense=True,
        actuators=ActuatorConfig(
            delay=0.020,
            module_gain=rng.uniform(0.95, 1.05, N_ROTORS),
            duct_imbalance=rng.uniform(-0.05, 0.05, N_ROTORS),
            thrust_tilt=rng.uniform(-1.0, 1.0, (N_ROTORS, 2)) * np.radians(1.0),
            thrust_noise=0.1,
            backlash=0.002,
        ),
    )


def fly_paper(
    preset: str = "as_flown", *, noise: bool = False, seed: int = 0, on_tick: Callable[[], object] = lambda: None
) -> FlightLog:
    """Simulate the paper's flight experiment.

    The robot hovers in form ①. From 4 s it moves through ② to ③ at 0.2 rad/s without a stop, and holds ③ until 40 s.
    The interference constraints are dropped from 28.5 to 30 s and from 35 to 36.5 s [Zhao2025, Sec. Flight].

    Args:
        preset: Controller (`UnknownNameError` lists the valid ones).
        noise: Use `noisy_robot` instead of the nominal robot with true states.
        seed: Seed of `noisy_robot` and of its noise.
        on_tick: Called after every tick, for progress bars.

    Raises:
        SpidarError: If the flight ends early.
    """
    env = HoverEnv(
        forms="paper",
        preset=preset,
        perturbation=0.0,
        unrestricted=UNRESTRICTED,
        plant=noisy_robot(np.random.Generator(np.random.PCG64(seed))) if noise else None,
        horizon_s=FLIGHT_SECONDS,
        control="python",  # measures the time of the QP
    )
    rows: list[dict[str, Any]] = []
    for step in rollout(env, seed=seed, ticks=FLIGHT_TICKS):
        info, time = step.info, (len(rows) + 1) / CONTROL_RATE
        if step.terminated:
            raise SpidarError(f"the flight ended after {time:.2f} s: {info['failure']}")
        tick = env.controller.last_step
        assert tick is not None
        rows.append(
            {
                "time": time,
                "position_error": info["position_error"],
                "attitude_error": info["attitude_error"],
                "joint_position": env.state.joint_position,
                "joint_torque": info["joint_torque_allocated"],
                "vectoring": info["vectoring"],
                "thrust": info["thrust"],
                "solve_time": tick.allocation.solve_time,
                "status": info["qp_status"],
                "air_force": info["air_force"],
                "power": info["power_w"],
                "qpos": env.plant.data.qpos.copy(),
            }
        )
        on_tick()
    return FlightLog(preset, **columns(rows), noise=noise)


def sink(log: FlightLog, window: tuple[float, float]) -> float:
    """Return the descent of the CoG from a window's start to its end [m]."""
    start, end = (int(np.searchsorted(log.time, t - 1e-9)) for t in window)
    return float(log.position_error[end, 2] - log.position_error[start, 2])


def recovery(log: FlightLog, start: float, end: float) -> float:
    """Return the time from `start` until the position error stays below 5 cm up to `end` [s]; infinite if never."""
    inside = (log.time >= start - 1e-9) & (log.time <= end + 1e-9)
    far = np.linalg.norm(log.position_error[inside], axis=1) >= RECOVERED
    if far[-1]:
        return math.inf
    return float(log.time[inside][far][-1] + 1.0 / CONTROL_RATE - start) if far.any() else 0.0


def flight_figures(log: FlightLog) -> dict[str, Any]:
    """Compute the experiment's figures for JSON; the units are in the keys."""
    form3_vectoring = log.window(log.vectoring, FORM3_WINDOW).mean(axis=0)
    recoveries = (
        recovery(log, UNRESTRICTED[0][1], UNRESTRICTED[1][0]),
        recovery(log, UNRESTRICTED[1][1], FLIGHT_SECONDS),
    )
    return {
        "preset": log.preset,
        "rmse_position_m": _rms(log.window(log.position_error, RMSE_WINDOW)),
        "deviation_z_m": float(np.abs(log.window(log.position_error, DEVIATION_WINDOW)[:, 2]).max()),
        "rmse_attitude_rad": _rms(log.window(log.attitude_error, RMSE_WINDOW)),
        "theta_form3_rad": form3_vectoring[list(UPPER_ROTORS), 1].tolist(),
        "phi_form3_rad": form3_vectoring[list(UPPER_ROTORS), 0].tolist(),
        "tau2_form3_nm": float(log.window(log.joint_torque, FORM3_WINDOW)[:, 1].mean()),
        "thrust_form1_n": log.window(log.thrust, FORM1_WINDOW).mean(axis=0).tolist(),
        "thrust_form3_n": log.window(log.thrust, FORM3_WINDOW).mean(axis=0).tolist(),
        "noise": log.noise,
        "sink_m": [sink(log, window) for window in UNRESTRICTED],
        "sink_half_second_m": [sink(log, (start, start + 0.5)) for start, _ in UNRESTRICTED],
        "recovery_s": [None if math.isinf(t) else t for t in recoveries],  # JSON has no infinity
        "wake_loss_constrained": float(-log.window(log.air_force, FORM3_WINDOW)[:, 2].mean() / ROBOT.weight),
        "endurance_min": endurance_min(float(log.window(log.power, FORM1_WINDOW).mean())),
        "qp": qp_figures(log.solve_time, log.status),
    }


def qp_figures(solve_time: np.ndarray, status: np.ndarray) -> dict[str, Any]:
    """Compute statistics of the QP's time, and count the ticks without an optimum.

    Args:
        solve_time: Time of the allocation in each tick, (n,) [s].
        status: Status of the allocation in each tick, (n,).
    """
    solve_us = 1e6 * solve_time
    return {
        "median_us": float(np.median(solve_us)),
        "p99_us": float(np.percentile(solve_us, 99)),
        "max_us": float(solve_us.max()),
        "unsolved": int((~np.isin(status, ANSWERED)).sum()),
    }


def _rms(values: np.ndarray) -> list[float]:
    return np.sqrt((values**2).mean(axis=0)).tolist()


def flight_lines(
    figures: dict[str, Any], noisy: dict[str, Any] | None = None, calibrated: dict[str, Any] | None = None
) -> list[list[str]]:
    """Return the table of our figures beside the paper's.

    Args:
        figures: Figures of the flight.
        noisy: Figures of the same flight with noise, for a second column.
        calibrated: `calibrated_figures` of flights with calibrated robots, for a further column.
    """
    lines = _flight_rows(figures)
    if noisy:
        lines = [
            [name, ours, own, theirs]
            for (name, ours, _), (_, own, theirs) in zip(lines, _flight_rows(noisy), strict=True)
        ]
        lines[0][1:3] = "nominal", "with noise"
    return with_calibrated(lines, calibrated)


def with_calibrated(lines: list[list[str]], calibrated: dict[str, Any] | None) -> list[list[str]]:
    """Return a table with a column of calibrated robots before the paper's, if there are any."""
    if calibrated is None:
        return lines
    head, *rest = lines
    title = f"calibrated: {calibrated['preset']}, median of {calibrated['robots']}"
    return [
        [*head[:-1], title, head[-1]],
        *([*line[:-1], calibrated["lines"].get(line[0], "–"), line[-1]] for line in rest),
    ]


def _flight_rows(figures: dict[str, Any]) -> list[list[str]]:
    """Return label, our figure and the paper's; the first is the heading."""

    def row(name: str, ours: str, theirs: str = "–") -> list[str]:
        return [name, ours, theirs]

    def numbers(values: list[float], digits: int) -> str:
        return "  ".join(f"{value + 0.0:.{digits}f}" for value in values)

    def rmse(name: str, key: str) -> list[str]:
        # Only the flight with noise is comparable with the real robot; the other one uses true states.
        return row(name, numbers(figures[key], 5), numbers(PAPER_FLIGHT[key], 3) if figures["noise"] else "see --noise")

    recovered = "  ".join("never" if t is None else f"{t:.2f}" for t in figures["recovery_s"])
    form1, form3 = (sum(figures[f"thrust_{form}_n"]) for form in ("form1", "form3"))
    flown = f"flight, preset {figures['preset']}" + (", with noise" if figures["noise"] else "")
    return [
        row(flown, "simulated", "paper"),
        rmse("RMSE position x y z, 0–27 s [m]", "rmse_position_m"),
        row("largest error in z, 4–12 s [m]", f"{figures['deviation_z_m']:.4f}", "“large deviation”"),
        rmse("RMSE attitude x y z, 0–27 s [rad]", "rmse_attitude_rad"),
        row("θ of rotors 1 3 5 7, form ③ [rad]", numbers(figures["theta_form3_rad"], 3), "about −0.4 each"),
        row("φ of rotors 1 3 5 7, form ③ [rad]", numbers(figures["phi_form3_rad"], 3), "0, fixed"),
        row("allocated τ₂, form ③ [Nm]", f"{figures['tau2_form3_nm']:.2f}", "around 2"),
        row("thrust λ₁ … λ₈, form ① [N]", numbers(figures["thrust_form1_n"], 1), "near mg/8 = 20"),
        row("thrust λ₁ … λ₈, form ③ [N]", numbers(figures["thrust_form3_n"], 1), "λ₁, λ₂ larger than in ①"),
        row("Σλ, form ① → form ③ [N]", f"{form1:.1f} → {form3:.1f} ({form3 / form1 - 1:+.1%})", "larger in ③"),
        row("lift lost to the wake, form ③", f"{figures['wake_loss_constrained']:.2%}"),
        row("sink without the constraint [m]", numbers(figures["sink_m"], 3), "“instant descending”, no contact"),
        row("sink in the first 0.5 s without it [m]", numbers(figures["sink_half_second_m"], 3)),
        row("recovery to 5 cm afterwards [s]", recovered, "recovered"),
        row("endurance in form ① (calibrated) [min]", f"{figures['endurance_min']:.1f}", "9"),
        *qp_lines(figures["qp"]),
    ]


def qp_lines(qp: dict[str, Any]) -> list[list[str]]:
    """Return the lines of `qp_figures` for the end of an experiment's table."""
    times = " / ".join(f"{qp[name]:.0f}" for name in ("median_us", "p99_us", "max_us"))
    return [
        ["ticks without an optimum", f"{qp['unsolved']}", "–"],
        ["QP time here, median / p99 / max [µs]", times, "–"],
    ]
