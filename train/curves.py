"""Collect the learning curves of all seeds of each row, plot them by track, and write the guide's table of costs.

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
from spidar_gym.console import run_cli
from spidar_gym.control.presets import FORMER_PRESETS, PRESETS
from spidar_gym.errors import SpidarError, require_least
from spidar_gym.files import json_text, write_text
from spidar_gym.processes import Pool, cpu_count
from spidar_gym.text import format_table
from spidar_gym.viz import Curve, learning_curves
from train.lib.config import CONTROL
from train.lib.evaluate import Base, PairedEvaluator

FLIGHTS = {**PRESETS, **FORMER_PRESETS}
"""Presets of flight controllers."""
LINES = {
    FLIGHT: {row: preset for preset, row in BASES.items() if preset in FLIGHTS},
    GROUND: {row: preset for preset, row in BASES.items() if preset not in FLIGHTS},
    BOTH: {},
}
"""World → row of a base controller → its preset, plotted as horizontal lines; courses use the base of the runs."""


TAUGHT = "train.distill"
"""Recipe whose policies are not residuals, which its stored settings do not state."""


@dataclass(frozen=True)
class Args:
    """Collect the learning curves of runs and plot them."""

    runs: Path = Path("out/train")
    """Folder with runs, NAME/seedK/curve.json; if it is missing, the curves in --out are plotted again."""
    out: Path = Path("train/curves")
    """Folder for the collected curves, NAME.json."""
    pictures: Path = Path("out/curves")
    """Folder for the plots, TRACK.png."""
    costs: Path = Path("docs/results/learned_costs.json")
    """File for the costs of the rows, from which the guide's table is generated."""
    control: str = CONTROL
    """Controller implementation for the base controllers: python, or core, which is compiled."""
    workers: int = cpu_count()
    """Number of processes that run scenarios."""

    def __post_init__(self) -> None:
        require_least(1, workers=self.workers)


def gather(runs: Path, out: Path) -> list[Path]:
    """Write the curves of all seeds of each row to one file; return the paths (`SpidarError` for a damaged curve)."""
    written = []
    for folder in sorted(path for path in runs.glob("*") if path.is_dir()):
        seeds = [read_curve(path) for path in sorted(folder.glob("seed*/curve.json"))]
        if seeds:
            path = out / f"{folder.name}.json"
            write_text(path, json_text({"row": folder.name, "runs": seeds}))
            written.append(path)
    return written


def read_curve(path: Path) -> dict[str, Any]:
    """Read a learning curve (`SpidarError` for a damaged file)."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SpidarError(f"{path} is no learning curve ({error}); valid: one that a training script wrote") from error


def panels(curves: Sequence[dict[str, Any]], track: str) -> dict[str, dict[str, list[Curve]]]:
    """Return metric → row → curves of its runs: ticks, minutes and absolute values on the validation scenarios.

    The curve of a residual begins with its base; the curve of a policy without a controller with its first validation.
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
    """Return the table of costs: number of runs, ticks and wall time per run, and ticks at the chosen agent."""
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
    """Format the shares of the runs' wall time, largest first, without those below 1 %."""
    total = sum(sum(own.values()) for own in parts)
    sums = {name: sum(own.get(name, 0.0) for own in parts) for name in dict.fromkeys(n for own in parts for n in own)}
    shares = sorted(((seconds / total, name) for name, seconds in sums.items() if total), reverse=True)
    return ", ".join(f"{name} {share:.0%}" for share, name in shares if share >= 0.01) or "not measured"


def write_costs(curves: Sequence[dict[str, Any]], path: Path) -> None:
    """Write the table of costs to a result file of the guide."""
    source = {"command": "python -m train.curves", "version": __version__, "date": date.today().isoformat()}
    write_text(path, json_text({**source, "lines": cost_lines(curves)}))


def _range(values: Sequence[float], form: str, unit: str) -> str:
    """Format the smallest and the largest of some numbers, or one number if both are formatted alike."""
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
