"""`spidar tune`: gains and compensations of the preset `tuned`, by CMA-ES on flights of seeds of its own."""

import hashlib
import importlib.util
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, parse_json, read_file, require_form
from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.margins import AXES, margins
from spidar_gym.errors import MissingDependencyError, SpidarError, require_least
from spidar_gym.files import json_text, write_text
from spidar_gym.paper.trial import CONDITIONS, Outcome, Trial, fly_all

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

LOG = "tune.json"
"""The file of a search."""
MOST_BYTES = 2**26
"""No log is larger."""
FORM = {
    "settings": {"population": int, "flights": int, "seed": int},
    "log": [
        {
            "generation": int, "cost": float, "best": float, "sigma": float, "shortfall": float,
            "parameters": {str: float}, "costs": [float],
        }
    ],
    "sha256": str,
}  # fmt: skip
"""What stands in it."""


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


GAINS: tuple[Parameter, ...] = (
    *_gains("xy", 4.7, 0.16, 6.0),
    *_gains("z", 8.0, 1.5, 6.0),
    *_gains("roll_pitch", 18.0, 2.0, 9.0),
    *_gains("yaw", 14.0, 1.3, 8.0),
)
"""Gains of the PIDs."""
COMPENSATIONS: tuple[Parameter, ...] = (
    Parameter("momentum_gain", 1.0, 0.5, 1.5),
    Parameter("momentum_filter", 0.02, 0.002, 0.1),
    Parameter("servo_bandwidth", 40.0, 8.0, 120.0),
    Parameter("vectoring_lead", 0.05, 0.005, 0.12),
    Parameter("observer_gain", 0.8, 0.1, 0.95),
    Parameter("observer_time", 0.5, 0.1, 2.0),
    Parameter("observer_lag", 0.05, 0.01, 0.2),
)
"""Fields of `CompensationConfig`; the ramp of the joints is fixed: the deadlines bound it, not the errors."""
PARAMETERS = GAINS + COMPENSATIONS
"""What is tuned."""
JOINT_RAMP = 0.4
"""Ramp of the commanded joints [s]."""


def configuration(values: dict[str, float]) -> ControllerConfig:
    """The controller with these parameters."""

    def pid(axis: str) -> tuple[float, float, float]:
        return values[f"{axis}_p"], values[f"{axis}_i"], values[f"{axis}_d"]

    xy, tilt = pid("xy"), pid("roll_pitch")
    return ControllerConfig(
        centroidal=CentroidalConfig(position_gains=(xy, xy, pid("z")), attitude_gains=(tilt, tilt, pid("yaw"))),
        compensation=CompensationConfig(joint_ramp=JOINT_RAMP, **{p.name: values[p.name] for p in COMPENSATIONS}),
    )


