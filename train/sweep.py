"""Sweep over seeds and hyperparameters of a preset of `train.residual` with Ray Tune, locally or on a cluster.

    python -m train.sweep hover-paper-ppo --seeds 0 1 2 3 4 --lr 3e-4 1e-3 --steps 500000

Every trial is an ordinary run with its own folder, and resumes when the sweep is started again. On a cluster, all
machines must share the folder.
"""

import importlib.util
import itertools
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from spidar_gym.benchmark.cluster import cluster
from spidar_gym.console import run_cli
from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError, require_name
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.processes import cpu_count
from spidar_gym.text import format_table
from train import residual
from train.curves import read_curve
from train.lib.config import override
from train.lib.run import command_line, require_frameworks

FOUND = ("chosen", "score", "worst", "success", "steps", "seconds")
"""Reported results of a trial: the paired score of the chosen agent, and the last line of its curve."""
SWEPT = ("lr", "gamma", "log_std", "washout", "penalty")
"""Hyperparameters that a sweep can vary."""
FIXED = ("steps", "segment", "scenarios", "envs", "scaling_ticks")
"""Settings that all trials share."""


@dataclass(frozen=True)
class Args:
    """Sweep over seeds and hyperparameters."""

    preset: Annotated[str, tyro.conf.Positional]
    """Preset of train.residual."""
    seeds: tuple[int, ...] = (0,)
    """Training seeds."""
    lr: tuple[float, ...] = ()
    """Initial learning rates; the preset's if none is given."""
    gamma: tuple[float, ...] = ()
    """Discount factors per decision; the preset's if none is given."""
    log_std: tuple[float, ...] = ()
    """Natural logarithms of the exploration's initial standard deviation; the preset's if none is given."""
    washout: tuple[float, ...] = ()
    """Time constants of the washout [s]; the preset's if none is given."""
    penalty: tuple[float, ...] = ()
    """Penalties on the mean square action, as fractions of the reward; the preset's if none is given."""
    steps: int = 0
    """Length of each trial [control ticks]; the preset's if 0."""
    segment: int = 0
    """Length of a segment between two reports [control ticks]; the preset's if 0."""
    scenarios: int = 0
    """Number of validation scenarios of each track; the preset's if 0."""
    envs: int = 0
    """Number of robots of each trial; the preset's if 0."""
    scaling_ticks: int = 0
    """Control ticks flown on each track to determine the scaling of the observations; the preset's if 0."""
    ray: str = "local"
    """Ray cluster: local, auto, or HOST:PORT."""
    workers: int = cpu_count()
    """Number of parallel trials on a local cluster, each on one core."""
    out: Path = Path("out/sweep")
    """Folder for results.json and the runs of the trials."""

    def __post_init__(self) -> None:
        require_name("preset", self.preset, residual.PRESETS)
        if not self.seeds:
            raise InvalidValueError("seeds", self.seeds, "at least one seed")

    def trials(self) -> list[dict[str, Any]]:
        """Return the settings of every trial: all combinations."""
        swept = {name: getattr(self, name) for name in SWEPT if getattr(self, name)}
        fixed = {name: getattr(self, name) for name in FIXED if getattr(self, name)}
        return [
            {**fixed, "seed": seed, **dict(zip(swept, values, strict=True))}
            for values in itertools.product(*swept.values())
            for seed in self.seeds
        ]


def settings(args: Args, trial: dict[str, Any]) -> residual.Args:
    """Return the settings of a trial, with a folder named after the swept values."""
    words = [f"{name}={value:g}" for name, value in trial.items() if name in SWEPT]
    out = args.out.absolute() / ("_".join(words) or "preset")
    return override(residual.PRESETS[args.preset], **trial, row=False, out=out)


def sweep(args: Args) -> list[dict[str, Any]]:
    """Run all trials; return a line of results for each, best first, failed ones last."""
    if importlib.util.find_spec("ray") is None or importlib.util.find_spec("ray.tune") is None:
        raise MissingDependencyError("Ray Tune", "pip install 'spidar-gym[ray,train]'")
    require_frameworks()
    folder = output_folder(args.out).absolute()
    command = command_line().split()[2:]

    def trial(config: dict[str, Any]) -> None:
        from ray import tune

        # The command that is stored in the artifact.
        sys.argv = command

        def report(line: dict[str, Any]) -> None:
            tune.report({name: line.get(name) for name in FOUND})

        path = residual.learn(settings(args, config["trial"]), on_segment=report)
        # The final report, also for a run that was already complete.
        curve = read_curve(path.with_name("curve.json"))
        report({**curve["curve"][-1], "chosen": curve["chosen"]["score"]})

    # Trials run in this folder, so that `train` can be imported, and on one core each; BLAS would use all cores.
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
