"""Curves of the last seconds: errors, and loads of joints and rotors as shares of their limits."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import COURSE, CRAWL, GRASP
from spidar_gym.native.plant import Plant
from spidar_gym.robot import ROBOT

SECONDS = 20.0
"""Length of the curves [s]."""
POINTS = 200
"""Approximate largest number of points of a curve."""


@dataclass(frozen=True)
class Plot:
    """Curves that share one axis."""

    title: str
    """Quantity with its unit."""
    names: tuple[str, ...]
    """Names of the curves."""
    high: float
    """Least upper end of the axis; also of the lower end, negated, unless `low` is given."""
    low: float | None = None
    """Lower end of the axis; None for −`high`."""


SHARES = Plot("share of the limit [%]", ("joint torque", "thrust"), 100.0, 0.0)
FLIGHT = (
    Plot("position error [mm]", ("x", "y", "z"), 10.0),
    Plot("attitude error [mrad]", ("x", "y", "z"), 10.0),
    SHARES,
)
GROUND = (
    Plot("goal error [mm]", ("x", "y"), 10.0),
    Plot("heading error, tilt [mrad]", ("heading", "tilt"), 10.0),
    SHARES,
)
HOPS = (
    Plot("goal error [m]", ("x", "y"), 1.0),
    Plot("lift and charge [%]", ("thrust / weight", "charge"), 150.0, 0.0),
    SHARES,
)
GRASPS = (
    Plot("way of the object to its place, its lift [m]", ("way", "lift"), 1.0, 0.0),
    Plot("largest force of a foot [N]", ("force",), 40.0, 0.0),
    SHARES,
)


def plots(env_id: str) -> tuple[Plot, ...]:
    """Return the plots of an environment."""
    return {CRAWL: GROUND, COURSE: HOPS, GRASP: GRASPS}.get(env_id, FLIGHT)


def row(env_id: str, info: Mapping[str, Any], plant: Plant) -> list[float]:
    """Return the present values of all curves, plot by plot.

    Args:
        env_id: Environment.
        info: The environment's `info`.
        plant: Its plant, whose limits are used.
    """
    actuators = plant.config.actuators
    torque = float(np.abs(info["joint_torque"]).max()) / min(actuators.max_joint_torque, ROBOT.max_joint_torque)
    shares = [100.0 * torque, 100.0 * float(info["thrust"].max()) / actuators.max_thrust]
    if env_id == COURSE:
        x, y, _ = info["goal_error"].tolist()
        return [x, y, 100.0 * info["thrust_fraction"], 100.0 * info["charge"], *shares]
    if env_id == GRASP:
        return [info["way_m"], info["lifted_m"], info["force_n"], *shares]
    if env_id == CRAWL:
        x, y, yaw = (1e3 * info["goal_error"]).tolist()
        return [x, y, yaw, 1e3 * info["tilt_rad"], *shares]
    return [*(1e3 * info["position_error"]).tolist(), *(1e3 * info["attitude_error"]).tolist(), *shares]


class Traces:
    """The last seconds of all curves, over a time that continues across resets."""

    def __init__(self) -> None:
        """Start without values."""
        self._rows: deque[tuple[float, Sequence[float]]] = deque(maxlen=round(SECONDS * CONTROL_RATE))

    def add(self, time: float, values: Sequence[float]) -> None:
        """Store the values at a time [s]."""
        self._rows.append((time, values))

    def columns(self, first: int, count: int) -> tuple[np.ndarray, ...]:
        """Return time relative to now [s, negative] and `count` curves from `first`, thinned to `POINTS`; (n,) each."""
        rows = list(self._rows)
        if not rows:
            return (np.array([-1.0 / CONTROL_RATE, 0.0]), *[np.zeros(2)] * count)
        # Every n-th point by its overall number, not by its place in the list, so that moving curves keep their points.
        stride = max(1, -(-len(rows) // POINTS))
        last = round(rows[-1][0] * CONTROL_RATE)
        rows = [row for k, row in enumerate(reversed(rows)) if k == 0 or (last - k) % stride == 0][::-1]
        time = np.array([time for time, _ in rows]) - self._rows[-1][0]
        values = np.array([values for _, values in rows])[:, first : first + count]
        return (time, *values.T)
