"""Results of runs on the suite as a long table, their statistics as papers use them, and the tables of the guide."""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from spidar_gym.benchmark.statistics import DRAWS, Interval, iqm, named_generator
from spidar_gym.benchmark.suite import METRICS
from spidar_gym.committed import ROOT
from spidar_gym.envs.suite import SUITE, VERSION, SuiteTask
from spidar_gym.errors import SpidarError

RESULTS = ROOT / "baselines" / f"suite_{VERSION}.csv"
"""File with the committed runs."""
ALGORITHMS = ("ppo", "sac")
"""Algorithms of the table."""
MODES, REWARDS = ("torso_forces", "direct"), ("sloped", "narrow")
"""Action modes and rewards whose worth is measured; the first are those of the suite."""


@dataclass(frozen=True, order=True)
class Result:
    """One metric of one evaluation of a run."""

    algorithm: str
    """Name of the algorithm."""
    task: str
    """Task of the suite; with `-MODE` or `-REWARD` behind it if the run was trained with another one."""
    seed: int
    """Seed of the run."""
    step: int
    """Length of training before the evaluation [control ticks]."""
    seconds: float
    """Wall time of this training, without evaluations [s]."""
    metric: str
    """One of `METRICS`."""
    value: float
    """Mean over the episodes."""


HEAD = tuple(field.name for field in fields(Result))
"""Columns of the table."""


def read_results(path: Path) -> list[Result]:
    """Read a table of results (`SpidarError` with the line that is none)."""
    try:
        lines = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SpidarError(f"{path} is no table of results: {error}; valid: columns {', '.join(HEAD)}") from error
    if not lines or tuple(lines[0]) != HEAD:
        raise SpidarError(f"{path} is no table of results; valid: columns {', '.join(HEAD)}")
    found = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            algorithm, task, seed, step, seconds, metric, value = line
            row = Result(algorithm, task, int(seed), int(step), float(seconds), metric, float(value))
        except ValueError as error:
            raise SpidarError(f"{path}, line {number}: {error}; valid: {', '.join(HEAD)}") from error
        if not (task.split("-")[0] in SUITE and metric in METRICS and math.isfinite(row.value + row.seconds)):
            raise SpidarError(
                f"{path}, line {number}: {task}, {metric}, {value}; valid: a task of {', '.join(SUITE)}, a metric of "
                f"{', '.join(METRICS)}, a finite value"
            )
        found.append(row)
    return found


def results_text(rows: Iterable[Result]) -> str:
    """Return a table of results as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEAD)
    for row in rows:
        writer.writerow([f"{each:.6g}" if name == "value" else each for name, each in vars(row).items()])
    return text.getvalue()


def merged(rows: Iterable[Result], others: Iterable[Result]) -> list[Result]:
    """Return rows in order, each run of `others` in place of a run of the same algorithm, task and seed."""
    others = list(others)
    new = {(row.algorithm, row.task, row.seed) for row in others}
    kept = [row for row in rows if (row.algorithm, row.task, row.seed) not in new]
    names = list(SUITE)
    order = {name: k for k, name in enumerate(METRICS)}
    return sorted(
        [*kept, *others],
        key=lambda row: (names.index(row.task.split("-")[0]), row.task, row.algorithm, row.seed, row.step,
                         order[row.metric]),
    )  # fmt: skip


@dataclass(frozen=True)
class Curves:
    """One metric of all seeds of a task and an algorithm."""

    steps: np.ndarray
    """Length of training before each evaluation (K,) [control ticks]."""
    seconds: np.ndarray
    """Wall time of this training (seeds, K) [s]."""
    values: np.ndarray
    """Value of the metric (seeds, K)."""

    @property
    def last(self) -> list[float]:
        """Value of each seed at the end."""
        return self.values[:, -1].tolist()


def curves(rows: Iterable[Result], task: str, algorithm: str, metric: str) -> Curves | None:
    """Return the curves of all runs that are as long as the longest; None if there is none."""
    runs: dict[int, list[Result]] = {}
    for row in rows:
        if (row.task, row.algorithm, row.metric) == (task, algorithm, metric):
            runs.setdefault(row.seed, []).append(row)
    if not runs:
        return None
    longest = max(([row.step for row in own] for own in runs.values()), key=lambda steps: steps[-1])
    whole = [own for _, own in sorted(runs.items()) if [row.step for row in own] == longest]
    return Curves(
        np.array(longest), np.array([[row.seconds for row in own] for own in whole]),
        np.array([[row.value for row in own] for own in whole]),
    )  # fmt: skip


def interval(values: Mapping[str, Sequence[float]], rng: np.random.Generator) -> Interval:
    """Return the IQM over all seeds of all tasks, with an interval whose draws are stratified by task.

    Args:
        values: Task → value of each seed.
        rng: Generator of the draws.
    """
    rows = [np.asarray(each, float) for each in values.values()]
    drawn = [row[rng.integers(len(row), size=(DRAWS, len(row)))] for row in rows]
    low, high = np.percentile(iqm(np.concatenate(drawn, axis=1)), [2.5, 97.5]).tolist()
    return Interval(float(iqm(np.concatenate(rows))), low, high)


def profile(values: Mapping[str, Sequence[float]], thresholds: np.ndarray) -> np.ndarray:
    """Return the performance profile: the share of runs above each threshold, tasks weighing alike.

    Args:
        values: Task → value of each seed.
        thresholds: Thresholds (K,).
    """
    return np.mean([[np.mean(np.asarray(each) > at) for at in thresholds] for each in values.values()], axis=0)


def returns_of(rows: Sequence[Result], algorithm: str) -> dict[str, list[float]]:
    """Return the returns of each seed on the task's scale at the end, for each task of the suite that has runs."""
    found = {}
    for name, task in SUITE.items():
        own = curves(rows, name, algorithm, "return")
        if own is not None:
            found[name] = task.normalised(np.array(own.last)).tolist()
    return found


