"""Pins the needs of a flight in the engine: no SciPy, no OSQP, and no Pinocchio after the robots are made."""

import subprocess
import sys

import pytest

FLY = """
import hashlib
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

poisoned = sys.argv[2] == "poisoned"


class Nothing:
    def __getattr__(self, name):
        return Nothing()

    def __call__(self, *words, **named):
        raise RuntimeError("a package of the Python controllers is used")


class Stub(ModuleType):
    __path__ = []

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return Nothing()


class Finder(MetaPathFinder, Loader):
    def find_spec(self, name, path, target=None):
        return ModuleSpec(name, self, is_package=True) if name.split(".")[0] in ("scipy", "osqp") else None

    def create_module(self, spec):
        return Stub(spec.name)

    def exec_module(self, module):
        pass


if poisoned:
    sys.meta_path.insert(0, Finder())
import gymnasium
import numpy as np
import pinocchio
import spidar_gym

vector = gymnasium.make_vec(sys.argv[1], num_envs=2, sensors=True, randomization=1.0)
if poisoned:
    for name, found in list(vars(pinocchio).items()):
        if callable(found) and not isinstance(found, type):
            setattr(pinocchio, name, Nothing())
seen = [vector.reset(seed=0)[0]]
for _ in range(40):
    observations, rewards, *_ = vector.step(np.zeros(vector.action_space.shape))
    seen += [observations, rewards]
print(hashlib.sha256(b"".join(each.tobytes() for each in seen)).hexdigest())
"""


def flown(env_id, how):
    done = subprocess.run([sys.executable, "-c", FLY, env_id, how], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", ["Hover", "Crawl"])
def test_robots_fly_and_crawl_to_the_bit_without_the_packages_of_the_python_controllers(name):
    assert flown(f"spidar_gym/{name}-v0", "poisoned") == flown(f"spidar_gym/{name}-v0", "as it is")
