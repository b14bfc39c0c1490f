"""NumPy reference of native/engine/body.c: writes masses, friction and actuators into MuJoCo's model."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import mujoco
import numpy as np

from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_LEGS, N_LINKS, N_ROTORS, ROBOT, ROTOR_SITES
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.scene import TIMESTEP


def gain(c: ActuatorConfig) -> np.ndarray:
    """Thrust over commanded thrust of each module."""
    return c.thrust_gain * c.module_gain


def offsets(c: ActuatorConfig) -> np.ndarray:
    """True minus indicated value of all actuators: thrusts, joints, vectoring angles."""
    return np.concatenate([np.zeros(N_ROTORS), c.joint_offset, c.vectoring_offset.reshape(-1)])


def delay_steps(c: ActuatorConfig) -> tuple[int, int]:
    """Physics steps between a command and the actuators: thrusts and joints, vectoring servos."""
    delay = round(c.delay / TIMESTEP)
    return delay, delay + round(c.vectoring_delay / TIMESTEP)


def is_asymmetric(c: ActuatorConfig) -> bool:
    """Whether an actuator is direction-dependent: falling thrusts have another lag, or joints have play."""
    return c.backlash > 0.0 or c.spin_down != 1.0


def write_actuators(c: ActuatorConfig, model: mujoco.MjModel, joint_speed: float) -> None:  # pyright: ignore[reportAttributeAccessIssue] - compiled, without stubs
    """Write all actuator parameters that MuJoCo models; every value of an earlier configuration is overwritten."""
    rotors, joints, gimbals = (
        np.array([model.actuator(name).id for name in names]) for names in (ROTOR_SITES, JOINT_NAMES, GIMBAL_NAMES)
    )
    tilt_x, tilt_y = c.thrust_tilt.T
    x, y = c.thrust_offset.T
    gear = np.zeros((N_ROTORS, 6))
    gear[:, :3] = np.stack([np.sin(tilt_y), -np.sin(tilt_x) * np.cos(tilt_y), np.cos(tilt_x) * np.cos(tilt_y)], 1)
    # Torque of the force at (x, y, 0), and of two ducts at ± d on the y axis with unequal thrusts.
    gear[:, 3:] = np.cross(np.stack([x, y, np.zeros(N_ROTORS)], 1), gear[:, :3])
    gear[:, 3] += ROBOT.duct_offset_y * c.duct_imbalance
    model.actuator_gear[rotors] = gain(c)[:, None] * gear
    model.actuator_ctrlrange[rotors, 1] = model.actuator_actrange[rotors, 1] = c.max_thrust / gain(c)
    model.actuator_dynprm[rotors, 0] = c.thrust_lag
    model.actuator_dynprm[joints, 1] = joint_speed * c.joint_speed_factor * c.servo_speed
    model.actuator_biasprm[joints, 0] = 0.0
    model.actuator_biasprm[joints, 1] = -c.joint_kp * c.servo_stiffness
    model.actuator_biasprm[joints, 2] = -c.joint_kd
    model.actuator_biasprm[gimbals, 0] = 0.0
    model.actuator_biasprm[gimbals, 1] = -c.vectoring_kp
    model.actuator_biasprm[gimbals, 2] = -ROBOT.vectoring_kd
    dofs = [model.joint(name).dofadr[0] for name in JOINT_NAMES]
    model.dof_frictionloss[dofs] = c.joint_friction
    model.dof_damping[dofs] = c.joint_damping


def write_body(c: BodyConfig, model: mujoco.MjModel, nominal: mujoco.MjModel) -> None:
    """Write masses and friction into the model, starting from the nominal one."""
    mass, inertia, com = nominal.body_mass.copy(), nominal.body_inertia.copy(), nominal.body_ipos.copy()
    for i in range(N_LINKS):
        parts = (f"junction{i + 1}", f"link{i + 1}", f"gimbal{i + 1}_roll_module", f"gimbal{i + 1}_pitch_module")
        for name in parts:
            body = nominal.body(name).id
            mass[body] *= c.link_mass[i]
            inertia[body] *= c.link_mass[i]
        link = nominal.body(f"link{i + 1}").id
        inertia[link] *= c.inertia[i]
        com[link] += c.link_com[i]
    com[nominal.body("torso").id] += c.torso_com
    factor = c.total_mass / mass.sum()
    model.body_mass[:], model.body_inertia[:], model.body_ipos[:] = mass * factor, inertia * factor, com
    if c.payload_mass > 0.0:
        torso = nominal.body("torso").id
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, nominal.body_iquat[torso])
        R = R.reshape(3, 3)
        own, lever = model.body_mass[torso], c.payload_position - com[torso]
        total = own + c.payload_mass
        S = own * c.payload_mass / total * (lever @ lever * np.eye(3) - np.outer(lever, lever))
        moments, axes = np.linalg.eigh(R @ np.diag(inertia[torso] * factor) @ R.T + S)
        axes[:, 2] *= np.linalg.det(axes)
        mujoco.mju_mat2Quat(model.body_iquat[torso], axes.reshape(-1))
        model.body_mass[torso], model.body_inertia[torso] = total, moments
        model.body_ipos[torso] = com[torso] + c.payload_mass / total * lever
    touching = nominal.geom_conaffinity > 0
    feet = [nominal.geom(f"foot{leg}").id for leg in range(1, N_LEGS + 1)]
    model.geom_friction[touching, 0] = c.peg_friction
    model.geom_friction[feet, 0] = c.foot_friction
    # Quantities that MuJoCo derives from the masses.
    mujoco.mj_setConst(model, mujoco.MjData(model))
