"""Pins the observed motion: momentum of the whole robot, external wrench, prediction over the commands' delay."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.states import model, resting, staying

from spidar_gym.benchmark.evaluate import play
from spidar_gym.control.flight import motion
from spidar_gym.control.flight.centroidal import MotionError
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.control.flight.motion import (
    BEND_TIME,
    COMMAND_DELAY,
    LEAST_SHARE,
    MOMENTUM_TIME,
    RINGING,
    RINGING_TIME,
    ROTOR_LAG,
    Bending,
    fresh_motion,
    observe_motion,
    unbend,
    whole_motion,
)
from spidar_gym.control.presets import STEADY
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.policies.presets import OwnController
from spidar_gym.robot import GRAVITY
from spidar_gym.studies import flights

HOVER = resting(np.zeros(16))
DT = 0.025
OBSERVED = replace(ControllerConfig(), motion="observed")


def first_error(state, config=OBSERVED):
    """Return the errors that a controller feeds back in its first tick."""
    controller = FlightController(config, model())
    controller.reset(HOVER)
    controller.step(state, staying(HOVER))
    return controller.last_step.control_state.error


def test_a_torso_that_turns_against_its_legs_without_angular_momentum_does_not_turn_the_robot():
    rng = np.random.default_rng(1)
    snapshot = model().snapshot(HOVER.joint_position, np.eye(3), HOVER.vectoring)
    I, H = snapshot.inertia_c, snapshot.momentum_map[3:]
    for _ in range(5):
        rate = rng.normal(size=16)
        omega = -np.linalg.solve(I, H @ rate)
        against = first_error(replace(HOVER, omega_b=omega, joint_velocity=rate))
        torso = first_error(replace(HOVER, omega_b=omega, joint_velocity=rate), ControllerConfig())
        still = first_error(HOVER)
        np.testing.assert_allclose(against.omega_b, still.omega_b, rtol=0, atol=1e-12)
        assert np.abs(torso.omega_b - still.omega_b).max() > 0.1


def test_legs_that_move_as_planned_are_no_bending_and_a_lasting_deviation_is_sag():
    memory, rate = fresh_motion(), np.full(16, 0.2)
    for k in range(200):
        plan = HOVER.joint_position + k * DT * rate
        state = replace(HOVER, joint_position=plan - 0.01, joint_velocity=rate)
        memory, unbent, bending = unbend(memory, state, plan, dt=DT)
    np.testing.assert_allclose(bending.angle, 0.0, atol=1e-12)
    np.testing.assert_allclose(bending.rate, 0.0, atol=1e-9)
    np.testing.assert_allclose(bending.planned, rate, atol=1e-9)
    np.testing.assert_allclose(unbent.joint_position, state.joint_position, atol=1e-12)
    # A step of the deviation counts as bending first, and fades with the high-pass.
    jumped, seen = replace(state, joint_position=state.joint_position + 0.02), []
    for _ in range(5):
        memory, _, bending = unbend(memory, jumped, plan, dt=DT)
        seen.append(bending.angle[0])
    np.testing.assert_allclose(seen, 0.02 * np.exp(-DT / BEND_TIME) ** np.arange(1, 6), rtol=1e-9)


def rigid(thrusts, external, ticks):
    """Simulate the observer on a rigid robot whose rotors have the model's delay and lag; returns p, p̂, its prediction,
    ŵ and p at the predicted time, of z (k, 5) [Ns], [N].

    Args:
        thrusts: Function of the tick → factor on the hover's thrusts.
        external: Force upwards [N].
        ticks: Number of ticks.
    """
    steps = 100
    h = DT / steps
    snapshot = model().snapshot(HOVER.joint_position, np.eye(3), HOVER.vectoring)
    Q = thrust_map(snapshot.R_bl, snapshot.rotor_c)
    per_thrust = (Q @ vectoring_to_force(HOVER.thrust, HOVER.vectoring).reshape(-1))[2]
    memory, momentum = fresh_motion(), 0.0
    memory = replace(memory, sag=np.zeros(16))
    thrust, commands, late = 1.0, [1.0] * (4 * steps), round(COMMAND_DELAY / h)
    found, asked = [], 1.0
    for k in range(ticks):
        velocity = np.array([0.0, 0.0, momentum / snapshot.mass])
        _, state, bending = unbend(memory, HOVER, HOVER.joint_position, dt=DT)
        allocated = None if k == 0 else np.array([0.0, 0.0, asked * per_thrust, 0.0, 0.0, 0.0])
        memory, predicted = observe_motion(
            memory, state, bending, snapshot, np.eye(3), velocity_w=velocity, thrust_map=Q,
            thrust=asked * HOVER.thrust, allocated=allocated, dt=DT,
        )  # fmt: skip
        found.append([momentum, memory.momentum_w[2], predicted[2], memory.external_w[2]])
        asked = thrusts(k)
        for j in range(steps):
            if k > 0 and j == late - steps:  # COMMAND_DELAY after the tick before
                found[k - 1].append(momentum)
            commands.append(asked)
            thrust += h / ROTOR_LAG * (commands[-1 - late] - thrust)
            momentum += h * (thrust * per_thrust - snapshot.mass * GRAVITY + external)
    return np.array(found[:-1])


def test_the_observer_finds_a_constant_force_and_its_momentum_is_the_true_one():
    found = rigid(lambda _: 1.0, 5.0, 100)
    momentum, observed, _, force, _ = found[-1]
    assert force == pytest.approx(5.0, rel=1e-3)
    assert observed == pytest.approx(momentum, rel=1e-3)
    # Both poles at −1/T: after time t the share (1 + t/T) e^(−t/T) is missing, up to the sampling.
    k = round(2.0 * MOMENTUM_TIME / DT)
    assert found[k, 3] == pytest.approx(5.0 * (1.0 - 3.0 * np.exp(-2.0)), abs=0.4)


def test_the_prediction_is_the_momentum_at_the_time_when_the_next_command_acts():
    found = rigid(lambda k: 1.0 + 0.05 * np.sin(0.1 * k), 0.0, 400)
    momentum, observed, predicted, _, then = found[20:].T

    def rms(error):
        return float(np.sqrt(np.mean(error**2)))

    assert rms(predicted - then) < 0.06 * rms(momentum - then)
    assert rms(observed - momentum) < 0.05 * rms(momentum - then)


def test_while_legs_ring_less_of_the_attitude_and_all_of_the_position_is_fed_back():
    ones = np.ones(3)
    error = MotionError(position_w=ones, velocity_w=ones, attitude=ones, omega_b=ones)
    snapshot = model().snapshot(HOVER.joint_position, np.eye(3), HOVER.vectoring)

    def fed_back(rate):
        state = replace(HOVER, joint_velocity=np.where(np.arange(16) == 5, rate, 0.0))
        memory, unbent, _ = unbend(replace(fresh_motion(), sag=np.zeros(16)), state, HOVER.joint_position, dt=DT)
        straight = Bending(np.zeros(16), np.zeros(16), np.zeros(16))
        found, _ = whole_motion(
            memory, error, np.zeros(6), unbent, straight, snapshot, np.eye(3), velocity_w=np.zeros(3)
        )
        return memory, found

    _, still = fed_back(0.0)
    for rate, share in ((0.9 * RINGING, 1.0), (2.0 * RINGING, 0.25), (-2.0 * RINGING, 0.25), (9.0, LEAST_SHARE)):
        _, found = fed_back(rate)
        np.testing.assert_allclose(found.attitude, share * still.attitude)
        np.testing.assert_allclose(found.omega_b, share * still.omega_b)
        np.testing.assert_array_equal(found.position_w, still.position_w)
        np.testing.assert_array_equal(found.velocity_w, still.velocity_w)
    # The largest rate of the joints counts and fades.
    memory, _ = fed_back(1.0)
    for _ in range(round(RINGING_TIME / DT)):
        memory, *_ = unbend(memory, replace(HOVER, joint_velocity=np.zeros(16)), HOVER.joint_position, dt=DT)
    assert memory.ringing == pytest.approx(math.exp(-1.0))


@pytest.mark.parametrize(("share", "falls"), [(LEAST_SHARE, False), (1.0, True)])
def test_legs_that_ring_throw_a_badly_damped_robot_over_without_the_limit(share, falls, monkeypatch):
    """The robot of the study `flights` that fell first, in forms of independent legs at 0.6 rad/s."""
    monkeypatch.setattr(motion, "LEAST_SHARE", share)
    scenario = flights.draw(0.6, 95)
    (played,) = play(OwnController({"preset": "steady"}), flights.TRACK, [scenario], control="python")
    assert played["metrics"]["failed"] == falls


def test_on_the_floor_the_measured_motion_is_fed_back():
    controller = FlightController(STEADY, model())
    controller.reset(HOVER)
    state = replace(HOVER, omega_b=np.array([0.1, 0.0, 0.0]), joint_velocity=np.full(16, 0.3))
    for support in (0.0, 0.5):
        controller.step(state, replace(staying(HOVER), support=support))
    whole = FlightController(replace(STEADY, motion="complete"), model()).compute_state(state, staying(HOVER)).error
    np.testing.assert_array_equal(controller.last_step.control_state.error.omega_b, whole.omega_b)
    assert controller.memory.motion.sag is None
