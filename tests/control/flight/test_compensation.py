"""Pins the compensations' options and the lead of the vectoring: zeros have no effect, every option has one."""

import math
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from support.compensations import LEVEL, STILL, close
from support.states import model, resting, staying

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.control.flight.compensation import (
    CompensationConfig,
    fresh_compensation,
    lead_feedback,
    lead_forces,
    reference_wrench,
)
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError
from spidar_gym.so3 import exp, matrix_to_quat

FIELDS = tuple(name for name, value in vars(CompensationConfig()).items() if isinstance(value, float))


# ---- the lead of the vectoring ----


def lead_case(seed):
    rng = np.random.default_rng(seed)
    q, dq, omega = rng.uniform(-1.0, 1.0, 16), rng.uniform(-1.0, 1.0, 16), rng.uniform(-1.0, 1.0, 3)
    return q, dq, omega, rng.normal(scale=8.0, size=(8, 3))


def world(snapshot, R_wb, forces_l):
    return np.einsum("jk,ikl,il->ij", R_wb, snapshot.R_bl, forces_l)


def miss(seed, lead):
    """Angles [rad] between desired forces and forces `lead` seconds later, with and without lead."""
    q, dq, omega, forces = lead_case(seed)
    now, then = (model().snapshot(q + t * dq, np.eye(3), LEVEL) for t in (0.0, lead))
    wanted, R_wb = world(now, np.eye(3), forces), exp(lead * omega)

    def angles(forces_l):
        got = world(then, R_wb, forces_l)
        return np.arctan2(np.linalg.norm(np.cross(got, wanted), axis=1), (got * wanted).sum(axis=1))

    return angles(lead_forces(forces, now, omega, dq, lead=lead)), angles(forces)


@pytest.mark.parametrize("seed", range(6))
def test_a_led_force_points_where_it_should_once_its_link_has_turned(seed):
    """The compensation is of first order: the remaining error falls with the square of the lead."""
    led, unled = miss(seed, 0.04)
    assert led.max() < 0.002 < 0.015 < np.median(unled)
    closer, _ = miss(seed, 0.02)
    assert closer.max() < 0.3 * led.max()


def test_a_lead_turns_forces_and_keeps_their_size():
    q, dq, omega, forces = lead_case(20)
    led = lead_forces(forces, model().snapshot(q, np.eye(3), LEVEL), omega, dq, lead=0.1)
    close(np.linalg.norm(led, axis=1), np.linalg.norm(forces, axis=1), atol=1e-12)
    assert np.all(np.linalg.norm(led - forces, axis=1) > 0.01)


def test_no_lead_and_no_rates_leave_the_forces_alone():
    q, dq, omega, forces = lead_case(21)
    snapshot = model().snapshot(q, np.eye(3), LEVEL)
    np.testing.assert_array_equal(lead_forces(forces, snapshot, omega, dq, lead=0.0), forces)
    np.testing.assert_array_equal(lead_forces(forces, snapshot, STILL, np.zeros(16), lead=0.1), forces)


