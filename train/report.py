"""The end of a run: the test scenarios, a row of the leaderboard, and what it says against the base."""

import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from spidar_gym.benchmark.comparison import comparison_text
from spidar_gym.benchmark.evaluate import evaluate
from spidar_gym.benchmark.policy import load_policy, policy_name
from spidar_gym.benchmark.row import BASES, ROWS, make_row, read_row, write_row
from spidar_gym.benchmark.track import SCENARIOS


def evaluate_row(
    paths: Sequence[Path], tracks: Sequence[str], folder: Path, base: str, *, scenarios: int = SCENARIOS, workers: int
) -> str:
    """Play the test scenarios, write the row, and say how it compares with its base.

    Args:
        paths: Artifacts, one a training seed.
        tracks: Tracks.
        folder: Where the row goes.
        base: Preset of the controller that it adds to.
        scenarios: How many of each track.
        workers: Processes.
    """
    specs = [str(path) for path in paths]
    policies = [load_policy(spec) for spec in specs]
    total = len(specs) * len(tracks) * scenarios
    with tqdm(total=total, unit="scenario", desc=f"test {policy_name(policies[0])}", file=sys.__stderr__) as bar:
        scores = {
            track: [
                evaluate(spec, track, scenarios, workers=workers, folder=Path("out/eval"), on_scenario=bar.update)
                for spec in specs
            ]
            for track in tracks
        }
    words = " ".join(["spidar eval --policy", *specs, "--tracks", *tracks])
    row = make_row(
        policies, specs, scores, command=words + ("" if scenarios == SCENARIOS else f" --scenarios {scenarios}")
    )
    path = write_row(row, folder)
    committed = Path(ROWS) / f"{BASES[base]}.json"
    return f"{comparison_text(row, read_row(committed))}\nwritten to {path}"
