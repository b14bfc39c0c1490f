"""Pins the estimator: exact with perfect sensors, bounded errors with real ones, learnt biases, bridged drop-outs."""

import copy
import math
from dataclasses import asdict, dataclass, replace
from functools import cache

import gymnasium
import numpy as np
import pytest
from reference.sensors import Sensors
from support.states import resting

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.control.estimator import Estimator, EstimatorConfig
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.sensors import SensorConfig
from spidar_gym.so3 import exp, log, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Measurement, RobotState

PERFECT = SensorConfig(factor=0.0, dropout=0.0)
REAL = SensorConfig()
FC = np.array(ROBOT.flight_controller)
COMMANDED = np.linspace(15.0, 25.0, 8)
STILL = resting(FORMS["form2"], joint_torque=np.linspace(-5.0, 5.0, 16))
SEEDS = range(3)
COUNT = 2 * math.pi / 2**12
"""Coarsest count of a joint's encoder [rad]."""


def rest(time) -> RobotState:
    """State of the robot at rest."""
    return replace(STILL, time=time)


@cache
def wander(time) -> RobotState:
    """From rest into a flight about all axes: the attitude turns about a fixed skew axis, so that ω is exact."""
    s = min(time, 1.0) ** 2 / 2 + max(time - 1.0, 0.0)
    rate = min(time, 1.0)
    axis, phase = np.array([0.3, -0.25, 0.4]), 1.9 * s
    frequency, size = np.array([1.7, 1.3, 2.1]), np.array([0.3, 0.4, 0.2])
    return replace(
        STILL,
        time=time,
        position_w=size * np.sin(frequency * s) + np.array([0.0, 0.0, 1.0]),
        velocity_w=rate * size * frequency * np.cos(frequency * s),
        quat_wb=matrix_to_quat(exp(axis * math.sin(phase))),
        omega_b=axis * 1.9 * rate * math.cos(phase),
    )


def cruise(time, velocity=(0.4, -0.3, 0.2), omega=(0.0, 0.0, 0.0)) -> RobotState:
    """From rest to constant velocity and angular velocity within the first second."""
    s, rate = min(time, 1.0) ** 2 / 2 + max(time - 1.0, 0.0), min(time, 1.0)
    velocity, omega = np.array(velocity), np.array(omega)
    return replace(
        STILL,
        time=time,
        position_w=s * velocity,
        velocity_w=rate * velocity,
        quat_wb=matrix_to_quat(exp(s * omega)),
        omega_b=rate * omega,
    )


def bend(time) -> RobotState:
    """Joints move at ± 0.2 rad/s after half a second; vectoring angles swing."""
    way = np.tile([1.0, -1.0], 8) * max(time - 0.5, 0.0)
    return replace(
        STILL,
        time=time,
        joint_position=STILL.joint_position + 0.2 * way,
        joint_velocity=0.2 * np.tile([1.0, -1.0], 8) * (time > 0.5),
        vectoring=STILL.vectoring + 0.1 * math.sin(2 * time),
        vectoring_velocity=np.full((8, 2), 0.2 * math.cos(2 * time)),
    )


@dataclass
class Flight:
    """A motion, its estimates and their errors."""

    time: np.ndarray
    truth: list[RobotState]
    seen: list[RobotState]
    errors: np.ndarray
    """Position [m], attitude [rad], velocity [m/s], angular velocity [rad/s], one row a tick."""
    bias: np.ndarray
    """True biases, gyroscope, then accelerometer."""
    learnt: np.ndarray

    def after(self, seconds, until=math.inf) -> np.ndarray:
        """Errors within `seconds` … `until`."""
        return self.errors[(self.time > seconds + 1e-9) & (self.time < until + 1e-9)]


def deviation(seen: RobotState, true: RobotState) -> np.ndarray:
    """Errors of position, attitude, velocity and angular velocity."""
    turn = log(quat_to_matrix(seen.quat_wb) @ quat_to_matrix(true.quat_wb).T)
    return np.concatenate(
        [seen.position_w - true.position_w, turn, seen.velocity_w - true.velocity_w, seen.omega_b - true.omega_b]
    )


