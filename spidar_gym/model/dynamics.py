"""Kinematics and dynamics with Pinocchio: (joint angles, attitude, vectoring angles) → `Snapshot` of a control tick.

Frames: `b` torso origin and axes, `c` CoG with torso axes (the paper's {CoG}), `l` axes of the link that carries a
rotor. Joint-space quantities hold the torso fixed.
"""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below have no type stubs.

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from spidar_gym.arrays import FootForces, JointVector, Matrix3, RotorForces, Vector3, Vectoring
from spidar_gym.robot import (
    CONTACT_SITES,
    GIMBAL_NAMES,
    GRAVITY,
    JOINT_NAMES,
    N_JOINTS,
    N_LEGS,
    N_ROTORS,
    ROBOT,
    RobotSpec,
)
from spidar_gym.robot.description import model_file
from spidar_gym.so3 import CROSS


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Model quantities at one configuration: the coefficients of the centroidal dynamics [Zhao2025, Eq. 3-5].

    Torso axes unless the suffix names other axes.
    """

    mass: float
    """Total mass mΣ [kg]."""
    com_b: Vector3
    """Position of the CoG from the torso's origin [m]."""
    inertia_c: Matrix3
    """Centroidal inertia IΣ(q) [kg m²]."""
    R_bl: Float[np.ndarray, "8 3 3"]
    """Attitude of each rotor's link."""
    rotor_c: RotorForces
    """Rotor centres p_i from the CoG [m]; they depend on φ, because the rotor is 27 mm below the φ axis."""
    J_rotor: Float[np.ndarray, "8 3 16"]
    """∂(rotor centre)/∂q, torso held fixed [m/rad]: the paper's J_r."""
    joint_axes: Float[np.ndarray, "3 16"]
    """Direction of each joint's axis."""
    gravity_torque: JointVector
    """Joint torque that holds the links against gravity without thrust, −Σ J_sᵀ m_s g [Nm]."""
    momentum_map: Float[np.ndarray, "6 16"]
    """Linear and angular momentum about the CoG per joint velocity, torso held fixed [kg m, kg m²]."""
    robot: RobotSpec = ROBOT
    """The robot of these quantities; the controller reads its limits here."""


@dataclass(frozen=True, slots=True)
class Feet:
    """The foot spheres' centres at one configuration, torso axes."""

    position_b: FootForces
    """Positions from the torso's origin [m]."""
    J: Float[np.ndarray, "4 3 16"]
    """∂(centre)/∂q, torso held fixed [m/rad]."""


@lru_cache(maxsize=64)
def build_model(robot: RobotSpec) -> pin.Model:
    """Build Pinocchio's model of a robot, shared and read-only (`StaleAssetError` if the committed MJCF was edited)."""
    with model_file(robot) as path:
        return pin.buildModelFromMJCF(str(path))


