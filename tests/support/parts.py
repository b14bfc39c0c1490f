"""Positions and masses of the robot's parts by Pinocchio, with which tests compare sums and engines."""

import numpy as np
import pinocchio as pin

from spidar_gym.model.dynamics import Model
from spidar_gym.robot import ROTOR_SITES


def configure(model: Model, q, vectoring):
    """Pinocchio's model and work space, and the configuration of these joint and vectoring angles [rad]."""
    model._q[model._q_joint] = q
    model._q[model._q_gimbal] = vectoring.reshape(-1)
    return model._model, model._data, model._q


def segments(model: Model, q, vectoring):
    """Masses (k,) [kg], CoGs from the torso's origin (k, 3) [m] and Jacobians (k, 3, 16) of the k = 33 segments."""
    robot, data, configuration = configure(model, q, vectoring)
    pin.computeJointJacobians(robot, data, configuration)
    masses, positions, jacobians = [], [], []
    for j in range(1, robot.njoints):
        inertia, placement = robot.inertias[j], data.oMi[j]
        position = placement.act(inertia.lever)
        J = pin.getJointJacobian(robot, data, j, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        offset = position - placement.translation
        masses.append(inertia.mass)
        positions.append(position)
        jacobians.append((J[:3] + np.cross(J[3:].T, offset).T)[:, model._v_joint])
    return np.array(masses), np.array(positions), np.array(jacobians)


def rotors(model: Model, q, vectoring):
    """Positions from the torso's origin (8, 3) [m] and attitudes (8, 3, 3) of the thrust frames."""
    robot, data, configuration = configure(model, q, vectoring)
    pin.framesForwardKinematics(robot, data, configuration)
    placements = [data.oMf[robot.getFrameId(name)] for name in ROTOR_SITES]
    return np.array([p.translation for p in placements]), np.array([p.rotation for p in placements])


def mass_matrix(model: Model, q, vectoring):
    """Joint-space inertia (38, 38) with a free torso at the origin, and the names of its joints, root first."""
    robot, data, configuration = configure(model, q, vectoring)
    upper = np.triu(pin.crba(robot, data, configuration))
    return upper + np.triu(upper, 1).T, list(robot.names)[1:]
