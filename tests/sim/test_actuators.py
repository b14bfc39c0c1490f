"""Pins the actuators off their description: every field of the configuration changes what it names, and only that."""

import math

import mujoco
import numpy as np
import pytest
from support.states import model

from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import JOINT_NAMES, ROBOT
from spidar_gym.sim.actuators import NOISE_BANDWIDTH, ActuatorConfig, thrust_noise
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.plant import AIR_STEPS, TIMESTEP, Plant, PlantConfig
from spidar_gym.sim.randomize import randomize
from spidar_gym.sim.sensors import ENCODER_STEPS, SensorConfig
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.state import Command

HIGH = np.array([0.0, 0.0, 5.0])
VACUUM = AeroConfig(wake=False)
AIR_PERIOD = AIR_STEPS * TIMESTEP
TILT = math.radians(3.0)
THRUST = np.linspace(5.0, 26.0, 8)
OUTER_YAW = JOINT_NAMES.index("joint2_yaw")
SPIN = 0.3
"""Some angle of a joint in its range [rad]."""


def command(thrust=0.0, joints=0.0, vectoring=0.0, limit=7.0) -> Command:
    """A command; numbers stand for equal entries."""
    shapes = ((8,), (8, 2), (16,), (16,))
    values = (thrust, vectoring, joints, limit)
    return Command(*(np.broadcast_to(v, s).astype(float) for v, s in zip(values, shapes, strict=True)))


def floating(*, substeps=10, joint_speed=ROBOT.joint_speed, thrust=None, q=None, vectoring=None, **actuators) -> Plant:
    """A plant at rest without gravity and air."""
    config = ActuatorConfig(**actuators)
    plant = Plant(PlantConfig(substeps=substeps, joint_speed=joint_speed, aero=VACUUM, actuators=config))
    plant.model.opt.gravity[:] = 0.0
    rng = np.random.default_rng(0)
    plant.reset(HIGH, joint_position=q, vectoring=vectoring, thrust=thrust, rng=rng)
    return plant


def askew():
    """A pose: joints, vectoring angles, attitude and its quaternion."""
    rng = np.random.default_rng(3)
    R_wb = exp(np.array([0.2, -0.3, 0.5]))
    return rng.uniform(-0.6, 0.6, 16), rng.uniform(-1.0, 1.0, (8, 2)), R_wb, matrix_to_quat(R_wb)


def wrench(**actuators):
    """Force, world, and torque about the torso's origin, torso axes, of eight different thrusts on an askew robot."""
    q, vectoring, _, quat = askew()
    plant = Plant(PlantConfig(aero=VACUUM, actuators=ActuatorConfig(**actuators)))
    plant.model.opt.gravity[:] = 0.0
    plant.reset(HIGH, quat, q, vectoring, THRUST)
    force, torque = plant.net_wrench()
    return force.copy(), torque.copy()


def expected(directions=None, offsets=None, gains=None, moments=None):
    """The same from the geometry of the description; direction, offset and moment of each module in module axes."""
    q, vectoring, R_wb, _ = askew()
    positions, attitudes = model().rotors(q, vectoring)
    force, torque = np.zeros(3), np.zeros(3)
    for i in range(8):
        T = THRUST[i] * (1.0 if gains is None else gains[i])
        f = T * attitudes[i] @ ([0.0, 0.0, 1.0] if directions is None else directions[i])
        point = positions[i] + attitudes[i] @ (np.zeros(3) if offsets is None else offsets[i])
        force += f
        torque += np.cross(point, f)
        if moments is not None:
            torque += T * attitudes[i] @ moments[i]
    return R_wb @ force, torque


def assert_wrench(actual, desired):
    for a, b in zip(actual, desired, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-8)


def loaded(plant: Plant, servo: str, torque: float, told: Command, seconds: float = 2.0):
    """The state after a torque has pulled at one joint for some time; it acts between two links, so nothing flies."""
    dof = plant.model.joint(servo).dofadr[0]
    for _ in range(round(seconds / plant.period)):
        plant.data.qfrc_applied[dof] = torque
        state = plant.step(told)
    plant.data.qfrc_applied[dof] = 0.0
    return state