class Model:
    """A robot's kinematics and mass distribution; owns Pinocchio's workspace."""

    def __init__(self, robot: RobotSpec = ROBOT) -> None:
        """Load the robot's MJCF (`StaleAssetError` if the committed one was edited)."""
        self.robot = robot
        """The modelled robot."""
        self._model = build_model(robot)
        self._data = self._model.createData()
        self._q = pin.neutral(self._model)
        self._no_velocity = np.zeros(self._model.nv)
        joint = self._model.getJointId
        self._q_joint = np.array([self._model.idx_qs[joint(name)] for name in JOINT_NAMES])
        self._v_joint = np.array([self._model.idx_vs[joint(name)] for name in JOINT_NAMES])
        self._q_gimbal = np.array([self._model.idx_qs[joint(name)] for name in GIMBAL_NAMES])
        self._mass = float(pin.computeTotalMass(self._model))
        # Views into Pinocchio's memory: they contain the results of the latest forward pass.
        self._J, self._com = self._data.J, self._data.com[0]
        self._link_views = [self._data.oMi[joint(f"joint{i}_pitch")].rotation for i in range(1, N_ROTORS + 1)]
        self._rotor_views = [self._data.oMi[joint(f"gimbal{i}_pitch")].translation for i in range(1, N_ROTORS + 1)]
        self._knee_views = [self._data.oMi[joint(f"joint{2 * leg}_pitch")] for leg in range(1, N_LEGS + 1)]
        self._foot = np.array([robot.pitch_to_foot, 0.0, 0.0])
        self._carries = np.array([[[j // 4 == leg] for j in range(N_JOINTS)] for leg in range(N_LEGS)], float)
        self._carries = self._carries.transpose(0, 2, 1)
        # A rotor is moved by the joints between the torso and its link: two for an inner link, all four of the leg
        # for an outer one.
        self._moves = np.array(
            [[[j // 4 == i // 2 and (i % 2 == 1 or j % 4 < 2) for j in range(N_JOINTS)]] for i in range(N_ROTORS)],
            float,
        )

    def __reduce__(self) -> tuple[type["Model"], tuple[RobotSpec]]:
        """Pickle the robot only: the copy builds its own model, because copied views would refer to no workspace."""
        return type(self), (self.robot,)

    def snapshot(self, q: JointVector, R_wb: Matrix3, vectoring: Vectoring) -> Snapshot:
        """Compute all model quantities of one control tick.

        Args:
            q: Joint angles [rad].
            R_wb: Attitude of the torso, for the direction of gravity.
            vectoring: (φ, θ) of each rotor [rad].

        Returns:
            The snapshot, independent of the model's workspace.
        """
        configuration, data, joints = self._q, self._data, self._v_joint
        configuration[self._q_joint] = q
        configuration[self._q_gimbal] = vectoring.reshape(-1)
        momentum = pin.ccrba(self._model, data, configuration, self._no_velocity).take(joints, axis=1)
        rotors = np.array(self._rotor_views)
        # Velocity of a point per joint, v = v_O + ω × p = v_O − [p]ₓ ω, for all rotors and joints.
        J = self._J.take(joints, axis=1)
        J_rotor = J[:3] - (rotors @ CROSS).reshape(N_ROTORS, 3, 3) @ J[3:]
        J_rotor *= self._moves
        com = self._com.copy()
        return Snapshot(
            mass=self._mass,
            com_b=com,
            inertia_c=data.Ig.inertia,
            R_bl=np.array(self._link_views),
            rotor_c=rotors - com,
            J_rotor=J_rotor,
            joint_axes=J[3:],
            # The rate at which a joint lifts the CoG, times the weight: −Σ J_sᵀ m_s g = mΣ g ∂(height)/∂q.
            gravity_torque=(GRAVITY * R_wb[2]) @ momentum[:3],
            momentum_map=momentum,
            robot=self.robot,
        )

    def stance(self, q: JointVector, R_wb: Matrix3, vectoring: Vectoring) -> tuple[Snapshot, Feet]:
        """Compute the `snapshot` and the positions and Jacobians of the feet."""
        snapshot = self.snapshot(q, R_wb, vectoring)
        feet = np.array([placement.translation + placement.rotation @ self._foot for placement in self._knee_views])
        J = self._J.take(self._v_joint, axis=1)
        J_foot = J[:3] - (feet @ CROSS).reshape(N_LEGS, 3, 3) @ J[3:]
        J_foot *= self._carries
        return snapshot, Feet(feet, J_foot)

    def contacts(self, q: JointVector) -> tuple[np.ndarray, np.ndarray]:
        """Positions from the torso's origin (12, 3) [m] and Jacobians (12, 3, 16) of the points in `CONTACT_SITES`."""
        self._q[self._q_joint] = q
        self._q[self._q_gimbal] = 0.0
        pin.computeJointJacobians(self._model, self._data, self._q)
        pin.updateFramePlacements(self._model, self._data)
        ids = [self._model.getFrameId(name) for name in CONTACT_SITES]
        world_aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobians = [pin.getFrameJacobian(self._model, self._data, i, world_aligned)[:3, self._v_joint] for i in ids]
        return np.array([self._data.oMf[i].translation for i in ids]), np.array(jacobians)
