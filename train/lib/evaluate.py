"""Paired evaluation of a candidate and its base on the same validation scenarios."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.scenario import Scenario, load_scenarios
from spidar_gym.benchmark.track import BOTH, FLIGHT, GROUND, find_track
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.policies.artifact import Artifact, LearnedPolicy
from spidar_gym.policies.policy import Policy
from spidar_gym.policies.presets import PresetPolicy

SPLIT = "validation"
"""The only split of scenarios that training uses."""
COMPARED = {
    FLIGHT: ("position_rms_m", "attitude_rms_rad"), GROUND: ("duration_s", "energy_wh", "error"), BOTH: ("error",)
}  # fmt: skip
"""Metrics compared in each world; on a course only the error, as an early collision saves time and energy."""
TOLERANCE = 0.02
"""Largest relative deterioration in any cell with which a candidate may still be chosen."""
TOGETHER = 12
"""Largest number of scenarios of a track that one process evaluates together."""
FRACTIONS = (1.0, 0.7, 0.5, 0.3)
"""Fractions of the learned residual, tried in this order until nothing gets worse."""


class Base(PresetPolicy):
    """The controller alone: the zero action."""

    def __init__(self, arguments: Mapping[str, Any]) -> None:
        """Store the arguments of `gym.make`."""
        self._arguments = dict(arguments)

    def arguments(self, env_id: str) -> Mapping[str, Any]:
        """Return the same arguments for every environment."""
        return self._arguments


@dataclass(frozen=True)
class Verdict:
    """Result of a comparison."""

    cells: Mapping[str, Mapping[str, float]]
    """Track → metric → mean of the candidate divided by mean of the base, minus 1; below 0 is better."""
    success: float
    """Success rate minus that of the base, over all scenarios."""
    failed: bool
    """Whether the candidate failed in a scenario in which the base did not."""

    @property
    def score(self) -> float:
        """Mean over all cells."""
        return float(np.mean([value for cell in self.cells.values() for value in cell.values()]))

    @property
    def worst(self) -> float:
        """Largest value of all cells."""
        return max(value for cell in self.cells.values() for value in cell.values())

    @property
    def admissible(self) -> bool:
        """Whether no cell exceeds `TOLERANCE`, the success rate did not drop and no new failure occurred."""
        return self.worst <= TOLERANCE and self.success >= 0.0 and not self.failed


def _metrics(policy: Policy, control: str, portion: Sequence[tuple[str, Scenario]]) -> list[dict[str, Any]]:
    scenarios = [scenario for _, scenario in portion]
    return [each["metrics"] for each in play(policy, portion[0][0], scenarios, control=control)]


def _portions(scenarios: Sequence[tuple[str, Scenario]]) -> Iterator[list[tuple[str, Scenario]]]:
    """Split scenarios, in order, into portions of one track and at most `TOGETHER` scenarios each."""
    for _, own in groupby(scenarios, key=lambda one: one[0]):
        of_track = list(own)
        yield from (of_track[k : k + TOGETHER] for k in range(0, len(of_track), TOGETHER))


class PairedEvaluator:
    """Evaluates the base once, and then every candidate on the same scenarios."""

    def __init__(
        self, tracks: Sequence[str], base: Policy, scenarios: int, *, control: str,
        on_scenario: Callable[[], object] = lambda: None, each: Callable[..., Iterable[Any]] = map,
    ) -> None:  # fmt: skip
        """Evaluate the base.

        Args:
            tracks: Tracks of one environment.
            base: Policy that candidates are compared with.
            scenarios: Number of validation scenarios of each track, counted from the first.
            control: `python` or `core`.
            on_scenario: Called after each scenario.
            each: `map`, or the `map` of a process pool; scenarios are independent of each other.
        """
        self._control, self._each = control, each
        self._scenarios = [(t, s) for t in tracks for s in load_scenarios(t, SPLIT)[0][:scenarios]]
        if not self._scenarios:
            raise InvalidValueError("validation scenarios", scenarios, "at least one scenario of one track")
        self._tracks = tuple(tracks)
        self.base = self._play(base, self._scenarios, on_scenario)
        self.means = self._means(self.base)
        """Track → metric → mean of the base."""

    def _means(self, found: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
        """Return track → metric → mean over the scenarios of the track."""
        means = {}
        for track in self._tracks:
            own = [m for (name, _), m in zip(self._scenarios, found, strict=True) if name == track]
            metrics = COMPARED[find_track(track).world]
            means[track] = {metric: float(np.mean([m[metric] for m in own])) for metric in metrics}
        return means

    def relative_errors(self, *, apart: bool = False) -> dict[str, tuple[float, ...]]:
        """Return track → errors of the base divided by their means over all tracks, one for each metric.

        Args:
            apart: Whether each metric keeps its own ratio; otherwise all have the mean ratio of the track.
        """
        every = {
            metric: np.mean([means[metric] for means in self.means.values()]) for metric in self.means[self._tracks[0]]
        }
        found = {}
        for track, means in self.means.items():
            own = [float(value / every[metric]) for metric, value in means.items()]
            found[track] = tuple(own) if apart else (float(np.mean(own)),) * len(own)
        return found

    def _play(
        self,
        policy: Policy,
        scenarios: Sequence[tuple[str, Scenario]],
        on_scenario: Callable[[], object] = lambda: None,
    ) -> list[dict[str, Any]]:
        found = list[dict[str, Any]]()
        for metrics in self._each(partial(_metrics, policy, self._control), list(_portions(scenarios))):
            found += metrics
            for _ in metrics:
                on_scenario()
        return found

    def evaluate(self, candidate: Artifact | Policy, on_scenario: Callable[[], object] = lambda: None) -> Verdict:
        """Evaluate a candidate on all scenarios and compare it with the base."""
        policy = LearnedPolicy(candidate) if isinstance(candidate, Artifact) else candidate
        found = self._play(policy, self._scenarios, on_scenario)
        cells = {
            track: {name: value / self.means[track][name] - 1.0 for name, value in means.items()}
            for track, means in self._means(found).items()
        }
        success = float(np.mean([m["success"] for m in found]) - np.mean([m["success"] for m in self.base]))
        failed = any(m["failed"] and not b["failed"] for m, b in zip(found, self.base, strict=True))
        return Verdict(cells, success, failed)

    def largest_fraction(
        self, candidate: Callable[[float], Artifact], on_scenario: Callable[[], object] = lambda: None
    ) -> tuple[Verdict, float]:
        """Find the largest of `FRACTIONS` with an admissible verdict; the smallest if there is none.

        Args:
            candidate: Function from a fraction to the artifact of that fraction of the residual.
            on_scenario: Called after each scenario of the first candidate.
        """
        fraction = FRACTIONS[0]
        verdict = self.evaluate(candidate(fraction), on_scenario)
        for less in FRACTIONS[1:]:
            if verdict.admissible:
                break
            fraction, verdict = less, self.evaluate(candidate(less))
        return verdict, fraction

    def require_same_as_base(self, artifact: Artifact) -> None:
        """Raise `SpidarError` if an untrained agent differs from the base in any metric of one scenario per track."""
        first = {track: k for k, (track, _) in reversed(list(enumerate(self._scenarios)))}
        found = self._play(LearnedPolicy(artifact), [self._scenarios[k] for k in first.values()])
        for (track, k), mine in zip(first.items(), found, strict=True):
            differ = {name for name, value in mine.items() if value != self.base[k][name]}
            if differ:
                raise SpidarError(
                    f"before training the agent differs from its base on {track} in {', '.join(sorted(differ))}; "
                    "valid: the base, bit for bit"
                )
