"""The one robot of a fleet, as an environment of a single robot tells of it: in objects, words and single numbers."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from spidar_gym.envs.fleet import Fleet
from spidar_gym.native.draws import take_back
from spidar_gym.native.library import STATUS
from spidar_gym.native.plant import read_command, read_state
from spidar_gym.sim.randomize import TABLE
from spidar_gym.state import Command, RobotState


def begin(fleet: Fleet, rng: np.random.Generator) -> None:
    """Let the next episode of robot 0 begin; it is drawn from `rng`, which moves on."""
    fleet.seed(0, rng)
    fleet.reset()
    take_back(rng, fleet.robots[0]["episode"]["generator"])


def look(fleet: Fleet, name: str) -> RobotState | Command:
    """What the controller sees (`seen`), or the last `command`."""
    episode = fleet.robots[0]["episode"]
    return read_state(episode["seen"]) if name == "seen" else read_command(episode["command"])


def drawn(numbers: np.ndarray) -> dict[str, np.ndarray]:
    """What was drawn of robots (…, numbers), by field of `PlantConfig`: arrays (…, shape of the field)."""
    draws, at = dict[str, np.ndarray](), 0
    for row in TABLE:
        size = math.prod(row.shape)
        draws[row.field] = numbers[..., at : at + size].reshape((*numbers.shape[:-1], *row.shape)).copy()
        at += size
    return draws


_STATUSES = tuple(str(word) for word in STATUS)
SETS = ("shortfalls",)
"""What names several words at once: their numbers are bits."""


def words_of(failures: Iterable[str], words: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Words of `info` by name, in the order of their codes.

    Args:
        failures: Why an episode may be over.
        words: What else an environment has.
    """
    return {"qp_status": _STATUSES, "failure": tuple(failures), **words}


def spoken(name: str, code: int, words: Sequence[str]) -> str:
    """What a code of `info` means: −1 is none, in `SETS` bit k is the k-th word."""
    if name in SETS:
        return ", ".join(word for k, word in enumerate(words) if code >> k & 1)
    return words[code] if code >= 0 else "none" if name == "qp_status" else ""


def info(
    record: np.ndarray, terms: Iterable[str], values: np.ndarray, words: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """What is told of a robot, an array, a number or a word each.

    Args:
        record: `sp_hover_info` or one of the other tasks', shape (1,).
        terms: Names of the terms of the reward.
        values: Their values in this order.
        words: What codes mean, by the word's name, in the order of the codes.
    """
    # A copy of bytes, and one call that takes it apart: a record's own copy goes field by field.
    (common, *own), names = record.view(np.uint8).copy().view(record.dtype)[0].item(), _names(record.dtype)
    found = dict(zip(names, (*common, *own), strict=True))
    for name, value in zip(terms, values.tolist(), strict=True):
        found[f"reward_{name}"] = value
    coded = {name: found.pop(f"{name}_code") for name in words if f"{name}_code" in found}
    for name, code in coded.items():
        found[name] = spoken(name, code, words[name])
    return found


@cache
def _names(layout: np.dtype[Any]) -> tuple[str, ...]:
    """Names of what a record of infos tells: what all environments do comes first."""
    common, *own = layout.names or ()
    return (*(layout[common].names or ()), *own)
