"""Pins the sensors: rates, latency, true values without noise, quantisation, size and colour of noise, refusals."""

import math
from dataclasses import asdict, fields, replace
from itertools import pairwise

import numpy as np
import pytest
from reference.sensors import Sensors
from support.states import resting

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.sim.sensors import SensorConfig
from spidar_gym.so3 import exp, log, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Command

G = np.array([0.0, 0.0, 9.81])
HIGH = np.array([0.0, 0.0, 5.0])
ASKEW = matrix_to_quat(exp(np.array([0.2, -0.1, 0.3])))
VACUUM = AeroConfig(wake=False)
PERFECT = SensorConfig(factor=0.0, dropout=0.0)
FC = np.array(ROBOT.flight_controller)
JOINT_STEPS = np.tile([2 * math.pi / 2**13, 2 * math.pi / 2**12], 8)
"""Resolution of yaw and pitch joints [rad]: 13 and 12 bits a turn."""
VECTORING_STEPS = np.tile([0.00092, 0.00115], (8, 1))
STILL = resting(FORMS["form2"], joint_torque=np.linspace(-5.0, 5.0, 16))
QUIET = {f.name: 0.0 for f in fields(SensorConfig) if f.name not in ("latency", "factor")}
"""Configuration with every kind of noise at zero."""


def only(**noise) -> SensorConfig:
    """Sensor configuration with only these kinds of noise."""
    return SensorConfig(**(QUIET | noise))


def at_rest():
    """The motion of a robot at rest."""
    state = replace(STILL)

    def motion(time):
        # Updated in place, because building a state takes longer than measuring it.
        object.__setattr__(state, "time", time)
        return state

    return motion


def watch(config, seconds, *, motion=None, seed=0, tick=0.025):
    """Measurements of a robot in motion, one a control tick from time 0 on."""
    sensors, rng, said, motion = Sensors(config), np.random.default_rng(seed), [], motion or at_rest()
    memory = sensors.start(motion(0.0), rng)
    said.append(sensors.read(memory, 0.0))
    each = round(tick / 0.005)
    # The simulation's time is accumulated step by step.
    for n, time in enumerate(np.cumsum(np.full(2 * round(seconds / 0.005), TIMESTEP))[1::2].tolist(), 1):
        sensors.sample(memory, motion(time), rng)
        if n % each == 0:
            said.append(sensors.read(memory, time))
    return said


def frames(said):
    """Times, positions and attitudes of all frames except for the first, which was taken before time 0."""
    parts = [(m.pose_time, m.pose_position_w, m.pose_quat_wb) for m in said]
    return [
        np.concatenate([part[i][: m.pose_count] for part, m in zip(parts, said, strict=True)])[1:] for i in range(3)
    ]


def samples(said):
    """Times, angular velocities and specific forces of all samples."""
    parts = [(m.imu_time, m.gyro_b, m.specific_force_b) for m in said]
    return [np.concatenate([part[i][: m.imu_count] for part, m in zip(parts, said, strict=True)]) for i in range(3)]


def command(rng=None) -> Command:
    """A random command, or a zero command without `rng`."""
    if rng is None:
        return Command(np.zeros(8), np.zeros((8, 2)), np.zeros(16), np.full(16, 7.0))
    return Command(rng.uniform(0, 15, 8), rng.uniform(-1, 1, (8, 2)), rng.uniform(-1, 1, 16), np.full(16, 7.0))


def tumble(seconds, *, tumbling=True, config=PERFECT, substeps=2, seed=0, **others):
    """True states and measurements of a robot in the air under random commands, from the reset on."""
    plant = Plant(PlantConfig(sense=True, substeps=substeps, sensors=config, aero=VACUUM, **others))
    rng = np.random.default_rng(seed + 100)
    states = [plant.reset(HIGH, ASKEW, rng=np.random.default_rng(seed))]
    said = [plant.measure()]
    commanded = command()
    for k in range(round(seconds / plant.period)):
        if k % 20 == 0:
            commanded = command(rng if tumbling else None)
        states.append(plant.step(commanded))
        said.append(plant.measure())
    return states, said


def swing(time):
    """Exact state of a robot that swings about its torso's origin, which circles, with moving joints."""
    omega = np.array([0.9, -0.5, 0.7]) * math.cos(3.0 * time)
    R = exp(np.array([0.9, -0.5, 0.7]) * math.sin(3.0 * time) / 3.0)
    return replace(
        STILL,
        time=time,
        position_w=np.array([math.sin(2 * time), math.cos(2 * time), 0.3 * time]),
        velocity_w=np.array([2 * math.cos(2 * time), -2 * math.sin(2 * time), 0.3]),
        quat_wb=matrix_to_quat(R),
        omega_b=omega,
        joint_position=STILL.joint_position + 0.2 * time,
        vectoring=STILL.vectoring + math.sin(time),
    )