def _cell(value: Interval, seeds: int, digits: int = 2) -> str:
    """Return a value with its interval, which one seed does not have."""
    if seeds < 2:
        return f"{value.value:.{digits}f}"
    return f"{value.value:.{digits}f} [{value.low:.{digits}f}, {value.high:.{digits}f}]"


def _cells(rows: Sequence[Result], task: SuiteTask, algorithm: str) -> list[str]:
    """Return the cells of an algorithm on a task: ticks, return on the task's scale, success, time of a run."""
    found = {metric: curves(rows, task.name, algorithm, metric) for metric in ("return", "success")}
    returns, success = found["return"], found["success"]
    if returns is None or success is None:
        return [f"`python -m train.standard {task.name} {algorithm} --seed 0`", "", "", ""]
    scaled = {task.name: task.normalised(np.array(returns.last)).tolist()}
    words = ("suite", task.name, algorithm)
    shares = interval({task.name: [100.0 * each for each in success.last]}, named_generator(*words, "success"))
    return [
        f"{returns.steps[-1] / 1e6:.1f} M × {len(returns.values)}",
        _cell(interval(scaled, named_generator(*words)), len(returns.values)),
        f"{_cell(shares, len(success.values), 0)} %",
        f"{returns.seconds[:, -1].mean() / 3600.0:.1f} h",
    ]


def suite_lines(rows: Sequence[Result], *, only_runs: bool = False) -> list[list[str]]:
    """Return the table of the suite: a line for each task and algorithm, and one over all tasks of an algorithm.

    Args:
        rows: Results.
        only_runs: Whether tasks without runs are left out.
    """
    lines = [["task", "algorithm", "ticks × seeds", "return", "success", "time of a run"]]
    for algorithm in ALGORITHMS:
        for name, task in SUITE.items():
            if not only_runs or curves(rows, name, algorithm, "return"):
                lines.append([name, algorithm, *_cells(rows, task, algorithm)])
        found = returns_of(rows, algorithm)
        if len(found) > 1:
            own = interval(found, named_generator("suite", algorithm))
            lines.append(
                [f"the {len(found)} with runs", algorithm, "", _cell(own, min(map(len, found.values()))), "", ""]
            )
    return lines


def variant_lines(rows: Sequence[Result], task: str) -> list[list[str]]:
    """Return what action mode and reward are worth on a task: IQM of return and success of each pair, the same ticks.

    Args:
        rows: Results, with runs of `--mode` and `--reward`.
        task: Task of the suite.
    """
    lines = [["action mode", *(f"reward `{reward}`" for reward in REWARDS)]]
    for mode in MODES:
        cells = []
        for reward in REWARDS:
            name = f"{task}-{mode}-{reward}"
            returns, success = (curves(rows, name, "ppo", metric) for metric in ("return", "success"))
            if returns is None or success is None:
                cells.append(f"`python -m train.standard {task} ppo --mode {mode} --reward {reward}`")
                continue
            scaled = SUITE[task].normalised(np.array(returns.last))
            each = ", ".join(f"{value:.2f}" for value in scaled)
            cells.append(
                f"{float(iqm(scaled)):.2f} ({each}), {100.0 * np.mean(success.last):.0f} % after "
                f"{returns.steps[-1] / 1e6:.1f} M"
            )
        lines.append([f"`{mode}`", *cells])
    return lines


def task_lines() -> list[list[str]]:
    """Return the table of the tasks."""
    lines = [["task", "id", "what", "success", "0 on its scale", "1 on its scale", "budget"]]
    for name, task in SUITE.items():
        zero, one = task.anchors
        budgets = ", ".join(f"{algorithm} {ticks / 1e6:g} M" for algorithm, ticks in task.budgets.items())
        classical = task.classical.partition(":")[2]
        lines.append([f"[{name}](../suite/{name}.md)", f"`{task.id}`", task.doc, task.success, f"{zero:.1f}",
                      f"{one:.1f}, `{classical}`", budgets])  # fmt: skip
    return lines
