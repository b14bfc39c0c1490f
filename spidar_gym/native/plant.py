"""One simulated robot of an engine in Python: `step(Command) → RobotState`, with saving and restoring."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import mujoco
import numpy as np

from spidar_gym.arrays import JointVector, Quaternion, RotorVector, Vector3, Vectoring
from spidar_gym.errors import InvalidValueError
from spidar_gym.native import limits
from spidar_gym.native.draws import from_numpy
from spidar_gym.native.engine_binding import Engine, check_delay
from spidar_gym.native.engine_structs import AIR_STEPS, engine_layouts
from spidar_gym.native.library import pointer
from spidar_gym.native.structs import WORDS, fill, read
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS
from spidar_gym.sim.config import NEEDS_RNG, PlantConfig
from spidar_gym.sim.disturbances import PUSH_SECONDS, Disturbances
from spidar_gym.sim.energy import CAPACITY_WH, USABLE
from spidar_gym.sim.ground import Touch
from spidar_gym.sim.object import ObjectState
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.state import Command, Measurement, Reference, RobotState

_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_POSE = np.dtype(
    [("position_w", "f8", 3), ("quat_wb", "f8", 4), ("joint_position", "f8", N_JOINTS),
     ("vectoring", "f8", 2 * N_ROTORS), ("thrust", "f8", N_ROTORS), ("motion", "f8", 6), ("object", "f8", 7)]
)  # fmt: skip
"""`sp_pose`."""


@dataclass(frozen=True)
class Saved:
    """Saved state of one simulated robot; `Plant.restore` continues from it bit for bit."""

    robot: bytes
    """Bytes of its record."""
    model: bytes
    """Bytes of its part of MuJoCo's model."""


def read_state(record: np.ndarray | np.void) -> RobotState:
    """Copy a state of the library into a dataclass."""
    r = record
    return RobotState(
        float(r["time"]), r["position_w"].copy(), r["quat_wb"].copy(), r["velocity_w"].copy(), r["omega_b"].copy(),
        r["joint_position"].copy(), r["joint_velocity"].copy(), r["vectoring"].reshape(N_ROTORS, 2).copy(),
        r["vectoring_velocity"].reshape(N_ROTORS, 2).copy(), r["thrust"].copy(), r["joint_torque"].copy(),
    )  # fmt: skip


def read_command(record: np.ndarray | np.void) -> Command:
    """Copy a command of the library into a dataclass."""
    return Command(
        record["thrust"].copy(), record["vectoring"].reshape(N_ROTORS, 2).copy(), record["joint_position"].copy(),
        record["joint_torque_limit"].copy(),
    )  # fmt: skip


def read_reference(record: np.ndarray | np.void) -> Reference:
    """Copy a reference of the library into a dataclass."""
    masks = {name: record[name] != 0 for name in ("lost_thrust", "lost_vectoring")}
    names = [f.name for f in fields(Reference) if f.name not in ("mode", "support", *masks)]
    arrays = {name: record[name].copy() for name in names}
    mode = WORDS["reference", "mode"][int(record["mode"])]
    return Reference(**arrays, **masks, mode=mode, support=float(record["support"]))


