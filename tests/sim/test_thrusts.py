"""Pins non-nominal thrusts: gain, imbalance, tilt, offset, largest thrust, battery, lags, noise."""

import math

import mujoco
import numpy as np
import pytest
from reference import plant as reference
from support.parts import rotors
from support.plants import HIGH, VACUUM, command, floating
from support.states import model

from spidar_gym.native.engine_structs import AIR_STEPS
from spidar_gym.native.formulas import thrust_noise
from spidar_gym.native.plant import Plant
from spidar_gym.robot import ROBOT
from spidar_gym.sim.actuators import NOISE_BANDWIDTH, ActuatorConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.so3 import exp, matrix_to_quat

AIR_PERIOD = AIR_STEPS * TIMESTEP
TILT = math.radians(3.0)
THRUST = np.linspace(5.0, 26.0, 8)


def askew():
    """A tilted pose: joints, vectoring angles, attitude and its quaternion."""
    rng = np.random.default_rng(3)
    R_wb = exp(np.array([0.2, -0.3, 0.5]))
    return rng.uniform(-0.6, 0.6, 16), rng.uniform(-1.0, 1.0, (8, 2)), R_wb, matrix_to_quat(R_wb)


def wrench(**actuators):
    """Force, world, and torque about the torso's origin, torso axes, of eight different thrusts on a tilted robot."""
    q, vectoring, _, quat = askew()
    plant = Plant(PlantConfig(aero=VACUUM, actuators=ActuatorConfig(**actuators)))
    plant.model.opt.gravity[:] = 0.0
    plant.reset(HIGH, quat, q, vectoring, THRUST)
    force, torque = plant.net_wrench()
    return force.copy(), torque.copy()


def expected(directions=None, offsets=None, gains=None, moments=None):
    """Expected wrench from the description's geometry; directions, offsets and moments are in module axes."""
    q, vectoring, R_wb, _ = askew()
    positions, attitudes = rotors(model(), q, vectoring)
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
def test_the_acceleration_of_a_robot_is_scaled_by_the_thrust_gain(gain):
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
    # The order of two small rotations has an effect of second order: 0.05² of 120 N.
    np.testing.assert_allclose(force, about[0], rtol=0, atol=0.05**2 * THRUST.sum())
    np.testing.assert_allclose(torque, about[1], rtol=0, atol=0.05**2 * THRUST.sum())
    alone = [np.zeros((8, 2)) for _ in range(8)]
    for i in range(8):
        alone[i][i] = tilts[i]
        difference = wrench(thrust_tilt=alone[i])[0] - wrench()[0]
        np.testing.assert_allclose(
            np.linalg.norm(difference), 2.0 * THRUST[i] * math.sin(0.5 * np.linalg.norm(tilts[i])), rtol=1e-3
        )


def test_an_offset_moves_the_point_of_attack_and_not_the_force():
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
    # A couple about x is unchanged by a tilt of the thrust about x.
    assert_wrench(actual, desired)


@pytest.mark.parametrize("most", [20.0, 31.8, 42.0])
def test_no_module_thrusts_more_than_its_largest_thrust(most):
    plant = floating(max_thrust=most)
    for _ in range(40):
        thrust = plant.step(command(99.0)).thrust
        assert thrust.max() <= most
    np.testing.assert_allclose(thrust, most, rtol=1e-9)


def test_a_largest_thrust_above_the_descriptions_is_reached():
    plant = floating(max_thrust=50.0)
    for _ in range(40):
        state = plant.step(command(99.0))
    np.testing.assert_allclose(state.thrust, 50.0, rtol=1e-9)


