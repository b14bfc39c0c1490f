"""The owner of MuJoCo: `step(Command) → RobotState`, with exact saving and restoring."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import copy
import logging
import math
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from spidar_gym.arrays import JointVector, Quaternion, RotorVector, Vector3, Vectoring
from spidar_gym.description import mjcf_path
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS, ROBOT, ROTOR_SITES
from spidar_gym.state import Command, RobotState

# MuJoCo would write its warnings into a file of the working folder.
mujoco.set_mju_user_warning(logging.getLogger("spidar_gym.mujoco").warning)

TIMESTEP = 0.0025
"""Physics step [s], implicitfast."""
MAX_WIDTH, MAX_HEIGHT = 1920, 1080
"""Largest picture [px]."""
_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class PlantConfig:
    """What can be chosen about the simulated robot."""

    substeps: int = 10
    """Physics steps a control period: 10 × 2.5 ms = 25 ms, 40 Hz."""
    joint_speed: float = ROBOT.joint_speed
    """The joint servos' setpoints move no faster than this [rad/s]: the one joint speed limit there is."""
    idle_thrust: float = 0.0
    """Least thrust of a module [N]; `ROBOT.idle_thrust` for armed motors."""

    def __post_init__(self) -> None:
        """Refuse what cannot be simulated."""
        if self.substeps < 1:
            raise InvalidValueError("substeps", self.substeps, "a whole number of at least 1")
        if not (math.isfinite(self.joint_speed) and self.joint_speed > 0.0):
            raise InvalidValueError("joint_speed", self.joint_speed, "a number above 0 [rad/s]")
        if not 0.0 <= self.idle_thrust <= ROBOT.max_thrust:
            raise InvalidValueError("idle_thrust", self.idle_thrust, f"a number within 0 … {ROBOT.max_thrust:g} N")


