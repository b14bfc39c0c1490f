"""Pins the compensations: servos by their ODE, torques by inverse dynamics, lead, observer, ramp; zeros do nothing."""

import math
from dataclasses import replace

import gymnasium
import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.states import model, resting, staying

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.control.flight.compensation import (
    CompensationConfig,
    fresh_compensation,
    lead_forces,
    momentum_torque,
    observe_wrench,
    ramp_joints,
    servo_response,
)
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import FORMS, GIMBAL_NAMES, GRAVITY, JOINT_NAMES, ROBOT
from spidar_gym.robot.description import mjcf_path
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.plant import Plant
from spidar_gym.so3 import exp, log
from spidar_gym.state import Command

DT = 0.025
LEVEL = np.zeros((8, 2))
STILL = np.zeros(3)
UNFILTERED = CompensationConfig(momentum_gain=1.0, momentum_filter=0.0)
BOUND = np.repeat([0.5 * ROBOT.weight, 10.0], 3)
"""Largest wrench that the observer believes in [N, Nm]."""
FIELDS = tuple(CompensationConfig.__dataclass_fields__)


def close(actual, desired, *, atol=1e-9):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=atol)


# ---- the servo model ----


@pytest.mark.parametrize("bandwidth", [8.0, 40.0, 120.0])
def test_the_servo_model_is_the_solution_of_its_differential_equation(bandwidth):
    rng = np.random.default_rng(0)
    q, dq, command = rng.normal(size=(3, 16))

    def rate(_, y):
        return np.concatenate([y[16:], bandwidth**2 * (command - y[:16]) - 2.0 * bandwidth * y[16:]])

    exact = solve_ivp(rate, (0.0, DT), np.concatenate([q, dq]), rtol=1e-11, atol=1e-12).y[:, -1]
    position, velocity = servo_response(q, dq, command, bandwidth=bandwidth, dt=DT)
    close(position, exact[:16], atol=1e-8)
    close(velocity, exact[16:], atol=1e-7)


def test_two_ticks_of_the_servo_model_are_one_of_twice_the_length():
    rng = np.random.default_rng(1)
    q, dq, command = rng.normal(size=(3, 16))
    twice = servo_response(*servo_response(q, dq, command, bandwidth=30.0, dt=DT), command, bandwidth=30.0, dt=DT)
    close(np.array(twice), np.array(servo_response(q, dq, command, bandwidth=30.0, dt=2 * DT)), atol=1e-12)


def test_the_servo_model_neither_moves_in_no_time_nor_misses_its_command_in_the_end():
    rng = np.random.default_rng(2)
    q, dq, command = rng.normal(size=(3, 16))
    close(np.array(servo_response(q, dq, command, bandwidth=40.0, dt=0.0)), np.array([q, dq]), atol=1e-15)
    position, velocity = servo_response(q, dq, command, bandwidth=40.0, dt=2.0)
    close(position, command)
    close(velocity, np.zeros(16))


def test_the_servo_model_follows_a_ramp_two_over_its_bandwidth_late():
    q, dq, speed = np.zeros(16), np.zeros(16), np.linspace(-0.2, 0.2, 16)
    for k in range(8000):
        q, dq = servo_response(q, dq, speed * (k + 1) * 1e-4, bandwidth=40.0, dt=1e-4)
    close(dq, speed, atol=1e-6)
    close(speed * 0.8 - q, 2.0 / 40.0 * speed, atol=2e-5)


def test_a_servo_at_rest_never_passes_its_command():
    q, dq = np.zeros(16), np.zeros(16)
    for _ in range(40):
        q, dq = servo_response(q, dq, np.ones(16), bandwidth=60.0, dt=0.01)
        assert np.all(q <= 1.0)
        assert np.all(dq >= 0.0)


# ---- the torque that the legs' momentum needs ----


class Engine:
    """MuJoCo's inverse dynamics of the floating robot, its torso at the origin: no gravity, no floor, no friction."""

    def __init__(self):
        self.model = mujoco.MjModel.from_xml_path(str(mjcf_path()))
        self.model.opt.gravity[:] = 0.0
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self.data = mujoco.MjData(self.model)
        self.dofs = [int(self.model.joint(name).dofadr[0]) for name in JOINT_NAMES]

    def torque(self, q, vectoring, dq, ddq, omega):
        """Torque about the CoG, torso axes, under which the torso turns at a constant rate while the joints move."""
        data = self.data
        data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        for name, angle in zip(JOINT_NAMES + GIMBAL_NAMES, [*q, *vectoring.reshape(-1)], strict=True):
            data.joint(name).qpos = angle
        data.qvel[:], data.qacc[:] = 0.0, 0.0
        data.qvel[3:6] = omega
        data.qvel[self.dofs], data.qacc[self.dofs] = dq, ddq
        mujoco.mj_inverse(self.model, data)
        force, about_origin = data.qfrc_inverse[:3], data.qfrc_inverse[3:6]
        return about_origin - np.cross(data.body("torso").subtree_com, force)


