"""Pins threads: a robot that one thread has randomised is the same on all others."""

import numpy as np
import pytest

from spidar_gym.envs.registry import COURSE, CRAWL, HOVER
from spidar_gym.envs.vector import NativeVectorEnv

CASES = [
    (HOVER, {}), (CRAWL, {}), (COURSE, {"hold": 4}), (COURSE, {"action_mode": "residual"}),
    (COURSE, {"action_mode": "direct"}),
]  # fmt: skip


def visited(name, options, threads):
    """Return observations of robots of which one is reset at every tick."""
    env = NativeVectorEnv(name, 5, num_threads=threads, randomization=1.0, autoreset_mode="Disabled", **options)
    env.reset(seed=3)
    rng, seen = np.random.default_rng(1), []
    for _ in range(60):
        seen.append(env.step(rng.normal(0.0, 0.3, env.action_space.shape))[0])
        seen.append(env.reset(options={"reset_mask": np.arange(5) == rng.integers(5)})[0])
    env.close()
    return np.array(seen)


@pytest.mark.parametrize(("name", "options"), CASES)
def test_a_robot_that_is_reset_while_others_continue_has_the_same_bits_on_every_thread(name, options):
    alone = visited(name, options, 1)
    for threads in (2, 3):
        np.testing.assert_array_equal(visited(name, options, threads), alone)
