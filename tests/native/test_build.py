"""Pins the installation: pip compiles the library, if necessary with a compiler from PyPI, with the same results."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from support.needs import needs_compiler

from spidar_gym.native import recipe
from spidar_gym.native.recipe import LIBRARY

ROOT = Path(__file__).resolve().parents[2]
NOT_THERE = ("No matching distribution found for ziglang", "No matching distribution found for hatchling")
FLY = """
import sys
import gymnasium
import numpy as np
import spidar_gym

for name in ("Hover", "Crawl"):
    env = gymnasium.make(f"spidar_gym/{name}-v0", control="core")
    seen = [env.reset(seed=0)[0]]
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (100, *env.action_space.shape)).astype(np.float32)
    for action in actions:
        seen.append(env.step(action)[0])
        if not env.unwrapped.observation_space.contains(seen[-1]):
            break
    print(np.array(seen).tobytes().hex())
"""


def wheel(folder, **environment):
    """Build a wheel as pip does, in isolation."""
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), str(ROOT)]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, check=False)
    return done, next(folder.glob("*.whl"), None) if folder.is_dir() else None


def flown(**environment):
    command = [sys.executable, "-c", FLY]
    return subprocess.run(
        command, env={**os.environ, **environment}, cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.slow
def test_without_a_compiler_pip_installs_one_and_the_library_computes_the_same_bits(tmp_path):
    (tmp_path / "no compilers").mkdir()
    done, made = wheel(tmp_path / "out", PATH=str(tmp_path / "no compilers"), CC="")
    if any(words in done.stderr for words in NOT_THERE):
        pytest.skip("ziglang cannot be downloaded: no network")
    assert done.returncode == 0, done.stderr
    assert made.name.split("-")[2:4] == ["py3", "none"], "expected a wheel for every Python and one platform"
    assert "any" not in made.name
    with zipfile.ZipFile(made) as content:
        assert sum(name.endswith(LIBRARY) for name in content.namelist()) == 1
        library = content.extract(f"spidar_gym/native/{LIBRARY}", tmp_path)
    assert flown(SPIDAR_CORE=library) == flown()


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(
    ("cc", "message"),
    [
        ("no-such-compiler", "CC = no-such-compiler is not valid; expected a C99 compiler"),
        ("false", "does not compile"),
    ],
)
def test_a_compiler_that_does_not_work_is_named(tmp_path, cc, message):
    done, made = wheel(tmp_path / "out", CC=cc)
    if any(words in done.stderr for words in NOT_THERE):
        pytest.skip("hatchling cannot be downloaded: no network")
    assert done.returncode != 0
    assert made is None
    assert message in done.stderr + done.stdout


def test_line_ends_of_a_clone_change_neither_sources_nor_their_digest(tmp_path, monkeypatch):
    def git(*words):
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *words], cwd=tmp_path, check=True)

    source = recipe.NATIVE / "core" / "path.c"
    (tmp_path / "here").mkdir()
    for path in (ROOT / ".gitattributes", source):
        (tmp_path / "here" / path.name).write_bytes(path.read_bytes())
    git("init", "-q", "here")
    git("-C", "here", "add", ".")
    git("-C", "here", "commit", "-qm", "Sources")
    git("-c", "core.autocrlf=true", "clone", "-q", "here", "there")
    assert (tmp_path / "there" / source.name).read_bytes() == source.read_bytes()

    digest = recipe.library_digest()
    folder = tmp_path / "core"
    folder.mkdir()
    for path in (recipe.NATIVE / "core").glob("*.[ch]"):
        (folder / path.name).write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    monkeypatch.setattr(recipe, "SOURCES", (folder, *recipe.SOURCES[1:]))
    assert recipe.library_digest() == digest
