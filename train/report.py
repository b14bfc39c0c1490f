"""The end of a run: the test scenarios, a row of the leaderboard, and what it says against the base."""

import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from spidar_gym.benchmark.comparison import comparison_text
from spidar_gym.benchmark.evaluate import evaluate_runs
from spidar_gym.benchmark.policy import load_policy, policy_name
from spidar_gym.benchmark.row import BASES, committed_row, eval_command, make_row, write_row
from spidar_gym.benchmark.track import SCENARIOS


def evaluate_row(
    path: Path, tracks: Sequence[str], folder: Path, base: str, *, scenarios: int = SCENARIOS, workers: int
) -> str:
    """Play the test scenarios, write the row, and say how it compares with its base.

    Args:
        path: The artifact.
        tracks: Tracks.
        folder: Where the row goes.
        base: Preset of the controller that it adds to, or that it is to replace.
        scenarios: How many of each track.
        workers: Processes.
    """
    spec = str(path)
    policy = load_policy(spec)
    with tqdm(
        total=len(tracks) * scenarios, unit="scenario", desc=f"test {policy_name(policy)}", file=sys.__stderr__
    ) as bar:
        scores = evaluate_runs(
            [spec], tracks, scenarios, workers=workers, folder=Path("out/eval"), on_scenario=bar.update,
            on_track=bar.set_postfix_str,
        )  # fmt: skip
    row = make_row([policy], [spec], scores, command=eval_command([spec], tracks, scenarios=scenarios))
    written, against = f"written to {write_row(row, folder)}", committed_row(BASES[base])
    return written if against is None else f"{comparison_text(row, against)}\n{written}"
