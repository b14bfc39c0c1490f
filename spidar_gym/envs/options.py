"""Arguments of the environments: which ones there are, and what those that both take are made into."""

import inspect
from collections.abc import Collection
from typing import Any, Protocol, runtime_checkable

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.errors import (
    InvalidValueError,
    UnknownArgumentError,
    require_arguments,
    require_instance,
    require_least,
)
from spidar_gym.robot import RobotSpec
from spidar_gym.sim.config import PlantConfig

OF_VECTORS = ("num_threads", "autoreset_mode", "max_episode_steps")
"""Arguments that only a vector has."""
OF_ONE = ("control", "allocator", "law")
"""Arguments that only a single robot's environment has: the core flies a vector."""


@runtime_checkable
class Task(Protocol):
    """What every environment asks of its task, a frozen dataclass of options."""

    @property
    def horizon_s(self) -> float:
        """Length of an episode [s]."""
        ...


def option_names(shared: type, env: type, task: type) -> list[str]:
    """Names of all arguments: those of the task, of `env`, and of what all share."""
    named = [
        name
        for kind in (env, shared)
        for name, p in inspect.signature(kind.__init__).parameters.items()
        if p.default is not p.empty
    ]
    return [*inspect.signature(task).parameters, *named]


def split_options(
    shared: type, env: type, task: type, options: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments of the task, and the others (`UnknownArgumentError` lists all that there are)."""
    require_arguments(options, option_names(shared, env, task))
    own = inspect.signature(task).parameters
    return {k: v for k, v in options.items() if k in own}, {k: v for k, v in options.items() if k not in own}


def require_vector_options(shared: type, env: type, task: type, options: Collection[str]) -> None:
    """Raise `UnknownArgumentError` for what is no argument of a vector of this environment."""
    valid = [*OF_VECTORS, *(name for name in option_names(shared, env, task) if name not in OF_ONE)]
    for name in OF_ONE:
        if name in options:
            raise UnknownArgumentError(name, valid, "the core flies")
    require_arguments(options, valid)


def own_robot(plant: PlantConfig | None, robot: Any = None) -> PlantConfig:  # noqa: ANN401 - whatever a user gives
    """The simulated robot.

    Args:
        plant: One of the user's own; by default it is as described.
        robot: The description, as `RobotSpec.parse` takes it; the plant's by default, and else the nominal robot.

    Raises:
        InvalidValueError: For a plant of another robot.
    """
    if plant is None:
        return PlantConfig.of(RobotSpec.parse(robot))
    require_instance(PlantConfig, plant=plant)
    if robot is not None and plant.robot != RobotSpec.parse(robot):
        given = f"of a robot of {plant.robot.total_mass:.4g} kg"
        raise InvalidValueError("plant", given, "one of the robot that is given: PlantConfig.of(robot), changed")
    return plant


def described_robot(arguments: dict[str, Any]) -> RobotSpec:
    """The robot that arguments of an environment mean, which stands in them afterwards (errors as of `own_robot`)."""
    robot = own_robot(arguments.get("plant"), arguments.get("robot")).robot
    arguments["robot"] = robot
    return robot


def solver_settings(max_iter: int) -> AllocatorConfig:
    """Settings of the QP solver with an iteration cap of one's own."""
    require_least(1, max_iter=max_iter)
    return AllocatorConfig(max_iter=int(max_iter))
