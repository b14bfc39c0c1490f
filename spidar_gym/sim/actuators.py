"""Parameters of the actuators: gain, misalignment, lag, delay, loss, noise, stiffness, friction, backlash, offsets.

The engine reads them: body.c writes those that MuJoCo simulates into the model, plant.c simulates the rest.
"""

from dataclasses import dataclass, field, fields

import numpy as np

from spidar_gym.arrays import constant
from spidar_gym.errors import InvalidValueError, require_arrays, require_flag, require_within
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT, RobotSpec

NOISE_BANDWIDTH = 10.0
"""Corner frequency of the thrust noise [Hz]."""
STICKING = 50.0
"""Stiffness with which dry friction holds a vectoring axis, three times its servo's [Nm/rad] [chosen]."""


@dataclass(frozen=True)
class ActuatorConfig:
    """Parameters of the simulated actuators; the defaults are those of the robot description."""

    thrust_gain: float = 1.0
    """Thrust over commanded thrust, all modules."""
    module_gain: np.ndarray = field(default_factory=lambda: constant(1.0, N_ROTORS))
    """Thrust over commanded thrust of each module, times `thrust_gain`."""
    duct_imbalance: np.ndarray = field(default_factory=lambda: constant(0.0, N_ROTORS))
    """(T_left − T_right) / λ of each module; causes a torque about the module's x axis."""
    thrust_tilt: np.ndarray = field(default_factory=lambda: constant(0.0, N_ROTORS, 2))
    """Tilt of the thrust about the module's x and y axes [rad]."""
    thrust_offset: np.ndarray = field(default_factory=lambda: constant(0.0, N_ROTORS, 2))
    """Offset of the thrust's point of attack from the module's centre, x and y [m]."""
    max_thrust: float = ROBOT.max_thrust
    """Largest thrust of a module [N]."""
    battery: bool = False
    """Whether the largest thrust falls with the voltage of the battery."""
    battery_spent: float = 0.0
    """Share of the battery's usable energy that is spent at the reset, 0 … 1 [chosen]."""
    board_scaling: bool = False
    """Whether the flight board scales all thrusts by one factor when one exceeds the largest thrust [JSK]."""
    thrust_lag: float = ROBOT.thrust_lag
    """Time constant of a rising thrust [s]."""
    spin_down: float = 1.0
    """Time constant of a falling thrust over that of a rising one."""
    thrust_noise: float = 0.0
    """Standard deviation of each module's thrust noise, with a bandwidth of 10 Hz [N]."""
    delay: float = 0.0
    """Delay between a command and the actuators, rounded to physics steps [s]."""
    vectoring_delay: float = 0.0
    """Additional delay of the vectoring servos, rounded to physics steps [s]."""
    jitter: float = 0.0
    """Largest additional delay of a command, uniform from 0 on, rounded to physics steps [s]; up to 0.01 [chosen]."""
    loss: float = 0.0
    """Probability that a command is lost; the actuators then keep the last one that arrived; up to 0.05 [chosen]."""
    joint_kp: float = ROBOT.joint_kp
    """Stiffness of the joint servos [Nm/rad]."""
    joint_kd: float = ROBOT.joint_kd
    """Damping of the joint servos [Nm s/rad]."""
    servo_stiffness: np.ndarray = field(default_factory=lambda: constant(1.0, N_JOINTS))
    """Factor on the stiffness of each joint servo."""
    joint_speed_factor: float = 1.0
    """Actual speed limit of the joint servos over the commanded one."""
    servo_speed: np.ndarray = field(default_factory=lambda: constant(1.0, N_JOINTS))
    """Factor on the speed limit of each joint servo, times `joint_speed_factor`; 0.85 … 1.15 [chosen]."""
    max_joint_torque: float = ROBOT.max_joint_torque
    """Largest torque that the joint servos reach [Nm]."""
    joint_friction: float = ROBOT.joint_friction
    """Dry friction of a joint [Nm]."""
    joint_damping: float = ROBOT.joint_damping
    """Viscous friction of a joint [Nm s/rad]."""
    backlash: float = 0.0
    """Half of a joint's play, within which the servo exerts no torque [rad]."""
    joint_offset: np.ndarray = field(default_factory=lambda: constant(0.0, N_JOINTS))
    """True minus indicated joint angle, the zero offset of the encoder [rad]."""
    vectoring_kp: float = ROBOT.vectoring_kp
    """Stiffness of the vectoring servos [Nm/rad]."""
    vectoring_friction: float = 0.0
    """Dry friction of a vectoring axis [Nm]; up to 0.1, of the servos' 1.5 [chosen]."""
    vectoring_backlash: float = 0.0
    """Half of a vectoring axis' play, within which the servo exerts no torque [rad]; up to 0.01 [chosen]."""
    vectoring_offset: np.ndarray = field(default_factory=lambda: constant(0.0, N_ROTORS, 2))
    """True minus indicated vectoring angle [rad]."""

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_arrays(self)
        require_flag(battery=self.battery, board_scaling=self.board_scaling)
        require_within(0.0, 1.0, battery_spent=self.battery_spent, loss=self.loss)
        least = (
            "thrust_noise", "delay", "vectoring_delay", "jitter", "joint_kd", "joint_friction", "joint_damping",
            "backlash", "vectoring_friction", "vectoring_backlash",
        )  # fmt: skip
        positive = (
            "thrust_gain", "module_gain", "servo_stiffness", "servo_speed", "max_thrust", "thrust_lag", "spin_down",
            "joint_kp", "joint_speed_factor", "max_joint_torque", "vectoring_kp",
        )  # fmt: skip
        for f in fields(self):
            value = np.asarray(getattr(self, f.name), float)
            if f.name in least and value < 0.0:
                raise InvalidValueError(f.name, getattr(self, f.name), "a number of at least 0")
            if f.name in positive and (value <= 0.0).any():
                raise InvalidValueError(f.name, getattr(self, f.name), "a number above 0")

    @property
    def has_draws(self) -> bool:
        """Whether the actuators draw random numbers: noise of the thrusts, jitter and loss of commands."""
        return self.thrust_noise > 0.0 or self.jitter > 0.0 or self.loss > 0.0

    @classmethod
    def of(cls, robot: RobotSpec) -> "ActuatorConfig":
        """Return the parameters of a described robot."""
        return cls(
            max_thrust=robot.max_thrust, thrust_lag=robot.thrust_lag, joint_kp=robot.joint_kp, joint_kd=robot.joint_kd,
            max_joint_torque=robot.max_joint_torque, joint_friction=robot.joint_friction,
            joint_damping=robot.joint_damping, vectoring_kp=robot.vectoring_kp,
        )  # fmt: skip
