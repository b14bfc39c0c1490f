"""Lets a task in NumPy refer, preview and judge the robots of a fleet in place of the built-in one in C."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from spidar_gym.envs.batch import Robots, VectorTask, check_weights, weighted
from spidar_gym.envs.crawl.task import CrawlTask
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.hover.task import HoverTask
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.draws import from_numpy, to_numpy
from spidar_gym.native.engine_structs import AUTORESETS

TASKS = {"hover": "an object of a class derived from FlightTask", "crawling": "one of a class derived from WalkTask"}
"""What a task of one's own is, by the robots that it judges."""


class Judge:
    """A task of a user's own over a fleet: it writes the fleet's arrays as the engine does."""

    def __init__(self, task: VectorTask[Any], fleet: Fleet, own: HoverTask | CrawlTask) -> None:
        """Take over.

        Args:
            task: What the robots are to do.
            fleet: Robots at no episode yet.
            own: The environment's own task: its options.

        Raises:
            InvalidValueError: For a task of other robots, weights that do not add up to 1, and failures without
                `diverged`.
        """
        if not (isinstance(task, VectorTask) and task.robots.kind == fleet.kind):
            raise InvalidValueError("task", task, TASKS[fleet.kind])
        if not check_weights(task):
            raise InvalidValueError("reward_terms", dict(task.reward_terms), "weights that add up to 1")
        if "diverged" not in task.failures:
            raise InvalidValueError("failures", list(task.failures), "diverged among them: the engine says that")
        rules = fleet.rules["rules"]
        rules["is_judged"] = True
        self.task, self._fleet = task, fleet
        """What the robots are to do."""
        self._weights, self._words = [weight for weight, _ in task.reward_terms.values()], list(task.failures)
        self._same_step = AUTORESETS[int(rules["autoreset"])] == "same_step"
        robots = len(fleet.robots)
        memory = np.zeros(robots, np.dtype([*task.memory, ("_task", "u1")]))
        self.terms, self.final_terms = (np.zeros((robots, len(self._weights))) for _ in range(2))
        """Terms of the reward, in the order of the task's table."""
        fleet.extras += [memory, self.terms]
        fleet.task = f"{type(task).__module__}.{type(task).__qualname__}"
        self._memory, self._own = memory, own
        self._draws = type(task).draw is not VectorTask.draw

    def _robots(self) -> Any:  # noqa: ANN401 - what its task is told
        make: Any = self.task.robots
        return make(self._fleet, self._memory, self._own)

    def begin(self, ids: np.ndarray) -> None:
        """Go on where the engine has reset robots."""
        fleet, task = self._fleet, self.task
        self._memory[ids] = 0
        if self._draws:
            for k in ids.tolist():
                episode = fleet.robots[k]["episode"]
                rng = to_numpy(episode["generator"])
                for name, value in task.draw(rng).items():
                    self._memory[name][k] = value
                episode["generator"] = from_numpy(rng)
        robots = self._robots()
        robots.begin(task, ids)
        self.terms[ids] = self._terms(robots)[ids]
        fleet.infos["is_success"][ids] = False

    def step(self) -> None:
        """One control period of all robots."""
        fleet, task, robots = self._fleet, self.task, self._robots()
        rules, records = fleet.rules["rules"], fleet.robots
        episode = records["episode"]
        fleet.begun[:] = False
        fleet.step()
        begun = np.flatnonzero(fleet.begun)
        robots.look(task)
        task.advance(robots)
        diverged = records["plant"]["diverged"] != 0
        failure = np.full(len(records), -1)
        found = _rows(task.failed(robots), [word for word in self._words if word != "diverged"], "failed", len(robots))
        for word, mask in reversed(list(found.items())):
            failure[mask] = self._words.index(word)
        failure[diverged] = self._words.index("diverged")
        self.terms[:] = self._terms(robots)
        self.terms[diverged] = 0.0
        fleet.rewards[:] = weighted(self.terms, self._weights)
        fleet.infos["is_success"] = task.succeeded(robots) & (failure < 0)
        truncated = (episode["ticks"] >= rules["horizon"]) & bool(rules["truncates"])
        failure[begun], truncated[begun], fleet.rewards[begun] = -1, False, 0.0
        over = (failure >= 0) | truncated
        episode["failure"], episode["truncated"], episode["over"] = failure, truncated, over
        episode["reward"] = fleet.rewards
        fleet.terminated[:], fleet.truncated[:] = failure >= 0, truncated
        robots.aim(task)
        if begun.size:
            self.begin(begun)
        fleet.show()
        if self._same_step and over.any():
            fleet.final_observations[over], fleet.final_infos[over] = fleet.observations[over], fleet.infos[over]
            self.final_terms[over] = self.terms[over]
            ids = np.flatnonzero(over)
            rewards, ends = fleet.rewards[ids], (fleet.terminated[ids], fleet.truncated[ids])
            fleet.reset(ids)
            fleet.rewards[ids], (fleet.terminated[ids], fleet.truncated[ids]) = rewards, ends
            self.begin(ids)

    def _terms(self, robots: Robots) -> np.ndarray:
        found = _rows(self.task.terms(robots), self.task.reward_terms, "terms", len(robots))
        return np.stack(list(found.values()), axis=1)


def _rows(given: Any, names: Iterable[str], method: str, robots: int) -> dict[str, np.ndarray]:  # noqa: ANN401 - a user's
    """What a task gives by name, an entry for every robot each, in the order of its table."""
    names = list(names)
    if not isinstance(given, dict) or given.keys() != {*names}:
        raise InvalidValueError(method, given, f"a dictionary with an array for each of {', '.join(names)}")
    for name in names:
        if np.shape(given[name]) != (robots,):
            raise InvalidValueError(f"{method}: {name}", np.shape(given[name]), f"an array of shape ({robots},)")
    return {name: given[name] for name in names}
