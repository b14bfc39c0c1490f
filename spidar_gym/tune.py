"""`spidar tune`: gains and compensations of the preset `tuned`, by CMA-ES on flights of seeds of its own."""

import importlib.util
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.control.centroidal import CentroidalConfig
from spidar_gym.control.compensation import CompensationConfig
from spidar_gym.control.controller import ControllerConfig
from spidar_gym.control.margins import AXES, margins
from spidar_gym.errors import MissingDependencyError, SpidarError, require_least
from spidar_gym.files import json_text, write_bytes, write_text
from spidar_gym.trial import CONDITIONS, Outcome, Trial, fly_all

FIRST_SEED = 900_000
"""Tuning flies seeds from here on; nothing else may."""
SPEEDS = (0.2, 0.6, 1.0)
"""Joint speeds of the tuning flights [rad/s]."""
SECONDS = 7.0
"""Length of a tuning flight [s]."""
POSITION_UNIT, ATTITUDE_UNIT = 0.010, 0.010
"""Errors that cost 1 each [m], [rad]."""
LOST = 20.0
"""Cost of a flight that ends early."""
LEAST_GAIN, LEAST_DELAY, MOST_SENSITIVITY = 2.0, 0.040, 2.2
"""Margins that every loop must keep: gain factor, more delay [s], largest sensitivity."""


@dataclass(frozen=True)
class Parameter:
    """One number that is tuned, in logarithms, within bounds."""

    name: str
    """What it is called in the log."""
    start: float
    """First guess."""
    low: float
    """Least value."""
    high: float
    """Largest value."""


def _gains(axis: str, p: float, i: float, d: float) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{axis}_{term}", value, value / 5.0, value * 5.0) for term, value in (("p", p), ("i", i), ("d", d))
    )


PARAMETERS: tuple[Parameter, ...] = (
    *_gains("xy", 4.7, 0.16, 6.0),
    *_gains("z", 8.0, 1.5, 6.0),
    *_gains("roll_pitch", 18.0, 2.0, 9.0),
    *_gains("yaw", 14.0, 1.3, 8.0),
    Parameter("momentum_gain", 1.0, 0.5, 1.5),
    Parameter("momentum_filter", 0.02, 0.002, 0.1),
    Parameter("servo_bandwidth", 40.0, 8.0, 120.0),
    Parameter("vectoring_lead", 0.05, 0.005, 0.12),
    Parameter("observer_gain", 0.8, 0.1, 0.95),
    Parameter("observer_time", 0.5, 0.1, 2.0),
    Parameter("observer_lag", 0.05, 0.01, 0.2),
)
"""What is tuned; the ramp of the joints is fixed, because it is bounded by the deadlines, not by the errors."""
JOINT_RAMP = 0.4
"""Ramp of the commanded joints [s]."""


def configuration(values: dict[str, float]) -> ControllerConfig:
    """The controller with these parameters."""

    def pid(axis: str) -> tuple[float, float, float]:
        return values[f"{axis}_p"], values[f"{axis}_i"], values[f"{axis}_d"]

    xy, tilt = pid("xy"), pid("roll_pitch")
    names = [p.name for p in PARAMETERS if "_" in p.name and p.name[-2:] not in ("_p", "_i", "_d")]
    return ControllerConfig(
        centroidal=CentroidalConfig(position_gains=(xy, xy, pid("z")), attitude_gains=(tilt, tilt, pid("yaw"))),
        compensation=CompensationConfig(joint_ramp=JOINT_RAMP, **{name: values[name] for name in names}),
    )


def decode(x: np.ndarray) -> dict[str, float]:
    """Parameters of a point of the search: 0 is the start, ± 1 the bounds in logarithms, beyond them reflected."""
    values = {}
    for parameter, u in zip(PARAMETERS, np.asarray(x, float).tolist(), strict=True):
        u = abs((u + 1.0) % 4.0 - 2.0) - 1.0  # a triangle wave through (−1, 1), (1, −1)
        u = -u
        end = parameter.high if u > 0.0 else parameter.low
        values[parameter.name] = parameter.start * (end / parameter.start) ** abs(u)
    return values


def shortfall(config: ControllerConfig) -> float:
    """How far the loops' margins fall short, 0 where all are kept."""
    total = 0.0
    for axis in range(len(AXES)):
        m = margins(config, axis)
        total += max(0.0, 1.0 - m.gain / LEAST_GAIN) + max(0.0, 1.0 - m.delay / LEAST_DELAY)
        total += max(0.0, min(m.sensitivity, 100.0) / MOST_SENSITIVITY - 1.0)
    return total


