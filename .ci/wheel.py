"""Builds the wheel, installs it in an empty environment, and tests it outside the checkout."""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

from commands import DONE, GUIDE, Try

ROOT = Path(__file__).resolve().parent.parent
OLDEST = "gymnasium==1.2.0"
"""The oldest version that pyproject.toml admits; the tests use the newest."""
EXTRAS = "viz,web,tune,train,ray"
"""Extras installed for the commands that need them."""
LIMIT = 5400.0
"""Time limit of a command [s], long enough for a busy machine."""


class Environment:
    """A virtual environment for the wheel, and an empty working folder beside it."""

    def __init__(self, folder: Path, python: str) -> None:
        """Create the environment with `python`."""
        self.folder, self.bin = folder, folder / "venv" / "bin"
        self.work = folder / "work"
        self.work.mkdir(parents=True)
        call("environment", [python, "-m", "venv", str(folder / "venv")])
        # No path of the checkout, no display, no cache of compiled files.
        self.variables = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "DISPLAY", "WAYLAND_DISPLAY")}
        self.variables |= {
            "PATH": f"{self.bin}{os.pathsep}{os.environ['PATH']}", "XDG_CACHE_HOME": str(folder / "cache"),
            "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl"),
        }  # fmt: skip

    def install(self, *words: str) -> None:
        """Install packages with the environment's pip."""
        call("install", [str(self.bin / "python"), "-m", "pip", "install", "-q", *words])

    def run(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        """Run a program of the environment, or of the system, in the working folder."""
        own = self.bin / words[0]
        return subprocess.run(
            [str(own) if own.exists() else words[0], *words[1:]], cwd=self.work, env=self.variables, check=False,
            capture_output=True, text=True, timeout=LIMIT, stdin=subprocess.DEVNULL,
        )  # fmt: skip


def call(title: str, command: list[str], **how: object) -> None:
    """Run a step of the preparation; exit if it fails."""
    print(f"── {title}: {' '.join(command)}", flush=True)
    code = subprocess.run(command, check=False, **how).returncode  # pyright: ignore[reportCallIssue, reportArgumentType]
    if code != 0:
        sys.exit(f"{title} failed with exit status {code}")


def build(folder: Path) -> Path:
    """Build the wheel from the checkout with `python -m build`; returns its path."""
    call("wheel", [sys.executable, "-m", "build", "--wheel", "--installer", "pip", "--outdir", str(folder), str(ROOT)])
    return next(folder.glob("*.whl"))


def smoke(wheel: Path, python: str, folder: Path) -> None:
    """Run the smoke test on the oldest Gymnasium."""
    made = Environment(folder, python)
    made.install(str(wheel), OLDEST)
    command = [str(made.bin / "python"), str(ROOT / ".ci" / "smoke.py")]
    call("smoke test on the wheel", command, cwd=made.work, env=made.variables)


def outcome(one: Try, made: Environment, extras: bool) -> tuple[str, bool]:
    """Run a command; returns its outcome in words, and whether that is the documented one."""
    try:
        done = made.run(one.words)
    except subprocess.TimeoutExpired:
        return f"stopped after {LIMIT:.0f} s", False
    said = done.stderr.strip().splitlines()
    refusal = one.refusal if one.refusal and not (extras and one.extra) else ""
    if refusal and done.returncode == one.status:
        last = said[-1].replace(f"{made.folder}/", "") if said else ""
        return f"refused: {last.removeprefix('spidar: ')}", refusal in last and "Traceback" not in done.stderr
    if done.returncode != 0 or "Traceback" in done.stderr:
        print(done.stdout[-2000:], done.stderr[-4000:], sep="\n", flush=True)
        return f"exit status {done.returncode}", False
    missing = [name for name in one.makes if not (made.work / name).exists()]
    notes = dict.fromkeys(line.split(":")[0] for line in said if re.match("no .* is not available", line))
    lacks = f", {', '.join(notes)} (extra `viz`)" if notes else ""
    return f"{DONE}{lacks}" if not missing else f"lacks {', '.join(missing)}", not (missing or refusal)


def every_command(wheel: Path, python: str, folder: Path, only: tuple[str, ...]) -> tuple[list[list[str]], list[str]]:
    """Return the lines of a table, and the commands whose outcome is not the documented one.

    Every command of the guide runs with the wheel alone, then those that need an extra run with the extras.
    """
    made = Environment(folder, python)
    made.install(str(wheel))
    found: dict[str, dict[bool, str]] = {}
    wrong: list[str] = []
    tries = [one for one in GUIDE if not only or one.command.startswith(only)]
    for extras in (False, True):
        if extras and any(one.extra for one in tries):
            made.install(f"spidar-gym[{EXTRAS}] @ {wheel.as_uri()}")
        for one in tries:
            if not (one.extra if extras else one.alone):
                continue
            start = time.monotonic()
            said, right = outcome(one, made, extras)
            found.setdefault(one.command, {})[extras] = said
            print(f"{'  ' if right else '✗ '}{one.command}: {said} ({time.monotonic() - start:.0f} s)", flush=True)
            wrong += [] if right else [one.command]
    lines = [["command", "tried as", "wheel alone", "with its extra"]]
    for one in tries:
        alone, more = (found[one.command].get(extras, "–") for extras in (False, True))
        lines.append([one.command, f"`{one.tried}`", alone, more])
    return lines, wrong


def renewed(path: Path, lines: list[list[str]]) -> list[list[str]]:
    """Return the table of an existing result, updated with `lines`."""
    old = json.loads(path.read_text(encoding="utf-8"))["lines"] if path.exists() else lines
    new = {line[0]: line for line in old} | {line[0]: line for line in lines}
    return [new[name] for name in ("command", *(one.command for one in GUIDE)) if name in new]


def weigh(wheel: Path, python: str, folder: Path) -> list[list[str]]:
    """Return the table of the sizes of the wheel and its dependencies."""
    made = Environment(folder, python)
    made.install(str(wheel))
    done = made.run(["python", str(ROOT / ".ci" / "weights.py"), "spidar-gym"])
    if done.returncode != 0:
        sys.exit(done.stderr)
    lines = json.loads(done.stdout)
    for line in lines:
        print(" | ".join(line))
    return lines


def write(path: Path, wheel: Path, how: str, lines: list[list[str]]) -> None:
    """Write a result of the guide: the cells of its table, the command, the version and the date."""
    made = {"command": f"python .ci/wheel.py {how}", "version": wheel.name.split("-")[1], "date": str(date.today())}
    path.write_text(json.dumps({**made, "lines": lines}, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--commands", action="store_true", help="run every command of the guide, up to two hours")
    parser.add_argument("--only", nargs="+", default=[], help="only commands with these prefixes; results keep others")
    parser.add_argument("--weights", action="store_true", help="print the installed packages and their sizes")
    parser.add_argument("--python", nargs="+", default=[sys.executable], help="Pythons to use in place of this one")
    parser.add_argument("--wheel", type=Path, help="an existing wheel, in place of a new one")
    parser.add_argument("--result", type=Path, help="write the table to this file, a result of the guide")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        wheel = given.wheel.resolve() if given.wheel else build(folder)
        for k, python in enumerate(given.python):
            place = folder / str(k)
            how, wrong = "--commands" if given.commands else "--weights", []
            if given.commands:
                lines, wrong = every_command(wheel, python, place, tuple(given.only))
                if given.only and given.result:
                    lines = renewed(given.result, lines)
            elif given.weights:
                lines = weigh(wheel, python, place)
            else:
                smoke(wheel, python, place)
                continue
            if given.result:
                write(given.result, wheel, how, lines)
            if wrong:
                sys.exit(f"outcome differs from the guide: {', '.join(wrong)}")


if __name__ == "__main__":
    main()
