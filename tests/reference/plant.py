"""Python reference of the plant on MuJoCo: `step(Command) → RobotState`, with exact saving and restoring."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import copy
from typing import Any

import mujoco
import numpy as np
from reference.air import Aero
from reference.body import delay_steps, gain, is_asymmetric, offsets, write_actuators, write_body
from reference.contacts import GroundWatch
from reference.energy import electrical_power, max_thrust, voltage
from reference.events import Event, every, next_arrival
from reference.plant_memory import PlantMemory, Saved
from reference.sensors import Sensors
from reference.weather import Weather, advance_eddy, thrust_noise

from spidar_gym.arrays import JointVector, Quaternion, RotorVector, Vector3, Vectoring
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS, ROBOT, ROTOR_SITES
from spidar_gym.sim.actuators import STICKING, ActuatorConfig
from spidar_gym.sim.config import NEEDS_RNG, PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.energy import CAPACITY_WH, USABLE
from spidar_gym.sim.ground import Touch
from spidar_gym.sim.scene import TIMESTEP, quieten, scene
from spidar_gym.state import Command, Measurement, RobotState

AIR_STEPS = 10
"""Physics steps between two evaluations of the air: 25 ms; docs/concepts/air.md reports the error of the hold."""
SERVO_STEPS = 5
"""Physics steps between two updates of falling thrusts and of the joints' positions in their play: 12.5 ms."""
IMU_STEPS = 2
"""Physics steps between two samples of the sensors: 5 ms, 200 Hz."""
FASTEST = 12.0
"""Assumed largest fall speed [m/s]: contacts are detected only if it suffices to reach the floor within a period."""
_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_ROTORS, _JOINTS = slice(N_ROTORS), slice(N_ROTORS, N_ROTORS + N_JOINTS)
_GIMBALS = slice(N_ROTORS + N_JOINTS, N_ROTORS + 2 * N_JOINTS)


