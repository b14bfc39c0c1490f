"""Corrupted saved robots and states with a valid checksum: refused, or simulated further."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from support.hostile_states import CASES, numbers, sealed

from spidar_gym.envs.registry import COURSE, CRAWL, HOVER
from spidar_gym.errors import SpidarError
from spidar_gym.native import limits, structs
from spidar_gym.native.engine_structs import engine_layouts

KINDS = {"hover": "hover", "path": "hover", "crawl": "crawl", "course": "course", "grasp": "grasp"}
TESTS = Path(__file__).resolve().parents[1]
STRUCTS = {name: f"{kind}_robot" for name, kind in KINDS.items()}
VALUES = 6
"""Number of values to which each integer is changed."""


def plans(case, tries):
    """Tries for each kind of state: every integer, and up to 2,000 floats or words."""
    whole = VALUES * len(numbers(STRUCTS[case], whole=True))
    counts = {
        "vector:integers": whole, "core:integers": whole, "python:integers": whole, "vector:floats": 2000,
        "core:floats": 500, "python:floats": 500, "core:words": 500, "python:words": 500,
    }  # fmt: skip
    return [f"{plan}:{tries(count)}" for plan, count in counts.items()]


@pytest.mark.parametrize("case", CASES)
def test_a_changed_state_is_refused_and_changes_nothing_or_goes_on(case, rng, tries):
    words = [sys.executable, "-m", "support.hostile_states", case, str(rng.integers(2**31)), *plans(case, tries)]
    done = subprocess.run(words, cwd=TESTS, capture_output=True, text=True, check=False, timeout=200 + tries(2000))
    assert done.returncode == 0, done.stderr[-300:]
    told = json.loads(done.stdout.splitlines()[-1])
    print(case, told["found"])
    assert not told["wrong"]
    assert any("refused" in found for found in told["found"].values())


@pytest.mark.parametrize(
    "struct", ["goal", "knot", *(f"{kind}_{part}" for kind in KINDS.values() for part in ("robot", "info"))]
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
    with pytest.raises(LookupError, match=r"goal\.reached is an integer without bounds"):
        limits.numbers_of("goal")
    limits.numbers_of.cache_clear()


def _on_no_path(r):
    r["manager"]["memory"]["phase"], r["manager"]["knot_count"] = 4, 0


def _of_tiles(r):
    r["course"]["count"] = 3
    gates = r["course"]["gates"][:, :3]
    gates["kind"], gates["begin"], gates["end"] = 4, 2.0, 5.5


def _in_a_phase(r):
    r["crawl"]["gait"]["phase"], r["crawl"]["gait"]["count"] = 3, 0


def _stuck(r):
    r["plant"]["is_stuck"], r["plant"]["disturbances"]["lost_rotor"] = 1, 0


def _mode(r):
    r["flight"]["mode"]["m"] -= 1


def _config(r):
    r["flight"]["config"]["allocator"]["max_iter"] += 1


def _goal(r):
    r["current"] = r["goals"]


def _stream(r):
    r["episode"]["generator"]["increment_low"] &= ~np.uint64(1)


def _failure(r):
    r["episode"]["failure"] = 4


def _far(r):
    r["plant"]["row"][:, 50] = 1e7


def _late(r):
    r["plant"]["config"]["actuators"]["jitter"] = 0.8


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        (HOVER, _late, "plant.vectoring_delay with the jitter is too long"),
        (COURSE, _on_no_path, "manager.knot_count is 0 on a path"),
        (COURSE, _of_tiles, "course.gates do not fit into the boxes and tiles"),
        (CRAWL, _in_a_phase, "crawl.gait.phase is not one of the present step's"), (HOVER, _stuck, "plant.is_stuck"),
        (HOVER, _mode, "flight.mode differs from config's"), (HOVER, _config, "config.allocator.max_iter differs"),
        (HOVER, _goal, "current is not one of the goals"), (CRAWL, _stream, "episode.generator has an even increment"),
        (CRAWL, _failure, "episode.failure"), (HOVER, _far, "plant.row has diverged"),
    ],
)  # fmt: skip
def test_numbers_that_do_not_fit_together_are_refused(name, change, words):
    """Each number is within its bounds, but some of these states once led out of arrays or into endless loops."""
    env: Any = gymnasium.make_vec(name, 1).unwrapped
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape))
    good, robots = env.save(), env.fleet.robots.copy()
    change(robots)
    with pytest.raises(SpidarError, match=re.escape(words)):
        env.restore(sealed(good, 0, robots.tobytes()))
    assert env.save() == good
    env.close()


def test_what_is_wrong_is_named():
    env: Any = gymnasium.make(HOVER).unwrapped
    env.reset(seed=0)
    robots = env.fleet.robots.copy()
    robots["flight"]["memory"]["lock"]["active"][0, 3] = 7
    assert limits.fault_of("hover_robot", robots) == "flight.memory.lock.active[3] = 7, expected 0 … 1"
    with pytest.raises(SpidarError, match="no saved state"):
        env.restore_state(b"")
    env.close()
