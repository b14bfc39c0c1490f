"""Construction of `info`: words, numbers and sampled parameters of one robot, arrays and masks of many."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from spidar_gym.envs.fleet import Fleet
from spidar_gym.native.library import STATUS
from spidar_gym.sim.randomize import Randomization
from spidar_gym.sim.rows import TABLE, Row


def drawn(numbers: np.ndarray, rows: Iterable[Row] = TABLE) -> dict[str, np.ndarray]:
    """Split the robots' sampled parameters (…, numbers) by field of `PlantConfig`: arrays (…, shape of the field).

    Args:
        numbers: Sampled parameters, in the order of the rows.
        rows: Rows that were sampled.
    """
    draws, at = dict[str, np.ndarray](), 0
    for row in rows:
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
    fleet: Fleet, terms: Iterable[str], mask: np.ndarray, draws: "Draws", *,
    ended: dict[str, np.ndarray] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Build `info` of all robots, with words as codes: new arrays (N, …), and a mask for every entry.

    Args:
        fleet: The robots.
        terms: Names of the reward terms.
        mask: Robots for which it is valid (N,).
        draws: The robots' randomisation.
        ended: Sampled parameters of the last episodes, to build `info` of their ends after the next have begun.
    """
    final = ended is not None
    # Each array owns its memory: JAX accepts no views into records.
    info: dict[str, Any] = {name: each.copy() for name, each in (fleet.final_told if final else fleet.told).items()}
    info["term"] = (fleet.final_terms if final else fleet.terms).copy()
    info.update(zip(titles("reward_", terms), info["term"].T.copy(), strict=True))
    masks = dict.fromkeys(titles("_", info), mask)
    if found := ended if final else draws.of(fleet):
        info["randomization"], masks["_randomization"] = found, mask & draws.mask
    return info | masks


class Draws:
    """Randomisation of the robots of a vector."""

    def __init__(self, given: Sequence[Randomization]) -> None:
        """Group robots by the rows that are sampled for them.

        Args:
            given: Randomisation of each robot.
        """
        self.mask = np.array([each.draws for each in given])
        """Which robots are randomised (N,)."""
        self._of_world = np.array([each.world is not None for each in given])
        self._groups: dict[tuple[Row, ...], list[int]] = {}
        for k, each in enumerate(given):
            self._groups.setdefault(each.rows, []).append(k)
        self._rows = {row.field: row for own in self._groups for row in own}

    def of(self, fleet: Fleet) -> dict[str, np.ndarray]:
        """Return the sampled parameters of all robots by field of `PlantConfig` (N, …); empty without randomisation.

        A parameter that is sampled for other robots only has the value without effect. `kind` is the index of a kind of
        the calibrated world, −1 for robots without one.
        """
        if not self.mask.any():
            return {}
        numbers, kinds = fleet.robots["episode"]["drawn"], fleet.robots["episode"]["kind"]
        kind = {"kind": np.where(self._of_world, kinds, -1)} if self._of_world.any() else {}
        if len(self._groups) == 1:
            return kind | drawn(numbers, self._rows.values())
        configs = fleet.robots["plant"]["config"]
        found = {field: _unsampled(row, configs) for field, row in self._rows.items()}
        for own, ids in self._groups.items():
            for field, values in drawn(numbers[ids], own).items():
                found[field][ids] = values
        return kind | found


def _unsampled(row: Row, configs: np.ndarray) -> np.ndarray:
    """Return the value without effect for all robots, given their configurations."""
    part, name = row.field.split(".")
    if row.operation == "set":
        return configs[part][name].copy()
    return np.full((len(configs), *row.shape), 1.0 if row.operation == "scale" else 0.0)


def titles(prefix: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return names with a prefix, cached."""
    return _titles(prefix, tuple(names))


@cache
def _titles(prefix: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(prefix + name for name in names)