def setpoints(plant: Plant) -> np.ndarray:
    """Thrusts, and setpoints of joint and vectoring servos."""
    return plant.data.act[plant._act].copy()


# Rotors -------------------------------------------------------------------------------------------------------------


def test_nominal_rotors_pull_at_the_modules_centres_along_their_axes():
    assert_wrench(wrench(), expected())


def test_the_thrust_gain_scales_the_force_of_every_module():
    force, torque = wrench()
    assert_wrench(wrench(thrust_gain=0.9), (0.9 * force, 0.9 * torque))


def test_the_module_gain_scales_the_force_of_its_own_module_on_top_of_the_common_one():
    gains = np.linspace(0.8, 1.3, 8)
    assert_wrench(wrench(module_gain=gains), expected(gains=gains))
    assert_wrench(wrench(module_gain=gains, thrust_gain=1.1), expected(gains=1.1 * gains))


@pytest.mark.parametrize("gain", [0.8, 1.1])
def test_a_robot_with_a_thrust_gain_accelerates_as_much_more(gain):
    plant = floating(thrust=np.full(8, 10.0), thrust_gain=gain)
    plant.step(command(10.0))
    torso = plant.model.body("torso").id
    mujoco.mj_subtreeVel(plant.model, plant.data)
    mujoco.mj_forward(plant.model, plant.data)
    mujoco.mj_subtreeVel(plant.model, plant.data)
    speed = plant.data.subtree_linvel[torso][2]
    np.testing.assert_allclose(speed, gain * 80.0 / ROBOT.total_mass * plant.period, rtol=1e-5)


