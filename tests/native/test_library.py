"""Pins how the compiled core is loaded and released: never an incomplete one, never a second one."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest

from spidar_gym.errors import SpidarError, StaleAssetError
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.core_flight import CoreFlightController
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


def make(name=HOVER, **options):
    return gymnasium.make(name, control="core", **options).unwrapped


@pytest.mark.parametrize("name", [HOVER, CRAWL])
def test_a_closed_environment_raises(name):
    env = make(name)
    env.reset(seed=0)
    for _ in range(2):
        env.close()
    for use in (lambda: env.step(np.zeros(env.action_space.shape)), lambda: env.reset(seed=0)):
        with pytest.raises(SpidarError, match="is closed; valid: a new one"):
            use()


def test_all_controllers_share_one_library():
    path = core_path()
    kinds = (CoreFlightController, CoreCrawler) * 3
    controllers = [kind() for kind in kinds]
    assert len({id(each.library) for each in controllers}) == 1
    with open("/proc/self/maps", encoding="utf-8") as maps:
        assert len({line.split(maxsplit=5)[5] for line in maps if str(path) in line}) == 1
    assert not list(path.parent.glob("libspidar*.so.*"))


@pytest.mark.parametrize("keep", [0, 1, SEAL, 64, 4096, 100_000, -SEAL, -1])
def test_half_a_library_is_refused_before_it_is_loaded(tmp_path, monkeypatch, keep):
    half = tmp_path / "half.so"
    half.write_bytes(core_path().read_bytes()[:keep])
    monkeypatch.setenv("SPIDAR_CORE", str(half))
    # In a separate process, as loading half a library would end it with a bus error.
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
