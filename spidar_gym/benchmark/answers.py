"""How the allocation answers: the ticks of rows, played again, by status."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spidar_gym.benchmark.evaluate import Shard
from spidar_gym.benchmark.row import Row
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.scoring import play_scenario
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.benchmark.verify import require_ours
from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.native.library import core_path
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_arguments
from spidar_gym.processes import Pool
from spidar_gym.text import format_table

STATUSES = (*map(str, AllocationStatus), "none")
"""How a tick is answered; `none` where no allocation runs."""


@dataclass(frozen=True)
class Answers:
    """The ticks of a row on a track, all runs together."""

    row: str
    """Name of the row."""
    track: str
    """Track."""
    ticks: Mapping[str, int]
    """Status → ticks."""

    @property
    def total(self) -> int:
        """All ticks."""
        return sum(self.ticks.values())


def count_ticks(shard: Shard) -> Counter[str]:
    """Play a scenario, with the compiled core where there is one; status → ticks."""
    ticks: Counter[str] = Counter()
    policy = load_policy(shard.policy)
    chosen = policy_arguments(policy, TRACKS[shard.track].env_id) or {}
    # The core has an allocation of its own.
    control = "core" if core_path().is_file() and "allocator" not in chosen else "python"
    play_scenario(
        policy, shard.track, shard.scenario, act_limit_s=shard.act_limit_s, control=control,
        on_tick=lambda info: ticks.update([info["qp_status"]]),
    )  # fmt: skip
    return ticks


def answer_shards(
    rows: Mapping[str, Row], tracks: Sequence[str], scenarios: int, *, trust: bool = False
) -> list[tuple[str, Shard]]:
    """What has to be played: name of a row, and a scenario of one of its runs.

    Args:
        rows: The rows.
        tracks: Tracks; a row is played on those that it has.
        scenarios: How many of each track, from the first that the row was evaluated on.
        trust: Whether code from outside the package and the checkout's baselines may run.

    Raises:
        RowError: When a policy's file is no longer the one that was evaluated, or may not run.
    """
    found = []
    for name, row in rows.items():
        require_ours(row, trust=trust)
        for track in (t for t in tracks if t in row.tracks):
            split = row.content["tracks"][track]["split"]
            every = load_scenarios(track, split)[0]
            chosen = [every[index] for index in row.scenarios(track)[:scenarios]]
            found += [(name, Shard(spec, track, split, scenario)) for spec in row.policies for scenario in chosen]
    return found


def count_answers(
    shards: Sequence[tuple[str, Shard]], *, workers: int = 1, on_scenario: Callable[[], object] = lambda: None
) -> list[Answers]:
    """Ticks by row, track and status.

    Args:
        shards: What `answer_shards` gives.
        workers: Processes.
        on_scenario: Called after every scenario, for progress.
    """
    ticks: dict[tuple[str, str], Counter[str]] = {(name, shard.track): Counter() for name, shard in shards}
    with Pool(workers) as pool:
        played = [shard for _, shard in shards]
        for k, counted in pool.as_done(count_ticks, played, lambda k: str(played[k])):
            ticks[shards[k][0], played[k].track].update(counted)
            on_scenario()
    return [Answers(row, track, {s: counted[s] for s in STATUSES}) for (row, track), counted in ticks.items()]


def answers_json(answers: Sequence[Answers]) -> list[dict[str, Any]]:
    """The counts, ready for JSON."""
    return [{"row": a.row, "track": a.track, "ticks": dict(a.ticks)} for a in answers]


def answers_text(answers: Sequence[Answers]) -> str:
    """A table: ticks, and the share of each status."""
    lines = [["row", "track", "ticks", *STATUSES]]
    for a in answers:
        shares = (f"{100.0 * a.ticks[s] / a.total:.3f} %" if a.ticks[s] else "–" for s in STATUSES)
        lines.append([a.row, a.track, str(a.total), *shares])
    return format_table(lines)