def test_ducts_that_pull_unequally_turn_their_module_about_x_by_the_lever_times_the_difference():
    imbalance = np.linspace(-0.05, 0.04, 8)
    # The left duct is at +y: T_left − T_right = imbalance · λ, at ± d on the y axis.
    left, right = 0.5 * (1.0 + imbalance), 0.5 * (1.0 - imbalance)
    moments = np.zeros((8, 3))
    for share, y in ((left, ROBOT.duct_offset_y), (right, -ROBOT.duct_offset_y)):
        moments += share[:, None] * np.cross([0.0, y, 0.0], [0.0, 0.0, 1.0])
    assert_wrench(wrench(duct_imbalance=imbalance), expected(moments=moments))
    np.testing.assert_allclose(moments[-1], [0.1335 * 0.04, 0.0, 0.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("axis", "direction"),
    [(0, [0.0, -math.sin(TILT), math.cos(TILT)]), (1, [math.sin(TILT), 0.0, math.cos(TILT)])],
)
def test_a_tilt_turns_the_force_by_its_angle_about_the_modules_axis(axis, direction):
    tilt = np.zeros((8, 2))
    tilt[:, axis] = TILT
    assert_wrench(wrench(thrust_tilt=tilt), expected(directions=[direction] * 8))


def test_tilts_about_both_axes_turn_without_stretching_and_each_module_by_its_own():
    tilts = np.random.default_rng(1).uniform(-0.05, 0.05, (8, 2))
    turned = [exp(np.array([a, b, 0.0])) @ [0.0, 0.0, 1.0] for a, b in tilts]
    force, torque = wrench(thrust_tilt=tilts)
    about = expected(directions=turned)
    # The order of two small turns is second order: 0.05² of 120 N.
    np.testing.assert_allclose(force, about[0], rtol=0, atol=0.05**2 * THRUST.sum())
    np.testing.assert_allclose(torque, about[1], rtol=0, atol=0.05**2 * THRUST.sum())
    alone = [np.zeros((8, 2)) for _ in range(8)]
    for i in range(8):
        alone[i][i] = tilts[i]
        difference = wrench(thrust_tilt=alone[i])[0] - wrench()[0]
        np.testing.assert_allclose(
            np.linalg.norm(difference), 2.0 * THRUST[i] * math.sin(0.5 * np.linalg.norm(tilts[i])), rtol=1e-3
        )


def test_an_offset_moves_the_point_of_attack_and_leaves_the_force():
    offsets = np.random.default_rng(2).uniform(-0.01, 0.01, (8, 2))
    points = np.concatenate([offsets, np.zeros((8, 1))], axis=1)
    assert_wrench(wrench(thrust_offset=offsets), expected(offsets=points))


def test_gain_tilt_offset_and_imbalance_are_one_force_at_one_point_and_one_couple():
    tilt = np.zeros((8, 2))
    tilt[:, 0] = TILT
    gains, points = np.linspace(0.9, 1.1, 8), np.tile([0.003, -0.002, 0.0], (8, 1))
    direction = [0.0, -math.sin(TILT), math.cos(TILT)]
    moments = np.tile([0.05 * ROBOT.duct_offset_y, 0.0, 0.0], (8, 1))
    actual = wrench(module_gain=gains, thrust_tilt=tilt, thrust_offset=points[:, :2], duct_imbalance=np.full(8, 0.05))
    desired = expected([direction] * 8, points, gains, moments)
    # A couple about x that tilts with the thrust about x stays a couple about x.
    assert_wrench(actual, desired)


@pytest.mark.parametrize("most", [20.0, 31.8, 42.0])
def test_no_module_thrusts_more_than_its_largest_thrust(most):
    plant = floating(max_thrust=most)
    for _ in range(40):
        thrust = plant.step(command(99.0)).thrust
        assert thrust.max() <= most
    np.testing.assert_allclose(thrust, most, rtol=1e-9)


def test_a_largest_thrust_above_the_descriptions_is_given():
    plant = floating(max_thrust=50.0)
    for _ in range(40):
        state = plant.step(command(99.0))
    np.testing.assert_allclose(state.thrust, 50.0, rtol=1e-9)


@pytest.mark.parametrize("charge_wh", [0.0, 200.0, 453.0])
def test_with_a_battery_the_largest_thrust_is_the_one_at_the_voltage_under_load(charge_wh):
    """λ̄ = 2 (15.9 + 1.45 (V − 22.2)), V from 25.2 (full) to 22.2 (85 % of 532.8 Wh), minus 10 mΩ times the current."""
    plant = floating(battery=True)
    plant.memory.energy_wh = charge_wh
    for _ in range(60):
        state = plant.step(command(99.0))
    rest = 25.2 - 3.0 * plant.memory.energy_wh / (0.85 * 8 * 22.2 * 3.0)
    volts = rest - 0.010 * plant.memory.power / rest
    np.testing.assert_allclose(state.thrust, 2.0 * (15.9 + 1.45 * (volts - 22.2)), rtol=5e-4)
    assert 24.0 < state.thrust[0] < 40.5


def test_a_battery_lowers_the_limit_and_never_raises_it():
    for most, battery, given in ((20.0, True, 20.0), (42.0, False, 42.0)):
        plant = floating(battery=battery, max_thrust=most)
        for _ in range(40):
            state = plant.step(command(99.0))
        np.testing.assert_allclose(state.thrust, given, rtol=1e-9)


@pytest.mark.parametrize("lag", [0.01, 0.03, 0.06])
def test_a_rising_thrust_has_come_63_percent_of_its_way_after_one_time_constant(lag):
    plant = floating(substeps=round(lag / TIMESTEP), thrust_lag=lag, thrust=np.full(8, 5.0))
    np.testing.assert_allclose(plant.step(command(25.0)).thrust, 25.0 - 20.0 / math.e, rtol=1e-9)


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.5])
def test_a_falling_thrust_has_its_own_time_constant_from_the_second_evaluation_on(factor):
    lag, told = 0.04, np.repeat([5.0, 30.0], 4)
    plant = floating(substeps=AIR_STEPS, thrust_lag=lag, spin_down=factor, thrust=np.full(8, 20.0))
    away = [np.abs(plant.step(command(told)).thrust - told) for _ in range(6)]
    falling, rising = np.array(away)[:, 0], np.array(away)[:, -1]
    np.testing.assert_allclose(falling[1:] / falling[:-1], math.exp(-AIR_PERIOD / (lag * factor)), rtol=1e-9)
    np.testing.assert_allclose(rising[1:] / rising[:-1], math.exp(-AIR_PERIOD / lag), rtol=1e-9)
    # It changes its mind within one evaluation.
    before = plant.step(command(told)).thrust[0]
    turned = [plant.step(command(25.0)).thrust[0] for _ in range(3)]
    gone = (25.0 - np.array([before, *turned[:-1]])) / (25.0 - np.array(turned))
    np.testing.assert_allclose(gone[1:], math.exp(AIR_PERIOD / lag), rtol=1e-9)


