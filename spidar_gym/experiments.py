"""The paper's experiments, flown in the simulator, and their figures beside the paper's."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

import spidar_gym.envs.registry
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.modes import preset as find_preset
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.errors import SpidarError

FLIGHT_SECONDS = 40.0
"""Length of the flight experiment [s]."""
FLIGHT_TICKS = round(FLIGHT_SECONDS * CONTROL_RATE)
"""… in control periods."""
RMSE_WINDOW = (0.0, 27.0)
"""Window of the RMSE [s] [Zhao2025, Sec. Flight]."""
FORM1_WINDOW = (2.0, 4.0)
"""Window of the hover in form ① [s]."""
FORM3_WINDOW = (14.0, 27.0)
"""Window of the hover in form ③ [s]."""
UPPER_ROTORS = (0, 2, 4, 6)
"""Indices of rotors 1, 3, 5, 7, which form ③ stacks over the others."""

PAPER_FLIGHT: dict[str, Any] = {
    "rmse_position_m": [0.038, 0.037, 0.043],
    "rmse_attitude_rad": [0.016, 0.016, 0.016],
    "theta_form3_rad": [-0.4, -0.4, -0.4, -0.4],
    "phi_form3_rad": [0.0, 0.0, 0.0, 0.0],
    "tau2_form3_nm": 2.0,
    "qp": {"max_us": 5000.0},
}
"""[Zhao2025, Sec. Flight]: the real robot's figures."""


@dataclass(frozen=True)
class FlightLog:
    """What happened, one row a tick."""

    preset: str
    """Allocation that flew."""
    time: np.ndarray
    """(n,) [s]."""
    position_error: np.ndarray
    """(n, 3), world [m]."""
    attitude_error: np.ndarray
    """(n, 3), torso axes [rad]."""
    joint_position: np.ndarray
    """(n, 16) [rad]."""
    joint_torque: np.ndarray
    """Allocated, (n, 16) [Nm]."""
    vectoring: np.ndarray
    """Measured, (n, 8, 2) [rad]."""
    thrust: np.ndarray
    """Measured, (n, 8) [N]."""
    solve_time: np.ndarray
    """(n,) [s]."""
    status: np.ndarray
    """(n,) words."""
    qpos: np.ndarray
    """Configuration of the simulated robot, (n, 39), for pictures."""

    def window(self, values: np.ndarray, window: tuple[float, float]) -> np.ndarray:
        """The rows of `values` within a window [s]."""
        return values[(self.time >= window[0]) & (self.time <= window[1])]


def fly_paper(preset: str = "as_flown", *, on_tick: Callable[[], object] = lambda: None) -> FlightLog:
    """Fly the paper's flight experiment.

    Hover at form ①, from 4 s on through ② to ③ at 0.2 rad/s without a stop, ③ until 40 s
    [Zhao2025, Sec. Flight].

    Args:
        preset: Allocation that flies (`UnknownNameError` lists the valid ones).
        on_tick: Called after every tick, for progress.

    Raises:
        SpidarError: When the flight ends early.
    """
    find_preset(preset)
    spidar_gym.envs.registry.register()
    wrapped = gymnasium.make(
        "spidar_gym/Hover-v0",
        forms="paper",
        preset=preset,
        perturbation=0.0,
        horizon_s=FLIGHT_SECONDS,
        max_episode_steps=FLIGHT_TICKS,
    )
    env = wrapped.unwrapped
    assert isinstance(env, SpidarEnv)
    rows: list[tuple] = []
    try:
        wrapped.reset(seed=0)
        action = np.zeros(wrapped.action_space.shape or ())
        for k in range(FLIGHT_TICKS):
            _, _, terminated, _, info = wrapped.step(action)
            if terminated:
                raise SpidarError(f"the flight ended after {(k + 1) / CONTROL_RATE:.2f} s: {info['failure']}")
            tick = env.controller.tick
            assert tick is not None
            rows.append(
                (
                    (k + 1) / CONTROL_RATE,
                    info["position_error"],
                    info["attitude_error"],
                    env.state.joint_position,
                    info["joint_torque_allocated"],
                    info["vectoring"],
                    info["thrust"],
                    tick.allocation.solve_time,
                    info["qp_status"],
                    env.plant.data.qpos.copy(),
                )
            )
            on_tick()
    finally:
        wrapped.close()
    return FlightLog(preset, *(np.array(column) for column in zip(*rows, strict=True)))


