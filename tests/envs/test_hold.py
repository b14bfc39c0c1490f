"""Tests steps of several control periods: equal to as many steps of one, ended early by a failure, refused below 1."""

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.actions import TORSO
from spidar_gym.envs.registry import CRAWL, ENVIRONMENTS, HOVER
from spidar_gym.errors import InvalidValueError
from spidar_gym.tasks.hover import HoverTask


@pytest.mark.parametrize("control", ["core", "python"])
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_a_step_of_four_periods_is_four_steps_of_one(name, control):
    long, short = (
        gymnasium.make(name, action_mode=TORSO, control=control, hold=hold, sensors=True).unwrapped for hold in (4, 1)
    )
    long.reset(seed=3)
    short.reset(seed=3)
    rng = np.random.default_rng(2)
    for _ in range(8):
        action = rng.normal(0.0, 0.2, 40).astype(np.float32)
        seen, reward, ended, _, info = long.step(action)
        for _ in range(4):
            seen_short, reward_short, ended_short, _, info_short = short.step(action)
        assert long.state.position_w.tobytes() == short.state.position_w.tobytes()
        assert long.state.joint_position.tobytes() == short.state.joint_position.tobytes()
        assert (reward, ended) == (reward_short, ended_short)
        if name != "spidar_gym/Course-v0":  # which observes the time left, in steps
            assert seen.tobytes() == seen_short.tobytes()
        assert info["energy_wh"] == info_short["energy_wh"]


@pytest.mark.parametrize("control", ["core", "python"])
def test_a_failure_ends_a_step_early(control):
    down = np.r_[np.tile([0.0, 0.0, -1.0], 8), np.zeros(16)].astype(np.float32)
    options = {"action_mode": TORSO, "action_scale": {"force": 10.0}, "control": control}
    short = gymnasium.make(HOVER, **options).unwrapped
    short.reset(seed=0)
    periods, ended = 0, False
    while not ended:
        _, _, ended, _, _ = short.step(down)
        periods += 1
    long = gymnasium.make(HOVER, hold=periods - 5, **options).unwrapped
    long.reset(seed=0)
    assert not long.step(down)[2]
    _, _, ended, _, info = long.step(down)
    assert ended
    assert info["failure"]
    assert abs(long.state.time - periods / 40.0) < 1e-9


class Leans(HoverTask):
    """A custom task with references of its own."""

    def reference(self, robots):
        found = robots.scheduled["reference"]
        found["position_w"][:, 0] = 0.1 * robots.time
        return found


def test_references_of_a_custom_task_are_new_in_every_control_period_and_ended_robots_stay():
    long, short = (gymnasium.make_vec(HOVER, num_envs=3, task=Leans, hold=hold) for hold in (4, 1))
    long.reset(seed=1)
    short.reset(seed=1)
    for _ in range(5):
        long.step(np.zeros((3, 6), np.float32))
        for _ in range(4):
            short.step(np.zeros((3, 6), np.float32))
    one, other = (each.robots["plant"]["state"]["position_w"] for each in (long, short))
    assert one.tobytes() == other.tobytes()
    assert long.robots["position_sum"].tobytes() == short.robots["position_sum"].tobytes()


def test_the_horizon_is_in_seconds_and_success_is_evaluated_there():
    env = gymnasium.make(HOVER, hold=8, forms="form1", horizon_s=2.0, preset="tuned")
    env.reset(seed=0)
    for k in range(10):
        _, _, ended, truncated, info = env.step(np.zeros(6, np.float32))
        assert (truncated, ended) == (k == 9, False)
    assert info["is_success"]


@pytest.mark.parametrize("hold", [0, -1])
def test_a_hold_below_one_period_is_refused(hold):
    with pytest.raises(InvalidValueError):
        gymnasium.make(CRAWL, hold=hold)
