"""What identification leaves to a search: controllers tuned on identified robots, beside those tuned on the true ones.

The robots are those of the study hidden, after its parameters are opened. A true robot is described by the same file as
an identified one, with intervals as narrow as the file allows. All controllers fly the true robot in new scenarios.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.errors import SpidarError
from spidar_gym.files import output_folder, write_text
from spidar_gym.identify.estimate import Estimate
from spidar_gym.identify.hovers import Hovers
from spidar_gym.identify.robot_file import Identified, robot_text
from spidar_gym.identify.servos import Servos
from spidar_gym.robot import N_JOINTS, N_ROTORS
from spidar_gym.sim.config import PlantConfig
from spidar_gym.studies.hidden import robot_of, sealed_robots, truth_of
from spidar_gym.tune.search import (
    Candidate,
    candidates,
    cost,
    draw_scenarios,
    find_search,
    pieces,
    play_candidate,
    tune,
)

SEARCH = "steady"
"""Search whose controllers are compared."""
SEARCHES = (("identified", 0), ("true", 0), ("true, again", 1))
"""Robots of each search, and the seed of its scenarios."""
FRESH = (1000, 2)
"""Generation and seed of the scenarios of the comparison, which no search has."""
UNKNOWN = 1e6
"""Deviation before the log of numbers that count as told."""


def true_text(config: PlantConfig) -> str:
    """Return the file of a robot that is known exactly, with what `spidar identify` can tell."""

    def exact(value: np.ndarray | float) -> Estimate:
        values = np.array(value, float)
        return Estimate(values, np.zeros_like(values), np.full_like(values, UNKNOWN))

    truth = truth_of(config)
    gain, lag = truth["gain_over_mass"] * config.body.total_mass, truth["lag"]
    untold = Estimate(np.zeros(1), np.full(1, UNKNOWN), np.full(1, UNKNOWN))
    nothing = np.zeros(N_JOINTS)
    servos = Servos(
        exact(truth["delay"][0]), *(exact(truth[name]) for name in ("damping", "friction", "stiffness", "speed")),
        lost=config.actuators.loss, misfit=1.0, ahead=nothing, described=nothing,
    )  # fmt: skip
    hovers = Hovers(
        exact(gain), exact(gain.mean()), exact(lag), exact(lag.mean()), untold, untold, untold, untold,
        forms=np.zeros((1, N_JOINTS)), hovers=0, slow=np.zeros(6), slow_time=np.zeros(6),
    )  # fmt: skip
    assert gain.shape == (N_ROTORS,)
    return robot_text(Identified(exact(config.body.total_mass), servos, hovers))


def steps_of(robots: int, generations: int) -> int:
    """Return the number of calls of `on_step` in `searches`."""
    population = candidates(SEARCH, None)
    return robots * len(SEARCHES) * sum(pieces(SEARCH, population, k) for k in range(generations))


def searches(
    folder: Path, robots: int, *, generations: int, scenarios: int, workers: int,
    on_step: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Search and compare, or resume; returns a row for each robot and search, with its cost on the true robot.

    The row `start` is the controller with which all searches begin.

    Args:
        folder: Folder of the study hidden, with its reports.
        robots: Number of its robots, from the first.
        generations: Generations of each search.
        scenarios: Scenarios per track.
        workers: Number of processes.
        on_step: Called after each simulated candidate and track.
    """
    sealed, found = sealed_robots(folder), []
    if len(sealed) < robots:
        raise SpidarError(f"{folder} has {len(sealed)} robots; valid: --robots 1 … {len(sealed)}")
    search = find_search(SEARCH)
    start = {each.name: each.start for each in search.parameters}
    for k, row in enumerate(sealed[:robots]):
        own = output_folder(folder / "searches" / f"{k:02}")
        true = own / "true.toml"
        write_text(true, true_text(robot_of(row)))
        files = {"identified": folder / "reports" / f"{k:02}" / "robot.toml"}
        for name, seed in SEARCHES:
            last = tune(
                SEARCH, own / f"{name.split(',')[0]}-{seed}", generations=generations,
                population=candidates(SEARCH, None), scenarios=scenarios, seed=seed, workers=workers,
                robots=str(files.get(name, true)), on_piece=on_step,
            )  # fmt: skip
            found.append(_row(k, row, name, last["parameters"], true, scenarios))
        found.append(_row(k, row, "start", start, true, scenarios))
    return found


def _row(
    k: int, row: dict[str, Any], name: str, values: dict[str, float], true: Path, scenarios: int
) -> dict[str, Any]:  # fmt: skip
    """Fly a controller with the true robot; return its row."""
    errors = {}
    for track, drawn in draw_scenarios(SEARCH, FRESH[0], FRESH[1], 2 * scenarios, str(true)).items():
        errors[track] = float(np.mean(play_candidate(Candidate(SEARCH, values, track, drawn))["errors"]))
    lack = play_candidate(Candidate(SEARCH, values, "", robots=str(true)))["shortfall"]
    kind = row["robots"].partition(":")[2]
    return {"robot": k, "kind": kind, "search": name, "cost": cost(errors, lack), "shortfall": lack, "errors": errors}


def search_lines(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Return the table: errors over those of the start, geometric means over the tracks, margins included."""
    names = [name for name, _ in SEARCHES]
    lines = [["robot", "kind", *(f"tuned on the {name}" for name in names), "identified over true", "true, twice"]]
    for k in dict.fromkeys(row["robot"] for row in rows):
        costs = {row["search"]: row["cost"] for row in rows if row["robot"] == k}
        kind = next(row["kind"] for row in rows if row["robot"] == k)
        shares = [math.exp(costs[name] - costs["start"]) for name in names]
        both = [costs[name] for name in names[1:]]
        lost = math.exp(costs[names[0]] - sum(both) / len(both)) - 1.0
        spread = math.exp(abs(both[1] - both[0])) - 1.0
        lines.append([f"{k}", kind, *(f"{share:.3f}" for share in shares), f"{lost:+.1%}", f"± {spread:.1%}"])
    return lines
