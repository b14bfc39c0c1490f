"""Pins the compensations: servo model, leg momentum, lead, observer, ramp, and that none of them acts when off."""

import math
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from states import model, upright

from spidar_gym.control.compensation import (
    CompensationConfig,
    fresh_compensation,
    lead_forces,
    momentum_torque,
    observe_wrench,
    ramp_joints,
    servo_response,
)
from spidar_gym.control.controller import ControllerConfig
from spidar_gym.control.presets import PRESETS, controller_config
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.model.rotor import vectoring_to_force
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.so3 import exp

DT = 0.025
ZERO = np.zeros(3)


def snapshot(q=None, R_wb=None):
    q = FORMS["form2"] if q is None else q
    return model().snapshot(q, np.eye(3) if R_wb is None else R_wb, upright(q, np.eye(3)))


def test_the_servo_model_is_the_critically_damped_oscillator_that_it_says():
    rng = np.random.default_rng(0)
    for w in (8.0, 40.0, 120.0):
        q, v, u = rng.normal(size=(3, 16))

        def oscillator(t, y, u=u, w=w):
            return np.concatenate([y[16:], w * w * (u - y[:16]) - 2.0 * w * y[16:]])

        y = solve_ivp(oscillator, (0.0, DT), np.concatenate([q, v]), rtol=1e-10, atol=1e-12).y[:, -1]
        position, velocity = servo_response(q, v, u, bandwidth=w, dt=DT)
        np.testing.assert_allclose(position, y[:16], atol=1e-7)
        np.testing.assert_allclose(velocity, y[16:], atol=1e-6)


def test_the_feed_forward_torque_adds_up_to_the_change_of_the_legs_momentum():
    config, rng = CompensationConfig(momentum_gain=1.0, momentum_filter=0.0), np.random.default_rng(1)
    here, memory, total = snapshot(), fresh_compensation(FORMS["form2"], np.zeros(6)), np.zeros(3)
    for _ in range(10):
        memory = replace(memory, servo_velocity=rng.normal(size=16))
        torque, h = momentum_torque(here, memory, ZERO, config=config, dt=DT)
        if memory.momentum is None:
            first = h
        total += DT * torque
        memory = replace(memory, momentum=h, torque=torque)
    np.testing.assert_allclose(total, h - first, atol=1e-12)


def test_a_turning_torso_feels_the_legs_momentum_turn_with_it():
    config, omega = CompensationConfig(momentum_gain=1.0, momentum_filter=0.0), np.array([0.3, -0.2, 0.5])
    here, rates = snapshot(), np.random.default_rng(2).normal(size=16)
    h = here.momentum_map[3:] @ rates
    memory = replace(fresh_compensation(FORMS["form2"], np.zeros(6)), servo_velocity=rates, momentum=h)
    torque, _ = momentum_torque(here, memory, omega, config=config, dt=DT)
    np.testing.assert_allclose(torque, np.cross(omega, h), atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_led_force_points_where_it_should_once_the_links_have_turned(seed):
    rng, lead = np.random.default_rng(seed), 1e-4
    q, rates, omega = rng.uniform(-0.5, 1.0, 16), rng.normal(size=16), rng.normal(size=3)
    forces = vectoring_to_force(rng.uniform(5, 30, 8), rng.uniform(-1, 1, (8, 2)))
    now = model().snapshot(q, np.eye(3), np.zeros((8, 2)))
    led = lead_forces(forces, now, omega, rates, lead=lead)
    later = model().snapshot(q + lead * rates, np.eye(3), np.zeros((8, 2)))
    wanted = (now.R_bl @ forces[:, :, None])[:, :, 0]
    given = (exp(lead * omega) @ later.R_bl @ led[:, :, None])[:, :, 0]
    moved = np.abs((exp(lead * omega) @ later.R_bl @ forces[:, :, None])[:, :, 0] - wanted).max()
    assert np.abs(given - wanted).max() < 1e-3 * moved
    np.testing.assert_allclose(np.linalg.norm(led, axis=1), np.linalg.norm(forces, axis=1), rtol=1e-12)
    np.testing.assert_array_equal(lead_forces(forces, now, ZERO, np.zeros(16), lead=0.05), forces)


@pytest.mark.parametrize("truth", [np.array([6.0, -4.0, -15.0, 0.5, -0.8, 1.2]), np.zeros(6)])
def test_the_observer_finds_a_constant_wrench_on_a_rigid_body_with_its_time_constant(truth):
    config = CompensationConfig(observer_gain=1.0, observer_time=0.3, observer_lag=0.0)
    here = snapshot()
    memory, v, L, seen = fresh_compensation(FORMS["form2"], np.zeros(6)), np.zeros(3), np.zeros(3), []
    hover = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0])
    for _ in range(100):
        omega = np.linalg.solve(here.inertia_c, L)
        # Small angles: the body is taken to stay level while its momentum is followed.
        external, delivered, momentum = observe_wrench(
            here, memory, np.eye(3), omega, v, hover, config=config, dt=DT
        )  # fmt: skip
        memory = replace(memory, external_w=external, delivered_w=delivered, observed_momentum=momentum)
        v, L = v + DT * truth[:3] / here.mass, L + DT * truth[3:]
        seen.append(external)
    k = round(config.observer_time / DT)
    np.testing.assert_allclose(seen[k], (1.0 - math.exp(-1.0)) * truth, atol=0.02 * np.abs(truth).max() + 1e-12)
    np.testing.assert_allclose(seen[-1], truth, atol=1e-3 * np.abs(truth).max() + 1e-12)