# Rates and latency --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("substeps", [2, 5, 10])
def test_a_second_has_100_frames_and_200_samples_evenly_spaced(substeps):
    _, said = tumble(1.0, substeps=substeps, config=replace(PERFECT, latency=0.0))
    np.testing.assert_allclose(frames(said)[0], 0.01 * np.arange(1, 101), rtol=0, atol=1e-9)
    np.testing.assert_allclose(samples(said)[0], 0.005 * np.arange(201), rtol=0, atol=1e-9)


def test_the_servos_are_read_50_times_a_second_and_the_angles_stay_in_between():
    _, said = tumble(1.0)
    times = np.array([m.encoder_time for m in said])
    np.testing.assert_allclose(np.unique(times), 0.02 * np.arange(51), rtol=0, atol=1e-9)
    for before, after in pairwise(said):
        moved = not np.array_equal(before.joint_position, after.joint_position)
        assert moved <= (before.encoder_time != after.encoder_time)


@pytest.mark.parametrize("substeps", [7, 10])
@pytest.mark.parametrize("latency", [0.0, 0.01, 0.017, 0.03, 0.1])
def test_every_frame_arrives_once_with_the_first_tick_after_its_latency(latency, substeps):
    _, said = tumble(0.5, substeps=substeps, config=replace(PERFECT, latency=latency))
    last = -1.0
    for m in said:
        arrived = m.pose_time[: m.pose_count]
        assert np.all(arrived + latency <= m.time + 1e-9)
        assert np.all(arrived + latency > last)
        last = m.time + 1e-9
    arrived = frames(said)[0]
    expected = 0.01 * np.arange(1, 1 + int((said[-1].time - latency + 1e-9) / 0.01))
    np.testing.assert_allclose(arrived, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("substeps", [3, 10, 15])
def test_every_sample_of_the_inertial_unit_is_returned_once_oldest_first(substeps):
    _, said = tumble(0.6, substeps=substeps)
    times = samples(said)[0]
    np.testing.assert_allclose(times, 0.005 * np.arange(len(times)), rtol=0, atol=1e-9)
    assert times[-1] > said[-1].time - 0.005 - 1e-9


def test_a_second_reading_at_the_same_instant_returns_no_new_data():
    plant = Plant(PlantConfig(sense=True))
    plant.reset(HIGH, rng=np.random.default_rng(0))
    plant.measure()
    plant.step(command())
    first, second = plant.measure(), plant.measure()
    assert first.pose_count > 0
    assert first.imu_count == 5
    assert second.pose_count == second.imu_count == 0
    np.testing.assert_array_equal(first.joint_position, second.joint_position)


@pytest.mark.parametrize("latency", [0.0, 0.01, 0.03])
def test_a_robot_at_rest_has_a_frame_with_its_first_measurement(latency):
    plant = Plant(PlantConfig(sense=True, sensors=replace(PERFECT, latency=latency)))
    plant.reset(HIGH, ASKEW, rng=np.random.default_rng(0))
    first = plant.measure()
    assert first.pose_count == 1
    np.testing.assert_allclose(first.pose_time[0], -latency, rtol=0, atol=1e-12)
    np.testing.assert_allclose(first.pose_position_w[0], HIGH + quat_to_matrix(ASKEW) @ FC, rtol=0, atol=1e-12)


# True values without noise ------------------------------------------------------------------------------------------


def test_a_perfect_frame_is_the_pose_of_the_flight_controller_when_it_was_taken():
    said = watch(replace(PERFECT, latency=0.03), 1.0, motion=swing)
    for time, position, quat in zip(*frames(said), strict=True):
        state = swing(time)
        R = quat_to_matrix(state.quat_wb)
        np.testing.assert_allclose(position, state.position_w + R @ FC, rtol=0, atol=1e-9)
        np.testing.assert_allclose(quat_to_matrix(quat), R, rtol=0, atol=1e-9)


def test_a_perfect_gyroscope_measures_omega():
    states, said = tumble(0.5)
    omega = np.array([state.omega_b for state in states])
    assert np.abs(omega).max() > 0.3
    np.testing.assert_allclose(samples(said)[1], omega, rtol=0, atol=1e-12)


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.3, -0.5, 1.0]), np.array([math.pi, 0.0, 0.0])])
def test_specific_force_at_rest_is_one_g_upwards_whatever_the_attitude(turn):
    R = exp(turn)
    said = watch(PERFECT, 0.1, motion=lambda time: replace(STILL, time=time, quat_wb=matrix_to_quat(R)))
    np.testing.assert_allclose(samples(said)[2] @ R.T, np.tile(G, (21, 1)), rtol=0, atol=1e-9)


