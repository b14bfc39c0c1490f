"""Pins the ramp of the joints: straight to the target, within speed and acceleration, never past it."""

import math

import numpy as np
import pytest
from support.compensations import DT, close
from support.states import model, resting, staying

from spidar_gym.control.flight.compensation import (
    CompensationConfig,
    ramp_joints,
)
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.robot import FORMS, ROBOT

# ---- the ramp of the joints ----

SPEED, RAMP = 0.5, 0.4
STEP = SPEED / RAMP * DT
"""Largest change of the velocity in a tick [rad/s]."""


def ramped(start, targets, *, speed=SPEED, ramp=RAMP):
    """Commands and velocities of one tick per target, preceded by the start."""
    q, v = start, np.zeros(16)
    path, rates = [q], [v]
    for target in targets:
        q, v = ramp_joints(q, v, target, speed=speed, ramp=ramp, dt=DT)
        path.append(q)
        rates.append(v)
    return np.array(path), np.array(rates)


def check_bounds(path, rates, speed=SPEED, ramp=RAMP):
    assert np.abs(rates).max() <= speed * (1.0 + 1e-9)
    assert np.abs(np.diff(rates, axis=0)).max() <= speed / ramp * DT * (1.0 + 1e-6)
    close(np.diff(path, axis=0), DT * rates[1:], atol=2e-9)


@pytest.mark.parametrize("seed", range(8))
def test_a_ramp_goes_straight_to_its_target_within_speed_and_acceleration(seed):
    rng = np.random.default_rng(seed)
    start, target = rng.uniform(-1.0, 1.0, (2, 16))
    speed, ramp = rng.uniform(0.2, 1.0), rng.uniform(0.1, 0.8)
    longest = np.abs(target - start).max()
    time = longest / speed + ramp
    path, rates = ramped(start, [target] * (math.ceil(time / DT) + 10), speed=speed, ramp=ramp)
    check_bounds(path, rates, speed, ramp)
    share = (path - start) @ (target - start) / ((target - start) @ (target - start))
    close(path, start + np.outer(share, target - start), atol=1e-9)
    np.testing.assert_array_equal(path[-1], target)


@pytest.mark.parametrize("seed", range(8))
def test_a_ramp_never_passes_its_target_nor_turns_back(seed):
    rng = np.random.default_rng(50 + seed)
    for distance in (0.001, 0.01, 0.2, rng.uniform(0.0, 0.1), rng.uniform(0.1, 2.0)):
        target = distance * np.linspace(-1.0, 1.0, 16)
        path, rates = ramped(np.zeros(16), [target] * 300, speed=rng.uniform(0.2, 1.0), ramp=rng.uniform(0.1, 0.8))
        assert (path[:, -1]).max() <= distance * (1.0 + 1e-9)
        assert rates[:, -1].min() >= 0.0


@pytest.mark.parametrize("distance", [0.25, 0.4, 1.0, 1.8])
def test_a_ramp_takes_its_distance_at_full_speed_and_one_ramp(distance):
    target = distance * np.linspace(-1.0, 1.0, 16)
    path, _ = ramped(np.zeros(16), [target] * 300)
    arrived = int(np.argmax(np.abs(path - target).max(axis=1) < 1e-6))
    assert abs(DT * arrived - (distance / SPEED + RAMP)) <= DT * (1.0 + 1e-9)


def test_a_short_distance_is_accelerated_and_braked_without_reaching_full_speed():
    distance = 0.05
    target = np.full(16, distance)
    path, rates = ramped(np.zeros(16), [target] * 100)
    least = 2.0 * math.sqrt(distance * RAMP / SPEED)
    arrived = int(np.argmax(np.abs(path - target).max(axis=1) < 1e-6))
    assert least - DT <= DT * arrived <= least + 2.0 * DT
    assert rates.max() < 0.6 * SPEED


def test_a_target_that_changes_on_the_way_breaks_no_bound_and_is_reached():
    rng = np.random.default_rng(30)
    targets = np.repeat(rng.uniform(-1.0, 1.0, (12, 16)), 17, axis=0)
    path, rates = ramped(np.zeros(16), [*targets, *[targets[-1]] * 300])
    check_bounds(path, rates)
    np.testing.assert_array_equal(path[-1], targets[-1])
    assert not rates[-1].any()


def test_a_target_that_jumps_every_tick_breaks_no_bound():
    rng = np.random.default_rng(31)
    check_bounds(*ramped(np.zeros(16), rng.uniform(-1.0, 1.0, (400, 16))))


def test_a_ramp_with_nowhere_to_go_stays():
    q = np.linspace(-0.3, 0.4, 16)
    path, rates = ramped(q, [q] * 5)
    np.testing.assert_array_equal(path, np.tile(q, (6, 1)))
    assert not rates.any()


def test_the_controllers_joints_ramp_and_its_tick_reports_their_rate():
    state, target = resting(FORMS["form1"]), FORMS["form2"]
    controller = FlightController(ControllerConfig(compensation=CompensationConfig(joint_ramp=RAMP)), model())
    controller.reset(state)
    path, rates = [state.joint_position], [np.zeros(16)]
    for _ in range(20):
        path.append(controller.step(state, staying(state, joint_target=target)).joint_position)
        rates.append(controller.last_step.joint_velocity)
    check_bounds(np.array(path), np.array(rates), ROBOT.joint_speed, RAMP)
    assert np.abs(rates[-1]).max() == pytest.approx(ROBOT.joint_speed)
