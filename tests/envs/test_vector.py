"""Pins the native vector: flights and crawls as with Python controllers, for any other robots and threads."""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from support.vectors import DRAWN, FLIGHTS, WORN, WORN_ON_COURSES, expected

from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import COURSE, CRAWL, HOVER
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownArgumentError, UnknownNameError
from spidar_gym.native.draws import to_numpy
from spidar_gym.tasks.hover import HoverTask

CRAWLS = {
    "published": {},
    "overlapped, legs pulled": {"preset": "overlapped", "action_mode": "residual_gait_force"},
    "drawn": {"preset": "robust", **DRAWN},
    "worn": {"preset": "robust", **WORN},
    "a slope of tiles": {"preset": "robust", "slope": 0.1, "slope_direction": 1.0, "steps": 0.01},
    "drawn robots on tiles": {"steps": 0.01, "randomization": 0.5, "sensors": True},
    "stairs of a drawn robot": {"preset": "robust", "steps": 0.04, "terrain": "stairs", "distance": 0.8, **DRAWN},
    "tiles or stairs": {"preset": "robust", "steps": 0.04, "terrain": "mixed"},
    "obstacles": {"obstacles": ((1.0, 0.0, 0.2),), "distance": 0.3},
    "alone": {"action_mode": "direct"},
}
SEEDS = {"a slope of tiles": 1}
"""Seeds other than 7, with which a foot lands on an edge and 1e-15 grow to 1e-6 in one tick."""


def compare(kind, name, options, ticks, size, tolerance, seed=7):
    """Step beside the environment with a Python controller; assert that every difference is within the tolerance."""
    env, vector = kind(control="python", **options), NativeVectorEnv(name, 1, **options)
    (first, info), (seen, told) = env.reset(seed=seed), vector.reset(seed=seed)
    rng, worst, reward = np.random.default_rng(8), {}, 0.0

    def look(title, one, other):
        shape = np.shape(one)
        difference = np.abs(np.asarray(one, float) - np.reshape(np.asarray(other, float), shape))
        relative = difference / np.maximum(1.0, np.abs(np.asarray(one, float)))
        worst[title] = max(worst.get(title, 0.0), float(relative.max()))

    rewards = np.zeros(1)
    for tick in range(ticks):
        look("observation", first, seen[0])
        look("reward", reward, rewards[0])
        known = expected(info, env.reward_terms, env.failures)
        assert {*known, *(f"_{title}" for title in known)} == told.keys() - {"randomization", "_randomization"}
        for title, value in known.items():
            look(title, value, told[title][0])
        if info["failure"]:
            break
        # Single precision, as from agents; some entries are out of range.
        action = rng.normal(0.0, size, env.action_space.shape).astype(np.float32)
        first, reward, terminated, _, info = env.step(action)
        seen, rewards, ended, _, told = vector.step(action[None])
        assert terminated == ended[0], tick
    drawn = to_numpy(vector.robots[0]["episode"]["generator"])
    assert drawn.bit_generator.state == env.np_random.bit_generator.state
    assert {title: value for title, value in worst.items() if value > tolerance} == {}
    vector.close()
    env.close()


@pytest.mark.parametrize("case", FLIGHTS)
def test_a_flight_is_that_of_the_python_controller(case):
    size = 0.05 if case == "alone" else 0.4
    compare(HoverEnv, HOVER, FLIGHTS[case], 60, size, 1e-9)


@pytest.mark.parametrize("case", CRAWLS)
def test_a_crawl_is_that_of_the_python_controller(case):
    # Contacts amplify rounding: the sums of air and sensors are computed in another order.
    compare(CrawlEnv, CRAWL, CRAWLS[case], 50, 0.2, 1e-8, SEEDS.get(case, 7))


def content(record):
    """Bytes of a record without padding."""
    if record.dtype.names is None:
        return record.tobytes()
    return b"".join(content(record[name]) for name in record.dtype.names)


def trace(name, robots, threads, ticks, seeds=None, **options):
    """Records of all robots, by seed, after some ticks; the actions follow from the seeds."""
    vector = NativeVectorEnv(name, robots, num_threads=threads, **options)
    seeds: list[int | None] = list(range(robots)) if seeds is None else seeds
    vector.reset(seed=seeds)
    size = len(vector.single_action_space.sample())
    actions = {s: np.random.default_rng(s).normal(0.0, 0.7, (ticks, size)) for s in seeds}
    for tick in range(ticks):
        vector.step(np.array([actions[s][tick] for s in seeds]))
    found = {s: content(vector.robots[k]) for k, s in enumerate(seeds)}
    vector.close()
    return found


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (HOVER, {"forms": "narrow", "joint_speed": 1.0, **DRAWN}), (CRAWL, {"preset": "robust", "randomization": 1.0}),
        (COURSE, {"hold": 5, **DRAWN}), (COURSE, {"action_mode": "residual", "hold": 5, "randomization": 1.0}),
        (COURSE, {"action_mode": "direct", **DRAWN}), (HOVER, WORN), (CRAWL, WORN),
        (COURSE, {"hold": 5, **WORN_ON_COURSES}),
    ],
)  # fmt: skip
def test_bits_do_not_depend_on_other_robots_threads_or_order(name, options):
    whole = trace(name, 9, 1, 30, **options)
    for other in (
        trace(name, 9, 3, 30, **options),
        trace(name, 2, 2, 30, [4, 1], **options),
        trace(name, 9, 2, 30, [8, 0, 3, 7, 1, 2, 6, 5, 4], **options),
    ):
        assert {s: bits == whole[s] for s, bits in other.items()} == dict.fromkeys(other, True)


