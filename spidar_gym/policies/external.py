"""The force that pulls at a flying robot beyond what was commanded: what a policy may remember of a flight."""

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import layout
from spidar_gym.errors import require_above
from spidar_gym.policies import torso
from spidar_gym.policies.filters import shares
from spidar_gym.robot import GRAVITY, ROBOT

SIZE = 9
"""How many numbers it shows."""
_FIELDS = layout(0)
_ENDS = np.cumsum([field.size for field in _FIELDS]).tolist()
PLACES = {field.name: slice(end - field.size, end) for field, end in zip(_FIELDS, _ENDS, strict=True)}
"""Where the pieces of a flight's observation are, in every action mode."""


class ExternalForce:
    """What of a robot's acceleration its commands and its weight do not explain, as a force in torso axes.

    m (v − v₋)/dt − f + m g, with the mass of the description, the velocity v of the CoG that is seen, and the commanded
    force f behind a first-order model of the rotors: what a momentum observer [DeLuca2006] low-passes, as do `Traces`
    here. A residual is among the commands, so it is not mistaken for wind. The reference is at rest and level.
    """

    def __init__(self, lag: float) -> None:
        """Begin.

        Args:
            lag: Time constant of the rotors [s].

        Raises:
            InvalidValueError: For a time that is not above 0.
        """
        require_above("0", lag=lag)
        self.share = float(shares("lag", np.array([lag]))[0])
        """Share of the way to the commanded force that the model goes in a tick."""
        self.reset()

    def reset(self, *robots: int) -> None:
        """Forget what was seen, of one robot or of so many."""
        self.velocity, self.force, self.first = (np.full((*robots, 3), np.nan) for _ in range(3))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The observation with `SIZE` numbers behind it.

        Args:
            observation: Of a flight, shape (…, size).

        Returns:
            Behind it the force [N], the same without its signs, and the position's integral as it was first [m s],
            without its signs, which tells how much was known to pull before; three each. There is no force at first.
        """
        seen = {name: observation[..., place].astype(float) for name, place in PLACES.items()}
        x, y = -seen["attitude_error"][..., 1], seen["attitude_error"][..., 0]
        up = np.stack([-x, -y, np.ones_like(x)], axis=-1)  # of the world, to first order
        velocity, force = -seen["velocity_error"], commanded_force(seen)
        begun = ~np.isnan(self.velocity)
        self.force = np.where(begun, self.force + self.share * (force - self.force), force)
        momentum = ROBOT.weight / GRAVITY * CONTROL_RATE * (velocity - self.velocity)
        pull = np.where(begun, momentum - self.force + ROBOT.weight * up, 0.0)
        self.first = np.where(begun, self.first, np.abs(seen["position_integral"]))
        self.velocity = velocity
        return np.concatenate([observation, pull, np.abs(pull), self.first], axis=-1)


def commanded_force(seen: dict[str, np.ndarray]) -> np.ndarray:
    """Total of the last commands' thrusts in torso axes (…, 3) [N], where the joints are measured.

    Args:
        seen: Pieces of the observation by name.
    """
    directions = torso.directions(seen["vectoring_command_sine"], seen["vectoring_command_cosine"])
    forces_l = seen["thrust_command"][..., None] * directions
    return torso.turned(torso.links(seen["joint_position"]), forces_l).sum(axis=-2)
