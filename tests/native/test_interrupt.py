"""Pins Ctrl-C: it is handled soon, after the tick has ended for all robots, and the environment can be closed."""

import signal
import subprocess
import sys
import time

import pytest

RUN = """
import signal, sys, time
import numpy as np
from spidar_gym.envs.vector import NativeVectorEnv

signal.signal(signal.SIGINT, signal.default_int_handler)  # the parent process may have ignored it
env = NativeVectorEnv({name!r}, {robots}, num_threads=2, **{options!r})
env.reset(seed=0, options={{"reset_mask": np.ones({robots}, bool)}}) if {steps} else None
actions = np.zeros(env.action_space.shape)
print("ready", flush=True)
try:
    while {steps}:
        env.step(actions)
    env.reset(seed=0)
except KeyboardInterrupt:
    print("interrupted", flush=True)
counts = env.robots["plant"]["state"]["time"]
print("apart" if {steps} and counts.min() != counts.max() else "alike", flush=True)
try:
    env.reset(seed=1, options={{"disturbances": None}}) if {again} else None
    env.close()
    print("closed", flush=True)
except KeyboardInterrupt:
    sys.exit("twice")
"""
TILES = {"steps": 0.01, "randomization": 1.0}


@pytest.mark.parametrize(
    ("name", "robots", "options", "steps", "again", "seconds"),
    [
        ("spidar_gym/Hover-v0", 2000, {"sensors": True, "randomization": 1.0}, True, True, 3.0),
        ("spidar_gym/Crawl-v0", 256, TILES, False, False, 1.0),
        ("spidar_gym/Crawl-v0", 32, {**TILES, "max_episode_steps": 1, "autoreset_mode": "SameStep"}, True, False, 5.0),
    ],
    ids=["a step of thousands", "a reset that settles", "a step in which all reset"],
)
@pytest.mark.slow
def test_ctrl_c_is_handled_when_the_tick_has_ended_for_all_robots(name, robots, options, steps, again, seconds):
    program = RUN.format(name=name, robots=robots, options=options, steps=steps, again=again)
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            assert process.stdout.readline() == "ready\n"
            time.sleep(1.0)
            start = time.monotonic()
            process.send_signal(signal.SIGINT)
            assert process.stdout.readline() == "interrupted\n"
            assert time.monotonic() - start < seconds
            assert process.stdout.readline() == "alike\n"
            assert process.stdout.readline() == "closed\n"
            assert process.wait(10.0) == 0
        finally:
            process.kill()
