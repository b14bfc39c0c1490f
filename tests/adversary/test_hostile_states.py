"""Saved robots of which a number was changed and the seal made anew: refused, and nothing changes, or flown on."""

import hashlib
import time

import gymnasium
import numpy as np
import pytest

from spidar_gym.border import pack, unpack
from spidar_gym.envs import saving
from spidar_gym.envs.moments import TITLE
from spidar_gym.envs.registry import COURSE, CRAWL, HOVER, PATH
from spidar_gym.errors import SpidarError
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.limits import limits_of

WHOLE = 2000
ROUGH = {"randomization": 1.0, "sensors": True, "disturbances": {"wind": 2.0, "lost_rotor": 3, "fault_time": 0.0}}
CASES = {
    "hover": (HOVER, ROUGH), "path": (PATH, {}), "crawl": (CRAWL, {"randomization": 1.0}),
    "course": (COURSE, {"hold": 1, "sensors": True}),
}  # fmt: skip
FLOATS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e18, 1e-308, -1.0, 0.0)


def leaves(dtype, at=0, member=""):
    """Offset, kind, name and struct of every number of a record."""
    for name in dtype.names:
        kind, offset = dtype.fields[name][:2]
        base, count = kind.base, int(np.prod(kind.shape, dtype=int))
        for k in range(count):
            where = at + offset + k * base.itemsize
            if base.names:
                yield from leaves(base, where, name)
            else:
                yield where, base, name, member


def changed(good, rng, numbers, size):
    """Saved robots with one number changed, sealed again."""
    body = bytearray(good[: -saving.CHECKSUM])
    head = bytes(body).index(b"\n", len(saving.MAGIC)) + 1
    where, kind, name, member = numbers[rng.integers(len(numbers))]
    if kind.kind == "f":
        value = kind.type(
            FLOATS[rng.integers(len(FLOATS))] if rng.random() < 0.7 else rng.normal() * 10 ** rng.uniform(0, 20)
        )
    else:
        low, high = limits_of(name, member)
        info = np.iinfo(kind) if kind.kind != "b" else None
        choice = (low - 1, high + 1, 2**31 - 1, -(2**31), int(rng.integers(-5, 300)))[rng.integers(5)]
        value = np.array(int(np.clip(choice, info.min, info.max)) if info else choice % 2, kind)
    at = head + where + int(rng.integers(2)) * size
    body[at : at + kind.itemsize] = value.tobytes()
    return bytes(body) + hashlib.sha256(body).digest(), f"{member}.{name} = {value}"


@pytest.mark.parametrize("whole_numbers", [True, False], ids=["integers", "floats"])
@pytest.mark.parametrize("case", CASES)
def test_a_changed_number_is_refused_and_changes_nothing_or_is_flown(case, whole_numbers, rng, tries):
    name, options = CASES[case]
    vector = gymnasium.make_vec(name, 2, **options).unwrapped
    vector.reset(seed=1)
    action = np.zeros(vector.action_space.shape)
    for _ in range(12):
        vector.step(action)
    good, robots = vector.save(), vector.fleet.robots
    numbers = [leaf for leaf in leaves(robots.dtype) if (leaf[1].kind == "f") != whole_numbers]
    for _ in range(tries(WHOLE)):
        before = robots.tobytes()
        bad, what = changed(good, rng, numbers, robots.itemsize)
        try:
            vector.restore(bad)
        except SpidarError:
            assert robots.tobytes() == before, what
            continue
        for _ in range(2):
            began = time.process_time()
            try:
                vector.step(action)
            except SpidarError as error:
                if "MuJoCo gave up" not in str(error):
                    raise
            assert time.process_time() - began < 1.0, what
        vector.restore(good)
    vector.close()


@pytest.mark.parametrize("case", CASES)
def test_a_single_environment_refuses_them_too_and_takes_the_good_one(case, rng, tries):
    name, options = CASES[case]
    env = gymnasium.make(name, **options).unwrapped
    env.reset(seed=1)
    action = np.zeros(env.action_space.shape)
    env.step(action)
    good = env.save_state()
    told, arrays = unpack(TITLE, good, sealed=True)
    numbers = [leaf for leaf in leaves(env.fleet.robots.dtype) if leaf[1].kind != "f"]
    refused = 0
    for _ in range(tries(WHOLE // 4)):
        robot, what = changed(arrays["robot"].tobytes(), rng, numbers, 0)
        bad = pack(TITLE, told, arrays | {"robot": np.frombuffer(robot, np.uint8)}, sealed=True)
        before = env.save_state()
        try:
            env.restore_state(bad)
        except SpidarError:
            refused += 1
            assert env.save_state() == before, what
            continue
        try:
            env.step(action)
        except SpidarError as error:
            if "MuJoCo gave up" not in str(error):
                raise
        env.restore_state(good)
    assert refused
    env.restore_state(good)
    env.step(action)


def test_every_whole_number_of_a_robot_has_limits():
    for struct in ("hover", "crawling", "coursing", "goal", "knot"):
        for _, kind, name, member in leaves(engine_layouts()[struct]):
            assert kind.kind == "f" or limits_of(name, member) is not None, (struct, member, name)
