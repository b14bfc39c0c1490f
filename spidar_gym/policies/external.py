"""Estimate of the external force on a flying robot, a memory of learned policies."""

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import layout
from spidar_gym.errors import require_above
from spidar_gym.policies import torso
from spidar_gym.policies.filters import shares
from spidar_gym.robot import GRAVITY, ROBOT

SIZE = 9
"""Number of values that it appends to an observation."""
_FIELDS = layout(0)
_ENDS = np.cumsum([field.size for field in _FIELDS]).tolist()
PLACES = {field.name: slice(end - field.size, end) for field, end in zip(_FIELDS, _ENDS, strict=True)}
"""Slices of the fields of a flight's observation, in every action mode."""


class ExternalForce:
    """Part of a robot's acceleration that commands and weight do not explain, as a force in torso axes.

    It is m (v − v₋)/dt − f + m g, with the described mass m, the observed velocity v of the CoG, and the commanded
    force f after a first-order model of the rotors. A momentum observer [DeLuca2006] low-passes this quantity, as
    `Traces` do here. The commands include residuals, which are therefore not mistaken for wind. The reference is
    assumed to be at rest and level.
    """

    def __init__(self, lag: float) -> None:
        """Reset the estimate.

        Args:
            lag: Time constant of the rotors [s].

        Raises:
            InvalidValueError: For a time that is not above 0.
        """
        require_above("0", lag=lag)
        self.share = float(shares("lag", np.array([lag]))[0])
        """Share by which the model approaches the commanded force per tick."""
        self.reset()

    def reset(self, *robots: int) -> None:
        """Reset the memory, of one robot or of a number of robots."""
        self.velocity, self.force, self.first = (np.full((*robots, 3), np.nan) for _ in range(3))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Append `SIZE` numbers to an observation.

        Args:
            observation: Observation of a flight, shape (…, size).

        Returns:
            The observation followed by the force [N], its absolute values, and the absolute values of the position's
            initial integral [m s], a measure of the initially known force; three each. The first force is 0.
        """
        seen = {name: observation[..., place].astype(float) for name, place in PLACES.items()}
        x, y = -seen["attitude_error"][..., 1], seen["attitude_error"][..., 0]
        up = np.stack([-x, -y, np.ones_like(x)], axis=-1)  # of the world, to first order in the attitude error
        velocity, force = -seen["velocity_error"], commanded_force(seen)
        begun = ~np.isnan(self.velocity)
        self.force = np.where(begun, self.force + self.share * (force - self.force), force)
        momentum = ROBOT.weight / GRAVITY * CONTROL_RATE * (velocity - self.velocity)
        pull = np.where(begun, momentum - self.force + ROBOT.weight * up, 0.0)
        self.first = np.where(begun, self.first, np.abs(seen["position_integral"]))
        self.velocity = velocity
        return np.concatenate([observation, pull, np.abs(pull), self.first], axis=-1)


def commanded_force(seen: dict[str, np.ndarray]) -> np.ndarray:
    """Return the sum of the last commanded thrusts in torso axes (…, 3) [N], at the measured joint angles.

    Args:
        seen: Fields of the observation by name.
    """
    directions = torso.directions(seen["vectoring_command_sine"], seen["vectoring_command_cosine"])
    forces_l = seen["thrust_command"][..., None] * directions
    return torso.turned(torso.links(seen["joint_position"]), forces_l).sum(axis=-2)
