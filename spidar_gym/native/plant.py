"""One simulated robot of an engine, as Python sees it: `step(Command) → RobotState`, with saving and restoring."""

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
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import PUSH_SECONDS, Disturbances
from spidar_gym.sim.ground import Touch
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.state import Command, Measurement, Reference, RobotState

_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_POSE = np.dtype(
    [("position_w", "f8", 3), ("quat_wb", "f8", 4), ("joint_position", "f8", N_JOINTS),
     ("vectoring", "f8", 2 * N_ROTORS), ("thrust", "f8", N_ROTORS), ("motion", "f8", 6)]
)  # fmt: skip
"""`sp_pose`."""


@dataclass(frozen=True)
class Saved:
    """A moment of one simulated robot; `Plant.restore` continues from it bit for bit."""

    robot: bytes
    """Its record."""
    model: bytes
    """Its part of MuJoCo's model."""


def read_state(record: np.ndarray | np.void) -> RobotState:
    """A state of the library as a dataclass of its own arrays."""
    r = record
    return RobotState(
        float(r["time"]), r["position_w"].copy(), r["quat_wb"].copy(), r["velocity_w"].copy(), r["omega_b"].copy(),
        r["joint_position"].copy(), r["joint_velocity"].copy(), r["vectoring"].reshape(N_ROTORS, 2).copy(),
        r["vectoring_velocity"].reshape(N_ROTORS, 2).copy(), r["thrust"].copy(), r["joint_torque"].copy(),
    )  # fmt: skip


def read_command(record: np.ndarray | np.void) -> Command:
    """A command of the library as a dataclass of its own arrays."""
    return Command(
        record["thrust"].copy(), record["vectoring"].reshape(N_ROTORS, 2).copy(), record["joint_position"].copy(),
        record["joint_torque_limit"].copy(),
    )  # fmt: skip


def read_reference(record: np.ndarray | np.void) -> Reference:
    """A reference of the library as a dataclass of its own arrays."""
    masks = {name: record[name] != 0 for name in ("lost_thrust", "lost_vectoring")}
    names = [f.name for f in fields(Reference) if f.name not in ("mode", "support", *masks)]
    arrays = {name: record[name].copy() for name in names}
    mode = WORDS["reference", "mode"][int(record["mode"])]
    return Reference(**arrays, **masks, mode=mode, support=float(record["support"]))


