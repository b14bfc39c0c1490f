"""Arguments of the environments: which ones there are, and what those that both take are made into."""

import inspect
from typing import Any, Protocol, runtime_checkable

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.errors import require_instance, require_least, require_name
from spidar_gym.sim.config import PlantConfig


@runtime_checkable
class Task(Protocol):
    """What every environment asks of its task, a frozen dataclass of options."""

    @property
    def horizon_s(self) -> float:
        """Length of an episode [s]."""
        ...


def split_options(
    shared: type, env: type, task: type, options: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments of the task, and those of `env` and of what all share (`UnknownNameError` lists all that there are)."""
    own = list(inspect.signature(task).parameters)
    named, common = (
        [name for name, p in inspect.signature(kind.__init__).parameters.items() if p.default is not p.empty]
        for kind in (env, shared)
    )
    for name in options:
        require_name("option", name, own + named + common)
    return {k: v for k, v in options.items() if k in own}, {k: v for k, v in options.items() if k not in own}


def own_robot(plant: PlantConfig | None) -> PlantConfig:
    """The simulated robot that was given, or the nominal one."""
    plant = PlantConfig() if plant is None else plant
    require_instance(PlantConfig, plant=plant)
    return plant


def solver_settings(max_iter: int) -> AllocatorConfig:
    """Settings of the QP solver with an iteration cap of one's own."""
    require_least(1, max_iter=max_iter)
    return AllocatorConfig(max_iter=int(max_iter))
