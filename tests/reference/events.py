"""What happens between physics steps, as data: name, when it is due, what it does, who needs it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from reference.plant_memory import PlantMemory

NEVER = 2**62
"""A physics step that does not come."""
PlantT = TypeVar("PlantT")


@dataclass(frozen=True, slots=True)
class Event(Generic[PlantT]):
    """One thing that happens between two physics steps."""

    name: str
    """What it is called."""
    due: Callable[[PlantMemory], int]
    """Memory → the next physics step after which it happens."""
    run: Callable[[PlantT], None]
    """What it does to the plant."""
    needed: Callable[[PlantT], bool]
    """Whether this robot and this episode need it; asked at a reset and where a moment is restored."""


def every(steps: int) -> Callable[[PlantMemory], int]:
    """Due at multiples of so many physics steps."""
    return lambda memory: memory.clock + steps - memory.clock % steps


def next_arrival(memory: PlantMemory) -> int:
    """Due when the next command on its way arrives."""
    return min([due for due, _, _ in memory.pending], default=NEVER)
