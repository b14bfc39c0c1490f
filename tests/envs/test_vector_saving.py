"""Pins single robots of a vector: pictures with their floors, and saved robots that continue in other places."""

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import jaxtyping
import numpy as np
import pytest
from support.vectors import DRAWN, WORN

from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, HOVER
from spidar_gym.envs.serialization.fleets import CHECKSUM
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.robot import FORMS

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "flights of one robot": (HOVER, {"forms": "mixed", "joint_speed": 1.0}),
    "flights of drawn robots": (HOVER, {"preset": "tuned", "forms": "narrow", **DRAWN}),
    "flights of worn robots": (HOVER, {"preset": "tuned", **WORN}),
    "crawls": (CRAWL, {}),
    "crawls of drawn robots on tiles": (CRAWL, {"preset": "robust", "steps": 0.01, "slope": 0.1, **DRAWN}),
    "crawls of worn robots": (CRAWL, {"preset": "robust", **WORN}),
    "crawls on tiles or stairs": (CRAWL, {"preset": "robust", "steps": 0.05, "terrain": "mixed"}),
    "courses by targets": (COURSE, {"hold": 5, **DRAWN}),
    "courses by the rule": (COURSE, {"action_mode": "residual", "hold": 5}),
    "courses alone": (COURSE, {"action_mode": "direct", **DRAWN}),
}


def trace(env, ids, seeds, ticks):
    """Results of some robots over some ticks, while the other robots receive random actions."""
    size = env.single_action_space.shape[0]
    generators = {k: np.random.default_rng(s) for k, s in zip(ids, seeds, strict=True)}
    actions = np.zeros((env.num_envs, size))
    noise, shown = np.random.default_rng(99), []
    for _ in range(ticks):
        actions[:] = noise.normal(0.0, 0.2, actions.shape)
        for k in ids:
            actions[k] = generators[k].normal(0.0, 0.2, size)
        seen, rewards, *ends, info = env.step(actions)
        shown.append(
            [np.concatenate([seen[k], [rewards[k]], info["thrust"][k], [end[k] for end in ends]]) for k in ids]
        )
    return np.array(shown)


def content(record):
    """Bytes of a record without padding."""
    if record.dtype.names is None:
        return record.tobytes()
    return b"".join(content(record[name]) for name in record.dtype.names)


@pytest.mark.parametrize("case", CASES)
def test_a_restored_robot_continues_bit_for_bit_in_another_place_of_another_vector(case):
    name, options = CASES[case]
    first = NativeVectorEnv(name, 3, max_episode_steps=30, **options)
    first.reset(seed=5)
    trace(first, [0, 2], [1, 2], 12)
    before = first.robots.tobytes()
    saved = first.save([0, 2])
    assert first.robots.tobytes() == before
    # Beyond the end of the episode: a restored robot also begins the same next episode.
    expected = trace(first, [0, 2], [3, 4], 26)
    other = NativeVectorEnv(name, 5, num_threads=2, max_episode_steps=30, **options)
    other.reset(seed=50)
    trace(other, [0], [0], 5)
    seen, info = other.restore(saved, [4, 1])
    assert np.flatnonzero(info["_thrust"]).tolist() == [1, 4]
    assert seen[4] in other.single_observation_space
    assert np.array_equal(trace(other, [4, 1], [3, 4], 26), expected)
    assert [content(other.robots[k]) for k in (4, 1)] == [content(first.robots[k]) for k in (0, 2)]
    # Restore into the original vector too, at a later time.
    first.restore(saved, [0, 2])
    assert np.array_equal(trace(first, [0, 2], [3, 4], 26), expected)
    first.close()
    other.close()


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_a_robot_that_has_just_begun_is_restored(name):
    env = NativeVectorEnv(name, 2)
    env.reset(seed=0)
    before = env.robots.tobytes()
    env.restore(env.save())
    assert env.robots.tobytes() == before
    env.close()


IN_ANOTHER_PROCESS = """
import hashlib, sys
import numpy as np
from spidar_gym.envs.vector import NativeVectorEnv
options = {"preset": "tuned", "randomization": 1.0, "sensors": True}
env = NativeVectorEnv("spidar_gym/Hover-v0", 2, autoreset_mode="SameStep", **options)
env.restore(open(sys.argv[1], "rb").read())
shown = [env.step(np.full((2, 6), 0.1 * (k % 5)))[0].tobytes() for k in range(20)]
print(hashlib.sha256(b"".join(shown)).hexdigest())
"""


def test_a_restored_robot_continues_bit_for_bit_in_another_process(tmp_path: Path):
    options = {"preset": "tuned", "randomization": 1.0, "sensors": True}
    env = NativeVectorEnv(HOVER, 2, **options)
    env.reset(seed=1)
    trace(env, [0], [1], 10)
    path = tmp_path / "robots"
    path.write_bytes(env.save())
    shown = [env.step(np.full((2, 6), 0.1 * (k % 5)))[0].tobytes() for k in range(20)]
    env.close()
    told = subprocess.run(
        [sys.executable, "-c", IN_ANOTHER_PROCESS, str(path)], capture_output=True, text=True, check=True
    )
    assert told.stdout.split()[-1] == hashlib.sha256(b"".join(shown)).hexdigest()