class Plant:
    """One simulated robot over a floor.

    Its joint servos apply τ = k_{j,p} (q^d − q) − k_{j,d} q̇ [Zhao2025, Eq. 17] at every physics step, within their
    torque limit. The setpoint is slewed at the joint speed at most.
    """

    def __init__(self, config: PlantConfig | None = None) -> None:
        """Compile the scene (`StaleAssetError` where the model file was edited by hand)."""
        config = config or PlantConfig()
        self.model = copy.copy(scene(visual=False, uneven=config.ground.uneven))
        self.data = mujoco.MjData(self.model)
        # Views into MuJoCo's memory, created once, because every access to an attribute of MjData creates a new view.
        self._q, self._v, self._a = self.data.qpos, self.data.qvel, self.data.act
        self._control, self._force, self._applied = self.data.ctrl, self.data.actuator_force, self.data.qfrc_applied
        joints = [self.model.joint(name) for name in (*JOINT_NAMES, *GIMBAL_NAMES)]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._qvel = np.array([joint.dofadr[0] for joint in joints])
        servos = [self.model.actuator(name) for name in (*ROTOR_SITES, *JOINT_NAMES, *GIMBAL_NAMES)]
        # `_actuators[k]` is the k-th of eight thrusts, sixteen joints, sixteen vectoring angles, in this order.
        self._ctrl = np.array([self.model.actuator_ctrladr[servo.id] for servo in servos])
        self._act = np.array([self.model.actuator_actadr[servo.id] for servo in servos])
        self._rotors = np.array([servo.id for servo in servos[_ROTORS]])
        self._joint_servos = np.array([servo.id for servo in servos[_JOINTS]])
        self._gimbal_servos = np.array([servo.id for servo in servos[_GIMBALS]])
        self._targets = np.zeros(N_ROTORS + 2 * N_JOINTS)
        self._watch = GroundWatch(self.model, self.data)
        self.memory = PlantMemory()
        self._events: tuple[Event[Plant], ...] = ()
        self.diverged = False
        """Whether the state is no longer finite, or beyond 10⁶ (m, m/s, rad/s)."""
        self.config = config
        """Configuration of the robot."""
        self._aero, self._sensors = self._write_config()

    def configure(self, config: PlantConfig) -> None:
        """Change the configuration from the next reset on (`InvalidValueError` for tiles where there were none)."""
        if config.ground.uneven != self.config.ground.uneven:
            raise InvalidValueError("tiles", config.ground.uneven, "the kind of floor given at construction")
        self.config = config
        self._aero, self._sensors = self._write_config()

    def _write_config(self) -> tuple[Aero, Sensors]:
        """Write the configuration into MuJoCo's model; returns the air and the sensors of this robot."""
        config = self.config
        write_actuators(config.actuators, self.model, config.joint_speed)
        write_body(config.body, self.model, scene(visual=False, uneven=config.ground.uneven))
        config.ground.apply(self.model)
        sensors = Sensors(config.sensors, offsets(config.actuators)[N_ROTORS:])
        return Aero(self.model, self.data, config.aero, config.recirculation), sensors

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.config.substeps * TIMESTEP

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
    ) -> RobotState:
        """Place the robot with all servos at their setpoints, by default at rest.

        Args:
            position_w: Origin of the torso [m].
            quat_wb: Attitude (w, x, y, z).
            joint_position: q [rad]; zero by default.
            vectoring: (φ, θ) [rad]; zero by default.
            thrust: Initial thrust of the modules [N]; zero by default.
            disturbances: Disturbances of the episode; none by default.
            rng: Source of noise, wind, pushes, jitter and loss.
            spent_wh: Energy that its battery lacks [Wh]; by default as configured.
            motion: Velocity of the torso's origin, world [m/s], and its angular velocity, torso axes [rad/s].

        Raises:
            InvalidValueError: For a configuration that draws, wind or pushes without a generator.
        """
        disturbances = disturbances or Disturbances()
        if rng is None and (self.config.draws or disturbances.has_weather):
            raise InvalidValueError("rng", rng, NEEDS_RNG)
        mujoco.mj_resetData(self.model, self.data)
        quieten(self.data)
        self.diverged = False
        spent = self.config.actuators.battery_spent * USABLE * CAPACITY_WH if spent_wh is None else spent_wh
        self.memory = memory = PlantMemory(rng=rng, disturbances=disturbances, spent_wh=spent)
        targets = self._targets
        targets[_ROTORS] = 0.0 if thrust is None else thrust
        targets[_JOINTS] = 0.0 if joint_position is None else joint_position
        targets[_GIMBALS] = 0.0 if vectoring is None else vectoring.reshape(-1)
        targets += offsets(self.config.actuators)
        self.data.qpos[:3] = position_w
        self.data.qpos[3:7] = quat_wb
        self.data.qvel[:6] = 0.0 if motion is None else motion
        self.data.qpos[self._qpos] = targets[N_ROTORS:]
        self.data.act[self._act] = targets
        self.data.ctrl[self._ctrl] = targets
        self._limit_torque(memory.torque_limit)
        self._watch.enable(True)
        self._write_asymmetry()
        memory.sticks = self._q.take(self._qpos[N_JOINTS:])
        self._write_play()
        mujoco.mj_forward(self.model, self.data)
        memory.in_contact = self.data.ncon > 0
        if rng is not None and disturbances.has_weather:
            memory.weather = Weather.draw(disturbances, rng)
        if rng is not None and self.config.recirculation.acts:
            memory.eddy = rng.standard_normal(6)
        self._choose_events()
        for event in self._events:
            event.run(self)
        memory.power = self._power()
        state = self.state()
        if self.config.sense and rng is not None:
            memory.sensors = self._sensors.start(state, rng)
            self._choose_events()
        return state

    def step(self, command: Command) -> RobotState:
        """Advance by one control period: the physics, and each of `EVENTS` when it is due.

        Args:
            command: Thrusts are clipped to the idle thrust … the largest available thrust (λ̄, gain, battery); joint
                setpoints are clipped to ± 90° and slewed by the servos.

        Returns:
            The true state at the end of the period. If the state has `diverged`, air, power and energy are unchanged.
        """
        memory, config, events = self.memory, self.config, self._events
        before = memory.air, memory.power, memory.energy_wh
        self._dispatch_command(command)
        self._watch.enable(not self._watch.clearance(config.ground) > FASTEST * self.period)
        end = memory.clock + config.substeps
        while memory.clock < end:
            dues = [event.due(memory) for event in events]
            stop = min(end, *dues)
            mujoco.mj_step(self.model, self.data, stop - memory.clock)
            memory.clock = stop
            for event, due in zip(events, dues, strict=True):
                if due == stop:
                    event.run(self)
        memory.in_contact = self.data.ncon > 0
        memory.power = self._power()
        memory.energy_wh += memory.power * self.period / 3600.0
        self.diverged = not float(self._q @ self._q + self._v @ self._v) < 1e12
        if self.diverged:
            memory.air, memory.power, memory.energy_wh = before
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
            thrust=self._a.take(self._act[:N_ROTORS]) * gain(self.config.actuators),
            joint_torque=self._force.take(self._joint_servos),
        )

    def measure(self) -> Measurement:
        """Sensor measurements since the last call (`InvalidValueError` where `sense` is off)."""
        if self.memory.sensors is None:
            raise InvalidValueError("sense", self.config.sense, "True at the reset")
        return self._sensors.read(self.memory.sensors, self.data.time)

    @property
    def in_contact(self) -> bool:
        """Whether any part of the robot touches the floor."""
        return self.memory.in_contact

    def touch(self) -> Touch:
        """Contacts with the floor, and their sliding speeds."""
        return self._watch.look(self.config.ground)

    def contact_forces(self) -> np.ndarray:
        """Position and force of each contact with the floor, world: (k, 6) [m, N]."""
        return self._watch.forces()

    @property
    def thrust_factor(self) -> RotorVector:
        """Thrust of each module over its thrust in still air."""
        air = self.memory.air
        return np.ones(N_ROTORS) if air is None else 0.5 * (air.thrust_factor[::2] + air.thrust_factor[1::2])

    @property
    def air_force(self) -> Vector3:
        """Force of the air on the whole robot, without the thrust in still air, world [N]."""
        return np.zeros(3) if self.memory.air is None else self.memory.air.generalized[:3].copy()

    @property
    def mean_power(self) -> float:
        """Mean electrical power since the reset [W]."""
        memory = self.memory
        return 3600.0 * memory.energy_wh / self.data.time if memory.energy_wh > 0.0 else memory.power

    def net_wrench(self) -> tuple[Vector3, Vector3]:
        """Force, world [N], and torque about the torso's origin, torso axes [Nm], of rotors and weight on the robot.

        Excludes the air. At rest both are zero in an exact hover.
        """
        data: Any = self.data  # one of its arrays is declared without a type
        net = data.qfrc_actuator - data.qfrc_bias
        return net[:3], net[3:6]

    def save(self) -> Saved:
        """Save the complete state; `restore` continues from it bit for bit."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return Saved(np.concatenate([state, self.data.actuator_force]), copy.deepcopy(self.memory))

    def restore(self, saved: Saved) -> RobotState:
        """Restore a state saved with this configuration (`InvalidValueError` for a state of another simulation)."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        sizes = mujoco.mj_stateSize(self.model, kind), self.model.nu
        if saved.state.shape != (sum(sizes),):
            raise InvalidValueError("saved", saved.state.shape, f"a state of {sum(sizes)} numbers from save()")
        state, force = np.split(saved.state, sizes[:1])
        self.memory = copy.deepcopy(saved.memory)
        self._choose_events()
        quieten(self.data)
        self.diverged = False
        mujoco.mj_setState(self.model, self.data, state, kind)
        self._limit_torque(self.memory.torque_limit)
        self._write_asymmetry()
        self._write_play()
        mujoco.mj_forward(self.model, self.data)
        # The forward pass computes the forces of the present instant; a step leaves those of its last substep's start.
        self.data.actuator_force[:] = force
        return self.state()

    def _choose_events(self) -> None:
        """Select those of `EVENTS` that this robot and this episode need."""
        self._events = tuple(event for event in EVENTS if event.needed(self))

    def _dispatch_command(self, command: Command) -> None:
        """Queue a command for the actuators, limited to what they deliver, unless it is lost."""
        config, actuators, memory, targets = self.config, self.config.actuators, self.memory, self._targets
        lost, late = self._draw_transmission()
        targets[_ROTORS] = command.thrust
        targets[_JOINTS] = command.joint_position
        targets[_GIMBALS] = command.vectoring.reshape(-1)
        most = actuators.max_thrust
        if actuators.battery:
            most = min(most, max_thrust(voltage(memory.spent_wh + memory.energy_wh, memory.power)))
        thrust = targets[_ROTORS]
        if actuators.board_scaling and thrust.max() > most:
            thrust *= most / thrust.max()
        np.minimum(thrust, most / gain(actuators), out=thrust)
        if config.idle_thrust > 0.0:
            np.maximum(thrust, config.idle_thrust, out=thrust)
        fault = memory.disturbances
        if fault.lost_rotor and self.data.time >= fault.fault_time - 1e-9:
            k = fault.lost_rotor - 1
            if fault.fault == "thrust":
                thrust[k] = 0.0
            elif memory.stuck is None:
                memory.stuck = self._q.take(self._qpos[N_JOINTS + 2 * k : N_JOINTS + 2 * k + 2])
        targets += offsets(actuators)
        delay, vectoring_delay = delay_steps(actuators)
        early = slice(0, _GIMBALS.start)
        if not lost:
            memory.due = max(memory.clock + delay + late, memory.due)  # no command overtakes the one before it
            memory.pending.append((memory.due, early, targets[early].copy()))
            memory.pending.append((memory.due + vectoring_delay - delay, _GIMBALS, targets[_GIMBALS].copy()))
        self._deliver_due_commands()
        if not lost and not (command.joint_torque_limit == memory.torque_limit).all():
            self._limit_torque(command.joint_torque_limit.copy())

    def _draw_transmission(self) -> tuple[bool, int]:
        """Draw whether a command is lost, and its jitter in physics steps."""
        actuators, rng = self.config.actuators, self.memory.rng
        if rng is None:
            return False, 0
        lost = actuators.loss > 0.0 and rng.random() < actuators.loss
        return lost, round(rng.uniform(0.0, actuators.jitter) / TIMESTEP) if actuators.jitter > 0.0 else 0

    def _deliver_due_commands(self) -> None:
        """Write the commands whose delay has elapsed to the actuators."""
        memory = self.memory
        for due, part, values in memory.pending:
            if due <= memory.clock:
                self._control[self._ctrl[part]] = values
        memory.pending = [entry for entry in memory.pending if entry[0] > memory.clock]
        if memory.stuck is not None:
            # A failed vectoring servo holds its angle and ignores commands.
            first = _GIMBALS.start + 2 * (memory.disturbances.lost_rotor - 1)
            self._control[self._ctrl[first : first + 2]] = memory.stuck

    @property
    def _has_air(self) -> bool:
        """Whether air, wind, pushes, recirculation or thrust noise act on the robot."""
        disturbances, config = self.memory.disturbances, self.config
        noisy = config.actuators.thrust_noise > 0.0
        return config.aero.wake or disturbances.has_weather or noisy or config.recirculation.acts

    def _update_air(self) -> None:
        """Advance noise, wind, pushes and recirculation, and evaluate the air."""
        memory, actuators = self.memory, self.config.actuators
        weather, windy = memory.weather, memory.disturbances.has_weather
        if memory.rng is not None:
            dt = AIR_STEPS * TIMESTEP
            if actuators.thrust_noise > 0.0:
                memory.noise = thrust_noise(memory.noise, actuators.thrust_noise, dt, memory.rng)
            if windy:
                weather.advance(memory.disturbances, self.data.time, dt, memory.rng)
            if self.config.recirculation.acts:
                memory.eddy = advance_eddy(memory.eddy, self.config.recirculation, dt, memory.rng)
        memory.air = self._aero.evaluate(
            self._a.take(self._act[_ROTORS]) * gain(actuators),
            wind_w=weather.mean_w + weather.gust_w if windy else weather.mean_w,
            noise=memory.noise,
            push_w=weather.push_w,
            eddy=memory.eddy if self.config.recirculation.acts else None,
        )
        self._applied[:] = memory.air.generalized

    def _update_asymmetry(self) -> None:
        """Update which thrusts are falling and where the joints are in their play."""
        memory, play = self.memory, self.config.actuators.backlash
        memory.falling = self._control.take(self._ctrl[_ROTORS]) < self._a.take(self._act[_ROTORS])
        gap = self._a.take(self._act[_JOINTS]) - self._q.take(self._qpos[:N_JOINTS])
        memory.loose = np.minimum(np.maximum(gap, -play), play)
        self._write_asymmetry()

    def _write_asymmetry(self) -> None:
        """Write the direction-dependent parameters into MuJoCo's model: the lag of thrusts and the play of joints.

        A servo's spring exerts no torque within the play; outside, its deflection is measured from the play's edge.
        """
        memory, actuators = self.memory, self.config.actuators
        if actuators.spin_down != 1.0:
            slower = np.where(memory.falling, actuators.spin_down, 1.0)
            self.model.actuator_dynprm[self._rotors, 0] = actuators.thrust_lag * slower
        if actuators.backlash > 0.0:
            stiffness = actuators.joint_kp * actuators.servo_stiffness
            self.model.actuator_biasprm[self._joint_servos, 0] = -stiffness * memory.loose

    def _write_play(self) -> None:
        """Write play and dry friction of the vectoring axes into MuJoCo's model."""
        c, memory = self.config.actuators, self.memory
        if c.vectoring_backlash == c.vectoring_friction == 0.0:
            return
        q, play = self._q.take(self._qpos[N_JOINTS:]), c.vectoring_backlash
        gap = self._a.take(self._act[_GIMBALS]) - q
        torque = -c.vectoring_kp * np.clip(gap, -play, play)
        if c.vectoring_friction > 0.0:
            way = c.vectoring_friction / STICKING
            memory.sticks = np.clip(memory.sticks, q - way, q + way)
            torque += STICKING * (memory.sticks - q)
        self.model.actuator_biasprm[self._gimbal_servos, 0] = torque
        damped = (abs(gap) >= play) | (c.vectoring_friction > 0.0)
        self.model.actuator_biasprm[self._gimbal_servos, 2] = np.where(damped, -ROBOT.vectoring_kd, 0.0)

    def _sample_sensors(self) -> None:
        """Sample the sensors."""
        memory = self.memory
        assert memory.sensors is not None
        assert memory.rng is not None
        self._sensors.sample(memory.sensors, self.state(), memory.rng)

    def _power(self) -> float:
        """Electrical power now [W]."""
        return electrical_power(
            self._a.take(self._act[_ROTORS]),
            self._force.take(self._joint_servos),
            self._v.take(self._qvel[:N_JOINTS]),
        )

    def _limit_torque(self, limit: JointVector) -> None:
        self.memory.torque_limit = limit
        bound = np.minimum(limit, self.config.actuators.max_joint_torque)
        self.model.actuator_forcerange[self._joint_servos, 0] = -bound
        self.model.actuator_forcerange[self._joint_servos, 1] = bound


def _has_play(config: ActuatorConfig) -> bool:
    """Whether the vectoring axes have play or friction."""
    return config.vectoring_backlash > 0.0 or config.vectoring_friction > 0.0


EVENTS: tuple[Event[Plant], ...] = (
    Event("delivery", next_arrival, Plant._deliver_due_commands, lambda plant: True),
    Event("air", every(AIR_STEPS), Plant._update_air, lambda plant: plant._has_air),
    Event(
        "asymmetry", every(SERVO_STEPS), Plant._update_asymmetry, lambda plant: is_asymmetric(plant.config.actuators)
    ),
    Event("play", every(1), Plant._write_play, lambda plant: _has_play(plant.config.actuators)),
    Event("sensors", every(IMU_STEPS), Plant._sample_sensors, lambda plant: plant.memory.sensors is not None),
)
"""Events between the physics steps, in order: delayed commands at 400 Hz at most, the air at 40 Hz, falling thrusts and
play of joints at 80 Hz, play of the vectoring axes at 400 Hz, sensors at 200 Hz. Once a control period, the command is
sent before the first physics step, and contacts, power and energy are read after the last."""
