"""Robots of a vector with different arguments, from options of `reset`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.tasks.hover import HoverTask

Env = SpidarEnv[Any, Any, Any]


def varied(envs: Sequence[Env], options: Mapping[str, Sequence[Any]], ids: Sequence[int]) -> list[Env]:
    """Return the environments of all robots after a change of arguments, without changing anything.

    Args:
        envs: Current environments of all robots; robots with the same arguments share one.
        options: Arguments by name, with an entry for every robot.
        ids: Robots whose arguments change.

    Raises:
        UnknownNameError, InvalidValueError: For an argument that is not valid.
    """
    found, made = list(envs), dict[tuple[int, str], Env]()
    for k in ids:
        own = {name: values[k] for name, values in options.items()}
        key = id(envs[k]), repr(own)
        if key not in made:
            made[key] = envs[k].variant(own)
        found[k] = made[key]
    return found


def make_fleet(
    envs: Sequence[Env], old: Fleet, threads: int, *, autoreset: str, truncates: bool, alike: bool
) -> Fleet:  # fmt: skip
    """Make robots with separate rules that use the arrays of another fleet; all must be reset afterwards.

    Args:
        envs: Environments of all robots.
        old: The other fleet, which is closed.
        threads: Number of threads.
        autoreset: As for `SpidarEnv.make_fleet`.
        truncates: As for `SpidarEnv.make_fleet`.
        alike: Whether all have the first environment's rules, so that they share one copy.
    """
    how = {"autoreset": autoreset, "truncates": truncates}
    rules = None if alike else np.array([env.rules(**how) for env in envs])
    fleet = envs[0].make_fleet(len(envs), threads, **how, rules=rules)
    fleet.take_over(old)
    make_room(fleet, envs)
    return fleet


def rewrite(fleet: Fleet, envs: Sequence[Env], ids: Sequence[int], *, autoreset: str, truncates: bool) -> None:
    """Write other rules for some robots of a fleet, which must be reset afterwards."""
    for k in ids:
        fleet.rules[k] = envs[k].rules(autoreset=autoreset, truncates=truncates)
    fleet.engine.configure(np.ascontiguousarray(fleet.rules["rules"]["plant"]), np.array(ids, np.int32))
    make_room(fleet, envs)


def make_room(fleet: Fleet, envs: Sequence[Env]) -> None:
    """Allocate memory for the forms and knots of the longest episode."""
    for task in {id(env): env.task for env in envs}.values():
        if isinstance(task, HoverTask):
            fleet.make_room(task.most_goals, task.most_knots)
