"""What a vector is told and gives: a value for each robot, a seed for each, ways of beginning anew, copies."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from spidar_gym.envs.hover.task import FlightStart
from spidar_gym.errors import InvalidValueError


def listed(name: str, value: Any, robots: int) -> list[Any]:  # noqa: ANN401 - whatever a user gives
    """A value for each robot, where a list has them and all else is one for all."""
    if not isinstance(value, list):
        return [value] * robots
    if len(value) != robots:
        raise InvalidValueError(name, value, f"one for all robots, or a list of {robots}")
    return value


def seeds(seed: int | Sequence[int | None] | None, mask: np.ndarray, *, began: bool) -> dict[int, int | None]:
    """Seed of each robot that gets a new generator.

    Args:
        seed: One for all, from which each has its own, or one for each.
        mask: Which robots begin an episode (N,).
        began: Whether they have generators.
    """
    n = len(mask)
    if seed is None:
        return {} if began else dict.fromkeys(range(n))
    given: Any = seed.tolist() if isinstance(seed, np.ndarray) else seed
    each = [given + k for k in range(n)] if isinstance(given, int | np.integer) else given
    if not (isinstance(each, list | tuple) and len(each) == n and all(s is None or _is_seed(s) for s in each)):
        raise InvalidValueError("seed", seed, f"a whole number from 0 on, or {n} of them")
    return {k: s if s is None else int(s) for k, s in enumerate(each) if mask[k] and not (s is None and began)}


def _is_seed(value: object) -> bool:
    return isinstance(value, int | np.integer) and int(value) >= 0


def autoreset(mode: Any) -> AutoresetMode:  # noqa: ANN401 - whatever a user gives
    """A way of beginning anew, by name or as it is (`InvalidValueError` lists the names)."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        ways = ", ".join(way.value for way in AutoresetMode)
        raise InvalidValueError("autoreset_mode", mode, f"one of {ways}") from None


def start(value: Mapping[str, Any] | FlightStart | None) -> FlightStart | None:
    """A flight's start as a user gives it."""
    return None if value is None else FlightStart.parse(value)


def copied(shown: Any) -> Any:  # noqa: ANN401 - an array, or a dictionary of them
    """A copy of what is shown of robots."""
    return {name: rows.copy() for name, rows in shown.items()} if isinstance(shown, dict) else shown.copy()
