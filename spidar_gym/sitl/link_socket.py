"""The robot's end of the socket: collects messages into the runner's input at each tick and waits for its answer."""

import contextlib
import select
import socket
import time
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.onboard.health import HEALTH_TOPICS, N_SERVOS
from spidar_gym.onboard.message_types import FORCE_LANDING
from spidar_gym.onboard.messages import FEEDBACK, ORDERS, STATE_NAMES, Message
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.onboard.runner_structs import ORDER_TEXT, TOPICS, Action, log_layouts
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS
from spidar_gym.robot.description import model_hash
from spidar_gym.state import IMU_SAMPLES, POSE_FRAMES

ODOMETRY_FIELDS = {"position_w": "position", "quat_wb": "quat", "velocity_w": "velocity", "omega_b": "omega"}
"""Members of the runner's odometry → their names in a message."""
SERVO_MEMBERS = {
    "servo_angle": "angle", "servo_temperature": "temp", "servo_load": "load", "servo_error": "error",
}  # fmt: skip
"""Members of the runner's health input → their names in a message."""
HEALTH_NAMES = tuple(name for name, _ in HEALTH_TOPICS.values())
PATIENCE = 10.0
"""Time limit for the runner to connect or to answer [s]."""


class SocketLink:
    """Link in lock-step: the robot's clock is the only one, so that a run does not depend on the machine's speed."""

    def __init__(
        self, *, model: str | None = None, names: tuple[str, ...] = STATE_NAMES, silent: Collection[str] = ()
    ) -> None:
        """Listen on the loopback.

        Args:
            model: Hash of the model that the robot reports; the present one by default.
            names: Names of the robot's angles.
            silent: Topics that the robot does not publish.
        """
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.1)
        self._peer: socket.socket | None = None
        self._hello = np.zeros((), log_layouts()["sim_hello"])
        text = {"interface": runner_hash(), "model": model or model_hash()}
        for field, word in text.items():
            self._hello[field][: len(word)] = list(word.encode())
        for row, name in zip(self._hello["names"], names, strict=False):
            row[: len(name)] = list(name.encode())
        self._hello["name_count"] = len(names)
        rates = {topic.name: topic.rate for topic in FEEDBACK}
        self._hello["rates"] = [0.0 if name in silent else rates[name] for name, _ in TOPICS.values()]
        self._input = np.zeros((), log_layouts()["loop_input"])
        self._poses: list[Message] = []
        self._imu: list[Message] = []
        self._orders: list[bytes] = []
        self.answer = np.zeros((), log_layouts()["loop_output"])
        """The runner's last answer."""
        self.parting = ""
        """Why the last runner was disconnected."""

    @property
    def place(self) -> str:
        """Address HOST:PORT for the runner."""
        host, port = self._server.getsockname()
        return f"{host}:{port}"

    @property
    def awaited(self) -> bool:
        """Whether a runner waits to be accepted."""
        return bool(select.select([self._server], [], [], 0.0)[0])

    def accept(self, alive: Callable[[], bool] = lambda: True, *, patience: float = PATIENCE) -> None:
        """Wait for the runner and send the robot's identity.

        Args:
            alive: Returns whether the runner's process still runs.
            patience: Time limit [s].

        Raises:
            SpidarError: When no runner connects.
        """
        end = time.monotonic() + patience
        while self._peer is None:
            try:
                peer, _ = self._server.accept()
            except TimeoutError as error:
                if time.monotonic() > end or not alive():
                    raise SpidarError(f"no runner connected to {self.place}; valid: one that starts") from error
            except ConnectionError:
                pass  # the runner has disconnected already
            else:
                self._greet(peer)

    def _greet(self, peer: socket.socket) -> None:
        """Send the robot's identity and reset the link for this runner; a runner that has disconnected is ignored."""
        peer.settimeout(PATIENCE)
        try:
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            peer.sendall(self._hello.tobytes())
        except OSError:
            peer.close()
            return
        self._peer, self._poses, self._imu, self._orders = peer, [], [], []
        self._input[...] = np.zeros((), self._input.dtype)
        self._input["flight_state"], self._input["flight_state_time"] = -1, -np.inf
        for name in ("voltage_time", "servo_time", "motor_time"):
            self._input["health"][name] = -np.inf
        self.answer = np.zeros((), self.answer.dtype)

    def publish(self, message: Message) -> None:
        """Store a message for the runner's next tick."""
        values, record = message.values, self._input
        if message.topic == "mocap/pose":
            self._poses.append(message)
        elif message.topic == "imu":
            self._imu.append(message)
        elif message.topic == "joint_states":
            m = record["measurement"]
            position = np.asarray(values["position"], float)
            m["encoder_time"] = message.stamp
            m["joint_position"], m["vectoring"] = position[:N_JOINTS], position[N_JOINTS:]
            m["joint_torque"] = np.asarray(values["effort"], float)[:N_JOINTS]
        elif message.topic == "flight_state":
            record["flight_state"], record["flight_state_time"] = values["data"], message.stamp
        elif message.topic in HEALTH_NAMES:
            self._publish_health(message)
        elif message.topic == "uav/cog/odom":
            self._publish_odometry(message)
        elif message.topic == ORDERS.name:
            text = str(values["data"]).encode()
            if len(text) >= ORDER_TEXT:
                raise InvalidValueError("orders", f"{len(text)} bytes", f"at most {ORDER_TEXT - 1}")
            self._orders.append(text)
        elif message.topic == "four_axes/command":
            record["has_thrust"], record["thrust"] = 1, values["thrust"]

    def _publish_odometry(self, message: Message) -> None:
        odometry = self._input["odometry"]
        self._input["has_odometry"], odometry["time"] = 1, message.stamp
        for field, name in ODOMETRY_FIELDS.items():
            odometry[field] = message.values[name]

    def _publish_health(self, message: Message) -> None:
        """Store a message about the robot's health, as the runner's link to ROS does."""
        health, values = self._input["health"], message.values
        if message.topic == "battery_voltage_status":
            health["voltage_time"], health["voltage"] = message.stamp, values["data"]
        elif message.topic == "motor_pwms":
            outputs = np.asarray(values["motor_value"])
            health["motor_time"], health["motor_count"] = message.stamp, len(outputs)
            health["motor_output"][: len(outputs)] = outputs[:N_ROTORS]
        else:
            index = np.asarray(values["index"])
            known = index < N_SERVOS
            health["servo_time"], health["servo_count"] = message.stamp, int(known.sum())
            for member, field in SERVO_MEMBERS.items():
                health[member][index[known]] = np.asarray(values[field])[known]

    def tick(self, now: float) -> list[Message] | None:
        """Send the input; return the messages that the runner publishes, None if it is disconnected (see `parting`)."""
        if self._peer is None:
            return None
        m = self._input["measurement"]
        self._input["time"] = m["time"] = now
        m["pose_count"], m["imu_count"] = len(self._poses[-POSE_FRAMES:]), len(self._imu[-IMU_SAMPLES:])
        for k, message in enumerate(self._poses[-POSE_FRAMES:]):
            m["pose_time"][k] = message.stamp
            m["pose_position_w"].reshape(POSE_FRAMES, 3)[k] = message.values["position"]
            m["pose_quat_wb"].reshape(POSE_FRAMES, 4)[k] = message.values["quat"]
        for k, message in enumerate(self._imu[-IMU_SAMPLES:]):
            m["imu_time"][k] = message.stamp
            m["gyro_b"].reshape(IMU_SAMPLES, 3)[k] = message.values["gyro"]
            m["specific_force_b"].reshape(IMU_SAMPLES, 3)[k] = message.values["acc"]
        self._poses, self._imu = [], []
        self._input["orders"] = 0
        if self._orders:  # one message per tick, as from the runner's queue in ROS
            text = self._orders.pop(0)
            self._input["orders"][: len(text)] = list(text)
        try:
            self.answer = self._ask(self._peer)
        except (OSError, SpidarError) as error:
            self.dismiss(getattr(error, "strerror", None) or str(error))
            return None
        finally:
            self._input["has_odometry"] = self._input["has_thrust"] = 0
        return published(self.answer, now)

    def _ask(self, peer: socket.socket) -> Any:  # noqa: ANN401 - a numpy record
        """Send the input and receive one answer; any other data on the connection is an error.

        Raises:
            OSError: When the connection breaks, or the whole answer takes too long.
            SpidarError: When the runner has closed the connection or sends an invalid answer.
        """
        peer.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            if peer.recv(1):
                raise SpidarError("it sent data without a request; valid: one answer to each message")
        end, size, data = time.monotonic() + PATIENCE, self.answer.dtype.itemsize, b""
        peer.settimeout(PATIENCE)
        peer.sendall(self._input.tobytes())
        while len(data) < size:
            peer.settimeout(max(end - time.monotonic(), 1e-3))
            part = peer.recv(size - len(data))
            if not part:
                raise SpidarError("it closed the connection")
            data += part
        answer = np.frombuffer(data, self.answer.dtype)[0]
        if answer["action"] not in tuple(Action):
            raise SpidarError("it sent an invalid answer; valid: those of the interface's runner")
        return answer

    def dismiss(self, why: str) -> None:
        """Disconnect the runner; another one may connect."""
        self.parting = why
        if self._peer is not None:
            self._peer.close()
        self._peer = None

    def close(self) -> None:
        """Close both ends."""
        for end in (self._peer, self._server):
            if end is not None:
                end.close()


def published(answer: Any, time: float) -> list[Message]:  # noqa: ANN401 - a numpy record
    """Return the messages that a link publishes for an answer of the runner."""
    if answer["action"] == Action.SILENT:
        return []
    if answer["action"] == Action.FORCE_LANDING:
        return [Message("flight_config_cmd", time, {"cmd": FORCE_LANDING})]
    c = answer["command"]
    return [
        Message("four_axes/command", time, {"thrust": c["thrust"].copy()}),
        Message("gimbals_ctrl", time, {"name": GIMBAL_NAMES, "position": c["vectoring"].copy()}),
        Message("joints_ctrl", time, {"name": JOINT_NAMES, "position": c["joint_position"].copy()}),
        Message("joints_torque_ctrl", time, {"name": JOINT_NAMES, "effort": c["joint_torque_limit"].copy()}),
    ]