def cost(outcome: Outcome) -> float:
    """Cost of one flight."""
    if outcome.failure:
        return LOST
    return outcome.position / POSITION_UNIT + outcome.attitude / ATTITUDE_UNIT


def trials(generation: int, flights: int) -> list[Trial]:
    """The flights of a generation: every condition and speed, other seeds each time, the same for all candidates."""
    kinds = [(condition, speed) for condition in CONDITIONS for speed in SPEEDS]
    first = FIRST_SEED + generation * flights
    return [Trial(*kinds[k % len(kinds)], first + k, SECONDS) for k in range(flights)]


def check_search(*, generations: int, population: int, flights: int, seed: int, workers: int) -> None:
    """Refuse a search that cannot be made."""
    if importlib.util.find_spec("cma") is None:
        raise MissingDependencyError("cma", "pip install 'spidar-gym[tune]'")
    require_least(1, generations=generations, flights=flights, workers=workers)
    require_least(2, population=population)
    require_least(0, seed=seed)


def tune(
    folder: Path,
    *,
    generations: int,
    population: int,
    flights: int,
    seed: int,
    workers: int,
    on_flight: Callable[[], object] = lambda: None,
    on_generation: Callable[[dict[str, Any]], object] = lambda _: None,
) -> dict[str, Any]:
    """Search, or go on with the search in `folder`.

    Args:
        folder: Where the state and the log of the search are kept after every generation.
        generations: How many in all.
        population: Candidates a generation.
        flights: Flights a candidate.
        seed: Of the search; other settings than those of an unfinished search are refused.
        workers: Processes.
        on_flight: Called after every flight.
        on_generation: Called with the head of each line of the log.

    Returns:
        The last line of the log: the mean of the search distribution, its cost and margins.
    """
    check_search(generations=generations, population=population, flights=flights, seed=seed, workers=workers)
    import cma

    settings = {"population": population, "flights": flights, "seed": seed}
    state = folder / "tune.pickle"
    lines: list[dict[str, Any]] = []
    if state.is_file():
        search, lines, earlier = pickle.loads(state.read_bytes())
        if earlier != settings:
            raise SpidarError(f"{state} holds a search with {earlier}; valid: the same settings, or another folder")
    else:
        options = {"popsize": population, "seed": seed + 1, "verbose": -9, "CMA_diagonal": True}
        search = cma.CMAEvolutionStrategy(np.zeros(len(PARAMETERS)), 0.3, options)
    for generation in range(len(lines), generations):
        points = search.ask()
        # The mean of the distribution flies too: it is the answer, so its cost belongs in the log.
        configs = [configuration(decode(x)) for x in [*points, search.mean]]
        jobs = [(config, trial) for config in configs for trial in trials(generation, flights)]
        outcomes = fly_all(jobs, workers=workers, on_done=on_flight)
        costs = np.array([cost(outcome) for outcome in outcomes]).reshape(len(configs), flights).mean(axis=1)
        costs += [10.0 * shortfall(config) for config in configs]
        search.tell(points, costs[:-1].tolist())
        lines.append(
            {
                "generation": generation,
                "cost": float(costs[-1]),
                "best": float(costs[:-1].min()),
                "sigma": float(search.sigma),
                "shortfall": shortfall(configs[-1]),
                "parameters": {name: float(f"{value:.4g}") for name, value in decode(search.mean).items()},
            }
        )
        write_bytes(state, pickle.dumps((search, lines, settings)))
        write_text(folder / "tune.json", json_text({"settings": settings, "log": lines}))
        on_generation({name: lines[-1][name] for name in ("generation", "cost", "best", "sigma")})
    return lines[-1]


def margin_table(config: ControllerConfig) -> str:
    """Margins of every loop as text."""
    lines = [f"{'axis':12}{'gain margin':>14}{'phase margin':>15}{'delay margin':>15}{'sensitivity':>13}"]
    for axis, name in enumerate(AXES):
        m = margins(config, axis)
        lines.append(f"{name:12}{m.gain:14.2f}{m.phase:11.2f} rad{1e3 * m.delay:12.0f} ms{m.sensitivity:13.2f}")
    return "\n".join(lines)
