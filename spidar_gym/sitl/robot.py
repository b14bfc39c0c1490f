"""The simulated robot behind the real one's interface: plant, sensors, board and flight stack at 200 Hz."""

import math
from dataclasses import replace

import numpy as np

from spidar_gym.control.crawl.footsteps import GaitConfig, lying_pose
from spidar_gym.control.estimator import Estimator
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.native.engine_structs import IMU_STEPS
from spidar_gym.native.formulas import voltage
from spidar_gym.native.plant import Plant
from spidar_gym.onboard.messages import STATE_NAMES, Message
from spidar_gym.onboard.runner_structs import FlightState
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.sensors import IMU_POSITION_B
from spidar_gym.sitl.board import Board
from spidar_gym.sitl.health import Health, motors
from spidar_gym.sitl.missions import HANGING
from spidar_gym.sitl.stack import LANDING_FORM, Stack
from spidar_gym.so3 import cross, euler_angles, quat_to_matrix
from spidar_gym.state import Command, Measurement

DT = 0.005
"""One step [s]."""
TICK = 5
"""Steps per tick of the flight stack: 40 Hz."""
ODOMETRY = 2
"""Steps between two estimates of the flight stack: 100 Hz."""
SERVOS, BATTERY = 4, 20
"""Steps between two messages of the servos, 50 Hz, and of battery and motors, 10 Hz."""
STAND = np.array([0.0, 0.0, 1.5])
"""Origin of the torso of a robot on a stand: hanging legs do not reach the floor [m] [chosen]."""
SETPOINTS = {
    "gimbals_ctrl": ("vectoring", GIMBAL_NAMES, "position", -math.inf, math.inf),
    "joints_ctrl": ("joints", JOINT_NAMES, "position", -ROBOT.joint_limit, ROBOT.joint_limit),
    "joints_torque_ctrl": ("torque_limit", JOINT_NAMES, "effort", 0.0, ROBOT.max_joint_torque),
}
"""Topic → attribute of the robot, names of its elements, field of the message, least and largest value."""


