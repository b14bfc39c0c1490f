"""A `direct` policy in torso axes: features of an observation for the network, and commands from its output.

In link axes the numbers of a force depend on the form, and a small rotation of it can be a large one of the vectoring
angles. In torso axes hovering is nearly constant, so that a small network can learn it. The rotations between the axes
are kinematics of the measured joints, independent of the robot's masses, errors and controllers. With zero outputs of
the network the joints move to their form automatically, smoothly and straight.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spidar_gym.control.flight.compensation import ramp_joints
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import layout
from spidar_gym.model.rotor import aim
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, ROBOT

FORCE = 10.0
"""Force for an output of 1 [N]."""
OFFSET = 0.1
"""Offset of a joint from its form for an output of 1 [rad]."""
SPEED, ACCELERATION = 1.0, 2.5
"""Largest speed of the slowest joint [rad/s], and its acceleration [rad/s²]."""
SURE = 0.15
"""Commanded speed below which a joint counts as having reached its target [rad/s]; servos must be faster."""
ACTION = 3 * N_ROTORS + N_JOINTS
"""Length of a `direct` action (thrusts, φ, θ, joints) and of the network's output (forces, offsets of joints)."""
_FIELDS = layout(ACTION)
_ENDS = np.cumsum([field.size for field in _FIELDS]).tolist()
_PLACES = {field.name: slice(end - field.size, end) for field, end in zip(_FIELDS, _ENDS, strict=True)}
OBSERVATION = _ENDS[-1]
"""Length of the observation."""
SHOWN = OBSERVATION + N_JOINTS
"""Length of the observation followed by the commanded joints."""
KEPT = (
    "position_error", "velocity_error", "attitude_error", "angular_velocity_error", "joint_position", "joint_velocity",
    "joint_target_error", "joint_command_velocity", "leg_momentum", "leg_momentum_rate", "position_integral",
    "attitude_integral", "next_form", "time_to_next_form",
)  # fmt: skip
"""Fields of the observation that are features unchanged; the rotors that interference restricts are not among them."""
KEPT_ENTRIES = np.concatenate([np.arange(OBSERVATION)[_PLACES[name]] for name in KEPT])
"""Indices of the entries of `KEPT`."""
FEATURES = len(KEPT_ENTRIES) + 3 * 3 * N_ROTORS + N_JOINTS
"""Number of features: `KEPT`, measured directions, commanded forces, links' x axes, commanded joints."""
_AZIMUTHS = np.array([ROBOT.leg_azimuth(leg) for leg in range(N_LEGS)])


def entries(*names: str) -> np.ndarray:
    """Return the indices of some fields in the observation of a `direct` flight."""
    return np.concatenate([np.arange(OBSERVATION)[_PLACES[name]] for name in names])


def kept_entries(*names: str) -> np.ndarray:
    """Return the indices of some fields of `KEPT` in the features."""
    return np.flatnonzero(np.isin(KEPT_ENTRIES, entries(*names)))


def links(joint_position: np.ndarray) -> np.ndarray:
    """Return attitudes R_bl of the rotors' links (…, 8, 3, 3) at joint positions (…, 16) [rad]."""
    q = joint_position.reshape(*joint_position.shape[:-1], N_LEGS, 4)
    inner = _yaw_pitch(_AZIMUTHS + q[..., 0], q[..., 1])
    knee = _yaw_pitch(q[..., 2], q[..., 3])
    outer = (inner[..., :, :, None] * knee[..., None, :, :]).sum(axis=-2)  # products of a library differ by processor
    both = np.stack([inner, outer], axis=-3)
    return both.reshape(*joint_position.shape[:-1], N_ROTORS, 3, 3)


