"""Rows played again: what a stranger does who wants to trust them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spidar_gym.benchmark.content import RowError
from spidar_gym.benchmark.evaluate import Shard, run_shards
from spidar_gym.benchmark.metrics import METRICS, differences
from spidar_gym.benchmark.row import Row
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.scoring import CONTROL
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.policies.provenance import file_digest, processor, versions
from spidar_gym.policies.source import is_own, source_file


@dataclass(frozen=True)
class Check:
    """A scenario of a row, played again."""

    row: str
    """Name of the row."""
    line: str
    """What came out, in words."""
    conditions: str
    """Processor, versions, control with which the row was made where they are others, in words; else empty."""
    moved: Mapping[str, float]
    """Metrics that are not equal: by how much, as a share of what rounding may do."""

    @property
    def equal(self) -> bool:
        """Every metric bit for bit."""
        return not self.moved

    @property
    def passes(self) -> bool:
        """Equal, or every metric within its tolerance where something is otherwise."""
        return self.equal or (bool(self.conditions) and max(self.moved.values()) <= 1.0)


def require_own_policies(row: Row, *, trust: bool) -> None:
    """Refuse a row whose policies may not run here, or are not the files that were evaluated; nothing is imported.

    Args:
        row: The row, whose names of policies are whatever its file says.
        trust: Whether code from outside the package and the committed baselines may run.

    Raises:
        RowError: For a policy that may not run, or whose file has changed.
        PolicyError: When there is none of that name.
    """
    for spec, digest in zip(row.policies, row.content["policies_sha256"], strict=True):
        if not (trust or is_own(spec)):
            raise RowError(
                f"row {row.name}: {spec} is code from outside the package and the committed baselines; "
                "valid: --trust, once you have read it"
            )
        if file_digest(source_file(spec)) != digest:
            raise RowError(f"row {row.name}: {spec} has changed since; valid: the row evaluated anew")


def shard_of(row: Row, track: str, run: int, k: int, control: str = CONTROL, *, trust: bool = False) -> Shard:
    """What has to be played again for a run of a row on the k-th of its scenarios of a track."""
    split = row.split(track)
    scenario = load_scenarios(track, split)[0][row.scenarios(track)[k]]
    return Shard(row.policies[run], track, split, scenario, control=control, trust=trust)


def other_conditions(row: Row, control: str = CONTROL) -> str:
    """With what a row's file was made that is different here, in words; empty where its numbers have to be equal."""
    present = versions()
    words = [
        f"{package} {number or 'none'}"
        for package, number in row.content["versions"].items()
        if present.get(package, "") != number
    ]
    words += [row.content["processor"]] if row.content["processor"] != processor() else []
    words += [CONTROL] if control != CONTROL else []
    return ", ".join(words)


def verify(
    rows: Mapping[str, Row],
    sample: int,
    rng: np.random.Generator,
    *,
    workers: int = 1,
    trust: bool = False,
    control: str = CONTROL,
    on_check: Callable[[Check], object] = lambda _: None,
) -> list[Check]:
    """Play scenarios of rows again and compare.

    Args:
        rows: The rows.
        sample: How many scenarios, each of a row, a track, a run and an index drawn evenly.
        rng: Source of the draws.
        workers: Processes.
        trust: Whether code from outside the package and the committed baselines may run.
        control: `core`, with which rows are made, or `python`, whose rounding is another one.
        on_check: Called with what came out of each scenario, as soon as it has.

    Raises:
        RowError: When a policy's file is no longer the one that was evaluated, or may not run.
    """
    names, shards = list(rows), []
    picks: list[tuple[Row, str, int, int]] = []
    for _ in range(sample):
        row = rows[names[rng.integers(len(names))]]
        track = row.tracks[rng.integers(len(row.tracks))]
        run, k = int(rng.integers(len(row.policies))), int(rng.integers(len(row.scenarios(track))))
        picks.append((row, track, run, k))
        shards.append(shard_of(row, track, run, k, control, trust=trust))
    for row in {id(row): row for row, *_ in picks}.values():
        require_own_policies(row, trust=trust)
    checks: dict[int, Check] = {}

    def on_done(place: int, result: dict[str, Any]) -> None:
        row, track, run, k = picks[place]
        checks[place] = _compare(row, track, run, k, result["metrics"], other_conditions(row.part(track), control))
        on_check(checks[place])

    run_shards(shards, workers=workers, on_done=on_done)
    return [checks[place] for place in range(len(picks))]


def _compare(row: Row, track: str, run: int, k: int, metrics: dict[str, Any], conditions: str) -> Check:
    then = {name: values[k] for name, values in row.part(track).content["tracks"][track]["runs"][run].items()}
    moved = differences(then, metrics, world=TRACKS[track].world)
    where = f"{row.name}, {track}, run {run}, scenario {row.scenarios(track)[k]}: error {metrics['error']:.6g}"
    check = Check(row.name, f"{where}, equal", conditions, moved)
    if check.equal:
        return check
    if check.passes:
        worst = max(moved, key=lambda name: moved[name])
        return replace(check, line=f"{where}, within tolerance ({worst} {moved[worst]:.1%} of it)")
    off = ", ".join(f"{name} {then[name]} → {metrics[name]}" for name in moved if not conditions or moved[name] > 1.0)
    return replace(check, line=f"{where}, DIFFERS ({off})")


def measures(checks: Sequence[Check]) -> list[str]:
    """For each row by which measure it was held, in words."""
    lines = []
    for name, conditions in dict.fromkeys((check.row, check.conditions) for check in checks):
        own = [check for check in checks if (check.row, check.conditions) == (name, conditions)]
        equal = sum(check.equal for check in own)
        measure = f"within tolerance (made with {conditions})" if conditions else "bit for bit"
        lines.append(f"{name}: {len(own)} {measure}" + (f", {equal} of them equal" if conditions else ""))
    return lines


def largest_differences(checks: Sequence[Check]) -> str:
    """How far every metric that is not equal everywhere has moved at most, in words."""
    moved: dict[str, float] = {}
    for check in checks:
        moved |= {name: max(share, moved.get(name, 0.0)) for name, share in check.moved.items()}
    return ", ".join(f"{name} {moved[name]:.2%}" for name in METRICS if name in moved)


def require_verified(checks: Sequence[Check]) -> None:
    """Raise `RowError` unless every scenario gave what its row says."""
    wrong = [check.line for check in checks if not check.passes]
    if wrong:
        raise RowError(
            f"{len(wrong)} of {len(checks)} scenarios give something else ({wrong[0]}); "
            "valid: rows that `spidar eval` wrote with this code"
        )