def test_the_three_autoreset_modes_visit_the_same_episodes():
    options = {"forms": "form1", "action_mode": "direct", "max_episode_steps": 25}
    rng = np.random.default_rng(3)
    actions = np.concatenate([rng.uniform(-0.4, 0.2, (200, 3, 8)), rng.normal(0.0, 0.1, (200, 3, 32))], axis=2)
    episodes = {}
    for mode in AutoresetMode:
        vector = NativeVectorEnv(HOVER, 3, autoreset_mode=mode, **options)
        seen, _ = vector.reset(seed=11)
        visited = [[[seen[k]]] for k in range(3)]
        taken = np.zeros(3, int)
        while taken.min() < 60:
            chosen = np.array([actions[taken[k], k] for k in range(3)])
            resetting = vector.robots["episode"]["over"].astype(bool) & (mode is AutoresetMode.NEXT_STEP)
            seen, rewards, terminated, truncated, info = vector.step(chosen)
            taken += ~resetting
            over = terminated | truncated
            for k in range(3):
                if resetting[k]:
                    visited[k].append([seen[k]])
                    assert rewards[k] == 0.0
                    assert not over[k]
                elif over[k] and mode is AutoresetMode.SAME_STEP:
                    assert info["_final_obs"][k]
                    visited[k][-1].append(info["final_obs"][k])
                    visited[k].append([seen[k]])
                else:
                    visited[k][-1].append(seen[k])
            if mode is AutoresetMode.DISABLED and over.any():
                seen, info = vector.reset(options={"reset_mask": over})
                assert (info["_failure_code"] == over).all()
                for k in np.flatnonzero(over):
                    visited[k].append([seen[k]])
        episodes[mode] = [[np.array(episode).tobytes() for episode in robot[:2]] for robot in visited]
        vector.close()
    assert len(episodes[AutoresetMode.NEXT_STEP][0]) == 2
    assert episodes[AutoresetMode.NEXT_STEP] == episodes[AutoresetMode.SAME_STEP] == episodes[AutoresetMode.DISABLED]


def test_a_robot_that_fails_or_diverges_affects_no_other_robot():
    options: dict[str, Any] = {"autoreset_mode": AutoresetMode.DISABLED, "forms": "form1", "action_mode": "direct"}
    quiet = trace(HOVER, 3, 1, 20, **options)
    vector = NativeVectorEnv(HOVER, 3, **options)
    vector.reset(seed=[0, 1, 2])
    actions = [np.random.default_rng(s).normal(0.0, 0.7, (20, 40)) for s in range(3)]
    for tick in range(20):
        if tick == 5:
            row = vector.robots["plant"]["row"]
            row[1, 1 + 39 : 1 + 39 + 38] = 1e30  # the velocities in MuJoCo's state, after time and positions
        seen, rewards, terminated, _, info = vector.step(np.array([a[tick] for a in actions]))
        if tick == 5:
            assert terminated[1]
            assert info["failure_code"][1] == list(HoverTask.failures).index("diverged")
            assert rewards[1] == 0.0
            assert not seen[1].any()
            assert np.isfinite(info["position_error"]).all()
    assert [content(vector.robots[k]) == quiet[k] for k in (0, 2)] == [True, True]
    vector.close()


def test_seeds_are_those_of_gymnasiums_own_vectors():
    one, other = NativeVectorEnv(HOVER, 3), NativeVectorEnv(HOVER, 3)
    np.testing.assert_array_equal(one.reset(seed=5)[0], other.reset(seed=[5, 6, 7])[0])
    np.testing.assert_array_equal(one.reset()[0], other.reset()[0])
    assert not np.array_equal(one.reset(seed=5)[0][0], one.reset(seed=6)[0][0])
    one.close()
    other.close()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda env: env.step(np.zeros((2, 6))), "shape"),
        (lambda env: env.step(np.full((3, 6), np.nan)), "finite numbers"),
        (lambda env: env.reset(seed=[1, 2]), "or 3 of them"),
        (lambda env: env.reset(options={"reset_mask": np.ones(2, bool)}), "3 flags"),
        (lambda env: env.reset(options={"reset_mask": np.zeros(3, bool)}), "at least one of them"),
        (lambda env: env.reset(options={"reset_mask": np.ones(3)}), "3 flags"),
    ],
)
def test_invalid_arguments_are_refused_and_nothing_moves(call, words):
    env = NativeVectorEnv(HOVER, 3)
    env.reset(seed=1)
    env.step(np.zeros((3, 6)))
    before = env.robots.tobytes()
    with pytest.raises(InvalidValueError, match=words):
        call(env)
    assert env.robots.tobytes() == before
    env.close()


def test_invalid_vectors_are_refused():
    with pytest.raises(UnknownNameError, match="Hover-v0"):
        NativeVectorEnv("spidar_gym/Swim-v0", 2)
    bad: dict[str, Any]
    for bad in ({"num_envs": 0}, {"num_envs": 2, "num_threads": 0}, {"num_envs": 2, "max_episode_steps": 0}):
        with pytest.raises(InvalidValueError, match="at least 1"):
            NativeVectorEnv(HOVER, **bad)
    with pytest.raises(UnknownArgumentError, match=r"'control'; valid: num_threads, .*; .* every robot of a vector$"):
        NativeVectorEnv(HOVER, 2, control="python")
    env = NativeVectorEnv(HOVER, 2)
    with pytest.raises(SpidarError, match="call reset"):
        env.step(np.zeros((2, 6)))
    env.close()
    env.close()
    with pytest.raises(SpidarError, match="is closed; valid: a new one"):
        env.reset(seed=0)
