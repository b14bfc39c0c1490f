"""Verification of rows: re-run their scenarios and compare the metrics."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spidar_gym.benchmark.content import RowError
from spidar_gym.benchmark.evaluate import Shard, run_shards
from spidar_gym.benchmark.metrics import METRICS, differences
from spidar_gym.benchmark.row import Row, world_words
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.scoring import CONTROL
from spidar_gym.benchmark.track import SECOND, TRACKS
from spidar_gym.policies.provenance import file_digest, processor, versions
from spidar_gym.policies.source import is_own, source_file


class Pick(NamedTuple):
    """Scenario of a row to be re-run."""

    row: str
    """Name of the row."""
    track: str
    """Track."""
    run: int
    """Index of the row's policy."""
    k: int
    """Position of the scenario in the row's list of scenarios."""


@dataclass(frozen=True)
class Check:
    """Result of a re-run scenario of a row."""

    row: str
    """Name of the row."""
    line: str
    """Result, as text."""
    conditions: str
    """Processor, versions and controller of the row that differ here, as text; empty if none differs."""
    moved: Mapping[str, float]
    """Differences of the unequal metrics, as a share of their tolerance."""
    metrics: Mapping[str, Any] = field(default_factory=dict)
    """Metrics of the re-run."""
    fell: bool = False
    """Whether both runs failed for the same reason, with the error `CAP`. Falls are chaotic; under other conditions the
    other metrics of such a scenario are therefore not compared."""

    @property
    def equal(self) -> bool:
        """Whether all metrics are equal bit for bit."""
        return not self.moved

    @property
    def passes(self) -> bool:
        """Whether the metrics are equal or, under other conditions, within tolerance or of the same failure."""
        return self.equal or (bool(self.conditions) and (self.fell or max(self.moved.values()) <= 1.0))


def require_own_policies(row: Row, *, trust: bool) -> None:
    """Refuse a row whose policies may not run or whose files have changed; nothing is imported.

    Args:
        row: Row; its policy specifications are untrusted.
        trust: Whether code from outside the package and the committed baselines may run.

    Raises:
        RowError: For a policy that may not run, or whose file has changed.
        PolicyError: When a policy does not exist.
    """
    for spec, digest in zip(row.policies, row.content["policies_sha256"], strict=True):
        if not (trust or is_own(spec)):
            raise RowError(
                f"row {row.name}: {spec} is code from outside the package and the committed baselines; "
                "valid: --trust, once you have read it"
            )
        if file_digest(source_file(spec)) != digest:
            raise RowError(f"row {row.name}: {spec} has changed since; valid: the row evaluated again")


def require_worlds(row: Row, track: str) -> None:
    """Refuse a row whose calibrated world is not the present one (`RowError` with both)."""
    present, then = TRACKS[track].calibration, row.part(track).content["tracks"][track].get("world")
    if present is not None and then != world_words(present):
        words = [f"{world['name']} {world['sha256'][:12]}" for world in (then, world_words(present))]
        raise RowError(
            f"row {row.name}: {track} is of world {words[0]}, not {words[1]}; valid: the row evaluated again"
        )


def with_second_draws(rows: Mapping[str, Row]) -> dict[str, Row]:
    """Return the rows, and those of their second draws by `NAME (second)`."""
    return {**rows, **{f"{name} ({SECOND})": row.second for name, row in rows.items() if row.second is not None}}


def shard_of(row: Row, track: str, run: int, k: int, control: str = CONTROL, *, trust: bool = False) -> Shard:
    """Return the shard that re-runs a row's run on the k-th of its scenarios of a track."""
    split = row.split(track)
    scenario = load_scenarios(track, split)[0][row.scenarios(track)[k]]
    return Shard(row.policies[run], track, split, scenario, control=control, run=run, trust=trust)


def other_conditions(row: Row, control: str = CONTROL) -> str:
    """Return the conditions of a row's evaluation that differ here; empty if the metrics must be equal."""
    present = versions()
    words = [
        f"{package} {number or 'none'}"
        for package, number in row.content["versions"].items()
        if present.get(package, "") != number
    ]
    words += [row.content["processor"]] if row.content["processor"] != processor() else []
    words += [CONTROL] if control != CONTROL else []
    return ", ".join(words)


def every_scenario(rows: Mapping[str, Row], tracks: Sequence[str] = ()) -> list[Pick]:
    """Return every evaluated scenario of rows, or of some tracks, once."""
    return [
        Pick(name, track, run, k)
        for name, row in rows.items()
        for track in row.tracks
        if track in (tracks or row.tracks)
        for run in range(len(row.policies))
        for k in range(len(row.scenarios(track)))
    ]


def drawn_per_run(picks: Sequence[Pick], count: int, rng: np.random.Generator) -> list[Pick]:
    """Sample `count` scenarios, or all if there are fewer, of each row, track and run, without replacement."""
    chosen = []
    for _, group in groupby(picks, key=lambda pick: pick[:3]):
        own = list(group)
        chosen += [own[place] for place in sorted(rng.permutation(len(own))[:count])]
    return chosen


