"""State estimator: computes the controller's state from motion capture, inertial unit and encoders.

The inertial unit is integrated at its own rate (strapdown). Each motion capture frame corrects the estimate with fixed
gains, by its error against the past estimate of the time at which the frame was taken. The estimator runs on the robot
and does not depend on a simulator.
"""

from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import Matrix3, RotorVector, Vector3
from spidar_gym.robot import GRAVITY, N_JOINTS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.so3 import cross, exp, log, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Measurement, RobotState

HISTORY = 32
"""Number of past estimates kept for delayed frames: 160 ms."""


@dataclass(frozen=True)
class EstimatorConfig:
    """Gains of the corrections."""

    position: float = 0.27
    """Share of a frame's position error that is corrected immediately."""
    velocity: float = 3.5
    """Correction of the velocity per position error of a frame [1/s]."""
    accelerometer: float = 6.0
    """Correction of the accelerometer bias per position error of a frame [1/s²]."""
    attitude: float = 0.1
    """Share of a frame's attitude error that is corrected immediately."""
    gyro: float = 0.25
    """Correction of the gyroscope bias per attitude error of a frame [1/s]."""
    joint_bandwidth: float = 40.0
    """Bandwidth of the joint velocity filter [rad/s]; one encoder count per reading is 0.08 rad/s. A lower bandwidth
    reduces noise, but its lag appears as motion of the CoG: at 15 rad/s the error at 1 rad/s joint speed doubles."""
    vectoring_bandwidth: float = 60.0
    """Bandwidth of the vectoring velocity filter [rad/s]."""


@dataclass
class EstimatorMemory:
    """The estimate and its history."""

    time: float
    """Time of the estimate [s]."""
    R_wb: Matrix3
    """Attitude of the torso."""
    position_w: Vector3
    """Position of the inertial unit [m]."""
    velocity_w: Vector3
    """Velocity of the inertial unit [m/s]."""
    omega_b: Vector3
    """Angular velocity, torso axes [rad/s]."""
    gyro_bias: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Bias of the gyroscope [rad/s]."""
    accelerometer_bias: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Bias of the accelerometer [m/s²]."""
    past_time: np.ndarray = field(default_factory=lambda: np.full(HISTORY, -np.inf))
    """Times of the past estimates, oldest first [s]."""
    past_position_w: np.ndarray = field(default_factory=lambda: np.zeros((HISTORY, 3)))
    """Past positions of the inertial unit [m]."""
    past_R_wb: np.ndarray = field(default_factory=lambda: np.tile(np.eye(3), (HISTORY, 1, 1)))
    """Past attitudes of the torso."""
    encoder_time: float = 0.0
    """Time of the latest encoder reading [s]."""
    angles: np.ndarray = field(default_factory=lambda: np.zeros(N_JOINTS + 2 * N_ROTORS))
    """Filtered joint and vectoring angles at that time [rad]."""
    rates: np.ndarray = field(default_factory=lambda: np.zeros(N_JOINTS + 2 * N_ROTORS))
    """Rates of these angles [rad/s]."""


