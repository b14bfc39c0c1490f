"""What tasks in NumPy over many robots share: what they are told of the robots, and what they say."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import Field
from spidar_gym.envs.fleet import Fleet
from spidar_gym.errors import REAL, InvalidValueError, SpidarError


class Robots(ABC):
    """What a task is told of N robots; its arrays have an entry for every robot, and are not to be written."""

    kind: ClassVar[str]
    """Struct of a robot."""
    counter: ClassVar[str]
    """Its member that counts the ticks of an episode."""

    def __init__(self, fleet: Fleet, memory: np.ndarray) -> None:
        """Look at the robots of a fleet, and at what the task keeps of them."""
        self.fleet, self.memory, self.robots = fleet, memory, fleet.robots
        rules = fleet.rules["rules"]
        self.horizon, self._size = int(rules["horizon"]), int(rules["mode"]["size"])

    def __len__(self) -> int:
        """How many."""
        return len(self.robots)

    @property
    def ticks(self) -> np.ndarray:
        """Ticks of the episode (N,)."""
        return self.robots[self.counter]

    @property
    def time(self) -> np.ndarray:
        """Time since its beginning (N,) [s]."""
        return self.ticks / CONTROL_RATE

    @cached_property
    def state(self) -> np.ndarray:
        """True states, records of `RobotState`'s fields, arrays in it flat: `state["position_w"]` is (N, 3) [m]."""
        return self.robots["plant"]["state"]

    @property
    def in_contact(self) -> np.ndarray:
        """Whether a part of the robot touches the floor (N,)."""
        return self.robots["plant"]["in_contact"] != 0

    @property
    def power(self) -> np.ndarray:
        """Electrical power (N,) [W]."""
        return self.robots["plant"]["power"]

    @property
    def payload(self) -> np.ndarray:
        """Mass of what the torso carries (N,) [kg]."""
        return self.robots["plant"]["config"]["body"]["payload_mass"]

    def load(self, ids: np.ndarray, mass: Any, position_b: Any = (0.0, 0.0, 0.0)) -> None:  # noqa: ANN401 - numbers or arrays
        """Let torsos carry point masses from the next tick on, until their episodes end; 0 kg puts them down.

        Args:
            ids: Whose, numbers or flags (N,).
            mass: [kg], one for all of them or one for each.
            position_b: Where, torso axes (3,) or (…, 3) [m].

        Raises:
            SpidarError: For a task that does not say that it `loads`.
            InvalidValueError: For a mass below 0, or numbers that are none.
        """
        if not self.fleet.has_own_copies:
            raise SpidarError("these robots share one model; valid: a task with loads = True")
        ids = np.flatnonzero(ids) if np.asarray(ids).dtype == bool else np.asarray(ids, int)
        mass, position = np.broadcast_to(mass, ids.shape), np.broadcast_to(position_b, (*ids.shape, 3))
        if not (np.isfinite(mass).all() and (mass >= 0.0).all() and np.isfinite(position).all()):
            raise InvalidValueError("load", (mass.tolist(), position.tolist()), "masses from 0 kg on, at numbers in m")
        if ids.size:
            self.fleet.load(ids, mass, position)

    @property
    def action(self) -> np.ndarray:
        """Last actions, in [−1, 1], (N, size of an action)."""
        return self.robots["episode"]["action"][:, : self._size]

    @abstractmethod
    def begin(self, task: Any, ids: np.ndarray) -> None:  # noqa: ANN401 - the task of these robots
        """Let a task take over robots whose episode the engine has begun."""

    def look(self, task: Any) -> None:  # noqa: ANN401, B027 - as above; there may be nothing to look at
        """Look at the robots once more, where what they are to do has moved on with the tick."""

    @abstractmethod
    def aim(self, task: Any) -> None:  # noqa: ANN401 - as above
        """Let a task say what the robots are to do in the next tick."""


R = TypeVar("R", bound=Robots)


