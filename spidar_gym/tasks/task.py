"""Base class of tasks: options, reward terms, failures and success, for N robots at once, and optional methods."""

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
    """Goal, reward and end of the robots' episodes.

    The fields of the dataclass are arguments of the environment and options of its `reset`. Each method is called once
    per tick for all robots. The result for one robot must not depend on other robots: use no matrix products over
    robots, and sample random numbers only in `draw` and `start`.

    Every returned value is checked. One of the wrong type or shape, or one that is not finite for a robot that has not
    diverged, raises an `InvalidValueError` with the task, method, term and robot. Exceptions of a method itself are not
    caught. In a step the robots have already moved when an error is raised: call `reset` then.
    """

    robots: ClassVar[type[Robots]]
    """Class of the methods' argument."""
    reward_terms: ClassVar[Mapping[str, tuple[float, str]]]
    """Weight and formula of each term; the weights add up to 1."""
    failures: ClassVar[Mapping[str, str]]
    """Name and meaning of each failure, in the order of their codes; the engine itself detects `diverged`."""
    stops: ClassVar[Mapping[str, float]] = {}
    """Limits of quantities; above one the engine ends a step of several control periods early."""
    memory: ClassVar[tuple[tuple[Any, ...], ...]] = ()
    """Variables that the task stores for each robot, as NumPy fields: name, type, shape; zero at the start."""
    fields: ClassVar[tuple[Field, ...]] = ()
    """Additional fields at the end of the environment's observation."""
    ends_with_success: ClassVar[bool] = False
    """Whether an episode ends, terminated without a failure, when the robot has succeeded."""
    loads: ClassVar[bool] = False
    """Whether the task attaches loads (`Robots.load`); each robot then has its own simulation model."""

    @abstractmethod
    def terms(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Return the reward terms (N,), any finite numbers; the reward is their sum weighted with `reward_terms`."""

    @abstractmethod
    def failed(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Return flags (N,) by the names in `failures`; the first that is set is the reported failure."""

    @abstractmethod
    def succeeded(self, robots: R, /) -> np.ndarray:
        """Return which robots have succeeded (N,), booleans."""

    def tell(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Return the task's entries of `info`, by name (N,)."""
        del robots
        return {}

    def draw(self, rng: np.random.Generator) -> Mapping[str, Any]:
        """Sample initial values of `memory` for a robot's episode, after all samples of the environment."""
        del rng
        return {}

    def advance(self, robots: R, /) -> None:
        """Update the memory, once per tick."""

    def observe(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Return the values of `fields` by name, (N,) or (N, size), in their units, clipped to their bounds."""
        del robots
        return {}

    def write(self, rules: Any) -> None:  # noqa: ANN401 - a record of the task's rules
        """Write the options and constants that the engine needs into `rules`."""
        del rules

    @property
    def is_own(self) -> bool:
        """Whether the task is a custom task, defined outside this package."""
        return not type(self).__module__.startswith("spidar_gym.tasks.")

    @property
    def refers(self) -> bool:
        """Whether a custom task overrides `reference` or `preview` of the schedule."""
        return any(hasattr(self, name) and self.overrides(name) for name in ("reference", "preview"))

    def overrides(self, method: str) -> bool:
        """Return whether a method is defined in a class outside this package."""
        owner = next(kind for kind in type(self).__mro__ if method in vars(kind))
        return not owner.__module__.startswith("spidar_gym.tasks.")


def require_ranges(task: Task[Any], ranges: Mapping[str, tuple[float, float, str]]) -> None:
    """Require options to lie within their ranges, and convert them to floats (`InvalidValueError`).

    Args:
        task: The task; an option may be None if None is its default.
        ranges: Least and largest value, and unit, by option.
    """
    for name, bounds in ranges.items():
        is_optional = any(vars(kind).get(name, task) is None for kind in type(task).__mro__)
        if getattr(task, name) is not None or not is_optional:
            require_within(*bounds, **{name: getattr(task, name)})
            object.__setattr__(task, name, float(getattr(task, name)))


def write_constants(rules: Any, page: Mapping[str, Any], names: str) -> None:  # noqa: ANN401 - a record
    """Copy a task module's constants into the fields of `rules` with the same names in lower case.

    Args:
        rules: A record of the task's rules.
        page: `globals()` of the module.
        names: Names of the constants in lower case, separated by spaces.
    """
    for name in names.split():
        rules[name] = page[name.upper()]


def length(v: np.ndarray) -> np.ndarray:
    """Return Euclidean lengths (N,) of vectors (N, …)."""
    return np.sqrt(square(v))


def square(v: np.ndarray) -> np.ndarray:
    """Return squared lengths; the order of each sum does not depend on the number of vectors."""
    return np.square(v, order="C").sum(axis=1)


def tolerance(error: np.ndarray, margin: float) -> np.ndarray:
    """Return 1 / (1 + (error / margin)²): 1 at no error, ½ at `margin`, falling towards 0."""
    ratio = error / margin
    return 1.0 / (1.0 + ratio * ratio)


def check_weights(task: Task[Any]) -> bool:
    """Return whether the weights of the reward add up to 1."""
    return math.isclose(sum(weight for weight, _ in task.reward_terms.values()), 1.0)


def checked_array(name: str, given: object, shape: tuple[int, ...], kinds: str = REAL) -> np.ndarray:
    """Return a task's result as an array of a type and shape (`InvalidValueError`); (N,) is valid for (N, 1)."""
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
    """Require values (N, …) to be finite for every robot that has not diverged (`InvalidValueError`)."""
    if np.isfinite(values).all():
        return
    whole = np.isfinite(values).reshape(len(values), -1).all(axis=1) | (diverged != 0)
    if not whole.all():
        robot = int(np.argmin(whole))
        raise InvalidValueError(
            name, values[robot].tolist(), f"finite numbers for every robot, and so for robot {robot}"
        )
