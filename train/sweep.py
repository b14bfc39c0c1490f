"""Seeds and hyperparameters of a preset side by side: a Ray Tune sweep of `train.residual`, here or on a cluster.

    python -m train.sweep hover-paper-ppo --seeds 0 1 2 3 4 --lr 3e-4 1e-3 --steps 500000

Every trial is a run like any other: it has a folder of its own, and goes on where it was when the sweep is started
again. On a cluster the folder must be one that all its machines share.
"""

import importlib.util
import itertools
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from spidar_gym.benchmark.cluster import cluster
from spidar_gym.cli.console import run_cli
from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError, require_name
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.processes import cpu_count
from spidar_gym.text import format_table
from train import residual
from train.curves import read_curve
from train.lib.config import override
from train.lib.run import command_line, require_frameworks

FOUND = ("chosen", "score", "worst", "success", "steps", "seconds")
"""What a trial reports: the paired score of the agent that it would publish, and the last line of its curve."""
SWEPT = ("lr", "gamma", "log_std", "washout", "penalty")
"""Hyperparameters of which a sweep tries several."""
FIXED = ("steps", "segment", "scenarios", "envs", "scaling_ticks")
"""Settings that all trials share."""


@dataclass(frozen=True)
class Args:
    """Sweep over seeds and hyperparameters."""

    preset: Annotated[str, tyro.conf.Positional]
    """Preset of train.residual."""
    seeds: tuple[int, ...] = (0,)
    """Seeds."""
    lr: tuple[float, ...] = ()
    """Learning rates at the beginning; the preset's if none is given, as with the others."""
    gamma: tuple[float, ...] = ()
    """Discounts."""
    log_std: tuple[float, ...] = ()
    """Logarithms of the exploration's standard deviation."""
    washout: tuple[float, ...] = ()
    """Time constants of the washout [s]."""
    penalty: tuple[float, ...] = ()
    """Fractions of the reward that the largest action costs."""
    steps: int = 0
    """Control ticks of each trial; the preset's if 0."""
    segment: int = 0
    """Ticks between two reports; the preset's if 0."""
    scenarios: int = 0
    """Validation scenarios of each track; the preset's if 0."""
    envs: int = 0
    """Environments of each trial; the preset's if 0."""
    scaling_ticks: int = 0
    """Ticks of the baseline from which the observations' scaling is taken; the preset's if 0."""
    ray: str = "local"
    """Cluster: local, auto, or host:port."""
    workers: int = cpu_count()
    """Trials side by side on a local cluster, each on one core."""
    out: Path = Path("out/sweep")
    """Folder: results.json, and the trials' runs."""

    def __post_init__(self) -> None:
        require_name("preset", self.preset, residual.PRESETS)
        if not self.seeds:
            raise InvalidValueError("seeds", self.seeds, "at least one seed")

    def trials(self) -> list[dict[str, Any]]:
        """Settings of every trial: all combinations."""
        swept = {name: getattr(self, name) for name in SWEPT if getattr(self, name)}
        fixed = {name: getattr(self, name) for name in FIXED if getattr(self, name)}
        return [
            {**fixed, "seed": seed, **dict(zip(swept, values, strict=True))}
            for values in itertools.product(*swept.values())
            for seed in self.seeds
        ]


def settings(args: Args, trial: dict[str, Any]) -> residual.Args:
    """A trial's settings, with a folder whose name says what was swept."""
    words = [f"{name}={value:g}" for name, value in trial.items() if name in SWEPT]
    out = args.out.absolute() / ("_".join(words) or "preset")
    return override(residual.PRESETS[args.preset], **trial, row=False, out=out)


def sweep(args: Args) -> list[dict[str, Any]]:
    """Run all trials; a line of results each, best first, those that failed last."""
    if importlib.util.find_spec("ray") is None or importlib.util.find_spec("ray.tune") is None:
        raise MissingDependencyError("Ray Tune", "pip install 'spidar-gym[ray,train]'")
    require_frameworks()
    folder = output_folder(args.out).absolute()
    command = command_line().split()[2:]

    def trial(config: dict[str, Any]) -> None:
        from ray import tune

        # What an artifact says it was made by.
        sys.argv = command

        def report(line: dict[str, Any]) -> None:
            tune.report({name: line.get(name) for name in FOUND})

        path = residual.learn(settings(args, config["trial"]), on_segment=report)
        # The last word, which a run that was finished before has too.
        curve = read_curve(path.with_name("curve.json"))
        report({**curve["curve"][-1], "chosen": curve["chosen"]["score"]})

    # A trial stays in this folder, where `train` is found; one core each, or BLAS would take them all.
    variables = {"RAY_CHDIR_TO_TRIAL_DIR": "0", "OMP_NUM_THREADS": "1"}
    with cluster(args.ray, args.workers, variables=variables, logging_level="ERROR"):
        from ray import tune

        grid = tune.Tuner(
            tune.with_resources(trial, {"cpu": 1}),
            param_space={"trial": tune.grid_search(args.trials())},
            run_config=tune.RunConfig(storage_path=str(folder / "tune"), verbose=1),
        ).fit()
    lines = []
    for result in grid:
        metrics, error = result.metrics or {}, str(result.error or "").strip()
        found = {name: metrics.get(name) for name in FOUND}
        lines.append({**(result.config or {})["trial"], **found, "error": error and error.splitlines()[-1]})
    return sorted(lines, key=lambda line: (line["error"] != "", line["chosen"] or 0.0, line["score"] or 0.0))


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.sweep")
    lines = sweep(args)
    write_text(args.out / "results.json", json_text({"preset": args.preset, "trials": lines}))
    cells = [[f"{v:.4g}" if isinstance(v, float) else str(v) for v in line.values()] for line in lines]
    print(format_table([list(lines[0]), *cells]))
    failed = [line["error"] for line in lines if line["error"]]
    if failed:
        raise SpidarError(f"{len(failed)} of {len(lines)} trials failed, the first of them with {failed[0]}")


if __name__ == "__main__":
    run_cli("train.sweep", main)