def _yaw_pitch(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """Return Rz(yaw) Ry(pitch), (…, 3, 3)."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    rows = [[cy * cp, -sy, cy * sp], [sy * cp, cy, sy * sp], [-sp, np.zeros_like(yaw), cp]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def directions(sine: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Return thrust directions u(φ, θ) in link axes (…, 8, 3) from sines and cosines (…, 16) [Zhao2025, Eq. 1]."""
    s_phi, s_theta, c_phi, c_theta = sine[..., 0::2], sine[..., 1::2], cosine[..., 0::2], cosine[..., 1::2]
    return np.stack([s_theta, -s_phi * c_theta, c_phi * c_theta], axis=-1)


def turned(R: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Rotate each vector (…, 8, 3) by its matrix."""
    return (R * vectors[..., None, :]).sum(axis=-1)


@dataclass(frozen=True)
class Turn:
    """Transformation of numbers under a turn of the robot by 90° about z: each leg takes the next one's place.

    The robot is symmetric under the turn: transformed features have the transformed output.
    """

    places: np.ndarray
    """Index of the number that each entry receives, (size,)."""
    signs: np.ndarray
    """Sign of each entry, (size,)."""

    @classmethod
    def joined(cls, turns: "Sequence[Turn]") -> "Turn":
        """Return the transformation of concatenated numbers."""
        starts = np.cumsum([0, *(len(turn.places) for turn in turns)])
        places = [start + turn.places for start, turn in zip(starts, turns, strict=False)]
        return cls(np.concatenate(places), np.concatenate([turn.signs for turn in turns]))

    @classmethod
    def passed_on(cls, size: int) -> "Turn":
        """Return the transformation of scalars, equally many per leg: each leg takes the next one's place."""
        return cls(np.roll(np.arange(size), size // N_LEGS), np.ones(size))

    @classmethod
    def none(cls, size: int) -> "Turn":
        """Return the identity."""
        return cls(np.arange(size), np.ones(size))

    def __call__(self, numbers: np.ndarray) -> np.ndarray:
        """Transform numbers (…, size)."""
        return self.signs * numbers[..., self.places]


_VECTOR = Turn(np.array([1, 0, 2]), np.array([-1.0, 1.0, 1.0]))
"""(x, y, z) → (−y, x, z)."""
_BY_ROTOR = Turn(
    (3 * np.roll(np.arange(N_ROTORS), N_ROTORS // N_LEGS)[:, None] + _VECTOR.places).reshape(-1),
    np.tile(_VECTOR.signs, N_ROTORS),
)
"""Transformation of a vector for each rotor: rotated, and moved to the next leg."""
_BY_LEG = Turn.passed_on(N_JOINTS)
SAID_TURN = Turn.joined([_BY_ROTOR, _BY_LEG])
"""Transformation of the network's output."""


def shown_turn(traces: int) -> Turn:
    """Return the transformation of the network's input: features, followed by traces of vectors."""
    kinds = {3: _VECTOR, N_JOINTS: _BY_LEG, 1: Turn.none(1)}
    kept = [kinds[field.size] for name in KEPT for field in _FIELDS if field.name == name]
    return Turn.joined([*kept, *[_BY_ROTOR] * 3, _BY_LEG, *[_VECTOR] * (traces // 3)])


class Joints:
    """Estimate of the commanded joint angles: the targets, or as far towards them as the joint speed allows.

    An observation contains only the commanded velocities, which are integrated. Before the first action the measured
    angles are used.
    """

    def __init__(self) -> None:
        """Reset the estimate."""
        self.reset()

    def reset(self, *robots: int) -> None:
        """Reset the estimate, of one robot or of a number of robots."""
        self.position = np.full((*robots, N_JOINTS), np.nan)
        """Commanded joint angles [rad]; NaN before the first observation."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Update the estimate with a tick's observation (…, `OBSERVATION`) and append it to the observation."""
        velocity = observation[..., _PLACES["joint_command_velocity"]].astype(float)
        asked = ROBOT.joint_limit * observation[..., _PLACES["previous_action"]][..., 3 * N_ROTORS :].astype(float)
        moved = np.where(np.abs(velocity) < SURE, asked, self.position + velocity / CONTROL_RATE)
        measured = observation[..., _PLACES["joint_position"]].astype(float)
        self.position = np.where(np.isnan(self.position), measured, moved)
        return np.concatenate([observation, self.position], axis=-1)

    def begin(self, robots: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Append the measured joints to the first observations of some robots' episodes.

        Args:
            robots: Indices of the robots, (number,).
            observations: First observations of these robots, (number, `OBSERVATION`).
        """
        self.position[robots] = observations[:, _PLACES["joint_position"]]
        return np.concatenate([observations, self.position[robots]], axis=-1)


def features(observation: np.ndarray) -> np.ndarray:
    """Return the features of an observation.

    Args:
        observation: Observation of a `direct` flight followed by the commanded joints, shape (…, `SHOWN`).

    Returns:
        The fields of `KEPT`; in torso axes the measured directions of thrust, the commanded forces [N] and the links' x
        axes, each (8, 3); the commanded joints [rad]. Shape (…, `FEATURES`).
    """
    observation, joints = np.split(observation, [OBSERVATION], axis=-1)
    seen = {name: observation[..., place].astype(float) for name, place in _PLACES.items()}
    R = links(seen["joint_position"])
    measured = turned(R, directions(seen["vectoring_sine"], seen["vectoring_cosine"]))
    commanded = directions(seen["vectoring_command_sine"], seen["vectoring_command_cosine"])
    forces = turned(R, seen["thrust_command"][..., None] * commanded)
    flat = (*observation.shape[:-1], 3 * N_ROTORS)
    parts = [observation[..., KEPT_ENTRIES], measured.reshape(flat), forces.reshape(flat), R[..., 0].reshape(flat)]
    return np.concatenate([*parts, joints], axis=-1)


def forces(thrust: np.ndarray, vectoring: np.ndarray, observation: np.ndarray) -> np.ndarray:
    """Return forces in torso axes (…, 8, 3) [N] of thrusts (…, 8) [N] and vectoring angles (…, 8, 2) [rad].

    Args:
        thrust: λ.
        vectoring: (φ, θ).
        observation: Observation with the measured joints, shape (…, `OBSERVATION`).
    """
    flat = vectoring.reshape(*vectoring.shape[:-2], 2 * N_ROTORS)
    R = links(observation[..., _PLACES["joint_position"]].astype(float))
    return turned(R, thrust[..., None] * directions(np.sin(flat), np.cos(flat)))


def _toward(form: np.ndarray, commanded: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the next joint command (…, 16) [rad], straight towards a form with limited speed and acceleration."""
    most = np.abs(velocity).max(axis=-1, keepdims=True)
    speed = np.minimum(SPEED, most + ACCELERATION / CONTROL_RATE)
    return ramp_joints(commanded, velocity, form, speed=speed, ramp=speed / ACCELERATION, dt=1.0 / CONTROL_RATE)[0]


def answer(forces_b: np.ndarray) -> np.ndarray:
    """Return the network's output for which `command` yields given forces and moves the joints to their form.

    Args:
        forces_b: Forces in torso axes (…, 8, 3) [N].
    """
    hover = np.array([0.0, 0.0, ROBOT.weight / N_ROTORS])
    forces = ((forces_b - hover) / FORCE).reshape(*forces_b.shape[:-2], 3 * N_ROTORS)
    return np.concatenate([forces, np.zeros((*forces.shape[:-1], N_JOINTS))], axis=-1)


def command(said: np.ndarray, observation: np.ndarray) -> np.ndarray:
    """Return the `direct` action, within ± 1, for an output of the network.

    Args:
        said: Output (…, 40): forces in torso axes beyond an eighth of the weight, in units of `FORCE`; offsets of the
            joints from their form, in units of `OFFSET`. Zeros hover: every rotor bears an eighth of the weight.
        observation: Observation followed by the commanded joints, shape (…, `SHOWN`).
    """
    observation, commanded = np.split(observation, [OBSERVATION], axis=-1)
    aside, velocity = (observation[..., _PLACES[f"joint_{name}"]] for name in ("target_error", "command_velocity"))
    said = said.astype(float)
    forces_b = FORCE * said[..., : 3 * N_ROTORS].reshape(*said.shape[:-1], N_ROTORS, 3)
    forces_b = forces_b + np.array([0.0, 0.0, ROBOT.weight / N_ROTORS])
    form = commanded + aside.astype(float) + OFFSET * said[..., 3 * N_ROTORS :]
    joints = _toward(form, commanded, velocity.astype(float))
    seen = {name: observation[..., _PLACES[name]].astype(float) for name in _PLACES if name.startswith("vectoring_c")}
    R = links(observation[..., _PLACES["joint_position"]].astype(float))
    sine, cosine = (seen[f"vectoring_command_{name}"][..., 0::2] for name in ("sine", "cosine"))
    thrust, phi, theta = aim(R, forces_b, sine, cosine)
    action = [2.0 * thrust / ROBOT.max_thrust - 1.0, phi / np.pi, theta / np.pi, joints / ROBOT.joint_limit]
    return np.minimum(np.maximum(np.concatenate(action, axis=-1), -1.0), 1.0)