def test_a_wrong_belief_does_not_take_over():
    config = CompensationConfig(observer_gain=1.0, observer_time=0.01)
    memory = replace(fresh_compensation(FORMS["form2"], np.zeros(6)), observed_momentum=np.zeros(6))
    external, _, _ = observe_wrench(
        snapshot(), memory, np.eye(3), np.full(3, 50.0), np.full(3, 50.0), np.zeros(6), config=config, dt=DT
    )
    assert np.all(np.abs(external) <= np.repeat([0.5 * ROBOT.weight, 10.0], 3))


@pytest.mark.parametrize(
    ("distance", "speed", "ramp"), [(1.0, 0.2, 0.4), (1.4, 1.0, 0.4), (0.05, 1.0, 0.4), (0.3, 0.2, 0.1)]
)
def test_ramped_joints_arrive_together_without_overshoot_and_within_speed_and_acceleration(distance, speed, ramp):
    start = np.zeros(16)
    target = np.random.default_rng(3).uniform(-1, 1, 16)
    target *= distance / np.abs(target).max()
    command, velocity, path = start, np.zeros(16), []
    for _ in range(round((distance / speed + 2.0 * ramp) / DT) + 3):
        following, next_velocity = ramp_joints(command, velocity, target, speed=speed, ramp=ramp, dt=DT)
        assert np.abs(next_velocity).max() <= speed * (1 + 1e-9)
        assert np.abs(next_velocity - velocity).max() <= speed / ramp * DT * (1 + 1e-6)
        command, velocity = following, next_velocity
        path.append(command)
    path = np.array(path)
    np.testing.assert_array_equal(path[-1], target)
    share = path @ target / (target @ target)
    assert np.all(np.diff(share) >= -1e-12)
    assert share.max() <= 1.0 + 1e-9
    np.testing.assert_allclose(path, share[:, None] * target, atol=1e-12)  # a straight line
    if distance > speed * ramp:
        arrival = DT * (1 + int(np.argmax(share > 1.0 - 1e-6)))
        assert abs(arrival - distance / speed - ramp) < 3 * DT


def test_a_target_that_changes_on_the_way_is_followed_within_the_acceleration():
    command, velocity, rng = np.zeros(16), np.zeros(16), np.random.default_rng(4)
    for _ in range(6):
        target = rng.uniform(-1, 1, 16)
        for _ in range(15):
            command, following = ramp_joints(command, velocity, target, speed=1.0, ramp=0.4, dt=DT)[0], velocity
            _, velocity = ramp_joints(command, velocity, target, speed=1.0, ramp=0.4, dt=DT)
            assert np.abs(velocity - following).max() <= DT / 0.4 * (1 + 1e-6)


def test_without_any_option_the_controller_is_the_papers_bit_for_bit():
    logs = []
    for config in (None, ControllerConfig(compensation=CompensationConfig(servo_bandwidth=9.0, observer_time=1.0))):
        env = gymnasium.make("spidar_gym/Hover-v0", forms="independent", joint_speed=1.0, controller=config)
        env.reset(seed=5)
        logs.append([env.step(np.zeros(6))[0] for _ in range(60)])
    np.testing.assert_array_equal(*logs)


@pytest.mark.parametrize("name", ["momentum_gain", "vectoring_lead", "observer_gain", "joint_ramp"])
def test_each_option_alone_changes_the_flight(name):
    tuned = controller_config("tuned").compensation
    logs = []
    for value in (0.0, getattr(tuned, name)):
        config = ControllerConfig(compensation=replace(CompensationConfig(), **{name: value}))
        env = gymnasium.make("spidar_gym/Hover-v0", forms="paper", joint_speed=1.0, controller=config)
        env.reset(seed=5)
        logs.append(np.array([env.step(np.zeros(6))[0] for _ in range(200)]))
    assert np.abs(logs[0] - logs[1]).max() > 1e-4


@pytest.mark.parametrize(
    ("name", "value"),
    [("momentum_gain", -1.0), ("joint_ramp", math.nan), ("servo_bandwidth", 0.0), ("observer_time", 0.0)],
)
def test_a_compensation_that_makes_no_sense_is_refused(name, value):
    with pytest.raises(InvalidValueError, match=name):
        CompensationConfig(**{name: value})


@pytest.mark.parametrize("preset", PRESETS)
def test_a_known_trim_is_in_the_first_demand_whatever_holds_it(preset):
    env = gymnasium.make("spidar_gym/Hover-v0", forms="form1", preset=preset, perturbation=0.0).unwrapped
    env.reset(seed=0)
    trim = np.array([1.0, -2.0, 8.0, 0.3, -0.2, 0.1])
    env.controller.reset(env.state, FORMS["form1"], trim)
    env.controller.step(env.state, env.reference())
    without = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0])
    first = env.controller.tick.wrench_desired
    np.testing.assert_allclose(first, without + trim, atol=0.05)


def test_an_unknown_preset_is_refused_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="paper, as_flown, tuned"):
        controller_config("best")