@cache
def follow(motion, config=PERFECT, seconds=4.0, seed=0, blind=(0.0, 0.0), wrong=False) -> Flight:
    """Measure a motion and estimate it every 25 ms; no frame arrives within `blind`; `wrong` offsets the start."""
    sensors, rng, estimator = Sensors(config), np.random.default_rng(seed), Estimator()
    start = motion(0.0)
    memory = sensors.start(start, rng)
    if wrong:
        turned = matrix_to_quat(exp(np.array([0.05, -0.05, 0.08])) @ quat_to_matrix(start.quat_wb))
        start = replace(start, position_w=start.position_w + 0.1, quat_wb=turned)
    estimator.reset(start)
    truth, seen = [], []
    for n in range(round(seconds / 0.005) + 1):
        state = motion(0.005 * n)
        if n:
            sensors.sample(memory, state, rng)
        if n % 5 == 0:
            measurement = sensors.read(memory, state.time)
            if blind[0] < state.time <= blind[1]:
                measurement = replace(measurement, pose_count=0)
            truth.append(state)
            seen.append(estimator.update(measurement, COMMANDED))
    own = estimator.memory
    return Flight(
        np.array([state.time for state in truth]),
        truth,
        seen,
        np.array([deviation(s, t) for s, t in zip(seen, truth, strict=True)]),
        np.concatenate([memory.gyro_bias, memory.accelerometer_bias]),
        np.concatenate([own.gyro_bias, own.accelerometer_bias]),
    )


def rms(errors) -> np.ndarray:
    """Root mean square of position, attitude, velocity and angular velocity, norms of the vectors."""
    return np.sqrt((errors.reshape(-1, 4, 3) ** 2).sum(2).mean(0))


def largest(errors) -> np.ndarray:
    """Largest error of position, attitude, velocity and angular velocity."""
    return np.sqrt((errors.reshape(-1, 4, 3) ** 2).sum(2).max(0))


def equal(a, b) -> bool:
    """Whether two dataclasses hold the same numbers, bit for bit."""
    pairs = zip(asdict(a).values(), asdict(b).values(), strict=True)
    return all(np.asarray(x).tobytes() == np.asarray(y).tobytes() for x, y in pairs)


def said(time, *, imu=(), frame=None, encoder_time=0.0) -> Measurement:
    """Perfect measurement of a robot at rest: samples at these times, and a frame (time, position, attitude)."""
    frames = [] if frame is None else [frame]
    pad = [(0.0, np.zeros(3), np.zeros((3, 3)))] * (4 - len(frames))
    times, positions, attitudes = zip(*frames, *pad, strict=True)
    return Measurement(
        time=time,
        pose_count=len(frames),
        pose_time=np.array(times),
        pose_position_w=np.array(positions),
        pose_quat_wb=np.array([matrix_to_quat(R) if R.any() else np.zeros(4) for R in attitudes]),
        imu_count=len(imu),
        imu_time=np.concatenate([imu, np.zeros(8 - len(imu))]),
        gyro_b=np.zeros((8, 3)),
        specific_force_b=np.tile([0.0, 0.0, 9.81], (8, 1)),
        encoder_time=encoder_time,
        joint_position=STILL.joint_position,
        joint_torque=STILL.joint_torque,
        vectoring=STILL.vectoring,
    )


def estimate_after_delay(delay, frame, **gains) -> RobotState:
    """Estimate at 0.3 s of a robot at rest that receives one frame of 0.1 s with a delay [s]."""
    estimator = Estimator(EstimatorConfig(**gains))
    estimator.reset(STILL)
    seen = STILL
    for n in range(1, 61):
        time = 0.005 * n
        due = n == 20 + round(delay / 0.005)
        seen = estimator.update(said(time, imu=[time], frame=(0.1, *frame) if due else None), COMMANDED)
    return seen


def midway() -> tuple[Estimator, Measurement]:
    """An estimator during a flight with real sensors, and its next measurement: samples, frames and encoders."""
    sensors, rng, estimator = Sensors(REAL), np.random.default_rng(0), Estimator()
    memory = sensors.start(wander(0.0), rng)
    estimator.reset(wander(0.0))
    for n in range(1, 101):
        sensors.sample(memory, wander(0.005 * n), rng)
        if n % 5 == 0:
            measurement = sensors.read(memory, 0.005 * n)
            if n < 100:
                estimator.update(measurement, COMMANDED)
    assert measurement.pose_count > 0
    assert measurement.imu_count == 5
    assert measurement.encoder_time > estimator.memory.encoder_time
    return estimator, measurement


