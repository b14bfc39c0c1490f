"""Pins when a crawl without a gait is finished: at rest at the goal, by the engine, the readable path and the page."""

from dataclasses import replace
from functools import cache
from typing import Any

import gymnasium
import numpy as np
import pytest

from spidar_gym.control.crawl.footsteps import GaitConfig, lying_pose
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.envs.progress import CrawlProgress
from spidar_gym.envs.registry import CRAWL
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.robot import ROBOT
from spidar_gym.sim.ground import Touch
from spidar_gym.state import RobotState
from spidar_gym.tasks.crawl import REST_TIME, CrawlTask

SHORT = {"distance": 0.15, "direction": 0.0, "turn": 0.0, "schedule": "overlapped", "joint_speed": 0.4}
"""One quick cycle."""
AT_HAND = {"distance": 0.005, "direction": 0.0, "turn": 0.0}
"""A goal so near that the robot lies at it."""
STILL = RobotState.at_rest(lying_pose(GaitConfig()))
ON_PEGS = Touch(np.ones(4, bool), np.ones(8, bool), False, np.zeros(4), np.zeros(4), 0.1)
REST_TICKS = round(REST_TIME * 40)


def make(**options) -> Any:
    return gymnasium.make(CRAWL, disable_env_checker=True, **options).unwrapped


@cache
def classical():
    """The quick cycle and a rest after it: actions of `direct` with its commands, and the time that it took [s]."""
    env, actions, rest, seconds = make(**SHORT), [], 2 * REST_TICKS, 0.0
    env.reset(seed=0)
    while rest:
        *_, info = env.step(np.zeros(4))
        rest, seconds = rest - info["finished"], info["time_s"]
        turns = np.remainder(info["vectoring_command"].T + np.pi, 2.0 * np.pi) - np.pi
        joints = env.fleet.robots[0]["episode"]["command"]["joint_position"] / ROBOT.joint_limit
        thrust = 2.0 * info["thrust_command"] / ROBOT.max_thrust - 1.0
        actions.append(np.concatenate([thrust, turns.ravel() / np.pi, joints]).astype(np.float32))
    return actions, seconds


def lying(env):
    """The action with which a robot goes on lying: rotors off, joints where they are."""
    return np.concatenate([-np.ones(8), np.zeros(16), env.state.joint_position / ROBOT.joint_limit])


@pytest.mark.parametrize("control", ["core", "python"])
def test_the_classical_commands_replayed_without_a_gait_are_a_success(control):
    actions, seconds = classical()
    env = make(**SHORT, action_mode="direct", control=control)
    env.reset(seed=0)
    info = {}
    for action in actions:
        *_, terminated, _, info = env.step(action)
        assert not terminated
        assert info["is_success"] == info["finished"]
    assert info["is_success"], info["shortfalls"]
    assert np.hypot(*info["goal_error"][:2]) < 0.003
    assert 0.0 <= info["time_s"] - seconds <= REST_TIME + 1e-9


def test_the_page_in_numpy_finishes_a_crawl_without_a_gait_in_the_same_tick():
    ways = []
    for task in (None, CrawlTask()):
        vector = NativeVectorEnv(CRAWL, 1, task=task, **SHORT, action_mode="direct", autoreset_mode="Disabled")
        vector.reset(seed=0)
        told = [vector.step(action[None]) for action in classical()[0]]
        ways.append([(r.item(), i["is_success"].item(), i["time_s"].item()) for _, r, *_, i in told])
        vector.close()
    np.testing.assert_allclose(*ways, rtol=0, atol=1e-15)
    assert ways[0][-1][1]


@pytest.mark.parametrize("control", ["core", "python"])
@pytest.mark.parametrize(
    ("change", "is_there"),
    [({}, True), ({"distance": 0.02}, False), ({"turn": 0.03}, False), ({"distance": 9.0}, False)],
)
def test_lying_still_without_a_gait_is_a_success_at_the_goal_alone(control, change, is_there):
    env = make(**AT_HAND | change, action_mode="direct", control=control)
    env.reset(seed=0)
    told = [env.step(lying(env))[-1] for _ in range(3 * REST_TICKS)]
    assert told[-1]["finished"] == told[-1]["is_success"] == (told[-1]["shortfalls"] == "") == is_there
    assert not any(info["finished"] for info in told[: REST_TICKS - 1])


def test_rotors_that_carry_and_legs_that_move_are_no_rest():
    env = make(**AT_HAND, action_mode="direct")
    env.reset(seed=0)
    rest = lying(env)
    for k in range(4 * REST_TICKS):
        action = rest.copy()
        if k % 16 < 8:
            action[:8] = -0.85  # 14 % of the weight
        else:
            action[24:] += 0.02 * (-1) ** (k // 4)
        assert not env.step(action)[-1]["finished"]


@pytest.mark.parametrize(
    "change",
    [
        {"velocity_w": np.array([0.011, 0.0, 0.0])}, {"omega_b": np.array([0.0, 0.0, 0.06])},
        {"joint_velocity": 0.06 * np.eye(16)[5]}, {"thrust": 0.11 * ROBOT.weight}, {"pegs": np.zeros(8, bool)},
        {"error": (0.011, 0.0, 0.0)}, {"error": (0.0, 0.0, 0.021)},
    ],
)  # fmt: skip
def test_each_thing_that_does_not_rest_begins_the_time_anew(change):
    def tick(error=(0.0, 0.0, 0.0), thrust=0.0, pegs=ON_PEGS.pegs, **state):
        progress.ticks += 1
        progress.error = np.array(error)
        progress.rest(replace(STILL, **state), replace(ON_PEGS, pegs=pegs), thrust)
        return bool(progress.finished)

    progress = CrawlProgress(Pose2(), 20.0, np.zeros(3))
    assert not any(tick() for _ in range(REST_TICKS - 1))
    assert not tick(**change)
    assert [tick() for _ in range(REST_TICKS)] == [False] * (REST_TICKS - 1) + [True]
