"""Payloads: rigid bodies fixed to the torso or to a link."""

from dataclasses import dataclass

import numpy as np

from spidar_gym.errors import InvalidValueError, is_finite, require_name
from spidar_gym.robot.inertial import Inertial, Six, Three
from spidar_gym.robot.ranges import INERTIAS, LENGTHS, MASSES, PLACES

CARRIERS = ("torso", *(f"link{i}" for i in range(1, 9)))
"""Bodies to which a payload can be fixed: the torso, or link 1 … 8 (odd ones are inner links)."""


@dataclass(frozen=True)
class Payload:
    """A rigid body fixed to the torso or a link; the controller's model includes it, as everything in `RobotSpec`."""

    body: str
    """Body to which it is fixed: `torso`, or `link1` … `link8`."""
    mass: float
    """Mass [kg]."""
    position: Three = (0.0, 0.0, 0.0)
    """Centre of mass in the frame of that body [m]."""
    size: Three = (0.06, 0.06, 0.06)
    """Edges of the box along the axes of that frame [m]; the box is rendered but does not collide."""
    inertia: Six | None = None
    """xx, yy, zz, xy, xz, yz about the centre of mass, axes of that frame [kg m²]; that of a uniform box by default."""

    def __post_init__(self) -> None:
        """Validate body, mass, size and inertia, and convert numbers to floats."""
        require_name("carrier", self.body, CARRIERS)
        if not (is_finite(self.mass) and self.mass > 0.0):
            raise InvalidValueError("payload: mass", self.mass, "a number above 0 [kg]")
        MASSES.require("payload: mass", self.mass)
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "position", numbers("payload: position", self.position, 3))
        object.__setattr__(self, "size", numbers("payload: size", self.size, 3))
        if not all(edge > 0.0 for edge in self.size):
            raise InvalidValueError("payload: size", self.size, "three edges above 0 [m]")
        LENGTHS.require("payload: size", *self.size)
        PLACES.require("payload: position", *self.position)
        if self.inertia is None:
            return
        object.__setattr__(self, "inertia", numbers("payload: inertia", self.inertia, 6))
        principal = np.linalg.eigvalsh(self.inertial.matrix)
        if not (principal[0] > 0.0 and principal[0] + principal[1] >= principal[2] * (1.0 - 1e-9)):
            raise InvalidValueError(
                "payload: inertia", self.inertia,
                "xx, yy, zz, xy, xz, yz of a rigid body [kg m²]: positive, no moment above the sum of the others",
            )  # fmt: skip
        INERTIAS.require("payload: inertia, a principal moment", *principal.tolist())

    @property
    def inertial(self) -> Inertial:
        """Mass distribution in the frame of the body to which the payload is fixed."""
        if self.inertia is not None:
            return Inertial(self.mass, self.position, self.inertia)
        x, y, z = (edge * edge for edge in self.size)
        twelfth = self.mass / 12.0
        return Inertial(
            self.mass, self.position, (twelfth * (y + z), twelfth * (x + z), twelfth * (x + y), 0.0, 0.0, 0.0)
        )


def numbers(name: str, given: object, count: int) -> tuple[float, ...]:
    """Return `count` finite numbers as a tuple of floats (`InvalidValueError` for anything else)."""
    values = tuple(given) if isinstance(given, tuple | list | np.ndarray) else ()
    if len(values) != count or not all(is_finite(value) for value in values):
        raise InvalidValueError(name, given, f"{count} finite numbers")
    return tuple(float(value) for value in values)
