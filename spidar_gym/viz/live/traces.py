"""What is drawn over the last seconds: errors, and the shares of their limits that joints and rotors use."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import COURSE, CRAWL
from spidar_gym.native.plant import Plant
from spidar_gym.robot import ROBOT

SECONDS = 20.0
"""How long it is remembered [s]."""
POINTS = 200
"""No more points of a curve are handed out."""


@dataclass(frozen=True)
class Plot:
    """Some curves with one axis."""

    title: str
    """What it is, with its unit."""
    names: tuple[str, ...]
    """What each curve is."""
    high: float
    """The axis reaches up to it at least, and down to as much below 0."""
    low: float | None = None
    """Where the axis begins, which then ends at `high` always."""


SHARES = Plot("share of the limit [%]", ("joint torque", "thrust"), 100.0, 0.0)
FLIGHT = (
    Plot("position error [mm]", ("x", "y", "z"), 10.0),
    Plot("attitude error [mrad]", ("x", "y", "z"), 10.0),
    SHARES,
)
GROUND = (
    Plot("way to the goal [mm]", ("x", "y"), 10.0),
    Plot("angles to the goal [mrad]", ("heading", "tilt"), 10.0),
    SHARES,
)
HOPS = (
    Plot("way to the goal [m]", ("x", "y"), 1.0),
    Plot("lift and charge [%]", ("thrust / weight", "charge"), 150.0, 0.0),
    SHARES,
)


def plots(env_id: str) -> tuple[Plot, ...]:
    """What is drawn of an environment."""
    return {CRAWL: GROUND, COURSE: HOPS}.get(env_id, FLIGHT)


def row(env_id: str, info: Mapping[str, Any], plant: Plant) -> list[float]:
    """The values of all curves now, plot by plot.

    Args:
        env_id: Environment.
        info: What it tells.
        plant: Its robot, whose limits count.
    """
    actuators = plant.config.actuators
    torque = float(np.abs(info["joint_torque"]).max()) / min(actuators.max_joint_torque, ROBOT.max_joint_torque)
    shares = [100.0 * torque, 100.0 * float(info["thrust"].max()) / actuators.max_thrust]
    if env_id == COURSE:
        x, y, _ = info["goal_error"].tolist()
        return [x, y, 100.0 * info["thrust_fraction"], 100.0 * info["charge"], *shares]
    if env_id == CRAWL:
        x, y, yaw = (1e3 * info["goal_error"]).tolist()
        return [x, y, yaw, 1e3 * info["tilt_rad"], *shares]
    return [*(1e3 * info["position_error"]).tolist(), *(1e3 * info["attitude_error"]).tolist(), *shares]


class Traces:
    """The last seconds of all curves; a time of its own, which goes on over resets, is their abscissa."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._rows: deque[tuple[float, Sequence[float]]] = deque(maxlen=round(SECONDS * CONTROL_RATE))

    def add(self, time: float, values: Sequence[float]) -> None:
        """Remember the values at a time [s]."""
        self._rows.append((time, values))

    def columns(self, first: int, count: int) -> tuple[np.ndarray, ...]:
        """Time before now [s, negative] and `count` curves from the `first` on, thinned to `POINTS`: (n,) each."""
        rows = list(self._rows)
        if not rows:
            return (np.array([-1.0 / CONTROL_RATE, 0.0]), *[np.zeros(2)] * count)
        # Every n-th by their number in all, not in the list: as they move on, curves keep the same points.
        stride = max(1, -(-len(rows) // POINTS))
        last = round(rows[-1][0] * CONTROL_RATE)
        rows = [row for k, row in enumerate(reversed(rows)) if k == 0 or (last - k) % stride == 0][::-1]
        time = np.array([time for time, _ in rows]) - self._rows[-1][0]
        values = np.array([values for _, values in rows])[:, first : first + count]
        return (time, *values.T)
