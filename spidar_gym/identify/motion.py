"""Motion of a robot from a log, smoothed: attitude, rates and accelerations of torso, joints and gimbals."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo comes without stubs.

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from spidar_gym.identify.estimate import UnfitLogError
from spidar_gym.identify.shooting import in_order
from spidar_gym.identify.smooth import smoothed
from spidar_gym.logs.record import Record
from spidar_gym.native.plant import Plant
from spidar_gym.robot import GIMBAL_NAMES, GRAVITY, JOINT_NAMES, N_JOINTS, N_LINKS, N_ROTORS
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.sensors import IMU_PERIOD, IMU_POSITION_B

FINE, COARSE, SLOW = 0.02, 0.05, 0.1
"""Distances of the knots of the splines that smooth the inertial unit, the encoders and the motion capture [s]."""
CORRECTION, BIAS_CORRECTION = 0.02, 0.002
"""Share of the difference from a frame of the motion capture by which the attitude and the gyroscope's bias move."""
EDGE = 0.3
"""Time at both ends of a log that is not used [s]."""
EVERY = 2
"""Samples of the inertial unit for each sample of the motion: 100 Hz, far above the motion of the robot."""


@dataclass(frozen=True)
class Motion:
    """Motion of a robot at 100 Hz."""

    time: np.ndarray
    """(n,) [s]."""
    R_wb: np.ndarray
    """Attitude of the torso, (n, 3, 3)."""
    omega_b: np.ndarray
    """Angular velocity, torso axes, (n, 3) [rad/s]."""
    alpha_b: np.ndarray
    """Angular acceleration, torso axes, (n, 3) [rad/s²]."""
    specific_force_b: np.ndarray
    """Acceleration of the inertial unit minus gravity, torso axes, without the accelerometer's bias, (n, 3) [m/s²]."""
    angle: np.ndarray
    """Angles of joints and gimbals, (n, 32) [rad]."""
    rate: np.ndarray
    """Their rates, (n, 32) [rad/s]."""
    acceleration: np.ndarray
    """Their accelerations, (n, 32) [rad/s²]."""


def motion_of(record: Record, late: tuple[float, float] = (0.0, 0.0)) -> Motion:
    """Return the motion of a robot in a log.

    The attitude is that of the motion capture, between whose frames the gyroscope is integrated.

    Args:
        record: The log.
        late: How much later than their values the stamps of accelerometer and encoders are [s].

    Raises:
        UnfitLogError: For a log without inertial unit, motion capture or joint states.
    """
    for topic in ("imu", "mocap/pose", "joint_states"):
        if topic not in record:
            raise UnfitLogError(topic, "a log of a flight with motion capture")
    unit, seen, joints = record["imu"], record["mocap/pose"], record["joint_states"]
    at = (unit.time > unit.time[0] + EDGE) & (unit.time < unit.time[-1] - EDGE)
    time, gyro = unit.time[at][::EVERY], unit.values["angular_velocity"]
    R_wb, bias = _attitude(unit.time, gyro, seen.time, seen.values["quat_wb"])
    turn, push = smoothed(unit.time, gyro - bias, FINE), smoothed(unit.time, unit.values["specific_force"], FINE)
    angles = in_order(joints.names, joints.values["position"], (*JOINT_NAMES, *GIMBAL_NAMES))
    angle = smoothed(joints.time, angles, COARSE)
    # Over the whole log the velocity changes by little, so that the mean of the acceleration is known well.
    velocity = smoothed(seen.time, seen.values["position_w"], SLOW).derivative()
    mean = (velocity(time[-1]) - velocity(time[0])) / (time[-1] - time[0]) + np.array([0.0, 0.0, GRAVITY])
    force, R = push(time + late[0]), R_wb[at][::EVERY]
    off = np.linalg.solve(R.mean(axis=0), (R @ force[..., None])[..., 0].mean(axis=0) - mean)
    seen_at = time + late[1]
    return Motion(
        time, R, turn(time), turn.derivative()(time), force - off, angle(seen_at), angle.derivative()(seen_at),
        angle.derivative(2)(seen_at),
    )  # fmt: skip


