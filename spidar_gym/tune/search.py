"""`spidar tune`: search over a controller's parameters, with the benchmark's errors on separate scenarios as cost."""

import hashlib
import importlib.util
import json
import math
import shutil
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.resume import finish
from spidar_gym.benchmark.scenario import Scenario, draw_scenario_from, robot_scenarios
from spidar_gym.benchmark.track import CALIBRATED, CAP, FLIGHT, GROUND, REST_S, TRACKS, WORLD
from spidar_gym.border import BorderError, parse_json, read_file, require_form
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.flight.controller import CONTROL_RATE, ControllerConfig
from spidar_gym.control.flight.margins import Margins
from spidar_gym.control.presets import STEADY_CRAWL, TUNED_V1
from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError, require_least, require_name
from spidar_gym.files import json_text, write_text
from spidar_gym.margins import flight_law, flight_mode, legs_shortfall
from spidar_gym.policies.presets import OwnController
from spidar_gym.policies.source import load_module, module_of
from spidar_gym.sim.randomize import Randomization
from spidar_gym.sim.worlds import World
from spidar_gym.tune import crawl, flight
from spidar_gym.tune.evolution import Cma, Evolution, Pattern, better
from spidar_gym.tune.parameter import Parameter, decode

DRAWS = 2
"""Number of the split in the scenarios' seeds, which no split of the benchmark has (0 is test, 1 validation)."""
POPULATION = 12
"""Default number of candidates per generation."""
MARGIN_COST = 10.0
"""Cost of a margin whose relative shortfall is 1."""
STEP = 0.15
"""First step of a search, in halves of the parameters' ranges."""

MOST_BYTES = 2**26
"""Largest size of a log [bytes]."""
FORM = {
    "settings": {"search": str, "population": int, "scenarios": int, "seed": int},
    "log": [
        {
            "generation": int, "cost": float, "reference": float, "best": float, "sigma": float, "shortfall": float,
            "ticks": int, "parameters": {str: float}, "costs": [float], "errors": {str: float},
        }
    ],
    "sha256": str,
}  # fmt: skip
"""Structure of a log; a search with other robots has the digest of their file in its settings too."""


@dataclass(frozen=True)
class Search:
    """Definition of a search: its parameters, tracks and algorithm."""

    name: str
    """Name of its log."""
    group: str
    """Group of tracks."""
    reference: str
    """Preset that is evaluated beside every generation."""
    parameters: tuple[Parameter, ...]
    """Tuned parameters."""
    arguments: Callable[[dict[str, float]], dict[str, Any]]
    """Parameters → arguments of `gym.make`; raises `InvalidValueError` for an invalid controller."""
    loops: Callable[[dict[str, float]], Sequence[Margins]] | None = None
    """Parameters → margins of the loops; None where no margins are defined, as for a gait."""
    unsuccessful: float = 0.0
    """Added to the error of an unsuccessful episode."""
    by_pattern: bool = False
    """Whether the search is a `Pattern` on the same scenarios in all generations, for starts near a good controller,
    instead of CMA-ES on new scenarios in each."""
    settle: Callable[[dict[str, float]], dict[str, float]] = dict
    """Parameters → these and those derived from them, which are passed to `arguments` and `loops`."""
    legs: str = ""
    """Calibrated world over whose robots the margins with legs that bend are held; none if empty."""
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Further tracks of the search: name → options that replace those of the group's only track."""
    durations: Mapping[str, float] = field(default_factory=dict)
    """Longest durations of successful episodes on some tracks [s]; the share of time beyond adds to the error."""
    also: tuple[str, ...] = ()
    """Tracks of other groups on which candidates are evaluated too."""

    @property
    def tracks(self) -> tuple[str, ...]:
        """Tracks on which candidates are evaluated."""
        return (*(name for name, track in TRACKS.items() if track.group == self.group), *self.also, *self.options)

    def track(self, name: str) -> str:
        """Return the track of the benchmark of one of `tracks`."""
        return self.tracks[0] if name in self.options else name

    def shortfall(self, values: dict[str, float], robots: str = "") -> float:
        """Return the shortfall of the margins, those with legs that bend over `robots` if given."""
        rigid = 0.0 if self.loops is None else flight.shortfall(self.loops(values))
        if not self.legs:
            return rigid
        arguments = self.arguments(values)
        return rigid + legs_shortfall(flight_law(arguments), robots or self.legs, flight_mode(arguments))


