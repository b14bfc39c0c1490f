"""The search for `tuned`: gains and compensations of the flight controller, subject to stability margins."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from spidar_gym.control.flight.centroidal import CentroidalConfig, Gains
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.margins import AXES, Margins, margins
from spidar_gym.control.presets import TUNED, TUNED_V1
from spidar_gym.tune.parameter import Parameter

LEAST_GAIN, LEAST_DELAY, MOST_SENSITIVITY, MOST_NOISE = 2.0, 0.040, 2.2, 16.0
"""Margins that every loop must keep: gain factor, additional delay [s], largest sensitivity, gain of noise [1/s]."""
INSIDE = 1.002
"""Factor by which `at_the_edge` tightens the margins, so that rounding to four digits does not violate them."""
REFERENCE = "tuned_v1"
"""Preset that is evaluated beside every generation; the search starts from its numbers."""


def axes(config: ControllerConfig) -> dict[str, Gains]:
    """Return the gains of the four distinct axes, by the prefix of their parameters' names."""
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
"""Bounds of fields of `CompensationConfig`. The ramp of the joints is fixed, because deadlines bound it and not errors.
The gain of the reference's acceleration is fixed, because no track has such an acceleration."""
MORE_BOUNDS = {
    "torque_observer_gain": (0.1, 0.98),
    "torque_observer_time": (0.05, 2.0),
    "torque_observer_lag": (0.01, 0.9),
    "lead_gain": (0.01, 2.0),
    "lead_time": (0.02, 0.5),
}
"""Bounds of further fields, which `retuned` tunes."""
NAMES = tuple(BOUNDS)
"""Compensations that are tuned by default."""


def pids(xy: Gains, z: Gains, tilt: Gains, yaw: Gains) -> CentroidalConfig:
    """Return the gains of all axes from those of the four distinct axes."""
    return CentroidalConfig(position_gains=(xy, xy, z), attitude_gains=(tilt, tilt, yaw))


# As `tuned`, but with separate parameters of the two observers and a small lead. The torque observer works best with an
# exaggerated lag of the rotors, because it then adds to the feed-forward of the legs. The force observer has no such
# feed-forward to add to.
RETUNED_START = replace(
    TUNED,
    compensation=replace(
        TUNED.compensation, torque_observer_gain=0.6, torque_observer_time=0.2, torque_observer_lag=0.3,
        lead_gain=0.05, lead_time=0.08,
    ),
)  # fmt: skip
"""Start of the search for `retuned`."""
RETUNED_NAMES = (*(name for name in NAMES if name not in ("momentum_filter", "servo_bandwidth")), *MORE_BOUNDS)
"""Compensations that `retuned` tunes; the model of the servos is that of `tuned`."""


def scaled(config: ControllerConfig, scale: float) -> ControllerConfig:
    """Return a controller that is `scale` times as fast: `scale`², `scale`³, `scale` times the P, I and D gains."""

    def faster(rows: tuple[Gains, Gains, Gains]) -> tuple[Gains, Gains, Gains]:
        x, y, z = ((p * scale**2, i * scale**3, d * scale) for p, i, d in rows)
        return x, y, z

    c = config.centroidal
    position, attitude = faster(c.position_gains), faster(c.attitude_gains)
    return replace(config, centroidal=replace(c, position_gains=position, attitude_gains=attitude))


# The result of earlier searches of 56 and 60 generations, which began with the numbers of `tuned`; the observer of the
# motion was slower then, and nothing held legs that ring.
STEADY_START = replace(
    TUNED,
    motion="observed",
    centroidal=pids((34.9, 0.05696, 6.33), (41.12, 5.838, 8.526), (37.9, 1.718, 7.552), (52.8, 6.418, 8.479)),
    compensation=replace(
        TUNED.compensation, vectoring_lead=0.05, observer_gain=0.4707, observer_time=0.2, observer_lag=0.25
    ),
)
"""Start of the search for `steady`."""
NOMINAL_TRACKS = ("flight-fast5", "flight-narrow")
"""Nominal tracks whose errors count beside those of calibrated robots."""
STEADY_NAMES = tuple(name for name in NAMES if not name.startswith(("momentum", "servo")))
"""Compensations that `steady` tunes. The feed-forward of the legs is that of `tuned`: a smaller one costs described
robots errors with fast legs, and calibrated ones, whose servos differ, do not show it."""


def parameters(
    start: ControllerConfig, names: Sequence[str] = NAMES, *, stiffness: bool = True
) -> tuple[Parameter, ...]:
    """Return the parameters of a search: non-zero PID gains within a factor of 5, then compensations.

    Args:
        start: First guess.
        names: Compensations to tune, from `BOUNDS` and `MORE_BOUNDS`; the others are fixed.
        stiffness: Whether the proportional gains are tuned too.
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
    """Return the controller with these parameters; all other numbers are those of `start`."""

    def pid(axis: str, row: Gains) -> Gains:
        p, i, d = row
        return values.get(f"{axis}_p", p), values.get(f"{axis}_i", i), values.get(f"{axis}_d", d)

    rows = (pid(axis, row) for axis, row in axes(start).items())
    found = {name: values[name] for name in (*BOUNDS, *MORE_BOUNDS) if name in values}
    return replace(start, centroidal=pids(*rows), compensation=replace(start.compensation, **found))


def at_the_edge(values: Mapping[str, float], start: ControllerConfig) -> dict[str, float]:
    """Complete parameters so that each axis is as stiff as its margins allow.

    Proportional and differential gains are scaled as for a loop that is f times as fast: f² p and f d.

    Args:
        values: Parameters without the proportional gains, which start from those of `start`.
        start: Controller with all other numbers.
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
    """Find the largest number for which a condition holds, to a relative 10⁻³; 1 where it holds for none.

    Args:
        holds: Condition.
        low: Least number.
        high: Largest number.
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
    """Return the margins of each of `AXES`."""
    return [margins(config, axis) for axis in range(len(AXES))]


def shortfall(found: Sequence[Margins]) -> float:
    """Return the sum of the margins' shortfalls; 0 where all margins are kept."""
    return sum(map(lack, found))


def lack(m: Margins, inside: float = 1.0) -> float:
    """Return the shortfall of the margins of one loop, with each bound tightened by a factor."""
    total = max(0.0, 1.0 - m.gain / (inside * LEAST_GAIN)) + max(0.0, 1.0 - m.delay / (inside * LEAST_DELAY))
    for value, bound in ((m.sensitivity, MOST_SENSITIVITY), (m.noise, MOST_NOISE)):
        total += max(0.0, inside * min(value, 1000.0) / bound - 1.0)
    return total


def margin_lines(found: Sequence[Margins]) -> list[list[str]]:
    """Return the margins of each of `AXES` as the cells of a table."""
    lines = [["axis", "gain margin", "phase margin", "delay margin", "sensitivity", "gain of noise"]]
    for name, m in zip(AXES, found, strict=True):
        cells = f"{m.gain:.2f}", f"{m.phase:.2f} rad", f"{1e3 * m.delay:.0f} ms", f"{m.sensitivity:.2f}"
        lines.append([name, *cells, f"{m.noise:.1f} s⁻¹"])
    return lines
