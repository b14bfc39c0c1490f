"""The health of the simulated robot as its messages: battery, servos, motors. Constants of servos are guesses."""

import numpy as np

from spidar_gym.arrays import JointVector, RotorVector, Vectoring
from spidar_gym.native.formulas import max_thrust
from spidar_gym.onboard.health import HEALTH_TOPICS, MOTOR_FULL, N_SERVOS, SERVO_STALL
from spidar_gym.onboard.messages import Message
from spidar_gym.robot import N_ROTORS, ROBOT

STALL_TORQUE = 6.6
"""Stall torque of a joint servo behind its belt [Nm] [ROBOTIS]; that of φ and θ is the robot's largest."""
AMBIENT, STALL_RISE, WARM_UP = 25.0, 140.0, 300.0
"""Temperature of the air [°C]; final rise of a servo at its stall torque [K]; time constant [s]. All are guesses."""
OVERHEATED, OVERHEAT_BIT = 60.0, 0x04
"""Temperature at which a servo reports an error [°C] [JSK], and the bit of this error [ROBOTIS]."""
COUNTS = (7.6699e-4, 1.534e-3, 9.20388e-4, 1.15048e-3)
"""Angle per encoder count of joint yaw, joint pitch, φ and θ [rad] [JSK]; counts decrease with the angle."""
MIDDLE_COUNT = 2047
"""Encoder count at the angle 0 [JSK]."""
DUTY = (0.532614, 0.0854219, 0.2610449, -0.1543049, 0.0253983)
"""Duty of a motor over a tenth of its fan's thrust [N], coefficients from the constant on, at `DUTY_VOLTAGE` [JSK]."""
DUTY_VOLTAGE, DUTY_LEAST, DUTY_MOST = 25.2, 0.54, 0.92
"""Voltage of these coefficients [V], and least and largest duty of an armed board [JSK]."""
DISARMED = 0.5
"""Duty of a disarmed board [JSK]."""


def motor_duty(thrust: RotorVector, volts: float, *, armed: bool = True) -> RotorVector:
    """Compute the duty of each module's two motors, shape (8,), for its thrust [N] at a voltage [V]."""
    if not armed:
        return np.full(N_ROTORS, DISARMED)
    fan = 0.05 * thrust * (DUTY_VOLTAGE / volts) ** 1.5
    # The polynomial is not monotonic above the largest thrust.
    fan = np.minimum(fan, 0.05 * max_thrust(DUTY_VOLTAGE))
    return np.clip(np.polynomial.polynomial.polyval(fan, DUTY), DUTY_LEAST, DUTY_MOST)


def interleaved(joints: JointVector, vectoring: Vectoring) -> np.ndarray:
    """Arrange values of the joints and of φ and θ by servo, shape (32,)."""
    return np.concatenate([joints.reshape(N_ROTORS, 2), vectoring.reshape(N_ROTORS, 2)], axis=1).reshape(-1)


class Health:
    """Temperature of the servos, and the messages about servos, motors and battery."""

    def __init__(self) -> None:
        """Begin with servos as warm as the air."""
        self.temperature = np.full(N_SERVOS, AMBIENT)
        """Temperature of each servo [°C]."""
        self.load = np.zeros(N_SERVOS)
        """Torque of each servo over its stall torque."""

    def step(self, torque: JointVector, vectoring_torque: Vectoring, dt: float) -> None:
        """Advance the temperatures: a first-order response to the square of the torque.

        Args:
            torque: Torque of the joints [Nm].
            vectoring_torque: Torque of φ and θ, (8, 2) [Nm].
            dt: Time since the last step [s].
        """
        self.load = interleaved(torque / STALL_TORQUE, vectoring_torque / ROBOT.max_vectoring_torque)
        final = AMBIENT + STALL_RISE * self.load**2
        self.temperature = self.temperature + dt / WARM_UP * (final - self.temperature)

    def servos(self, time: float, joints: JointVector, vectoring: Vectoring) -> Message:
        """Return the message of the servos at measured angles [rad]."""
        counts = np.rint(MIDDLE_COUNT - interleaved(joints, vectoring) / np.tile(COUNTS, N_ROTORS))
        values = {
            "index": np.arange(N_SERVOS), "angle": np.clip(counts, -32768, 32767).astype(int),
            "temp": np.rint(self.temperature).astype(int), "load": np.rint(SERVO_STALL * self.load).astype(int),
            "error": np.where(self.temperature > OVERHEATED, OVERHEAT_BIT, 0),
        }  # fmt: skip
        return Message(HEALTH_TOPICS["servos"][0], time, values)


def motors(time: float, thrust: RotorVector, volts: float, *, armed: bool) -> Message:
    """Return the message of the motors for commanded thrusts [N] at a voltage [V]."""
    duty = motor_duty(thrust, volts, armed=armed)
    return Message(HEALTH_TOPICS["motors"][0], time, {"motor_value": np.rint(MOTOR_FULL * duty).astype(int)})
