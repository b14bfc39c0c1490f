"""Calls of the command line in this process: the messages of refused commands, and the files of a folder."""

from pathlib import Path

import pytest

from spidar_gym.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
LEARNED = str(ROOT / "baselines" / "learned" / "supervised_paper" / "seed0.npz")
"""A committed policy."""


def _refused(capfd, arguments, command=main, prog="spidar") -> list[str]:
    """The lines on stderr of a command that ends with status 2 and nothing on stdout."""
    with pytest.raises(SystemExit) as stop:
        command(list(arguments))
    out, err = capfd.readouterr()
    assert stop.value.code == 2
    assert out == ""
    assert err.endswith("\n")
    lines = err.splitlines()
    assert lines[-1].startswith(f"{prog}: ")
    return lines


def refused(capfd, *arguments, command=main, prog="spidar") -> str:
    """The one line on stderr with which a command is refused."""
    (line,) = _refused(capfd, arguments, command, prog)
    return line


def refused_after_a_bar(capfd, *arguments) -> str:
    """The last line on stderr of a command that is refused after its progress bar has appeared."""
    return _refused(capfd, arguments)[-1]


def files(folder: Path) -> dict[str, bytes]:
    """Every file of a folder: path → bytes."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