def test_a_robot_in_free_fall_measures_no_specific_force():
    states, said = tumble(0.5, tumbling=False)
    assert states[-1].velocity_w[2] < -4.8
    assert np.abs(samples(said)[2][1:]).max() < 1e-6


def test_specific_force_of_a_steady_turn_is_centripetal():
    rate = np.array([0.0, 0.0, 2.0])

    def spin(time):
        return replace(STILL, time=time, quat_wb=matrix_to_quat(exp(rate * time)), omega_b=rate)

    force = samples(watch(PERFECT, 0.5, motion=spin))[2][2:]
    expected = np.cross(rate, np.cross(rate, FC)) + G
    # The mean over a sample's 5 ms lags by half of it.
    np.testing.assert_allclose(
        force, np.tile(expected, (len(force), 1)), rtol=0, atol=0.011 * np.abs(expected[:2]).max()
    )


def test_integrals_of_the_specific_force_are_the_change_of_velocity_and_the_path_of_the_flight_controller():
    states, said = tumble(0.8)
    R = np.array([quat_to_matrix(state.quat_wb) for state in states])
    at = np.array([state.position_w for state in states]) + R @ FC
    acceleration = np.einsum("nij,nj->ni", R, samples(said)[2]) - G
    velocity = 0.005 * np.cumsum(acceleration, axis=0)
    between = (at[2:] - at[:-2]) / 0.01
    assert np.abs(between).max() > 2.0
    np.testing.assert_allclose(velocity[1:-1], between, rtol=0, atol=0.02)
    path = 0.005 * np.cumsum(0.5 * (velocity[1:] + velocity[:-1]), axis=0)
    np.testing.assert_allclose(path, at[1:] - at[0], rtol=0, atol=0.01)


def test_perfect_servos_report_their_torque():
    said = watch(PERFECT, 0.1)
    for m in said:
        np.testing.assert_array_equal(m.joint_torque, STILL.joint_torque)


# Encoders -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [0.0, 1.0])
def test_encoders_return_whole_counts(factor):
    for m in watch(SensorConfig(factor=factor), 1.0, motion=swing):
        for angles, step in ((m.joint_position, JOINT_STEPS), (m.vectoring, VECTORING_STEPS)):
            # The resolution is specified to three digits.
            counts = angles / step
            np.testing.assert_allclose(counts, np.round(counts), rtol=5e-4, atol=1e-9)


def test_encoders_without_noise_are_within_half_a_count_and_use_all_of_it():
    errors = []
    for m in watch(PERFECT, 2.0, motion=swing):
        state = swing(m.encoder_time)
        joints = (m.joint_position - state.joint_position) / JOINT_STEPS
        errors.append(np.concatenate([joints, ((m.vectoring - state.vectoring) / VECTORING_STEPS).reshape(-1)]))
    largest = np.abs(errors).max(0)
    assert np.all(largest < 0.502)
    assert np.all(largest > 0.4)


def test_an_encoder_with_a_zero_offset_indicates_the_commanded_angle_and_the_true_angle_is_off():
    rng = np.random.default_rng(3)
    joint, vectoring = rng.uniform(0.01, 0.03, 16), rng.uniform(-0.02, -0.01, (8, 2))
    config = PlantConfig(
        sense=True,
        sensors=PERFECT,
        aero=VACUUM,
        actuators=ActuatorConfig(joint_offset=joint, vectoring_offset=vectoring),
    )
    plant = Plant(config)
    plant.model.opt.gravity[:] = 0.0
    q = FORMS["form2"]
    plant.reset(HIGH, joint_position=q, rng=rng)
    commanded = replace(command(), joint_position=q)
    for _ in range(4):
        state, said = plant.state(), plant.measure()
        np.testing.assert_allclose(state.joint_position, q + joint, rtol=0, atol=1e-6)
        np.testing.assert_allclose(state.vectoring, vectoring, rtol=0, atol=1e-6)
        assert np.all(np.abs(said.joint_position - q) < 0.502 * JOINT_STEPS)
        assert np.all(np.abs(said.vectoring) < 0.502 * VECTORING_STEPS)
        plant.step(commanded)


# Noise --------------------------------------------------------------------------------------------------------------


