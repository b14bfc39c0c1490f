"""The flight controller board: checks thrust commands and lands the robot when they fail [robot's firmware]."""

import math
from dataclasses import dataclass

import numpy as np

from spidar_gym.onboard.message_types import ARM_OFF, ARM_ON, FORCE_LANDING
from spidar_gym.robot import N_ROTORS, ROBOT
from spidar_gym.so3 import euler_angles

COMMAND_TIMEOUT = 0.5
"""The board lands when it has received no thrust command for this long [s]."""
TILT_LIMIT = 1.0
"""Roll or pitch above which the board lands [rad]."""
LANDING_RATE = 1.25
"""Rate at which the mean thrust falls in a forced landing [N/s]."""
LANDING_THRUST = 7.0
"""Least mean thrust of a forced landing [N]; commands below it are ignored during the landing."""
ATTITUDE_GAINS = (15.0, 5.0)
"""Roll and pitch gains of the board in a forced landing, on angle [1/s²] and rate [1/s]. Yaw is not controlled: rotors
that point up have almost no torque about it, and a yaw command would use the thrust that holds the attitude."""


@dataclass
class Board:
    """Board that applies thrust commands while armed, and lands when they stop or the robot tips over."""

    armed: bool = False
    """Whether the rotors turn."""
    landing: bool = False
    """Whether the landing is forced."""
    reason: str = ""
    """Why the board lands."""
    heard: float = math.inf
    """Time of the last command; infinite before the first [s]."""
    tilt: float = 0.0
    """Roll or pitch, the larger [rad]."""

    def __post_init__(self) -> None:
        """Set all thrusts to zero."""
        self.base = np.zeros(N_ROTORS)

    def command(self, thrust: np.ndarray, time: float) -> None:
        """Store thrusts of the modules [N]; ignored while disarmed, or unless there are eight."""
        if len(thrust) != N_ROTORS or not self.armed:
            return
        self.heard = time
        if not np.isfinite(thrust).all() or (self.landing and float(np.mean(thrust)) < LANDING_THRUST):
            return
        self.base = np.maximum(np.asarray(thrust, float), 0.0)

    def configure(self, command: int) -> bool:
        """Execute a configuration command; return whether it is a valid one."""
        if command == ARM_ON:
            self.armed = True
        elif command == ARM_OFF:
            self.armed, self.landing, self.reason, self.heard = False, False, "", math.inf
            self.base = np.zeros(N_ROTORS)
        elif command == FORCE_LANDING:
            self._land("commanded")
        else:
            return False
        return True

    def _land(self, reason: str) -> None:
        if self.armed and not self.landing:
            self.landing, self.reason = True, reason

    def tick(self, time: float, dt: float, R_wb: np.ndarray, omega_b: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """Compute the thrusts that the rotors receive.

        Args:
            time: Current time [s].
            dt: Time since the last tick [s].
            R_wb: Attitude.
            omega_b: Angular velocity, torso axes [rad/s].
            torques: Roll and pitch acceleration per module thrust, shape (2, 8) [rad/s²/N].

        Returns:
            Thrust of the modules [N].
        """
        if not self.armed:
            return np.zeros(N_ROTORS)
        roll, pitch, _ = euler_angles(R_wb).tolist()
        self.tilt = max(abs(roll), abs(pitch))
        if self.tilt > TILT_LIMIT:
            self._land("tilt")
        if time - self.heard > COMMAND_TIMEOUT:
            self._land("no command for 0.5 s")
        if not self.landing:
            return np.minimum(self.base, ROBOT.max_thrust)
        mean = float(self.base.mean())
        if mean > LANDING_THRUST:
            self.base = self.base * (max(LANDING_THRUST, mean - LANDING_RATE * dt) / mean)
        angle, rate = ATTITUDE_GAINS
        wish = -angle * np.array([roll, pitch]) - rate * omega_b[:2]
        thrust = np.maximum(self.base + np.linalg.pinv(torques) @ wish, 0.0)
        # All thrusts are scaled by one factor, so that their ratios, which determine the torque, do not change.
        return thrust * min(1.0, ROBOT.max_thrust / max(float(thrust.max()), 1e-9))