@pytest.mark.parametrize("charge_wh", [0.0, 200.0, 453.0])
def test_with_a_battery_the_largest_thrust_is_the_one_at_the_voltage_under_load(charge_wh):
    """λ̄ = 2 (15.9 + 1.45 (V − 22.2)), V from 25.2 (full) to 22.2 (85 % of 532.8 Wh), minus 10 mΩ times the current."""
    plant = floating(battery=True)
    plant.record["energy_wh"] = charge_wh
    for _ in range(60):
        state = plant.step(command(99.0))
    rest = 25.2 - 3.0 * plant.energy_wh / (0.85 * 8 * 22.2 * 3.0)
    volts = rest - 0.010 * plant.power / rest
    np.testing.assert_allclose(state.thrust, 2.0 * (15.9 + 1.45 * (volts - 22.2)), rtol=5e-4)
    assert 24.0 < state.thrust[0] < 40.5


def test_a_battery_lowers_the_limit_and_never_raises_it():
    for most, battery, given in ((20.0, True, 20.0), (42.0, False, 42.0)):
        plant = floating(battery=battery, max_thrust=most)
        for _ in range(40):
            state = plant.step(command(99.0))
        np.testing.assert_allclose(state.thrust, given, rtol=1e-9)


def shared(plant: Plant, thrust: np.ndarray) -> np.ndarray:
    """Commands that the modules execute of given ones."""
    plant.step(command(thrust))
    return plant.data.ctrl[:8].copy()


def torso_wrench(thrust: np.ndarray) -> np.ndarray:
    """Force and torque of thrusts in a tilted pose, torso axes."""
    q, vectoring, *_ = askew()
    positions, attitudes = rotors(model(), q, vectoring)
    forces = thrust[:, None] * attitudes[:, :, 2]
    return np.concatenate([forces.sum(axis=0), np.cross(positions, forces).sum(axis=0)])


@pytest.mark.parametrize("limit", [{"max_thrust": 20.0}, {"battery": True, "battery_spent": 1.0}])
def test_scaled_thrusts_keep_their_ratios_and_the_wrenchs_direction_and_clipped_ones_do_not(limit):
    given = np.linspace(8.0, 42.0, 8)
    scaled, clipped = (shared(floating(board_scaling=board, **limit), given) for board in (True, False))
    most = 20.0 if "max_thrust" in limit else 2.0 * (15.9 - 1.45 * 0.010 * 60.0 / 22.2)
    np.testing.assert_allclose(scaled, given * most / 42.0, rtol=1e-9)
    np.testing.assert_allclose(clipped, np.minimum(given, most), rtol=1e-9)
    wrenches = [torso_wrench(each) / np.linalg.norm(torso_wrench(each)) for each in (given, scaled, clipped)]
    np.testing.assert_allclose(wrenches[1], wrenches[0], atol=1e-12)
    assert np.abs(wrenches[2] - wrenches[0]).max() > 0.02


def test_the_board_scales_only_above_the_largest_thrust_and_a_module_stays_within_its_own():
    low = np.linspace(8.0, 19.9, 8)
    assert np.array_equal(shared(floating(board_scaling=True, max_thrust=20.0), low), low)
    # The board does not know the gain: a strong module would exceed its largest thrust, a weak one stays below it.
    gains = np.array([1.25, 0.8, *[1.0] * 6])
    commands = shared(floating(board_scaling=True, max_thrust=20.0, module_gain=gains), np.full(8, 25.0))
    np.testing.assert_allclose(gains * commands, [20.0, 16.0, *[20.0] * 6], rtol=1e-9)


