"""Rows played again: what a stranger does who wants to trust them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spidar_gym.benchmark.episode import METRICS
from spidar_gym.benchmark.evaluate import Shard, run_shards
from spidar_gym.benchmark.policy import load_policy, policy_digest
from spidar_gym.benchmark.row import Row, RowError, processor, versions
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import TRACKS

TOLERANCE = {"flight": 0.005, "ground": 0.02}
"""Other versions or another processor may change a scenario's error by this share of it, or of 0.1 if that is more."""


@dataclass(frozen=True)
class Check:
    """A scenario of a row, played again."""

    line: str
    """What came out, in words."""
    equal: bool
    """Every metric bit for bit."""
    fine: bool
    """Equal, or within the tolerance where versions or processor differ."""


def verify(
    rows: Mapping[str, Row],
    sample: int,
    rng: np.random.Generator,
    *,
    workers: int = 1,
    on_scenario: Callable[[], object] = lambda: None,
) -> list[Check]:
    """Play scenarios of rows again and compare.

    Args:
        rows: The rows.
        sample: How many scenarios, each of a row, a track, a run and an index drawn evenly.
        rng: Source of the draws.
        workers: Processes.
        on_scenario: Called after every scenario, for progress.

    Raises:
        RowError: When a policy's file is no longer the one that was evaluated.
    """
    names, picks, shards = list(rows), [], []
    for _ in range(sample):
        row = rows[names[rng.integers(len(names))]]
        track = row.tracks[rng.integers(len(row.tracks))]
        run, k = int(rng.integers(len(row.policies))), int(rng.integers(len(row.scenarios(track))))
        split = row.content["tracks"][track]["split"]
        scenario = load_scenarios(track, split)[0][row.scenarios(track)[k]]
        picks.append((row, track, run, k))
        shards.append(Shard(row.policies[run], track, split, scenario))
    for row in {id(row): row for row, *_ in picks}.values():
        for spec, digest in zip(row.policies, row.content["policies_sha256"], strict=True):
            if policy_digest(load_policy(spec)) != digest:
                raise RowError(f"row {row.name}: {spec} has changed since; valid: the row evaluated anew")
    results = run_shards(shards, workers=workers, on_scenario=on_scenario)
    return [
        _compare(row, track, run, k, result["metrics"])
        for (row, track, run, k), result in zip(picks, results, strict=True)
    ]


def _compare(row: Row, track: str, run: int, k: int, metrics: dict[str, Any]) -> Check:
    then = {name: values[k] for name, values in row.content["tracks"][track]["runs"][run].items()}
    differ = [name for name in METRICS if metrics[name] != then[name]]
    where = f"{row.name}, {track}, run {run}, scenario {row.scenarios(track)[k]}: error {metrics['error']:.6g}"
    if not differ:
        return Check(f"{where}, equal", True, True)
    same = row.content["versions"] == versions() and row.content["timing"]["processor"] == processor()
    allowed = TOLERANCE["flight" if TRACKS[track].flies else "ground"] * max(0.1, then["error"])
    fine = not same and abs(metrics["error"] - then["error"]) <= allowed and metrics["failed"] == then["failed"]
    words = "within tolerance of another processor or version" if fine else "DIFFERS"
    return Check(f"{where}, was {then['error']:.6g}, {words} ({', '.join(differ)})", False, fine)


def require_verified(checks: Sequence[Check]) -> None:
    """Raise `RowError` unless every scenario gave what its row says."""
    wrong = [check.line for check in checks if not check.fine]
    if wrong:
        raise RowError(
            f"{len(wrong)} of {len(checks)} scenarios give something else ({wrong[0]}); "
            "valid: rows that `spidar eval` wrote with this code"
        )