def flight_search(
    name: str,
    start: ControllerConfig,
    *,
    reference: str = "tuned",
    names: Sequence[str] = flight.NAMES,
    by_pattern: bool = False,
    **fixed: Any,  # noqa: ANN401 - whatever `gym.make` takes
) -> Search:
    """Define a search for a flight controller's numbers, subject to stability margins.

    Args:
        name: Name of its log.
        start: Start of the search, and the values of all numbers that are not tuned.
        reference: Preset that is evaluated beside every generation.
        names: Compensations to tune, from `flight.BOUNDS` and `flight.MORE_BOUNDS`.
        by_pattern: As in `Search`; each axis is then as stiff as the margins allow, and its damping is tuned.
        **fixed: Further arguments of `gym.make`.
    """
    configuration = partial(flight.configuration, start=start)
    return Search(
        name, "flight", reference, flight.parameters(start, names, stiffness=not by_pattern),
        lambda values: {"controller": configuration(values), **fixed},
        lambda values: flight.loops(configuration(values)), by_pattern=by_pattern,
        settle=partial(flight.at_the_edge, start=start) if by_pattern else dict,
    )  # fmt: skip


def steady_search(
    name: str, start: ControllerConfig, *, names: Sequence[str] = flight.STEADY_NAMES, **fixed: Any,  # noqa: ANN401 - as above
) -> Search:  # fmt: skip
    """Define a pattern search for a flight controller's numbers on robots of the calibrated world.

    The margins that are held know legs that bend, over the same robots. The cost includes two nominal tracks, with the
    largest differences between controllers.

    Args:
        name: Name of its log.
        start: As in `flight_search`.
        names: As in `flight_search`.
        **fixed: Further arguments of `gym.make`.
    """
    configuration = partial(flight.configuration, start=start)
    return Search(
        name, CALIBRATED[FLIGHT], "tuned_v1", flight.parameters(start, names),
        lambda values: {"controller": configuration(values), **fixed}, by_pattern=True, legs=WORLD,
        also=flight.NOMINAL_TRACKS,
    )  # fmt: skip


def ground_search(
    name: str, start: CrawlerConfig, *, reference: str = "robust_overlapped", by_pattern: bool = False,
    group: str = "ground", options: Mapping[str, Mapping[str, Any]] | None = None,
    durations: Mapping[str, float] | None = None, **wider: tuple[float, float],
) -> Search:  # fmt: skip
    """Define a search for a crawler's numbers.

    Args:
        name: Name of its log.
        start: Start of the search, and the values of all numbers that are not tuned.
        reference: Preset that is evaluated beside every generation.
        by_pattern: As in `Search`.
        group: As in `Search`.
        options: As in `Search`.
        durations: As in `Search`.
        **wider: Bounds that replace the default ones.
    """
    configuration = partial(crawl.configuration, start=start)
    return Search(
        name, group, reference, crawl.parameters(start, **wider),
        lambda values: {"controller": configuration(values)}, unsuccessful=crawl.UNSUCCESSFUL,
        by_pattern=by_pattern, options=options or {}, durations=durations or {},
    )  # fmt: skip


