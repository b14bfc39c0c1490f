"""The sensors of the real robot: motion capture, inertial unit and encoders, with their rates, noise and latency.

native/engine/sensors.c simulates the measurements.
"""

from dataclasses import dataclass

import numpy as np

from spidar_gym.errors import InvalidValueError, require_not_negative
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT

POSE_PERIOD, IMU_PERIOD, ENCODER_PERIOD = 0.010, 0.005, 0.020
"""Periods of motion capture (100 Hz), inertial unit (200 Hz) and servo bus (50 Hz) [JSK] [s]."""
YAW_STEP, PITCH_STEP = 0.000767, 0.001534
"""One count of the joint encoders [rad] [JSK]."""
ROLL_STEP, TILT_STEP = 0.00092, 0.00115
"""One count of the encoders of φ and θ [rad] [JSK]."""
IMU_POSITION_B = np.array(ROBOT.flight_controller)
"""Point that motion capture and inertial unit measure, torso axes [m]."""


@dataclass(frozen=True)
class SensorConfig:
    """Noise of the sensors; values of a motion capture of the Vicon class [JSK] and of an ADIS16448 [RotorS]."""

    latency: float = 0.010
    """Latency of a frame of the motion capture [s]."""
    position_noise: float = 1e-3
    """Standard deviation of a position [m]."""
    rotation_noise: float = 1e-3
    """Standard deviation of an attitude [rad]."""
    position_drift: float = 1e-3
    """Standard deviation of the slow error of positions, with a correlation time of 10 s [m]."""
    rotation_drift: float = 1e-3
    """Standard deviation of the slow error of attitudes, with a correlation time of 10 s [rad]."""
    dropout: float = 0.002
    """Probability that a drop-out of 50 ms begins at a frame."""
    gyro_noise: float = 3.4e-4
    """Density of the gyroscope's noise [rad/s/√Hz]."""
    gyro_bias: float = 8.7e-3
    """Standard deviation of the gyroscope's bias at switch-on [rad/s]."""
    accelerometer_noise: float = 4e-3
    """Density of the accelerometer's noise [m/s²/√Hz]."""
    accelerometer_bias: float = 0.196
    """Standard deviation of the accelerometer's bias at switch-on [m/s²]."""
    vibration: float = 0.5
    """Standard deviation of the accelerometer's error from vibration of the rotors [m/s²] [estimate]."""
    encoder_noise: float = 0.5
    """Standard deviation of an encoder before rounding, in counts."""
    torque_noise: float = 0.1
    """Relative error of a servo's reported torque."""
    factor: float = 1.0
    """Factor on all noise, drift and bias above, but not on the encoders' steps."""

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_not_negative(**vars(self))
        if self.latency > 0.1:
            raise InvalidValueError("latency", self.latency, "within 0 … 0.1 s: older frames are useless")
        if self.dropout > 1.0:
            raise InvalidValueError("dropout", self.dropout, "a probability within 0 … 1")


DRIFT_SECONDS = 10.0
"""Correlation time of the motion capture's slow errors [s]."""
DROPOUT_SECONDS = 0.05
"""Duration of a drop-out of the motion capture [s]."""
ENCODER_STEPS = np.concatenate(
    [np.tile([YAW_STEP, PITCH_STEP], N_JOINTS // 2), np.tile([ROLL_STEP, TILT_STEP], N_ROTORS)]
)
"""Encoder counts of the joints, then of the vectoring angles [rad]."""