def drawn_sample(picks: Sequence[Pick], count: int, rng: np.random.Generator) -> list[Pick]:
    """Sample `count` scenarios without replacement: uniformly a row, then one of its tracks, then a scenario."""
    left: dict[str, dict[str, list[Pick]]] = {}
    for pick in picks:
        left.setdefault(pick.row, {}).setdefault(pick.track, []).append(pick)
    chosen = []
    for _ in range(min(count, len(picks))):
        row = list(left)[rng.integers(len(left))]
        track = list(left[row])[rng.integers(len(left[row]))]
        own = left[row][track]
        chosen.append(own.pop(int(rng.integers(len(own)))))
        if not own:
            del left[row][track]
        if not left[row]:
            del left[row]
    return chosen


def verify(
    rows: Mapping[str, Row],
    picks: Sequence[Pick],
    *,
    workers: int = 1,
    trust: bool = False,
    control: str = CONTROL,
    folder: Path | None = None,
    on_check: Callable[[Check], object] = lambda _: None,
) -> list[Check]:
    """Re-run scenarios of rows and compare the metrics.

    Args:
        rows: Rows by name.
        picks: Scenarios.
        workers: Number of processes.
        trust: Whether code from outside the package and the committed baselines may run.
        control: `core`, which rows use, or `python`, whose rounding differs.
        folder: Folder for finished scenarios, from which an interrupted verification resumes.
        on_check: Called with the result of each scenario as soon as it is available.

    Raises:
        RowError: When a policy's file has changed since its evaluation, or may not run.
    """
    for name in dict.fromkeys(pick.row for pick in picks):
        require_own_policies(rows[name], trust=trust)
    for name, track in dict.fromkeys((pick.row, pick.track) for pick in picks):
        require_worlds(rows[name], track)
    shards = [shard_of(rows[pick.row], pick.track, pick.run, pick.k, control, trust=trust) for pick in picks]
    checks: dict[int, Check] = {}

    def on_done(place: int, result: dict[str, Any]) -> None:
        pick = picks[place]
        row = rows[pick.row]
        conditions = other_conditions(row.part(pick.track), control)
        checks[place] = _compare(row, pick, result["metrics"], conditions)
        on_check(checks[place])

    run_shards(shards, workers=workers, folder=folder, on_done=on_done)
    return [checks[place] for place in range(len(picks))]


def _compare(row: Row, pick: Pick, metrics: dict[str, Any], conditions: str) -> Check:
    _, track, run, k = pick
    then = {name: values[k] for name, values in row.part(track).content["tracks"][track]["runs"][run].items()}
    moved = differences(then, metrics, world=TRACKS[track].world)
    where = f"{pick.row}, {track}, run {run}, scenario {row.scenarios(track)[k]}: error {metrics['error']:.6g}"
    fell = bool(then["failed"]) and all(then[name] == metrics[name] for name in ("failed", "failure", "error"))
    check = Check(pick.row, f"{where}, equal", conditions, moved, metrics, fell)
    if check.equal:
        return check
    if check.passes and fell:
        return replace(check, line=f"{where}, within tolerance (fails as it did: {metrics['failure']})")
    if check.passes:
        worst = max(moved, key=lambda name: moved[name])
        return replace(check, line=f"{where}, within tolerance ({worst} {moved[worst]:.1%} of it)")
    off = ", ".join(f"{name} {then[name]} → {metrics[name]}" for name in moved if not conditions or moved[name] > 1.0)
    return replace(check, line=f"{where}, DIFFERS ({off})")


def measures(checks: Sequence[Check]) -> list[str]:
    """Return the criterion of comparison for each row, as text."""
    lines = []
    for name, conditions in dict.fromkeys((check.row, check.conditions) for check in checks):
        own = [check for check in checks if (check.row, check.conditions) == (name, conditions)]
        equal = sum(check.equal for check in own)
        measure = f"within tolerance (made with {conditions})" if conditions else "bit for bit"
        lines.append(f"{name}: {len(own)} {measure}" + (f", {equal} of them equal" if conditions else ""))
    return lines


def largest_differences(checks: Sequence[Check]) -> str:
    """Return the largest difference of each unequal metric, without equal failures, as text."""
    moved: dict[str, float] = {}
    for check in (each for each in checks if not each.fell):
        moved |= {name: max(share, moved.get(name, 0.0)) for name, share in check.moved.items()}
    return ", ".join(f"{name} {moved[name]:.2%}" for name in METRICS if name in moved)


def require_verified(checks: Sequence[Check]) -> None:
    """Raise `RowError` unless every scenario passes."""
    wrong = [check.line for check in checks if not check.passes]
    if wrong:
        raise RowError(
            f"{len(wrong)} of {len(checks)} scenarios give other results ({wrong[0]}); "
            "valid: rows that `spidar eval` wrote with this code"
        )


def results(rows: Mapping[str, Row], picks: Sequence[Pick], checks: Sequence[Check]) -> list[dict[str, Any]]:
    """Return the results for JSON, which keeps every bit of a number, so that two commits can be compared."""
    return [
        {"row": pick.row, "track": pick.track, "run": pick.run,
         "scenario": rows[pick.row].scenarios(pick.track)[pick.k], "equal": check.equal, "metrics": check.metrics}
        for pick, check in zip(picks, checks, strict=True)
    ]  # fmt: skip
