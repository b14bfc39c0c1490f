"""Saved robots and states of which one thing was changed and the seal made anew: refused, or flown on; never the end."""

import json
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest
from support.hostile_states import CASES, numbers

from spidar_gym.envs.registry import HOVER
from spidar_gym.errors import SpidarError
from spidar_gym.native import limits, structs
from spidar_gym.native.engine_structs import engine_layouts

TESTS = Path(__file__).resolve().parents[1]
STRUCTS = {"hover": "hover", "path": "hover", "crawl": "crawling", "course": "coursing"}
VALUES = 6
"""To which each whole number is changed."""


def plans(case, tries):
    """What is tried: every whole number, and 2,000 others, of each kind of state."""
    whole, of_plant = (VALUES * len(numbers(struct, whole=True)) for struct in (STRUCTS[case], "plant"))
    counts = {
        "vector:integers": whole, "core:integers": whole, "python:integers": of_plant, "vector:floats": 2000,
        "core:floats": 1000, "python:floats": 1000, "core:words": 1000, "python:words": 1000,
    }  # fmt: skip
    return [f"{plan}:{tries(count)}" for plan, count in counts.items()]


@pytest.mark.parametrize("case", CASES)
def test_a_changed_state_is_refused_and_changes_nothing_or_goes_on(case, rng, tries):
    words = [sys.executable, "-m", "support.hostile_states", case, str(rng.integers(2**31)), *plans(case, tries)]
    done = subprocess.run(words, cwd=TESTS, capture_output=True, text=True, check=False, timeout=7200)
    assert done.returncode == 0, done.stderr[-300:]
    told = json.loads(done.stdout.splitlines()[-1])
    print(case, told["found"])
    assert not told["wrong"]
    assert any("refused" in found for found in told["found"].values())


@pytest.mark.parametrize(
    "struct", ["goal", "knot", *(f"{name}{info}" for name in STRUCTS.values() for info in ("", "_info"))]
)
def test_every_whole_number_that_is_saved_has_bounds(struct):
    found = limits.numbers_of(struct)
    own = {kind: len(each.at) for kind, each in found.items()}
    assert sum(count * int(kind[1:]) for kind, count in own.items()) <= engine_layouts()[struct].itemsize
    assert all((each.low <= each.high).all() for each in found.values())


def test_a_whole_number_without_bounds_is_an_error(monkeypatch):
    table = structs.CStruct("goal", "A goal.", (("start deadline", "f8", ()  , ""), ("joint_target", "f8", (16,), ""),
                                               ("reached", "i4", (), "")))  # fmt: skip
    monkeypatch.setattr(limits, "_tables", lambda: {"goal": table})
    limits.numbers_of.cache_clear()
    with pytest.raises(LookupError, match=r"goal\.reached is a whole number without bounds"):
        limits.numbers_of("goal")
    limits.numbers_of.cache_clear()


def test_what_is_wrong_is_named():
    env = gymnasium.make(HOVER).unwrapped
    env.reset(seed=0)
    robots = env.fleet.robots.copy()
    robots["flight"]["memory"]["lock"]["active"][0, 3] = 7
    assert limits.fault_of("hover", robots) == "flight.memory.lock.active[3] = 7, expected 0 … 1"
    with pytest.raises(SpidarError, match="no saved state"):
        env.restore_state(b"")
    env.close()
