"""Statuses of the allocation: re-run scenarios of rows and count their ticks by status."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from spidar_gym.benchmark.evaluate import Shard
from spidar_gym.benchmark.resume import finish
from spidar_gym.benchmark.row import Row
from spidar_gym.benchmark.scoring import play_scenario
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.benchmark.verify import require_own_policies, shard_of
from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.policies.guest import close_guests
from spidar_gym.policies.policy import control_of, policy_arguments
from spidar_gym.text import format_table

STATUSES = (*map(str, AllocationStatus), "none")
"""Statuses of the allocation in a tick; `none` where no allocation runs."""


def count_ticks(shard: Shard) -> Counter[str]:
    """Run a scenario and count its ticks by status; on the compiled core unless it has custom control code."""
    ticks: Counter[str] = Counter()
    policy = shard.load()
    chosen = policy_arguments(policy, TRACKS[shard.track].env_id) or {}
    # Policies with a custom allocator or law run on the Python controller.
    control = control_of(chosen, "core")
    play_scenario(
        policy, shard.track, shard.scenario, act_limit_s=shard.act_limit_s, control=control,
        on_tick=lambda info: ticks.update([info["qp_status"]]),
    )  # fmt: skip
    return ticks


def answer_shards(
    rows: Mapping[str, Row], tracks: Sequence[str], scenarios: int, *, trust: bool = False
) -> list[tuple[str, Shard]]:
    """Return the scenarios to run, each with the name of its row.

    Args:
        rows: The rows.
        tracks: Tracks; those that a row lacks are skipped for this row.
        scenarios: Number of scenarios per track, counted from the first on which the row was evaluated.
        trust: Whether code from outside the package and the committed baselines may run.

    Raises:
        RowError: When a policy's file has changed since its evaluation, or may not run.
    """
    found = []
    for name, row in rows.items():
        require_own_policies(row, trust=trust)
        for track in (t for t in tracks if t in row.tracks):
            count = min(scenarios, len(row.scenarios(track)))
            found += [
                (name, shard_of(row, track, run, k, trust=trust))
                for run in range(len(row.policies))
                for k in range(count)
            ]
    return found


def count_answers(
    shards: Sequence[tuple[str, Shard]], *, workers: int = 1, on_scenario: Callable[[], object] = lambda: None
) -> list[dict[str, Any]]:
    """Count ticks by row, track and status, over all runs of a row; the result can be written as JSON.

    Args:
        shards: Result of `answer_shards`.
        workers: Number of processes.
        on_scenario: Called after every scenario, for progress.
    """
    try:
        counted = finish(
            count_ticks, [shard for _, shard in shards], workers=workers, label=lambda k: str(shards[k][1]),
            on_done=lambda *_: on_scenario(),
        )  # fmt: skip
    finally:
        close_guests()
    ticks: dict[tuple[str, str], Counter[str]] = {}
    for (row, shard), own in zip(shards, counted, strict=True):
        ticks.setdefault((row, shard.track), Counter()).update(own)
    return [
        {"row": row, "track": track, "ticks": {status: own[status] for status in STATUSES}}
        for (row, track), own in ticks.items()
    ]


def answers_text(answers: Sequence[Mapping[str, Any]]) -> str:
    """Format a table of ticks and the share of each status."""
    lines = [["row", "track", "ticks", *STATUSES]]
    for counted in answers:
        ticks = counted["ticks"]
        total = sum(ticks.values())
        shares = (f"{100.0 * ticks[status] / total:.3f} %" if ticks[status] else "–" for status in STATUSES)
        lines.append([counted["row"], counted["track"], str(total), *shares])
    return format_table(lines)
