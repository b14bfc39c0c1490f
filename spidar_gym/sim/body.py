"""What the body and the ground really are: masses, centres of mass, inertia and friction off the description."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

from dataclasses import dataclass, field

import mujoco
import numpy as np

from spidar_gym.arrays import constant
from spidar_gym.errors import InvalidValueError, require_arrays
from spidar_gym.robot import N_LEGS, N_LINKS, ROBOT


@dataclass(frozen=True)
class BodyConfig:
    """How far body and ground are from the robot description; the defaults are the description."""

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
    foot_friction: float = ROBOT.foot_friction
    """Sliding friction of the feet."""
    peg_friction: float = ROBOT.peg_friction
    """Sliding friction of pegs, ducts and torso."""

    def __post_init__(self) -> None:
        """Refuse what has no mass."""
        require_arrays(self)
        for name in ("total_mass", "link_mass", "inertia", "foot_friction", "peg_friction"):
            value = np.asarray(getattr(self, name), float)
            if not (value > 0.0).all():
                raise InvalidValueError(name, getattr(self, name), "numbers above 0")

    def apply(self, model: mujoco.MjModel, nominal: mujoco.MjModel) -> None:
        """Write masses and friction into the model, starting from the nominal one."""
        mass, inertia, com = nominal.body_mass.copy(), nominal.body_inertia.copy(), nominal.body_ipos.copy()
        for i in range(N_LINKS):
            parts = (f"junction{i + 1}", f"link{i + 1}", f"gimbal{i + 1}_roll_module", f"gimbal{i + 1}_pitch_module")
            for name in parts:
                body = nominal.body(name).id
                mass[body] *= self.link_mass[i]
                inertia[body] *= self.link_mass[i]
            link = nominal.body(f"link{i + 1}").id
            inertia[link] *= self.inertia[i]
            com[link] += self.link_com[i]
        com[nominal.body("torso").id] += self.torso_com
        factor = self.total_mass / mass.sum()
        model.body_mass[:], model.body_inertia[:], model.body_ipos[:] = mass * factor, inertia * factor, com
        touching = nominal.geom_conaffinity > 0
        feet = [nominal.geom(f"foot{leg}").id for leg in range(1, N_LEGS + 1)]
        model.geom_friction[touching, 0] = self.peg_friction
        model.geom_friction[feet, 0] = self.foot_friction
        # Quantities that MuJoCo derives from the masses.
        mujoco.mj_setConst(model, mujoco.MjData(model))
