"""Progress of a run: a bar for each stage in its own unit, and the validations' figures for TensorBoard."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from typing import Any, TypeVar

from tqdm import tqdm

from spidar_gym.cli.console import progress
from train.lib.evaluate import Verdict

T = TypeVar("T")


class Stages(AbstractContextManager["Stages"]):
    """The bars of a run, one after the other, for as long as the context lasts."""

    def __init__(self, run: str) -> None:
        """Take the name of the run."""
        self._run, self._latest = run, ""
        self._bar: tqdm = tqdm(disable=True)

    def __exit__(self, *_: object) -> None:
        """End the last stage."""
        self._bar.close()

    def begin(self, stage: str, total: int, unit: str, done: int = 0) -> None:
        """End a stage and begin another one.

        Args:
            stage: What is done in it.
            total: How many units it takes.
            unit: What it counts.
            done: How many of them an interrupted run has done.
        """
        self._bar.close()
        self._bar = progress(total=total, initial=done, unit=unit, unit_scale=unit == "tick", desc="")
        self.say(stage)

    def each(self, stage: str, items: Iterable[T], total: int, unit: str) -> Iterator[T]:
        """The items one by one, as a stage that counts them."""
        self.begin(stage, total, unit)
        for item in items:
            yield item
            self.count()

    def say(self, stage: str) -> None:
        """Say what is being done while the count goes on; costs nothing where that is said already."""
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