# Noise --------------------------------------------------------------------------------------------------------------


def test_thrust_noise_has_its_standard_deviation_at_every_time_step():
    for dt in (0.001, 0.0125, 0.05):
        rng, noise = np.random.default_rng(1), np.zeros(20000)
        for _ in range(round(0.2 / dt) + 1):
            noise = thrust_noise(noise, 0.3, dt, rng)
        assert abs(noise.std() - 0.3) < 0.01
        assert abs(noise.mean()) < 0.01


def test_half_of_the_power_of_the_noise_is_below_its_corner_frequency():
    dt, rng, noise, history = 0.001, np.random.default_rng(2), np.zeros(64), []
    for _ in range(4200):
        noise = thrust_noise(noise, 1.0, dt, rng)
        history.append(noise)
    history = np.array(history[200:])
    power = (np.abs(np.fft.rfft(history, axis=0)) ** 2).sum(axis=1)
    low = np.fft.rfftfreq(len(history), dt) < NOISE_BANDWIDTH
    assert abs(power[low].sum() / power.sum() - 0.5) < 0.03


def test_the_noise_is_a_force_along_the_thrust_of_that_standard_deviation_and_free_of_drift():
    sigma, plant = 0.4, floating(thrust_noise=0.4, vectoring=np.tile([0.6, 0.0], (8, 1)))
    samples, told = [], command(vectoring=np.array([0.6, 0.0]))
    for _ in range(200):
        plant.step(told)
        air = plant.memory.air
        _, axes = plant_axes(plant)
        pulled = air.forces_w[:16].reshape(8, 2, 3).sum(axis=1)
        along = (pulled * axes).sum(axis=1)
        np.testing.assert_allclose(pulled, along[:, None] * axes, rtol=0, atol=0.02 * sigma)
        np.testing.assert_allclose(plant.air_force, pulled.sum(axis=0), rtol=0, atol=1e-9)
        samples.append(along)
    samples = np.array(samples)
    assert abs(samples.std() - sigma) < 0.1 * sigma
    assert abs(samples.mean()) < 0.1 * sigma
    correlation = np.corrcoef(samples.T) - np.eye(8)
    assert np.abs(correlation).max() < 0.4, "every module has its own"
    assert not plant.state().thrust.any(), "it is no part of the thrust that was asked for"
    assert np.abs(plant.data.qvel).max() > 1e-3


def plant_axes(plant: Plant):
    """Positions and thrust axes of the modules, world."""
    sites = [plant.model.site(f"thrust{i}").id for i in range(1, 9)]
    return plant.data.site_xpos[sites], plant.data.site_xmat[sites].reshape(8, 3, 3)[:, :, 2]


def test_without_noise_nothing_is_drawn_and_nothing_pulls():
    plant, rng = floating(), np.random.default_rng(4)
    before = rng.bit_generator.state
    plant.reset(HIGH, thrust=np.full(8, 10.0), rng=rng)
    for _ in range(5):
        plant.step(command(10.0))
    assert rng.bit_generator.state == before
    assert not plant.air_force.any()
    assert not plant.data.qfrc_applied.any()


# Delays -------------------------------------------------------------------------------------------------------------