def decode(x: np.ndarray) -> dict[str, float]:
    """Parameters of a point of the search: 0 is the start, ± 1 the bounds in logarithms, beyond them reflected."""
    values = {}
    for parameter, u in zip(PARAMETERS, np.asarray(x, float).tolist(), strict=True):
        u = 1.0 - abs((u + 1.0) % 4.0 - 2.0)  # a triangle wave through (−1, −1), (1, 1)
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
        folder: Where the log of the search is written after every generation; what was told is all of its state. The
            flights of an unfinished generation lie there too.
        generations: How many in all.
        population: Candidates a generation.
        flights: Flights a candidate.
        seed: Seed of the search; other settings than those of an unfinished search are refused.
        workers: Processes.
        on_flight: Called after every flight.
        on_generation: Called with the head of each line of the log.

    Returns:
        The last line of the log: the mean of the search distribution, its cost and margins.
    """
    check_search(generations=generations, population=population, flights=flights, seed=seed, workers=workers)
    settings = {"population": population, "flights": flights, "seed": seed}
    search, lines, unfinished = _search(population, seed), read_log(folder, settings), folder / "unfinished"
    _replay(search, lines, folder / LOG)
    for _ in range(len(lines) * (population + 1) * flights):
        on_flight()
    for generation in range(len(lines), generations):
        points, mean = search.ask(), search.mean.copy()
        # The mean of the distribution flies too: it is the answer, so its cost belongs in the log.
        configs = [configuration(decode(x)) for x in [*points, mean]]
        jobs = [(config, trial) for config in configs for trial in trials(generation, flights)]
        outcomes = fly_all(jobs, workers=workers, folder=unfinished, on_done=on_flight)
        costs = np.array([cost(outcome) for outcome in outcomes]).reshape(len(configs), flights).mean(axis=1)
        costs += [10.0 * shortfall(config) for config in configs]
        search.tell(points, costs[:-1].tolist())
        lines.append(_line(generation, costs.tolist(), mean, search))
        write_text(folder / LOG, log_text(settings, lines))
        shutil.rmtree(unfinished, ignore_errors=True)
        on_generation({name: lines[-1][name] for name in ("generation", "cost", "best", "sigma")})
    return lines[-1]


def _search(population: int, seed: int) -> Any:  # noqa: ANN401 - cma is optional
    """A search at its beginning: what it does from here on rests on the costs that it is told, and on nothing else."""
    import cma

    # Of its own: whatever draws from NumPy's global generator meanwhile would change the search.
    draw = np.random.RandomState(seed + 1).randn
    options = {"popsize": population, "randn": draw, "seed": math.nan, "verbose": -9, "CMA_diagonal": True}
    return cma.CMAEvolutionStrategy(np.zeros(len(PARAMETERS)), 0.3, options)


def _line(generation: int, costs: list[float], mean: np.ndarray, search: Any) -> dict[str, Any]:  # noqa: ANN401 - cma's
    """The log's line of a generation, from its costs, that of the `mean` last, and the search that was told them."""
    return {
        "generation": generation,
        "cost": costs[-1],
        "best": min(costs[:-1]),
        "sigma": float(search.sigma),
        "shortfall": shortfall(configuration(decode(mean))),
        "parameters": {name: float(f"{value:.4g}") for name, value in decode(search.mean).items()},
        "costs": costs,
    }


def read_log(folder: Path, settings: dict[str, Any]) -> list[dict[str, Any]]:
    """The lines of the search in a folder; none where there is no search (`SpidarError` for one that is not this one).

    Args:
        folder: Folder of the search.
        settings: What it has to have been begun with.
    """
    path, old = folder / LOG, folder / "tune.pickle"
    if old.exists():
        raise SpidarError(
            f"{old} is the state of an earlier version's search, which is not read because it can run code; "
            f"valid: another folder, or this one without it and {LOG}"
        )
    if not path.exists():
        return []
    try:
        data = read_file(path, MOST_BYTES)
        content = parse_json(data)
        require_form(content, FORM, LOG)
        if data != log_text(content["settings"], content["log"]).encode():
            raise BorderError("its checksum is not that of its content")
    except BorderError as error:
        raise SpidarError(f"{path} is damaged ({error}); valid: another folder, or this one without it") from error
    if content["settings"] != settings:
        raise SpidarError(
            f"{path} holds a search with {content['settings']}; valid: the same settings, or another folder"
        )
    return content["log"]


def _replay(search: Any, lines: list[dict[str, Any]], path: Path) -> None:  # noqa: ANN401 - cma's
    """Bring a search to where the one of the log was (`SpidarError` where it does not get there)."""
    for generation, line in enumerate(lines):
        points, mean = search.ask(), search.mean.copy()
        if len(line["costs"]) == len(points) + 1:
            search.tell(points, line["costs"][:-1])
        if len(line["costs"]) != len(points) + 1 or line != _line(generation, line["costs"], mean, search):
            raise SpidarError(
                f"{path}: told its costs, the search does not come to generation {generation} of the log; "
                "valid: the versions of cma and numpy that wrote it, or another folder"
            )


def log_text(settings: dict[str, Any], lines: list[dict[str, Any]]) -> str:
    """The file of a search, with its checksum."""
    content = {"settings": settings, "log": lines}
    digest = hashlib.sha256(json.dumps(content).encode()).hexdigest()
    return json_text({**content, "sha256": digest}) + "\n"


def margin_lines(config: ControllerConfig) -> list[list[str]]:
    """Margins of every loop: the cells of a table."""
    lines = [["axis", "gain margin", "phase margin", "delay margin", "sensitivity"]]
    for axis, name in enumerate(AXES):
        m = margins(config, axis)
        lines.append([name, f"{m.gain:.2f}", f"{m.phase:.2f} rad", f"{1e3 * m.delay:.0f} ms", f"{m.sensitivity:.2f}"])
    return lines
