"""Pins floors with a sampled slope: each robot on its own, in vectors and saved states, beside the task's arguments."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.registry import CRAWL
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.so3 import quat_to_matrix

SLOPE, HEADING = "ground.slope", "ground.heading"
STEEP = {SLOPE: (-0.2, 0.2), HEADING: (-math.pi, math.pi)}
"""Floors on which a robot visibly lies, and holds."""


def make(**options: Any) -> Any:
    return gymnasium.make(CRAWL, disable_env_checker=True, **options).unwrapped


def normals(slope, heading):
    """Normals of floors (n, 3) that rise by `slope` in the direction `heading`."""
    slope, heading = np.asarray(slope), np.asarray(heading)
    return np.stack([-np.sin(slope) * np.cos(heading), -np.sin(slope) * np.sin(heading), np.cos(slope)], axis=-1)


def test_every_robot_of_a_vector_lies_on_its_own_sampled_floor():
    env = NativeVectorEnv(CRAWL, 6, num_threads=2, preset="robust", randomization=STEEP)
    drawn = env.reset(seed=2)[1]["randomization"]
    config = env.robots["plant"]["config"]["ground"]
    assert np.array_equal(config["slope"], drawn[SLOPE])
    assert np.array_equal(config["heading"], drawn[HEADING])
    for _ in range(40):
        info = env.step(np.zeros((6, env.single_action_space.shape[0])))[4]
    up = np.array([quat_to_matrix(state["quat_wb"])[:, 2] for state in env.robots["plant"]["state"]])
    own = normals(drawn[SLOPE], drawn[HEADING])
    angles = np.arccos(np.clip(up @ own.T, -1.0, 1.0))
    assert np.diag(angles).max() < 1e-3
    assert angles[~np.eye(6, dtype=bool)].min() > 0.02
    assert info["tilt_rad"] == pytest.approx(np.diag(angles), abs=1e-5)
    env.close()


def test_robots_of_a_vector_with_and_without_ranges_have_the_episodes_of_single_environments():
    env = NativeVectorEnv(CRAWL, 4, num_threads=2)
    env.reset(seed=0)
    each: list[Any] = [STEEP, {}, {HEADING: (1.0, 2.0)}, {"strength": 1.0, SLOPE: (0.1, 0.2)}]
    slopes = [0.0, 0.0, 0.1, 0.0]
    seen, info = env.reset(seed=5, options={"randomization": each, "slope": slopes})
    assert info["randomization"][SLOPE][[1, 2]].tolist() == [0.0, 0.1]
    zero = np.zeros((4, env.single_action_space.shape[0]))
    steps = [env.step(zero) for _ in range(20)]
    for k in range(4):
        single = make(randomization=each[k], slope=slopes[k])
        assert np.array_equal(single.reset(seed=5 + k)[0], seen[k])
        for step in steps:
            assert np.array_equal(single.step(zero[k])[0], step[0][k])
        single.close()
    env.close()


@pytest.mark.parametrize(
    ("ranges", "options", "slope", "heading"),
    [
        (STEEP, {"slope": 0.5, "slope_direction": 5.0}, (-0.2, 0.2), (-math.pi, math.pi)),
        ({SLOPE: (0.1, 0.2)}, {"slope": 0.5, "slope_direction": 5.0}, (0.1, 0.2), (5.0, 5.0)),
        ({SLOPE: (0.1, 0.2)}, {"slope_direction": 1.0}, (0.1, 0.2), (1.0, 1.0)),
        ({HEADING: (1.0, 2.0)}, {"slope": 0.3, "slope_direction": 5.0}, (0.3, 0.3), (1.0, 2.0)),
        ({}, {"slope": 0.3, "slope_direction": 5.0}, (0.3, 0.3), (5.0, 5.0)),
    ],
)
def test_a_sampled_slope_or_heading_replaces_the_argument_and_the_other_stays(ranges, options, slope, heading):
    env = make(randomization=ranges, **options)
    for seed in range(3):
        env.reset(seed=seed)
        ground = env.plant.config.ground
        assert slope[0] <= ground.slope <= slope[1]
        assert heading[0] <= ground.heading <= heading[1]
    env.close()


@pytest.mark.parametrize("control", ["core", "python"])
def test_a_saved_robot_resumes_on_its_floor_where_another_robot_has_lain(control):
    first, other = (make(control=control, randomization=STEEP, preset="robust") for _ in range(2))
    first.reset(seed=1)
    other.reset(seed=2)
    zero = np.zeros(first.action_space.shape)
    for env in (first, other):
        for _ in range(5):
            env.step(zero)
    other.restore_state(first.save_state())
    assert other.plant.config.ground.slope == first.plant.config.ground.slope != 0.0
    for name in ("geom_quat", "geom_pos"):
        assert np.array_equal(getattr(other.plant.model, name), getattr(first.plant.model, name))
    for _ in range(40):
        assert np.array_equal(other.step(zero)[0], first.step(zero)[0])
    first.close()
    other.close()


@pytest.mark.parametrize("seed", range(2))
def test_a_cycle_on_a_sampled_floor_reaches_its_goal(seed):
    short = {"distance": 0.15, "direction": 0.0, "turn": 0.0, "schedule": "overlapped", "joint_speed": 0.4}
    env = make(**short, preset="robust", randomization={SLOPE: (0.05, 0.1), HEADING: (-math.pi, math.pi)})
    env.reset(seed=seed)
    zero = np.zeros(env.action_space.shape)
    for _ in range(3000):
        *_, terminated, _, info = env.step(zero)
        if terminated or info["finished"]:
            break
    assert info["failure"] == ""
    assert np.hypot(*info["goal_error"][:2]) < 0.015
    env.close()
