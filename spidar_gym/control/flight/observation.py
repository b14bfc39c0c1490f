"""Observation of a policy in flight: a named layout and one pure function, used by the environment and on the robot.

Every quantity is measured or known on the real robot: no contact forces, no wake, no parameters of the simulator.
"""

from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.arrays import JointVector, RotorVector, Vector3
from spidar_gym.control.flight.memory import ControlState, FlightMemory
from spidar_gym.control.flight.path import AHEAD, AHEAD_STEP, PathPreview
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.state import RobotState

NO_NEXT_FORM = 60.0
"""Observed time to the next form if there is none, and the largest observed value [s]."""
_UNTIL_NEXT_FORM = f"until they become the target; {NO_NEXT_FORM:g} if there is none"


@dataclass(frozen=True)
class Field:
    """One named part of the observation."""

    name: str
    """Name of the field."""
    size: int
    """Number of values."""
    bound: float
    """Values are clipped to ± this."""
    unit: str
    """Unit of the values."""
    doc: str
    """Meaning of the values, with the frame."""
    scale: float = 1.0
    """Usual size of the values, by which the observation `scaled` divides them."""


def layout(action_size: int, robot: RobotSpec = ROBOT) -> tuple[Field, ...]:
    """Return the fields of the observation in order; the length depends on the size of the action."""
    return (*_flight(robot), _previous(action_size))


def path_layout(action_size: int, robot: RobotSpec = ROBOT) -> tuple[Field, ...]:
    """Return the fields of the observation along a path, which include the path of the next second."""
    return (*_flight(robot), *_PATH, _previous(action_size))


def _flight(robot: RobotSpec) -> tuple[Field, ...]:
    """Return the fields common to all flights; the bound of thrusts is the robot's largest thrust."""
    return tuple(replace(f, bound=robot.max_thrust) if f.name == "thrust_command" else f for f in _FLIGHT)


def _previous(action_size: int) -> Field:
    return Field("previous_action", action_size, 1.0, "", "last action")


_FLIGHT = (
    Field("position_error", 3, 2.0, "m", "desired − actual CoG, torso axes", scale=0.03),
    Field("velocity_error", 3, 5.0, "m/s", "desired − actual CoG velocity, torso axes", scale=0.1),
    Field("attitude_error", 3, 2.0, "rad", "½ (RᵀR_d − R_dᵀR)^∨, torso axes", scale=0.03),
    Field("angular_velocity_error", 3, 10.0, "rad/s", "desired − actual, torso axes", scale=0.2),
    Field("joint_position", N_JOINTS, 2.0, "rad", "q"),
    Field("joint_velocity", N_JOINTS, 5.0, "rad/s", "q̇", scale=0.5),
    Field("vectoring_sine", 2 * N_ROTORS, 1.0, "", "sine of φ₁, θ₁, φ₂, θ₂ …"),
    Field("vectoring_cosine", 2 * N_ROTORS, 1.0, "", "cosine of φ₁, θ₁, φ₂, θ₂ …"),
    Field("vectoring_velocity", 2 * N_ROTORS, 20.0, "rad/s", "rates of φ₁, θ₁, φ₂, θ₂ …", scale=5.0),
    Field("joint_target_error", N_JOINTS, 4.0, "rad", "form to reach − commanded joint position", scale=0.5),
    Field("joint_command_velocity", N_JOINTS, 5.0, "rad/s", "commanded joint velocity of the last tick", scale=0.5),
    Field("leg_momentum", 3, 20.0, "Nms", "angular momentum of the legs by the commanded joint velocity, torso axes"),
    Field("leg_momentum_rate", 3, 400.0, "Nm", "its change since the last tick", scale=10.0),
    Field("position_integral", 3, 20.0, "m s", "∫ position error of the controller, world axes", scale=0.3),
    Field("attitude_integral", 3, 20.0, "rad s", "∫ attitude error of the controller, torso axes", scale=0.1),
    Field("thrust_command", N_ROTORS, ROBOT.max_thrust, "N", "λ₁ … λ₈ of the last command", scale=10.0),
    Field("vectoring_command_sine", 2 * N_ROTORS, 1.0, "", "sine of the last commanded φ, θ"),
    Field("vectoring_command_cosine", 2 * N_ROTORS, 1.0, "", "cosine of the last commanded φ, θ"),
    Field("restricted_rotors", N_ROTORS, 1.0, "", "1 where interference restricts the rotor"),
    Field("next_form", N_JOINTS, 2.0, "rad", "joint targets of the form after this one"),
    Field("time_to_next_form", 1, NO_NEXT_FORM, "s", _UNTIL_NEXT_FORM, scale=30.0),
)
_LATER = ", ".join(f"{AHEAD_STEP * (k + 1):g}" for k in range(AHEAD))
_PATH = (
    Field("path_ahead", 3 * AHEAD, 5.0, "m", f"desired CoG in {_LATER} s − desired CoG now, torso axes"),
    Field("path_turn", AHEAD, 4.0, "rad", "how far the desired heading turns until then", scale=0.5),
    Field("path_velocity", 3, 5.0, "m/s", "desired velocity of the CoG, torso axes"),
    Field("path_acceleration", 3, 20.0, "m/s²", "desired acceleration of the CoG, torso axes"),
)


