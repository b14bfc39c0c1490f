"""Learning curves: all seeds of a row in one file, a picture a track, and the guide's table of what the rows cost.

python -m train.curves --runs out/train --out train/curves
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import tyro
from tqdm import tqdm

from spidar_gym import __version__
from spidar_gym.benchmark.row import BASES
from spidar_gym.benchmark.track import BOTH, FLIGHT, GROUND, TRACKS
from spidar_gym.cli.console import run_cli
from spidar_gym.control.presets import FORMER_PRESETS, PRESETS
from spidar_gym.errors import SpidarError, require_least
from spidar_gym.files import json_text, write_text
from spidar_gym.processes import Pool, cpu_count
from spidar_gym.text import format_table
from spidar_gym.viz import Curve, learning_curves
from train.lib.config import CONTROL
from train.lib.evaluate import Base, PairedEvaluator

FLIGHTS = {**PRESETS, **FORMER_PRESETS}
"""Controllers of flights."""
LINES = {
    FLIGHT: {row: preset for preset, row in BASES.items() if preset in FLIGHTS},
    GROUND: {row: preset for preset, row in BASES.items() if preset not in FLIGHTS},
    BOTH: {},
}
"""World → rows of the controllers that are added to, drawn as lines, with their presets; on a course the runs' own."""


TAUGHT = "train.distill"
"""The recipe whose agents never add to a controller; its settings have no action mode."""


@dataclass(frozen=True)
class Args:
    """Gather the curves of runs, and draw them."""

    runs: Path = Path("out/train")
    """Folder with runs: NAME/seedK/curve.json; where it is missing only pictures are drawn anew."""
    out: Path = Path("train/curves")
    """Folder for NAME.json."""
    pictures: Path = Path("out/curves")
    """Folder for TRACK.png."""
    costs: Path = Path("docs/results/learned_costs.json")
    """File for what the rows cost, from which the guide's table is made."""
    control: str = CONTROL
    """Controller that flies the lines: python, or core."""
    workers: int = cpu_count()
    """Processes that fly."""

    def __post_init__(self) -> None:
        require_least(1, workers=self.workers)


def gather(runs: Path, out: Path) -> list[Path]:
    """Write the curves of all seeds of each row into one file; their paths (`SpidarError` for a damaged one)."""
    written = []
    for folder in sorted(path for path in runs.glob("*") if path.is_dir()):
        seeds = [read_curve(path) for path in sorted(folder.glob("seed*/curve.json"))]
        if seeds:
            path = out / f"{folder.name}.json"
            write_text(path, json_text({"row": folder.name, "runs": seeds}))
            written.append(path)
    return written


def read_curve(path: Path) -> dict[str, Any]:
    """A learning curve (`SpidarError` for a damaged file)."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SpidarError(f"{path} is no learning curve ({error}); valid: one that a training script wrote") from error


def panels(curves: Sequence[dict[str, Any]], track: str) -> dict[str, dict[str, list[Curve]]]:
    """Metric → row → for each run its ticks, minutes, and absolute values on the validation scenarios.

    A run that adds to a controller begins as that one; one that flies by itself begins where it was judged first.
    """
    found: dict[str, dict[str, list[Curve]]] = {}
    for curve in curves:
        for run in curve["runs"]:
            base = run["base"].get(track)
            adds = run["settings"].get("action_mode") != "direct" and TAUGHT not in run.get("command", "")
            for metric, value in (base or {}).items():
                judged = [
                    (float(n["steps"]), n["seconds"] / 60.0, value * (1.0 + n["cells"][track][metric]))
                    for n in run["curve"]
                ]
                points = [(0.0, 0.0, value), *judged] if adds else judged
                found.setdefault(metric, {}).setdefault(curve["row"], []).append(Curve(*zip(*points, strict=True)))
    return found


def cost_lines(curves: Sequence[dict[str, Any]]) -> list[list[str]]:
    """What each row cost: its runs, ticks and wall time of each, and when the chosen agent had been found."""
    lines = [["row", "runs", "ticks a run", "minutes a run", "ticks/s", "of which", "chosen at", "score on validation"]]
    for curve in curves:
        runs = curve["runs"]
        lines.append([
            curve["row"],
            str(len(runs)),
            _range([run["curve"][-1]["steps"] / 1e3 for run in runs], ".0f", " k"),
            _range([run["seconds"] / 60.0 for run in runs], ".1f", ""),
            _range([run["curve"][-1]["steps"] / run["seconds"] for run in runs], ".0f", ""),
            _shares([run.get("parts", {}) for run in runs]),
            _range([run["chosen"]["steps"] / 1e3 for run in runs], ".0f", " k"),
            _range([100.0 * run["chosen"]["score"] for run in runs], "+.1f", " %"),
        ])  # fmt: skip
    return lines


def _shares(parts: Sequence[Mapping[str, float]]) -> str:
    """Where the wall time of some runs went, the largest part first; those below a hundredth are left out."""
    total = sum(sum(own.values()) for own in parts)
    sums = {name: sum(own.get(name, 0.0) for own in parts) for name in dict.fromkeys(n for own in parts for n in own)}
    shares = sorted(((seconds / total, name) for name, seconds in sums.items() if total), reverse=True)
    return ", ".join(f"{name} {share:.0%}" for share, name in shares if share >= 0.01) or "not measured"


def write_costs(curves: Sequence[dict[str, Any]], path: Path) -> None:
    """Write what the rows cost as a result of the guide."""
    source = {"command": "python -m train.curves", "version": __version__, "date": date.today().isoformat()}
    write_text(path, json_text({**source, "lines": cost_lines(curves)}))


def _range(values: Sequence[float], form: str, unit: str) -> str:
    """The least and the largest of some numbers, or one where they are written alike."""
    return " … ".join(dict.fromkeys(f"{value:{form}}" for value in (min(values), max(values)))) + unit


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.curves")
    gather(args.runs, args.out)
    curves = [read_curve(path) for path in sorted(args.out.glob("*.json"))]
    if not curves:
        raise SpidarError(
            f"no curves in {args.runs} and none in {args.out}; valid: a folder that a training script wrote"
        )
    drawn = {track: found for track in TRACKS if (found := panels(curves, track))}
    played = {
        track: next(run["settings"]["scenarios"] for c in curves for run in c["runs"] if track in run["base"])
        for track in drawn
    }
    total = sum(scenarios * len(LINES[TRACKS[track].world]) for track, scenarios in played.items())
    with Pool(args.workers) as pool, tqdm(total=total, unit="scenario", desc="lines") as bar:
        for track, scenarios in played.items():
            bar.set_postfix_str(track)
            lines = {
                row: PairedEvaluator(
                    [track], Base({"preset": preset}), scenarios, control=args.control, on_scenario=bar.update,
                    each=pool.map,
                ).means[track]
                for row, preset in LINES[TRACKS[track].world].items()
            }  # fmt: skip
            if TRACKS[track].world == BOTH:
                lines = {
                    run["settings"]["base"]: run["base"][track]
                    for c in curves
                    for run in c["runs"]
                    if track in run["base"]
                }
            picture = args.pictures / f"{track}.png"
            learning_curves(drawn[track], lines, f"{track}: validation scenarios", picture)
            bar.write(str(picture))
    write_costs(curves, args.costs)
    print(format_table(cost_lines(curves)))


if __name__ == "__main__":
    run_cli("train.curves", main)