@pytest.fixture(scope="module")
def engine():
    return Engine()


def motion(rng):
    """Joint angles, rates and accelerations."""
    return rng.uniform(-1.0, 1.0, 16), rng.uniform(-1.0, 1.0, 16), rng.uniform(-5.0, 5.0, 16)


def fed_forward(q, vectoring, dq, ddq, omega, h=1e-5):
    """The torque of two ticks `h` apart around a moment of a motion."""
    memory = fresh_compensation(q, np.zeros(6))
    for t in (-0.5 * h, 0.5 * h):
        snapshot = model().snapshot(q + t * dq, np.eye(3), vectoring)
        memory = replace(memory, servo_velocity=dq + t * ddq)
        # Unfiltered, what was torque before is forgotten.
        memory = momentum_torque(snapshot, memory, omega, config=UNFILTERED, dt=h)
    return memory.torque


@pytest.mark.parametrize("seed", range(5))
def test_the_feed_forward_is_the_torque_that_keeps_the_torso_of_a_floating_robot_still(engine, seed):
    rng = np.random.default_rng(seed)
    (q, dq, ddq), vectoring = motion(rng), rng.uniform(-1.0, 1.0, (8, 2))
    expected = engine.torque(q, vectoring, dq, ddq, STILL)
    assert np.linalg.norm(expected) > 0.3
    close(fed_forward(q, vectoring, dq, ddq, STILL), expected, atol=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_with_a_turning_torso_the_gyroscopic_torque_of_the_legs_comes_on_top(engine, seed):
    """What is left of the inverse dynamics besides Iα + ω × Iω (nothing here is accelerated) and İω."""
    rng = np.random.default_rng(100 + seed)
    (q, dq, ddq), vectoring, omega = motion(rng), rng.uniform(-1.0, 1.0, (8, 2)), rng.uniform(-2.0, 2.0, 3)
    inertia, later, earlier = (model().snapshot(q + t * dq, np.eye(3), vectoring).inertia_c for t in (0.0, 1e-5, -1e-5))
    rigid = np.cross(omega, inertia @ omega) + (later - earlier) @ omega / 2e-5
    expected = engine.torque(q, vectoring, dq, ddq, omega) - rigid
    assert np.linalg.norm(expected - engine.torque(q, vectoring, dq, ddq, STILL)) > 0.05
    close(fed_forward(q, vectoring, dq, ddq, omega), expected, atol=2e-3)


def manoeuvre(config, omega=STILL, ticks=60):
    """Torques and momenta of the legs while the joints step to another form as fast as the servos follow."""
    rng = np.random.default_rng(7)
    q, target = rng.uniform(-0.5, 0.5, (2, 16))
    memory, torques, momenta = fresh_compensation(q, np.zeros(6)), [], []
    for _ in range(ticks):
        p, v = servo_response(memory.servo_position, memory.servo_velocity, target, bandwidth=20.0, dt=DT)
        memory = replace(memory, servo_position=p, servo_velocity=v)
        memory = momentum_torque(model().snapshot(p, np.eye(3), LEVEL), memory, omega, config=config, dt=DT)
        torques.append(memory.torque)
        momenta.append(memory.momentum)
    return np.array(torques), np.array(momenta)


def test_without_rotation_the_unfiltered_torque_adds_up_to_the_change_of_the_legs_momentum():
    torques, momenta = manoeuvre(UNFILTERED)
    assert np.abs(momenta).max() > 0.1
    close(torques[0], STILL, atol=0.0)
    close(momenta[0] + DT * np.cumsum(torques, axis=0), momenta, atol=1e-12)


def test_the_filter_delays_the_torque_and_loses_none_of_it():
    sharp, _ = manoeuvre(UNFILTERED, ticks=200)
    smooth, _ = manoeuvre(replace(UNFILTERED, momentum_filter=0.1), ticks=200)
    close(smooth.sum(axis=0), sharp.sum(axis=0), atol=1e-6)
    assert np.abs(smooth).max() < 0.7 * np.abs(sharp).max()


def test_a_step_of_the_wanted_torque_passes_the_filter_by_63_percent_in_its_time_constant():
    """Joints that do not move on a turning torso want nothing; a constant h on a constant ω wants ω × h."""
    q, dq, omega = FORMS["form2"], np.linspace(-1.0, 1.0, 16), np.array([0.3, -0.5, 0.8])
    snapshot = model().snapshot(q, np.eye(3), LEVEL)
    memory, config = replace(fresh_compensation(q, np.zeros(6)), servo_velocity=dq), CompensationConfig()
    config, wanted = replace(config, momentum_filter=10 * DT), np.cross(omega, snapshot.momentum_map[3:] @ dq)
    for _ in range(10):
        memory = momentum_torque(snapshot, memory, omega, config=config, dt=DT)
    close(memory.torque, (1.0 - math.exp(-1.0)) * wanted, atol=1e-12)
    assert np.linalg.norm(wanted) > 0.02


def rotation_of_floating_torso(share, fold=0.3, ticks=40):
    """Rotation vector of a floating robot [rad] that folds one leg up sideways, helped by a share of the torque."""
    plant = Plant(PlantConfig(aero=AeroConfig(wake=False), joint_speed=1.0))
    plant.model.opt.gravity[:] = 0.0
    state = plant.reset(np.array([0.0, 0.0, 5.0]))
    torso, memory = plant.model.body("torso").id, fresh_compensation(state.joint_position, np.zeros(6))
    joints, turned = np.zeros(16), []
    for k in range(ticks):
        joints = np.minimum(joints + 0.02 * (k > 1), fold) * (np.arange(16) < 4)
        p, v = servo_response(memory.servo_position, memory.servo_velocity, joints, bandwidth=25.0, dt=DT)
        memory = replace(memory, servo_position=p, servo_velocity=v)
        snapshot = model().snapshot(state.joint_position, np.eye(3), state.vectoring)
        memory = momentum_torque(snapshot, memory, state.omega_b, config=UNFILTERED, dt=DT)
        R_wb = plant.data.xmat[torso].reshape(3, 3)
        plant.data.xfrc_applied[torso, 3:] = share * (R_wb @ memory.torque)
        state = plant.step(Command(np.zeros(8), LEVEL, joints, np.full(16, 7.0)))
        turned.append(log(plant.data.xmat[torso].reshape(3, 3).copy()))
    return np.array(turned)


def test_the_feed_forward_takes_most_of_the_rotation_from_a_simulated_torso_whose_leg_moves():
    free, helped = rotation_of_floating_torso(0.0), rotation_of_floating_torso(1.0)
    assert np.linalg.norm(free[-1]) > 0.01
    assert np.linalg.norm(helped[-1]) < 0.35 * np.linalg.norm(free[-1])
    assert np.linalg.norm(rotation_of_floating_torso(-1.0)[-1]) > 1.5 * np.linalg.norm(free[-1])


# ---- the lead of the vectoring ----


def lead_case(seed):
    rng = np.random.default_rng(seed)
    q, dq, omega = rng.uniform(-1.0, 1.0, 16), rng.uniform(-1.0, 1.0, 16), rng.uniform(-1.0, 1.0, 3)
    return q, dq, omega, rng.normal(scale=8.0, size=(8, 3))


def world(snapshot, R_wb, forces_l):
    return np.einsum("jk,ikl,il->ij", R_wb, snapshot.R_bl, forces_l)


def miss(seed, lead):
    """Angles [rad] between each force now and the led force when its link has turned for `lead` seconds; no lead's."""
    q, dq, omega, forces = lead_case(seed)
    now, then = (model().snapshot(q + t * dq, np.eye(3), LEVEL) for t in (0.0, lead))
    wanted, R_wb = world(now, np.eye(3), forces), exp(lead * omega)

    def angles(forces_l):
        got = world(then, R_wb, forces_l)
        return np.arctan2(np.linalg.norm(np.cross(got, wanted), axis=1), (got * wanted).sum(axis=1))

    return angles(lead_forces(forces, now, omega, dq, lead=lead)), angles(forces)


@pytest.mark.parametrize("seed", range(6))
def test_a_led_force_points_where_it_should_once_its_link_has_turned(seed):
    """To first order: what is missed falls with the square of the lead."""
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


# ---- the observer ----


def observed(wrench, config, seconds, external=None, R_start=None):
    """Estimates, tick by tick, for a rigid robot of form 2 whose rotors carry it and on which `wrench` acts (world)."""
    R = np.eye(3) if R_start is None else R_start
    snapshot, steps = model().snapshot(FORMS["form2"], R, LEVEL), 20
    memory = fresh_compensation(FORMS["form2"], np.zeros(6) if external is None else external)
    memory = replace(memory, delivered_w=np.array([0.0, 0.0, snapshot.mass * GRAVITY, 0.0, 0.0, 0.0]))
    L, velocity, estimates = np.zeros(3), np.zeros(3), []
    for _ in range(round(seconds / DT)):
        allocated = np.concatenate([R.T @ memory.delivered_w[:3], np.zeros(3)])
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


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_the_observer_finds_a_constant_wrench_on_a_rigid_robot_whatever_its_attitude(turned):
    R_start = exp(turned * np.array([0.6, -0.8, 0.3]))
    estimate = observed(WRENCH, OBSERVER, 1.0 + DT, R_start=R_start)[-1]
    close(estimate, WRENCH * (1.0 - math.exp(-5.0)), atol=2e-3)


def test_the_observer_converges_with_its_time_constant():
    for time in (0.1, 0.4):
        estimates = observed(WRENCH, replace(OBSERVER, observer_time=time), 0.5)
        # The first tick only looks.
        passed = DT * np.arange(len(estimates))
        close(estimates / WRENCH, np.tile(1.0 - np.exp(-passed / time), (6, 1)).T, atol=2e-3)


def test_without_an_external_wrench_the_observer_finds_none_and_forgets_what_it_believed():
    close(observed(np.zeros(6), OBSERVER, 1.0), np.zeros((40, 6)), atol=1e-9)
    forgotten = observed(np.zeros(6), OBSERVER, 1.0 + DT, external=WRENCH)
    close(forgotten[0], WRENCH, atol=0.0)
    close(forgotten[-1], math.exp(-5.0) * WRENCH, atol=1e-9)


def test_the_observer_believes_in_no_more_than_half_the_weight_and_ten_newton_metres():
    for sign in (1.0, -1.0):
        wrench = sign * np.array([200.0, 100.0, 300.0, 15.0, 20.0, 30.0])
        estimates = observed(wrench, replace(OBSERVER, observer_time=0.05), 0.3)
        close(estimates[-1], sign * BOUND, atol=0.0)
        assert np.all(np.abs(estimates) <= BOUND)


def rumour(real_lag):
    """Largest force that the observer makes up when the lift rises by 20 N with a lag; it believes in 0.1 s."""
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


def test_the_observer_blames_nobody_for_rotors_that_lag_as_it_believes():
    assert rumour(0.1) < 1e-9
    assert rumour(0.4) > 3.0


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
        # A force in the torso is off the CoG: it turns the robot as well.
        arm = reference.position_w - plant.data.xipos[torso]
        expected = np.concatenate([pull[:3], pull[3:] - np.cross(arm, pull[:3])])
        found = controller.memory.compensation.external_w
        close(found[:3], expected[:3], atol=0.2)
        close(found[3:], expected[3:], atol=0.06)


# ---- the ramp of the joints ----

SPEED, RAMP = 0.5, 0.4
STEP = SPEED / RAMP * DT
"""Largest change of the velocity in a tick [rad/s]."""


def ramped(start, targets, *, speed=SPEED, ramp=RAMP):
    """Commands and velocities of one tick for each of the targets, the start first."""
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


def test_a_short_way_takes_two_halves_of_the_acceleration_and_never_full_speed():
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


def test_the_controllers_joints_ramp_and_its_tick_tells_their_rate():
    state, target = resting(FORMS["form1"]), FORMS["form2"]
    controller = FlightController(ControllerConfig(compensation=CompensationConfig(joint_ramp=RAMP)), model())
    controller.reset(state)
    path, rates = [state.joint_position], [np.zeros(16)]
    for _ in range(20):
        path.append(controller.step(state, staying(state, joint_target=target)).joint_position)
        rates.append(controller.last_step.joint_velocity)
    check_bounds(np.array(path), np.array(rates), ROBOT.joint_speed, RAMP)
    assert np.abs(rates[-1]).max() == pytest.approx(ROBOT.joint_speed)


# ---- the options ----


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_what_is_no_filter_is_refused_with_what_was_expected(name, value):
    with pytest.raises(InvalidValueError, match=rf"{name} = .* a number of at least 0"):
        CompensationConfig(**{name: value})


@pytest.mark.parametrize("name", FIELDS)
def test_zero_is_refused_where_it_would_divide_and_nowhere_else(name):
    if name in ("servo_bandwidth", "observer_time"):
        with pytest.raises(InvalidValueError, match=rf"{name} = 0.0 .* a number above 0"):
            CompensationConfig(**{name: 0.0})
    else:
        assert getattr(CompensationConfig(**{name: 0.0}), name) == 0.0


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


@pytest.mark.parametrize("option", ["momentum_gain", "vectoring_lead", "observer_gain", "joint_ramp"])
def test_every_option_changes_a_flight(option):
    config = ControllerConfig(compensation=CompensationConfig(**{option: 0.05}))
    # The first form is held for a second, so that joints move from the fortieth tick on.
    difference = np.abs(flown(config, 120) - flown(ControllerConfig(), 120)).max()
    assert 1e-6 < difference < 3.0
