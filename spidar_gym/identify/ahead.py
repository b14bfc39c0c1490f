"""Held-out fit of a flight: where the robot is one second later, predicted from a measured state and the commands.

The seconds lie outside the swings from which gains and lags are estimated. The model is simulated without air but for
its steady wrench in each form, which is one of the estimates: what eddies and gusts do in a second is the least error.
"""

# pyright: reportAttributeAccessIssue=false
# MuJoCo comes without stubs.

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco import rollout
from scipy.spatial.transform import Rotation

from spidar_gym.identify.excitation import excitations_of
from spidar_gym.identify.hovers import Hovers, driven_span, lagged
from spidar_gym.identify.motion import Motion, motion_of
from spidar_gym.identify.servos import Servos
from spidar_gym.identify.shooting import in_order
from spidar_gym.identify.smooth import smoothed
from spidar_gym.logs.record import Record
from spidar_gym.native.plant import Plant
from spidar_gym.onboard.runner_structs import Excited
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.sim.sensors import IMU_POSITION_B

SECONDS, EVERY = 1.0, 0.5
"""Length of a prediction, and distance of their begins [s]."""
KNOTS = 0.1
"""Distance of the knots of the spline through the motion capture's positions [s]."""


@dataclass(frozen=True)
class Ahead:
    """RMS errors of predictions one second ahead."""

    position: float
    """Position of the inertial unit [m]."""
    attitude: float
    """Attitude of the torso [rad]."""
    joints: float
    """Angles of the joints [rad]."""


def predict(
    record: Record, mass: float, delay: float, servos: Servos | None, hovers: Hovers | None, robot: RobotSpec = ROBOT,
    threads: int = 2,
) -> tuple[Ahead, int]:  # fmt: skip
    """Predict a flight one second ahead, again and again, where nothing was fitted.

    Args:
        record: The log.
        mass: Mass of the robot [kg].
        delay: Delay of the commands [s].
        servos: Joint servos; as described if None.
        hovers: Modules; as described if None.
        robot: The described robot.
        threads: Threads that simulate.

    Returns:
        The errors, and the number of predictions.
    """
    motion = motion_of(record)
    begins = _begins(record, motion)
    config = PlantConfig.of(robot)
    config = replace(config, body=replace(config.body, total_mass=mass))
    if hovers is not None:
        config = replace(
            config, body=replace(config.body, torso_com=hovers.torso_com.value),
            actuators=replace(config.actuators, thrust_tilt=hovers.tilt.value),
        )  # fmt: skip
    model = Plant(config).model
    gain, lag = np.ones(N_ROTORS), np.full(N_ROTORS, robot.thrust_lag)
    speed = np.full(N_JOINTS, robot.joint_speed)
    joints, gimbals = (slice(N_ROTORS, N_ROTORS + N_JOINTS), slice(N_ROTORS + N_JOINTS, N_ROTORS + N_JOINTS + 16))
    moved = model.actuator_trnid[N_ROTORS : N_ROTORS + N_JOINTS + 2 * N_ROTORS, 0]
    qpos, dof = model.jnt_qposadr[moved], model.jnt_dofadr[moved]
    if hovers is not None:
        gain, lag = hovers.gain.value, hovers.lag.value
    if servos is not None:
        speed = servos.speed.value
        model.actuator_biasprm[joints, 1:3] = -np.stack([servos.stiffness.value, servos.damping.value], axis=1)
        model.dof_damping[dof[:N_JOINTS]], model.dof_frictionloss[dof[:N_JOINTS]] = 0.0, servos.friction.value
    model.actuator_dynprm[:N_ROTORS, 0], model.actuator_dynprm[joints, 1] = lag, speed
    sent = record["four_axes/command"]
    # The motion is at 100 Hz, so that a begin is at a sample; the controls are held over physics steps.
    steps = round(SECONDS / TIMESTEP)
    path = smoothed(record["mocap/pose"].time, record["mocap/pose"].values["position_w"], KNOTS)
    commands = [gain * sent.values["base_thrust"]]
    for topic, names in (("joints_ctrl", JOINT_NAMES), ("gimbals_ctrl", GIMBAL_NAMES)):
        commands.append(in_order(record[topic].names, record[topic].values["position"], names))
    come = [record[topic].received + delay for topic in ("four_axes/command", "joints_ctrl", "gimbals_ctrl")]
    thrust = lagged(motion.time, sent.received, commands[0], delay, lag)
    setpoints = _limited(come[1], commands[1], motion.time, speed)
    data, kind = mujoco.MjData(model), mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts, controls = [], []
    for k in begins:
        now, R = motion.time[k], motion.R_wb[k]
        times = now + np.arange(steps) * TIMESTEP
        held = [
            values[np.maximum(np.searchsorted(at, times + 1e-6, side="right") - 1, 0)]
            for at, values in zip(come, commands, strict=True)
        ]
        controls.append(np.concatenate([*held, np.tile(_steady(hovers, motion, k, model.nv), (steps, 1))], axis=1))
        lever, omega_w = R @ IMU_POSITION_B, R @ motion.omega_b[k]
        data.qpos[:3], data.qvel[:3] = path(now) - lever, path.derivative()(now) - np.cross(omega_w, lever)
        data.qpos[3:7], data.qvel[3:6] = Rotation.from_matrix(R).as_quat()[[3, 0, 1, 2]], motion.omega_b[k]
        data.qpos[qpos], data.qvel[dof] = motion.angle[k], motion.rate[k]
        data.act[:N_ROTORS], data.act[joints], data.act[gimbals] = thrust[k], setpoints[k], held[2][0]
        state = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, state, kind)
        starts.append(state)
    threads_data = [mujoco.MjData(model) for _ in range(threads)]
    given = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED
    states = np.asarray(
        rollout.rollout(model, threads_data, np.array(starts), np.array(controls), control_spec=int(given))[0]
    )
    last = states[:, -1, 1 : 1 + model.nq]
    then = begins + round(SECONDS / (motion.time[1] - motion.time[0]))
    turned = Rotation.from_quat(last[:, [4, 5, 6, 3]])
    place = last[:, :3] + turned.apply(IMU_POSITION_B)
    errors = (
        place - path(motion.time[then]), (Rotation.from_matrix(motion.R_wb[then]).inv() * turned).as_rotvec(),
        last[:, qpos[:N_JOINTS]] - motion.angle[then, :N_JOINTS],
    )  # fmt: skip
    position, attitude = (float(np.sqrt((own**2).sum(axis=1).mean())) for own in errors[:2])
    return Ahead(position, attitude, float(np.sqrt((errors[2] ** 2).mean()))), len(begins)


