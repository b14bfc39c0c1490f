"""Progress of a run: a progress bar for each stage, the wall time of each part, and scalars for TensorBoard."""

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from typing import Any, TypeVar

from tqdm import tqdm

from spidar_gym.console import progress
from train.lib.evaluate import Verdict

T = TypeVar("T")


class Stages(AbstractContextManager["Stages"]):
    """Context manager that shows one progress bar per stage of a run and measures the wall time of its parts."""

    def __init__(self, run: str, parts: dict[str, float]) -> None:
        """Store the run's name and the wall times so far.

        Args:
            run: Name of the run.
            parts: Wall time of each part so far [s], updated in place: validation, flights, learner, rest; for PPO
                and SAC also engine, environment and policy.
        """
        self._run, self._latest = run, ""
        self._parts, self._part, self._since = parts, "rest", time.perf_counter()
        self._bar: tqdm = tqdm(disable=True)

    def __exit__(self, *_: object) -> None:
        """End the last stage."""
        self.clock()
        self._bar.close()

    def begin(self, stage: str, total: int, unit: str, part: str, done: int = 0) -> None:
        """End the current stage and begin another.

        Args:
            stage: Description of the new stage.
            total: Number of units in the stage.
            unit: Name of a unit.
            part: Part that the time is assigned to.
            done: Number of units that an interrupted run has already done.
        """
        self._bar.close()
        self._bar = progress(total=total, initial=done, unit=unit, unit_scale=unit == "tick", desc="")
        self.say(stage, part)

    def clock(self) -> None:
        """Add the time since the last call to the current part."""
        now = time.perf_counter()
        self._parts[self._part] = self._parts.get(self._part, 0.0) + now - self._since
        self._since = now

    def hand_over(self, parts: Mapping[str, float]) -> None:
        """Move the given times [s] from the current part to other parts."""
        for part, seconds in parts.items():
            self._parts[part] = self._parts.get(part, 0.0) + seconds
            self._parts[self._part] = self._parts.get(self._part, 0.0) - seconds

    def each(self, stage: str, items: Iterable[T], total: int, unit: str, part: str) -> Iterator[T]:
        """Yield the items, as a stage that counts them."""
        self.begin(stage, total, unit, part)
        for item in items:
            yield item
            self.count()

    def say(self, stage: str, part: str) -> None:
        """Change a stage's description and current part without resetting its count; cheap if nothing changes."""
        if part != self._part:
            self.clock()
            self._part = part
        if (words := f"{self._run}: {stage}") != self._bar.desc.removesuffix(": "):
            self._bar.set_description(words, refresh=False)
            self._bar.set_postfix_str(self._latest)

    def count(self, units: int = 1) -> None:
        """Advance the bar by the given number of units."""
        self._bar.update(units)

    def evaluated(self, verdict: Verdict) -> None:
        """Store a verdict and show it in this and all later bars."""
        self._latest = f"against the base {verdict.score:+.1%}, worst {verdict.worst:+.1%}"
        self._bar.set_postfix_str(self._latest)


def scalars(line: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the entries of a learning curve's line as (name, value) pairs for TensorBoard."""
    for name in ("score", "worst", "success"):
        yield f"validation/{name}", line[name]
    for track, cell in line["cells"].items():
        for metric, value in cell.items():
            yield f"validation/{track}/{metric}", value
