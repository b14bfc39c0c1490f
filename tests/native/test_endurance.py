"""Pins memory and CPU time of many robots: creation, resets, hours of flight.

`SPIDAR_SOAK_HOURS=12 pytest -n0 -s tests/native/test_endurance.py` prints the figures and flies twelve hours.
"""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.envs.vector import NativeVectorEnv

DRAWN = {"randomization": 1.0, "sensors": True, "battery": True, "disturbances": {"wind": 2.0, "push": 20.0}}
HOURS = float(os.environ.get("SPIDAR_SOAK_HOURS", "0.1"))
ROBOTS = 256


def memory():
    """Return the resident memory of this process [bytes]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def numbers(info):
    """Yield all arrays of an `info`, also those of nested dictionaries."""
    for value in info.values():
        yield from numbers(value) if isinstance(value, dict) else [value]


def report(name, options, words):
    print(f"\n{name}{' randomised' if options else ''}: {words}", end="")


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, DRAWN], ids=["described", "drawn"])
@pytest.mark.parametrize("name", [HOVER, CRAWL])
def test_a_robot_takes_a_quarter_of_a_megabyte_and_two_milliseconds(name, options):
    NativeVectorEnv(name, 2, **options).close()  # memory that all environments share
    before, start = memory(), time.perf_counter()
    env = NativeVectorEnv(name, ROBOTS, **options)
    made = time.perf_counter() - start
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample() * 0.1)
    each = (memory() - before) / ROBOTS
    report(name, options, f"{ROBOTS} robots in {made:.2f} s, {each / 1e3:.0f} kB each")
    assert each < 250e3
    assert made < 0.002 * ROBOTS + 0.5  # controller, mjModel and mjData are shared by all robots
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, DRAWN], ids=["described", "drawn"])
@pytest.mark.parametrize("name", [HOVER, CRAWL])
def test_resets_allocate_no_memory(name, options):
    env = NativeVectorEnv(name, 50, autoreset_mode="Disabled", **options)
    env.reset(seed=0)
    times = []
    for k in range(220 if name == HOVER else 60):  # 10,000 flights, 2,000 crawls after the first
        if k == 20:
            before = memory()
        start = time.process_time()
        env.fleet.reset()
        times.append((time.process_time() - start) / 50)
        env.step(np.zeros(env.action_space.shape))
    report(name, options, f"a reset in {1e6 * np.median(times):.0f} µs (least {1e6 * min(times):.0f})")
    assert memory() - before < 1e6
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, DRAWN], ids=["described", "drawn"])
def test_hours_of_flight_allocate_no_memory_and_yield_finite_numbers(options):
    ticks = max(200, int(HOURS / 2 * 3600 * 40 / 64))
    env = NativeVectorEnv(HOVER, 64, num_threads=2, max_episode_steps=400, **options)
    env.reset(seed=0)
    rng, failures, episodes, start = np.random.default_rng(0), {}, 0, time.perf_counter()
    for tick in range(ticks):
        if tick == 100:
            before = memory()
        seen, rewards, terminated, truncated, info = env.step(rng.normal(0.0, 0.3, env.action_space.shape))
        assert np.isfinite(seen).all()
        assert np.isfinite(rewards).all()
        assert all(np.isfinite(value).all() for value in numbers(info))
        episodes += int((terminated | truncated).sum())
        for code in info["failure_code"][terminated]:
            failures[int(code)] = failures.get(int(code), 0) + 1
    grown, took = memory() - before, time.perf_counter() - start
    report(
        HOVER,
        options,
        f"{64 * ticks / 40 / 3600:.2f} h in {took:.0f} s, {episodes} episodes, failures {failures}, "
        f"{grown / 1e3:+.0f} kB",
    )
    assert grown < 2e6
    env.close()
