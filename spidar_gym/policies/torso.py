"""A `direct` policy in the torso's axes: what its network sees of an observation, and what its numbers command.

In link axes one and the same force is other numbers in every form, and a small turn of it may be a large one of the
vectoring angles. In the torso's axes hovering is nearly constant, so that a small network learns it. The turns between
the two are kinematics of the measured joints; nothing here knows the robot's masses, its errors or a controller. The
joints go to their form by themselves, gently and straight, if the network says nothing else.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spidar_gym.control.flight.compensation import ramp_joints
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import layout
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, ROBOT

FORCE = 10.0
"""What a 1 of the network is of a force [N]."""
OFFSET = 0.1
"""How far off its form a 1 of the network leads a joint [rad]."""
SPEED, ACCELERATION = 1.0, 2.5
"""Largest speed of the slowest joint [rad/s], and how fast that changes [rad/s²]."""
SURE = 0.15
"""A joint that was commanded slower than this was where it was asked to be [rad/s]; so servos may not be slower."""
HOLD = 0.05
"""Share of a force that keeps φ where it was: where the thrust lies along φ's axis, φ means nothing."""
ACTION = 3 * N_ROTORS + N_JOINTS
"""Length of a `direct` action: thrusts, φ, θ, joints; the network's is as long: forces, then offsets of joints."""
_FIELDS = layout(ACTION)
_ENDS = np.cumsum([field.size for field in _FIELDS]).tolist()
_PLACES = {field.name: slice(end - field.size, end) for field, end in zip(_FIELDS, _ENDS, strict=True)}
OBSERVATION = _ENDS[-1]
"""Length of the observation."""
SHOWN = OBSERVATION + N_JOINTS
"""Length of the observation with the commanded joints behind it."""
KEPT = (
    "position_error", "velocity_error", "attitude_error", "angular_velocity_error", "joint_position", "joint_velocity",
    "joint_target_error", "joint_command_velocity", "leg_momentum", "leg_momentum_rate", "position_integral",
    "attitude_integral", "next_form", "time_to_next_form",
)  # fmt: skip
"""Pieces of the observation that the network sees as they are; which rotors interference restricts, nobody tells it."""
KEPT_ENTRIES = np.concatenate([np.arange(OBSERVATION)[_PLACES[name]] for name in KEPT])
"""Their entries."""
FEATURES = len(KEPT_ENTRIES) + 3 * 3 * N_ROTORS + N_JOINTS
"""How many numbers the network sees: `KEPT`, measured directions, commanded forces, links' x axes, commanded joints."""
_AZIMUTHS = np.array([ROBOT.leg_azimuth(leg) for leg in range(N_LEGS)])


def entries(*names: str) -> np.ndarray:
    """Which entries of the observation of a `direct` flight some of its pieces are."""
    return np.concatenate([np.arange(OBSERVATION)[_PLACES[name]] for name in names])


def kept_entries(*names: str) -> np.ndarray:
    """Which of the numbers that the network sees some pieces of `KEPT` are."""
    return np.flatnonzero(np.isin(KEPT_ENTRIES, entries(*names)))


def links(joint_position: np.ndarray) -> np.ndarray:
    """Attitudes R_bl of the rotors' links (…, 8, 3, 3) at joint positions (…, 16) [rad]."""
    q = joint_position.reshape(*joint_position.shape[:-1], N_LEGS, 4)
    inner = _yaw_pitch(_AZIMUTHS + q[..., 0], q[..., 1])
    outer = np.matmul(inner, _yaw_pitch(q[..., 2], q[..., 3]))
    both = np.stack([inner, outer], axis=-3)
    return both.reshape(*joint_position.shape[:-1], N_ROTORS, 3, 3)