def flight_figures(log: FlightLog) -> dict[str, Any]:
    """The experiment's figures, ready for JSON; keys carry their units."""
    form3_vectoring = log.window(log.vectoring, FORM3_WINDOW).mean(axis=0)
    solve_us = 1e6 * log.solve_time
    answered = np.isin(log.status, ["closed_form", "solved"])
    return {
        "preset": log.preset,
        "rmse_position_m": _rms(log.window(log.position_error, RMSE_WINDOW)),
        "rmse_attitude_rad": _rms(log.window(log.attitude_error, RMSE_WINDOW)),
        "theta_form3_rad": form3_vectoring[list(UPPER_ROTORS), 1].tolist(),
        "phi_form3_rad": form3_vectoring[list(UPPER_ROTORS), 0].tolist(),
        "tau2_form3_nm": float(log.window(log.joint_torque, FORM3_WINDOW)[:, 1].mean()),
        "thrust_form1_n": log.window(log.thrust, FORM1_WINDOW).mean(axis=0).tolist(),
        "thrust_form3_n": log.window(log.thrust, FORM3_WINDOW).mean(axis=0).tolist(),
        "qp": {
            "median_us": float(np.median(solve_us)),
            "p99_us": float(np.percentile(solve_us, 99)),
            "max_us": float(solve_us.max()),
            "unsolved": int((~answered).sum()),
        },
    }


def _rms(values: np.ndarray) -> list[float]:
    return np.sqrt((values**2).mean(axis=0)).tolist()


def flight_table(figures: dict[str, Any]) -> str:
    """Our figures beside the paper's, as text."""

    def row(name: str, ours: str, theirs: str = "–") -> tuple[str, str, str]:
        return name, ours, theirs

    def numbers(values: list[float], digits: int) -> str:
        return "  ".join(f"{value + 0.0:.{digits}f}" for value in values)

    def rmse(name: str, key: str) -> tuple[str, str, str]:
        return row(name, numbers(figures[key], 5), numbers(PAPER_FLIGHT[key], 3))

    form1, form3 = (sum(figures[f"thrust_{form}_n"]) for form in ("form1", "form3"))
    qp = figures["qp"]
    times = f"{qp['median_us']:.0f} / {qp['p99_us']:.0f} / {qp['max_us']:.0f}"
    rows = [
        rmse("RMSE position x y z, 0–27 s [m]", "rmse_position_m"),
        rmse("RMSE attitude x y z, 0–27 s [rad]", "rmse_attitude_rad"),
        row("θ of rotors 1 3 5 7, form ③ [rad]", numbers(figures["theta_form3_rad"], 3), "about −0.4 each"),
        row("φ of rotors 1 3 5 7, form ③ [rad]", numbers(figures["phi_form3_rad"], 3), "0, fixed"),
        row("allocated τ₂, form ③ [Nm]", f"{figures['tau2_form3_nm']:.2f}", "around 2"),
        row("thrust λ₁ … λ₈, form ① [N]", numbers(figures["thrust_form1_n"], 1), "near mg/8 = 20"),
        row("thrust λ₁ … λ₈, form ③ [N]", numbers(figures["thrust_form3_n"], 1), "λ₁, λ₂ larger than in ①"),
        row("Σλ, form ① → form ③ [N]", f"{form1:.1f} → {form3:.1f} ({form3 / form1 - 1:+.1%})", "larger in ③"),
        row("ticks without an optimum", f"{qp['unsolved']}"),
        row("QP time, median / p99 / max [µs]", times, "within 5000 (Jetson TX2)"),
    ]
    header = row(f"flight, preset {figures['preset']}", "simulated", "paper")
    widths = [max(len(r[k]) for r in (header, *rows)) for k in range(3)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(r, widths, strict=True)).rstrip() for r in (header, *rows)
    ]
    return "\n".join([lines[0], "  ".join("─" * width for width in widths), *lines[1:]])