def flown(plant: Plant, ticks: int, seed: int = 1) -> list[np.ndarray]:
    """Random commands; positions, velocities and setpoints after every tick."""
    rng, states = np.random.default_rng(seed), []
    for _ in range(ticks):
        plant.step(command(rng.uniform(0, 15, 8), rng.uniform(-1, 1, 16), rng.uniform(-1, 1, (8, 2))))
        states.append(np.concatenate([plant.data.qpos, plant.data.qvel, plant.data.act]))
    return states


@pytest.mark.parametrize(
    ("substeps", "delay", "ticks"), [(1, 0.005, 2), (1, 0.040, 16), (1, 0.0262, 10), (1, 0.001, 0), (10, 0.05, 2)]
)
def test_a_delay_shifts_the_whole_motion_bit_for_bit_and_nothing_moves_before(substeps, delay, ticks):
    prompt = flown(floating(substeps=substeps), 30)
    late = floating(substeps=substeps, delay=delay)
    rest = np.concatenate([late.data.qpos, late.data.qvel, late.data.act])
    motion = flown(late, 30)
    assert np.array_equal(motion[:ticks], [rest] * ticks)
    assert np.array_equal(motion[ticks:], prompt[: 30 - ticks])
    assert not np.array_equal(prompt[0], prompt[1])


@pytest.mark.parametrize("delay", [0.0075, 0.0175])
def test_a_delay_within_a_control_period_arrives_within_it(delay):
    plant = floating(thrust_lag=0.03, delay=delay)
    thrust = plant.step(command(20.0)).thrust
    np.testing.assert_allclose(thrust, 20.0 * (1.0 - math.exp(-(0.025 - delay) / 0.03)), rtol=1e-9)


@pytest.mark.parametrize("common", [0.0, 0.01])
def test_the_vectoring_delay_comes_on_top_and_delays_the_vectoring_servos_alone(common):
    prompt, late = floating(substeps=1, delay=common), floating(substeps=1, delay=common, vectoring_delay=0.015)
    first, second = [], []
    for plant, kept in ((prompt, first), (late, second)):
        rng = np.random.default_rng(5)
        for _ in range(30):
            plant.step(command(rng.uniform(0, 15, 8), rng.uniform(-1, 1, 16), rng.uniform(-1, 1, (8, 2))))
            kept.append(setpoints(plant))
    first, second = np.array(first), np.array(second)
    assert np.array_equal(first[:, :24], second[:, :24])
    assert np.array_equal(first[:-6, 24:], second[6:, 24:])
    assert not second[:6, 24:].any()
    assert np.ptp(first[:, 24:], axis=0).min() > 0.01


def test_a_robot_that_obeys_late_obeys_every_command_in_turn():
    plant, told = floating(substeps=2, delay=0.0225), np.random.default_rng(6).uniform(0, 40, (40, 8))
    given = []
    for thrust in told:
        plant.step(command(thrust))
        given.append(plant.data.ctrl[plant._ctrl[:8]].copy())
    # 9 steps: a command reaches the rotors in the middle of the fifth tick after its own.
    assert np.array_equal(given[4:], told[:-4])
    assert not np.any(given[:4])


# Servos -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("joint", ["joint1_pitch", "joint2_yaw"])
@pytest.mark.parametrize(("kp", "torque"), [(80.0, 1.0), (175.0, -2.0), (300.0, 3.0)])
def test_a_joint_under_a_torque_sags_by_the_torque_over_the_stiffness(joint, kp, torque):
    state = loaded(floating(joint_kp=kp), joint, torque, command())
    sag = state.joint_position[JOINT_NAMES.index(joint)]
    np.testing.assert_allclose(sag, torque / kp, rtol=2e-3)
    np.testing.assert_allclose(state.joint_torque[JOINT_NAMES.index(joint)], -torque, rtol=2e-3)


def test_the_stiffness_of_each_servo_has_its_own_factor():
    factors = np.linspace(0.85, 1.15, 16)
    for k in (0, 7, 15):
        state = loaded(floating(joint_kp=150.0, servo_stiffness=factors), JOINT_NAMES[k], 1.5, command())
        np.testing.assert_allclose(state.joint_position[k], 1.5 / (150.0 * factors[k]), rtol=5e-3)


