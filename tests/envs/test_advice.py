"""Pins the controller's advice in `direct` flights: a led flight is the controller's; the advice is an action."""

import numpy as np
import pytest

from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import ROBOT

FLIGHTS = {
    "fast": {"forms": "independent", "joint_speed": 1.0},
    "drawn": {"forms": "independent", "joint_speed": 0.6, "sensors": True, "randomization": 1.0},
    "narrow": {"forms": "narrow", "joint_speed": 0.2},
}
ROBOTS, TICKS, SIZE = 3, 120, 40


def advised(options, preset="tuned"):
    """A vector of direct flights with advice, and the size of its observation without the last action."""
    vector = NativeVectorEnv(HOVER, ROBOTS, preset=preset, action_mode="direct", **options)
    vector.fleet.ask_advice()
    return vector, vector.single_observation_space.shape[0] - SIZE


@pytest.mark.parametrize("preset", ["tuned", "paper"])
@pytest.mark.parametrize("name", FLIGHTS)
def test_a_flight_that_is_led_is_the_controllers(name, preset):
    own = NativeVectorEnv(HOVER, ROBOTS, preset=preset, **FLIGHTS[name])
    led, size = advised(FLIGHTS[name], preset)
    led.robots["is_led"] = True
    first, second = own.reset(seed=3)[0], led.reset(seed=3)[0]
    idle = np.zeros((ROBOTS, *own.single_action_space.shape))
    for _ in range(TICKS):
        np.testing.assert_array_equal(first[:, :size], second[:, :size])
        first, second = own.step(idle)[0], led.step(np.zeros((ROBOTS, SIZE)))[0]
    assert own.robots["episode"]["ticks"].tolist() == [TICKS] * ROBOTS


@pytest.mark.parametrize("name", FLIGHTS)
def test_the_advice_is_an_action_that_flies_the_same_when_another_policy_commands_it(name):
    led, _ = advised(FLIGHTS[name])
    student, size = advised(FLIGHTS[name])
    led.robots["is_led"] = True
    led.reset(seed=3)
    student.reset(seed=3)
    for _ in range(TICKS):
        first = led.step(np.zeros((ROBOTS, SIZE)))[0]
        said = led.robots["episode"]["action"][:, :SIZE].copy()
        np.testing.assert_allclose(first[:, size:], said, rtol=0.0, atol=1e-6)
        second = student.step(said)[0]
        np.testing.assert_allclose(second, first, rtol=0.0, atol=1e-6)
        for word in ("thrust", "joint_position"):
            np.testing.assert_allclose(
                student.robots["advice"][word], led.robots["advice"][word], rtol=0.0, atol=1e-6
            )  # fmt: skip


def test_a_robot_that_is_not_led_follows_its_actions_and_receives_advice():
    """A bad policy with a constant low thrust falls, and the advised thrust grows."""
    asked, _ = advised(FLIGHTS["fast"])
    alone = NativeVectorEnv(HOVER, ROBOTS, preset="tuned", action_mode="direct", **FLIGHTS["fast"])
    asked.reset(seed=5)
    alone.reset(seed=5)
    action = np.zeros((ROBOTS, SIZE))
    action[:, :8] = -0.5
    totals = []
    for _ in range(8):
        asked.step(action)
        alone.step(action)
        for part in ("position_w", "velocity_w", "joint_position", "thrust", "vectoring"):
            np.testing.assert_array_equal(
                asked.robots["plant"]["state"][part], alone.robots["plant"]["state"][part]
            )  # fmt: skip
        totals.append(asked.robots["advice"]["thrust"].sum(axis=1))
    assert np.all(totals[-1] > totals[0])


def test_thrust_commanded_by_a_policy_is_not_estimated_as_wind():
    """The disturbance observer accounts for 3 N of thrust beyond the advice, unlike for 3 N of wind."""
    led, _ = advised({"forms": "paper"})
    student, _ = advised({"forms": "paper"})
    led.robots["is_led"] = True
    led.reset(seed=3)
    student.reset(seed=3)
    more = 3.0 / 8.0 / ROBOT.max_thrust
    for _ in range(40):
        led.step(np.zeros((ROBOTS, SIZE)))
        said = led.robots["episode"]["action"][:, :SIZE].copy()
        said[:, :8] += 2.0 * more
        student.step(said)
    rise = student.robots["plant"]["state"]["position_w"][:, 2] - led.robots["plant"]["state"]["position_w"][:, 2]
    assert np.all(rise > 0.03)
    memory = [vector.robots["flight"]["memory"]["compensation"]["external_w"] for vector in (student, led)]
    assert np.abs(memory[0] - memory[1])[:, :3].max() < 0.5


def test_advice_is_refused_where_the_controller_flies_anyway_and_on_the_ground():
    for name, options in ((HOVER, {}), (CRAWL, {"action_mode": "direct"})):
        with pytest.raises(InvalidValueError, match="expected a flight with action_mode=direct"):
            NativeVectorEnv(name, 1, **options).fleet.ask_advice()