SEARCHES: dict[str, Search] = {
    "flight": flight_search("flight", TUNED_V1, reference=flight.REFERENCE),
    "retuned": flight_search("retuned", flight.RETUNED_START, names=flight.RETUNED_NAMES, by_pattern=True),
    "steady": steady_search("steady", flight.STEADY_START),
    "crawl": ground_search("crawl", crawl.START, reference=crawl.REFERENCE),
    "recrawl": ground_search("recrawl", crawl.RESTART, by_pattern=True, torque_limit=(3.0, 7.0)),
    "steady_crawl": ground_search(
        "steady_crawl",
        STEADY_CRAWL,
        reference="robust_retuned",
        by_pattern=True,
        group=CALIBRATED[GROUND],
        options={"the paper's way at 0.8 rad/s": crawl.FAST_WAY},
        durations={"the paper's way at 0.8 rad/s": crawl.FAST_TIME},
        torque_limit=(3.0, 7.0),
    ),
}
"""Built-in searches by name; a custom one is given as `module:NAME`."""


def find_search(name: str) -> Search:
    """Return a built-in search by its name, or a custom one by `module:NAME`.

    Raises:
        UnknownNameError: For an unknown name; lists the built-in searches.
        InvalidValueError: For a module that cannot be imported or does not contain the search.
    """
    if ":" not in name:
        require_name("search", name, [*SEARCHES, "module:NAME"])
        return SEARCHES[name]
    wanted = f"one of {', '.join(SEARCHES)}, or module:NAME of a `Search`, importable"
    try:
        module, own = module_of(name)
        found = getattr(load_module(module), own, None)
    except SpidarError as error:  # its message is about policies
        raise InvalidValueError("search", name, wanted) from error
    if not isinstance(found, Search):
        raise InvalidValueError("search", name, wanted)
    return found


@dataclass(frozen=True)
class Candidate:
    """A controller and the scenarios of one track: the smallest job of a search."""

    search: str
    """Name of the search."""
    values: Mapping[str, float] | None
    """The controller's parameters; None for the reference preset."""
    track: str
    """Name of the track; empty for the margins."""
    scenarios: tuple[Scenario, ...] = ()
    """Scenarios to run."""
    robots: str = ""
    """World whose robots replace those of the search; none if empty."""


def play_candidate(candidate: Candidate) -> dict[str, Any]:
    """Run a candidate; return the `errors` of its scenarios, with `unsuccessful` added, and the simulated `ticks`.

    Without a track, return the `shortfall` of its margins.
    """
    search = find_search(candidate.search)
    if not candidate.track:
        return {"shortfall": _shortfall(search, candidate.values, candidate.robots)}
    if candidate.values is None:
        arguments: dict[str, Any] = {"preset": search.reference}
    else:
        try:
            arguments = search.arguments(dict(candidate.values))
        except InvalidValueError:
            return {"errors": [CAP] * len(candidate.scenarios), "ticks": 0}
    played = play(OwnController(arguments), search.track(candidate.track), candidate.scenarios)
    seconds = [one["metrics"]["duration_s"] or 0.0 for one in played]  # None where the simulation diverged
    wanted = search.durations.get(candidate.track, math.inf)
    late = [max(0.0, (own - REST_S) / wanted - 1.0) for own in seconds]
    errors = [
        one["metrics"]["error"] + share + search.unsuccessful * (share > 0.0 or not one["metrics"]["success"])
        for one, share in zip(played, late, strict=True)
    ]
    return {"errors": errors, "ticks": round(sum(seconds) * CONTROL_RATE)}


def draw_scenarios(
    name: str, generation: int, seed: int, count: int, robots: str = ""
) -> dict[str, tuple[Scenario, ...]]:  # fmt: skip
    """Sample the scenarios of a generation, which all its candidates share; return track → scenarios.

    With `robots`, a calibrated world, its robots replace those of the calibrated tracks.
    """
    found, search = {}, find_search(name)
    for track in search.tracks:
        rngs = (
            np.random.Generator(np.random.PCG64([zlib.crc32(track.encode()), DRAWS, seed, generation, k]))
            for k in range(count)
        )
        own = search.track(track)
        if robots and TRACKS[own].is_calibrated:
            drawn = iter(robot_scenarios(own, robots, rngs))
        else:
            drawn = (draw_scenario_from(TRACKS[own], rng, k) for k, rng in enumerate(rngs))
        more = search.options.get(track, {})
        found[track] = tuple(replace(one, options={**one.options, **more}) for one in drawn)
    return found


