"""Final report of a run: the validation result, the commands for the next steps, and the row on the test scenarios."""

import json
from collections.abc import Sequence
from pathlib import Path

from spidar_gym.benchmark.comparison import COMPARED, comparison_text
from spidar_gym.benchmark.evaluate import evaluate_runs
from spidar_gym.benchmark.row import BASES, committed_row, eval_command, make_row, write_row
from spidar_gym.benchmark.track import SCENARIOS
from spidar_gym.console import progress
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_name
from train.lib.config import Recipe

HEADINGS = {metric: heading for group in COMPARED.values() for metric, (heading, *_) in group.items()}
"""Metric → heading in reports."""


def report(path: Path, recipe: Recipe, env_id: str, tracks: Sequence[str], base: str, *, workers: int) -> None:
    """Print the validation result of a run and, if `recipe.output.row` is set, evaluate it and write its row.

    Args:
        path: The artifact, in the same folder as its run's curve.
        recipe: Settings of the run; `recipe.output` states whether and where to write a row.
        env_id: Environment.
        tracks: Tracks to evaluate on.
        base: Preset of the controller that the policy adds to or replaces, or a row of the leaderboard.
        workers: Number of processes.
    """
    print(f"{path}: {recipe.name}, seed {recipe.seed}\n{conclusion(path, base, env_id, tracks)}")
    if not recipe.output.row:
        return
    spec = str(path)
    policy = load_policy(spec)
    with progress(total=len(tracks) * SCENARIOS, unit="scenario", desc=f"test {policy_name(policy)}") as bar:
        scores = evaluate_runs(
            [spec], tracks, SCENARIOS, workers=workers, folder=Path("out/eval"), on_scenario=bar.update,
            on_track=bar.set_postfix_str,
        )  # fmt: skip
    row = make_row([policy], [spec], scores, command=eval_command([spec], tracks))
    written, against = write_row(row, recipe.output.out / "scores"), committed_row(BASES.get(base, base))
    if against is not None:
        print(comparison_text(row, against))
    print(f"written to {written}")


def conclusion(path: Path, base: str, env_id: str, tracks: Sequence[str]) -> str:
    """Compare the chosen agent with its base on the validation scenarios, and list the commands for the next steps."""
    content = json.loads(path.with_name("curve.json").read_text(encoding="utf-8"))
    chosen, curve = content["chosen"], content["curve"]
    # The last line with these steps: if a fraction of the residual was chosen, its line follows that of the whole.
    lines = [line for line in curve if line["steps"] == chosen["steps"]][-1:]
    worst = max((value for line in lines for cell in line["cells"].values() for value in cell.values()), default=0.0)
    if not chosen["steps"]:
        words = f"no agent of {len(curve)} did better than {base} without doing anything worse: this one adds nothing"
    else:
        better = "better" if chosen["score"] < 0.0 else "worse"
        words = f"{abs(chosen['score']):.1%} {better} than {base} in the mean, chosen after {chosen['steps']} ticks"
        cells = [
            f"{track} " + ", ".join(f"{HEADINGS[metric]} {value:+.1%}" for metric, value in cell.items())
            for line in lines
            for track, cell in line["cells"].items()
        ]
        words = f"{words}; worst {worst:+.1%}: {'; '.join(cells)}" if cells else words
    return "\n".join([
        f"validation: {words}",
        f"film it:    spidar run {env_id} --policy {path} --out {path.with_name('film.mp4')}",
        f"measure it: spidar eval --policy {path} --tracks {' '.join(tracks)}",
    ])  # fmt: skip
