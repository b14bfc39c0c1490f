"""Array types for the annotations of this package, each with its shape.

With jaxtyping's import hook (switched on in the tests) every call is checked against these shapes.
"""

import numpy as np
from jaxtyping import Bool, Float

Vector3 = Float[np.ndarray, "3"]
"""A vector in three-dimensional space; the variable's suffix names its frame."""
Matrix3 = Float[np.ndarray, "3 3"]
"""A rotation matrix `R_ab` (maps b to a) or an inertia tensor."""
Quaternion = Float[np.ndarray, "4"]
"""A unit quaternion in the order w, x, y, z."""
Wrench = Float[np.ndarray, "6"]
"""Force [N] and torque [Nm] about the CoG, in torso axes."""
JointVector = Float[np.ndarray, "16"]
"""One number per joint, in the paper's order q₁ … q₁₆."""
RotorVector = Float[np.ndarray, "8"]
"""One number per rotor module, rotor 1 first."""
RotorMask = Bool[np.ndarray, "8"]
"""One truth value per rotor module."""
RotorForces = Float[np.ndarray, "8 3"]
"""One force [N] per rotor module; the variable's suffix names its frame."""
LegMask = Bool[np.ndarray, "4"]
"""One truth value per leg, front left first."""
FootForces = Float[np.ndarray, "4 3"]
"""One force [N] or position [m] per foot; the variable's suffix names its frame."""
Vectoring = Float[np.ndarray, "8 2"]
"""The vectoring angles (φ, θ) [rad] of each rotor module."""


def constant(value: float | bool, *shape: int) -> np.ndarray:
    """Return a read-only array filled with one number or truth value, for defaults of dataclasses."""
    array = np.full(shape, value)
    array.flags.writeable = False
    return array
