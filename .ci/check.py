"""Runs all checks in the order of CI: format, lint, types, imports, generated files, guide, tests, wheel."""

import argparse
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent
WORKERS = str(min(4, os.cpu_count() or 1))
QUICK = (
    "benchmark/comparison", "benchmark/row", "benchmark/statistics", "benchmark/track", "cli/bench",
    "control/allocation/allocator", "control/allocation/blocks", "control/allocation/contact",
    "control/allocation/fallbacks", "control/allocation/projection",
    "control/crawl/footsteps", "control/crawl/kinematics", "control/crawl/pose2", "control/flight/centroidal",
    "control/flight/controller", "control/flight/margins", "control/flight/observation", "control/presets",
    "control/thrust", "envs/actions", "envs/docs", "errors", "files", "meta/architecture", "meta/check",
    "meta/docs", "meta/ledger", "meta/pages", "meta/readme",
    "model/dynamics", "model/interference", "model/rotor", "paper/flight",
    "robot/description", "robot/spec", "sim/body", "sim/disturbances", "sim/energy", "sim/randomize", "sim/sensors",
    "so3", "train/headroom",
)  # fmt: skip
"""Test files of --fast: each takes at most about twelve seconds of one core, all together 160."""


def test_file(name: str) -> str:
    """Return the path of a test file: `sim/plant` → `tests/sim/test_plant.py`."""
    folder, _, module = name.rpartition("/")
    return str(Path("tests", folder, f"test_{module}.py"))


@dataclass(frozen=True)
class Stage:
    """Commands that run in parallel, and their expected duration."""

    title: str
    """Title of the stage."""
    commands: dict[str, list[str]]
    """Title → command; its first word is a program of this environment."""
    minutes: float
    """Expected duration on two quiet cores [min]."""

    @property
    def limit(self) -> float:
        """Time limit of each command [s], so that a hanging command does not block the whole check."""
        return 60.0 * max(5.0, 4.0 * self.minutes)


# In parallel: pyright uses one core.
CHECKS: dict[str, list[str]] = {
    "types": ["pyright", "--pythonpath", sys.executable],
    "format": ["ruff", "format", "--check", "."],
    "lint": ["ruff", "check", "."],
    "import layers": ["lint-imports"],
    "words": ["python", str(Path(".ci", "words.py"))],
    "generated files": ["spidar", "assets", "--check"],
}
# Sphinx's warnings and broken links are errors; no network is used.
GUIDE = {"guide": ["spidar", "docs"]}
# -rs prints the reasons of skipped tests.
PYTEST = ["pytest", "-rs", "-n", WORKERS, "--dist", "loadfile"]
TIMED = [*PYTEST, "--durations", "12"]
UNCHECKED = "--strict-markers -q --import-mode=importlib"
"""Pytest's options of pyproject.toml without the checks of shapes and types."""
FULL = (
    Stage("static checks, guide", CHECKS | GUIDE, 1.2),
    Stage(
        "tests, shapes and types checked",
        {"pytest": [*TIMED, "-m", "not (ros or slow or train or unchecked)"]},
        5.5,
    ),
    # Long runs of the same code: checks at run time would double their time, and the stage above makes them.
    Stage(
        "whole programs, long tests",
        {"pytest": [*TIMED, "-o", f"addopts={UNCHECKED}", "-m", "(slow or train or unchecked) and not ros"]},
        10.0,
    ),
    # In real time: nothing else runs in parallel.
    Stage("tests through ROS 1", {"pytest": ["pytest", "-rs", "-n0", "-m", "ros"]}, 4.5),
    Stage("leaderboard rows, evaluated again", {"verify": ["spidar", "leaderboard", "verify", "--sample", "10"]}, 0.2),
    Stage("wheel, installed alone", {"wheel": ["python", str(Path(".ci", "wheel.py"))]}, 0.8),
)
FAST = (
    Stage("static checks", CHECKS, 0.7),
    Stage(
        "quick tests",
        {"pytest": [*PYTEST, "-m", "not ros and not slow and not train", *map(test_file, QUICK)]},
        2.0,
    ),
)


def run(title: str, command: list[str], limit: float = 300.0, cwd: Path | str = ROOT) -> None:
    """Run one command for `limit` seconds at most; exit if it fails."""
    print(f"── {title}: {' '.join(command)}", flush=True)
    try:
        code = subprocess.run(command, cwd=cwd, check=False, timeout=limit).returncode
    except subprocess.TimeoutExpired:
        sys.exit(f"{title} was stopped after {limit / 60:.0f} min")
    if code != 0:
        sys.exit(f"{title} failed with exit status {code}")


def play(stage: Stage) -> None:
    """Run a stage and print its duration and CPU time, whose ratio reveals a busy machine."""
    start, worked = time.monotonic(), _processor_minutes()
    with ThreadPoolExecutor(2) as pool:
        program = {title: [str(BIN / first), *rest] for title, (first, *rest) in stage.commands.items()}
        for done in [pool.submit(run, title, command, stage.limit) for title, command in program.items()]:
            done.result()
    print(
        f"── {stage.title}: {(time.monotonic() - start) / 60:.1f} min, {_processor_minutes() - worked:.1f} min of "
        f"processor time; {stage.minutes:g} min on two quiet cores",
        flush=True,
    )


def _processor_minutes() -> float:
    times = os.times()
    return (times.children_user + times.children_system) / 60.0


def plan(stages: tuple[Stage, ...]) -> str:
    """Return the stages with their expected minutes, as text."""
    lines = [f"{stage.minutes:4.1f} min  {stage.title}" for stage in stages]
    return "\n".join([*lines, f"{sum(stage.minutes for stage in stages):4.1f} min  in all, on two quiet cores"])


def main(arguments: list[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=f"everything:\n{plan(FULL)}\n\n--fast:\n{plan(FAST)}\n\n"
        "adversaries run a sample of their attempts, ROS some missions; all of them: pytest tests/adversary --whole, "
        "pytest -n0 -m ros --whole; from logs to the tuned flight: "
        "pytest -n0 tests/onboard/test_tuned_flight.py --whole",
    )
    parser.add_argument("--fast", action="store_true", help="run only the quick checks, for use between two commits")
    fast = parser.parse_args(arguments).fast
    stages = FAST if fast else FULL
    print(plan(stages), flush=True)
    for stage in stages:
        play(stage)
    print("all quick checks passed; the others: python .ci/check.py" if fast else "all checks passed")


if __name__ == "__main__":
    main()