@cache
def scene(visual: bool) -> mujoco.MjModel:
    """The robot over a floor; without `visual` the geoms that only please the eye are left out, a third of a step."""
    spec = mujoco.MjSpec.from_file(str(mjcf_path()))
    if not visual:
        for geom in list(spec.geoms):
            if geom.contype == 0 and geom.conaffinity == 0:
                spec.delete(geom)
    world = spec.worldbody
    floor = world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    floor.contype, floor.conaffinity, floor.friction = 1, 0, [0.8, 0.005, 0.0001]
    if visual:
        spec.visual.headlight.ambient = [0.4, 0.4, 0.4]
        spec.visual.headlight.diffuse = [0.3, 0.3, 0.3]
        getattr(spec.visual, "global").offwidth = MAX_WIDTH
        getattr(spec.visual, "global").offheight = MAX_HEIGHT
        # Off-screen pictures are mostly drawn by the processor: a reflection, a large shadow map and multiple
        # sampling would each cost more than the robot.
        spec.visual.quality.shadowsize = 1024
        spec.visual.quality.offsamples = 0
        builtin = mujoco.mjtBuiltin
        spec.add_texture(
            name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=builtin.mjBUILTIN_GRADIENT,
            rgb1=[0.75, 0.83, 0.92], rgb2=[0.95, 0.96, 0.97], width=256, height=1536,
        )  # fmt: skip
        spec.add_texture(
            name="grid", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=builtin.mjBUILTIN_CHECKER,
            rgb1=[0.72, 0.74, 0.76], rgb2=[0.78, 0.80, 0.82], width=512, height=512,
            mark=mujoco.mjtMark.mjMARK_EDGE, markrgb=[0.6, 0.62, 0.65],
        )  # fmt: skip
        grid = spec.add_material(name="grid", texrepeat=[1, 1], texuniform=True)
        grid.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
        floor.material = "grid"
        world.add_light(
            pos=[0, 0, 5], dir=[0, 0, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            castshadow=True, diffuse=[0.45, 0.45, 0.45], specular=[0.2, 0.2, 0.2],
        )  # fmt: skip
    model = spec.compile()
    # A state that diverges must be seen, not silently reset.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


class Plant:
    """One simulated robot over a floor.

    Its joint servos run τ = k_{j,p} (q^d − q) − k_{j,d} q̇ [Zhao2025, Eq. 17] at every physics step, on a setpoint that
    moves no faster than the joint speed, within their torque limit.
    """

    def __init__(self, config: PlantConfig | None = None) -> None:
        """Compile the scene (`StaleAssetError` where the model file was edited by hand)."""
        self.config = config or PlantConfig()
        self.model = copy.copy(scene(visual=False))
        self.data = mujoco.MjData(self.model)
        self.period = self.config.substeps * TIMESTEP
        """Control period [s]."""
        # Views into MuJoCo's memory, made once: every access to an attribute of MjData makes a new one.
        self._q, self._v, self._a = self.data.qpos, self.data.qvel, self.data.act
        self._control, self._force = self.data.ctrl, self.data.actuator_force
        joints = [self.model.joint(name) for name in (*JOINT_NAMES, *GIMBAL_NAMES)]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._qvel = np.array([joint.dofadr[0] for joint in joints])
        servos = [self.model.actuator(name) for name in (*ROTOR_SITES, *JOINT_NAMES, *GIMBAL_NAMES)]
        # `_actuators[k]` is the k-th of eight thrusts, sixteen joints, sixteen vectoring angles, in this order.
        self._ctrl = np.array([self.model.actuator_ctrladr[servo.id] for servo in servos])
        self._act = np.array([self.model.actuator_actadr[servo.id] for servo in servos])
        self._joint_servos = np.array([servo.id for servo in servos[N_ROTORS : N_ROTORS + N_JOINTS]])
        self.model.actuator_dynprm[self._joint_servos, 1] = self.config.joint_speed  # the pid servo's slewmax
        self._torque_limit = np.full(N_JOINTS, ROBOT.max_joint_torque)
        self._targets = np.zeros(N_ROTORS + 2 * N_JOINTS)
        self._in_contact = False

    def reset(
        self,
        position_w: Vector3,
        quat_wb: Quaternion = _LEVEL,
        joint_position: JointVector | None = None,
        vectoring: Vectoring | None = None,
        thrust: RotorVector | None = None,
    ) -> RobotState:
        """Put the robot somewhere at rest, servos at their setpoints.

        Args:
            position_w: Origin of the torso [m].
            quat_wb: Attitude (w, x, y, z).
            joint_position: q [rad]; zero by default.
            vectoring: (φ, θ) [rad]; zero by default.
            thrust: Thrust that the modules already deliver [N]; zero by default.
        """
        mujoco.mj_resetData(self.model, self.data)
        targets = self._targets
        targets[:N_ROTORS] = 0.0 if thrust is None else thrust
        targets[N_ROTORS : N_ROTORS + N_JOINTS] = 0.0 if joint_position is None else joint_position
        targets[N_ROTORS + N_JOINTS :] = 0.0 if vectoring is None else vectoring.reshape(-1)
        self.data.qpos[:3] = position_w
        self.data.qpos[3:7] = quat_wb
        self.data.qpos[self._qpos] = targets[N_ROTORS:]
        self.data.act[self._act] = targets
        self.data.ctrl[self._ctrl] = targets
        self._limit_torque(np.full(N_JOINTS, ROBOT.max_joint_torque))
        mujoco.mj_forward(self.model, self.data)
        self._in_contact = self.data.ncon > 0
        return self.state()

    def step(self, command: Command) -> RobotState:
        """Advance by one control period.

        Args:
            command: Thrusts are clipped to idle … λ̄, joint setpoints to ± 90° and slewed by the servos.

        Returns:
            The true state at the end of the period.
        """
        targets = self._targets
        targets[:N_ROTORS] = command.thrust
        targets[N_ROTORS : N_ROTORS + N_JOINTS] = command.joint_position
        targets[N_ROTORS + N_JOINTS :] = command.vectoring.reshape(-1)
        if self.config.idle_thrust > 0.0:
            np.maximum(targets[:N_ROTORS], self.config.idle_thrust, out=targets[:N_ROTORS])
        self._control[self._ctrl] = targets
        if not (command.joint_torque_limit == self._torque_limit).all():
            self._limit_torque(command.joint_torque_limit.copy())
        mujoco.mj_step(self.model, self.data, self.config.substeps)
        self._in_contact = self.data.ncon > 0
        return self.state()

    def state(self) -> RobotState:
        """The true state."""
        q, v = self._q.take(self._qpos), self._v.take(self._qvel)
        return RobotState(
            time=self.data.time,
            position_w=self._q[:3].copy(),
            quat_wb=self._q[3:7].copy(),
            velocity_w=self._v[:3].copy(),
            omega_b=self._v[3:6].copy(),
            joint_position=q[:N_JOINTS],
            joint_velocity=v[:N_JOINTS],
            vectoring=q[N_JOINTS:].reshape(N_ROTORS, 2),
            vectoring_velocity=v[N_JOINTS:].reshape(N_ROTORS, 2),
            thrust=self._a.take(self._act[:N_ROTORS]),
            joint_torque=self._force.take(self._joint_servos),
        )

    @property
    def in_contact(self) -> bool:
        """Whether any part of the robot touches the floor."""
        return self._in_contact

    @property
    def diverged(self) -> bool:
        """Whether the state is no longer finite, or faster than anything that flies (10⁶ rad/s, m/s)."""
        return not float(self._q @ self._q + self._v @ self._v) < 1e12

    def save(self) -> np.ndarray:
        """The full state of the simulation as one vector; `restore` continues from it bit for bit."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return np.concatenate([state, self.data.actuator_force, self._torque_limit, [self._in_contact]])

    def restore(self, saved: np.ndarray) -> RobotState:
        """Return to a saved state (`InvalidValueError` for a vector of another length)."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        sizes = mujoco.mj_stateSize(self.model, kind), self.model.nu, N_JOINTS, 1
        if saved.shape != (sum(sizes),):
            raise InvalidValueError("saved", saved.shape, f"a vector of {sum(sizes)} numbers from save()")
        state, force, limit, contact = np.split(saved, np.cumsum(sizes)[:-1])
        mujoco.mj_setState(self.model, self.data, state, kind)
        self._limit_torque(limit.copy())
        mujoco.mj_forward(self.model, self.data)
        # The forward pass looks at the present instant; a step leaves what it saw at the start of its last substep.
        self.data.actuator_force[:] = force
        self._in_contact = bool(contact[0])
        return self.state()

    def _limit_torque(self, limit: JointVector) -> None:
        self._torque_limit = limit
        bound = np.minimum(limit, ROBOT.max_joint_torque)
        self.model.actuator_forcerange[self._joint_servos, 0] = -bound
        self.model.actuator_forcerange[self._joint_servos, 1] = bound