def _attitude(
    time: np.ndarray, gyro: np.ndarray, seen: np.ndarray, quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return attitudes (n, 3, 3) at the gyroscope's samples, and its bias at the end (3,) [rad/s]."""
    frames, found = Rotation.from_quat(quat[:, [1, 2, 3, 0]]), np.empty((len(time), 3, 3))
    present, bias, k = frames[0], np.zeros(3), 0
    for i, now in enumerate(time):
        present = present * Rotation.from_rotvec((gyro[i] - bias) * IMU_PERIOD)
        while k < len(seen) and seen[k] <= now + 1e-9:
            off = (present.inv() * frames[k]).as_rotvec()
            present, bias, k = present * Rotation.from_rotvec(CORRECTION * off), bias - BIAS_CORRECTION * off, k + 1
        found[i] = present.as_matrix()
    return found, bias


class Dynamics:
    """Inverse dynamics of a robot's model: wrenches in torso axes, torques about the torso's origin."""

    def __init__(self, config: PlantConfig) -> None:
        """Build the model of a robot."""
        self._model = model = Plant(config).model
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self._data = mujoco.MjData(model)
        moved = model.actuator_trnid[N_ROTORS : N_ROTORS + N_JOINTS + 2 * N_ROTORS, 0]
        self._qpos, self._dof = model.jnt_qposadr[moved], model.jnt_dofadr[moved]
        self._sites = model.actuator_trnid[:N_ROTORS, 0]
        self._bodies = [model.body(name).id for name in ("torso", *(f"link{k + 1}" for k in range(N_LINKS)))]

    def needed(self, motion: Motion) -> np.ndarray:
        """Return the wrench that accelerates the robot as logged, gravity apart, (n, 6) [N, Nm]."""
        found = np.empty((len(motion.time), 6))
        for k, R in enumerate(self._at_each(motion)):
            found[k] = self._data.qfrc_inverse[:6]
            found[k, :3] = R.T @ found[k, :3]
        return found

    def parts(self, motion: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the needed wrench and what it consists of.

        Returns:
            The needed wrench (n, 6); the wrench by a force of 1 N of each module along its axes x, y and z,
            (n, 6, 8, 3); and the wrench of gravity by a shift of the centre of mass of torso and each link along its
            axes, (n, 6, 9, 3) [1/m].
        """
        model, data, n = self._model, self._data, len(motion.time)
        needed, module, com = np.empty((n, 6)), np.empty((n, 6, N_ROTORS, 3)), np.zeros((n, 6, 1 + N_LINKS, 3))
        weight = model.body_mass[self._bodies, None, None] * model.opt.gravity
        for k, R in enumerate(self._at_each(motion)):
            needed[k] = data.qfrc_inverse[:6]
            needed[k, :3] = R.T @ needed[k, :3]
            axes = data.site_xmat[self._sites].reshape(N_ROTORS, 3, 3).transpose(0, 2, 1)
            module[k, :3] = np.einsum("cr,mac->rma", R, axes)
            module[k, 3:] = np.einsum("cr,mac->rma", R, np.cross(data.site_xpos[self._sites][:, None], axes))
            own = data.xmat[self._bodies].reshape(-1, 3, 3).transpose(0, 2, 1)
            com[k, 3:] = np.einsum("cr,mac->rma", R, np.cross(own, weight))
        return needed, module, com

    def _at_each(self, motion: Motion) -> Iterator[np.ndarray]:
        """Put the model into each instant of a motion, with the inverse dynamics computed; yields the attitude."""
        data, gravity = self._data, self._model.opt.gravity
        quat = Rotation.from_matrix(motion.R_wb).as_quat()[:, [3, 0, 1, 2]]
        lever = np.cross(motion.alpha_b, IMU_POSITION_B)
        lever = lever + np.cross(motion.omega_b, np.cross(motion.omega_b, IMU_POSITION_B))
        acceleration = np.einsum("nij,nj->ni", motion.R_wb, motion.specific_force_b - lever) + gravity
        data.qpos[:3], data.qvel[:3] = 0.0, 0.0
        for k, R in enumerate(motion.R_wb):
            data.qpos[3:7], data.qvel[3:6] = quat[k], motion.omega_b[k]
            data.qacc[:3], data.qacc[3:6] = acceleration[k], motion.alpha_b[k]
            data.qpos[self._qpos], data.qvel[self._dof] = motion.angle[k], motion.rate[k]
            data.qacc[self._dof] = motion.acceleration[k]
            mujoco.mj_inverse(self._model, data)
            yield R
