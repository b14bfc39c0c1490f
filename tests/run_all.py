"""Everything that must hold, in the order of CI: format, lint, types, imports, generated files, tests, wheel."""

import os
import subprocess
import sys
import tempfile
import venv
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent
WORKERS = str(min(4, os.cpu_count() or 1))
OLDEST = "gymnasium==1.2.0"
"""The oldest that pyproject.toml admits; the tests have the newest."""

# Side by side: pyright uses one core.
STATIC: list[tuple[str, list[str]]] = [
    ("types", ["pyright", "--pythonpath", sys.executable]),
    ("format", ["ruff", "format", "--check", "."]),
    ("lint", ["ruff", "check", "."]),
    ("import layers", ["lint-imports"]),
    ("generated files", ["spidar", "assets", "--check"]),
    ("onboard core", ["spidar", "export", "--build"]),
]
PYTEST = ["pytest", "-n", WORKERS, "--dist", "loadfile", "--durations", "12"]
STEPS: list[tuple[str, list[str]]] = [
    ("tests, shapes and types checked", [*PYTEST, "-m", "not ros and not slow and not train"]),
    # The same code for longer: the checks at run time would double its time, and have been made above.
    ("long tests", [*PYTEST, "-o", "addopts=--strict-markers -q", "-m", "(slow or train) and not ros"]),
    # In real time: nothing else runs beside them.
    ("tests through ROS 1", ["pytest", "-n", "2", "-m", "ros"]),
    ("rows of the leaderboard, played again", ["spidar", "leaderboard", "verify", "--sample", "10"]),
]


def run(title: str, command: list[str], cwd: Path | str = ROOT) -> None:
    """Run one step; stop everything where it fails."""
    print(f"── {title}: {' '.join(command)}", flush=True)
    code = subprocess.run(command, cwd=cwd, check=False).returncode
    if code != 0:
        sys.exit(f"{title} failed with exit status {code}")


def wheel_alone() -> None:
    """The built wheel, installed without the checkout on the oldest Gymnasium, makes an environment and flies it."""
    with tempfile.TemporaryDirectory() as folder:
        run("wheel", [sys.executable, "-m", "build", "--wheel", "--installer", "pip", "--outdir", folder, str(ROOT)])
        wheel = next(Path(folder).glob("*.whl"))
        venv.create(Path(folder) / "venv", with_pip=True, system_site_packages=False)
        python = str(Path(folder) / "venv" / "bin" / "python")
        run("install the wheel alone", [python, "-m", "pip", "install", "-q", str(wheel), OLDEST])
        run("smoke test on the wheel", [python, str(ROOT / "tests" / "smoke.py")], cwd=folder)


if __name__ == "__main__":
    with ThreadPoolExecutor(2) as pool:
        for step in [pool.submit(run, title, [str(BIN / command[0]), *command[1:]]) for title, command in STATIC]:
            step.result()
    for title, command in STEPS:
        run(title, [str(BIN / command[0]), *command[1:]])
    wheel_alone()
    print("all checks passed")
