"""Construction of `info`: words, numbers and sampled parameters of one robot, arrays and masks of many."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from spidar_gym.envs.fleet import Fleet
from spidar_gym.native.library import STATUS
from spidar_gym.sim.randomize import TABLE


def drawn(numbers: np.ndarray) -> dict[str, np.ndarray]:
    """Split the robots' sampled parameters (…, numbers) by field of `PlantConfig`: arrays (…, shape of the field)."""
    draws, at = dict[str, np.ndarray](), 0
    for row in TABLE:
        size = math.prod(row.shape)
        draws[row.field] = numbers[..., at : at + size].reshape((*numbers.shape[:-1], *row.shape)).copy()
        at += size
    return draws


_STATUSES = tuple(str(word) for word in STATUS)
SETS = ("shortfalls",)
"""Entries that can hold several words: their codes are bit masks."""


def words_of(failures: Iterable[str], words: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Return the words of `info` by name, in the order of their codes.

    Args:
        failures: Names of the failures.
        words: Other words of the environment.
    """
    return {"qp_status": _STATUSES, "failure": tuple(failures), **words}


def spoken(name: str, code: int, words: Sequence[str]) -> str:
    """Return the word of a code of `info`: −1 is none; in `SETS`, bit k is the k-th word."""
    if name in SETS:
        return ", ".join(word for k, word in enumerate(words) if code >> k & 1)
    return words[code] if code >= 0 else "none" if name == "qp_status" else ""


def info_of(
    record: np.ndarray, terms: Iterable[str], values: np.ndarray, words: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """Return `info` of a robot; each entry is an array, a number or a word.

    Args:
        record: `sp_hover_info` or one of the other tasks', shape (1,).
        terms: Names of the reward terms.
        values: Values of the terms in this order.
        words: Words by the entry's name, in the order of their codes.
    """
    # Copying the bytes and unpacking them in one call is faster than copying a record, which goes field by field.
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
    """Return the names of the entries of a record of infos; those common to all environments come first."""
    common, *own = list(layout.names or ("",))
    return (*(layout[common].names or ()), *own)


def arrays_of(
    fleet: Fleet, terms: Iterable[str], mask: np.ndarray, is_drawn: np.ndarray, *,
    ended: dict[str, np.ndarray] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Build `info` of all robots, with words as codes: new arrays (N, …), and a mask for every entry.

    Args:
        fleet: The robots.
        terms: Names of the reward terms.
        mask: Robots for which it is valid (N,).
        is_drawn: Which robots are randomised (N,).
        ended: Sampled parameters of the last episodes, to build `info` of their ends after the next have begun.
    """
    final = ended is not None
    # Each array owns its memory: JAX accepts no views into records.
    info: dict[str, Any] = {name: each.copy() for name, each in (fleet.final_told if final else fleet.told).items()}
    info["term"] = (fleet.final_terms if final else fleet.terms).copy()
    info.update(zip(titles("reward_", terms), info["term"].T.copy(), strict=True))
    masks = dict.fromkeys(titles("_", info), mask)
    if draws := ended if final else draws_of(fleet, is_drawn):
        info["randomization"], masks["_randomization"] = draws, mask & is_drawn
    return info | masks


def draws_of(fleet: Fleet, is_drawn: np.ndarray) -> dict[str, np.ndarray]:
    """Return the sampled parameters of all robots by field of `PlantConfig` (N, …); empty without randomisation."""
    return drawn(fleet.robots["episode"]["drawn"]) if is_drawn.any() else {}


def titles(prefix: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return names with a prefix, cached."""
    return _titles(prefix, tuple(names))


@cache
def _titles(prefix: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(prefix + name for name in names)
