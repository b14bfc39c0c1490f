"""The robot's numbers for the core and the engine: data, so that one library serves all robots."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

from functools import lru_cache

import numpy as np
import pinocchio as pin

from spidar_gym.model.dynamics import build_model
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.robot import GIMBAL_NAMES, GRAVITY, JOINT_NAMES, N_ROTORS, ROBOT, RobotSpec


@lru_cache(maxsize=64)
def robot(spec: RobotSpec = ROBOT) -> np.ndarray:
    """Return `sp_robot`, read only: the kinematic tree of a robot, and its limits."""
    record = np.zeros((), core_layouts()["robot"])
    model = build_model(spec)
    bodies = {name: joint - 1 for joint, name in enumerate(model.names)}  # Pinocchio's joint 0 is the universe
    names = (*JOINT_NAMES, *GIMBAL_NAMES)
    for joint in range(1, model.njoints):
        body, inertia = record["tree"][joint - 1], model.inertias[joint]
        body["rotation"] = np.eye(3).reshape(-1)
        if joint > 1:  # the first is the torso; every other body follows its parent
            placement = model.jointPlacements[joint]
            body["parent"], body["joint"] = model.parents[joint] - 1, names.index(model.names[joint])
            body["rotation"], body["position"] = placement.rotation.reshape(-1), placement.translation
            body["axis"] = _axis(model, joint)
        body["mass"], body["com"], body["inertia"] = inertia.mass, inertia.lever, inertia.inertia.reshape(-1)
    record["joint_body"] = [bodies[name] for name in JOINT_NAMES]
    record["link_body"] = [bodies[f"joint{i}_pitch"] for i in range(1, N_ROTORS + 1)]
    record["rotor_body"] = [bodies[f"gimbal{i}_pitch"] for i in range(1, N_ROTORS + 1)]
    record["gravity"] = GRAVITY
    for name in names_of(record)[names_of(record).index("weight") :]:
        record[name] = getattr(spec, name)
    record.setflags(write=False)
    return record


def names_of(record: np.ndarray) -> tuple[str, ...]:
    """Return the names of a record's members."""
    assert record.dtype.names is not None
    return record.dtype.names


def _axis(model: object, joint: int) -> np.ndarray:
    """Return the axis of a revolute joint in its own frame."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    J = pin.computeJointJacobian(model, data, pin.neutral(model), joint)
    return np.round(J[3:, model.idx_vs[joint]], 12) + 0.0