class VectorTask(ABC, Generic[R]):
    """What robots are to do, and how well they do it.

    Each method is called once a tick for all robots. What one robot gets may not depend on the others: no products of
    matrices over robots, no draws but those of `draw`.

    What a method gives is checked where it enters: an answer of another kind or shape, or one that is not finite for a
    robot that has not diverged, is an `InvalidValueError` that names task, method, term and robot; what a method
    raises itself goes through unchanged. In a step the robots have moved by then: `reset` begins anew.
    """

    robots: ClassVar[type[Robots]]
    """What it is told of the robots."""
    reward_terms: Mapping[str, tuple[float, str]]
    """Weight and formula of each term; the weights add up to 1."""
    failures: Mapping[str, str]
    """Why an episode may be over, and what the words mean; `diverged` is the engine's own."""
    memory: tuple[tuple[Any, ...], ...] = ()
    """What the task keeps of a robot, as numpy has it: name, kind, shape; zero when an episode begins."""
    fields: tuple[Field, ...] = ()
    """What a policy sees besides what the environment shows, at the end of its observation."""
    loads: bool = False
    """Whether it has robots carry things (`Robots.load`): each then has a model of its own."""

    def draw(self, rng: np.random.Generator) -> Mapping[str, Any]:
        """Numbers of the memory that an episode begins with, drawn after all that the environment draws."""
        del rng
        return {}

    def observe(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """What `fields` says, by name: (N,) or (N, size) each, in its unit; it is clipped to its bounds."""
        del robots
        return {}

    @abstractmethod
    def advance(self, robots: R, /) -> None:
        """Count a tick; a task with a memory of its own writes it here, after `super().advance(robots)`."""

    @abstractmethod
    def terms(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Terms of the reward (N,), any finite numbers; the reward is their sum weighted with `reward_terms`."""

    @abstractmethod
    def failed(self, robots: R, /) -> Mapping[str, np.ndarray]:
        """Whose episode is over why (N,), booleans by word; the first that holds counts."""

    @abstractmethod
    def succeeded(self, robots: R, /) -> np.ndarray:
        """Who has done what was to be done (N,), booleans."""


def checked_array(name: str, given: object, shape: tuple[int, ...], kinds: str = REAL) -> np.ndarray:
    """A task's answer: an array of a kind and shape, (N,) for (N, 1) too (`InvalidValueError` for another)."""
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


def require_finite(name: str, values: np.ndarray, robots: np.ndarray) -> None:
    """Refuse numbers (N, …) that are not finite for a robot that has not diverged (`InvalidValueError`)."""
    if np.isfinite(values).all():
        return
    whole = np.isfinite(values).reshape(len(values), -1).all(axis=1) | (robots["plant"]["diverged"] != 0)
    if not whole.all():
        robot = int(np.argmin(whole))
        raise InvalidValueError(
            name, values[robot].tolist(), f"finite numbers for every robot, and so for robot {robot}"
        )


def checked_records(name: str, given: object, like: np.ndarray, robots: np.ndarray) -> np.ndarray:
    """Records that a task gives, of the kind of `like`, finite for robots that have not diverged."""
    if not (isinstance(given, np.ndarray) and given.dtype == like.dtype and given.shape == like.shape):
        raise InvalidValueError(
            name, getattr(given, "dtype", given), f"records of shape {like.shape} with the fields of the default"
        )
    # All at once: whole numbers read as floats are finite, but for negative ones.
    if not np.isfinite(np.ascontiguousarray(given).view(np.float64)).all():
        for member in given.dtype.names or ():
            if given[member].dtype.kind == "f":
                require_finite(f"{name}: {member}", given[member], robots)
    return given


def length(v: np.ndarray) -> np.ndarray:
    """Euclidean lengths of vectors (N, …): (N,)."""
    return np.sqrt(square(v))


def tolerance(error: np.ndarray, margin: float) -> np.ndarray:
    """1 at no error, ½ at `margin`, falling towards 0: 1 / (1 + (error / margin)²)."""
    ratio = error / margin
    return 1.0 / (1.0 + ratio * ratio)


def square(v: np.ndarray) -> np.ndarray:
    """Squared lengths, each summed in the same order however many there are."""
    return np.square(v, order="C").sum(axis=1)


def weighted(terms: np.ndarray, weights: list[float]) -> np.ndarray:
    """Sum of terms (N, k) with their weights, in order: (N,)."""
    return sum((weight * terms[:, k] for k, weight in enumerate(weights)), start=np.zeros(len(terms)))


def check_weights(task: VectorTask[Any]) -> bool:
    """Whether the weights add up to 1."""
    return math.isclose(sum(weight for weight, _ in task.reward_terms.values()), 1.0)
