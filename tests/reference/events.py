"""Events between physics steps as data: name, due step, action, and whether a robot needs the event."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from reference.plant_memory import PlantMemory

NEVER = 2**62
"""A physics step that is never reached."""
PlantT = TypeVar("PlantT")


@dataclass(frozen=True, slots=True)
class Event(Generic[PlantT]):
    """An action between two physics steps."""

    name: str
    """Name of the event."""
    due: Callable[[PlantMemory], int]
    """Memory → the next physics step after which the event runs."""
    run: Callable[[PlantT], None]
    """Its action on the plant."""
    needed: Callable[[PlantT], bool]
    """Whether this robot and this episode need the event; evaluated by `reset` and `restore`."""


def every(steps: int) -> Callable[[PlantMemory], int]:
    """Due at multiples of `steps` physics steps."""
    return lambda memory: memory.clock + steps - memory.clock % steps


def next_arrival(memory: PlantMemory) -> int:
    """Due when the next pending command arrives."""
    return min([due for due, _, _ in memory.pending], default=NEVER)
