"""What a row's file may hold: type and range of every field, so that nothing else gets into a table."""

import re
from collections.abc import Mapping
from typing import Any

from spidar_gym.benchmark.metrics import find_odd, told_in
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import SCENARIOS, SPLITS, TRACKS
from spidar_gym.border import BorderError, require_form
from spidar_gym.errors import InvalidValueError, SpidarError, require_name
from spidar_gym.policies.policy import ARGUMENTS, DOC, KINDS, LINE, check_line, check_name
from spidar_gym.robot.description import model_hash

ANEW = "a row evaluated anew by its command"
LONGEST = 1e9
"""Largest time [s or ms] and number of steps that a row may tell."""
FORM = {
    "format": int, "name": str, "kind": str, "doc": str, "policies": [str], "policies_sha256": [str], "given": [str],
    "training": ([(dict, None)], None), "arguments": dict, "command": str, "versions": {str: str}, "processor": str,
    "model_sha256": str,
    "tracks": {str: {"split": str, "scenarios_sha256": str, "scenarios": [int], "runs": [{str: list}]}},
    "timing": {str: {"step_ms_p50_p99": [float, float], "policy_ms_p50_p99": [float, float], "wall_s": float}},
    "sha256": str,
}  # fmt: skip
"""What stands in a row; `arguments` where its policies were learned, `given` since rows say it."""
GIVEN = {"observation": "what the environment shows", "run": "the run's number, as seed", "state": "the whole state"}
"""What a policy may have been given, as a row says: the state only to an allocator or a law of the package's own."""


class RowError(SpidarError):
    """A row's file that cannot be read, was edited by hand, holds what no row does, or belongs to other scenarios."""


def check_content(content: Mapping[str, Any]) -> None:
    """Whether a row has all its parts, each of its type and in its range, of the present robot and scenarios.

    Raises:
        SpidarError: For the first that is not.
    """
    try:
        require_form({"arguments": {}, "given": [], "sha256": "", **content}, FORM, "it")
    except BorderError as error:
        raise RowError(f"{error}; valid: a row that `spidar eval` wrote") from error
    _check_words(content)
    _check_arguments(content.get("arguments", {}))
    if content["model_sha256"] != model_hash():
        raise RowError(f"another robot model; valid: {ANEW}")
    runs = len(content["policies"])
    for name in ("policies_sha256", "training"):
        if content[name] is not None and len(content[name]) != runs:
            raise InvalidValueError(name, content[name], f"{runs}, one a policy")
    for name in ("policies", "tracks"):
        if not content[name]:
            raise InvalidValueError(name, content[name], "at least one")
    for name, track in content["tracks"].items():
        _check_track(name, track, runs)
    if set(content["timing"]) != set(content["tracks"]):
        raise RowError(f"it has not the times of its tracks; valid: those of {', '.join(content['tracks'])}")
    for times in content["timing"].values():
        check_times(times)


def _check_words(content: Mapping[str, Any]) -> None:
    """Whether what a row says of its origin can stand in a table."""
    check_name(content["name"])
    require_name("kind", content["kind"], KINDS)
    for word in content.get("given", []):
        require_name("given", word, GIVEN)
    lines = [
        ("doc", content["doc"], DOC),
        ("processor", content["processor"], DOC),
        ("command", content["command"], LINE),
    ]
    lines += [("policies", spec, LINE) for spec in content["policies"]]
    lines += [("versions", word, DOC) for version in content["versions"].items() for word in version]
    for name, text, most in lines:
        check_line(name, text, most)
    for digest in content["policies_sha256"]:
        if not re.fullmatch("([0-9a-f]{64})?", digest):
            expected = "a SHA-256 in 64 hexadecimal digits, or nothing where there was no file"
            raise InvalidValueError("policies_sha256", digest, expected)
    for entry in filter(None, content["training"] or ()):
        # Shown of it are one line and one number.
        check_line("command of training", entry.get("command", ""))
        _check_number("steps of training", entry.get("steps", 0))


def _check_arguments(arguments: Mapping[str, Any]) -> None:
    for name, choice in arguments.items():
        require_name("argument", name, ARGUMENTS)
        if isinstance(choice, str):
            check_line(name, choice, DOC)
        elif not isinstance(choice, bool | int | float):
            raise InvalidValueError(name, choice, "a word or a number")


def _check_number(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= LONGEST:
        raise InvalidValueError(name, value, f"a number within 0 … {LONGEST:g}")


def check_times(times: Mapping[str, Any]) -> None:
    """Whether they are times: pairs of medians and 99th percentiles, and the whole (`SpidarError` if not)."""
    for name, value in times.items():
        for number in value if isinstance(value, list) else [value]:
            _check_number(name, number)


def _check_track(name: str, track: Mapping[str, Any], runs: int) -> None:
    """Whether a track has a number for each scenario, of each metric and run."""
    require_name("split", track["split"], SPLITS)
    if name not in TRACKS or load_scenarios(name, track["split"])[1] != track["scenarios_sha256"]:
        raise RowError(f"{_plain(name)} has other scenarios; valid: {ANEW}")
    indices = track["scenarios"]
    within = all(0 <= index < SCENARIOS for index in indices)
    if not (within and indices and len(set(indices)) == len(indices)):
        raise RowError(f"{name} has scenarios {indices!s:.80}; valid: different ones within 0 … {SCENARIOS - 1}")
    if len(track["runs"]) != runs:
        raise RowError(f"{name} has {len(track['runs'])} runs; valid: {runs}, one a policy")
    for number, run in enumerate(track["runs"]):
        _check_run(name, number, run, indices)


def _check_run(name: str, number: int, run: Mapping[str, list[Any]], indices: list[int]) -> None:
    """Whether a run has what an episode gives on each scenario."""
    world = TRACKS[name].world
    for metric in told_in(world):
        if metric not in run:
            raise RowError(f"{name} lacks {metric}; valid: {ANEW}")
    for metric, values in run.items():
        if len(values) != len(indices):
            raise RowError(f"{name} has {len(values)} numbers of {_plain(metric)}; valid: {len(indices)}")
    if (found := find_odd(run, world=world)) is not None:
        k, error = found
        raise RowError(f"{name}, run {number}, scenario {indices[k]}: {error}") from error


def _plain(word: str) -> str:
    """A name that is none, as an error may show it."""
    return ascii(word)[1:-1][:40]
