"""Environments that are made anew at reset: with another argument of the task, or robots drawn in another way."""

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
    """What an environment is made of, and how `reset` changes that."""

    task_type: ClassVar[type[Any]]
    """Class of its task."""
    task: Any
    """What is to be done, a frozen dataclass of arguments."""
    layout: tuple[Field, ...]
    """What a policy sees, piece by piece."""
    hold: int
    """Control periods of a step."""
    reset_options: tuple[str, ...] = ("disturbances",)
    """Names of the options of `reset` beside the arguments that it takes anew."""
    view: View
    """How it is looked at."""
    turn: Turn
    """Orders the calls on it from several threads."""
    is_closed: bool = False
    """Whether `close` was called: nothing else can be from then on."""
    most_steps: int | None = None
    """Steps that whoever made it allows an episode; None where the task alone says."""
    truncates: bool = False
    """Whether an episode is truncated at its horizon."""
    ticks: int
    """Steps since the reset."""
    _arguments: dict[str, Any]
    """What it is made of, but for `_choices`."""
    _choices: dict[str, Any]
    """Arguments that `reset` changes without making it anew: what they are from now on."""
    _is_bare = False
    """Whether it has neither robot nor controller: it says what others in a vector are to do."""
    _kept: ClassVar[tuple[str, ...]] = ()
    """Attributes that options of `reset` set, and that no argument gives."""

    def __init_subclass__(cls) -> None:
        """Show the arguments of `__init__` to whoever asks for them, and not those of `__new__`."""
        super().__init_subclass__()
        _, *rest = inspect.signature(cls.__init__).parameters.values()
        cls.__signature__ = inspect.Signature(rest)

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401 - arguments of the class, an object of it
        """Keep what it is made of, so that `reset` can have another argument."""
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
        """Steps after which the episode ends, unless it fails before."""
        own = max(1, round(self.task.horizon_s * CONTROL_RATE / self.hold))
        if self.most_steps is None:
            return own
        is_given = "horizon_s" in self._arguments or self.task.horizon_s != self.task_type.horizon_s
        return min(self.most_steps, own) if is_given else self.most_steps

    @in_turn
    def end(self, max_episode_steps: int | None) -> None:
        """Say when an episode is truncated.

        Args:
            max_episode_steps: After how many steps, at most those of `horizon_s` where that was given; −1 for never;
                None for the task's `horizon_s`.

        Raises:
            InvalidValueError: For a number below 1 other than −1.
        """
        most = None if max_episode_steps == -1 else max_episode_steps
        if most is not None:
            require_least(1, max_episode_steps=most)
        self.truncates, self.most_steps = max_episode_steps != -1, None if most is None else int(most)
        # It stays where a reset makes the environment anew, and goes before what was said when that was first made.
        self._arguments = {name: value for name, value in self._arguments.items() if name != "max_episode_steps"}

    @property
    def is_over(self) -> bool:
        """Whether the episode has come to its end."""
        return self.truncates and self.ticks >= self.horizon

    @property
    def reset_arguments(self) -> tuple[str, ...]:
        """Arguments that `reset` takes as options: those of the task, its own too, and how robots are drawn."""
        return (*(field.name for field in fields(self.task)), "randomization", "task")

    @abstractmethod
    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - whatever a user gives
        """Attributes that an option of `reset` sets from now on, and their values; refuses what is not valid."""

    @abstractmethod
    def _empty(self) -> None:
        """Let go of robot and controller."""

    def close(self) -> None:
        """Release window or OpenGL context, and what the controller holds; a second call does nothing."""
        with self.turn.lock:
            if not self.is_closed:
                self.is_closed = True
                self.view.close()
                self._empty()

    def variant(self, arguments: Mapping[str, Any]) -> Any:  # noqa: ANN401 - one of its own class
        """One of its kind with other arguments, which has neither robot nor controller: it says what others are to do.

        Args:
            arguments: Those that differ.

        Raises:
            UnknownNameError, InvalidValueError: For what is not valid.
        """
        kind, own = type(self), self._with(arguments)
        env = kind.__new__(kind, **own)
        env._is_bare, env.most_steps = True, self.most_steps
        env.__init__(**own)
        if env.layout != self.layout:
            raise InvalidValueError("task", env.task, "one with the fields of now: an observation keeps its size")
        env.view = self.view
        return env

    def _with(self, others: Mapping[str, Any]) -> dict[str, Any]:
        """All arguments, where some are others: options of a task of one's own are those of `task`."""
        arguments = self._arguments | self._choices | dict(others)
        task = find_task(arguments.get("task"), self.task_type)
        built_in = {field.name for field in fields(self.task_type)}
        own = {f.name: arguments.pop(f.name) for f in fields(task) if f.name in arguments and f.name not in built_in}
        if own:
            arguments["task"] = task(**own) if isinstance(task, type) else replace(task, **own)
        return arguments

    def _choose(self, options: object) -> dict[str, object]:
        """Attributes that options of `reset` set, and their values; it is made anew where its arguments are others."""
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
        trial = self.variant(made | others)  # what is not valid is refused here, and nothing has changed
        chosen = [trial._chosen(name, value) for name, value in own.items() if name not in made]
        kept = {name: getattr(self, name) for name in self._kept}
        self._empty()
        view = self.view
        self.__init__(**arguments)
        self._keep(arguments)
        self.view = view
        return kept | {name: value for each in chosen for name, value in each.items()}
