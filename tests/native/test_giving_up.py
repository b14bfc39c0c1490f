"""Pins failures of MuJoCo: one robot's episode ends, and no other robot is affected."""

import copy
import ctypes
import time
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import SpidarError
from spidar_gym.native import engine_binding
from spidar_gym.native.engine_structs import N_DOFS
from spidar_gym.native.mujoco import member_offsets
from spidar_gym.tasks.crawl import CrawlTask
from spidar_gym.tasks.hover import HoverTask

DIVERGED = {HOVER: list(HoverTask.failures).index("diverged"), CRAWL: list(CrawlTask.failures).index("diverged")}


@pytest.fixture
def short_of_memory(monkeypatch):
    """Limit MuJoCo's memory: enough for contacts in flight or on the feet, not for those of a robot in the floor."""

    def have(room=250_000):
        plain = engine_binding.scene

        def scene(**options):
            model = copy.copy(plain(**options))
            ctypes.c_uint64.from_address(model._address + member_offsets("mjModel")["narena"]).value = room
            return model

        monkeypatch.setattr(engine_binding, "scene", scene)

    return have


def sink(env, robots):
    """Place robots half inside the floor."""
    plants = env.robots["plant"]
    plants["row"][robots, 3] = -0.1
    plants["clearance"][robots] = 0.0


def content(record):
    """Return the bytes of a record without padding."""
    if record.dtype.names is None:
        return record.tobytes()
    return b"".join(content(record[name]) for name in record.dtype.names)


def contents(env, robots):
    return [content(env.robots[k]) for k in robots]


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize(
    ("name", "options"),
    [(HOVER, {}), (HOVER, {"randomization": 1.0, "sensors": True}), (CRAWL, {}), (CRAWL, {"randomization": 1.0})],
)
def test_a_robot_for_which_mujoco_fails_has_diverged_and_affects_no_other(short_of_memory, name, options, threads):
    short_of_memory()
    options = {**options, "autoreset_mode": AutoresetMode.DISABLED, "num_threads": threads}
    env, quiet = NativeVectorEnv(name, 6, **options), NativeVectorEnv(name, 6, **options)
    env.reset(seed=3)
    quiet.reset(seed=3)
    others, rng = [0, 1, 3, 4, 5], np.random.default_rng(1)
    before: dict[str, Any] = {}
    for tick in range(12):
        actions = rng.normal(0.0, 0.3, env.action_space.shape)
        if tick == 5:
            sink(env, [2])
        seen, rewards, terminated, truncated, info = env.step(actions)
        quiet.step(actions)
        assert contents(env, others) == contents(quiet, others), tick
        assert not (terminated | truncated)[others].any()
        if tick == 4:
            before = info
        if tick == 5:
            assert (terminated[2], truncated[2], rewards[2]) == (True, False, 0.0)
            assert info["failure_code"][2] == DIVERGED[name]
            assert not seen[2].any()
            assert not info["term"][2].any()
            assert all(np.isfinite(value[2]).all() for value in info.values() if not isinstance(value, dict))
            for key in ("thrust", "joint_torque", "air_force", "energy_wh"):  # the last valid values
                np.testing.assert_array_equal(info[key][2], before[key][2])
            mask = np.arange(6) == 2
            env.reset(options={"reset_mask": mask})
            quiet.reset(options={"reset_mask": mask})
            # Its next episode is the one that it would have had without the failure.
            others = list(range(6))
    env.close()
    quiet.close()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("name", [HOVER, CRAWL])
def test_its_next_episode_begins_automatically(short_of_memory, name, mode):
    short_of_memory()
    env, other = NativeVectorEnv(name, 3, autoreset_mode=mode), NativeVectorEnv(name, 3, autoreset_mode="Disabled")
    env.reset(seed=5)
    other.reset(seed=5)
    actions = np.zeros(env.action_space.shape)
    env.step(actions)
    sink(env, [1])
    seen, _, terminated, _, info = env.step(actions)
    assert terminated.tolist() == [False, True, False]
    if mode is AutoresetMode.SAME_STEP:
        assert info["_final_obs"].tolist() == [False, True, False]
        assert info["final_info"]["failure_code"][1] == DIVERGED[name]
        assert not info["final_obs"][1].any()
    else:
        assert info["failure_code"][1] == DIVERGED[name]
        seen, _, terminated, _, info = env.step(actions)
        assert not terminated.any()
    first, _ = other.reset(options={"reset_mask": np.arange(3) == 1})
    np.testing.assert_array_equal(seen[1], first[1])
    assert info["failure_code"].tolist() == [-1, -1, -1]
    env.close()
    other.close()


def test_an_aborted_job_of_mujoco_affects_no_other_robot(short_of_memory):
    """MuJoCo does not free its memory after a failure; without recovery the next robots would fail, too."""
    short_of_memory()
    env, quiet = (NativeVectorEnv(HOVER, 40, autoreset_mode="Disabled") for _ in range(2))
    env.reset(seed=0)
    quiet.reset(seed=0)
    actions = np.zeros(env.action_space.shape)
    for _ in range(3):
        sink(env, np.arange(39))
        _, _, terminated, _, info = env.step(actions)
        quiet.step(actions)
        assert terminated.tolist() == [True] * 39 + [False]
        assert set(info["failure_code"].tolist()) == {DIVERGED[HOVER], -1}
        assert contents(env, [39]) == contents(quiet, [39])
    env.close()
    quiet.close()


@pytest.mark.parametrize("within_a_step", [False, True])
def test_a_failure_during_a_reset_is_reported_in_one_line(short_of_memory, within_a_step):
    short_of_memory()
    env = NativeVectorEnv(HOVER, 2, autoreset_mode=AutoresetMode.SAME_STEP)
    env.reset(seed=0)
    position_w = env.fleet.rules["position_w"]
    height = position_w[2]
    position_w[2] = -3.0  # the next episodes start inside the floor
    with pytest.raises(SpidarError, match=r"^MuJoCo failed for robot 0: [^\n]*stack overflow[^\n]*; valid: [^\n]*$"):
        env.step(np.zeros(env.action_space.shape)) if within_a_step else env.reset()
    position_w[2] = height
    env.reset(seed=0)
    assert not env.step(np.zeros(env.action_space.shape))[2].any()
    env.close()


def test_a_tick_ends_where_a_robot_on_tiles_has_diverged():
    """MuJoCo's contact detection took a second for a diverged robot, ten times in a tick."""
    env = NativeVectorEnv(CRAWL, 2, steps=0.02, autoreset_mode="Disabled")
    env.reset(seed=0)
    actions = np.zeros(env.action_space.shape)
    env.step(actions)
    env.robots["plant"]["row"][0, 1 + N_DOFS + 1 :][:N_DOFS] = 1e6
    began = time.process_time()
    _, _, terminated, _, info = env.step(actions)
    assert time.process_time() - began < 1.0
    assert terminated.tolist() == [True, False]
    assert info["failure_code"][0] == DIVERGED[CRAWL]
    env.close()