@pytest.mark.parametrize("lag", [0.01, 0.03, 0.06])
def test_a_rising_thrust_has_completed_63_percent_of_a_step_after_one_time_constant(lag):
    plant = floating(substeps=round(lag / TIMESTEP), thrust_lag=lag, thrust=np.full(8, 5.0))
    np.testing.assert_allclose(plant.step(command(25.0)).thrust, 25.0 - 20.0 / math.e, rtol=1e-9)


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.5])
def test_a_falling_thrust_has_its_own_time_constant_from_the_second_evaluation_on(factor):
    lag, commanded = 0.04, np.repeat([5.0, 30.0], 4)
    plant = floating(substeps=AIR_STEPS, thrust_lag=lag, spin_down=factor, thrust=np.full(8, 20.0))
    away = [np.abs(plant.step(command(commanded)).thrust - commanded) for _ in range(6)]
    falling, rising = np.array(away)[:, 0], np.array(away)[:, -1]
    np.testing.assert_allclose(falling[1:] / falling[:-1], math.exp(-AIR_PERIOD / (lag * factor)), rtol=1e-9)
    np.testing.assert_allclose(rising[1:] / rising[:-1], math.exp(-AIR_PERIOD / lag), rtol=1e-9)
    # A thrust that rises again has the other time constant after one evaluation.
    before = plant.step(command(commanded)).thrust[0]
    turned = [plant.step(command(25.0)).thrust[0] for _ in range(3)]
    gone = (25.0 - np.array([before, *turned[:-1]])) / (25.0 - np.array(turned))
    np.testing.assert_allclose(gone[1:], math.exp(AIR_PERIOD / lag), rtol=1e-9)


@pytest.mark.parametrize("dt", [0.001, 0.0125, 0.05])
def test_thrust_noise_fades_with_its_bandwidth_and_is_filled_up_to_its_standard_deviation(dt):
    rng, decay = np.random.default_rng(1), math.exp(-2.0 * math.pi * NOISE_BANDWIDTH * dt)
    np.testing.assert_allclose(thrust_noise(np.arange(8.0), 0.0, dt, rng), decay * np.arange(8.0), rtol=1e-12)
    fresh = np.array([thrust_noise(np.zeros(8), 0.3, dt, rng) for _ in range(2500)])
    np.testing.assert_allclose(fresh.std(), 0.3 * math.sqrt(1.0 - decay**2), rtol=0.02)
    assert abs(fresh.mean()) < 0.01


def test_half_of_the_power_of_the_noise_is_below_its_corner_frequency():
    dt, rng, history = 0.004, np.random.default_rng(2), np.zeros((1050, 8, 8))
    for run in range(8):
        for k in range(1, len(history)):
            history[k, run] = thrust_noise(history[k - 1, run], 1.0, dt, rng)
    history = history[50:].reshape(-1, 64)
    power = (np.abs(np.fft.rfft(history, axis=0)) ** 2).sum(axis=1)
    low = np.fft.rfftfreq(len(history), dt) < NOISE_BANDWIDTH
    assert abs(power[low].sum() / power.sum() - 0.5) < 0.03


def test_the_noise_is_a_force_along_the_thrust_of_that_standard_deviation_and_free_of_drift():
    sigma, plant = 0.4, floating(kind=reference.Plant, thrust_noise=0.4, vectoring=np.tile([0.6, 0.0], (8, 1)))
    samples, commanded = [], command(vectoring=np.array([0.6, 0.0]))
    for _ in range(200):
        plant.step(commanded)
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
    assert np.abs(correlation).max() < 0.4, "the noise of the modules is independent"
    assert not plant.state().thrust.any(), "the noise is no part of the commanded thrust"
    assert np.abs(plant.data.qvel).max() > 1e-3


def plant_axes(plant: Plant):
    """Positions and thrust axes of the modules, world."""
    sites = [plant.model.site(f"thrust{i}").id for i in range(1, 9)]
    return plant.data.site_xpos[sites], plant.data.site_xmat[sites].reshape(8, 3, 3)[:, :, 2]


def test_without_noise_no_random_number_is_drawn_and_no_force_acts():
    plant, rng = floating(), np.random.default_rng(4)
    before = rng.bit_generator.state
    plant.reset(HIGH, thrust=np.full(8, 10.0), rng=rng)
    for _ in range(5):
        plant.step(command(10.0))
    assert rng.bit_generator.state == before
    assert not plant.air_force.any()
    assert not plant.data.qfrc_applied.any()
