"""Settings in groups: a command line, a checkpoint and a sweep know every field of a recipe by its own name alone."""

import dataclasses
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import tyro

from spidar_gym.errors import require_least, require_name

CONTROL = "core"
"""Controller that training flies with: the compiled one."""


@dataclass(frozen=True)
class OutputConfig:
    """What a run leaves behind."""

    out: Path = Path("out/train")
    """Folder for runs: NAME/seedK."""
    row: bool = True
    """Evaluate on the test scenarios in the end and write a row of this seed."""


@dataclass(frozen=True)
class ScheduleConfig:
    """How long it learns, and in which portions."""

    steps: int = 500_000
    """Control ticks to learn from."""
    first_steps: int = 0
    """Ticks on `first_tracks`, before it learns on all."""
    segment: int = 32_768
    """Ticks between two checkpoints, each with a validation."""
    envs: int = 16
    """Robots side by side."""
    threads: int = 2
    """Threads that carry them; no number depends on how many."""
    scaling_ticks: int = 2000
    """Ticks of the baseline in each kind of environment from which the observations' scaling is taken."""

    def __post_init__(self) -> None:
        require_least(1, **{name: value for name, value in vars(self).items() if name != "first_steps"})
        require_least(0, first_steps=self.first_steps)


@dataclass(frozen=True)
class EvaluationConfig:
    """How agents are compared with the base, and which one is taken."""

    scenarios: int = 6
    """Validation scenarios of each track."""
    select: bool = True
    """Take the best admissible agent of all validations; else the last one."""

    def __post_init__(self) -> None:
        require_least(1, scenarios=self.scenarios)


@dataclass(frozen=True)
class Recipe:
    """What the settings of every recipe have."""

    name: str
    """Name of the row: letters, digits, _ and -."""
    doc: str
    """What is learned, in one line."""
    _: KW_ONLY
    seed: int = 0
    """Seed of everything that is drawn."""
    output: OutputConfig = dataclasses.field(default_factory=OutputConfig)

    def __post_init__(self) -> None:
        require_least(0, seed=self.seed)


@dataclass(frozen=True)
class TrackRecipe(Recipe):
    """What the settings of a recipe for one kind of tracks and one action mode have."""

    action_mode: ClassVar[str]
    """Action mode that it learns in."""

    tracks: tuple[str, ...]
    """Tracks in whose kinds of environments it learns, and on whose validation scenarios it is evaluated."""
    base: str
    """Preset of the controller that it adds to."""
    _: KW_ONLY
    control: str = CONTROL
    """python, or core: the compiled controller, several times faster."""

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of `gym.make`."""
        return {"action_mode": self.action_mode, "preset": self.base}


T = TypeVar("T")
R = TypeVar("R", bound=Recipe)


def parse(presets: Mapping[str, R], prog: str, description: str | None) -> R:
    """The settings of a command line: a preset's, and what the options change; groups have no part in their names."""
    options = {name: (settings.doc, settings) for name, settings in presets.items()}
    return tyro.extras.overridable_config_cli(
        options, prog=prog, description=description, config=(tyro.conf.OmitArgPrefixes,)
    )


def flatten(settings: object, *left_out: type) -> dict[str, Any]:
    """Every field by name, without its group, but for groups that are left out."""
    assert dataclasses.is_dataclass(settings)
    found: dict[str, Any] = {}
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if not isinstance(value, left_out):
            found |= flatten(value, *left_out) if dataclasses.is_dataclass(value) else {field.name: value}
    return found


def override(settings: T, **changes: Any) -> T:  # noqa: ANN401 - of any field
    """The same settings with other values of some fields, whichever group each is in.

    Raises:
        UnknownNameError: For a field that no group has.
    """
    for name in changes:
        require_name("setting", name, flatten(settings))
    return _override(settings, changes)


def _override(settings: T, changes: Mapping[str, Any]) -> T:
    """The settings with what they and their groups have of the changes."""
    assert dataclasses.is_dataclass(settings)
    assert not isinstance(settings, type)
    values = {}
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            values[field.name] = _override(value, changes)
        elif field.name in changes:
            values[field.name] = changes[field.name]
    return dataclasses.replace(settings, **values)
