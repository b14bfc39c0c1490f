"""Rebuilding of an environment when `reset` changes arguments of its task or its randomisation."""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import Field
from spidar_gym.envs.locking import in_turn
from spidar_gym.envs.options import find_task
from spidar_gym.envs.view import View
from spidar_gym.errors import InvalidValueError, require_keys, require_least
from spidar_gym.turn import Turn


class Resettable(ABC):
    """Arguments of an environment, and their change by `reset`."""

    task_type: ClassVar[type[Any]]
    """Class of the task."""
    task: Any
    """The task, a frozen dataclass of arguments."""
    layout: tuple[Field, ...]
    """Fields of the observation, in order."""
    hold: int
    """Control periods per step."""
    reset_options: tuple[str, ...] = ("disturbances",)
    """Names of the options of `reset` that need no rebuilding."""
    view: View
    """Renderer."""
    turn: Turn
    """Lock that serialises calls from several threads."""
    is_closed: bool = False
    """Whether `close` was called; other calls then raise `SpidarError`."""
    most_steps: int | None = None
    """Limit of an episode's steps from `max_episode_steps`; None if only the task's `horizon_s` applies."""
    truncates: bool = False
    """Whether an episode is truncated at its horizon."""
    ticks: int
    """Steps since the reset."""
    _arguments: dict[str, Any]
    """Arguments of the constructor without `_choices`."""
    _choices: dict[str, Any]
    """Current values of the arguments that `reset` changes without rebuilding."""
    _is_bare = False
    """Whether it has neither robot nor controller, and only provides the rules for robots of a vector."""
    _kept: ClassVar[tuple[str, ...]] = ()
    """Attributes that only options of `reset` set, not arguments."""

    def __init_subclass__(cls) -> None:
        """Set the signature to that of `__init__`; `inspect` would show that of `__new__`."""
        super().__init_subclass__()
        _, *rest = inspect.signature(cls.__init__).parameters.values()
        cls.__signature__ = inspect.Signature(rest)

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401 - arguments of the class, an object of it
        """Store the arguments, so that `reset` can rebuild the environment with others."""
        del args
        env = super().__new__(cls)
        env.turn = Turn()
        env._keep(kwargs)
        return env

    def _keep(self, arguments: Mapping[str, Any]) -> None:
        self._choices = {name: value for name, value in arguments.items() if name in self.reset_options}
        self._arguments = {name: value for name, value in arguments.items() if name not in self._choices}

    @property
    def horizon(self) -> int:
        """Steps after which the episode is truncated."""
        own = max(1, round(self.task.horizon_s * CONTROL_RATE / self.hold))
        if self.most_steps is None:
            return own
        is_given = "horizon_s" in self._arguments or self.task.horizon_s != self.task_type.horizon_s
        return min(self.most_steps, own) if is_given else self.most_steps

    @in_turn
    def end(self, max_episode_steps: int | None) -> None:
        """Set the number of steps after which an episode is truncated.

        Args:
            max_episode_steps: Number of steps, at most those of `horizon_s` if that was given; −1 for never; None for
                the task's `horizon_s`.

        Raises:
            InvalidValueError: For a number below 1 other than −1.
        """
        most = None if max_episode_steps == -1 else max_episode_steps
        if most is not None:
            require_least(1, max_episode_steps=most)
        self.truncates, self.most_steps = max_episode_steps != -1, None if most is None else int(most)
        # A rebuilding reset keeps this value, which overrides the argument of the constructor.
        self._arguments = {name: value for name, value in self._arguments.items() if name != "max_episode_steps"}

    @property
    def is_over(self) -> bool:
        """Whether the episode is truncated."""
        return self.truncates and self.ticks >= self.horizon

    @property
    def reset_arguments(self) -> tuple[str, ...]:
        """Arguments that are also options of `reset`: those of the task, a custom one's too, and the randomisation."""
        return (*(field.name for field in fields(self.task)), "randomization", "task")

    @abstractmethod
    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - user input
        """Return the attributes that an option of `reset` sets, with their values; raise for an invalid value."""

    @abstractmethod
    def _empty(self) -> None:
        """Release the robot and the controller."""

    def close(self) -> None:
        """Release the window or OpenGL context, the robot and the controller; a second call does nothing."""
        with self.turn.lock:
            if not self.is_closed:
                self.is_closed = True
                self.view.close()
                self._empty()

    def variant(self, arguments: Mapping[str, Any]) -> Any:  # noqa: ANN401 - one of its own class
        """Return an environment with some other arguments, without robot and controller, to take rules from.

        Args:
            arguments: Arguments that differ.

        Raises:
            UnknownNameError, InvalidValueError: For an argument that is not valid.
        """
        kind, own = type(self), self._with(arguments)
        env = kind.__new__(kind, **own)
        env._is_bare, env.most_steps = True, self.most_steps
        env.__init__(**own)
        if env.layout != self.layout:
            raise InvalidValueError("task", env.task, "a task with the same fields: an observation keeps its size")
        env.view = self.view
        return env

    def _with(self, others: Mapping[str, Any]) -> dict[str, Any]:
        """Merge new values into the arguments; options of a custom task are merged into `task`."""
        arguments = self._arguments | self._choices | dict(others)
        task = find_task(arguments.get("task"), self.task_type, arguments.get("reward"))
        built_in = {field.name for field in fields(self.task_type)}
        own = {f.name: arguments.pop(f.name) for f in fields(task) if f.name in arguments and f.name not in built_in}
        if own:
            arguments.pop("reward", None)
            arguments["task"] = task(**own) if isinstance(task, type) else replace(task, **own)
        return arguments

    def _choose(self, options: object) -> dict[str, object]:
        """Return the attributes that options of `reset` set, with their values; rebuild for changed arguments."""
        names = (*self.reset_options, *self.reset_arguments)
        given = require_keys("options", "reset option", options, dict.fromkeys(names))
        own = {name: value for name, value in given.items() if name in self.reset_options}
        others = {name: value for name, value in given.items() if name not in own}
        made = {name: value for name, value in own.items() if name in (*self.reset_arguments, "disturbances")}
        if not others:
            chosen = [self._chosen(name, value) for name, value in own.items()]
            self._choices = self._choices | made
            return {name: value for each in chosen for name, value in each.items()}
        arguments = self._with(made | others)
        trial = self.variant(made | others)  # raises for invalid values before anything is changed
        chosen = [trial._chosen(name, value) for name, value in own.items() if name not in made]
        kept = {name: getattr(self, name) for name in self._kept}
        self._empty()
        view = self.view
        self.__init__(**arguments)
        self._keep(arguments)
        self.view = view
        return kept | {name: value for each in chosen for name, value in each.items()}
