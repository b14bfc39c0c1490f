"""Pictures of an identification: the parameters of joints and modules with their intervals, and the held-out fit."""

from pathlib import Path

import numpy as np

from spidar_gym.identify.report import QUANTITIES, Report
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.viz.style import BLUE, GREY, VERMILLION, pyplot, save

PANELS = ("damping", "friction", "stiffness", "speed", "gain_over_mass", "lag", "tilt")
"""Parameters with a panel each."""


def draw_report(report: Report, path: Path, robot: RobotSpec = ROBOT) -> None:
    """Draw the parameters with their 95 % intervals; the described values are lines.

    Args:
        report: The identification.
        path: Picture to write.
        robot: The described robot.
    """
    described = {
        "damping": robot.joint_kd + robot.joint_damping, "friction": robot.joint_friction, "stiffness": robot.joint_kp,
        "speed": robot.joint_speed, "gain_over_mass": 1.0 / robot.total_mass, "lag": robot.thrust_lag, "tilt": 0.0,
    }  # fmt: skip
    shown = [key for key in PANELS if any(line.key == key and np.isfinite(line.value) for line in report.lines)]
    plt = pyplot()
    figure, axes = plt.subplots(len(shown), 1, figsize=(8.0, 2.0 * len(shown)), squeeze=False)
    for key, axis in zip(shown, axes[:, 0], strict=True):
        lines = [line for line in report.lines if line.key == key]
        value, low, high = (np.array([getattr(line, name) for line in lines]) for name in ("value", "low", "high"))
        told = np.array([line.told for line in lines])
        axis.axhline(described[key], color=VERMILLION, label="as described", zorder=1)
        for chosen, color, label in ((told, BLUE, "told"), (~told, GREY, "not told")):
            at = np.flatnonzero(chosen)
            if len(at):
                ends = value[at] - low[at], high[at] - value[at]
                axis.errorbar(at, value[at], ends, fmt="o", markersize=3, color=color, label=label)
        quantity = QUANTITIES[key]
        axis.set_title(f"{quantity.name} [{quantity.unit}]", fontsize=9)
        axis.set_xticks(range(len(lines)), [line.place.replace("_", " ") for line in lines], rotation=45, ha="right")
        axis.set_xlim(-0.5, len(lines) - 0.5)
        axis.tick_params(axis="x", labelsize=6)
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
    save(figure, path)
