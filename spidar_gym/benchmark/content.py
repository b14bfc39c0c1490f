"""Validation of a row's file: type and range of every field, before any of it enters a table."""

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

ANEW = "a row evaluated again with its command"
LONGEST = 1e9
"""Largest time [s or ms] and number of steps in a row."""
FORM = {
    "format": int, "name": str, "kind": str, "doc": str, "policies": [str], "policies_sha256": [str], "given": [str],
    "training": ([(dict, None)], None), "arguments": dict, "command": str, "versions": {str: str}, "processor": str,
    "model_sha256": str,
    "tracks": {
        str: {
            "split": str, "scenarios_sha256": str, "scenarios": [int], "world": ({"name": str, "sha256": str}, None),
            "runs": [{str: list}],
        }
    },
    "timing": {str: {"step_ms_p50_p99": [float, float], "policy_ms_p50_p99": [float, float], "wall_s": float}},
    "sha256": str,
}  # fmt: skip
"""Fields of a row; `arguments` only of learned policies, `given` not in the oldest rows, `world` only of
calibrated tracks."""
GIVEN = {"observation": "the environment's observation", "run": "the run's number, as seed", "state": "the whole state"}
"""Inputs of a policy as recorded in a row; only the package's allocators and control laws receive `state`."""


class RowError(SpidarError):
    """Row that cannot be read, was edited by hand, has invalid content, or belongs to other scenarios."""


def check_content(content: Mapping[str, Any]) -> None:
    """Check that a row has all fields with valid types and ranges, and matches the current robot model and scenarios.

    Raises:
        SpidarError: For the first invalid field.
    """
    try:
        require_form({"arguments": {}, "given": [], "sha256": "", **_with_worlds(content)}, FORM, "it")
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
        raise RowError(f"timing is not of the row's tracks; valid: times of {', '.join(content['tracks'])}")
    for times in content["timing"].values():
        check_times(times)


def _with_worlds(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the content with the field `world` in every track."""
    tracks = content.get("tracks")
    if not isinstance(tracks, Mapping):
        return content
    every = {name: {"world": None, **own} if isinstance(own, Mapping) else own for name, own in tracks.items()}
    return {**content, "tracks": every}


def _check_words(content: Mapping[str, Any]) -> None:
    """Check the fields of a row's origin, which are shown in tables."""
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
        if digest and not _is_sha256(digest):
            expected = "a SHA-256 in 64 hexadecimal digits, or nothing where there was no file"
            raise InvalidValueError("policies_sha256", digest, expected)
    for entry in filter(None, content["training"] or ()):
        # Tables show these two entries only.
        check_line("command of training", entry.get("command", ""))
        _check_number("steps of training", entry.get("steps", 0))


def _is_sha256(digest: str) -> bool:
    return re.fullmatch("[0-9a-f]{64}", digest) is not None


def _check_arguments(arguments: Mapping[str, Any]) -> None:
    for name, choice in arguments.items():
        require_name("argument", name, ARGUMENTS)
        if isinstance(choice, str):
            check_line(name, choice, DOC)
        elif name == "action_scale" and isinstance(choice, Mapping):
            for part, number in choice.items():
                _check_number(f"{name}'s {check_line('its part', part, DOC)}", number)
        elif not isinstance(choice, bool | int | float):
            raise InvalidValueError(name, choice, "a word or a number; for action_scale numbers by name")


def _check_number(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= LONGEST:
        raise InvalidValueError(name, value, f"a number within 0 … {LONGEST:g}")


def check_times(times: Mapping[str, Any]) -> None:
    """Check times: pairs of median and 99th percentile, and a total (raises `SpidarError`)."""
    for name, value in times.items():
        for number in value if isinstance(value, list) else [value]:
            _check_number(name, number)


def _check_track(name: str, track: Mapping[str, Any], runs: int) -> None:
    """Check that a track has a value for each scenario, metric and run."""
    require_name("split", track["split"], SPLITS)
    if name not in TRACKS or load_scenarios(name, track["split"])[1] != track["scenarios_sha256"]:
        raise RowError(f"{_plain(name)} has other scenarios; valid: {ANEW}")
    world = track.get("world")
    if (world is None) != (TRACKS[name].calibration is None):
        raise RowError(f"{name} has {'no' if world is None else 'a'} calibrated world; valid: {ANEW}")
    if world is not None:
        check_name(world["name"])
        if not _is_sha256(world["sha256"]):
            raise InvalidValueError("sha256 of the world", world["sha256"], "64 hexadecimal digits")
    indices = track["scenarios"]
    within = all(0 <= index < SCENARIOS for index in indices)
    if not (within and indices and len(set(indices)) == len(indices)):
        raise RowError(f"{name} has scenarios {indices!s:.80}; valid: different ones within 0 … {SCENARIOS - 1}")
    if len(track["runs"]) != runs:
        raise RowError(f"{name} has {len(track['runs'])} runs; valid: {runs}, one a policy")
    for number, run in enumerate(track["runs"]):
        _check_run(name, number, run, indices)


def _check_run(name: str, number: int, run: Mapping[str, list[Any]], indices: list[int]) -> None:
    """Check that a run has valid metrics for each scenario."""
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
    """Escape and shorten an invalid name for an error message."""
    return ascii(word)[1:-1][:40]
