"""Finished scenarios in files, so that an evaluation goes on where it was: what is written, and what is believed."""

import hashlib
import json
from pathlib import Path
from typing import Any

from spidar_gym.benchmark.content import check_times
from spidar_gym.benchmark.metrics import check_metrics
from spidar_gym.errors import SpidarError
from spidar_gym.files import write_text


def write_finished(file: Path, result: dict[str, Any]) -> None:
    """Write what an episode gave, with a digest that binds it to this file."""
    write_text(file, json.dumps({**result, "sha256": _digest(file, result)}, allow_nan=False))


def read_finished(file: Path, *, flies: bool) -> dict[str, Any] | None:
    """What an episode gave; None where there is none, or none that is whole and can be: it is played once more."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        result = {"metrics": found["metrics"], "timing": found["timing"]}
        if found != {**result, "sha256": _digest(file, result)} or not isinstance(result["metrics"], dict):
            return None
        check_metrics(result["metrics"], flies=flies)
        check_times(result["timing"], "act_s", "step_s")
    except (OSError, ValueError, KeyError, TypeError, RecursionError, SpidarError):
        return None
    return result


def _digest(file: Path, result: dict[str, Any]) -> str:
    """Digest of a result and of its file's name, which says of which policy, scenario and code it is."""
    return hashlib.sha256(json.dumps([file.stem, result], sort_keys=True).encode()).hexdigest()