class Estimator:
    """Estimates states from measurements; owns the memory of one robot."""

    def __init__(self, config: EstimatorConfig | None = None, robot: RobotSpec = ROBOT) -> None:
        """Set the gains, and the robot, which defines the position of the flight controller in the torso."""
        self.config = config or EstimatorConfig()
        bandwidth = np.repeat([self.config.joint_bandwidth, self.config.vectoring_bandwidth], (N_JOINTS, 2 * N_ROTORS))
        self._bandwidth, self._lever_b = bandwidth, np.array(robot.flight_controller)
        self.memory: EstimatorMemory

    def reset(self, state: RobotState) -> None:
        """Start from a known state at rest."""
        R = quat_to_matrix(state.quat_wb)
        position = state.position_w + R @ self._lever_b
        memory = EstimatorMemory(state.time, R, position, state.velocity_w.copy(), state.omega_b.copy())
        memory.past_time[-1], memory.past_position_w[-1], memory.past_R_wb[-1] = state.time, position, R
        memory.encoder_time = state.time
        memory.angles = np.concatenate([state.joint_position, state.vectoring.reshape(-1)])
        self.memory = memory

    def update(self, measurement: Measurement, thrust: RotorVector) -> RobotState:
        """Estimate the state at a control tick.

        Args:
            measurement: Sensor data since the last tick.
            thrust: Thrust last commanded [N]; the robot does not measure it.
        """
        memory = self.memory
        for k in range(measurement.imu_count):
            self._predict(measurement.imu_time[k], measurement.gyro_b[k], measurement.specific_force_b[k])
        for k in range(measurement.pose_count):
            R = quat_to_matrix(measurement.pose_quat_wb[k])
            self._correct(measurement.pose_time[k], measurement.pose_position_w[k], R)
        if (dt := measurement.encoder_time - memory.encoder_time) > 1e-9:
            # A critically damped observer of constant rates [alpha-beta filter].
            read = np.concatenate([measurement.joint_position, measurement.vectoring.reshape(-1)])
            decay = np.exp(-self._bandwidth * dt)
            guess = memory.angles + dt * memory.rates
            error = read - guess
            memory.angles = guess + (1.0 - decay * decay) * error
            memory.rates = memory.rates + (1.0 - decay) ** 2 / dt * error
            memory.encoder_time = measurement.encoder_time
        angles = memory.angles + (measurement.time - memory.encoder_time) * memory.rates
        return RobotState(
            time=measurement.time,
            position_w=memory.position_w - memory.R_wb @ self._lever_b,
            quat_wb=matrix_to_quat(memory.R_wb),
            velocity_w=memory.velocity_w - memory.R_wb @ cross(memory.omega_b, self._lever_b),
            omega_b=memory.omega_b.copy(),
            joint_position=angles[:N_JOINTS],
            joint_velocity=memory.rates[:N_JOINTS].copy(),
            vectoring=angles[N_JOINTS:].reshape(N_ROTORS, 2),
            vectoring_velocity=memory.rates[N_JOINTS:].reshape(N_ROTORS, 2).copy(),
            thrust=thrust.copy(),
            joint_torque=measurement.joint_torque.copy(),
        )

    def _predict(self, time: float, gyro: Vector3, force: Vector3) -> None:
        """Integrate one sample; the accelerometer measures the mean since the previous sample."""
        memory = self.memory
        dt = time - memory.time
        if dt <= 0.0:
            return
        omega = gyro - memory.gyro_bias
        memory.R_wb = memory.R_wb @ exp(0.5 * dt * (omega + memory.omega_b))
        acceleration = memory.R_wb @ (force - memory.accelerometer_bias)
        acceleration[2] -= GRAVITY
        memory.position_w = memory.position_w + dt * memory.velocity_w + 0.5 * dt * dt * acceleration
        memory.velocity_w = memory.velocity_w + dt * acceleration
        memory.omega_b, memory.time = omega, time
        for past, now in (
            (memory.past_time, time), (memory.past_position_w, memory.position_w), (memory.past_R_wb, memory.R_wb)
        ):  # fmt: skip
            past[:-1] = past[1:]
            past[-1] = now

    def _correct(self, time: float, position_w: Vector3, R_wb: Matrix3) -> None:
        """Correct the estimate, and its history since `time`, with a frame taken at `time`."""
        c, memory = self.config, self.memory
        k = int(np.argmin(np.abs(memory.past_time - time)))
        error = position_w - memory.past_position_w[k]
        turn = log(R_wb @ memory.past_R_wb[k].T)
        memory.velocity_w = memory.velocity_w + c.velocity * error
        memory.accelerometer_bias = memory.accelerometer_bias - c.accelerometer * (error @ memory.R_wb)
        memory.gyro_bias = memory.gyro_bias - c.gyro * (turn @ memory.R_wb)
        # The history since the frame is corrected too, so that later frames do not correct the same error again. The
        # velocity error has changed the position since then.
        ages = memory.past_time[k:] - memory.past_time[k]
        memory.past_position_w[k:] += (c.position + c.velocity * ages)[:, None] * error
        memory.past_R_wb[k:] = exp(c.attitude * turn) @ memory.past_R_wb[k:]
        memory.position_w, memory.R_wb = memory.past_position_w[-1].copy(), memory.past_R_wb[-1].copy()
