"""Arguments of the environments: their names, and the parsing of task, robot and solver settings."""

import importlib
import inspect
from collections.abc import Collection, Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.errors import (
    InvalidValueError,
    UnknownArgumentError,
    require_arguments,
    require_instance,
    require_least,
    require_name,
)
from spidar_gym.robot import RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.tasks.sloped import REWARDS, SLOPED
from spidar_gym.tasks.task import Task, check_weights

TaskT = TypeVar("TaskT", bound=Task[Any])
OF_VECTORS = ("num_threads", "autoreset_mode", "max_episode_steps")
"""Arguments that only a vector has."""
OF_ONE = ("control", "allocator", "law")
"""Arguments that only a single robot's environment has, since the core controls every robot of a vector."""


def option_names(shared: type, env: type, task: type) -> list[str]:
    """Return the names of all arguments: those of the task, of `env`, and of `shared`."""
    named = [
        name
        for kind in (env, shared)
        for name, p in inspect.signature(kind.__init__).parameters.items()
        if p.default is not p.empty
    ]
    return [*dict.fromkeys([*inspect.signature(task).parameters, *named])]


def make_task(
    shared: type, env: type, built_in: type[TaskT], options: Mapping[str, Any], known: Mapping[str, Any] | None = None
) -> tuple[TaskT, dict[str, Any]]:
    """Make the task of an environment, and return it with the remaining arguments.

    Args:
        shared: Base class of all environments.
        env: Class of the environment.
        built_in: Class of its task; `options["task"]` may be an object of a class derived from it.
        options: All arguments but those of `env` itself.
        known: Values of task arguments that replace the task's defaults.

    Raises:
        UnknownArgumentError: For an argument that does not exist; it lists the valid ones.
        InvalidValueError: For a task of other robots, weights that do not add up to 1, failures without `diverged`.
    """
    given = find_task(options.get("task"), built_in, options.get("reward"))
    kind = given if isinstance(given, type) else type(given)
    require_arguments(options, option_names(shared, env, kind))
    names = {field.name: field.default for field in fields(kind)}
    own = {name: value for name, value in options.items() if name in names}
    rest = {name: value for name, value in options.items() if name not in names and name != "task"}
    told = dict(known or {})
    if not isinstance(given, type):
        told = {name: value for name, value in told.items() if getattr(given, name) == names[name]}
    task = given(**told | own) if isinstance(given, type) else replace(given, **told | own)
    if not check_weights(task):
        raise InvalidValueError("reward_terms", dict(task.reward_terms), "weights that add up to 1")
    if "diverged" not in task.failures:
        raise InvalidValueError("failures", list(task.failures), "failures with diverged, which the engine reports")
    arguments = {*option_names(shared, env, built_in)} - {field.name for field in fields(built_in)}
    twice = sorted(arguments & {*names})
    if twice:
        raise InvalidValueError("task", kind.__name__, f"a task without options named {', '.join(twice)}")
    return task, rest


def find_task(task: object, built_in: type[TaskT], reward: str | None = None) -> TaskT | type[TaskT]:
    """Return a task as an object or a class.

    Args:
        task: Custom task: an object, a class, or a name `module:Class`; None for `built_in`.
        built_in: The environment's own task.
        reward: One of `REWARDS`, which selects the terms of a task that is not a custom one.

    Raises:
        UnknownNameError: For a reward that does not exist; it lists the valid ones.
        InvalidValueError: For a name of no class, a task of other robots, and a reward beside a custom task.
    """
    if reward is not None:
        require_name("reward", reward, REWARDS)
    if task is None:
        return SLOPED[built_in] if reward == "sloped" else built_in  # pyright: ignore[reportReturnType] - derived
    if reward is not None:
        raise InvalidValueError("reward", reward, "none with a custom task, which has its own terms")
    found = task
    if isinstance(task, str):
        module, _, name = task.partition(":")
        try:
            found = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise InvalidValueError("task", task, f"module:Class of an importable task ({error})") from None
    if not issubclass(found if isinstance(found, type) else type(found), built_in):
        raise InvalidValueError("task", task, f"an object of a class derived from {built_in.__name__}")
    return found  # pyright: ignore[reportReturnType] - checked above


def require_vector_options(shared: type, env: type, task: type, options: Collection[str]) -> None:
    """Require options to be arguments of a vector of this environment (`UnknownArgumentError`)."""
    valid = [*dict.fromkeys([*OF_VECTORS, *(n for n in option_names(shared, env, task) if n not in OF_ONE)])]
    for name in OF_ONE:
        if name in options:
            raise UnknownArgumentError(name, valid, "the core controls every robot of a vector")
    require_arguments(options, valid)


def own_robot(plant: PlantConfig | None, robot: Any = None) -> PlantConfig:  # noqa: ANN401 - user input
    """Return the simulated robot.

    Args:
        plant: Custom simulated robot; by default it equals the description.
        robot: The description, as `RobotSpec.parse` takes it; by default the plant's, or the nominal robot.

    Raises:
        InvalidValueError: For a plant of another robot.
    """
    if plant is None:
        return PlantConfig.of(RobotSpec.parse(robot))
    require_instance(PlantConfig, plant=plant)
    if robot is not None and plant.robot != RobotSpec.parse(robot):
        given = f"of a robot of {plant.robot.total_mass:.4g} kg"
        raise InvalidValueError("plant", given, "a plant of the given robot: PlantConfig.of(robot), changed")
    return plant


def described_robot(arguments: dict[str, Any]) -> RobotSpec:
    """Return the described robot and store it in the arguments as `robot` (errors as for `own_robot`)."""
    robot = own_robot(arguments.get("plant"), arguments.get("robot")).robot
    arguments["robot"] = robot
    return robot


def solver_settings(max_iter: int) -> AllocatorConfig:
    """Return settings of the QP solver with an iteration cap."""
    require_least(1, max_iter=max_iter)
    return AllocatorConfig(max_iter=int(max_iter))