# Perfect sensors ----------------------------------------------------------------------------------------------------


def test_the_estimate_follows_the_truth_through_a_flight_with_perfect_sensors():
    flight = follow(wander)
    assert largest(np.array([deviation(s, STILL) for s in flight.truth])).min() > 0.4
    assert np.all(largest(flight.errors) < [2e-5, 1e-5, 2e-4, 2e-5])


def test_the_inertial_unit_alone_carries_the_estimate_through_three_seconds():
    flight = follow(wander, replace(PERFECT, dropout=1.0), 3.0)
    assert np.all(largest(flight.errors) < [2e-4, 2e-5, 1e-4, 1e-9])


def test_the_estimate_follows_the_robot_under_its_controller():
    env = gymnasium.make("spidar_gym/Hover-v0", plant=PlantConfig(sense=True, sensors=PERFECT)).unwrapped
    env.reset(seed=0)
    still, errors, moved = np.zeros(env.action_space.shape), [], []
    for _ in range(120):
        assert not env.step(still)[2]
        errors.append(deviation(env.seen, env.state))
        moved.append(np.abs(env.state.joint_velocity).max())
    env.close()
    assert max(moved) > 0.1
    # Forces of the air between two samples are not measured even by perfect sensors.
    assert np.all(largest(np.array(errors[40:])) < [1e-4, 2e-4, 2e-3, 5e-4])


def test_a_pure_rotation_about_the_origin_of_the_torso_does_not_move_it():
    def spin(time):
        return cruise(time, (0.0, 0.0, 0.0), (0.6, -0.5, 0.9))

    flight = follow(spin, seconds=3.0)
    there = np.array([quat_to_matrix(state.quat_wb) @ FC for state in flight.truth])
    assert np.ptp(there, axis=0).min() > 0.02
    assert np.abs([s.position_w for s in flight.seen]).max() < 1e-4
    assert np.abs([s.velocity_w for s in flight.seen]).max() < 5e-4


@pytest.mark.parametrize("latency", [0.01, 0.03, 0.05])
def test_latency_does_not_hold_back_a_robot_at_constant_velocity(latency):
    def glide(time):
        return cruise(time, (0.4, -0.3, 0.2), (0.1, 0.2, -0.3))

    flight = follow(glide, replace(PERFECT, latency=latency), 3.0)
    # Without compensation, a frame would be 0.5 m/s × latency behind.
    assert np.all(largest(flight.after(2.0)) < [5e-5, 1e-5, 2e-4, 2e-5])


@pytest.mark.parametrize("latency", [0.01, 0.03])
def test_a_wrong_start_is_forgotten_within_two_seconds(latency):
    flight = follow(wander, replace(PERFECT, latency=latency), 3.0, wrong=True)
    assert np.all(largest(flight.after(0.0, 0.05))[:2] > [0.05, 0.05])
    # Poles at 27 and 10 1/s; the position has those of the accelerometer's bias as well.
    assert np.all(largest(flight.after(0.5, 0.6))[:2] < [6e-3, 2e-2])
    assert np.all(largest(flight.after(2.0)) < [2e-4, 1e-4, 2e-3, 5e-4])


# Late frames --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0.01, 0.03, 0.06])
def test_a_late_frame_moves_the_estimate_as_far_as_one_in_time_would_have(delay):
    frame = (STILL.position_w + FC + np.array([0.01, -0.02, 0.03]), np.eye(3))
    prompt, late = (estimate_after_delay(after, frame, accelerometer=0.0) for after in (0.0, delay))
    assert np.linalg.norm(prompt.velocity_w) > 0.05
    np.testing.assert_allclose(late.velocity_w, prompt.velocity_w, rtol=0, atol=1e-9)
    np.testing.assert_allclose(late.position_w, prompt.position_w, rtol=0, atol=1e-9)


@pytest.mark.parametrize("delay", [0.01, 0.03, 0.06])
def test_a_late_frame_turns_the_estimate_as_far_as_one_in_time_would_have(delay):
    frame = (STILL.position_w + FC, exp(np.array([0.1, -0.2, 0.05])))
    prompt, late = (estimate_after_delay(after, frame, gyro=0.0) for after in (0.0, delay))
    assert np.abs(prompt.quat_wb[1:]).max() > 5e-3
    np.testing.assert_allclose(late.quat_wb, prompt.quat_wb, rtol=0, atol=1e-9)


