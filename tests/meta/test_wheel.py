"""Pins the trial of the wheel: every command of the guide is run with it, and it contains every file it needs."""

import re
import sys
import tomllib
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from spidar_gym.cli.evaluate import BASELINES

ROOT = Path(__file__).resolve().parents[2]
SPEC = spec_from_file_location("commands", ROOT / ".ci" / "commands.py")
commands = module_from_spec(SPEC)
sys.modules["commands"] = commands  # dataclasses look up their module by name
SPEC.loader.exec_module(commands)
GUIDE, CODE = commands.GUIDE, commands.CODE
TABLES = ["docs/commands.md", "docs/benchmark/protocol.md"]


def named(page):
    """Subcommands of `spidar` in the first column of a page's table."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for cell in re.findall(r"^\| (`spidar .+?`) \|", text, re.MULTILINE):
        for line in re.findall(r"`([^`]+)`", cell):
            words = re.match(r"(?:spidar )?([a-z-]+(?: [a-z-]+)?(?= |$|\b))?", line)[0].removeprefix("spidar ").split()
            yield " ".join(word for word in words if not word.startswith("-"))


@pytest.mark.parametrize("page", TABLES)
def test_every_command_of_the_guide_is_tried_with_the_wheel(page):
    tried = [" ".join(one.words[1:]) for one in GUIDE if one.words[0] == "spidar"]
    found = [name for name in named(page) if name]
    assert len(found) > 8
    for name in found:
        assert any(line.startswith(name) for line in tried), name


def test_every_try_has_a_unique_name_and_no_option_of_the_guide_is_lost():
    assert len({one.command for one in GUIDE}) == len(GUIDE)
    for one in GUIDE:
        if one.command.startswith("spidar") and not one.instead:
            assert one.tried.startswith(one.command)
    assert {one.extra for one in GUIDE} <= {"", "viz", "web", "tune", "train", "ray", "log"}


def test_the_ten_lines_that_are_tried_are_those_of_readme():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", readme, re.S)
    assert commands.README.strip() in code


def test_a_wheel_takes_with_it_whatever_a_command_reads_by_name():
    target = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
    assert target["wheel"]["sources"] == {name: f"spidar_gym/{name}" for name in ("assets", "baselines")}
    included = {path for pattern in target["wheel"]["include"] for path in ROOT.glob(pattern.removeprefix("/"))}
    needed = [ROOT / "baselines" / f"{spec.split(':')[0].split('.')[1]}.py" for spec in BASELINES]
    for path in (*needed, *ROOT.glob("baselines/scores/**/*.json"), *ROOT.glob("baselines/learned/*/*.npz")):
        assert path.is_file()
        assert {path, *path.parents} & included, path