class Plant:
    """One simulated robot over a floor.

    Its joint servos compute τ = k_{j,p} (q^d − q) − k_{j,d} q̇ [Zhao2025, Eq. 17] at every physics step, within their
    torque limit. The rate of the setpoint is limited to the joint speed.
    """

    def __init__(self, config: PlantConfig | None = None, *, engine: Engine | None = None) -> None:
        """Make a robot, or view the only robot of an engine.

        Raises:
            StaleAssetError: Where the model file was edited by hand.
            InvalidValueError: For a delay that is too long.
        """
        given = config or PlantConfig()
        self._look(engine or Engine("plant", given, 1, 1, alike=False), given)

    def _look(self, engine: Engine, config: PlantConfig | None) -> None:
        """View the only robot of an engine."""
        self._config, self._engine, robots = config, engine, engine.robots
        self._records = robots["plant"] if "plant" in (robots.dtype.names or ()) else robots
        self.record: Any = self._records[0]
        """`sp_plant`: configuration and state."""
        simulation = engine.simulations[0]
        self.model, self.data = simulation.model, simulation.data
        self._pose, self._command = np.zeros(1, _POSE), np.zeros(1, engine_layouts()["command"])

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy: the engine, without the views of its memory."""
        self.keep()
        return {"engine": self._engine, "config": self._config}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy that views the copied engine's robot."""
        self._look(state["engine"], state["config"])
        self._engine.run("sp_refresh_plants")

    @property
    def records(self) -> np.ndarray:
        """`record` as an array of length 1."""
        return self._records

    @property
    def config(self) -> PlantConfig:
        """Configuration of the robot, as given or randomised."""
        if self._config is None:
            self._config = replace(read(PlantConfig, self.record["config"]), robot=self._engine.robot)
        return self._config

    def reread(self) -> None:
        """Read `config` from the record again, after the engine may have changed it."""
        self._config = None

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.config.substeps * TIMESTEP

    def configure(self, config: PlantConfig, *, goes_on: bool = False) -> None:
        """Change the configuration from the next reset on, or with `goes_on` from the next tick on.

        Raises:
            InvalidValueError: For another robot, or a world of another kind.
        """
        if config.robot != self._engine.robot:
            raise InvalidValueError("robot", f"{config.robot.total_mass:.4g} kg", "the robot given at construction")
        kinds = [(c.ground.uneven, c.ground.boxed, c.object.exists) for c in (config, self.config)]
        if kinds[0] != kinds[1]:
            raise InvalidValueError("tiles, boxes, object", kinds[0], "the kind of world given at construction")
        check_delay(config)
        configs = np.zeros(1, engine_layouts()["plant_config"])
        fill(configs[0], config)
        self._engine.configure(configs, goes_on=goes_on)
        self._config = config

    def reset(
        self,
        position_w: Vector3,
        quat_wb: Quaternion = _LEVEL,
        joint_position: JointVector | None = None,
        vectoring: Vectoring | None = None,
        thrust: RotorVector | None = None,
        *,
        disturbances: Disturbances | None = None,
        rng: np.random.Generator | None = None,
        spent_wh: float | None = None,
        motion: np.ndarray | None = None,
        object_pose: np.ndarray | None = None,
    ) -> RobotState:
        """Place the robot, servos at their setpoints and at rest.

        Args:
            position_w: Origin of the torso [m].
            quat_wb: Attitude (w, x, y, z).
            joint_position: q [rad]; zero by default.
            vectoring: (φ, θ) [rad]; zero by default.
            thrust: Thrust that the modules already deliver [N]; zero by default.
            disturbances: Disturbances and fault; none by default.
            rng: Generator of everything that is sampled, `PlantConfig.draws`; it is copied and not advanced.
            spent_wh: Energy that its battery lacks [Wh]; by default as configured.
            motion: Velocity of the torso's origin, world [m/s], and its angular velocity, torso axes [rad/s], shape
                (6,); at rest by default.
            object_pose: Position [m] and attitude (w, x, y, z) of the object at rest, shape (7,); by default level on
                the floor at the origin.

        Raises:
            InvalidValueError: For a configuration that draws, wind or pushes without a generator.
        """
        disturbances = disturbances or Disturbances()
        actuators = self.config.actuators
        if rng is None and (self.config.draws or disturbances.has_weather):
            raise InvalidValueError("rng", rng, NEEDS_RNG)
        fill(self.record["disturbances"], disturbances)
        self.record["spent_wh"] = actuators.battery_spent * USABLE * CAPACITY_WH if spent_wh is None else spent_wh
        if rng is not None:
            self.record["generator"] = from_numpy(rng)
        return self.place(position_w, quat_wb, joint_position, vectoring, thrust, motion, object_pose)

    def place(
        self,
        position_w: Vector3,
        quat_wb: Quaternion = _LEVEL,
        joint_position: JointVector | None = None,
        vectoring: Vectoring | None = None,
        thrust: RotorVector | None = None,
        motion: np.ndarray | None = None,
        object_pose: np.ndarray | None = None,
    ) -> RobotState:
        """Reset as `reset` does, with the present disturbances, generator and battery."""
        pose = self._pose[0]
        pose["position_w"], pose["quat_wb"] = position_w, quat_wb
        pose["joint_position"] = 0.0 if joint_position is None else joint_position
        pose["vectoring"] = 0.0 if vectoring is None else vectoring.reshape(-1)
        pose["thrust"] = 0.0 if thrust is None else thrust
        pose["motion"] = 0.0 if motion is None else motion
        level = [0.0, 0.0, self.config.object.scale[2], *_LEVEL]
        pose["object"] = level if object_pose is None else object_pose
        self._engine.run("sp_reset_plants", None, self._pose)
        return self.state()

    def clamp(self, position_w: Vector3, stiffness: float = 2e4, damping: float = 600.0) -> None:
        """Clamp the level torso to a stand; `reset` the robot there afterwards.

        Args:
            position_w: Origin of the torso at rest [m].
            stiffness: Stiffness of the stand [N/m], and about each axis [Nm/rad].
            damping: Its damping [N s/m], and a fifth of it about each axis [Nm s/rad].
        """
        self.model.jnt_stiffness[0] = stiffness
        self.model.qpos_spring[:7] = [*position_w, *_LEVEL]
        own = self.model.dof_damping.copy()
        own[:3], own[3:6] = damping, 0.2 * damping
        self._engine.write_copy(0, "dof_damping", own)

    def disturb(self, disturbances: Disturbances, towards: float = 0.0) -> None:
        """Change the disturbances from now on, without a reset; a rotor that no longer has a fault recovers.

        Args:
            disturbances: New disturbances. `fault_time` counts from the reset. The first push starts at once.
            towards: Direction that the wind blows to, 0 along x, π/2 along y [rad].

        Raises:
            InvalidValueError: For wind or pushes if the reset received no generator.
        """
        record, weather = self.record, self.record["weather"]
        if disturbances.has_weather and not any(record["generator"].tobytes()):
            raise InvalidValueError("rng", None, "a generator at the reset, where there is to be wind or pushes")
        before = read(Disturbances, record["disturbances"])
        fill(record["disturbances"], disturbances)
        if (before.lost_rotor, before.fault) != (disturbances.lost_rotor, disturbances.fault):
            record["is_stuck"] = 0  # else the fault would persist for a rotor that is no longer named
        weather["mean_w"] = disturbances.wind * np.array([math.cos(towards), math.sin(towards), 0.0])
        if not disturbances.wind:
            weather["gust_w"] = 0.0
        if not disturbances.push:
            weather["push_w"], weather["next_push"] = 0.0, math.inf
        elif not math.isfinite(weather["next_push"]):
            weather["next_push"] = self.state().time
        record["has_air"] = bool(record["has_air"]) or disturbances.has_weather

    def shove(self, force_w: Vector3) -> None:
        """Push the torso for 0.2 s from now on, in addition to the disturbances [N]."""
        weather = self.record["weather"]
        if not self.record["disturbances"]["push"]:
            # Pushes are applied only if `push` is positive. No random push follows, as `next_push` is infinite.
            self.record["disturbances"]["push"] = float(np.linalg.norm(force_w))
        # The push starts at the next evaluation of the weather, and its duration counts from there.
        weather["push_w"], weather["push_end"] = force_w, self.state().time + AIR_STEPS * TIMESTEP + PUSH_SECONDS
        self.record["has_air"] = True

    def step(self, command: Command) -> RobotState:
        """Advance by one control period.

        Args:
            command: Thrusts are clipped to idle … the module's maximum (λ̄, its gain, the battery), after the board's
                scaling; joint setpoints to ± 90°, and slewed by the servos.

        Returns:
            The true state at the end of the period; if the robot has `diverged`, the last finite one.
        """
        self.keep()
        fill(self._command[0], command)
        self._engine.run("sp_step_plants", None, self._command)
        return self.state()

    def keep(self) -> None:
        """Store the state in `data` as the robot's, so that values written there count."""
        self._engine.call("sp_keep_now", self._engine.address)

    def state(self) -> RobotState:
        """Return the true state."""
        return read_state(self.record["state"])

    def measure(self) -> Measurement:
        """Return the sensor readings since the last call (`InvalidValueError` where `sense` is off)."""
        if not self.record["senses"]:
            raise InvalidValueError("sense", self.config.sense, "True at the reset")
        found = np.zeros((), engine_layouts()["measurement"])
        self._engine.call("sp_measure", pointer(self._engine.robots), pointer(found))
        shapes = {"pose_position_w": (-1, 3), "pose_quat_wb": (-1, 4), "gyro_b": (-1, 3), "specific_force_b": (-1, 3),
                  "vectoring": (N_ROTORS, 2)}  # fmt: skip
        values = {}
        for name in found.dtype.names or ():
            values[name] = found[name].reshape(shapes[name]) if name in shapes else found[name]
        numbers = {name: value.item() for name, value in values.items() if value.ndim == 0}
        return Measurement(**(values | numbers))

    @property
    def diverged(self) -> bool:
        """Whether the state is not finite, or its norm exceeds 10⁶ (SI units)."""
        return bool(self.record["diverged"])

    @property
    def in_contact(self) -> bool:
        """Whether any part of the robot touches the floor."""
        return bool(self.record["in_contact"])

    @property
    def hit(self) -> float:
        """Largest force since the last command on anything but feet and pegs, with boxes only [N]."""
        return float(self.record["hit"])

    @property
    def violated(self) -> int:
        """Constraints violated since `forgive` or the reset: bit k is the k-th of `VIOLATIONS`."""
        return int(self.record["violated"])

    def forgive(self) -> None:
        """Clear `violated`."""
        self.record["violated"] = 0

    def touch(self) -> Touch:
        """Evaluate the floor contacts and their slip."""
        found = np.zeros((), engine_layouts()["touch"])
        self._engine.call("sp_touching_now", self._engine.address, pointer(found))
        balls = found["balls"] != 0
        return Touch(
            balls[:N_LEGS], balls[N_LEGS:], bool(found["ducts"]), found["slip"][:N_LEGS], found["slip"][N_LEGS:],
            float(found["duct_clearance"]), float(found["hit"]),
        )  # fmt: skip

    def object(self) -> ObjectState:
        """Return the state of the object (`InvalidValueError` without one)."""
        if not self.config.object.exists:
            raise InvalidValueError("object", "none", "a PlantConfig with an object")
        record = self.record["object"]
        vectors = {name: record[name].copy() for name in record.dtype.names if name not in ("is_hit", "rests")}
        vectors["foot_force_w"] = vectors["foot_force_w"].reshape(N_LEGS, 3)
        return ObjectState(**vectors, is_hit=bool(record["is_hit"]))

    def contact_forces(self) -> np.ndarray:
        """Return position and force of each contact with floor or boxes, on the robot, world: (k, 6) [m, N]."""
        data, wrench = self.data, np.zeros(6)
        last = self.model.nbody - 1 if self.config.object.exists else self.model.nbody
        ours = np.flatnonzero((self.model.geom_bodyid[data.contact.geom] < last).all(axis=1))
        rows = np.zeros((len(ours), 6))
        for row, k in enumerate(ours):
            mujoco.mj_contactForce(self.model, data, k, wrench)
            force = data.contact.frame[k].reshape(3, 3).T @ wrench[:3]
            # MuJoCo returns the force on the second geom.
            is_ours = self.model.geom_bodyid[data.contact.geom[k, 1]] > 0
            rows[row, :3], rows[row, 3:] = data.contact.pos[k], force if is_ours else -force
        return rows

    @property
    def thrust_factor(self) -> RotorVector:
        """Thrust of each module over its thrust in still air."""
        factor = self.record["air_factor"]
        return 0.5 * (factor[::2] + factor[1::2])

    @property
    def air_force(self) -> Vector3:
        """Force of the air on the whole robot besides its thrust in still air, world [N]."""
        return self.record["air_force_w"].copy()

    @property
    def power(self) -> float:
        """Electrical power now [W]."""
        return float(self.record["power"])

    @property
    def energy_wh(self) -> float:
        """Electrical energy since the reset [Wh]."""
        return float(self.record["energy_wh"])

    @property
    def mean_power(self) -> float:
        """Mean electrical power since the reset [W]."""
        energy, time = float(self.record["energy_wh"]), float(self.record["state"]["time"])
        return 3600.0 * energy / time if energy > 0.0 else float(self.record["power"])

    def net_wrench(self) -> tuple[Vector3, Vector3]:
        """Compute force, world [N], and torque about the torso's origin, torso axes [Nm], of rotors and weight.

        At rest and without the air, both are zero for a robot that hovers.
        """
        data: Any = self.data  # one of its arrays is declared without a type
        net = data.qfrc_actuator - data.qfrc_bias
        return net[:3], net[3:6]

    def close(self) -> None:
        """Stop the engine's threads; a second call has no effect."""
        self._engine.close()

    def save(self) -> Saved:
        """Save the complete state; `restore` continues from it bit for bit."""
        self.keep()
        return Saved(self._records.tobytes(), self._engine.copies.tobytes())

    def fault_of(self, saved: Saved) -> str:
        """Describe what is invalid in a saved state of this kind of simulation; return "" if it is valid."""
        record = np.frombuffer(saved.robot, self._records.dtype)
        copies = np.frombuffer(saved.model, np.uint8)[None]
        fault = limits.fault_of("plant", record) or self._engine.fault_of_copies(copies)
        return fault or limits.differs("plant_config", record["config"], self._records["config"], ("i4",))

    def restore(self, saved: Saved) -> RobotState:
        """Restore a saved state (`InvalidValueError` for that of another kind of simulation)."""
        sizes = self._records.nbytes, self._engine.copies.nbytes
        if (len(saved.robot), len(saved.model)) != sizes:
            given = len(saved.robot), len(saved.model)
            raise InvalidValueError("saved", given, f"a saved state of {sizes[0]} and {sizes[1]} bytes from save()")
        with self._engine.turn.lock:
            self._records[:] = np.frombuffer(saved.robot, self._records.dtype)
            self._engine.copies[0] = np.frombuffer(saved.model, np.uint8)
            self.refresh()
            return self.state()

    def refresh(self) -> None:
        """Load the robot into `model` and `data`, after its memory was written from elsewhere."""
        self._engine.forget_copies()
        self._engine.run("sp_refresh_plants")
        self.reread()