def test_a_start_with_many_forms_is_saved_with_the_robot():
    options = {"horizon_s": 2.0, "wake": False}
    q = FORMS["form1"].tolist()
    start = {"goals": [[0.02 * k, 0.02 * k, q] for k in range(60)], "position": [0.0] * 3, "rotation": [0.0] * 3}
    one, other = NativeVectorEnv(HOVER, 1, **options), NativeVectorEnv(HOVER, 2, **options)
    one.reset(seed=1, options={"start": start})
    other.reset(seed=1)
    other.restore(one.save(), [1])
    assert np.array_equal(trace(one, [0], [1], 85), trace(other, [1], [1], 85))
    one.close()
    other.close()


def test_invalid_saved_robots_are_refused_in_one_line_and_nothing_changes():
    env = NativeVectorEnv(HOVER, 3)
    with pytest.raises(SpidarError, match="call reset"):
        env.save()
    env.reset(seed=0)
    saved = env.save([0, 1])
    env.step(np.zeros((3, 6)))
    crawls, others = NativeVectorEnv(CRAWL, 2), NativeVectorEnv(HOVER, 2, forms="narrow", joint_speed=0.5)
    foreign = []
    for vector in (crawls, others):
        vector.reset(seed=0)
        foreign.append(vector.save())
        vector.close()
    damaged = bytearray(saved)
    damaged[2000] ^= 1
    before = env.robots.tobytes()
    for given, ids, words in (
        (b"", [0, 1], "no saved robots"),
        (b"nothing of ours", [0, 1], "no saved robots"),
        (bytes(damaged), [0, 1], "damaged"),
        (saved[:-CHECKSUM], [0, 1], "damaged"),
        (foreign[0], [0, 1], "another environment: 'crawl'; valid here: hover"),
        (foreign[1], [0, 1], "another set of options"),
        (saved, [0], "2 robots, as many as were saved"),
        (saved, None, "2 robots"),
        (saved, [0, 3], "each once, within 0 … 2"),
        (saved, [1, 1], "each once"),
    ):
        with pytest.raises((SpidarError, InvalidValueError), match=words) as error:
            env.restore(given, ids)
        assert "\n" not in str(error.value)
    assert env.robots.tobytes() == before
    for ids in ([-1], [3], [0, 0]):
        with pytest.raises(InvalidValueError, match="each once"):
            env.save(ids)
    env.close()


@pytest.mark.parametrize("mode", ["rgb_array", "depth_array"])
def test_every_robot_is_rendered_with_its_floor(mode):
    options = {"steps": 0.03, "preset": "robust", "render_mode": mode, "width": 160, "height": 120}
    env: Any = NativeVectorEnv(CRAWL, 3, **options)
    with pytest.raises(SpidarError, match="call reset"):
        env.render()
    env.reset(seed=0)
    before = env.robots.tobytes()
    pictures = env.render()
    assert env.robots.tobytes() == before
    assert [picture.shape for picture in pictures] == [(120, 160, 3) if mode == "rgb_array" else (120, 160)] * 3
    assert not np.array_equal(pictures[0], pictures[1])
    again = env.render([2, 0])
    assert [np.array_equal(*pair) for pair in zip(again, (pictures[2], pictures[0]), strict=True)] == [True, True]
    # The picture equals that of the single environment.
    single: Any = type(env._single)(control="core", **options)
    single.reset(seed=1)
    assert np.array_equal(single.render(), pictures[1])
    single.close()
    env.close()


def test_a_window_shows_a_single_robot_and_without_a_mode_there_is_no_picture():
    with pytest.raises(InvalidValueError, match="a single robot"):
        NativeVectorEnv(HOVER, 2, render_mode="human")
    env = NativeVectorEnv(HOVER, 2)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="without a render_mode"):
        assert env.render() is None
    env.close()


class Odd:
    """An object whose conversion to an array raises."""

    def __array__(self, *_, **__):
        raise KeyError("no")


NO_ROBOTS = [
    5, "01", ["a", 1], [float("nan"), 1], [[0, 1]], [[0], [1, 2]], [2**70, 1], {0, 1}, [None], [0, 0], [-1], [2],
    [0.0, 1.0], [Odd()], Odd(), iter([0]),
]  # fmt: skip


def test_invalid_numbers_of_robots_are_refused_in_one_line_in_every_call(monkeypatch):
    """Some of these once raised other exceptions; `advance` passed them to MuJoCo, which ended the process."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # users have no type checker
    env: Any = NativeVectorEnv(HOVER, 2, render_mode="rgb_array")
    env.reset(seed=0)
    saved, actions = env.save(), np.zeros(env.action_space.shape)
    ways = {
        "save": env.save, "restore": lambda ids: env.restore(saved, ids), "render": env.render,
        "advance": lambda ids: env.advance(actions, ids),
        "mask": lambda ids: env.reset(options={"reset_mask": ids}),
    }  # fmt: skip
    before = env.robots.tobytes()
    for name, call in ways.items():
        for ids in NO_ROBOTS:
            with pytest.raises(InvalidValueError, match=r"^ids|^reset_mask") as error:
                call(ids)
            assert "\n" not in str(error.value), name
    with pytest.raises(InvalidValueError, match="rising order"):
        env.advance(actions, [1, 0])
    assert env.robots.tobytes() == before
    env.advance(actions, [1])
    env.close()
