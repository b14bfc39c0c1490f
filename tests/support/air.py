"""Poses of the robot in the air, what the air does to them, and modules that hang alone."""

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
"""What the air looks at."""
LINKS, TORSO = slice(N_DUCTS, N_DUCTS + 24), slice(N_DUCTS + 24, N_DUCTS + 29)
"""Where the stations of links and torso are among the forces."""


@cache
def world() -> mujoco.MjModel:
    """One model for all tests."""
    return scene(visual=False)


def posed(q, vectoring, R_wb=LEVEL, position=HIGH, velocity=0.0) -> mujoco.MjData:
    """The robot somewhere, its kinematics done; `velocity` is that of all degrees of freedom, or the torso's."""
    model, data = world(), mujoco.MjData(world())
    data.qpos[:3], data.qpos[3:7] = position, matrix_to_quat(R_wb)
    for names, angles in ((JOINT_NAMES, q), (GIMBAL_NAMES, np.reshape(vectoring, -1))):
        data.qpos[[model.joint(name).qposadr[0] for name in names]] = angles
    data.qvel[: np.size(velocity)] = velocity
    mujoco.mj_forward(model, data)
    return data


def evaluate(data, thrust=HOVER, wind=STILL, noise=NONE, push=STILL, **config) -> AirForces:
    """What the air does, with parameters of its own."""
    simulation = Simulation(world())
    for name in SEEN:
        getattr(simulation.data, name)[:] = getattr(data, name)
    wind_w, push_w = np.array(wind, float), np.array(push, float)
    return evaluate_air(simulation, thrust, wind_w=wind_w, noise=noise, push_w=push_w, config=AeroConfig(**config))


def evaluate_reference(data, thrust=HOVER, wind=STILL, noise=NONE, push=STILL, **config):
    """The same by the readable reference."""
    air = reference.Aero(world(), data, AeroConfig(**config))
    return air.evaluate(thrust, wind_w=np.array(wind, float), noise=noise, push_w=np.array(push, float))
