"""Pins the observer of external wrenches: estimate, time constant, bounds, and no response to modelled effects."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.compensations import DT, LEVEL, STILL, close
from support.states import model, resting, staying

from spidar_gym.control.flight.compensation import (
    CompensationConfig,
    fresh_compensation,
    observe_wrench,
    weight_wrench,
)
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, GRAVITY, ROBOT
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.so3 import exp

BOUND = np.repeat([0.5 * ROBOT.weight, 10.0], 3)
"""Bound of the estimated wrench [N, Nm]."""


# ---- the observer ----


def observed(wrench, config, seconds, external=None, R_start=None):
    """Estimates of every tick for a rigid robot in form 2, carried by its rotors, under `wrench` (world)."""
    R = np.eye(3) if R_start is None else R_start
    snapshot, steps = model().snapshot(FORMS["form2"], R, LEVEL), 20
    memory = fresh_compensation(FORMS["form2"], np.zeros(6) if external is None else external)
    weight = np.array([0.0, 0.0, snapshot.mass * GRAVITY, 0.0, 0.0, 0.0])
    memory = replace(memory, fed_w=weight, delivered_w=0.0 * weight if config.observer_beyond else weight)
    L, velocity, estimates = np.zeros(3), np.zeros(3), []
    for _ in range(round(seconds / DT)):
        allocated = np.concatenate([R.T @ weight[:3], np.zeros(3)])
        omega = np.linalg.solve(snapshot.inertia_c, R.T @ L)
        memory = observe_wrench(snapshot, memory, R, omega, velocity.copy(), allocated, config=config, dt=DT)
        estimates.append(memory.external_w)
        for _ in range(steps):
            R = R @ exp(DT / steps * np.linalg.solve(snapshot.inertia_c, R.T @ L))
            L = L + DT / steps * wrench[3:]
        velocity = velocity + DT / snapshot.mass * wrench[:3]
    return np.array(estimates)


WRENCH = np.array([3.0, -2.0, 4.0, 0.4, -0.3, 0.5])
OBSERVER = CompensationConfig(observer_gain=1.0, observer_time=0.2)


@pytest.mark.parametrize("beyond", [False, True])
@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_the_observer_finds_a_constant_wrench_on_a_rigid_robot_whatever_its_attitude(turned, beyond):
    R_start = exp(turned * np.array([0.6, -0.8, 0.3]))
    estimate = observed(WRENCH, replace(OBSERVER, observer_beyond=beyond), 1.0 + DT, R_start=R_start)[-1]
    close(estimate, WRENCH * (1.0 - math.exp(-5.0)), atol=2e-3)


def test_the_observer_converges_with_its_time_constant():
    for time in (0.1, 0.4):
        estimates = observed(WRENCH, replace(OBSERVER, observer_time=time), 0.5)
        # The first tick initialises the observer.
        passed = DT * np.arange(len(estimates))
        close(estimates / WRENCH, np.tile(1.0 - np.exp(-passed / time), (6, 1)).T, atol=2e-3)


def test_the_torque_observer_has_a_separate_time_constant():
    estimates = observed(WRENCH, replace(OBSERVER, observer_time=0.1, torque_observer_time=0.4), 0.5)
    passed = DT * np.arange(len(estimates))[:, None]
    expected = 1.0 - np.exp(-passed / np.repeat([0.1, 0.4], 3))
    close(estimates / WRENCH, expected, atol=2e-3)


def test_without_an_external_wrench_the_estimate_stays_zero_or_decays():
    close(observed(np.zeros(6), OBSERVER, 1.0), np.zeros((40, 6)), atol=1e-9)
    forgotten = observed(np.zeros(6), OBSERVER, 1.0 + DT, external=WRENCH)
    close(forgotten[0], WRENCH, atol=0.0)
    close(forgotten[-1], math.exp(-5.0) * WRENCH, atol=1e-9)


def test_the_estimate_is_bounded_by_half_the_weight_and_ten_newton_metres():
    for sign in (1.0, -1.0):
        wrench = sign * np.array([200.0, 100.0, 300.0, 15.0, 20.0, 30.0])
        estimates = observed(wrench, replace(OBSERVER, observer_time=0.05), 0.3)
        close(estimates[-1], sign * BOUND, atol=0.0)
        assert np.all(np.abs(estimates) <= BOUND)


def test_two_low_passes_are_the_extended_state_observer_of_a_velocity():
    """Gao's observer: ẑ₁' = ẑ₂ + u + 2ω (v − ẑ₁), ẑ₂' = ω² (v − ẑ₁), with the external wrench as the only input."""
    time, seconds = 0.6, 2.0
    estimates = observed(WRENCH, replace(OBSERVER, observer_time=time, observer_order=2), seconds)
    fine, omega, v, z1, z2, eso = 2000, 1.0 / time, 0.0, 0.0, 0.0, []
    for k in range(round(seconds * fine)):
        if k % (fine // 40) == 0:
            eso.append(z2)
        v += 1.0 / fine
        z1, z2 = z1 + (z2 + 2.0 * omega * (v - z1)) / fine, z2 + omega * omega * (v - z1) / fine
    # A held estimate is half a tick old on average.
    close(estimates[:-1] / WRENCH, np.tile(0.5 * (np.array(eso[:-1]) + eso[1:]), (6, 1)).T, atol=0.012)


@pytest.mark.parametrize("order", [1, 2])
def test_cancelled_whole_it_is_incremental_inversion(order):
    """w = H w₀ + M (a − H ȧ): w₀ the lagged rotor wrench, ȧ measured, H the filter of both [Smeur2016]."""
    config = CompensationConfig(observer_gain=1.0, observer_time=0.09, observer_lag=0.05, observer_order=order)
    snapshot, rng = model().snapshot(FORMS["form1"], np.eye(3), LEVEL), np.random.default_rng(3)
    M = np.zeros((6, 6))
    M[:3, :3], M[3:, 3:] = snapshot.mass * np.eye(3), snapshot.inertia_c
    weight = np.array([0.0, 0.0, snapshot.mass * GRAVITY, 0.0, 0.0, 0.0])
    share, lag = 1.0 - math.exp(-DT / config.observer_time), 1.0 - math.exp(-DT / config.observer_lag)
    given, v = weight.copy(), np.zeros(6)
    # Filter states of the rotor wrench and of the measured acceleration.
    H = {"given": [weight, weight], "measured": [np.zeros(6), np.zeros(6)]}
    memory = fresh_compensation(FORMS["form1"], np.zeros(6))
    memory = observe_wrench(snapshot, memory, np.eye(3), v[3:], v[:3], weight, config=config, dt=DT)
    for _ in range(50):
        asked, measured, wanted = weight + rng.normal(size=6), 0.1 * rng.normal(size=6), rng.normal(size=6)
        v = v + DT * measured
        given = given + lag * (asked - given)
        for name, value in (("given", given), ("measured", measured)):
            first = H[name][0] + share * (value - H[name][0])
            H[name] = [first, H[name][1] + share * ((first if order == 2 else value) - H[name][1])]
        memory = observe_wrench(snapshot, memory, np.eye(3), v[3:], v[:3], asked, config=config, dt=DT)
        inversion = H["given"][1] + M @ (wanted - H["measured"][1])
        close(M @ wanted + weight - memory.external_w, inversion, atol=1e-9)


def false_force(real_lag):
    """Largest spurious force estimate after a step of 20 N in lift with `real_lag`; the observer assumes 0.1 s."""
    snapshot = model().snapshot(FORMS["form1"], np.eye(3), LEVEL)
    config = CompensationConfig(observer_gain=1.0, observer_time=0.1, observer_lag=0.1)
    weight = np.array([0.0, 0.0, snapshot.mass * GRAVITY, 0.0, 0.0, 0.0])
    memory = replace(fresh_compensation(FORMS["form1"], np.zeros(6)), delivered_w=weight)
    velocity, extra, worst = 0.0, 0.0, 0.0
    for k in range(40):
        asked = weight + np.array([0.0, 0.0, 20.0 * (k >= 1), 0.0, 0.0, 0.0])
        extra += (1.0 - math.exp(-DT / real_lag)) * (asked[2] - weight[2] - extra)
        velocity += DT * extra / snapshot.mass
        velocity_w = np.array([0.0, 0.0, velocity])
        memory = observe_wrench(snapshot, memory, np.eye(3), STILL, velocity_w, asked, config=config, dt=DT)
        worst = max(worst, np.abs(memory.external_w).max())
    return worst


def test_rotors_with_the_modelled_lag_cause_no_estimate():
    assert false_force(0.1) < 1e-9
    assert false_force(0.4) > 3.0


def test_the_fed_forward_wrench_balances_weight_and_gyroscopic_torque():
    """Compared with finite differences of the momentum in world axes."""
    h, omega, start = 1e-5, np.array([0.7, -0.4, 0.9]), exp(np.array([0.3, 0.2, -0.5]))
    snapshot = model().snapshot(FORMS["form2"], start, LEVEL)
    later, before = (start @ exp(t * omega) @ snapshot.inertia_c @ omega for t in (h, -h))
    wrench = weight_wrench(snapshot, start, omega, omega)
    close(start @ wrench[:3], np.array([0.0, 0.0, snapshot.mass * GRAVITY]))
    close(start @ wrench[3:], (later - before) / (2.0 * h), atol=1e-6)
    assert np.linalg.norm(wrench[3:]) > 0.1
    close(weight_wrench(snapshot, start, omega, STILL)[3:], STILL)


def false_torque(beyond):
    """Largest spurious estimate of an observer that assumes slow rotors, when legs' torque is compensated at once."""
    q, config = FORMS["form2"], replace(OBSERVER, observer_lag=0.3, observer_beyond=beyond)
    snapshot, dq = model().snapshot(q, np.eye(3), LEVEL), np.linspace(-1.0, 1.0, 16)
    weight = np.array([0.0, 0.0, snapshot.mass * GRAVITY, 0.0, 0.0, 0.0])
    memory, h, worst = replace(fresh_compensation(q, np.zeros(6)), fed_w=weight), np.zeros(3), 0.0
    allocated = weight
    for k in range(80):
        memory = replace(memory, servo_velocity=math.sin(0.1 * k) * dq)
        before, h = h, snapshot.momentum_map[3:] @ memory.servo_velocity
        # The torque equals the change of the legs' momentum, so the torso stays at rest.
        fed = allocated = weight + np.concatenate((np.zeros(3), (h - before) / DT))
        memory = replace(memory, fed_w=fed)
        memory = observe_wrench(snapshot, memory, np.eye(3), STILL, STILL, allocated, config=config, dt=DT)
        worst = max(worst, np.abs(memory.external_w).max())
    return worst


def test_the_fed_forward_wrench_is_no_disturbance_for_any_rotor_lag_of_the_observer():
    assert false_torque(beyond=False) > 0.3
    assert false_torque(beyond=True) < 1e-12


def test_the_observer_of_a_simulated_flight_finds_a_pull_and_cancels_its_share():
    """A constant force and torque on the torso of a hovering robot without air."""
    plant, config = Plant(PlantConfig(aero=AeroConfig(wake=False))), controller_config("tuned")
    controller, q = FlightController(config, model()), FORMS["form2"]
    rest = resting(q, vectoring=controller.rest_vectoring(q))
    state = plant.reset(np.array([0.0, 0.0, 5.0]), rest.quat_wb, q, rest.vectoring, rest.thrust)
    controller.reset(state)
    reference, torso = staying(state), plant.model.body("torso").id
    for pull in (np.zeros(6), np.array([4.0, -3.0, 5.0, 0.3, -0.4, 0.2])):
        plant.data.xfrc_applied[torso] = pull
        for _ in range(160):
            state = plant.step(controller.step(state, reference))
        # A force on the torso acts away from the CoG and therefore exerts a torque as well.
        arm = reference.position_w - plant.data.xipos[torso]
        expected = np.concatenate([pull[:3], pull[3:] - np.cross(arm, pull[:3])])
        found = controller.memory.compensation.external_w
        close(found[:3], expected[:3], atol=0.2)
        close(found[3:], expected[3:], atol=0.06)
