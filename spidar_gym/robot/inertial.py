"""Mass distribution of rigid parts: change of frame, scaling, stretching, merging."""

from dataclasses import dataclass

import numpy as np

from spidar_gym.so3 import rotation_x, skew

Six = tuple[float, float, float, float, float, float]
"""xx, yy, zz, xy, xz, yz of a symmetric tensor."""
Three = tuple[float, float, float]
"""x, y, z."""


@dataclass(frozen=True)
class Inertial:
    """Mass distribution of a rigid part in some frame."""

    mass: float
    """Mass [kg]."""
    com: Three
    """Centre of mass [m]."""
    inertia: Six
    """xx, yy, zz, xy, xz, yz of the inertia tensor about the centre of mass, axes of the frame [kg m²]."""

    @property
    def matrix(self) -> np.ndarray:
        """Inertia tensor about the centre of mass, shape (3, 3) [kg m²]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def placed(self, position: Three, roll: float = 0.0) -> "Inertial":
        """Return the part in a frame in which its own frame is at `position` [m], turned by `roll` [rad] about x."""
        R = rotation_x(roll)
        x, y, z = (np.array(position) + R @ self.com).tolist()
        return Inertial(self.mass, (x, y, z), _six(R @ self.matrix @ R.T))

    def scaled(self, factor: float) -> "Inertial":
        """Return the same shape with `factor` times the density."""
        return Inertial(self.mass * factor, self.com, _six(factor * self.matrix))

    def stretched(self, factor: float) -> "Inertial":
        """Return the part stretched along x: the x coordinate of every point is multiplied by `factor`.

        The mass is multiplied by `factor`, and the second moment ∫ x² dm about the centre by its third power. So a
        uniform rod still has the inertia m l² / 12.
        """
        moments = 0.5 * np.trace(self.matrix) * np.eye(3) - self.matrix
        S = np.diag([factor, 1.0, 1.0])
        moments = factor * (S @ moments @ S)
        x, y, z = self.com
        return Inertial(factor * self.mass, (factor * x, y, z), _six(np.trace(moments) * np.eye(3) - moments))


def _six(I: np.ndarray) -> Six:
    return float(I[0, 0]), float(I[1, 1]), float(I[2, 2]), float(I[0, 1]), float(I[0, 2]), float(I[1, 2])


def merge(*parts: Inertial) -> Inertial:
    """Merge several parts given in one frame into one rigid body (parallel axis theorem)."""
    mass = sum(part.mass for part in parts)
    com = np.sum([part.mass * np.array(part.com) for part in parts], axis=0) / mass
    I = np.zeros((3, 3))
    for part in parts:
        S = skew(np.array(part.com) - com)
        I += part.matrix - part.mass * S @ S
    x, y, z = com.tolist()
    return Inertial(mass, (x, y, z), _six(I))