def cost(errors: Mapping[str, float], shortfall: float) -> float:
    """Compute the cost of a controller: mean over the tracks of log(mean error), plus the cost of its margins.

    The first term is the logarithm of the geometric mean over tracks, on which the leaderboard's score is based.
    """
    return float(np.mean(np.log(list(errors.values())))) + MARGIN_COST * shortfall


def check_search(name: str, *, generations: int, population: int, scenarios: int, seed: int, workers: int) -> None:
    """Raise an error for settings with which a search cannot run."""
    if not find_search(name).by_pattern and importlib.util.find_spec("cma") is None:
        raise MissingDependencyError("cma", "pip install 'spidar-gym[tune]'")
    require_least(1, generations=generations, scenarios=scenarios, workers=workers)
    require_least(2, population=population)
    require_least(0, seed=seed)


def _world_of(robots: str) -> World:
    """Return a calibrated world by name or file (`InvalidValueError` for another randomisation)."""
    found = Randomization.parse(robots)
    if found.world is None or found.ranges:
        raise InvalidValueError("robots", robots, "the name or file of a calibrated world, or of an identified robot")
    return found.world


def _require_calibrated(name: str, robots: str) -> None:
    """Require a search on calibrated tracks for other robots (`InvalidValueError`)."""
    search = find_search(name)
    if not any(TRACKS[search.track(track)].is_calibrated for track in search.tracks):
        own = [other for other, each in SEARCHES.items() if each.group in CALIBRATED.values()]
        raise InvalidValueError("robots", robots, f"none for {name}; with robots, a search of {', '.join(own)}")
    _world_of(robots)


def candidates(name: str, population: int | None) -> int:
    """Return the number of candidates per generation of a search: the given one, or the default.

    Raises:
        InvalidValueError: For a pattern search with a number other than two.
    """
    by_pattern = find_search(name).by_pattern
    if population is None:
        return 2 if by_pattern else POPULATION
    if by_pattern and population != 2:
        raise InvalidValueError("population", population, "2 for a pattern search: a step to either side")
    return population


def pieces(name: str, population: int, generation: int = 0) -> int:
    """Return the number of jobs of a generation: candidates, the mean and the reference, on every track, and margins.

    A pattern search evaluates the mean and the reference in its first generation only.
    """
    search = find_search(name)
    known = 2 if search.by_pattern and generation > 0 else 0
    return (population + 2 - known) * (len(search.tracks) + 1)


