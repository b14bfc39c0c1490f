"""Kills commands and their workers at random times: no orphan, no partial file, no traceback, no finished work lost.

`pytest tests/adversary/test_hostile_kills.py -n0 -s --whole` makes all 70 kills and 20 Ctrl-C, and prints how long each
Ctrl-C took.
"""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.policies.artifact import read_artifact

ROOT = Path(__file__).resolve().parents[2]
SPIDAR = [sys.executable, "-c", "from spidar_gym.cli.main import main; main()"]
COMMANDS = {
    "eval": [*SPIDAR, "eval", "--policy", "baselines.qp:QP", "--tracks", "flight-fast5", "--scenarios", "4",
             "--workers", "2", "--cache", "kept", "--out", "scores"],
    "speeds": [*SPIDAR, "paper", "flight", "--speeds", "--scenarios", "1", "--workers", "2", "--out", "flight"],
    "tune": [*SPIDAR, "tune", "flight", "--generations", "1", "--population", "2", "--scenarios", "1", "--workers", "2",
             "--out", "tune"],
    "verify": [*SPIDAR, "leaderboard", "verify", "--rows", str(ROOT / "baselines" / "scores"), "--sample", "4",
               "--workers", "2"],
    "supervised": [sys.executable, "-m", "train.supervised", "hover-paper", "--tracks", "flight-fast3", "--rounds", "1",
                   "--flights", "4", "--updates", "50", "--forms", "1", "--scenarios", "2", "--hidden", "8",
                   "--workers", "2", "--no-row", "--out", "train"],
}  # fmt: skip
LAST_WORDS = {"eval": "written to", "speeds": "condition", "tune": "written to", "verify": "scenarios of",
              "supervised": "measure it:"}  # fmt: skip
NEEDS = {"tune": "cma", "supervised": "torch"}
PATIENCE = 15.0
"""Timeout for the end of a command on a busy machine [s]; an idle one needs a fraction of a second."""
ORPHANS = 5.0
"""Timeout for the end of all worker processes [s]."""


def start(name: str, folder: Path) -> subprocess.Popen:
    """Start a command in a new process session; return when its first progress bar appears."""
    folder.mkdir(exist_ok=True)
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    with (folder / "said").open("wb") as said:
        process = subprocess.Popen(
            COMMANDS[name], cwd=folder, stdout=said, stderr=said, start_new_session=True, env=env
        )  # fmt: skip
    end = time.monotonic() + 120.0
    while b"%|" not in (folder / "said").read_bytes() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    return process


def session(leader: int) -> dict[int, int]:
    """Living processes of a session: process → parent."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent, _, own = path.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(own) == leader and state != "Z":
            found[int(path.parent.name)] = int(parent)
    return found


def require_nobody(leader: int) -> None:
    end = time.monotonic() + ORPHANS
    while (left := session(leader)) and time.monotonic() < end:
        time.sleep(0.02)
    assert not left


def require_whole(folder: Path, *, killed: bool) -> None:
    """Assert that every file can be read, and that a writer which was not killed left no temporary file."""
    for path in folder.rglob("*"):
        inside = any(part.startswith(".spidar.") for part in path.relative_to(folder).parts)
        assert killed or not inside
        if path.suffix == ".json" and not inside:
            json.loads(path.read_text(encoding="utf-8"))
        if path.name == "policy.npz" and not inside:
            read_artifact(path)


def finished(folder: Path) -> list[Path]:
    return sorted((folder / "kept").rglob("*.json"))


def choose(rng: np.random.Generator) -> str:
    return str(rng.choice([name for name in COMMANDS if importlib.util.find_spec(NEEDS.get(name, "json"))]))


def resume(name: str, folder: Path) -> list:
    """Run a command to its end; return its row's results."""
    before = finished(folder)
    process = start(name, folder)
    assert process.wait(600.0) == 0, (folder / "said").read_text()
    assert set(before) <= set(finished(folder))
    (row,) = (folder / "scores").glob("*.json")
    return [track["runs"] for track in json.loads(row.read_text(encoding="utf-8"))["tracks"].values()]


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    return resume("eval", tmp_path_factory.mktemp("whole"))


ENDS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -signal.SIGKILL}


def test_kills_at_random_moments_leave_no_orphan_and_no_half_of_a_file(tries, rng, tmp_path, request):
    for number in range(tries(70)):
        name, folder = choose(rng), tmp_path / str(number)
        kind = signal.Signals(rng.choice(list(ENDS)))
        whom = str(rng.choice(["parent", "all", "worker"]))
        process = start(name, folder)
        time.sleep(rng.uniform(0.0, 4.0))
        workers = [pid for pid, parent in session(process.pid).items() if parent == process.pid]
        expected = ENDS[kind]
        if whom == "worker" and workers:
            os.kill(int(rng.choice(workers)), signal.SIGKILL)
            expected = 2
        elif process.poll() is None:
            (os.killpg if whom == "all" else os.kill)(process.pid, kind)
        status = process.wait(PATIENCE if expected != 2 else 300.0)
        said = (folder / "said").read_text(encoding="utf-8")
        # A command that has printed its last words may end regularly, or by the signal while Python shuts down.
        over = LAST_WORDS[name] in said
        assert status == expected or (over and status in (0, -kind)), (name, kind, whom, said)
        assert "Traceback" not in said
        assert expected != 2 or over or "a worker process was killed by SIGKILL at " in said
        require_nobody(process.pid)
        require_whole(folder, killed=kind == signal.SIGKILL)
        if name == "eval":
            assert resume(name, folder) == request.getfixturevalue("uninterrupted")


def test_ctrl_c_is_answered_at_once_wherever_it_comes(tries, tmp_path):
    rng = np.random.default_rng(20)
    names = [name for name in COMMANDS if importlib.util.find_spec(NEEDS.get(name, "json"))]
    for number in range(tries(20)):
        name, folder = names[number % len(names)], tmp_path / str(number)
        process = start(name, folder)
        time.sleep(rng.uniform(0.0, 4.0))
        began = time.monotonic()
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        status = process.wait(PATIENCE)
        took = time.monotonic() - began
        said = (folder / "said").read_text(encoding="utf-8")
        last = said.replace("\r", "\n").strip().splitlines()[-1]
        print(f"{name:11}{took:6.2f} s, status {status}: {last}")
        assert (status == 130 and "interrupted" in last) or LAST_WORDS[name] in said
        require_nobody(process.pid)
        require_whole(folder, killed=False)
