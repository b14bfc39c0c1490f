"""The search for `tuned`: gains and compensations of the flight controller, margins held."""

from dataclasses import replace

from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.margins import AXES, margins
from spidar_gym.control.presets import TUNED_V1
from spidar_gym.tune.parameter import Parameter

LEAST_GAIN, LEAST_DELAY, MOST_SENSITIVITY = 2.0, 0.040, 2.2
"""Margins that every loop must keep: gain factor, more delay [s], largest sensitivity."""
REFERENCE = "tuned_v1"
"""Preset that flies beside every generation; the search begins at its numbers."""

_ROWS = {
    "xy": TUNED_V1.centroidal.position_gains[0],
    "z": TUNED_V1.centroidal.position_gains[2],
    "roll_pitch": TUNED_V1.centroidal.attitude_gains[0],
    "yaw": TUNED_V1.centroidal.attitude_gains[2],
}
_BOUNDS: dict[str, tuple[float, float]] = {
    "momentum_gain": (0.5, 2.0),
    "momentum_filter": (0.002, 0.1),
    "servo_bandwidth": (8.0, 120.0),
    "vectoring_lead": (0.005, 0.12),
    "observer_gain": (0.1, 0.98),
    "observer_time": (0.05, 2.0),
    "observer_lag": (0.01, 0.3),
}
"""Fields of `CompensationConfig`. The ramp of the joints is fixed, for the deadlines bound it and not the errors; so is
the gain of the reference's acceleration, which none of the tracks has."""

PARAMETERS: tuple[Parameter, ...] = (
    *(
        Parameter(f"{axis}_{term}", value, value / 5.0, value * 5.0)
        for axis, row in _ROWS.items()
        for term, value in zip("pid", row, strict=True)
    ),
    *(Parameter(name, getattr(TUNED_V1.compensation, name), *bounds) for name, bounds in _BOUNDS.items()),
)
"""Gains of the PIDs, then compensations."""


def configuration(values: dict[str, float]) -> ControllerConfig:
    """The controller with these parameters."""

    def pid(axis: str) -> tuple[float, float, float]:
        return values[f"{axis}_p"], values[f"{axis}_i"], values[f"{axis}_d"]

    xy, z, tilt, yaw = (pid(axis) for axis in _ROWS)
    return ControllerConfig(
        centroidal=CentroidalConfig(position_gains=(xy, xy, z), attitude_gains=(tilt, tilt, yaw)),
        compensation=replace(TUNED_V1.compensation, **{name: values[name] for name in _BOUNDS}),
    )


def shortfall(config: ControllerConfig) -> float:
    """How far the loops' margins fall short, 0 where all are kept."""
    total = 0.0
    for axis in range(len(AXES)):
        m = margins(config, axis)
        total += max(0.0, 1.0 - m.gain / LEAST_GAIN) + max(0.0, 1.0 - m.delay / LEAST_DELAY)
        total += max(0.0, min(m.sensitivity, 100.0) / MOST_SENSITIVITY - 1.0)
    return total


def margin_lines(config: ControllerConfig) -> list[list[str]]:
    """Margins of every loop: the cells of a table."""
    lines = [["axis", "gain margin", "phase margin", "delay margin", "sensitivity"]]
    for axis, name in enumerate(AXES):
        m = margins(config, axis)
        lines.append([name, f"{m.gain:.2f}", f"{m.phase:.2f} rad", f"{1e3 * m.delay:.0f} ms", f"{m.sensitivity:.2f}"])
    return lines
