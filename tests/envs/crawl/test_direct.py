"""Pins when a crawl without a gait is finished: at rest at the goal, with either controller."""

from functools import cache
from typing import Any

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.registry import CRAWL
from spidar_gym.robot import ROBOT
from spidar_gym.tasks.crawl import REST_TIME

SHORT = {"distance": 0.15, "direction": 0.0, "turn": 0.0, "schedule": "overlapped", "joint_speed": 0.4}
"""One quick cycle."""
AT_HAND = {"distance": 0.005, "direction": 0.0, "turn": 0.0}
"""A goal within the tolerance of the start."""
REST_TICKS = round(REST_TIME * 40)


def make(**options) -> Any:
    return gymnasium.make(CRAWL, disable_env_checker=True, **options).unwrapped


@cache
def classical():
    """The quick cycle and a rest: its commands as actions of `direct`, and its duration [s]."""
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
    """The action with which a robot stays on the floor: rotors off, joints held."""
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
    ("what", "change"),
    [
        ("slides", {"qvel": (0, 0.5)}), ("turns", {"qvel": (5, 1.0)}), ("a joint moves", {"joint": 0.2}),
        ("is carried", {"thrust": -0.75}), ("is off its pegs", {"qpos": (2, 0.02)}),
        ("is elsewhere", {"qpos": (0, -0.011)}),
    ],
)  # fmt: skip
def test_each_motion_or_lift_restarts_the_time_at_rest(what, change):
    env = make(**AT_HAND, action_mode="direct")
    env.reset(seed=0)
    rest = lying(env)
    for k in range(REST_TICKS - 5):
        env.step(rest)
        assert env.progress.rested == k + 1
    action = rest.copy()
    action[:8] = change.get("thrust", -1.0)
    action[24:] += change.get("joint", 0.0)
    for name in ("qpos", "qvel"):
        if name in change:
            at, by = change[name]
            getattr(env.plant.data, name)[at] += by
    for _ in range(4 if "joint" in change else 1):  # a servo needs some ticks to move
        env.step(action)
    assert env.progress.rested == 0, what
    assert not env.progress.finished, what
    if "qpos" not in change:
        finished = [env.step(rest)[-1]["finished"] for _ in range(REST_TICKS + 3)]
        assert not any(finished[: REST_TICKS - 1]), what