class Plant:
    """One simulated robot over a floor.

    Its joint servos run τ = k_{j,p} (q^d − q) − k_{j,d} q̇ [Zhao2025, Eq. 17] at every physics step, on a setpoint that
    moves no faster than the joint speed, within their torque limit.
    """

    def __init__(self, config: PlantConfig | None = None, *, engine: Engine | None = None) -> None:
        """Make one, or look at the robot of an engine that has just this one.

        Raises:
            StaleAssetError: Where the model file was edited by hand.
            InvalidValueError: For a delay that is too long.
        """
        given = config or PlantConfig()
        self._look(engine or Engine("plant", given, 1, 1, alike=False), given)

    def _look(self, engine: Engine, config: PlantConfig | None) -> None:
        """Look at the one robot of an engine."""
        self._config, self._engine, robots = config, engine, engine.robots
        self._records = robots["plant"] if "plant" in (robots.dtype.names or ()) else robots
        self.record: Any = self._records[0]
        """`sp_plant`: what it is, and all that changes about it."""
        simulation = engine.simulations[0]
        self.model, self.data = simulation.model, simulation.data
        self._pose, self._command = np.zeros(1, _POSE), np.zeros(1, engine_layouts()["command"])

    def __getstate__(self) -> dict[str, Any]:
        """What a copy is made of: the engine, not the views of its memory."""
        self.keep()
        return {"engine": self._engine, "config": self._config}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Become a copy that looks at the copied engine's robot."""
        self._look(state["engine"], state["config"])
        self._engine.run("sp_refresh_plants")

    @property
    def records(self) -> np.ndarray:
        """`record` as an array of one."""
        return self._records

    @property
    def config(self) -> PlantConfig:
        """What was chosen about the robot, or drawn."""
        if self._config is None:
            self._config = replace(read(PlantConfig, self.record["config"]), robot=self._engine.robot)
        return self._config

    def reread(self) -> None:
        """The engine may have made another robot of it."""
        self._config = None

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.config.substeps * TIMESTEP

    def configure(self, config: PlantConfig) -> None:
        """Become another robot from the next reset on (`InvalidValueError` for another spec or kind of floor)."""
        if config.robot != self._engine.robot:
            raise InvalidValueError("robot", f"{config.robot.total_mass:.4g} kg", "the description of the beginning")
        kinds = [(each.uneven, each.boxed) for each in (config.ground, self.config.ground)]
        if kinds[0] != kinds[1]:
            raise InvalidValueError("tiles, boxes", kinds[0], "a floor of the same kind as at the beginning")
        check_delay(config)
        configs = np.zeros(1, engine_layouts()["plant_config"])
        fill(configs[0], config)
        self._engine.configure(configs)
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
        spent_wh: float = 0.0,
        motion: np.ndarray | None = None,
    ) -> RobotState:
        """Put the robot somewhere, servos at their setpoints and at rest.

        Args:
            position_w: Origin of the torso [m].
            quat_wb: Attitude (w, x, y, z).
            joint_position: q [rad]; zero by default.
            vectoring: (φ, θ) [rad]; zero by default.
            thrust: Thrust that the modules already deliver [N]; zero by default.
            disturbances: What happens to it; nothing by default.
            rng: Source of noise, wind and pushes; a copy of it draws.
            spent_wh: Energy that its battery lacks [Wh].
            motion: Velocity of the torso's origin, world [m/s], and its angular velocity, torso axes [rad/s], shape
                (6,); at rest by default.

        Raises:
            InvalidValueError: When something random is to happen and there is no generator.
        """
        disturbances = disturbances or Disturbances()
        random = self.config.sense or self.config.actuators.thrust_noise
        if rng is None and (random or disturbances.has_weather):
            raise InvalidValueError("rng", rng, "a generator, where there is noise, wind or pushes")
        fill(self.record["disturbances"], disturbances)
        self.record["spent_wh"] = spent_wh
        if rng is not None:
            self.record["generator"] = from_numpy(rng)
        return self.place(position_w, quat_wb, joint_position, vectoring, thrust, motion)

    def place(
        self,
        position_w: Vector3,
        quat_wb: Quaternion = _LEVEL,
        joint_position: JointVector | None = None,
        vectoring: Vectoring | None = None,
        thrust: RotorVector | None = None,
        motion: np.ndarray | None = None,
    ) -> RobotState:
        """As `reset`, with the disturbances, the generator and the battery that the robot has."""
        pose = self._pose[0]
        pose["position_w"], pose["quat_wb"] = position_w, quat_wb
        pose["joint_position"] = 0.0 if joint_position is None else joint_position
        pose["vectoring"] = 0.0 if vectoring is None else vectoring.reshape(-1)
        pose["thrust"] = 0.0 if thrust is None else thrust
        pose["motion"] = 0.0 if motion is None else motion
        self._engine.run("sp_reset_plants", None, self._pose)
        return self.state()

    def disturb(self, disturbances: Disturbances, towards: float = 0.0) -> None:
        """Let something else happen from now on, without a reset; what a rotor had lost comes back.

        Args:
            disturbances: Their `fault_time` counts from the reset. Pushes begin with one at once.
            towards: Where the wind blows to, 0 along x, π/2 along y [rad].

        Raises:
            InvalidValueError: When something random is to happen and the reset was given no generator.
        """
        record, weather = self.record, self.record["weather"]
        if disturbances.has_weather and not any(record["generator"].tobytes()):
            raise InvalidValueError("rng", None, "a generator at the reset, where there is to be wind or pushes")
        before = read(Disturbances, record["disturbances"])
        fill(record["disturbances"], disturbances)
        if (before.lost_rotor, before.fault) != (disturbances.lost_rotor, disturbances.fault):
            record["is_stuck"] = 0  # it would go on for a rotor that is no longer named
        weather["mean_w"] = disturbances.wind * np.array([math.cos(towards), math.sin(towards), 0.0])
        if not disturbances.wind:
            weather["gust_w"] = 0.0
        if not disturbances.push:
            weather["push_w"], weather["next_push"] = 0.0, math.inf
        elif not math.isfinite(weather["next_push"]):
            weather["next_push"] = self.state().time
        record["has_air"] = bool(record["has_air"]) or disturbances.has_weather

    def shove(self, force_w: Vector3) -> None:
        """Push the torso for 0.2 s from now on, besides whatever else happens to it [N]."""
        weather = self.record["weather"]
        if not self.record["disturbances"]["push"]:
            # Nobody looks at a push where none may come; none of its own follows, as `next_push` is never.
            self.record["disturbances"]["push"] = float(np.linalg.norm(force_w))
        # It begins when the weather is looked at the next time, and its length counts from there.
        weather["push_w"], weather["push_end"] = force_w, self.state().time + AIR_STEPS * TIMESTEP + PUSH_SECONDS
        self.record["has_air"] = True

    def step(self, command: Command) -> RobotState:
        """Advance by one control period: physics, and what happens in between.

        Args:
            command: Thrusts are clipped to idle … what the module gives (λ̄, its gain, the battery); joint setpoints to
                ± 90°, and slewed by the servos.

        Returns:
            The true state at the end of the period; where it has `diverged`, the last one that was finite.
        """
        self.keep()
        fill(self._command[0], command)
        self._engine.run("sp_step_plants", None, self._command)
        return self.state()

    def keep(self) -> None:
        """Let the robot be where `data` has it: who writes there moves it."""
        self._engine.call("sp_keep_now", self._engine.address)

    def state(self) -> RobotState:
        """The true state."""
        return read_state(self.record["state"])

    def measure(self) -> Measurement:
        """What the sensors have said since the last call (`InvalidValueError` where `sense` is off)."""
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
        """Whether the state is no longer finite, or faster than anything that flies (10⁶ rad/s, m/s)."""
        return bool(self.record["diverged"])

    @property
    def in_contact(self) -> bool:
        """Whether any part of the robot touches the floor."""
        return bool(self.record["in_contact"])

    @property
    def hit(self) -> float:
        """Largest force since the last command on anything but feet and pegs, where there are boxes [N]."""
        return float(self.record["hit"])

    @property
    def violated(self) -> int:
        """Constraints that have been violated since `forgive` or the reset: bit k is the k-th of `VIOLATIONS`."""
        return int(self.record["violated"])

    def forgive(self) -> None:
        """From here on violations are counted anew."""
        self.record["violated"] = 0

    def touch(self) -> Touch:
        """What touches the floor, and how it slides."""
        found = np.zeros((), engine_layouts()["touch"])
        self._engine.call("sp_touching_now", self._engine.address, pointer(found))
        balls = found["balls"] != 0
        return Touch(
            balls[:N_LEGS], balls[N_LEGS:], bool(found["ducts"]), found["slip"][:N_LEGS], found["slip"][N_LEGS:],
            float(found["duct_clearance"]), float(found["hit"]),
        )  # fmt: skip

    def contact_forces(self) -> np.ndarray:
        """Where floor or boxes touch the robot and what they give there, world: (k, 6) [m, N]."""
        data, wrench = self.data, np.zeros(6)
        rows = np.zeros((data.ncon, 6))
        for k in range(data.ncon):
            mujoco.mj_contactForce(self.model, data, k, wrench)
            force = data.contact.frame[k].reshape(3, 3).T @ wrench[:3]
            # MuJoCo gives the force on the second geom.
            is_ours = self.model.geom_bodyid[data.contact.geom[k, 1]] > 0
            rows[k, :3], rows[k, 3:] = data.contact.pos[k], force if is_ours else -force
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
        """Force, world [N], and torque about the torso's origin, torso axes [Nm], of rotors and weight on the robot.

        At rest, and without the air: what keeps the robot from hovering where it is.
        """
        data: Any = self.data  # one of its arrays is declared without a type
        net = data.qfrc_actuator - data.qfrc_bias
        return net[:3], net[3:6]

    def close(self) -> None:
        """Stop the engine's threads; a second call does nothing."""
        self._engine.close()

    def save(self) -> Saved:
        """This moment, all of it; `restore` continues from it bit for bit."""
        self.keep()
        return Saved(self._records.tobytes(), self._engine.copies.tobytes())

    def fault_of(self, saved: Saved) -> str:
        """What of a moment of this kind of simulation cannot be, in words; empty where nothing is wrong."""
        record = np.frombuffer(saved.robot, self._records.dtype)
        copies = np.frombuffer(saved.model, np.uint8)[None]
        fault = limits.fault_of("plant", record) or self._engine.fault_of_copies(copies)
        return fault or limits.differs("plant_config", record["config"], self._records["config"], ("i4",))

    def restore(self, saved: Saved) -> RobotState:
        """Return to a saved moment (`InvalidValueError` for another kind of simulation's)."""
        sizes = self._records.nbytes, self._engine.copies.nbytes
        if (len(saved.robot), len(saved.model)) != sizes:
            given = len(saved.robot), len(saved.model)
            raise InvalidValueError("saved", given, f"a moment of {sizes[0]} and {sizes[1]} bytes from save()")
        with self._engine.turn.lock:
            self._records[:] = np.frombuffer(saved.robot, self._records.dtype)
            self._engine.copies[0] = np.frombuffer(saved.model, np.uint8)
            self.refresh()
            return self.state()

    def refresh(self) -> None:
        """Let `model` and `data` show the robot, where others have written its memory."""
        self._engine.forget_copies()
        self._engine.run("sp_refresh_plants")
        self.reread()