def test_a_joint_turns_the_forces_of_its_leg_from_its_link_on_and_no_others():
    q, _, _, forces = lead_case(22)
    snapshot = model().snapshot(q, np.eye(3), LEVEL)
    for joint in range(16):
        led = lead_forces(forces, snapshot, STILL, 1.0 * (np.arange(16) == joint), lead=0.05)
        inner = 2 * (joint // 4)
        expected = {inner, inner + 1} if joint % 4 < 2 else {inner + 1}
        assert set(np.flatnonzero(np.abs(led - forces).max(axis=1) > 1e-9).tolist()) == expected


# ---- the options ----


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_an_invalid_filter_is_refused_with_what_was_expected(name, value):
    with pytest.raises(InvalidValueError, match=rf"{name} = .* a number of at least 0"):
        CompensationConfig(**{name: value})


@pytest.mark.parametrize("name", FIELDS)
def test_zero_is_refused_where_it_would_divide_and_nowhere_else(name):
    if name in ("servo_bandwidth", "observer_time", "lead_time"):
        with pytest.raises(InvalidValueError, match=rf"{name} = 0.0 .* a number above 0"):
            CompensationConfig(**{name: 0.0})
    else:
        assert getattr(CompensationConfig(**{name: 0.0}), name) == 0.0


@pytest.mark.parametrize("order", [0, 3, -1])
def test_an_observer_of_no_such_order_is_refused(order):
    with pytest.raises(InvalidValueError, match=r"observer_order = .* 1 or 2"):
        CompensationConfig(observer_order=order)


def flown(controller, ticks=30):
    """States of a short flight through other forms, all numbers of a tick in a row."""
    env = gymnasium.make(
        "spidar_gym/Hover-v0", forms="independent", controller=controller, joint_speed=0.6, disable_env_checker=True
    )
    env.reset(seed=3)
    rows = []
    for _ in range(ticks):
        env.step(np.zeros(env.action_space.shape))
        state, memory = env.unwrapped.state, env.unwrapped.controller.memory
        rows.append(
            np.concatenate(
                [
                    state.position_w,
                    state.omega_b,
                    state.joint_position,
                    memory.vectoring.ravel(),
                    memory.forces_l.ravel(),
                ]
            )
        )
    env.close()
    return np.array(rows)


def test_with_all_options_off_their_time_constants_change_no_bit_of_the_papers_flight():
    filters = CompensationConfig(momentum_filter=0.07, servo_bandwidth=15.0, observer_time=0.1, observer_lag=0.0)
    np.testing.assert_array_equal(flown(ControllerConfig()), flown(ControllerConfig(compensation=filters)))


@pytest.mark.parametrize("option", ["momentum_gain", "vectoring_lead", "observer_gain", "joint_ramp", "lead_gain"])
def test_every_option_changes_a_flight(option):
    config = ControllerConfig(compensation=CompensationConfig(**{option: 0.05}))
    # The first form is held for a second, so that joints move from the fortieth tick on.
    difference = np.abs(flown(config, 120) - flown(ControllerConfig(), 120)).max()
    assert 1e-6 < difference < 3.0


@pytest.mark.parametrize(
    "option",
    [
        {"torque_observer_gain": 0.4}, {"torque_observer_time": 0.4}, {"torque_observer_lag": 0.4},
        {"observer_beyond": True},
    ],
)  # fmt: skip
def test_what_belongs_to_another_option_changes_a_flight_with_it_and_none_without(option):
    for base, changed in ((controller_config("tuned"), True), (ControllerConfig(), False)):
        config = replace(base, compensation=replace(base.compensation, **option))
        difference = np.abs(flown(config, 120) - flown(base, 120)).max()
        assert (1e-6 < difference < 3.0) if changed else difference == 0.0


# ---- a lead compensator in the feedback ----


def test_what_lasts_passes_the_lead_as_it_is_and_a_step_is_enlarged_at_first():
    config = CompensationConfig(lead_gain=0.5, lead_time=0.1)
    memory, R_wb = fresh_compensation(np.zeros(16), np.zeros(6)), exp(np.array([0.4, -0.2, 0.9]))
    step, added = np.array([3.0, -2.0, 1.0, 0.3, 0.2, -0.1]), []
    # The first tick initialises the filter: its demand is no step.
    memory, more = lead_feedback(memory, -step, R_wb, config=config, dt=0.025)
    close(more, np.zeros(6), atol=0.0)
    step = 2.0 * step
    for _ in range(60):
        memory, more = lead_feedback(memory, 0.5 * step, R_wb, config=config, dt=0.025)
        added.append(more)
    fades = np.exp(-0.25 * np.arange(1, 61))[:, None]
    close(np.array(added), 0.5 * fades * step)


def test_the_lead_is_that_of_world_axes():
    """A force that is constant in world axes is not enlarged while the robot turns."""
    config = CompensationConfig(lead_gain=0.5, lead_time=0.1)
    memory, force = fresh_compensation(np.zeros(16), np.zeros(6)), np.array([3.0, -2.0, 1.0])
    for k in range(80):
        R_wb = exp(0.02 * k * np.array([0.3, 0.5, 0.8]))
        asked = np.concatenate((force @ R_wb, np.zeros(3)))
        memory, more = lead_feedback(memory, asked, R_wb, config=config, dt=0.025)
    close(more, np.zeros(6), atol=1e-7)


# ---- a reference that accelerates ----


def wrench_of(gain, **changes):
    """Desired wrench and control state of the first tick of a rotated robot on its reference."""
    rng = np.random.default_rng(4)
    R_wb = exp(np.array([0.1, -0.2, 0.7]))
    state = resting(rng.uniform(-0.4, 0.4, 16), R_wb)
    controller = FlightController(ControllerConfig(compensation=CompensationConfig(reference_gain=gain)), model())
    controller.reset(state)
    controller.step(state, staying(state, quat_wb=state.quat_wb, **changes))
    return controller.last_step.wrench_desired, controller.last_step.control_state


def test_an_accelerating_reference_adds_the_wrench_of_its_acceleration():
    """m r̈ and I ω̇, independent of the axes in which they are expressed."""
    a, alpha, turned = np.array([0.7, -0.4, 0.2]), np.array([0.3, 0.1, -0.8]), exp(np.array([0.0, 0.0, 1.1]))
    still, control = wrench_of(1.0)
    moved, _ = wrench_of(1.0, acceleration_w=a, alpha_b=alpha)
    s, R_wb = control.snapshot, control.R_wb
    close(R_wb @ (moved - still)[:3], s.mass * a)
    close(np.linalg.solve(s.inertia_c, (moved - still)[3:]), alpha)  # the reference's attitude is the robot's
    close(wrench_of(0.4, acceleration_w=a, alpha_b=alpha)[0] - still, 0.4 * (moved - still))
    close(wrench_of(0.0, acceleration_w=a, alpha_b=alpha)[0], still)
    # A reference with another attitude has its angular acceleration in its own axes.
    quat = matrix_to_quat(turned)
    other = reference_wrench(s, R_wb, replace(staying(resting(np.zeros(16))), quat_wb=quat, alpha_b=alpha))
    close(R_wb @ np.linalg.solve(s.inertia_c, other[3:]), turned @ alpha)


@pytest.mark.parametrize("kind", ["acceleration_w", "alpha_b"])
def test_a_reference_that_is_not_finite_is_answered_with_the_last_command(kind):
    state = resting(np.zeros(16))
    controller = FlightController(controller_config("tuned"), model())
    controller.reset(state)
    before = controller.step(state, staying(state))
    held = controller.step(state, staying(state, **{kind: np.array([0.0, np.nan, 0.0])}))
    close(held.thrust, before.thrust)
    assert controller.last_step.allocation.status == AllocationStatus.HELD
