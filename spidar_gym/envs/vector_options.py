"""Options of a vector's `reset`: values for each robot, seeds, masks, autoreset modes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from spidar_gym.control.course.gates import parse_course
from spidar_gym.control.grasp.scene import parse_scene
from spidar_gym.envs.fleet import Fleet
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.engine_structs import SEQUENCES
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.tasks.start import FlightStart


def listed(name: str, value: Any, robots: int) -> list[Any]:  # noqa: ANN401 - user input
    """Return a value for each robot: the entries of a list, or any other value repeated."""
    if not isinstance(value, list):
        return [value] * robots
    if len(value) != robots:
        raise InvalidValueError(name, value, f"one for all robots, or a list of {robots}")
    return value


def _plain_array(value: Any) -> np.ndarray:  # noqa: ANN401 - user input
    """Convert a list, tuple, range or array to an array; other values and ragged lists become one without dimension."""
    try:
        return np.array(value) if isinstance(value, list | tuple | range | np.ndarray) else np.array(None)
    except Exception:  # conversion of an entry may run foreign code
        return np.array(None)


def numbered(ids: Any, robots: int, *, rising: bool = False) -> list[int]:  # noqa: ANN401 - user input
    """Return the indices of robots, all if None (`InvalidValueError` for an invalid list)."""
    if ids is None:
        return list(range(robots))
    given = _plain_array(ids)
    fits = given.ndim == 1 and (given.dtype.kind in "iu" or not given.size)
    if not fits or len({*given.tolist()}) < given.size or np.any((given < 0) | (given >= robots)):
        raise InvalidValueError("ids", ids, f"numbers of robots, each once, within 0 … {robots - 1}")
    if rising and np.any(np.diff(given) < 0):
        raise InvalidValueError("ids", ids, "numbers of robots in rising order")
    return given.astype(int).tolist()


def masked(flags: Any, robots: int) -> np.ndarray:  # noqa: ANN401 - user input
    """Return the mask of the robots to reset (robots,) (`InvalidValueError` for another value)."""
    mask = _plain_array(flags)
    if mask.shape != (robots,) or mask.dtype != bool or not mask.any():
        raise InvalidValueError("reset_mask", flags, f"{robots} flags, at least one of them True")
    return mask


def seeds(seed: int | Sequence[int | None] | None, mask: np.ndarray, *, began: bool) -> dict[int, int | None]:
    """Return the seeds of robots that get a new generator.

    Args:
        seed: Seed of robot 0, with robot k's k higher, or one for each.
        mask: Robots that begin an episode (N,).
        began: Whether the robots have generators already.
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


def autoreset(mode: Any) -> AutoresetMode:  # noqa: ANN401 - user input
    """Return an autoreset mode from its name or itself (`InvalidValueError` lists the names)."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        ways = ", ".join(way.value for way in AutoresetMode)
        raise InvalidValueError("autoreset_mode", mode, f"one of {ways}") from None


def start(value: Mapping[str, Any] | FlightStart | None) -> FlightStart | None:
    """Parse the start of a flight; None stays None."""
    return None if value is None else FlightStart.parse(value)


def copied(shown: Any) -> Any:  # noqa: ANN401 - an array, or a dictionary of them
    """Copy observations."""
    return {name: rows.copy() for name, rows in shown.items()} if isinstance(shown, dict) else shown.copy()


def parsed(name: str, value: Any, robots: int, task: Any) -> list[Any]:  # noqa: ANN401 - user input
    """Return the parsed value of an option of `reset` that needs no rebuilding, for each robot.

    Args:
        name: Name of the option.
        value: One value for all, or a list.
        robots: Number of robots.
        task: Task of the robots.
    """
    ways = {
        "disturbances": Disturbances.parse,
        "forms": lambda forms: SEQUENCES.index(replace(task, forms=forms).forms),
        "start": start,
        "course": parse_course,
        "scene": parse_scene,
    }
    each = listed(name, list(value) if isinstance(value, tuple) else value, robots)
    return [ways[name](one) for one in each]


def said_at_reset(fleet: Fleet, robot: int, options: Mapping[str, Any]) -> None:
    """Apply parsed options to a robot from its next episode on."""
    if "disturbances" in options:
        fleet.disturb(robot, options["disturbances"])
    if "forms" in options:
        fleet.robots["forms"][robot] = options["forms"]
    if "start" in options:
        fleet.give_start(robot, options["start"])
    if "course" in options:
        fleet.go(robot, options["course"])
    if "scene" in options:
        fleet.set_scene(robot, options["scene"])
