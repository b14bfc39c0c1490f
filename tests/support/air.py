"""Poses of the robot in the air, and the forces of the air on them by the core and by the reference."""

# pyright: reportAttributeAccessIssue=false

from functools import cache

import mujoco
import numpy as np
from reference import air as reference

from spidar_gym.native.formulas import AirForces, evaluate_air
from spidar_gym.native.mujoco import Simulation
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, ROBOT
from spidar_gym.sim.air import N_DUCTS, AeroConfig
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import matrix_to_quat

HIGH = np.array([0.0, 0.0, 5.0])
LEVEL = np.eye(3)
HOVER = np.full(8, ROBOT.hover_thrust)
STILL, NONE = np.zeros(3), np.zeros(8)
RADIUS = ROBOT.propeller_radius
SEEN = ("qpos", "qvel", "xpos", "xmat", "cvel", "cdof", "subtree_com")
"""Fields of `MjData` which the air model reads."""
LINKS, TORSO = slice(N_DUCTS, N_DUCTS + 24), slice(N_DUCTS + 24, N_DUCTS + 29)
"""Stations of the links and of the torso among the forces."""


@cache
def world() -> mujoco.MjModel:
    """One model for all tests."""
    return scene(visual=False)


def posed(q, vectoring, R_wb=LEVEL, position=HIGH, velocity=0.0) -> mujoco.MjData:
    """The robot in a pose, after forward kinematics; `velocity` covers all degrees of freedom or the first few."""
    model, data = world(), mujoco.MjData(world())
    data.qpos[:3], data.qpos[3:7] = position, matrix_to_quat(R_wb)
    for names, angles in ((JOINT_NAMES, q), (GIMBAL_NAMES, np.reshape(vectoring, -1))):
        data.qpos[[model.joint(name).qposadr[0] for name in names]] = angles
    data.qvel[: np.size(velocity)] = velocity
    mujoco.mj_forward(model, data)
    return data


def evaluate(
    data, thrust=HOVER, wind=STILL, noise=NONE, push=STILL, *, recirculation=None, eddy=None, simulation=None, **config
) -> AirForces:
    """Forces of the air by the core; `config` replaces parameters."""
    simulation = simulation or Simulation(world())
    for name in SEEN:
        getattr(simulation.data, name)[:] = getattr(data, name)
    wind_w, push_w = np.array(wind, float), np.array(push, float)
    return evaluate_air(
        simulation, thrust, wind_w=wind_w, noise=noise, push_w=push_w, config=AeroConfig(**config),
        recirculation=recirculation, eddy=eddy,
    )  # fmt: skip


def evaluate_reference(
    data, thrust=HOVER, wind=STILL, noise=NONE, push=STILL, *, recirculation=None, eddy=None, **config
):
    """Forces of the air by the Python reference."""
    air = reference.Aero(world(), data, AeroConfig(**config), recirculation)
    return air.evaluate(thrust, wind_w=np.array(wind, float), noise=noise, push_w=np.array(push, float), eddy=eddy)