class Robot:
    """One robot: `step` simulates 5 ms and returns the published messages, `receive` applies a command."""

    def __init__(
        self,
        plant: PlantConfig | None = None,
        *,
        crawls: bool = False,
        on_stand: bool = False,
        gait: GaitConfig | None = None,
        joint_speed: float = ROBOT.joint_speed,
        seed: int = 0,
    ) -> None:
        """Place the robot on the floor, or clamp it to a stand.

        Args:
            plant: The plant; the described robot with real sensors by default.
            crawls: Whether the robot starts for the ground, lying in the gait's first pose.
            on_stand: Whether its torso is clamped to a stand, legs hanging; it never takes off.
            gait: Gait that defines this pose.
            joint_speed: Largest speed of the joint servos [rad/s].
            seed: Seed of the noise.
        """
        config = replace(plant or PlantConfig(), substeps=IMU_STEPS, sense=True, joint_speed=joint_speed)
        if on_stand:  # rotors that stand still have no unsteady inflow
            config = replace(config, actuators=replace(config.actuators, thrust_noise=0.0))
        self.plant = Plant(config)
        self.board, self.stack, self.model = Board(), Stack(crawls or on_stand), Model()
        self.health = Health()
        """Temperature and load of the servos."""
        form = HANGING if on_stand else lying_pose(gait or GaitConfig()) if crawls else LANDING_FORM
        place = STAND if on_stand else config.ground.R_wf @ np.array([0.0, 0.0, ROBOT.peg_depth])
        if on_stand:
            self.plant.clamp(STAND)
        self.state = self.plant.reset(
            place,
            joint_position=form,
            rng=np.random.Generator(np.random.PCG64(seed)),
        )
        self._estimator = Estimator()
        first = self.plant.measure()
        indicated = {"joint_position": first.joint_position, "vectoring": first.vectoring}
        self._estimator.reset(replace(self.state, **indicated))
        self.seen = self._estimator.update(first, self.state.thrust)
        self.vectoring, self.joints = first.vectoring.copy(), form.copy()
        self.torque_limit = np.full(N_JOINTS, ROBOT.max_joint_torque)
        self.steps, self._encoder = 0, -1.0
        self.dead_rotor = 0
        """Module with a dead rotor, which ignores commands, 1 … 8; 0 for none."""
        self.driven_at = -math.inf
        """Time of a runner's last command [s]."""
        self.first_driven = math.inf
        """Time of a runner's first command [s]."""
        self._torques = np.zeros((2, N_ROTORS))
        self._batch: list[Measurement] = []
        self._echo: list[Message] = []
        self._com_b: np.ndarray | None = None

    @property
    def time(self) -> float:
        """The robot's clock [s]."""
        return self.steps * DT

    @property
    def flight_state(self) -> int:
        """Flight state as reported: FORCE_LANDING while the board lands, otherwise the flight stack's."""
        return int(FlightState.FORCE_LANDING if self.board.landing else self.stack.state)

    def receive(self, message: Message) -> None:
        """Apply a command."""
        if message.topic.startswith("teleop_command/"):
            self.stack.teleop(message.topic.split("/")[1], self.time)
        elif message.topic == "flight_config_cmd":
            self._configure(int(message.values["cmd"]))
        elif not self.drivable:
            return  # the flight stack is in control: on the robot a multiplexer of the topics blocks the runner
        elif message.topic == "four_axes/command":
            self.driven_at = self.time
            self.first_driven = min(self.first_driven, self.time)
            self.board.command(np.asarray(message.values["thrust"], float), self.time)
        elif message.topic in SETPOINTS:
            self._receive_setpoints(message)

    @property
    def drivable(self) -> bool:
        """Whether the state is one in which a runner may drive: HOVER in flight, ARM_ON on the ground."""
        wanted = FlightState.ARM_ON if self.stack.crawls else FlightState.HOVER
        return self.stack.state == wanted and not self.board.landing

    def _receive_setpoints(self, message: Message) -> None:
        """Store set-points by name, or all in order where no names are given; invalid ones are ignored."""
        own, names, field, least, most = SETPOINTS[message.topic]
        values, target = np.asarray(message.values[field], float), getattr(self, own).copy()
        given = list(message.values.get("name") or names)
        if len(given) != len(values) or not np.isfinite(values).all():
            return
        for name, value in zip(given, values, strict=True):
            if name in names:
                target.flat[names.index(name)] = value
        setattr(self, own, np.clip(target, least, most))

    def _configure(self, command: int) -> None:
        if self.board.configure(command):
            self._echo.append(Message("flight_config_ack", self.time, {"data": command}))
            self.stack.acknowledge(command, self.time)

    @property
    def driven(self) -> bool:
        """Whether a runner is in control: it has commanded since the present state began, and no landing is forced.

        If a driving runner stops commanding, the flight stack does not take over; the board's timeout lands the robot.
        """
        return self.drivable and self.driven_at >= self.stack.since

    def step(self) -> list[Message]:
        """Simulate 5 ms; return the messages published in them."""
        if self.steps % TICK == 0:
            self._decide()
        R_wb = quat_to_matrix(self.state.quat_wb)
        if self.board.landing and self.steps % TICK == 0:
            self._torques = self._torque_map(R_wb)
        thrust = self.board.tick(self.time, DT, R_wb, self.state.omega_b, self._torques)
        if self.dead_rotor:
            thrust[self.dead_rotor - 1] = 0.0
        self.state = self.plant.step(Command(thrust, self.vectoring, self.joints, self.torque_limit))
        self.steps += 1
        measurement = self.plant.measure()
        messages, self._echo = self._echo, []
        messages += self._publish(measurement)
        self._batch.append(measurement)
        if self.steps % ODOMETRY == 0:
            messages += self._odometry()
        if self.steps % TICK == 0:
            messages.append(Message("flight_state", self.time, {"data": self.flight_state}))
        return messages + self._health(measurement, thrust)

    def _decide(self) -> None:
        """Run a tick of the flight stack and pass its commands on."""
        stack, board = self.stack, self.board
        before = stack.state
        command = None if board.landing else stack.tick(self.seen, board.base, driven=self.driven)
        if stack.state != before:  # reported before the stack's own commands, so that a driving runner stops first
            self._echo.append(Message("flight_state", self.time, {"data": self.flight_state}))
        for wish in stack.wishes:
            self._configure(wish)
        stack.wishes = []
        if command is not None:
            board.command(command.thrust, self.time)
            self.vectoring, self.joints = command.vectoring, command.joint_position
            self.torque_limit = command.joint_torque_limit
            self._echo.append(Message("four_axes/command", self.time, {"thrust": command.thrust}))

    def _torque_map(self, R_wb: np.ndarray) -> np.ndarray:
        """Compute roll and pitch acceleration per thrust at the present vectoring angles, (2, 8) [rad/s²/N]."""
        snapshot = self.model.snapshot(self.seen.joint_position, R_wb, self.seen.vectoring)
        forces = vectoring_to_force(np.ones(N_ROTORS), self.seen.vectoring)
        Q = thrust_map(snapshot.R_bl, snapshot.rotor_c)[3:].reshape(3, N_ROTORS, 3)
        return np.linalg.solve(snapshot.inertia_c, np.einsum("ijk,jk->ij", Q, forces))[:2]

    def _publish(self, m: Measurement) -> list[Message]:
        """Return the messages of the sensors."""
        angles = euler_angles(quat_to_matrix(self.seen.quat_wb))
        messages = [
            Message(
                "imu", float(m.imu_time[k]),
                {"acc": m.specific_force_b[k], "gyro": m.gyro_b[k], "angles": angles},
            )
            for k in range(m.imu_count)
        ]  # fmt: skip
        for k in range(m.pose_count):
            pose = {"position": m.pose_position_w[k], "quat": m.pose_quat_wb[k]}
            messages.append(Message("mocap/pose", float(m.pose_time[k]), pose))
        if m.encoder_time > self._encoder:
            self._encoder = m.encoder_time
            position = np.concatenate([m.joint_position, m.vectoring.reshape(-1)])
            effort = np.concatenate([m.joint_torque, np.zeros(2 * N_ROTORS)])
            values = {"name": STATE_NAMES, "position": position, "effort": effort}
            messages.append(Message("joint_states", m.encoder_time, values))
        return messages

    def _health(self, m: Measurement, thrust: np.ndarray) -> list[Message]:
        """Return the messages about battery, servos and motors that are due after thrusts of the board [N]."""
        messages, spent = [], float(self.plant.record["spent_wh"])
        if self.steps % SERVOS == 0:
            vectoring_torque = self.plant.data.actuator_force[N_ROTORS + N_JOINTS :].reshape(N_ROTORS, 2)
            self.health.step(self.state.joint_torque, vectoring_torque, SERVOS * DT)
            messages.append(self.health.servos(self.time, m.joint_position, m.vectoring))
        if self.steps % BATTERY == 0:
            volts = voltage(spent + self.plant.energy_wh, self.plant.power)
            messages.append(Message("battery_voltage_status", self.time, {"data": float(np.float32(volts))}))
            messages.append(motors(self.time, thrust, volts, armed=self.board.armed))
        return messages

    def _odometry(self) -> list[Message]:
        """Update the flight stack's estimate; return the odometry of CoG and flight controller."""
        for measurement in self._batch:
            self.seen = self._estimator.update(measurement, self.board.base)
        self._batch = []
        seen, R_wb = self.seen, quat_to_matrix(self.seen.quat_wb)
        com_b = self.model.snapshot(seen.joint_position, R_wb, seen.vectoring).com_b
        rate = np.zeros(3) if self._com_b is None else (com_b - self._com_b) / (ODOMETRY * DT)
        self._com_b = com_b
        messages = []
        for topic, point, own in (
            ("uav/cog/odom", com_b, rate), ("uav/baselink/odom", IMU_POSITION_B, np.zeros(3))
        ):  # fmt: skip
            velocity = seen.velocity_w + R_wb @ (cross(seen.omega_b, point) + own)
            position = seen.position_w + R_wb @ point
            values = {"position": position, "quat": seen.quat_wb, "velocity": velocity, "omega": seen.omega_b}
            messages.append(Message(topic, seen.time, values))
        return messages
