"""Sensors from any log: noise of inertial unit, motion capture and encoders, and the capture's latency."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spidar_gym.identify.estimate import Estimate
from spidar_gym.identify.smooth import smoothed
from spidar_gym.logs.record import Record, Series

FINE, SLOW = 0.02, 0.1
"""Distances of the knots of the splines through inertial unit and motion capture [s]."""
STEP = 0.0025
"""Deviation of a latency from a log of ticks [s]."""


@dataclass(frozen=True)
class Sensors:
    """Noise of the sensors; what a log does not hold is NaN."""

    gyro: float
    """Density of the gyroscope's noise [rad/s/√Hz]."""
    accelerometer: float
    """Density of the accelerometer's noise, vibration included [m/s²/√Hz]."""
    position: float
    """Standard deviation of a position of the motion capture about a smooth path [m]."""
    rotation: float
    """Standard deviation of an attitude of the motion capture about a smooth path [rad]."""
    encoder: float
    """Standard deviation of a joint's angle about a smooth path [rad]."""
    latency: Estimate
    """Least time from a frame of the motion capture, by its stamp, to its receipt, () [s]."""
    dropped: float
    """Share of the motion capture's frames that were not received."""


def find_sensors(record: Record) -> Sensors:
    """Measure the noise of the sensors in a log."""
    nothing = Estimate(np.array(np.nan), np.array(np.nan), np.array(np.nan))
    found = dict.fromkeys(("gyro", "accelerometer", "position", "rotation", "encoder", "dropped"), np.nan)
    latency = nothing
    if "imu" in record and len(record["imu"]) > 100:
        unit = record["imu"]
        root = np.sqrt(float(np.median(np.diff(unit.time))))
        found["gyro"] = root * _scatter(unit, unit.values["angular_velocity"], FINE)
        found["accelerometer"] = root * _scatter(unit, unit.values["specific_force"], FINE)
    if "mocap/pose" in record and len(record["mocap/pose"]) > 100:
        seen = record["mocap/pose"]
        found["position"] = _scatter(seen, seen.values["position_w"], SLOW)
        turns = Rotation.from_quat(seen.values["quat_wb"][:, [1, 2, 3, 0]])
        found["rotation"] = _scatter(seen, (turns[0].inv() * turns).as_rotvec(), SLOW)
        waits = seen.received - seen.time
        latency = Estimate(np.array(np.quantile(waits, 0.02)), np.array(STEP), np.array(0.02))
        period = float(np.median(np.diff(seen.time)))
        found["dropped"] = max(0.0, 1.0 - (len(seen) - 1) * period / float(seen.time[-1] - seen.time[0]))
    if "joint_states" in record and len(record["joint_states"]) > 100:
        found["encoder"] = _scatter(record["joint_states"], record["joint_states"].values["position"][:, :16], SLOW)
    return Sensors(latency=latency, **found)


def _scatter(series: Series, values: np.ndarray, knots: float) -> float:
    """Return the standard deviation of samples about a smooth curve, for the number of its coefficients."""
    time, kept = np.unique(series.time, return_index=True)
    curve = smoothed(time, values[kept], knots)
    rest = values[kept] - curve(time)
    return float(np.sqrt((rest**2).sum() / ((len(time) - len(curve.c)) * rest.shape[1])))
