"""NumPy reference of the sensors in native/engine/sensors.c, with the same sequence of random numbers."""

import math
from dataclasses import dataclass, field

import numpy as np

from spidar_gym.robot import GRAVITY, N_JOINTS, N_ROTORS
from spidar_gym.sim.sensors import (
    DRIFT_SECONDS,
    DROPOUT_SECONDS,
    ENCODER_PERIOD,
    ENCODER_STEPS,
    IMU_PERIOD,
    IMU_POSITION_B,
    POSE_PERIOD,
    SensorConfig,
)
from spidar_gym.so3 import cross, exp, matrix_to_quat, quat_to_matrix
from spidar_gym.state import IMU_SAMPLES, POSE_FRAMES, Measurement, RobotState


@dataclass
class SensorMemory:
    """State of the sensors during an episode."""

    gyro_bias: np.ndarray
    """Bias of the gyroscope [rad/s]."""
    accelerometer_bias: np.ndarray
    """Bias of the accelerometer [m/s²]."""
    drift: np.ndarray
    """Slow error of position [m] and attitude [rad], shape (6,)."""
    velocity_w: np.ndarray
    """Velocity of the inertial unit at its last sample [m/s]."""
    silent_until: float = 0.0
    """End of the drop-out of the motion capture [s]."""
    next_pose: float = 0.0
    """Time of the next motion-capture frame [s]."""
    next_encoder: float = 0.0
    """Time of the next servo reading [s]."""
    frames: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    """Frames that have not arrived yet: time, position, attitude."""
    imu: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    """Samples since the last control tick: time, gyroscope, accelerometer."""
    encoder_time: float = 0.0
    """Time of the last servo reading [s]."""
    angles: np.ndarray = field(default_factory=lambda: np.zeros(N_JOINTS + 2 * N_ROTORS))
    """Angles indicated by the servos [rad]."""
    torque: np.ndarray = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Torque reported by the joint servos [Nm]."""


class Sensors:
    """Sensors of one robot; `sample` is called at every sampling instant of the inertial unit."""

    def __init__(self, config: SensorConfig, offset: np.ndarray | float = 0.0) -> None:
        """Store the noise levels, and the true minus indicated angles of joints, then vectoring servos (32,) [rad]."""
        self.config, self._offset = config, offset

    def start(self, state: RobotState, rng: np.random.Generator) -> SensorMemory:
        """Switch the sensors on in a state; samples biases and drifts."""
        c = self.config
        scale = c.factor * np.repeat([c.position_drift, c.rotation_drift], 3)
        memory = SensorMemory(
            gyro_bias=c.factor * c.gyro_bias * rng.standard_normal(3),
            accelerometer_bias=c.factor * c.accelerometer_bias * rng.standard_normal(3),
            drift=scale * rng.standard_normal(6),
            velocity_w=_imu_velocity(state, quat_to_matrix(state.quat_wb)),
        )
        self.sample(memory, state, rng)
        # The robot is assumed to have rested in this state: its first frame has arrived.
        memory.frames = [(state.time - c.latency, p, q) for _, p, q in memory.frames]
        return memory

    def sample(self, memory: SensorMemory, state: RobotState, rng: np.random.Generator) -> None:
        """Measure a true state, every 5 ms; updates `memory`."""
        c, time = self.config, state.time
        R = quat_to_matrix(state.quat_wb)
        velocity = _imu_velocity(state, R)
        acceleration = (velocity - memory.velocity_w) / IMU_PERIOD
        memory.velocity_w = velocity
        acceleration[2] += GRAVITY
        noise = c.factor * rng.standard_normal(9)
        density = 1.0 / math.sqrt(IMU_PERIOD)
        gyro = state.omega_b + memory.gyro_bias + c.gyro_noise * density * noise[:3]
        shake = math.hypot(c.accelerometer_noise * density, c.vibration)
        force = acceleration @ R + memory.accelerometer_bias + shake * noise[3:6]
        memory.imu = [*memory.imu[1 - IMU_SAMPLES :], (time, gyro, force)]
        if time >= memory.next_pose - 1e-9:
            memory.next_pose += POSE_PERIOD
            decay = math.exp(-POSE_PERIOD / DRIFT_SECONDS)
            size = c.factor * math.sqrt(1.0 - decay * decay) * np.repeat([c.position_drift, c.rotation_drift], 3)
            memory.drift = decay * memory.drift + size * rng.standard_normal(6)
            white = c.factor * rng.standard_normal(6)
            if rng.random() < c.dropout:
                memory.silent_until = time + DROPOUT_SECONDS
            if time >= memory.silent_until - 1e-9:
                position = state.position_w + R @ IMU_POSITION_B + memory.drift[:3] + c.position_noise * white[:3]
                attitude = R @ exp(memory.drift[3:] + c.rotation_noise * white[3:])
                memory.frames = [*memory.frames, (time, position, matrix_to_quat(attitude))]
        if time >= memory.next_encoder - 1e-9:
            memory.next_encoder += ENCODER_PERIOD
            angles = np.concatenate([state.joint_position, state.vectoring.reshape(-1)]) - self._offset
            counts = angles / ENCODER_STEPS + c.factor * c.encoder_noise * rng.standard_normal(len(angles))
            memory.angles = np.round(counts) * ENCODER_STEPS
            memory.torque = state.joint_torque * (1.0 + c.factor * c.torque_noise * rng.standard_normal(N_JOINTS))
            memory.encoder_time = time

    def read(self, memory: SensorMemory, time: float) -> Measurement:
        """Return the measurements that have arrived by a control tick at `time` [s]; each is returned once."""
        due = [frame for frame in memory.frames if frame[0] + self.config.latency <= time + 1e-9][-POSE_FRAMES:]
        memory.frames = [frame for frame in memory.frames if frame[0] + self.config.latency > time + 1e-9]
        imu, memory.imu = memory.imu, []
        pose_time, positions, quats = np.zeros(POSE_FRAMES), np.zeros((POSE_FRAMES, 3)), np.zeros((POSE_FRAMES, 4))
        for k, (at, position, quat) in enumerate(due):
            pose_time[k], positions[k], quats[k] = at, position, quat
        imu_time, gyro, force = np.zeros(IMU_SAMPLES), np.zeros((IMU_SAMPLES, 3)), np.zeros((IMU_SAMPLES, 3))
        for k, (at, omega, acceleration) in enumerate(imu):
            imu_time[k], gyro[k], force[k] = at, omega, acceleration
        return Measurement(
            time, len(due), pose_time, positions, quats, len(imu), imu_time, gyro, force,
            memory.encoder_time, memory.angles[:N_JOINTS], memory.torque, memory.angles[N_JOINTS:].reshape(N_ROTORS, 2),
        )  # fmt: skip


def _imu_velocity(state: RobotState, R_wb: np.ndarray) -> np.ndarray:
    """Velocity of the inertial unit, world [m/s]."""
    return state.velocity_w + R_wb @ cross(state.omega_b, IMU_POSITION_B)
