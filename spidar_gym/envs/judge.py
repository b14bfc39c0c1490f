"""Lets a task in NumPy refer, preview and judge the robots of a fleet in place of the built-in one in C."""

import importlib
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from spidar_gym.envs.batch import Robots, VectorTask, check_weights, checked_array, require_finite, weighted
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.hover.flights import FlightTask
from spidar_gym.envs.hover.task import FlightStart
from spidar_gym.envs.options import Task
from spidar_gym.errors import REAL, InvalidValueError, require_array, require_keys
from spidar_gym.native.draws import from_numpy, to_numpy
from spidar_gym.native.engine_structs import AUTORESETS

TASKS = {
    "hover": "an object of a class derived from FlightTask",
    "crawling": "an object of a class derived from WalkTask",
    "coursing": "None: a course is judged by its own task",
}
"""What a task of one's own is, by the robots that it judges."""


def require_task(task: object, kind: str, names: Iterable[str] = ()) -> None:
    """Refuse what is no task for robots of a kind.

    Args:
        task: A user's.
        kind: `hover`, `crawling` or `coursing`.
        names: Arguments of the environment, which options of the task may not be called.

    Raises:
        InvalidValueError: For a task of other robots, weights that do not add up to 1, failures without `diverged`, and
            options with the name of an argument.
    """
    if not (isinstance(task, VectorTask) and task.robots.kind == kind):
        raise InvalidValueError("task", task, TASKS[kind])
    if not check_weights(task):
        raise InvalidValueError("reward_terms", dict(task.reward_terms), "weights that add up to 1")
    if "diverged" not in task.failures:
        raise InvalidValueError("failures", list(task.failures), "diverged among them: the engine says that")
    twice = sorted({*task_options(task)} & {*names})
    if twice:
        raise InvalidValueError("task", type(task).__name__, f"one whose options are not called {', '.join(twice)}")


def find_task(task: object) -> Any:  # noqa: ANN401 - whatever a user gives
    """A task of one's own, or the one of a class that is given, by its name `module:Class` too; None stays None.

    Raises:
        InvalidValueError: For a name that leads to no class.
    """
    if isinstance(task, str):
        module, _, name = task.partition(":")
        try:
            task = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise InvalidValueError("task", task, f"module:Class of a task that Python finds ({error})") from None
    return task() if isinstance(task, type) and issubclass(task, VectorTask) else task


def task_options(task: object) -> tuple[str, ...]:
    """Options of a task of one's own, where it is a dataclass: `reset` takes them too."""
    return tuple(f.name for f in fields(task) if f.init) if is_dataclass(task) else ()