def test_the_newest_of_the_past_is_the_present():
    estimator, measurement = midway()
    estimator.update(measurement, COMMANDED)
    memory = estimator.memory
    assert memory.past_time[-1] == memory.time
    np.testing.assert_allclose(memory.past_R_wb[-1], memory.R_wb, rtol=0, atol=1e-12)
    np.testing.assert_allclose(memory.past_position_w[-1], memory.position_w, rtol=0, atol=1e-12)


# Real sensors -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_with_real_sensors_no_error_exceeds_9_mm_6_mrad_90_mm_per_s_and_40_mrad_per_s(seed):
    assert np.all(largest(follow(wander, REAL, 8.0, seed).after(2.0)) < [9e-3, 6e-3, 0.09, 0.04])


def test_with_real_sensors_the_state_is_known_to_3_mm_2_mrad_30_mm_per_s_and_13_mrad_per_s():
    errors = np.concatenate([follow(wander, REAL, 8.0, seed).after(2.0) for seed in SEEDS])
    assert np.all(rms(errors) < [3.0e-3, 2.3e-3, 0.029, 0.013])


def test_angular_velocity_is_known_better_than_the_raw_gyroscope_with_its_bias():
    errors = np.concatenate([follow(wander, REAL, 8.0, seed).after(2.0) for seed in SEEDS])
    raw = math.sqrt(3.0) * math.hypot(REAL.gyro_bias, REAL.gyro_noise * math.sqrt(200.0))
    assert rms(errors)[3] < 0.6 * raw


def test_biases_are_learnt():
    flights = [follow(wander, REAL, 8.0, seed) for seed in SEEDS]
    drawn, learnt = (np.array([getattr(flight, name) for flight in flights]) for name in ("bias", "learnt"))
    sizes = np.repeat([REAL.gyro_bias, REAL.accelerometer_bias], 3)
    before, left = (np.sqrt(np.mean((x / sizes).reshape(-1, 2, 3) ** 2, (0, 2))) for x in (drawn, drawn - learnt))
    assert np.all(before > 2.0 * left)
    assert np.all(left < [0.25, 0.4])


def test_biases_are_learnt_exactly_where_nothing_else_is_wrong():
    config = SensorConfig(
        position_noise=0.0, rotation_noise=0.0, position_drift=0.0, rotation_drift=0.0, dropout=0.0, gyro_noise=0.0,
        accelerometer_noise=0.0, vibration=0.0,
    )  # fmt: skip
    flight = follow(wander, config, 5.0)
    assert np.all(np.abs(flight.bias) > [1e-4] * 3 + [1e-3] * 3)
    np.testing.assert_allclose(flight.learnt, flight.bias, rtol=0, atol=1e-3)
    np.testing.assert_allclose(flight.learnt[:3], flight.bias[:3], rtol=0, atol=2e-5)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_drop_out_of_300_ms_is_bridged_and_forgotten(seed):
    flight = follow(wander, REAL, 4.0, seed, blind=(2.0, 2.3))
    start, end = (int(np.argmin(np.abs(flight.time - time))) for time in (2.0, 2.3))
    assert np.linalg.norm(flight.truth[end].position_w - flight.truth[start].position_w) > 0.1
    assert np.all(largest(flight.after(2.0, 2.325)) < [0.03, 6e-3, 0.12, 0.04])
    assert np.all(largest(flight.after(3.3)) < [9e-3, 6e-3, 0.09, 0.04])


def test_the_robot_flies_on_its_own_sensors():
    env = gymnasium.make("spidar_gym/Hover-v0", sensors=True).unwrapped
    env.reset(seed=1)
    still, errors = np.zeros(env.action_space.shape), []
    for _ in range(120):
        assert not env.step(still)[2]
        errors.append(deviation(env.seen, env.state))
    env.close()
    assert np.all(rms(np.array(errors[40:])) < [4.5e-3, 4e-3, 0.03, 0.013])


# Joints -------------------------------------------------------------------------------------------------------------


def rates(flight) -> np.ndarray:
    """Errors of the joint velocities, one row a tick [rad/s]."""
    return np.array([s.joint_velocity - t.joint_velocity for s, t in zip(flight.seen, flight.truth, strict=True)])