def tune(
    name: str,
    folder: Path,
    *,
    generations: int,
    population: int,
    scenarios: int,
    seed: int,
    workers: int,
    robots: str = "",
    on_piece: Callable[[], object] = lambda: None,
    on_generation: Callable[[dict[str, Any]], object] = lambda _: None,
) -> dict[str, Any]:
    """Run a search, or resume the one in `folder`.

    Args:
        name: One of `SEARCHES`, or `module:NAME`.
        folder: Folder of the log, which is written after every generation and determines the state of the search, and
            of the results of an unfinished generation.
        generations: Total number of generations.
        population: Number of candidates per generation.
        scenarios: Number of scenarios per track and candidate.
        seed: Seed of the search; settings that differ from those of an unfinished search are refused.
        workers: Number of processes.
        robots: File of a calibrated world or of an identified robot, whose robots replace those of the calibrated
            tracks and of the margins.
        on_piece: Called after every job.
        on_generation: Called with the first entries of each line of the log.

    Returns:
        The last line of the log: the mean of the search distribution, its cost, errors and margins.
    """
    check_search(
        name, generations=generations, population=population, scenarios=scenarios, seed=seed, workers=workers
    )  # fmt: skip
    if robots:
        _require_calibrated(name, robots)
    settings = {"search": name, "population": population, "scenarios": scenarios, "seed": seed}
    settings |= {"robots": _world_of(robots).digest} if robots else {}
    path, unfinished = folder / log_name(name), folder / f"{find_search(name).name}-unfinished"
    search, lines = find_search(name), read_log(path, settings)
    evolution = _evolution(search, population, seed)
    _replay(name, evolution, lines, path)
    for _ in range(sum(pieces(name, population, k) for k in range(len(lines)))):
        on_piece()
    for generation in range(len(lines), generations):
        if not evolution.sigma:  # the search has ended, perhaps in an earlier call
            break
        points, mean = evolution.ask(), evolution.mean.copy()
        values: list[dict[str, float] | None] = [search.settle(decode(search.parameters, x)) for x in points]
        knows = search.by_pattern and generation > 0
        # The mean of the distribution is evaluated too: it is the solution, so the log must contain its cost.
        values += [] if knows else [search.settle(decode(search.parameters, mean)), None]
        drawn = draw_scenarios(name, 0 if search.by_pattern else generation, seed, scenarios, robots)
        jobs = [Candidate(name, own, track, drawn[track]) for own in values for track in drawn]
        jobs += [Candidate(name, own, "", robots=robots) for own in values]
        found = finish(play_candidate, jobs, workers=workers, folder=unfinished, on_done=lambda *_: on_piece())
        played, margins = found[: -len(values)], [one["shortfall"] for one in found[-len(values) :]]
        means = np.array([np.mean(one["errors"]) for one in played]).reshape(len(values), len(drawn))
        errors = [dict(zip(drawn, row.tolist(), strict=True)) for row in means]
        costs = [cost(own, lack) for own, lack in zip(errors, margins, strict=True)]
        if knows:
            errors.append(lines[-1]["errors"])
            costs += [lines[-1]["cost"], lines[-1]["reference"]]
        evolution.tell(points, costs[:-1])
        ticks, told = sum(one["ticks"] for one in played), errors[_answer(search, costs)]
        kept = _told(search, mean, evolution)
        lack = next((lack for own, lack in zip(values, margins, strict=True) if own == kept), None)
        if lack is None:  # a pattern search's point of an earlier generation
            lack = lines[-1]["shortfall"] if search.legs else _shortfall(search, kept, robots)
        lines.append(_line(name, generation, costs, told, ticks, evolution, lack))
        write_text(path, log_text(settings, lines))
        shutil.rmtree(unfinished, ignore_errors=True)
        on_generation({name: lines[-1][name] for name in ("generation", "cost", "reference", "best", "sigma")})
    return lines[-1]


def _told(search: Search, mean: np.ndarray, evolution: Evolution) -> dict[str, float]:
    """Return the parameters whose errors are in a line of the log, after the search's update."""
    if search.by_pattern:
        return search.settle(decode(search.parameters, evolution.mean))
    return decode(search.parameters, mean)


def _answer(search: Search, costs: Sequence[float]) -> int:
    """Return the index of the cost in a line of the log: the evaluated mean, or a pattern search's point afterwards."""
    return better(costs[:-1]) if search.by_pattern else len(costs) - 2


def log_name(name: str) -> str:
    """Return the file name of a search's log."""
    return f"{find_search(name).name}.json"


def _shortfall(search: Search, values: Mapping[str, float] | None, robots: str = "") -> float:
    """Return the shortfall of the margins of parameters; 0 for the reference."""
    try:
        return 0.0 if values is None else search.shortfall(dict(values), robots)
    except InvalidValueError:
        return 0.0  # its errors are `CAP`


def _evolution(search: Search, population: int, seed: int) -> Evolution:
    """Build the algorithm of a search in its initial state; later states depend on the costs only."""
    size = len(search.parameters)
    return Pattern(size, STEP) if search.by_pattern else Cma(size, STEP, population, seed)