def _steady(hovers: Hovers | None, motion: Motion, k: int, dofs: int) -> np.ndarray:
    """Return the steady force of the air at a sample, as a generalised force: that of the nearest form, and wind."""
    applied = np.zeros(dofs)
    if hovers is not None:
        near = int(np.abs(hovers.forms - motion.angle[k, :N_JOINTS]).max(axis=1).argmin())
        air = hovers.air.value[near]
        applied[:3], applied[3:6] = motion.R_wb[k] @ air[:3], air[3:]
        applied[:2] += hovers.wind.value
    return applied


def _begins(record: Record, motion: Motion) -> np.ndarray:
    """Return the samples at which predictions begin: while the runner drives, and no thrust swings."""
    start, end = driven_span(record)
    times = np.arange(start + 1.0, end - SECONDS - 0.5, EVERY)
    for each in excitations_of(record):
        if each.excited == Excited.THRUST:
            times = times[(times + SECONDS < start + each.start) | (times > start + each.end)]
    return np.searchsorted(motion.time, times)


def _limited(come: np.ndarray, values: np.ndarray, times: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return the servos' setpoints, which follow the commands at a limited speed, at given times (n, 16) [rad]."""
    held = values[np.maximum(np.searchsorted(come, times, side="right") - 1, 0)]
    found, present = np.empty_like(held), held[0].copy()
    for k, way in enumerate(np.diff(times, prepend=times[0])):
        present = present + np.clip(held[k] - present, -speed * way, speed * way)
        found[k] = present
    return found