def test_white_noise_of_positions_and_attitudes_has_its_standard_deviation():
    _, positions, quats = frames(watch(only(position_noise=2e-3, rotation_noise=3e-3), 20.0))
    turns = np.array([log(quat_to_matrix(quat)) for quat in quats])
    errors = np.hstack([positions - FC, turns])
    np.testing.assert_allclose(errors.std(0), [2e-3] * 3 + [3e-3] * 3, rtol=0.08)
    assert np.abs(np.corrcoef(errors.T) - np.eye(6)).max() < 0.1
    assert np.abs(np.mean(errors[1:] * errors[:-1], axis=0) / errors.var(0)).max() < 0.1


def test_slow_errors_of_frames_are_as_large_at_the_start_as_later_and_10_s_wide():
    config = only(position_drift=2e-3, rotation_drift=3e-3)
    sizes = np.array([2e-3] * 3 + [3e-3] * 3)

    def errors(said):
        _, positions, quats = frames(said)
        return np.hstack([positions - FC, [log(quat_to_matrix(quat)) for quat in quats]]) / sizes

    first = np.array([errors(watch(config, 0.025, seed=seed))[0] for seed in range(200)])
    np.testing.assert_allclose(np.sqrt(np.mean(first**2, axis=0)), 1.0, atol=0.2)
    later = errors(watch(config, 20.0))
    # Ornstein–Uhlenbeck process: E(Δ²) = 2 σ² (1 − exp(−Δt / T)).
    for lag in (1, 5):
        change = np.mean((later[lag:] - later[:-lag]) ** 2)
        np.testing.assert_allclose(change, 2.0 * (1.0 - math.exp(-0.01 * lag / 10.0)), rtol=0.1)
    assert np.abs(later).max() < 5.0


def test_noise_of_the_inertial_unit_integrates_to_walks_of_its_densities():
    _, gyro, force = samples(watch(only(gyro_noise=0.02, accelerometer_noise=0.03), 30.0))
    for errors, density in ((gyro[1:], 0.02), (force[1:] - G, 0.03)):
        for window in (1, 40):
            walks = 0.005 * errors.reshape(-1, window, 3).sum(1)
            spread = np.sqrt(np.mean(walks**2))
            np.testing.assert_allclose(spread, density * math.sqrt(0.005 * window), rtol=0.025 * math.sqrt(window))


def test_rotors_shake_every_sample_of_the_accelerometer_and_no_gyroscope():
    _, gyro, force = samples(watch(only(vibration=0.7), 20.0))
    np.testing.assert_allclose((force - G).std(0), 0.7, rtol=0.05)
    assert not gyro.any()


def test_biases_are_sampled_at_switch_on_and_stay():
    config = only(gyro_bias=0.01, accelerometer_bias=0.2)
    drawn = []
    for seed in range(200):
        _, gyro, force = samples(watch(config, 0.025, seed=seed))
        np.testing.assert_allclose(gyro, np.tile(gyro[0], (6, 1)), rtol=0, atol=1e-12)
        np.testing.assert_allclose(force, np.tile(force[0], (6, 1)), rtol=0, atol=1e-9)
        drawn.append(np.concatenate([gyro[0] / 0.01, (force[0] - G) / 0.2]))
    np.testing.assert_allclose(np.std(drawn, axis=0), 1.0, atol=0.2)
    assert np.abs(np.corrcoef(np.transpose(drawn)) - np.eye(6)).max() < 0.25


def test_noise_of_encoders_adds_to_their_rounding_and_torques_are_off_in_proportion():
    said = watch(SensorConfig(encoder_noise=0.5, torque_noise=0.1), 20.0, tick=0.02)
    counts = np.array([(m.joint_position - STILL.joint_position) / JOINT_STEPS for m in said])
    angles = np.array([(m.vectoring - STILL.vectoring) / VECTORING_STEPS for m in said])
    for errors in (counts, angles):
        np.testing.assert_allclose(np.sqrt(np.mean(errors**2)), math.sqrt(0.5**2 + 1 / 12), rtol=0.03)
    torques = np.array([m.joint_torque for m in said]) / STILL.joint_torque - 1.0
    np.testing.assert_allclose(torques.std(), 0.1, rtol=0.03)
    assert np.abs(torques.mean(0)).max() < 0.02


