"""What a gripped object adds to the flight controller: forces of the feet, its weight, and its top as a target of jets.

The feet press on the object with F_k. These forces enter the joints' balance, τ_q = g + Σ J_kᵀ F_k − T f, so that the
allocation makes the grip with servos and thrust, and their sum, the object's weight, enters the desired wrench.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spidar_gym.arrays import FootForces, JointVector, Matrix3, Vector3, Wrench
from spidar_gym.model.dynamics import Feet, Snapshot
from spidar_gym.model.interference import Disc
from spidar_gym.robot import GRAVITY, N_LEGS

LEVER = 1.2
"""Longest horizontal lever of a payload from the torso's origin [m]: no leg reaches farther, and the weight of an
object that was left behind must not tilt the robot."""
LEAD_TIME = 0.3
"""Time constant with which joint setpoints follow the torques of a grip [s]: a shorter one excites badly damped joints
whose feet press."""


@dataclass(frozen=True, slots=True)
class Grip:
    """An object near the robot, and what the legs do with it."""

    position_w: Vector3
    """Origin of the object, in its middle, world [m]."""
    radius: float
    """Radius of the object for the jets [m]; 0 where they do not avoid it."""
    top: float
    """Height of its top over the origin [m]."""
    force: float = 0.0
    """Force of each foot towards the object's vertical axis [N]."""
    payload: float = 0.0
    """Mass that the legs carry [kg]."""

    def centre_b(self, R_wb: Matrix3, position_w: Vector3) -> Vector3:
        """Return the object's origin from the torso's, torso axes [m]."""
        return R_wb.T @ (self.position_w - position_w)

    def foot_forces(self, feet: Feet, R_wb: Matrix3, position_w: Vector3) -> FootForces:
        """Return the planned force of each foot on the object, torso axes [N]."""
        up = R_wb[2]
        inwards = self.centre_b(R_wb, position_w) - feet.position_b
        inwards -= np.outer(inwards @ up, up)
        inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-6)
        return self.force * inwards + self.payload * GRAVITY / N_LEGS * up

    def carried(self, snapshot: Snapshot, R_wb: Matrix3, position_w: Vector3) -> Wrench:
        """Return the wrench in {CoG} that carries the payload [N, Nm]."""
        up = R_wb[2]
        lever = self.centre_b(R_wb, position_w) - snapshot.com_b
        across = lever - (lever @ up) * up
        lever *= min(1.0, LEVER / max(float(np.linalg.norm(across)), 1e-6))
        force = self.payload * GRAVITY * up
        return np.concatenate((force, np.cross(lever, force)))

    def disc(self, snapshot: Snapshot, R_wb: Matrix3, position_w: Vector3) -> Disc:
        """Return the top of the object as a target that jets avoid [Zhao2025, Eq. 20-27]."""
        return Disc(self.centre_b(R_wb, position_w) + self.top * R_wb[2] - snapshot.com_b, self.radius)


def grip_torque(forces_b: FootForces, J: Float[np.ndarray, "4 3 16"]) -> JointVector:
    """Return the joint torque Σ J_kᵀ F_k of forces of the feet on an object [Nm]."""
    return np.einsum("kij,ki->j", J, forces_b)
