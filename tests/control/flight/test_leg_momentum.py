"""Pins the feed-forward of the legs' momentum: the servo model by its ODE, the torque by inverse dynamics."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.compensations import DT, LEVEL, STILL, close
from support.states import model

from spidar_gym.control.flight.compensation import (
    CompensationConfig,
    fresh_compensation,
    momentum_torque,
    servo_response,
)
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, GIMBAL_NAMES, JOINT_NAMES
from spidar_gym.robot.description import mjcf_path
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.so3 import log
from spidar_gym.state import Command

UNFILTERED = CompensationConfig(momentum_gain=1.0, momentum_filter=0.0)


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
    """Feed-forward torque of two ticks at ∓ h/2 around an instant of a motion."""
    memory = fresh_compensation(q, np.zeros(6))
    for t in (-0.5 * h, 0.5 * h):
        snapshot = model().snapshot(q + t * dq, np.eye(3), vectoring)
        memory = replace(memory, servo_velocity=dq + t * ddq)
        # Without the filter, the previous torque has no effect.
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
    """The inverse dynamics minus ω × Iω and İω; Iα is zero here."""
    rng = np.random.default_rng(100 + seed)
    (q, dq, ddq), vectoring, omega = motion(rng), rng.uniform(-1.0, 1.0, (8, 2)), rng.uniform(-2.0, 2.0, 3)
    inertia, later, earlier = (model().snapshot(q + t * dq, np.eye(3), vectoring).inertia_c for t in (0.0, 1e-5, -1e-5))
    rigid = np.cross(omega, inertia @ omega) + (later - earlier) @ omega / 2e-5
    expected = engine.torque(q, vectoring, dq, ddq, omega) - rigid
    assert np.linalg.norm(expected - engine.torque(q, vectoring, dq, ddq, STILL)) > 0.05
    close(fed_forward(q, vectoring, dq, ddq, omega), expected, atol=2e-3)


def manoeuvre(config, omega=STILL, ticks=60):
    """Torques and momenta of the legs during a step of the joint targets to another form."""
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
    """The desired torque of a constant h under a constant ω is ω × h."""
    q, dq, omega = FORMS["form2"], np.linspace(-1.0, 1.0, 16), np.array([0.3, -0.5, 0.8])
    snapshot = model().snapshot(q, np.eye(3), LEVEL)
    memory, config = replace(fresh_compensation(q, np.zeros(6)), servo_velocity=dq), CompensationConfig()
    config, wanted = replace(config, momentum_filter=10 * DT), np.cross(omega, snapshot.momentum_map[3:] @ dq)
    for _ in range(10):
        memory = momentum_torque(snapshot, memory, omega, config=config, dt=DT)
    close(memory.torque, (1.0 - math.exp(-1.0)) * wanted, atol=1e-12)
    assert np.linalg.norm(wanted) > 0.02


def rotation_of_floating_torso(share, fold=0.3, ticks=40):
    """Rotation vectors [rad] of a floating robot that folds one leg sideways, under a share of the feed-forward."""
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