def test_the_velocity_of_a_joint_at_200_mrad_per_s_is_known_to_10_percent_after_half_a_second():
    flight = follow(bend, seconds=2.5)
    assert np.abs(rates(flight)[flight.time > 1.0]).max() < 0.02
    assert np.abs(rates(flight)[(flight.time > 0.5) & (flight.time < 0.55)]).max() > 0.1


def test_with_real_encoders_joint_velocities_are_far_better_known_than_a_count_a_reading():
    flight = follow(bend, REAL, 2.5)
    assert np.sqrt(np.mean(rates(flight)[flight.time > 1.0] ** 2)) < 0.015
    assert np.abs(rates(flight)[flight.time < 0.5]).max() < 0.6 * COUNT / 0.02


def test_joint_angles_are_those_of_the_tick_and_not_of_the_reading_before():
    flight = follow(bend, seconds=2.5)
    errors = [s.joint_position - t.joint_position for s, t in zip(flight.seen, flight.truth, strict=True)]
    # They are up to 20 ms apart, 4 mrad.
    assert np.abs(errors)[flight.time > 1.0].max() < 0.6 * COUNT


def test_vectoring_angles_and_their_rates_follow_a_swing():
    flight = follow(bend, seconds=2.5)
    late = flight.time > 1.0
    pairs = list(zip(flight.seen, flight.truth, strict=True))
    angles = np.array([s.vectoring - t.vectoring for s, t in pairs])[late]
    speeds = np.array([s.vectoring_velocity - t.vectoring_velocity for s, t in pairs])[late]
    assert np.abs(angles).max() < 1.2e-3
    assert np.sqrt(np.mean(speeds**2)) < 0.02


# The rest of the state ----------------------------------------------------------------------------------------------


def test_thrust_is_the_commanded_one_and_torque_the_reported_one_at_the_time_of_the_tick():
    estimator, measurement = midway()
    seen = estimator.update(measurement, COMMANDED)
    np.testing.assert_array_equal(seen.thrust, COMMANDED)
    np.testing.assert_array_equal(seen.joint_torque, measurement.joint_torque)
    assert seen.time == measurement.time
    seen.thrust[:] = 0.0
    assert COMMANDED.all()


def test_an_update_is_a_function_of_memory_and_measurement_alone():
    estimator, measurement = midway()
    twin = Estimator()
    twin.memory = copy.deepcopy(estimator.memory)
    estimator.reset(rest(0.0))
    estimator.update(said(0.025, imu=[0.005]), COMMANDED)
    other = Estimator()
    other.memory = copy.deepcopy(twin.memory)
    assert equal(twin.update(measurement, COMMANDED), other.update(measurement, COMMANDED))
    assert equal(twin.memory, other.memory)


def test_an_update_modifies_no_argument_and_returns_copies():
    estimator, measurement = midway()
    before = copy.deepcopy(measurement)
    arrays = [value for value in vars_of(measurement) if isinstance(value, np.ndarray)]
    for array in arrays:
        array.flags.writeable = False
    seen = estimator.update(measurement, COMMANDED)
    assert equal(measurement, before)
    kept = copy.deepcopy(estimator.memory)
    for value in vars_of(seen):
        if isinstance(value, np.ndarray):
            value[:] = math.nan
    assert equal(estimator.memory, kept)


def test_a_start_is_copied():
    start = copy.deepcopy(wander(0.7))
    estimator = Estimator()
    estimator.reset(start)
    kept = copy.deepcopy(estimator.memory)
    for value in vars_of(start):
        if isinstance(value, np.ndarray):
            value[:] = math.nan
    assert equal(estimator.memory, kept)


def test_a_reset_forgets_everything():
    estimator, measurement = midway()
    estimator.update(measurement, COMMANDED)
    estimator.reset(STILL)
    fresh = Estimator()
    fresh.reset(STILL)
    assert equal(estimator.memory, fresh.memory)


def test_a_tick_without_measurements_changes_only_its_time():
    estimator, measurement = midway()
    seen = estimator.update(measurement, COMMANDED)
    again = estimator.update(replace(measurement, pose_count=0, imu_count=0), COMMANDED)
    assert equal(seen, again)


def vars_of(record) -> list:
    """The values of a dataclass, not copied."""
    return [getattr(record, name) for name in record.__dataclass_fields__]