class Judge:
    """A task of a user's own over a fleet: it writes the fleet's arrays as the engine does."""

    def __init__(self, task: VectorTask[Any], fleet: Fleet, own: Task, before: "Judge | None" = None) -> None:
        """Take over.

        Args:
            task: What the robots are to do, one that `require_task` takes.
            fleet: Robots at no episode yet, whose rules say that they are judged.
            own: The environment's own task: its options.
            before: Who judged as many robots until now; these go on in its arrays, where clients look.
        """
        rules, robots = fleet.rules["rules"], len(fleet.robots)
        self.task, self._fleet, self._own = task, fleet, own
        """What the robots are to do."""
        self._weights, self._words = [weight for weight, _ in task.reward_terms.values()], list(task.failures)
        self._autoreset = AUTORESETS[int(rules["autoreset"])]
        self._memory = np.zeros(robots, np.dtype([*task.memory, ("_task", "u1")]))
        self.terms, self.final_terms = (np.zeros((robots, len(self._weights))) for _ in range(2))
        """Terms of the reward, in the order of the task's table."""
        self.is_given = np.zeros(robots, bool) if before is None else before.is_given
        """Whose start a user has given, which goes before the task's."""
        self._bound = np.concatenate([[], *(np.full(f.size, f.bound) for f in task.fields)])
        size = int(rules["size"]) + len(self._bound)
        self._seen, self._final = (np.zeros((robots, size), np.float32) for _ in range(2))
        if before is not None:
            self._seen, self._final = before._seen, before._final
        fleet.extras += [self._memory, self.terms, self.is_given, self._seen]
        fleet.failures, fleet.task = len(self._words), f"{type(task).__module__}.{type(task).__qualname__}"
        self._draws = type(task).draw is not VectorTask.draw
        self._starts = isinstance(task, FlightTask) and type(task).start is not FlightTask.start

    @property
    def observations(self) -> np.ndarray:
        """What the engine shows, and the task's own fields after it, an array that is written anew at every step."""
        return self._seen if len(self._bound) else self._fleet.observations

    @property
    def final_observations(self) -> np.ndarray:
        """The same where an episode has ended and the next has begun in the same step."""
        return self._final if len(self._bound) else self._fleet.final_observations

    def _robots(self) -> Any:  # noqa: ANN401 - what its task is told
        make: Any = self.task.robots
        return make(self._fleet, self._memory, self._own)

    def reset(self, ids: np.ndarray | None = None) -> None:
        """Let robots begin an episode, all if not said."""
        ids = np.arange(len(self._memory)) if ids is None else ids
        self._prepare(ids)
        self._fleet.reset(ids)
        self._begin(ids)
        self._observe(self._robots(), ids)

    def _prepare(self, ids: np.ndarray) -> None:
        """Say what episodes that are about to begin begin with, where the task does."""
        if not self._starts:
            return
        task: Any = self.task
        for k in ids[~self.is_given[ids]].tolist():
            episode = self._fleet.robots[k]["episode"]
            rng = to_numpy(episode["generator"])
            start = task.start(rng, self._own)
            if not (start is None or isinstance(start, FlightStart)):
                raise InvalidValueError(f"{self._name}.start", start, "a FlightStart, or None to have it drawn")
            self._fleet.begin_with(k, start)
            episode["generator"] = from_numpy(rng)

    def _begin(self, ids: np.ndarray) -> None:
        """Go on where the engine has reset robots."""
        fleet, task = self._fleet, self.task
        self._memory[ids] = 0
        if self._draws:
            for k in ids.tolist():
                episode = fleet.robots[k]["episode"]
                rng = to_numpy(episode["generator"])
                self._remember(k, task.draw(rng))
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
        if self._starts and self._autoreset == "next_step":
            self._prepare(np.flatnonzero(episode["over"]))
        fleet.begun[:] = False
        fleet.step()
        begun = np.flatnonzero(fleet.begun)
        robots.look(task)
        task.advance(robots)
        diverged = records["plant"]["diverged"] != 0
        failure = np.full(len(records), -1)
        words = [word for word in self._words if word != "diverged"]
        found = self._rows(task.failed(robots), words, "failed", "?")
        for word, mask in reversed(list(found.items())):
            failure[mask] = self._words.index(word)
        failure[diverged] = self._words.index("diverged")
        self.terms[:] = self._terms(robots)
        self.terms[diverged] = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            fleet.rewards[:] = weighted(self.terms, self._weights)
        require_finite(f"{self._name}: sum of terms", fleet.rewards, records)
        succeeded = checked_array(f"{self._name}.succeeded", task.succeeded(robots), (len(records),), "?")
        fleet.infos["is_success"] = succeeded & (failure < 0)
        truncated = (episode["ticks"] >= rules["horizon"]) & bool(rules["truncates"])
        failure[begun], truncated[begun], fleet.rewards[begun] = -1, False, 0.0
        over = (failure >= 0) | truncated
        episode["failure"], episode["truncated"], episode["over"] = failure, truncated, over
        episode["reward"] = fleet.rewards
        fleet.terminated[:], fleet.truncated[:] = failure >= 0, truncated
        robots.aim(task)
        if begun.size:
            self._begin(begun)
        fleet.show()
        self._observe(robots)
        if self._autoreset == "same_step" and over.any():
            fleet.final_observations[over], fleet.final_infos[over] = fleet.observations[over], fleet.infos[over]
            self.final_terms[over], self._final[over] = self.terms[over], self._seen[over]
            ids = np.flatnonzero(over)
            rewards, ends = fleet.rewards[ids], (fleet.terminated[ids], fleet.truncated[ids])
            self.reset(ids)
            fleet.rewards[ids], (fleet.terminated[ids], fleet.truncated[ids]) = rewards, ends

    def _observe(self, robots: Robots, ids: np.ndarray | None = None) -> None:
        """Write what is seen: the engine's part, and the task's own."""
        if not len(self._bound):
            return
        task, chosen = self.task, slice(None) if ids is None else ids
        shown = self._fleet.observations
        given = task.observe(robots)
        names = [f.name for f in task.fields]
        self._require_names(given, names, "observe")
        own = []
        for f in task.fields:
            values, shape, name = given[f.name], (len(robots), f.size), f"{self._name}.observe: {f.name}"
            values = checked_array(name, values, shape).astype(float)
            require_finite(name, values, robots.robots)
            own.append(values)
        seen = np.clip(np.concatenate(own, axis=1), -self._bound, self._bound)
        seen[robots.robots["plant"]["diverged"] != 0] = 0.0
        self._seen[chosen, : shown.shape[1]], self._seen[chosen, shown.shape[1] :] = shown[chosen], seen[chosen]

    def _terms(self, robots: Robots) -> np.ndarray:
        found = self._rows(self.task.terms(robots), list(self.task.reward_terms), "terms", REAL)
        terms = np.stack(list(found.values()), axis=1).astype(float)
        if not np.isfinite(terms).all():
            for name, values in found.items():
                require_finite(f"{self._name}.terms: {name}", values, robots.robots)
        return terms

    @property
    def _name(self) -> str:
        return type(self.task).__name__

    def _remember(self, robot: int, drawn: Any) -> None:  # noqa: ANN401 - a user's
        """Write what a task has drawn for a robot into its memory."""
        method = f"{self._name}.draw"
        memory = self._memory[robot]
        for name, value in require_keys(
            method, "entry of the memory", drawn, [row[0] for row in self.task.memory]
        ).items():
            shape = np.shape(memory[name])
            values = require_array(f"{method}: {name}", value, f"numbers of shape {shape}")
            if values.shape not in ((), shape) or not np.isfinite(values).all():
                raise InvalidValueError(f"{method}: {name}", value, f"finite numbers of shape {shape}")
            memory[name] = value

    def _rows(self, given: Any, names: list[str], method: str, kinds: str) -> dict[str, np.ndarray]:  # noqa: ANN401 - a user's
        """What a task gives by name, an entry for every robot each, in the order of its table."""
        self._require_names(given, names, method)
        shape, name = (len(self._memory),), f"{self._name}.{method}"
        return {each: checked_array(f"{name}: {each}", given[each], shape, kinds) for each in names}

    def _require_names(self, given: Any, names: list[str], method: str) -> None:  # noqa: ANN401 - a user's
        if not isinstance(given, dict) or given.keys() != {*names}:
            expected = f"a dictionary with an array for each of {', '.join(names)}"
            raise InvalidValueError(f"{self._name}.{method}", given, expected)
