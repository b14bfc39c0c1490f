"""Tests each client library in a separate Python environment, for the guide's table: `python -m tests.clients`."""

import argparse
import json
import os
import site
import subprocess
import sys
import venv
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from xml.etree import ElementTree

from spidar_gym import __version__
from spidar_gym.console import run_cli
from spidar_gym.errors import require_name
from spidar_gym.files import output_folder
from spidar_gym.text import format_table

ROOT = Path(__file__).resolve().parents[2]
COMMAND = "python -m tests.clients --out docs/results/clients.json"
HEADING = ["client", "tried with", "outcome", "what was done"]
LIMIT = 1200.0
"""Time limit of each installation and of each client's tests [s]."""
VERSIONS = "import sys; from importlib.metadata import version; print(*map(version, sys.argv[1:]))"
PYTEST = ["-o", "addopts=--strict-markers -q --import-mode=importlib", "-o", "filterwarnings=default"]
"""Options of pytest that override pyproject.toml, as clients may raise warnings."""


@dataclass(frozen=True)
class Client:
    """A library, or a version of a library, that uses environments."""

    test: str
    """Name of its test file, without `test_` and `.py`."""
    install: tuple[tuple[str, ...], ...]
    """Requirements of each call of pip; later calls override versions that a client pins."""
    packages: tuple[str, ...]
    """Packages whose versions are reported."""
    done: str
    """Description of its test."""
    glue: str = ""
    """Adapter between client and environment, if the client's documented use is not sufficient."""
    but: str = ""
    """What does not work, and why."""

    @property
    def works(self) -> str:
        """Outcome if all tests pass."""
        how = f"glue: {self.glue}" if self.glue else "unchanged"
        return f"{how}; but not {self.but}" if self.but else how


LEARNS = "learns some hundred steps by id; its episodes' ends, lengths, rewards, `is_success`"
VECTORS = "one robot, native, sync and async vectors, each in the three autoreset modes"
CLIENTS = {
    "Gymnasium 1.2": Client("gymnasium", (("gymnasium==1.2.0",),), ("gymnasium",), VECTORS),
    "Gymnasium 1.3": Client("gymnasium", (("gymnasium==1.3.0",),), ("gymnasium",), VECTORS),
    "Gymnasium 1.4": Client("gymnasium", (("gymnasium==1.4.0",),), ("gymnasium",), VECTORS),
    "Gymnasium's conversions": Client(
        "converters", (("array-api-compat", "jax"),), ("gymnasium", "torch", "jax"),
        "to torch and JAX, of one robot and of both kinds of vectors: all is a tensor, no word is lost",
        "`Coded` around one robot; the native vector is unchanged",
        "Gymnasium's own vectors in the mode `SameStep`: Gymnasium fails there with every environment",
    ),
    "Stable-Baselines3": Client(
        "stable_baselines", (("stable-baselines3",),), ("stable-baselines3", "gymnasium", "torch"), f"PPO {LEARNS}"
    ),
    "sb3-contrib": Client("sb3_contrib", (("sb3-contrib",),), ("sb3-contrib", "gymnasium", "torch"), f"TQC {LEARNS}"),
    "sbx": Client("sbx", (("sbx-rl",),), ("sbx-rl", "gymnasium", "jax"), f"SAC {LEARNS}"),
    "RL Zoo": Client(
        "rl_zoo", (("rl_zoo3", "optuna"),), ("rl_zoo3", "optuna", "gymnasium", "torch"),
        "trains with a preset of `train/zoo`, evaluates, and searches with Optuna; lengths, successes, trials",
    ),
    "loop after CleanRL": Client(
        "cleanrl", (("torch",),), ("gymnasium", "torch"), "an actor and a critic over the native vector learn; as above"
    ),
    "RLlib": Client("rllib", (("ray[rllib]",),), ("ray", "gymnasium", "torch"), f"PPO {LEARNS}"),
    "Tianshou": Client(
        "tianshou", (("tianshou",),), ("tianshou", "gymnasium", "torch"),
        f"PPO {LEARNS}; its buffer keeps what was told",
    ),
    "skrl": Client(
        "skrl", (("skrl",),), ("skrl", "gymnasium", "torch"), "PPO learns over the native vector; rewards, `is_success`"
    ),
    "TorchRL": Client(
        "torchrl", (("torchrl",),), ("torchrl", "gymnasium", "torch"),
        "`GymEnv` by id, its own vectors, the native one: specs of every environment, episodes' ends, `is_success`",
        but="`GymEnv(…, num_envs=N)`, in which TorchRL takes no words of `info`: its `SerialEnv` works",
    ),
    "Minari and d3rlpy": Client(
        "minari", (("minari[create,hdf5]", "d3rlpy"), ("gymnasium>=1.2",)), ("minari", "d3rlpy", "gymnasium", "torch"),
        "records episodes with all of `info`, reads them again, learns from them offline, evaluates",
        "d3rlpy pins Gymnasium to 1.0.0: a newer one is installed after it",
    ),
}  # fmt: skip


