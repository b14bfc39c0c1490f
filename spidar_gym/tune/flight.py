"""The search for `tuned`: gains and compensations of the flight controller, margins held."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from spidar_gym.control.flight.centroidal import CentroidalConfig, Gains
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.margins import AXES, Margins, margins
from spidar_gym.control.presets import TUNED, TUNED_V1
from spidar_gym.tune.parameter import Parameter

LEAST_GAIN, LEAST_DELAY, MOST_SENSITIVITY, MOST_NOISE = 2.0, 0.040, 2.2, 16.0
"""Margins that every loop must keep: gain factor, more delay [s], largest sensitivity, gain of noise [1/s]."""
INSIDE = 1.002
"""At the edge they are kept with this factor, so that four digits of a number keep them."""
REFERENCE = "tuned_v1"
"""Preset that flies beside every generation; the search begins at its numbers."""


def axes(config: ControllerConfig) -> dict[str, Gains]:
    """Gains of the four axes that differ, by the name that parameters begin with."""
    gains = config.centroidal
    return {
        "xy": gains.position_gains[0],
        "z": gains.position_gains[2],
        "roll_pitch": gains.attitude_gains[0],
        "yaw": gains.attitude_gains[2],
    }


BOUNDS: dict[str, tuple[float, float]] = {
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
MORE_BOUNDS = {
    "torque_observer_gain": (0.1, 0.98),
    "torque_observer_time": (0.05, 2.0),
    "torque_observer_lag": (0.01, 0.9),
    "lead_gain": (0.01, 2.0),
    "lead_time": (0.02, 0.5),
}
"""Those that `retuned` has besides."""
NAMES = tuple(BOUNDS)
"""What is tuned by default."""


def pids(xy: Gains, z: Gains, tilt: Gains, yaw: Gains) -> CentroidalConfig:
    """Gains of all axes, from those of the four that differ."""
    return CentroidalConfig(position_gains=(xy, xy, z), attitude_gains=(tilt, tilt, yaw))


# As `tuned` is, but that each observer may go its own way (that of the torque is at its best where it exaggerates the
# lag of the rotors, for so it adds to what is fed forward of the legs; that of the force has nothing to add to), and a
# little lead.
RETUNED_START = replace(
    TUNED,
    compensation=replace(
        TUNED.compensation, torque_observer_gain=0.6, torque_observer_time=0.2, torque_observer_lag=0.3,
        lead_gain=0.05, lead_time=0.08,
    ),
)  # fmt: skip
"""Where the search for `retuned` begins."""
RETUNED_NAMES = (*(name for name in NAMES if name not in ("momentum_filter", "servo_bandwidth")), *MORE_BOUNDS)
"""What is tuned of it: the model of the servos stays that of `tuned`."""


def parameters(
    start: ControllerConfig, names: Sequence[str] = NAMES, *, stiffness: bool = True
) -> tuple[Parameter, ...]:
    """Gains of the PIDs that are not 0, within a factor of 5, then compensations: a search that begins at `start`.

    Args:
        start: First guess.
        names: Which compensations are tuned, of `BOUNDS` and `MORE_BOUNDS`; the others stay.
        stiffness: Whether the proportional gains are among them.
    """
    gains = (
        Parameter(f"{axis}_{term}", value, value / 5.0, value * 5.0)
        for axis, row in axes(start).items()
        for term, value in zip("pid", row, strict=True)
        if value > 0.0 and (stiffness or term != "p")
    )
    ranges = BOUNDS | MORE_BOUNDS
    return *gains, *(Parameter(name, getattr(start.compensation, name), *ranges[name]) for name in names)


PARAMETERS = parameters(TUNED_V1)
"""What is searched for `tuned`."""


def configuration(values: Mapping[str, float], start: ControllerConfig = TUNED_V1) -> ControllerConfig:
    """The controller with these parameters; what they do not name is as `start` has it."""

    def pid(axis: str, row: Gains) -> Gains:
        p, i, d = row
        return values.get(f"{axis}_p", p), values.get(f"{axis}_i", i), values.get(f"{axis}_d", d)

    rows = (pid(axis, row) for axis, row in axes(start).items())
    found = {name: values[name] for name in (*BOUNDS, *MORE_BOUNDS) if name in values}
    return replace(start, centroidal=pids(*rows), compensation=replace(start.compensation, **found))


def at_the_edge(values: Mapping[str, float], start: ControllerConfig) -> dict[str, float]:
    """The same parameters, each axis as stiff as its margins allow.

    Proportional and differential gains belong together as in the loop that is f times as fast: f² p and f d.

    Args:
        values: Parameters without the proportional gains, which are those of `start` at first.
        start: What they do not name.
    """
    found = dict(values)
    for k, (name, (p, _, d)) in enumerate(axes(start).items()):
        damping = values.get(f"{name}_d", d)

        def times(f: float, name: str = name, p: float = p, damping: float = damping) -> dict[str, float]:
            return {f"{name}_p": f * f * p, f"{name}_d": f * damping}

        def holds(f: float, k: int = k, times: Callable[[float], dict[str, float]] = times) -> bool:
            return lack(margins(configuration({**values, **times(f)}, start), k), INSIDE) == 0.0

        found |= times(most(holds, 0.5, 2.0))
    return found


def most(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The largest number, to a thousandth of itself, for which something holds; 1 where it does for none.

    Args:
        holds: Whether it does.
        low: Least number.
        high: Largest.
    """
    coarse = np.geomspace(high, low, 40)
    first = next((k for k, f in enumerate(coarse.tolist()) if holds(f)), None)
    if first is None:
        return 1.0
    good, bad = float(coarse[first]), float(coarse[max(0, first - 1)])
    while bad > good * 1.001:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


def loops(config: ControllerConfig) -> list[Margins]:
    """Margins of every one of `AXES`."""
    return [margins(config, axis) for axis in range(len(AXES))]


def shortfall(found: Sequence[Margins]) -> float:
    """How far margins fall short, 0 where all are kept."""
    return sum(map(lack, found))


def lack(m: Margins, inside: float = 1.0) -> float:
    """How far the margins of one loop fall short, each asked for by a factor more."""
    total = max(0.0, 1.0 - m.gain / (inside * LEAST_GAIN)) + max(0.0, 1.0 - m.delay / (inside * LEAST_DELAY))
    for value, bound in ((m.sensitivity, MOST_SENSITIVITY), (m.noise, MOST_NOISE)):
        total += max(0.0, inside * min(value, 1000.0) / bound - 1.0)
    return total


def margin_lines(found: Sequence[Margins]) -> list[list[str]]:
    """Margins of every one of `AXES`: the cells of a table."""
    lines = [["axis", "gain margin", "phase margin", "delay margin", "sensitivity", "gain of noise"]]
    for name, m in zip(AXES, found, strict=True):
        cells = f"{m.gain:.2f}", f"{m.phase:.2f} rad", f"{1e3 * m.delay:.0f} ms", f"{m.sensitivity:.2f}"
        lines.append([name, *cells, f"{m.noise:.1f} s⁻¹"])
    return lines
