"""What each robot of a vector is asked and drawn from, where options of `reset` make them differ."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.tasks.hover import HoverTask

Env = SpidarEnv[Any, Any, Any]


def varied(envs: Sequence[Env], options: Mapping[str, Sequence[Any]], ids: Sequence[int]) -> list[Env]:
    """Environments of all robots, where some get other arguments; nothing has changed yet.

    Args:
        envs: Those of all robots; robots that are asked the same share one.
        options: Arguments by name, an entry for every robot.
        ids: Whose entries count.

    Raises:
        UnknownNameError, InvalidValueError: For what is not valid.
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
    """Robots that go on in the arrays of others, each with the rules of its own environment; all have to begin anew.

    Args:
        envs: Those of all robots.
        old: The others, which are closed.
        threads: How many threads carry them.
        autoreset: As of `SpidarEnv.make_fleet`.
        truncates: Likewise.
        alike: Whether all have the first one's rules, and so need no copies of their own.
    """
    how = {"autoreset": autoreset, "truncates": truncates}
    rules = None if alike else np.array([env.rules(**how) for env in envs])
    fleet = envs[0].make_fleet(len(envs), threads, **how, rules=rules)
    fleet.take_over(old)
    make_room(fleet, envs)
    return fleet


def rewrite(fleet: Fleet, envs: Sequence[Env], ids: Sequence[int], *, autoreset: str, truncates: bool) -> None:
    """Give some robots of a fleet other rules of their own, from their next episodes on, which have to begin now."""
    for k in ids:
        fleet.rules[k] = envs[k].rules(autoreset=autoreset, truncates=truncates)
    fleet.engine.configure(np.ascontiguousarray(fleet.rules["rules"]["plant"]), np.array(ids, np.int32))
    make_room(fleet, envs)


def make_room(fleet: Fleet, envs: Sequence[Env]) -> None:
    """Let the longest episode have its forms, and its path its knots."""
    for task in {id(env): env.task for env in envs}.values():
        if isinstance(task, HoverTask):
            fleet.make_room(task.most_goals, task.most_knots)
