"""What a task is: options, reward terms, failures and success of N robots at once, and what it may change besides."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from spidar_gym.control.flight.observation import Field
from spidar_gym.errors import REAL, InvalidValueError, require_within
from spidar_gym.tasks.robots import Robots

R = TypeVar("R", bound=Robots)


@dataclass(frozen=True)
class Task(ABC, Generic[R]):
    """What robots are to do, and how well they do it.

    The fields of the dataclass are arguments of the environment and options of its `reset`. Each method is called once
    a tick for all robots. What one robot gets may not depend on the others: no products of matrices over robots, and no
    draws but those of `draw` and `start`.

    What a method gives is checked where it enters: an answer of another kind or shape, or one that is not finite for a
    robot that has not diverged, is an `InvalidValueError` that names task, method, term and robot; what a method
    raises itself goes through unchanged. In a step the robots have moved by then: `reset` begins anew.
    """

    robots: ClassVar[type[Robots]]
    """What the methods are given."""
    reward_terms: ClassVar[Mapping[str, tuple[float, str]]]
    """Weight and formula of each term; the weights add up to 1."""
    failures: ClassVar[Mapping[str, str]]
    """Why an episode may be over: words in the order of their codes, and what they mean; `diverged` is the engine's."""
    memory: ClassVar[tuple[tuple[Any, ...], ...]] = ()
    """What the task keeps of a robot, as numpy has it: name, kind, shape; zero when an episode begins."""
    fields: ClassVar[tuple[Field, ...]] = ()
    """What a policy sees besides what the environment shows, at the end of its observation."""
    loads: ClassVar[bool] = False
    """Whether it has robots carry things (`Robots.load`): each then has a model of its own."""

    @abstractmethod
    def terms(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Terms of the reward (N,), any finite numbers; the reward is their sum weighted with `reward_terms`."""

    @abstractmethod
    def failed(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Whose episode is over why (N,), booleans by word; the first that holds counts."""

    @abstractmethod
    def succeeded(self, robots: R, /) -> np.ndarray:
        """Who has done what was to be done (N,), booleans."""

    def tell(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Entries of `info` that the task says, by name (N,)."""
        del robots
        return {}

    def draw(self, rng: np.random.Generator) -> Mapping[str, Any]:
        """Numbers of the memory that an episode of one robot begins with, after all that the environment draws."""
        del rng
        return {}

    def advance(self, robots: R, /) -> None:
        """Count a tick: a task with a memory writes it here."""

    def observe(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """What `fields` says, by name: (N,) or (N, size) each, in its unit; it is clipped to its bounds."""
        del robots
        return {}

    def write(self, rules: Any) -> None:  # noqa: ANN401 - a record of the task's rules
        """Write what the engine draws and plays of this task into its rules."""
        del rules

    @property
    def is_own(self) -> bool:
        """Whether it is a task of the user's, not of this package."""
        return not type(self).__module__.startswith("spidar_gym.tasks.")

    @property
    def refers(self) -> bool:
        """Whether what the controllers are to do, or what is shown of it, is the task's and not the schedule's."""
        return any(hasattr(self, name) and self.overrides(name) for name in ("reference", "preview"))

    def overrides(self, method: str) -> bool:
        """Whether a method is of a class outside this package."""
        owner = next(kind for kind in type(self).__mro__ if method in vars(kind))
        return not owner.__module__.startswith("spidar_gym.tasks.")


def require_ranges(task: Task[Any], ranges: Mapping[str, tuple[float, float, str]]) -> None:
    """Refuse options outside their ranges, and make whole numbers real ones (`InvalidValueError`).

    Args:
        task: Whose options; one may be None where its class has that as its default.
        ranges: Least and largest number, and unit, by option.
    """
    for name, bounds in ranges.items():
        is_optional = any(vars(kind).get(name, task) is None for kind in type(task).__mro__)
        if getattr(task, name) is not None or not is_optional:
            require_within(*bounds, **{name: getattr(task, name)})
            object.__setattr__(task, name, float(getattr(task, name)))


def write_constants(rules: Any, page: Mapping[str, Any], names: str) -> None:  # noqa: ANN401 - a record
    """Write a page's constants into rules that have the same names in small letters.

    Args:
        rules: A record of the task's rules.
        page: The module's names, `globals()`.
        names: Of these constants, in small letters.
    """
    for name in names.split():
        rules[name] = page[name.upper()]


def length(v: np.ndarray) -> np.ndarray:
    """Euclidean lengths of vectors (N, …): (N,)."""
    return np.sqrt(square(v))


def square(v: np.ndarray) -> np.ndarray:
    """Squared lengths, each summed in the same order however many there are."""
    return np.square(v, order="C").sum(axis=1)


def tolerance(error: np.ndarray, margin: float) -> np.ndarray:
    """1 at no error, ½ at `margin`, falling towards 0: 1 / (1 + (error / margin)²)."""
    ratio = error / margin
    return 1.0 / (1.0 + ratio * ratio)


def check_weights(task: Task[Any]) -> bool:
    """Whether the weights add up to 1."""
    return math.isclose(sum(weight for weight, _ in task.reward_terms.values()), 1.0)


def checked_array(name: str, given: object, shape: tuple[int, ...], kinds: str = REAL) -> np.ndarray:
    """A task's answer: an array of a kind and shape, (N,) for (N, 1) too (`InvalidValueError` for another)."""
    if isinstance(given, np.ndarray) and given.shape == shape and given.dtype.char in kinds:
        return given
    expected = f"an array of shape {shape} of {'booleans' if kinds == '?' else 'real numbers'}"
    try:
        array = np.asarray(given)
    except Exception:  # rows of several lengths, and foreign `__array__`
        raise InvalidValueError(name, given, expected) from None
    if array.dtype.char not in kinds:
        raise InvalidValueError(name, f"{array.dtype}", expected)
    if array.shape != shape and (array.shape != shape[:1] or shape[1:] != (1,)):
        raise InvalidValueError(name, array.shape, expected)
    return array.reshape(shape)


def require_finite(name: str, values: np.ndarray, diverged: np.ndarray) -> None:
    """Refuse numbers (N, …) that are not finite for a robot that has not diverged (`InvalidValueError`)."""
    if np.isfinite(values).all():
        return
    whole = np.isfinite(values).reshape(len(values), -1).all(axis=1) | (diverged != 0)
    if not whole.all():
        robot = int(np.argmin(whole))
        raise InvalidValueError(
            name, values[robot].tolist(), f"finite numbers for every robot, and so for robot {robot}"
        )
