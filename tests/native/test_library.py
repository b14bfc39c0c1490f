"""Pins how the compiled core is loaded and let go: never half of one, never one more than is in use."""

import ctypes
import gc
import resource
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

from spidar_gym.errors import SpidarError, StaleAssetError
from spidar_gym.native.crawl import CoreCrawler
from spidar_gym.native.flight import CoreFlightController
from spidar_gym.native.library import core_path, load_core
from spidar_gym.native.recipe import SEAL

HOVER, CRAWL = "spidar_gym/Hover-v0", "spidar_gym/Crawl-v0"
LOADING = """
import sys
from spidar_gym.native.library import load_core
from spidar_gym.errors import StaleAssetError
try:
    load_core()
except StaleAssetError:
    sys.exit(7)
"""


def loaded():
    """How many copies of the core are in this process."""
    with open("/proc/self/maps", encoding="utf-8") as maps:
        return len({line.split(maxsplit=5)[5] for line in maps if "libspidar" in line})


@pytest.fixture
def before():
    gc.collect()
    return loaded()


def make(name=HOVER, **options):
    return gymnasium.make(name, control="core", **options).unwrapped


@pytest.mark.parametrize("name", [HOVER, CRAWL])
def test_a_closed_environment_has_no_library_and_says_so(name, before):
    env = make(name)
    env.reset(seed=0)
    assert loaded() == before + 1
    for _ in range(2):
        env.close()
        assert loaded() == before
    for use in (lambda: env.step(np.zeros(env.action_space.shape)), lambda: env.reset(seed=0)):
        with pytest.raises(SpidarError, match="is closed; valid: a new one"):
            use()


@pytest.mark.parametrize("kind", [CoreFlightController, CoreCrawler])
def test_a_controller_that_nobody_has_any_more_takes_its_library_with_it(kind, before):
    for _ in range(5):
        one, two = kind(), kind()
        assert loaded() == before + 2
        del one, two
        gc.collect()
        assert loaded() == before


def test_an_environment_that_nobody_closes_takes_its_library_with_it(before):
    for seed in range(3):
        env = make()
        env.reset(seed=seed)
        env.step(np.zeros(6))
    del env
    gc.collect()
    assert loaded() == before


def test_environments_that_could_not_be_made_leave_no_library(before):
    for _ in range(3):
        with pytest.raises(SpidarError):
            make(randomization=-1.0)
    gc.collect()
    assert loaded() == before


def test_a_function_keeps_its_library(before):
    library = load_core()
    function = library.sp_interface
    library.close()
    del library
    gc.collect()
    assert loaded() == before + 1
    function.restype = ctypes.c_char_p
    assert len(function()) == 32
    del function
    gc.collect()
    assert loaded() == before


@pytest.mark.parametrize("keep", [0, 1, SEAL, 64, 4096, 100_000, -SEAL, -1])
def test_half_a_library_is_refused_before_it_is_loaded(tmp_path, monkeypatch, keep):
    half = tmp_path / "half.so"
    half.write_bytes(core_path().read_bytes()[:keep])
    monkeypatch.setenv("SPIDAR_CORE", str(half))
    # In a process of its own: half a library that is loaded ends the process with a bus error.
    done = subprocess.run([sys.executable, "-c", LOADING], check=False)
    assert done.returncode == 7


def test_a_library_with_a_flipped_bit_is_refused(tmp_path, monkeypatch):
    data, rng = bytearray(core_path().read_bytes()), np.random.default_rng(0)
    monkeypatch.setenv("SPIDAR_CORE", str(tmp_path / "flipped.so"))
    for at in rng.integers(len(data), size=50):
        data[at] ^= 1 << rng.integers(8)
        (tmp_path / "flipped.so").write_bytes(data)
        with pytest.raises(StaleAssetError, match="spidar assets"):
            load_core()


def test_no_room_for_its_copy_is_one_line():
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(SpidarError, match="no room for temporary files: File too large; valid: a TMPDIR"):
            load_core()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
