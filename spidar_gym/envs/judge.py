"""Lets a task in NumPy refer, preview and judge the robots of a fleet in place of the built-in one in C."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.hover.flights import Flights, FlightTask, check_weights, weighted
from spidar_gym.envs.hover.task import HoverTask
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.draws import from_numpy, to_numpy
from spidar_gym.native.engine_structs import AUTORESETS


class Judge:
    """A task of a user's own over a fleet: it writes the fleet's arrays as the engine does."""

    def __init__(self, task: FlightTask, fleet: Fleet, hover: HoverTask) -> None:
        """Take over.

        Args:
            task: What the robots are to do.
            fleet: Robots at no episode yet.
            hover: Options of the environment.

        Raises:
            InvalidValueError: For weights that do not add up to 1, and failures without `diverged`.
        """
        if not check_weights(task):
            raise InvalidValueError("reward_terms", dict(task.reward_terms), "weights that add up to 1")
        if "diverged" not in task.failures:
            raise InvalidValueError("failures", list(task.failures), "diverged among them: the engine says that")
        rules = fleet.rules["rules"]
        rules["is_judged"] = True
        self._task, self._fleet = task, fleet
        self._weights, self._words = [weight for weight, _ in task.reward_terms.values()], list(task.failures)
        self._same_step = AUTORESETS[int(rules["autoreset"])] == "same_step"
        robots = len(fleet.robots)
        memory = np.zeros(robots, np.dtype([*task.memory, ("_task", "u1")]))
        self.terms, self.final_terms = (np.zeros((robots, len(self._weights))) for _ in range(2))
        """Terms of the reward, in the order of the task's table."""
        fleet.extras += [memory, self.terms]
        fleet.task = f"{type(task).__module__}.{type(task).__qualname__}"
        self._memory, self._hover = memory, hover
        self._draws = type(task).draw is not FlightTask.draw

    def _flights(self) -> Flights:
        rules = self._fleet.rules["rules"]
        return Flights(
            self._fleet.robots, self._fleet.goals, self._memory, self._hover, int(rules["horizon"]),
            int(rules["mode"]["size"]),
        )  # fmt: skip

    def begin(self, ids: np.ndarray) -> None:
        """Go on where the engine has reset robots."""
        fleet, task = self._fleet, self._task
        self._memory[ids] = 0
        for name in ("flown", "current", "position_sum", "attitude_sum"):
            fleet.robots[name][ids] = 0
        fleet.goals["reached"][ids] = 0
        if self._draws:
            for k in ids.tolist():
                episode = fleet.robots[k]["episode"]
                rng = to_numpy(episode["generator"])
                for name, value in task.draw(rng).items():
                    self._memory[name][k] = value
                episode["generator"] = from_numpy(rng)
        flights = self._flights()
        fleet.robots["reference"][ids] = task.reference(flights)[ids]
        fleet.robots["preview"][ids] = task.preview(flights)[ids]
        fleet.regard(ids)
        self.terms[ids] = self._terms(flights)[ids]
        fleet.infos["is_success"][ids] = False

    def step(self) -> None:
        """One control period of all robots."""
        fleet, task, flights = self._fleet, self._task, self._flights()
        rules, robots = fleet.rules["rules"], fleet.robots
        episode = robots["episode"]
        fleet.begun[:] = False
        fleet.step()
        begun = np.flatnonzero(fleet.begun)
        task.advance(flights)
        diverged = robots["plant"]["diverged"] != 0
        failure = np.full(len(robots), -1)
        found = _rows(task.failed(flights), [word for word in self._words if word != "diverged"], "failed", len(robots))
        for word, mask in reversed(list(found.items())):
            failure[mask] = self._words.index(word)
        failure[diverged] = self._words.index("diverged")
        self.terms[:] = self._terms(flights)
        self.terms[diverged] = 0.0
        fleet.rewards[:] = weighted(self.terms, self._weights)
        fleet.infos["is_success"] = task.succeeded(flights) & (failure < 0)
        truncated = (episode["ticks"] >= rules["horizon"]) & bool(rules["truncates"])
        failure[begun], truncated[begun], fleet.rewards[begun] = -1, False, 0.0
        over = (failure >= 0) | truncated
        episode["failure"], episode["truncated"], episode["over"] = failure, truncated, over
        episode["reward"] = fleet.rewards
        fleet.terminated[:], fleet.truncated[:] = failure >= 0, truncated
        robots["reference"], robots["preview"] = task.reference(flights), task.preview(flights)
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

    def _terms(self, flights: Flights) -> np.ndarray:
        found = _rows(self._task.terms(flights), self._task.reward_terms, "terms", len(flights))
        return np.stack(list(found.values()), axis=1)


def _rows(given: Any, names: Iterable[str], method: str, robots: int) -> dict[str, np.ndarray]:  # noqa: ANN401
    """What a task gives by name, an entry for every robot each, in the order of its table."""
    names = list(names)
    if not isinstance(given, dict) or given.keys() != {*names}:
        raise InvalidValueError(method, given, f"a dictionary with an array for each of {', '.join(names)}")
    for name in names:
        if np.shape(given[name]) != (robots,):
            raise InvalidValueError(f"{method}: {name}", np.shape(given[name]), f"an array of shape ({robots},)")
    return {name: given[name] for name in names}
