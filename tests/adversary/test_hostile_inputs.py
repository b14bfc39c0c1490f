"""Mistaken or malicious actions, options of reset and arguments: each works, or is refused without any effect."""

import copy
import math
from fractions import Fraction

import gymnasium
import numpy as np
import pytest
from support.tries import tried

from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.robot import FORMS
from spidar_gym.sim.config import PlantConfig

KINDS = {"hover": HoverEnv, "crawl": CrawlEnv}
QUICK = {HoverEnv: {"forms": "form1", "wake": False}, CrawlEnv: {"distance": 0.15, "turn": 0.0, "wake": False}}
"""Arguments for fast construction and steps."""
FORM = FORMS["form1"].tolist()
START = {"goals": [[0.0, 0.0, FORM]], "position": [0.0] * 3, "rotation": [0.0] * 3}
STORM = {"wind": 1.0, "push": 10.0, "lost_rotor": 1, "fault": "thrust", "fault_time": 0.1}
ARGUMENTS = {
    "action_mode", "preset", "controller", "allocator", "control", "max_iter", "forms", "joint_speed", "horizon_s",
    "perturbation", "avoid_interference", "unrestricted", "distance", "direction", "turn", "schedule", "friction",
    "slope", "slope_direction", "steps", "obstacles", "idle_thrust", "plant", "wake", "battery", "sensors",
    "randomization", "disturbances", "render_mode", "camera", "width", "height", "nothing", "",
}  # fmt: skip
"""Names of arguments: some of both environments, some of one, two of neither."""


class Odd:
    """An object whose conversions raise."""

    def __repr__(self):
        raise RuntimeError("no")

    def __array__(self, *_, **__):
        raise KeyError("no")


def number(rng):
    """A number, mostly an invalid one."""
    return rng.choice(
        np.array(
            [
                0, -1, 1, 3, 0.5, -0.0, 1e-300, 5e-324, 1e300, -1e308, 1e308, math.nan, math.inf, -math.inf, 10**400,
                -(10**20), True, False, 2j, Fraction(1, 3), np.float32(0.3), np.int64(4), np.bool_(True),
                float(rng.standard_normal()), float(10.0 ** rng.uniform(-8, 8)),
            ],
            dtype=object,
        )
    )  # fmt: skip


def thing(rng, depth=0):
    """A value of a random type."""
    kind = rng.integers(9 if depth < 3 else 4)
    if kind == 0:
        return number(rng)
    if kind == 1:
        names = ["", "x", "form2", "paper", "published", "thrust", "start", "wind", "é\n\0", "1.0", "A" * 5000]
        return str(rng.choice(names))
    if kind == 2:
        return [None, Odd(), object(), b"x", range(3), int, PlantConfig, len][rng.integers(8)]
    if kind == 3:
        shape = tuple(rng.integers(0, 4, rng.integers(0, 4)))
        array = rng.standard_normal(shape) * 10.0 ** rng.integers(-3, 300)
        return array.astype(rng.choice(["f8", "c16", "U3", "O", "?"]))
    if kind in (4, 5):
        return [thing(rng, depth + 1) for _ in range(rng.integers(0, 5))]
    if kind == 6:
        return tuple(thing(rng, depth + 1) for _ in range(rng.integers(0, 4)))
    if kind == 7:
        return {str(rng.choice([*STORM, *START, "x"])): thing(rng, depth + 1) for _ in range(rng.integers(0, 4))}
    return {number(rng): None}


def spoilt(rng, value):
    """A valid value with one part replaced, or with a key renamed or removed."""
    if not isinstance(value, dict | list) or not value or rng.random() < 0.2:
        return number(rng) if isinstance(value, float | int) and rng.random() < 0.7 else thing(rng)
    value = copy.copy(value)
    key = list(value)[rng.integers(len(value))] if isinstance(value, dict) else int(rng.integers(len(value)))
    fate = rng.random()
    if fate < 0.1:
        del value[key]
    elif fate < 0.2 and isinstance(value, dict):
        value[key + "s"] = value.pop(key)
    else:
        value[key] = spoilt(rng, value[key])
    return value


def action(rng, size):
    """A value instead of an action of this size."""
    kind = rng.integers(4)
    if kind == 0:
        return thing(rng)
    values = rng.uniform(-1, 1, size) * 10.0 ** rng.choice([0, 0, 1, 30, 307.9])
    if kind == 1:
        with np.errstate(all="ignore"):
            return values.astype(rng.choice(["f2", "f4", "f8", "O", "c8", "U20", "i8"]))
    if kind == 2:
        values[rng.integers(size)] = rng.choice([math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324])
        return values
    listed = values.tolist()
    listed[rng.integers(size)] = thing(rng)
    return listed


def options(rng, kind):
    """A value instead of the options of reset."""
    valid = {"disturbances": STORM, "forms": "form2", "start": START} if kind is HoverEnv else {"disturbances": STORM}
    return thing(rng) if rng.random() < 0.1 else spoilt(rng, valid)


