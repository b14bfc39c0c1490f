"""Whole episodes for the tests of the environments: simulation and bit-for-bit comparison."""

from dataclasses import fields

import gymnasium
import numpy as np

from spidar_gym.envs.docs import CHAPTERS
from spidar_gym.envs.registry import ENVIRONMENTS

HOVER = "spidar_gym/Hover-v0"
EVERY = [(name, mode) for name in ENVIRONMENTS for mode in CHAPTERS[name].modes]
"""Every environment in each of its action modes."""
EARLY = 35
"""A seed whose independent legs start to move after 1.05 s already."""
PUSHED = 147
"""A seed whose first push comes within a quarter of a second."""
ROUGH = {"sensors": True, "randomization": 1.0, "battery": True, "disturbances": {"wind": 2.0, "push": 30.0}}


def named(value) -> str:
    """Name of a parameter of a test."""
    return value if isinstance(value, str) else "rough" if value is ROUGH else "-".join(value) or "plain"


def make(name: str = HOVER, **options):
    """The environment without wrappers."""
    return gymnasium.make(name, **options).unwrapped


def actions_of(env, n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (n, *env.action_space.shape)).astype(np.float32)


def flight(env, actions, seed=None, options=None) -> list[tuple]:
    """(observation, reward, terminated, info) of the reset and of every step until the end."""
    observation, info = env.reset(seed=seed, options=options)
    steps = [(observation, None, False, info)]
    for action in actions:
        observation, reward, terminated, _, info = env.step(action)
        steps.append((observation, reward, terminated, info))
        if terminated:
            break
    return steps


def same(a, b) -> bool:
    """Whether two entries of an `info` or two saved states are equal bit for bit, whatever their type."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, np.random.Generator):
        return a.bit_generator.state == b.bit_generator.state
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)


def assert_same(a, b):
    """Assert that two flights are equal bit for bit, infos included."""
    assert len(a) == len(b)
    for (o1, r1, t1, i1), (o2, r2, t2, i2) in zip(a, b, strict=True):
        assert np.array_equal(o1, o2)
        assert (r1, t1) == (r2, t2)
        assert i1.keys() == i2.keys()
        for key in i1:
            assert same(i1[key], i2[key]), key


def direct(thrust) -> np.ndarray:
    """An action of `direct`: thrusts [N] with rotors upright in form ①."""
    action = np.zeros(40)
    action[:8] = np.asarray(thrust) / 21.0 - 1.0
    return action
