"""Progress of a run: a bar for each stage in its own unit, where its time goes, and figures for TensorBoard."""

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from typing import Any, TypeVar

from tqdm import tqdm

from spidar_gym.cli.console import progress
from train.lib.evaluate import Verdict

T = TypeVar("T")


class Stages(AbstractContextManager["Stages"]):
    """The bars of a run, one after the other, for as long as the context lasts, and the time of its parts."""

    def __init__(self, run: str, parts: dict[str, float]) -> None:
        """Take the run's name and its parts.

        Args:
            run: Name of the run.
            parts: Wall time of each part so far [s], which goes on: validation, flights, learner, rest; of PPO and SAC
                also engine, environment and policy.
        """
        self._run, self._latest = run, ""
        self._parts, self._part, self._since = parts, "rest", time.perf_counter()
        self._bar: tqdm = tqdm(disable=True)

    def __exit__(self, *_: object) -> None:
        """End the last stage."""
        self.clock()
        self._bar.close()

    def begin(self, stage: str, total: int, unit: str, part: str, done: int = 0) -> None:
        """End a stage and begin another one.

        Args:
            stage: What is done in it.
            total: How many units it takes.
            unit: What it counts.
            part: Whose time it is.
            done: How many of them an interrupted run has done.
        """
        self._bar.close()
        self._bar = progress(total=total, initial=done, unit=unit, unit_scale=unit == "tick", desc="")
        self.say(stage, part)

    def clock(self) -> None:
        """Write the time since the last look down to the present part."""
        now = time.perf_counter()
        self._parts[self._part] = self._parts.get(self._part, 0.0) + now - self._since
        self._since = now

    def hand_over(self, parts: Mapping[str, float]) -> None:
        """So much of the present part's time was other parts' [s]."""
        for part, seconds in parts.items():
            self._parts[part] = self._parts.get(part, 0.0) + seconds
            self._parts[self._part] = self._parts.get(self._part, 0.0) - seconds

    def each(self, stage: str, items: Iterable[T], total: int, unit: str, part: str) -> Iterator[T]:
        """The items one by one, as a stage that counts them."""
        self.begin(stage, total, unit, part)
        for item in items:
            yield item
            self.count()

    def say(self, stage: str, part: str) -> None:
        """Say what is being done, and whose time it is, while the count goes on; next to free if that is said."""
        if part != self._part:
            self.clock()
            self._part = part
        if (words := f"{self._run}: {stage}") != self._bar.desc.removesuffix(": "):
            self._bar.set_description(words, refresh=False)
            self._bar.set_postfix_str(self._latest)

    def count(self, units: int = 1) -> None:
        """Count units that are done."""
        self._bar.update(units)

    def evaluated(self, verdict: Verdict) -> None:
        """Remember a verdict, and show it from now on."""
        self._latest = f"against the base {verdict.score:+.1%}, worst {verdict.worst:+.1%}"
        self._bar.set_postfix_str(self._latest)


def scalars(line: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """A line of a learning curve, for TensorBoard: name and value."""
    for name in ("score", "worst", "success"):
        yield f"validation/{name}", line[name]
    for track, cell in line["cells"].items():
        for metric, value in cell.items():
            yield f"validation/{track}/{metric}", value
