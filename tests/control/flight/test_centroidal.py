"""Pins the centroidal control: hand cases of both PIDs, gravity, gyroscopic term, clips, anti-windup, convergence."""

from dataclasses import replace

import numpy as np
import pytest
from support.states import model, random_pose, upright

from spidar_gym.control.flight.centroidal import CentroidalConfig, Integrals, MotionError, desired_wrench, integrate
from spidar_gym.robot import FORMS, GRAVITY, ROBOT
from spidar_gym.so3 import exp, vee

ZERO = np.zeros(3)
NO_ERROR = MotionError(ZERO, ZERO, ZERO, ZERO)
NO_INTEGRALS = Integrals(ZERO, ZERO)
SNAPSHOT = model().snapshot(FORMS["form2"], np.eye(3), upright(FORMS["form2"], np.eye(3)))
I = SNAPSHOT.inertia_c
GAINS = CentroidalConfig(
    position_gains=((2.0, 0.5, 3.0), (4.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    attitude_gains=((10.0, 1.0, 2.0), (8.0, 0.0, 0.0), (0.0, 0.0, 4.0)),
)


def wrench_of(R_wb=None, omega_b=ZERO, config=None, integral=ZERO, attitude_integral=ZERO, rate=ZERO, **errors):
    """Desired wrench of a level state at rest without errors, except for the arguments; `rate` is e_ω."""
    R_wb, integrals = np.eye(3) if R_wb is None else R_wb, Integrals(integral, attitude_integral)
    error = replace(NO_ERROR, omega_b=rate, **errors)
    return desired_wrench(SNAPSHOT, R_wb, omega_b, error, integrals, config=config or CentroidalConfig())


def test_at_rest_the_force_carries_the_weight_straight_up_however_the_torso_is_tilted():
    rng = np.random.default_rng(0)
    for _ in range(20):
        R_wb = exp(rng.uniform(-1.5, 1.5, 3))
        wrench = wrench_of(R_wb)
        np.testing.assert_allclose(R_wb @ wrench[:3], [0.0, 0.0, 16.0 * 9.81], atol=1e-9)
        np.testing.assert_array_equal(wrench[3:], ZERO)


def test_gyroscopic_torque_keeps_the_angular_velocity_of_the_torso_and_does_no_work():
    rng = np.random.default_rng(1)
    for _ in range(20):
        omega_b = rng.uniform(-3.0, 3.0, 3)
        torque = wrench_of(omega_b=omega_b)[3:]
        assert abs(torque @ omega_b) < 1e-9
        acceleration = np.linalg.solve(I, torque - np.cross(omega_b, I @ omega_b))
        np.testing.assert_allclose(acceleration, ZERO, atol=1e-12)
        assert np.linalg.norm(torque) > 1e-3


def test_position_terms_add_up_to_the_acceleration_by_hand():
    wrench = wrench_of(
        config=GAINS,
        position_w=np.array([0.1, -0.2, 5.0]),
        velocity_w=np.array([-0.05, 7.0, 0.5]),
        integral=np.array([0.4, 9.0, 9.0]),
    )
    # x: 2·0.1 + 0.5·0.4 − 3·0.05 = 0.25; y: 4·(−0.2) = −0.8; z: 1·0.5 + 9.81
    np.testing.assert_allclose(wrench, [16.0 * 0.25, 16.0 * -0.8, 16.0 * 10.31, 0.0, 0.0, 0.0], atol=1e-9)


def test_attitude_terms_add_up_to_the_angular_acceleration_by_hand():
    wrench = wrench_of(
        config=GAINS,
        attitude=np.array([0.1, -0.2, 0.3]),
        rate=np.array([-0.25, 5.0, 0.1]),
        attitude_integral=np.array([0.5, 9.0, 9.0]),
    )
    # about x: 10·0.1 + 1·0.5 − 2·0.25 = 1; about y: 8·(−0.2) = −1.6; about z: 4·0.1
    np.testing.assert_allclose(np.linalg.solve(I, wrench[3:]), [1.0, -1.6, 0.4], atol=1e-12)


def test_the_force_of_an_error_points_along_it_in_the_world_whatever_the_attitude():
    config = CentroidalConfig(position_gains=((3.0, 0.0, 0.0),) * 3)
    rng = np.random.default_rng(2)
    for _ in range(10):
        _, R_wb = random_pose(rng)
        position_w = rng.uniform(-0.5, 0.5, 3)
        force_w = R_wb @ wrench_of(R_wb, config=config, position_w=position_w)[:3] - [0.0, 0.0, ROBOT.weight]
        np.testing.assert_allclose(force_w, 48.0 * position_w, atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_huge_errors_are_clipped_error_by_error_term_by_term_and_in_the_sum(sign):
    huge, config = sign * np.full(3, 1e6), CentroidalConfig()
    lift = np.array([0.0, 0.0, GRAVITY])
    # Error of z clipped to 1 m before k_p = 2.8; the terms of x and y clipped to 10, k_d ė of z to 20.
    for name, acceleration in (
        ("position_w", (10.0, 10.0, 2.8)),
        ("velocity_w", (10.0, 10.0, 20.0)),
        ("integral", (10.0, 10.0, 20.0)),
    ):
        force = wrench_of(config=config, **{name: huge})[:3]
        np.testing.assert_allclose(force / 16.0 - lift, sign * np.array(acceleration), rtol=1e-9)
    # All of them: 2.8 + 20 + 20 is clipped to 28.
    force = wrench_of(config=config, position_w=huge, velocity_w=huge, integral=huge)[:3]
    np.testing.assert_allclose(force / 16.0 - lift, sign * np.array([10.0, 10.0, 28.0]), rtol=1e-9)
    # Attitude: error of z clipped to 0.4 before k_p = 10; every term and the sum to 10.
    for errors, acceleration in (
        ({"attitude": huge}, (10.0, 10.0, 4.0)),
        ({"rate": huge}, (10.0, 10.0, 10.0)),
        ({"attitude_integral": huge}, (10.0, 10.0, 10.0)),
        ({"attitude": huge, "rate": huge, "attitude_integral": huge}, (10.0, 10.0, 10.0)),
    ):
        torque = wrench_of(config=config, **errors)[3:]
        np.testing.assert_allclose(np.linalg.solve(I, torque), sign * np.array(acceleration), rtol=1e-9)


def test_an_axis_is_frozen_only_when_its_missing_demand_and_its_error_push_the_same_way():
    start = Integrals(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]))
    for error, missing, moves in (
        (0.5, 20.0, False),
        (-0.5, -20.0, False),
        (0.5, -20.0, True),
        (-0.5, 20.0, True),
        (0.5, 1e-3, True),
        (-0.5, 0.0, True),
    ):
        for axis in np.eye(3):
            # The other axes have errors too, and no missing demand.
            errors = MotionError(np.full(3, error), ZERO, np.full(3, error), ZERO)
            after = integrate(start, errors, missing * axis, missing * axis, dt=0.1)
            step = np.where((axis == 1.0) & (not moves), 0.0, 0.1 * error)
            np.testing.assert_allclose(after.position_w, start.position_w + step, atol=1e-15)
            np.testing.assert_allclose(after.attitude, start.attitude + step, atol=1e-15)


def fly(seconds, *, push_w=ZERO, turn_b=ZERO, config=None, rate=40.0):
    """Final |errors| of a rigid body of the robot's mass and inertia under a constant push, from 0.3 m and 0.3 rad."""
    config, dt = config or CentroidalConfig(), 1.0 / rate
    R, p, v, omega = exp(np.array([0.3, -0.2, 0.3])), np.array([0.3, -0.3, 0.3]), ZERO, ZERO
    integrals = NO_INTEGRALS
    for _ in range(int(seconds * rate)):
        error = MotionError(-p, -v, vee(R.T), -omega)
        integrals = integrate(integrals, error, ZERO, ZERO, dt=dt)
        wrench = desired_wrench(SNAPSHOT, R, omega, error, integrals, config=config)
        omega = omega + dt * np.linalg.solve(I, wrench[3:] + turn_b - np.cross(omega, I @ omega))
        v = v + dt * ((R @ wrench[:3] + push_w) / 16.0 - [0.0, 0.0, GRAVITY])
        p, R = p + dt * v, R @ exp(dt * omega)
    return np.abs(p), np.abs(vee(R))


def test_a_rigid_body_comes_back_from_an_offset():
    position, attitude = fly(15.0)
    assert position.max() < 0.01
    assert attitude.max() < 0.01


def test_a_steady_push_leaves_no_steady_error():
    config = CentroidalConfig(position_gains=((3.6, 1.0, 4.0),) * 3, attitude_gains=((15.0, 5.0, 5.0),) * 3)
    push_w, turn_b = np.array([5.0, -5.0, -16.0]), np.array([1.0, -1.0, 0.5])
    position, attitude = fly(20.0, push_w=push_w, turn_b=turn_b, config=config)
    assert position.max() < 1e-3
    assert attitude.max() < 1e-3


def test_the_flown_gains_make_up_for_a_missing_tenth_of_the_lift():
    assert fly(15.0, push_w=np.array([0.0, 0.0, -16.0]))[0][2] < 1e-3