@dataclass(frozen=True, slots=True)
class FlightObservables:
    """Inputs of an observation in addition to the controller's memory."""

    state: RobotState
    """Measured state."""
    control_state: ControlState
    """Model quantities and errors of that state."""
    thrust_command: RotorVector
    """Thrust last commanded [N]."""
    joint_command_velocity: JointVector
    """Joint velocity last commanded [rad/s]."""
    leg_momentum: Vector3
    """Angular momentum of the legs about the CoG, torso axes [Nms]."""
    leg_momentum_rate: Vector3
    """Rate of that momentum since the last tick [Nm]."""
    joint_target: JointVector
    """Present target form [rad]."""
    next_form: JointVector
    """Target form after the present one [rad]."""
    time_to_next_form: float
    """Time until the next form becomes the target [s]."""
    previous_action: np.ndarray
    """The last action."""
    path: PathPreview | None = None
    """Preview of the path, or None without a path."""


def observe(seen: FlightObservables, memory: FlightMemory, *, bound: np.ndarray) -> np.ndarray:
    """Compute the observation in the order of `layout`, clipped to ± `bound` (one per number), float32."""
    state, error, rotation = seen.state, seen.control_state.error, seen.control_state.R_wb
    angles = np.concatenate((state.vectoring, memory.vectoring)).reshape(-1)
    sine, cosine, half = np.sin(angles), np.cos(angles), 2 * N_ROTORS
    path = (
        ()
        if seen.path is None
        else (
            (seen.path.ahead_w @ rotation).reshape(-1),
            seen.path.turn,
            seen.path.velocity_w @ rotation,
            seen.path.acceleration_w @ rotation,
        )
    )
    values = np.concatenate(
        (
            error.position_w @ rotation,
            error.velocity_w @ rotation,
            error.attitude,
            error.omega_b,
            state.joint_position,
            state.joint_velocity,
            sine[:half],
            cosine[:half],
            state.vectoring_velocity.reshape(-1),
            seen.joint_target - memory.joint_position,
            seen.joint_command_velocity,
            seen.leg_momentum,
            seen.leg_momentum_rate,
            memory.integrals.position_w,
            memory.integrals.attitude,
            seen.thrust_command,
            sine[half:],
            cosine[half:],
            memory.interference.restricted,
            seen.next_form,
            (seen.time_to_next_form,),
            *path,
            seen.previous_action,
        )
    )
    return np.minimum(np.maximum(values, -bound), bound).astype(np.float32)
