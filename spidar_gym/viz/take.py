"""What a film shows of one flight or crawl: where the robot was, its phases, and what is drawn over time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from spidar_gym.paper.crawl import CrawlLog
from spidar_gym.paper.flight import FORM_CHANGE, UNRESTRICTED, FlightLog
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.stage import cog
from spidar_gym.so3 import quat_to_matrix


@dataclass(frozen=True)
class Take:
    """One flight or crawl, one row a tick."""

    title: str
    """Who flies."""
    time: np.ndarray
    """(n,) [s]."""
    qpos: np.ndarray
    """Configuration of the simulated robot, (n, 39)."""
    thrust: np.ndarray
    """(n, 8) [N]."""
    phase: Sequence[str]
    """(n,) words."""
    traces: Mapping[str, np.ndarray]
    """What is drawn over time, with its unit: (n,) each."""
    contacts: Sequence[np.ndarray | None] | None = None
    """Contact points and forces of each tick, world: (k, 6) [m, N]."""
    ground: GroundConfig = field(default_factory=GroundConfig)
    """The floor."""


def tick_at(take: Take, time: float) -> int:
    """The tick that is nearest to a time [s]: the last one after the end."""
    return round(float(np.interp(time, take.time, np.arange(len(take.time)))))


def flight_take(log: FlightLog) -> Take:
    """The paper's flight."""
    title = f"preset {log.preset}{', with noise' if log.noise else ''}"
    phases = [flight_phase(time) for time in log.time.tolist()]
    traces = flight_traces(log.qpos, log.position_error, log.attitude_error)
    return Take(title, log.time, log.qpos, log.thrust, phases, traces)


def flight_phase(time: float) -> str:
    """What happens in the paper's flight at a time [s]."""
    start, end = FORM_CHANGE
    if any(first < time <= last for first, last in UNRESTRICTED):
        return "form ③, constraint dropped"
    return "hover in form ①" if time <= start else "① → ② → ③" if time <= end else "hover in form ③"


def flight_traces(qpos: np.ndarray, position_error: np.ndarray, attitude_error: np.ndarray) -> dict[str, np.ndarray]:
    """Height and errors of a flight, whose rows are ticks.

    Args:
        qpos: Configurations (n, 39).
        position_error: (n, 3) [m].
        attitude_error: (n, 3) [rad].
    """
    return {
        "height of the CoG [m]": cog(qpos)[:, 2],
        "position error [mm]": 1e3 * np.linalg.norm(position_error, axis=1),
        "attitude error [mrad]": 1e3 * np.linalg.norm(attitude_error, axis=1),
    }


def crawl_take(log: CrawlLog) -> Take:
    """A crawl."""
    title = f"preset {log.preset}, {log.joint_speed:g} rad/s{', with noise' if log.noise else ''}"
    phases = [str(phase) for phase in log.phase]
    return Take(title, log.time, log.qpos, log.thrust, phases, crawl_traces(log.qpos), log.contacts)


def crawl_traces(qpos: np.ndarray) -> dict[str, np.ndarray]:
    """Height, way and tilt of a crawling torso, from configurations (n, 39)."""
    tilt = [np.arccos(np.clip(quat_to_matrix(row)[2, 2], -1.0, 1.0)) for row in qpos[:, 3:7]]
    return {
        "height of the torso [m]": qpos[:, 2],
        "way [m]": np.linalg.norm(qpos[:, :2] - qpos[0, :2], axis=1),
        "tilt of the torso [mrad]": 1e3 * np.array(tilt),
    }