@pytest.mark.parametrize("kp", [11.0, 15.0, 19.0])
def test_a_vectoring_angle_under_a_torque_sags_by_the_torque_over_its_stiffness(kp):
    for axis, name in enumerate(("gimbal3_roll", "gimbal3_pitch")):
        state = loaded(floating(vectoring_kp=kp), name, 0.5, command(), 1.0)
        np.testing.assert_allclose(state.vectoring[2, axis], 0.5 / kp, rtol=1e-3)


@pytest.mark.parametrize("factor", [0.9, 1.0, 1.1])
def test_the_setpoints_of_the_joints_move_faster_by_the_speed_factor(factor):
    plant = floating(joint_speed=0.5, joint_speed_factor=factor)
    for k in range(1, 41):
        state = plant.step(command(joints=1.0))
        np.testing.assert_allclose(setpoints(plant)[8:24], 0.5 * factor * 0.025 * k, rtol=1e-9)
    np.testing.assert_allclose(state.joint_velocity[OUTER_YAW], 0.5 * factor, rtol=0.01)


@pytest.mark.parametrize(("most", "limit", "reached"), [(5.5, 99.0, 5.5), (8.0, 99.0, 8.0), (5.5, 3.0, 3.0)])
def test_a_joint_servo_reaches_its_torque_and_no_more_and_obeys_a_lower_limit(most, limit, reached):
    plant = floating(joint_speed=10.0, substeps=1, max_joint_torque=most)
    torques = [plant.step(command(joints=1.0, limit=limit)).joint_torque for _ in range(100)]
    assert abs(np.abs(torques).max() - reached) < 1e-12


def limp(joint: str) -> Command:
    """All servos hold but the one of `joint`."""
    return command(limit=np.array([0.0 if name == joint else 7.0 for name in JOINT_NAMES]))


@pytest.mark.parametrize(("friction", "torque"), [(0.3, 0.2), (0.5, -0.45)])
def test_dry_friction_holds_a_joint_against_a_smaller_torque(friction, torque):
    free = loaded(floating(), "joint2_yaw", torque, limp("joint2_yaw")).joint_velocity[OUTER_YAW]
    held = loaded(floating(joint_friction=friction), "joint2_yaw", torque, limp("joint2_yaw"))
    assert abs(free) > 0.2
    assert abs(held.joint_velocity[OUTER_YAW]) < 0.02 * abs(free)


@pytest.mark.parametrize(("damping", "friction"), [(0.3, 0.0), (0.9, 0.0), (2.0, 0.0), (0.9, 0.1)])
def test_a_limp_joint_turns_at_the_torque_less_the_dry_friction_over_the_viscous_one(damping, friction):
    plant = floating(joint_damping=damping, joint_friction=friction)
    state = loaded(plant, "joint2_yaw", 0.2, limp("joint2_yaw"), 2.5 if damping > 0.5 else 3.0)
    np.testing.assert_allclose(state.joint_velocity[OUTER_YAW], (0.2 - friction) / damping, rtol=0.05)


@pytest.mark.parametrize("backlash", [0.005, 0.01])
@pytest.mark.parametrize("torque", [1.5, -3.0, 0.1])
def test_under_a_load_a_joint_with_play_rests_half_the_play_farther_than_one_without(backlash, torque):
    tight = loaded(floating(), "joint2_yaw", torque, command(), 3.0).joint_position[OUTER_YAW]
    loose = loaded(floating(backlash=backlash), "joint2_yaw", torque, command(), 3.0).joint_position[OUTER_YAW]
    np.testing.assert_allclose(loose - tight, math.copysign(backlash, torque), rtol=1e-3)