def _line(
    name: str, generation: int, costs: list[float], errors: dict[str, float], ticks: int, evolution: Evolution,
    shortfall: float,
) -> dict[str, Any]:  # fmt: skip
    """Build the log's line of a generation from its costs (mean and reference last), after the search's update."""
    search, answer = find_search(name), _answer(find_search(name), costs)
    settled = search.settle(decode(search.parameters, evolution.mean))
    return {
        "generation": generation,
        "cost": costs[answer],
        "reference": costs[-1],
        "best": min(costs[:-2]),
        "sigma": float(evolution.sigma),
        "shortfall": shortfall,
        "ticks": ticks,
        "parameters": {key: float(f"{value:.4g}") for key, value in settled.items()},
        "costs": costs,
        "errors": errors,
    }


def read_log(path: Path, settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Read the lines of a search's log; none where there is no file (`SpidarError` for the log of another search).

    Args:
        path: File of the log.
        settings: Settings that the log must have.
    """
    if not path.exists():
        return []
    try:
        data = read_file(path, MOST_BYTES)
        content = parse_json(data)
        own = {"robots": str} if "robots" in settings else {}
        require_form(content, {**FORM, "settings": FORM["settings"] | own}, path.name)
        if data != log_text(content["settings"], content["log"]).encode():
            raise BorderError("its checksum is not that of its content")
    except BorderError as error:
        raise SpidarError(f"{path} is damaged ({error}); valid: another folder, or this one without it") from error
    if content["settings"] != settings:
        raise SpidarError(
            f"{path} holds a search with {content['settings']}; valid: the same settings, or another folder"
        )
    return content["log"]


def found_controller(path: Path) -> ControllerConfig:
    """Return the flight controller that a search has found, from its log.

    Raises:
        SpidarError: For a file that is no whole log of a search, or of one for a crawler.
    """
    try:
        content = parse_json(read_file(path, MOST_BYTES))
        require_form(content, {**FORM, "settings": dict}, path.name)
        if not content["log"] or content["sha256"] != _digest(content["settings"], content["log"]):
            raise BorderError("its checksum is not that of its content")
        require_form(content["settings"].get("search"), str, "search")
    except BorderError as error:
        raise SpidarError(f"{path} is no log of a search: {error}; valid: a file that `spidar tune` wrote") from error
    found = find_search(content["settings"]["search"]).arguments(content["log"][-1]["parameters"]).get("controller")
    if not isinstance(found, ControllerConfig):
        raise SpidarError(f"{path} is the search for a crawler; valid: one for a flight controller, such as steady")
    return found


def _replay(name: str, evolution: Evolution, lines: list[dict[str, Any]], path: Path) -> None:
    """Replay the log's costs to restore a search's state (`SpidarError` where the states differ)."""
    search = find_search(name)
    for generation, line in enumerate(lines):
        points, mean = evolution.ask(), evolution.mean.copy()
        fits = len(line["costs"]) == len(points) + 2
        if fits:
            evolution.tell(points, line["costs"][:-1])
        # Margins with legs take seconds, so they are not computed again.
        lack = line["shortfall"] if search.legs else _shortfall(search, _told(search, mean, evolution))
        if not fits or line != _line(name, generation, line["costs"], line["errors"], line["ticks"], evolution, lack):
            raise SpidarError(
                f"{path}: with the log's costs, the search does not reproduce generation {generation} of the log; "
                "valid: the versions of cma and numpy that wrote it, or another folder"
            )


def log_text(settings: dict[str, Any], lines: list[dict[str, Any]]) -> str:
    """Format the log of a search, with its checksum."""
    return json_text({"settings": settings, "log": lines, "sha256": _digest(settings, lines)}) + "\n"


def _digest(settings: dict[str, Any], lines: list[dict[str, Any]]) -> str:
    """Return the checksum of the log of a search."""
    return hashlib.sha256(json.dumps({"settings": settings, "log": lines}).encode()).hexdigest()
