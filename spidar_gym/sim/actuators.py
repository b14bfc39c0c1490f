"""What the actuators really do: gain, misalignment, lag, delay, noise, stiffness, friction, backlash, offsets."""

import math
from dataclasses import dataclass, field, fields
from functools import cached_property

import mujoco
import numpy as np

from spidar_gym.arrays import constant
from spidar_gym.errors import InvalidValueError, require_arrays
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS, ROBOT, ROTOR_SITES
from spidar_gym.sim.scene import TIMESTEP

NOISE_BANDWIDTH = 10.0
"""Corner frequency of the thrust noise [Hz]."""


@dataclass(frozen=True)
class ActuatorConfig:
    """How far the actuators are from the robot description; the defaults are the description."""

    thrust_gain: float = 1.0
    """Thrust over commanded thrust, all modules."""
    module_gain: np.ndarray = field(default_factory=lambda: constant(1.0, N_ROTORS))
    """Thrust over commanded thrust of each module, times `thrust_gain`."""
    duct_imbalance: np.ndarray = field(default_factory=lambda: constant(0.0, N_ROTORS))
    """(T_left − T_right) / λ of each module; it turns the module about x."""
    thrust_tilt: np.ndarray = field(default_factory=lambda: constant(0.0, N_ROTORS, 2))
    """Tilt of the thrust about the module's x and y axes [rad]."""
    thrust_offset: np.ndarray = field(default_factory=lambda: constant(0.0, N_ROTORS, 2))
    """Point of attack off the module's centre, x and y [m]."""
    max_thrust: float = ROBOT.max_thrust
    """Largest thrust of a module [N]."""
    battery: bool = False
    """Whether the largest thrust falls with the voltage of a battery that is full at reset."""
    thrust_lag: float = ROBOT.thrust_lag
    """Time constant of a rising thrust [s]."""
    spin_down: float = 1.0
    """Time constant of a falling thrust over that of a rising one."""
    thrust_noise: float = 0.0
    """Standard deviation of each module's thrust [N], 10 Hz wide."""
    delay: float = 0.0
    """Between a command and the actuators [s]; rounded to physics steps."""
    vectoring_delay: float = 0.0
    """More delay of the vectoring servos [s]; rounded to physics steps."""
    joint_kp: float = ROBOT.joint_kp
    """Stiffness of the joint servos [Nm/rad]."""
    joint_kd: float = ROBOT.joint_kd
    """Damping of the joint servos [Nm s/rad]."""
    servo_stiffness: np.ndarray = field(default_factory=lambda: constant(1.0, N_JOINTS))
    """Factor on the stiffness of each joint servo."""
    joint_speed_factor: float = 1.0
    """The servos' speed limit over the one that they are told."""
    max_joint_torque: float = ROBOT.max_joint_torque
    """Torque that the joint servos really reach [Nm]."""
    joint_friction: float = ROBOT.joint_friction
    """Dry friction of a joint [Nm]."""
    joint_damping: float = ROBOT.joint_damping
    """Viscous friction of a joint [Nm s/rad]."""
    backlash: float = 0.0
    """Half of the play of a joint [rad]: so far a link moves before its servo resists."""
    joint_offset: np.ndarray = field(default_factory=lambda: constant(0.0, N_JOINTS))
    """True minus indicated joint angle [rad]: an encoder whose zero is off."""
    vectoring_kp: float = ROBOT.vectoring_kp
    """Stiffness of the vectoring servos [Nm/rad]."""
    vectoring_offset: np.ndarray = field(default_factory=lambda: constant(0.0, N_ROTORS, 2))
    """True minus indicated vectoring angle [rad]."""

    def __post_init__(self) -> None:
        """Refuse what no actuator does."""
        require_arrays(self)
        least = dict.fromkeys(
            ("thrust_noise", "delay", "vectoring_delay", "joint_kd", "joint_friction", "joint_damping", "backlash"), 0.0
        )
        positive = (
            "thrust_gain", "module_gain", "servo_stiffness", "max_thrust", "thrust_lag", "spin_down", "joint_kp",
            "joint_speed_factor", "max_joint_torque", "vectoring_kp",
        )  # fmt: skip
        for f in fields(self):
            value = np.asarray(getattr(self, f.name), float)
            if f.name in least and value < 0.0:
                raise InvalidValueError(f.name, getattr(self, f.name), "a number of at least 0")
            if f.name in positive and (value <= 0.0).any():
                raise InvalidValueError(f.name, getattr(self, f.name), "a number above 0")

    @cached_property
    def gain(self) -> np.ndarray:
        """Thrust over commanded thrust of each module."""
        return self.thrust_gain * self.module_gain

    @cached_property
    def offsets(self) -> np.ndarray:
        """True minus indicated value of all actuators: thrusts, joints, vectoring angles."""
        return np.concatenate([np.zeros(N_ROTORS), self.joint_offset, self.vectoring_offset.reshape(-1)])

    @cached_property
    def delay_steps(self) -> tuple[int, int]:
        """Physics steps between a command and the actuators: thrusts and joints, vectoring servos."""
        delay = round(self.delay / TIMESTEP)
        return delay, delay + round(self.vectoring_delay / TIMESTEP)

    @property
    def asymmetric(self) -> bool:
        """Whether anything depends on a direction: falling thrusts lag otherwise, or joints have play."""
        return self.backlash > 0.0 or self.spin_down != 1.0

    def apply(self, model: mujoco.MjModel, joint_speed: float) -> None:  # pyright: ignore[reportAttributeAccessIssue]
        """Write everything that MuJoCo can do by itself into the model; nothing of an earlier configuration stays."""
        rotors, joints, gimbals = (
            np.array([model.actuator(name).id for name in names]) for names in (ROTOR_SITES, JOINT_NAMES, GIMBAL_NAMES)
        )
        tilt_x, tilt_y = self.thrust_tilt.T
        x, y = self.thrust_offset.T
        gear = np.zeros((N_ROTORS, 6))
        gear[:, :3] = np.stack([np.sin(tilt_y), -np.sin(tilt_x) * np.cos(tilt_y), np.cos(tilt_x) * np.cos(tilt_y)], 1)
        # Torque of the force at (x, y, 0), and of two ducts at ± d on the y axis that do not pull alike.
        gear[:, 3:] = np.cross(np.stack([x, y, np.zeros(N_ROTORS)], 1), gear[:, :3])
        gear[:, 3] += ROBOT.duct_offset_y * self.duct_imbalance
        model.actuator_gear[rotors] = self.gain[:, None] * gear
        model.actuator_ctrlrange[rotors, 1] = model.actuator_actrange[rotors, 1] = self.max_thrust / self.gain
        model.actuator_dynprm[rotors, 0] = self.thrust_lag
        model.actuator_dynprm[joints, 1] = joint_speed * self.joint_speed_factor
        model.actuator_biasprm[joints, 0] = 0.0
        model.actuator_biasprm[joints, 1] = -self.joint_kp * self.servo_stiffness
        model.actuator_biasprm[joints, 2] = -self.joint_kd
        model.actuator_biasprm[gimbals, 1] = -self.vectoring_kp
        dofs = [model.joint(name).dofadr[0] for name in JOINT_NAMES]
        model.dof_frictionloss[dofs] = self.joint_friction
        model.dof_damping[dofs] = self.joint_damping


def thrust_noise(noise: np.ndarray, sigma: float, dt: float, rng: np.random.Generator) -> np.ndarray:
    """The next sample of a first-order coloured noise of standard deviation `sigma`, `dt` [s] later."""
    decay = math.exp(-2.0 * math.pi * NOISE_BANDWIDTH * dt)
    return decay * noise + sigma * math.sqrt(1.0 - decay * decay) * rng.standard_normal(noise.shape)