def test_within_its_play_a_joint_moves_from_edge_to_edge_and_stays_where_it_is_left():
    b, touch = 0.01, 0.2
    slack, tight = floating(backlash=b, q=np.full(16, SPIN)), floating(q=np.full(16, SPIN))
    told = command(joints=SPIN)
    for torque in (touch, -touch, touch):
        for plant, play in ((slack, b), (tight, 0.0)):
            state = loaded(plant, "joint2_yaw", torque, told, 4.0)
            edge = math.copysign(play + touch / ROBOT.joint_kp, torque)
            np.testing.assert_allclose(state.joint_position[OUTER_YAW] - SPIN, edge, rtol=5e-3)
            left = loaded(plant, "joint2_yaw", 0.0, told)
            # The spring behind the edge gives back what the touch took; the play gives nothing back.
            away = left.joint_position[OUTER_YAW] - SPIN
            np.testing.assert_allclose(away, math.copysign(play, torque), rtol=0.02, atol=1e-6)
            assert abs(left.joint_torque[OUTER_YAW]) < 1e-3


def test_a_setpoint_that_moves_within_the_play_hardly_moves_the_link():
    plant = floating(backlash=0.02)
    for _ in range(40):
        state = plant.step(command(joints=0.018))
    np.testing.assert_allclose(setpoints(plant)[8:24], 0.018, rtol=1e-9)
    assert np.abs(state.joint_position).max() < 0.2 * 0.018
    tight = floating()
    for _ in range(40):
        state = tight.step(command(joints=0.018))
    np.testing.assert_allclose(state.joint_position, 0.018, rtol=0.02)


# Offsets ------------------------------------------------------------------------------------------------------------


def test_true_minus_indicated_is_the_offset_at_reset_and_under_way_for_joints_and_vectoring_angles():
    rng = np.random.default_rng(7)
    joint, vectoring = rng.uniform(-0.02, 0.02, 16), rng.uniform(-0.01, 0.01, (8, 2))
    config = PlantConfig(
        sense=True,
        aero=VACUUM,
        actuators=ActuatorConfig(joint_offset=joint, vectoring_offset=vectoring),
        sensors=SensorConfig(factor=0.0, dropout=0.0),
    )
    plant = Plant(config)
    plant.model.opt.gravity[:] = 0.0
    q, angles = rng.uniform(-0.5, 0.5, 16), rng.uniform(-1.0, 1.0, (8, 2))
    state = plant.reset(HIGH, joint_position=q, vectoring=angles, rng=rng)
    np.testing.assert_allclose(state.joint_position - q, joint, rtol=0, atol=1e-15)
    np.testing.assert_allclose(state.vectoring - angles, vectoring, rtol=0, atol=1e-15)
    still = plant.step(command(joints=q, vectoring=angles))
    np.testing.assert_allclose(still.joint_position, state.joint_position, rtol=0, atol=1e-12)
    for _ in range(120):
        state = plant.step(command(joints=q + 0.1, vectoring=angles - 0.2))
        said = plant.measure()
    np.testing.assert_allclose(state.joint_position - (q + 0.1), joint, rtol=0, atol=1e-4)
    np.testing.assert_allclose(state.vectoring - (angles - 0.2), vectoring, rtol=0, atol=1e-4)
    half = 0.5 * ENCODER_STEPS + 1e-4
    assert np.all(np.abs(state.joint_position - said.joint_position - joint) < half[:16])
    assert np.all(np.abs((state.vectoring - said.vectoring - vectoring).reshape(-1)) < half[16:])
    assert np.abs(joint).max() > 2 * half[:16].max()


# The model ----------------------------------------------------------------------------------------------------------