def arguments(rng, kind):
    """One to three arguments of the environment, some of them valid."""
    names = rng.choice(sorted(ARGUMENTS), rng.integers(1, 4), replace=False)
    valid = {"disturbances": STORM, "obstacles": [[3.0, 3.0, 0.1]], "plant": PlantConfig(), "horizon_s": 1.0}
    return QUICK[kind] | {str(name): spoilt(rng, valid.get(name, 1.0)) for name in names}


def assert_sound(env, observation, info):
    """Assert that an observation is in its space and `info` is finite."""
    assert observation in env.observation_space
    for key, value in info.items():
        if np.asarray(value).dtype.kind == "f":
            assert np.isfinite(value).all(), key


def continuation(env, steps=2):
    """Next steps of the current episode, then a reset and the first steps of the next episode, as bytes."""
    zero, seen = np.zeros(env.action_space.shape), []
    for k in range(2 * steps + 1):
        if k == steps:
            observation, info = env.reset()
        else:
            observation, _, _, _, info = env.step(zero)
        seen.append((observation.tobytes(), repr(sorted(info.items()))))
    return seen


pytestmark = pytest.mark.usefixtures("unchecked")


@pytest.fixture(params=KINDS, name="kind")
def kind_(request):
    return KINDS[request.param]


def begun(kind) -> SpidarEnv:
    """An environment in the middle of an episode, with disturbances set by reset."""
    env = kind(**QUICK[kind], disturbances={"push": 20.0})
    env.reset(seed=3, options={"disturbances": {"wind": 1.0}})
    env.step(np.full(env.action_space.shape, 0.1))
    return env


def test_an_action_of_any_kind_steps_finitely_or_is_refused_and_nothing_moves(kind, rng, tries):
    env = begun(kind)
    size, accepted = env.action_space.shape[0], 0
    for _ in range(tries(400)):
        before = env.plant.save(), env.ticks
        wild = action(rng, size)
        passed, step = tried(lambda wild=wild: env.step(wild))
        accepted += passed
        if passed:
            observation, _, terminated, _, info = step
            assert_sound(env, observation, info)
            if terminated:
                env.reset()
        else:
            after = env.plant.save()
            assert (after, env.ticks) == before
    assert accepted < tries(400)
    assert continuation(env)


def test_options_of_any_kind_begin_a_sound_episode_or_are_refused_and_the_present_one_goes_on(kind, rng, tries):
    expected, env = None, begun(kind)
    for _ in range(tries(400)):
        wild = options(rng, kind)
        passed, begun_ = tried(lambda env=env, wild=wild: env.reset(seed=5, options=wild))
        if passed:
            assert wild is None or isinstance(wild, dict)
            assert_sound(env, *begun_)
            step = env.step(np.zeros(env.action_space.shape))
            assert_sound(env, step[0], step[4])
            env = begun(kind)
        elif rng.random() < 0.2:
            # Sometimes check that the current episode and the next are as if no reset had been tried.
            expected = expected or continuation(begun(kind))
            assert continuation(env) == expected
            env = begun(kind)
    assert expected is not None


def test_arguments_of_any_kind_make_a_sound_environment_or_are_refused(kind, rng, tries):
    accepted = 0
    for _ in range(tries(400)):
        wild = arguments(rng, kind)
        passed, env = tried(lambda wild=wild: kind(**wild))
        if not passed:
            continue
        accepted += 1
        assert not {"nothing", ""} & wild.keys()
        env.render_mode = None
        assert_sound(env, *env.reset(seed=1))
        step = env.step(np.zeros(env.action_space.shape))
        assert_sound(env, step[0], step[4])
    assert accepted < tries(400)


@pytest.mark.parametrize("mode", ["direct", "residual_force", "residual"])
def test_extreme_actions_never_make_anything_that_is_not_finite(kind, mode, rng, request):
    """With `--whole`, 390,000 steps over all cases with extreme actions, in all disturbances."""
    env = kind(**QUICK[kind] | {"wake": True}, action_mode=mode, sensors=True, randomization=1.0)
    size = env.action_space.shape[0]
    env.reset(seed=int(rng.integers(2**31)))
    for _ in range(65000 if request.config.getoption("--whole") else 60):
        wild = rng.choice([-1.0, 1.0, 0.0, 1e308, -1e308], size) if rng.random() < 0.5 else rng.uniform(-1, 1, size)
        observation, _, terminated, _, info = env.step(wild)
        assert_sound(env, observation, info)
        if terminated or rng.random() < 0.01:
            storm = {"wind": rng.uniform(0, 20), "push": rng.uniform(0, 200), "lost_rotor": int(rng.integers(0, 9))}
            assert_sound(env, *env.reset(options={"disturbances": storm}))


def test_vectors_go_on_after_a_diverged_step():
    envs = gymnasium.make_vec("spidar_gym/Hover-v0", 2, "sync", forms="form1", wake=False)
    envs.reset(seed=0)
    envs.envs[0].unwrapped.plant.data.qvel[:] = math.inf
    zero = np.zeros((2, 6), np.float32)
    _, _, terminated, _, info = envs.step(zero)
    assert terminated.tolist() == [True, False]
    assert info["failure"][0] == "diverged"
    for _ in range(3):
        observations, _, terminated, _, _ = envs.step(zero)
        assert observations in envs.observation_space
        assert not terminated.any()
    envs.close()
