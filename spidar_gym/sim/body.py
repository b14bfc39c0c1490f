"""Parameters of the body: masses, centres of mass, inertias and friction."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import constant
from spidar_gym.errors import InvalidValueError, require_arrays
from spidar_gym.robot import N_LINKS, ROBOT, RobotSpec
from spidar_gym.robot.ranges import FACTORS, MASSES, PLACES


@dataclass(frozen=True)
class BodyConfig:
    """Parameters of the simulated body; the defaults are those of the robot description."""

    total_mass: float = ROBOT.total_mass
    """Mass of the whole robot [kg]; all masses and inertias are scaled to it, after the factors below."""
    link_mass: np.ndarray = field(default_factory=lambda: constant(1.0, N_LINKS))
    """Factor on mass and inertia of each link with its junction and module."""
    link_com: np.ndarray = field(default_factory=lambda: constant(0.0, N_LINKS, 3))
    """Shift of each link's centre of mass, link axes [m]."""
    torso_com: np.ndarray = field(default_factory=lambda: constant(0.0, 3))
    """Shift of the torso's centre of mass [m]."""
    inertia: np.ndarray = field(default_factory=lambda: constant(1.0, N_LINKS))
    """Factor on the inertia of each link about its own centre of mass."""
    payload_mass: float = 0.0
    """Point mass that the torso carries, in addition to `total_mass` [kg]."""
    payload_position: np.ndarray = field(default_factory=lambda: constant(0.0, 3))
    """Position of the payload, torso axes [m]."""
    foot_friction: float = ROBOT.foot_friction
    """Sliding friction of the feet."""
    peg_friction: float = ROBOT.peg_friction
    """Sliding friction of pegs, ducts and torso."""

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_arrays(self)
        for name in ("total_mass", "link_mass", "inertia", "foot_friction", "peg_friction"):
            value = np.asarray(getattr(self, name), float)
            if not (value > 0.0).all():
                raise InvalidValueError(name, getattr(self, name), "numbers above 0")
        if not self.payload_mass >= 0.0:
            raise InvalidValueError("payload_mass", self.payload_mass, "a number of at least 0 kg")
        MASSES.require("total_mass", self.total_mass)
        if self.payload_mass:
            MASSES.require("payload_mass", self.payload_mass)
        for range_, names in (
            (FACTORS, ("link_mass", "inertia")), (PLACES, ("link_com", "torso_com", "payload_position")),
        ):  # fmt: skip
            for name in names:
                range_.require(name, *np.ravel(getattr(self, name)).tolist())

    @classmethod
    def of(cls, robot: RobotSpec) -> "BodyConfig":
        """Return the parameters of a described robot."""
        return cls(total_mass=robot.total_mass, foot_friction=robot.foot_friction, peg_friction=robot.peg_friction)