def _yaw_pitch(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """Rz(yaw) Ry(pitch), (…, 3, 3)."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    rows = [[cy * cp, -sy, cy * sp], [sy * cp, cy, sy * sp], [-sp, np.zeros_like(yaw), cp]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def directions(sine: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Thrust directions u(φ, θ) in link axes (…, 8, 3) of the angles' sines and cosines (…, 16) [Zhao2025, Eq. 1]."""
    s_phi, s_theta, c_phi, c_theta = sine[..., 0::2], sine[..., 1::2], cosine[..., 0::2], cosine[..., 1::2]
    return np.stack([s_theta, -s_phi * c_theta, c_phi * c_theta], axis=-1)


def turned(R: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Each vector (…, 8, 3) by its matrix."""
    return np.matmul(R, vectors[..., None])[..., 0]


@dataclass(frozen=True)
class Turn:
    """What becomes of numbers when the robot is turned by 90° about its z axis and each leg takes the next one's place.

    The robot is the same again: what is shown, turned, has the answer, turned.
    """

    places: np.ndarray
    """Which number stands at each place afterwards, (size,)."""
    signs: np.ndarray
    """With which sign, (size,)."""

    @classmethod
    def joined(cls, turns: "Sequence[Turn]") -> "Turn":
        """That of numbers one behind the other."""
        starts = np.cumsum([0, *(len(turn.places) for turn in turns)])
        places = [start + turn.places for start, turn in zip(starts, turns, strict=False)]
        return cls(np.concatenate(places), np.concatenate([turn.signs for turn in turns]))

    @classmethod
    def passed_on(cls, size: int) -> "Turn":
        """That of numbers of the legs, as many of each: they take the next leg's place."""
        return cls(np.roll(np.arange(size), size // N_LEGS), np.ones(size))

    @classmethod
    def none(cls, size: int) -> "Turn":
        """That of numbers in which a turn changes nothing."""
        return cls(np.arange(size), np.ones(size))

    def __call__(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers (…, size), turned."""
        return self.signs * numbers[..., self.places]


_VECTOR = Turn(np.array([1, 0, 2]), np.array([-1.0, 1.0, 1.0]))
"""(x, y, z) → (−y, x, z)."""
_BY_ROTOR = Turn(
    (3 * np.roll(np.arange(N_ROTORS), N_ROTORS // N_LEGS)[:, None] + _VECTOR.places).reshape(-1),
    np.tile(_VECTOR.signs, N_ROTORS),
)
"""A vector for each rotor: turned, and passed on to the next leg's."""
_BY_LEG = Turn.passed_on(N_JOINTS)
SAID_TURN = Turn.joined([_BY_ROTOR, _BY_LEG])
"""That of what the network says."""


def shown_turn(traces: int) -> Turn:
    """That of what the network sees: features, and behind them so many traces of vectors."""
    kinds = {3: _VECTOR, N_JOINTS: _BY_LEG, 1: Turn.none(1)}
    kept = [kinds[field.size] for name in KEPT for field in _FIELDS if field.name == name]
    return Turn.joined([*kept, *[_BY_ROTOR] * 3, _BY_LEG, *[_VECTOR] * (traces // 3)])


class Joints:
    """Where the joints are commanded: where they were asked to be, or as far on the way as their speed let them go.

    How far that is, an observation tells only as a velocity. Before the first action they are where they are measured.
    """

    def __init__(self) -> None:
        """Begin."""
        self.reset()

    def reset(self, *robots: int) -> None:
        """Forget where they are, of one robot or of so many."""
        self.position = np.full((*robots, N_JOINTS), np.nan)
        """Joints as commanded [rad]; NaN before the first observation."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The observation (…, `OBSERVATION`) of a tick with the commanded joints behind it."""
        velocity = observation[..., _PLACES["joint_command_velocity"]].astype(float)
        asked = ROBOT.joint_limit * observation[..., _PLACES["previous_action"]][..., 3 * N_ROTORS :].astype(float)
        moved = np.where(np.abs(velocity) < SURE, asked, self.position + velocity / CONTROL_RATE)
        measured = observation[..., _PLACES["joint_position"]].astype(float)
        self.position = np.where(np.isnan(self.position), measured, moved)
        return np.concatenate([observation, self.position], axis=-1)

    def begin(self, robots: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Some robots' first observations of an episode, with the joints as measured behind them.

        Args:
            robots: Which rows of the positions, (number,).
            observations: Theirs, shape (number, `OBSERVATION`).
        """
        self.position[robots] = observations[:, _PLACES["joint_position"]]
        return np.concatenate([observations, self.position[robots]], axis=-1)


def features(observation: np.ndarray) -> np.ndarray:
    """What the network sees.

    Args:
        observation: Of a `direct` flight, commanded joints behind it, shape (…, `SHOWN`).

    Returns:
        The pieces of `KEPT`; in torso axes the measured directions of thrust, the commanded forces [N] and the links' x
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
    """Forces in torso axes (…, 8, 3) [N] of thrusts (…, 8) [N] and vectoring angles (…, 8, 2) [rad].

    Args:
        thrust: λ.
        vectoring: (φ, θ).
        observation: Shape (…, `OBSERVATION`): where the joints are measured.
    """
    flat = vectoring.reshape(*vectoring.shape[:-2], 2 * N_ROTORS)
    R = links(observation[..., _PLACES["joint_position"]].astype(float))
    return turned(R, thrust[..., None] * directions(np.sin(flat), np.cos(flat)))


def _toward(form: np.ndarray, commanded: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Next joint command (…, 16) [rad]: straight to a form, and never much faster than the joints were let go."""
    most = np.abs(velocity).max(axis=-1, keepdims=True)
    speed = np.minimum(SPEED, most + ACCELERATION / CONTROL_RATE)
    return ramp_joints(commanded, velocity, form, speed=speed, ramp=speed / ACCELERATION, dt=1.0 / CONTROL_RATE)[0]


def answer(forces_b: np.ndarray) -> np.ndarray:
    """What the network has to say for forces, with joints that go to their form; `command` does them.

    Args:
        forces_b: Forces in torso axes (…, 8, 3) [N].
    """
    hover = np.array([0.0, 0.0, ROBOT.weight / N_ROTORS])
    forces = ((forces_b - hover) / FORCE).reshape(*forces_b.shape[:-2], 3 * N_ROTORS)
    return np.concatenate([forces, np.zeros((*forces.shape[:-1], N_JOINTS))], axis=-1)


def command(said: np.ndarray, observation: np.ndarray) -> np.ndarray:
    """The `direct` action, within ± 1, of what the network says.

    Of the two turns (φ, θ) that point a module along its force, the one with φ nearer to the last command is taken.
    φ is that of the force plus `HOLD` of its length along the last φ; what is across φ's plane is left out for this
    tick.

    Args:
        said: Shape (…, 40): forces in torso axes beyond an eighth of the weight, in `FORCE`; where joints are to be
            beside their form, in `OFFSET`. All zero hovers: every rotor bears an eighth of the weight.
        observation: What it was said to, commanded joints behind it, shape (…, `SHOWN`).
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
    x, y, z = np.moveaxis(turned(np.swapaxes(R, -1, -2), forces_b), -1, 0)
    s, c = seen["vectoring_command_sine"][..., 0::2], seen["vectoring_command_cosine"][..., 0::2]
    hold = HOLD * np.sqrt(x * x + y * y + z * z)
    side = np.where(c * z - s * y < 0.0, -1.0, 1.0)
    phi = np.arctan2(hold * s - side * y, hold * c + side * z)
    along = np.cos(phi) * z - np.sin(phi) * y
    thrust = np.hypot(x, along)
    theta = np.arctan2(x, along)
    action = [2.0 * thrust / ROBOT.max_thrust - 1.0, phi / np.pi, theta / np.pi, joints / ROBOT.joint_limit]
    return np.minimum(np.maximum(np.concatenate(action, axis=-1), -1.0), 1.0)