def arrays(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """All arrays of a model."""
    names = [name for name in dir(model) if not name.startswith("_")]
    return {name: value.copy() for name in names if isinstance(value := getattr(model, name), np.ndarray)}


DERIVED = {"actuator_acc0"}
"""Acceleration that an actuator gives per unit force; nothing here uses it, and it has its own test."""


def differing(plant: Plant, other: Plant) -> set[str]:
    """Names of the arrays in which two models differ."""
    one, two = arrays(plant.model), arrays(other.model)
    return {name for name, array in one.items() if not np.array_equal(array, two[name])}


@pytest.mark.parametrize("seed", range(3))
def test_becoming_nominal_again_leaves_nothing_of_another_robot(seed):
    rng = np.random.default_rng(seed)
    strange, _ = randomize(PlantConfig(joint_speed=0.7), rng, 1.0)
    used, fresh = Plant(strange), Plant()
    used.reset(HIGH, disturbances=Disturbances(wind=3.0), rng=rng)
    flown(used, 5)
    fresh.reset(HIGH)
    touched = differing(used, fresh)
    assert {"actuator_gear", "actuator_dynprm", "actuator_biasprm", "dof_damping", "dof_frictionloss"} <= touched
    used.configure(PlantConfig())
    used.reset(HIGH)
    assert differing(used, fresh) - DERIVED == set()
    assert np.array_equal(flown(used, 10), flown(fresh, 10))


def test_configuring_twice_is_configuring_once():
    config, _ = randomize(PlantConfig(), np.random.default_rng(9), 1.0)
    once, twice = Plant(config), Plant(config)
    twice.configure(config)
    for plant in (once, twice):
        plant.reset(HIGH, rng=np.random.default_rng(0))
    assert differing(once, twice) - DERIVED == set()


def test_what_mujoco_derives_from_the_gears_is_that_of_the_present_robot_too():
    config, _ = randomize(PlantConfig(), np.random.default_rng(9), 1.0)
    once, twice, back = Plant(config), Plant(config), Plant(config)
    twice.configure(config)
    back.configure(PlantConfig())
    assert differing(once, twice) & DERIVED == set()
    assert differing(back, Plant()) & DERIVED == set()


# Refusals -----------------------------------------------------------------------------------------------------------

SCALARS = (
    "thrust_gain", "max_thrust", "thrust_lag", "spin_down", "thrust_noise", "delay", "vectoring_delay", "joint_kp",
    "joint_speed_factor", "max_joint_torque", "joint_friction", "joint_damping", "backlash", "vectoring_kp",
)  # fmt: skip
NOT_NEGATIVE = ("thrust_noise", "delay", "vectoring_delay", "joint_friction", "joint_damping", "backlash")
ARRAYS = {
    "module_gain": (8,), "duct_imbalance": (8,), "thrust_tilt": (8, 2), "thrust_offset": (8, 2),
    "servo_stiffness": (16,), "joint_offset": (16,), "vectoring_offset": (8, 2),
}  # fmt: skip


@pytest.mark.parametrize("name", SCALARS)
def test_a_number_that_no_actuator_has_is_refused(name):
    for value in (-0.1, math.nan, math.inf, -math.inf):
        with pytest.raises(InvalidValueError, match=rf"{name} = .*expected (a number|a finite|finite)"):
            ActuatorConfig(**{name: value})
    if name in NOT_NEGATIVE:
        ActuatorConfig(**{name: 0.0})
    else:
        with pytest.raises(InvalidValueError, match=f"{name} = .*expected a number above 0"):
            ActuatorConfig(**{name: 0.0})


@pytest.mark.parametrize(("name", "shape"), ARRAYS.items())
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_array_with_something_that_is_no_number_is_refused(name, shape, value):
    array = np.ones(shape)
    array.flat[-1] = value
    with pytest.raises(InvalidValueError, match=rf"(?s){name} = .*expected finite numbers"):
        ActuatorConfig(**{name: array})


@pytest.mark.parametrize("name", ["module_gain", "servo_stiffness"])
def test_a_module_that_sucks_and_a_servo_that_pushes_away_are_refused(name):
    array = np.ones(ARRAYS[name])
    array[-1] = -1.0
    with pytest.raises(InvalidValueError, match=rf"(?s){name} = .*expected"):
        ActuatorConfig(**{name: array})


@pytest.mark.parametrize(("name", "shape"), ARRAYS.items())
def test_an_array_of_another_length_is_refused(name, shape):
    with pytest.raises(InvalidValueError, match=f"{name}"):
        Plant(PlantConfig(actuators=ActuatorConfig(**{name: np.ones((3, *shape[1:]))})))


def test_nobody_can_write_into_the_defaults():
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(ActuatorConfig(), name)[0] = 0.5