def test_the_factor_scales_all_of_the_noise():
    config = SensorConfig(dropout=0.0)
    (_, *frame1), (_, *frame2) = (frames(watch(replace(config, factor=factor), 1.0)) for factor in (1.0, 2.0))
    (_, *sample1), (_, *sample2) = (samples(watch(replace(config, factor=factor), 1.0)) for factor in (1.0, 2.0))
    np.testing.assert_allclose(frame2[0] - FC, 2.0 * (frame1[0] - FC), rtol=0, atol=1e-12)
    np.testing.assert_allclose(sample2[0], 2.0 * sample1[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(sample2[1] - G, 2.0 * (sample1[1] - G), rtol=0, atol=1e-9)
    small, large = (np.array([log(quat_to_matrix(quat)) for quat in frame[1]]) for frame in (frame1, frame2))
    np.testing.assert_allclose(large, 2.0 * small, rtol=0, atol=1e-4)
    assert np.abs(small).max() > 1e-3


@pytest.mark.parametrize("field", [f.name for f in fields(SensorConfig) if f.name not in ("latency", "factor")])
def test_every_number_of_the_configuration_changes_a_measurement(field):
    quiet, noisy = (watch(config, 1.0) for config in (only(), only(**{field: 0.5})))
    assert not same(quiet, noisy)


# Drop-outs ----------------------------------------------------------------------------------------------------------


def test_a_drop_out_takes_50_ms_of_frames():
    times = frames(watch(SensorConfig(dropout=0.01), 40.0))[0]
    gaps = np.round(np.diff(times) / 0.01).astype(int) - 1
    lengths = gaps[gaps > 0]
    assert len(lengths) > 20
    assert lengths.min() == 5
    # A drop-out is longer only where another begins within it.
    assert np.mean(lengths == 5) > 0.8


def test_drop_outs_begin_at_their_probability():
    p = 0.05
    times = frames(watch(SensorConfig(dropout=p), 40.0))[0]
    # A frame arrives if neither it nor any of the four before it begins a drop-out.
    np.testing.assert_allclose(len(times) / 4000, (1.0 - p) ** 5, atol=0.05)


def test_without_drop_outs_no_frame_is_missing_and_with_nothing_else_none_comes():
    assert len(frames(watch(SensorConfig(dropout=0.0, latency=0.0), 5.0))[0]) == 500
    lost = watch(SensorConfig(dropout=1.0), 1.0)
    assert all(m.pose_count == 0 for m in lost)
    assert len(samples(lost)[0]) == 201


# Randomness ---------------------------------------------------------------------------------------------------------


def same(a, b) -> bool:
    """Whether two series of measurements are the same, bit for bit."""
    first, second = ([np.asarray(value) for m in said for value in asdict(m).values()] for said in (a, b))
    return len(first) == len(second) and all(np.array_equal(x, y) for x, y in zip(first, second, strict=True))


def test_a_seed_gives_the_same_measurements_and_another_seed_others():
    config = SensorConfig()
    (_, one), (_, again), (_, other) = (tumble(0.3, tumbling=False, config=config, seed=seed) for seed in (4, 4, 5))
    assert same(one, again)
    assert not same(one, other)
    assert not np.array_equal(one[-1].gyro_b, other[-1].gyro_b)


def test_measuring_does_not_change_the_motion():
    sensing, blind = Plant(PlantConfig(sense=True, aero=VACUUM)), Plant(PlantConfig(aero=VACUUM))
    rng = np.random.default_rng(0)
    commanded = [command(rng) for _ in range(20)]
    for plant in (sensing, blind):
        plant.reset(HIGH, ASKEW, rng=np.random.default_rng(1))
    for each in commanded:
        a, b = sensing.step(each), blind.step(each)
        sensing.measure()
        assert all(np.array_equal(x, y) for x, y in zip(asdict(a).values(), asdict(b).values(), strict=True))


# Refusals -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [-1e-3, math.nan, math.inf])
@pytest.mark.parametrize("field", [f.name for f in fields(SensorConfig)])
def test_negative_and_infinite_noise_is_refused(field, value):
    with pytest.raises(InvalidValueError, match=rf"^{field} = .* is not valid; expected a number of at least 0"):
        SensorConfig(**{field: value})


def test_a_probability_above_one_is_refused():
    with pytest.raises(InvalidValueError, match=r"^dropout = 1.5 is not valid; expected a probability within 0 … 1"):
        SensorConfig(dropout=1.5)


def test_a_plant_that_does_not_sense_refuses_to_measure():
    plant = Plant(PlantConfig(sense=False))
    plant.reset(HIGH, rng=np.random.default_rng(0))
    with pytest.raises(InvalidValueError, match=r"^sense = False is not valid; expected True at the reset"):
        plant.measure()


def test_sensors_without_a_generator_are_refused_at_the_reset():
    with pytest.raises(InvalidValueError, match=r"^rng = None is not valid; expected a generator"):
        Plant(PlantConfig(sense=True)).reset(HIGH)