def make_environment(folder: Path) -> str:
    """Create a Python environment; return its interpreter.

    The packages of this process are appended to its path, after the packages installed into it.
    """
    if not folder.exists():
        venv.create(folder, with_pip=True)
        (own,) = folder.glob("lib/python*/site-packages")
        lines = [f"import site; site.addsitedir({path!r})\n" for path in site.getsitepackages()]
        (own / "behind.pth").write_text("".join(lines), encoding="utf-8")
    return str(folder / "bin" / "python")


def last_line(text: str, most: int = 160) -> str:
    """Return the last line of a program's output, cut to `most` characters."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:most] if lines else "no output"


def verdict(report: str, works: str) -> str:
    """Summarise a client's tests from pytest's report in XML; `works` if they passed."""
    cases = list(ElementTree.fromstring(report).iter("testcase"))
    for case in cases:
        for what in (*case.findall("failure"), *case.findall("error")):
            return f"fails: {last_line(what.get('message', '').partition(chr(10))[0])}"
    passed = [case for case in cases if case.find("skipped") is None]
    return works if passed else "not tried: every test was skipped"


def attempt(client: Client, folder: Path) -> tuple[str, str]:
    """Install and test a client; return the tested versions and the outcome."""
    environ = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    python = make_environment(folder)

    def run(*command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [python, *command], cwd=ROOT, env=environ, capture_output=True, text=True, timeout=LIMIT, check=False
        )

    for asked in client.install:
        done = run("-m", "pip", "install", "-q", "--disable-pip-version-check", *asked)
        if done.returncode:
            return ", ".join(asked), f"not installed: {last_line(done.stderr)}"
    versions = run("-c", VERSIONS, *client.packages).stdout.split()
    tried = ", ".join(map(" ".join, zip(client.packages, versions, strict=False)))
    report = folder / "report.xml"
    report.unlink(missing_ok=True)
    done = run("-m", "pytest", *PYTEST, f"--junitxml={report}", f"tests/clients/test_{client.test}.py")
    if not report.exists():
        return tried, f"fails: {last_line(done.stderr)}"
    return tried, verdict(report.read_text(encoding="utf-8"), client.works)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns 1 if a client fails or cannot be installed."""
    parser = argparse.ArgumentParser(prog="python -m tests.clients", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="CLIENT", help=f"clients, all if not given: {', '.join(CLIENTS)}")
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "clients", help="folder for the environments")
    parser.add_argument("--out", type=Path, help="file for the result, from which the guide's table is generated")
    args = parser.parse_args(arguments)
    for name in args.names:
        require_name("client", name, CLIENTS)
    lines = []
    for name in args.names or CLIENTS:
        client = CLIENTS[name]
        folder = output_folder(args.folder) / "".join(c if c.isalnum() or c in ".-" else "_" for c in name)
        try:
            tried, outcome = attempt(client, folder)
        except subprocess.TimeoutExpired:
            tried, outcome = ", ".join(client.packages), f"fails: it was stopped after {LIMIT / 60:.0f} min"
        lines.append([name, tried, outcome, client.done])
        print(f"{name}: {outcome} ({tried})", flush=True)
    print(f"\n{format_table([HEADING, *lines])}")
    if args.out:
        result = {
            "command": COMMAND, "version": __version__, "date": date.today().isoformat(), "lines": [HEADING, *lines]
        }  # fmt: skip
        args.out.write_text(json.dumps(result, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return int(not all(outcome.startswith(("unchanged", "glue")) for _, _, outcome, _ in lines))


if __name__ == "__main__":
    run_cli("tests.clients", lambda: sys.exit(main()))
