"""Settings in groups; command lines, checkpoints and sweeps address each field by its name, without the group."""

import dataclasses
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import tyro

from spidar_gym.errors import require_least, require_name

CONTROL = "core"
"""Controller implementation used in training: the compiled one."""


@dataclass(frozen=True)
class OutputConfig:
    """Outputs of a run."""

    out: Path = Path("out/train")
    """Folder for runs; each run is stored in NAME/seedK below it."""
    row: bool = True
    """Whether to evaluate on the test scenarios at the end and write a leaderboard row for this seed."""


@dataclass(frozen=True)
class ScheduleConfig:
    """Length of training and its division into segments."""

    steps: int = 500_000
    """Length of training [control ticks], summed over all robots."""
    first_steps: int = 0
    """Length of the first phase on `first_tracks` [control ticks], before training on all tracks."""
    segment: int = 32_768
    """Length of a segment [control ticks]; each ends with a validation and a checkpoint."""
    envs: int = 16
    """Number of robots simulated in parallel."""
    threads: int = 2
    """Threads that simulate the robots; the results do not depend on their number."""
    scaling_ticks: int = 2000
    """Control ticks flown with the baseline on each track to determine the scaling of the observations."""

    def __post_init__(self) -> None:
        require_least(1, **{name: value for name, value in vars(self).items() if name != "first_steps"})
        require_least(0, first_steps=self.first_steps)


@dataclass(frozen=True)
class EvaluationConfig:
    """Comparison of agents with the base, and selection of the final agent."""

    scenarios: int = 6
    """Number of validation scenarios of each track."""
    select: bool = True
    """Whether to keep the best admissible agent of all validations; otherwise the last one."""

    def __post_init__(self) -> None:
        require_least(1, scenarios=self.scenarios)


@dataclass(frozen=True)
class Recipe:
    """Settings common to all recipes."""

    name: str
    """Name of the row: letters, digits, _ and -."""
    doc: str
    """Description of the recipe, in one line."""
    _: KW_ONLY
    seed: int = 0
    """Seed of all random numbers of the run."""
    output: OutputConfig = dataclasses.field(default_factory=OutputConfig)

    def __post_init__(self) -> None:
        require_least(0, seed=self.seed)


@dataclass(frozen=True)
class TrackRecipe(Recipe):
    """Settings common to recipes for one environment and one action mode."""

    action_mode: ClassVar[str]
    """Action mode used in training."""

    tracks: tuple[str, ...]
    """Tracks that define the training environments and the validation scenarios."""
    base: str
    """Base controller, which the policy adds to, imitates or starts from."""
    _: KW_ONLY
    control: str = CONTROL
    """Controller implementation: python, or core, which is compiled and several times faster."""

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of `gym.make`."""
        return {"action_mode": self.action_mode, "preset": self.base}


T = TypeVar("T")
R = TypeVar("R", bound=Recipe)


def parse(presets: Mapping[str, R], prog: str, description: str | None) -> R:
    """Parse the command line: a preset, and options that override its fields; option names omit the groups."""
    options = {name: (settings.doc, settings) for name, settings in presets.items()}
    return tyro.extras.overridable_config_cli(
        options, prog=prog, description=description, config=(tyro.conf.OmitArgPrefixes,)
    )


def flatten(settings: object, *left_out: type) -> dict[str, Any]:
    """Return all fields by name, without their groups, except groups of the types `left_out`."""
    assert dataclasses.is_dataclass(settings)
    found: dict[str, Any] = {}
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if not isinstance(value, left_out):
            found |= flatten(value, *left_out) if dataclasses.is_dataclass(value) else {field.name: value}
    return found


def override(settings: T, **changes: Any) -> T:  # noqa: ANN401 - of any field
    """Return a copy of the settings with some fields changed, in any group.

    Raises:
        UnknownNameError: If no group has a field of that name.
    """
    for name in changes:
        require_name("setting", name, flatten(settings))
    return _override(settings, changes)


def _override(settings: T, changes: Mapping[str, Any]) -> T:
    """Apply the changes to the fields of the settings and, recursively, to those of their groups."""
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
