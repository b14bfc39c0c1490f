"""What a row's file may hold: type and range of every field, so that nothing else gets into a table."""

import re
from collections.abc import Callable, Mapping
from typing import Any

from spidar_gym.benchmark.metrics import METRICS, check_metrics
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import SCENARIOS, SPLITS, TRACKS
from spidar_gym.errors import InvalidValueError, SpidarError, require_name
from spidar_gym.policies.policy import ARGUMENTS, DOC, KINDS, check_line, check_name
from spidar_gym.robot.description import model_hash

ANEW = "a row evaluated anew by its command"
LONGEST = 1e9
"""Largest time [s or ms] and number of steps that a row may tell."""


class RowError(SpidarError):
    """A row's file that cannot be read, was edited by hand, holds what no row does, or belongs to other scenarios."""


def check_content(content: Mapping[str, Any]) -> None:
    """Whether a row has all its parts, each of its type and in its range, of the present robot and scenarios.

    Raises:
        SpidarError: For the first that is not.
    """
    needed = {*_FIELDS, "format", "tracks", "timing"}
    missing, more = needed - set(content), set(content) - needed - {"sha256", "arguments"}
    if missing or more:
        odd = "lacks " + ", ".join(sorted(missing)) if missing else f"has fields besides a row's ({len(more)})"
        raise RowError(f"it {odd}; valid: a row that `spidar eval` wrote")
    for name, check in _FIELDS.items():
        check(name, content[name])
    _arguments(content.get("arguments", {}))
    if content["model_sha256"] != model_hash():
        raise RowError(f"another robot model; valid: {ANEW}")
    runs = len(content["policies"])
    for name in ("policies_sha256", "training"):
        if content[name] is not None and len(content[name]) != runs:
            raise InvalidValueError(name, content[name], f"{runs}, one a policy")
    tracks = _object("tracks", content["tracks"])
    if not tracks:
        raise InvalidValueError("tracks", tracks, "at least one")
    for name, track in tracks.items():
        _track(name, _object("track", track), runs)
    _timing(content["timing"], tracks)


def _object(name: str, value: object, keys: set[str] | None = None) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InvalidValueError(name, value, "an object")
    if keys is not None and set(value) != keys:
        odd = ", ".join(map(_plain, sorted(set(value) ^ keys)[:5]))
        raise RowError(f"{name} lacks fields or has others ({odd}); valid: {', '.join(sorted(keys))}")
    return value


def _plain(word: str) -> str:
    """A name that is none, as an error may show it."""
    return ascii(word)[1:-1][:40]


def _list(name: str, value: object) -> list[Any]:
    if not isinstance(value, list):
        raise InvalidValueError(name, value, "a list")
    return value


def _number(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= LONGEST:
        raise InvalidValueError(name, value, f"a number within 0 … {LONGEST:g}")


def _digest(name: str, value: object) -> None:
    if not (isinstance(value, str) and re.fullmatch("([0-9a-f]{64})?", value)):
        raise InvalidValueError(name, value, "a SHA-256 in 64 hexadecimal digits, or nothing where there was no file")


def _policies(name: str, value: object) -> None:
    if not _list(name, value):
        raise InvalidValueError(name, value, "at least one")
    for spec in _list(name, value):
        check_line(name, spec)


def _versions(name: str, value: object) -> None:
    for package, number in _object(name, value).items():
        check_line(name, package, DOC)
        check_line(f"{name}: {package}", number, DOC)


def _training(name: str, value: object) -> None:
    """Refuse trainings other than nothing or an object for each run; shown of it are one line and one number."""
    for entry in _list(name, [] if value is None else value):
        shown = _object(name, {} if entry is None else entry)
        check_line(f"command of {name}", shown.get("command", ""))
        _number(f"steps of {name}", shown.get("steps", 0))


def _arguments(value: object) -> None:
    for name, choice in _object("arguments", value).items():
        require_name("argument", name, ARGUMENTS)
        if isinstance(choice, str):
            check_line(name, choice, DOC)
        elif not isinstance(choice, bool | int | float):
            raise InvalidValueError(name, choice, "a word or a number")


def _digests(name: str, value: object) -> None:
    for digest in _list(name, value):
        _digest(name, digest)


_FIELDS: dict[str, Callable[[str, Any], object]] = {
    "name": lambda _, value: check_name(value),
    "kind": lambda name, value: require_name(name, value, KINDS),
    "doc": lambda name, value: check_line(name, value, DOC),
    "policies": _policies,
    "policies_sha256": _digests,
    "training": _training,
    "command": check_line,
    "versions": _versions,
    "processor": lambda name, value: check_line(name, value, DOC),
    "model_sha256": _digest,
}
"""What a row says of its origin: field → check."""


def _track(name: str, track: Mapping[str, Any], runs: int) -> None:
    """Whether a track has a number for each scenario, of each metric and run."""
    _object(_plain(name), track, {"split", "scenarios_sha256", "scenarios", "runs"})
    require_name("split", track["split"], SPLITS)
    if name not in TRACKS or load_scenarios(name, track["split"])[1] != track["scenarios_sha256"]:
        raise RowError(f"{_plain(name)} has other scenarios; valid: {ANEW}")
    indices = _list("scenarios", track["scenarios"])
    whole = all(type(index) is int and 0 <= index < SCENARIOS for index in indices)
    if not (whole and indices and len(set(indices)) == len(indices)):
        raise RowError(f"{name} has scenarios {indices!s:.80}; valid: different ones within 0 … {SCENARIOS - 1}")
    if len(_list("runs", track["runs"])) != runs:
        raise RowError(f"{name} has {len(track['runs'])} runs; valid: {runs}, one a policy")
    for number, run in enumerate(track["runs"]):
        _run(name, number, _object("run", run), indices)


def _run(name: str, number: int, run: Mapping[str, Any], indices: list[int]) -> None:
    """Whether a run has what an episode gives on each scenario."""
    for metric in METRICS:
        if metric not in run:
            raise RowError(f"{name} lacks {metric}; valid: {ANEW}")
    for metric, values in run.items():
        if len(_list(metric, values)) != len(indices):
            raise RowError(f"{name} has {len(values)} numbers of {_plain(metric)}; valid: {len(indices)}")
    for k, index in enumerate(indices):
        try:
            check_metrics({metric: values[k] for metric, values in run.items()}, flies=TRACKS[name].flies)
        except InvalidValueError as error:
            raise RowError(f"{name}, run {number}, scenario {index}: {error}") from error


def _timing(timing: object, tracks: Mapping[str, Any]) -> None:
    """Whether there are times of every track."""
    for times in _object("timing", timing, set(tracks)).values():
        check_times(times, "step_ms_p50_p99", "policy_ms_p50_p99")


def check_times(times: object, *pairs: str) -> None:
    """Whether it is the whole time and these pairs of medians and 99th percentiles (`SpidarError` if not)."""
    found = _object("timing", times, {*pairs, "wall_s"})
    _number("wall_s", found["wall_s"])
    for name in pairs:
        if len(_list(name, found[name])) != 2:
            raise InvalidValueError(name, found[name], "two numbers")
        for number in found[name]:
            _number(name, number)
