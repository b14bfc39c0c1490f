"""Records and bags for tests of logs: a flight through the runner, random series, bags as ROS writes them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.logs.record import Record, Series, ordered
from spidar_gym.logs.topics import FORMATS, definition
from spidar_gym.onboard.message_types import HEAD_IMU
from spidar_gym.onboard.messages import Message
from spidar_gym.onboard.runner_structs import Action, log_layouts
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import hover_mission
from spidar_gym.sitl.play import Played, play


class Witness(SocketLink):
    """A link that keeps what passes it."""

    said: list[Message]
    commanded: list[Message]

    def publish(self, message):
        self.said.append(message)
        super().publish(message)

    def tick(self, now):
        answers = super().tick(now)
        self.commanded += answers or []
        return answers


@dataclass
class Flown:
    """A flight that ends with a fault: its log, what the robot sent, what the runner commanded."""

    path: Path
    played: Played
    said: list[Message]
    commanded: list[Message]

    def sent(self, topic):
        return [message for message in self.said if message.topic == topic]

    def commands(self, topic):
        return [message for message in self.commanded if message.topic == topic]


def fly(folder, monkeypatch):
    """Fly with the runner until the poses stop, and the landing is forced."""
    Witness.said, Witness.commanded = [], []
    monkeypatch.setattr("spidar_gym.sitl.session.SocketLink", Witness)
    path = folder / "run.log"
    played = play(hover_mission(seconds=6.0), fault="pose_stops", log=path)
    return Flown(path, played, Witness.said, Witness.commanded)


def lengthened(log, path, count):
    """Write a log of `count` ticks: those of a run again and again, with later times and noise."""
    types, data = log_layouts(), log.read_bytes()
    start = types["log_head"].itemsize + types["mission"].itemsize
    tick = np.dtype([("input", types["loop_input"]), ("output", types["loop_output"]), ("clock", types["log_clock"])])
    once = np.frombuffer(data, tick, offset=start)
    once = once[once["output"]["action"] == Action.PUBLISH]
    ticks, rng = np.resize(once, count), np.random.default_rng(0)
    later = np.repeat(np.arange(-(-count // len(once))), len(once))[:count] * len(once) / CONTROL_RATE
    inputs, outputs, m = ticks["input"], ticks["output"], ticks["input"]["measurement"]
    for record, names in ((inputs, ("time", "flight_state_time")), (m, ("time", "encoder_time")),
                          (inputs["odometry"], ("time",)),
                          (inputs["health"], ("voltage_time", "servo_time", "motor_time"))):  # fmt: skip
        for name in names:
            record[name] += later
    for name in ("pose_time", "imu_time"):
        m[name] += later[:, None]
    for record, names in ((m, ("gyro_b", "specific_force_b", "pose_position_w", "joint_position")),
                          (outputs["state"], ("position_w", "quat_wb", "joint_position", "joint_velocity")),
                          (outputs, ("forces_l", "joint_torques"))):  # fmt: skip
        for name in names:
            record[name] += 1e-3 * rng.standard_normal(record[name].shape)
    path.write_bytes(data[:start] + ticks.tobytes())


def random_series(topic, rng, count=7, *, head=False):
    """A series with every column of its topic, as far as one message holds them."""
    form, values = FORMATS[topic], {}
    for column in form.columns:
        if topic == "imu" and column.name == ("angles" if head else "quat_wb"):
            continue
        shape = (count, *((len(form.names) or 5,) if column.shape is None else column.shape))
        if column.kind == "string":
            values[column.name] = np.array([f"text {k % 3} λ" for k in range(count)], object)
        elif column.kind.startswith("float"):
            values[column.name] = rng.normal(size=shape)
        else:
            values[column.name] = rng.integers(0, 100, shape)
        if column.kind == "float32" or form.kind.startswith("spinal"):
            values[column.name] = values[column.name].astype(np.float32).astype(float)
        if column.shape is None and not form.names:
            values[column.name][2, 3:] = np.nan  # a message with fewer values
    time = np.round(np.sort(rng.uniform(0.0, 5.0, count)), 6)
    stamped = "stamp" in definition(form.kind)
    return Series(topic, time, np.round(time + 0.01, 6) if stamped else time, values, form.names)


def random_record(seed=0):
    """A record with every topic."""
    rng = np.random.default_rng(seed)
    series = ordered({topic: random_series(topic, rng) for topic in FORMATS})
    return Record("bag", series, 1_700_000_000, {"sha256": "0"}, ("a warning",), {}, {"mission.json": b"{}"})


def assert_same(one, other):
    """Assert that two series hold the same numbers, to the nanosecond."""
    assert one.topic == other.topic
    assert one.names == other.names
    assert list(one.values) == list(other.values)
    np.testing.assert_allclose(one.time, other.time, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(one.received, other.received, rtol=0.0, atol=1e-9)
    for name, values in one.values.items():
        np.testing.assert_array_equal(values, other.values[name], err_msg=f"{one.topic} {name}")


def typestore(*, head=False):
    """A store of ROS 1 types with those of this project."""
    store = get_typestore(Stores.ROS1_NOETIC)
    for form in FORMATS.values():
        package = form.kind.partition("/")[0]
        if package in ("spinal", "spidar_gym"):
            text = HEAD_IMU if head and form.kind == "spinal/Imu" else definition(form.kind)
            store.register(get_types_from_msg(text, form.kind.replace("/", "/msg/")))
    return store


@dataclass
class Bag:
    """A bag as the robot's computer records it: two seconds of `imu`, joints, poses, commands, and foreign topics."""

    path: Path
    gyro: np.ndarray
    position: np.ndarray
    thrust: np.ndarray


EPOCH = 1_732_900_000
"""Time of the bag, since 1970 [s]."""


def write_bag(path, *, head=False, compression=None, namespace="/spidar", count=400):
    """Write a bag with rosbags."""
    rng, store = np.random.default_rng(1), typestore(head=head)
    gyro = rng.normal(size=(count, 3)).astype(np.float32)
    position, thrust = rng.normal(size=(count // 4, 4)), rng.uniform(0.0, 30.0, (count // 5, 8)).astype(np.float32)
    types = store.types

    def header(seconds):
        whole = int(seconds)
        stamp = types["builtin_interfaces/msg/Time"](EPOCH + whole, round(1e9 * (seconds - whole)))
        return types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="world")

    writer = Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:

        def topic(name, kind):
            channel = writer.add_connection(f"{namespace}/{name}", f"{kind}", typestore=store)
            return lambda seconds, **values: writer.write(
                channel,
                EPOCH * 10**9 + round(1e9 * (seconds + 0.003)),
                store.serialize_ros1(types[kind](**values), kind),
            )

        imu, pose = topic("imu", "spinal/msg/Imu"), topic("mocap/pose", "geometry_msgs/msg/PoseStamped")
        joints, command = (
            topic("joint_states", "sensor_msgs/msg/JointState"),
            topic("four_axes/command", "spinal/msg/FourAxisCommand"),
        )
        state, strange = topic("flight_state", "std_msgs/msg/UInt8"), topic("rpy/gain", "std_msgs/msg/String")
        empty, zeros = np.zeros(0), np.zeros(3, np.float32)
        for k in range(count):
            now = 0.005 * k
            stamp = header(now).stamp
            if head:
                quat = np.array([0.1, 0.2, 0.3, 0.9], np.float32)
                imu(now, stamp=stamp, acc=2 * gyro[k], gyro=gyro[k], mag=zeros, quaternion=quat)
            else:
                imu(now, stamp=stamp, acc_data=2 * gyro[k], gyro_data=gyro[k], mag_data=zeros, angles=zeros)
            if k % 4 == 0:  # arms and legs in turns, in another order than the robot's
                names = ["joint1_pitch", "joint1_yaw"] if k % 8 else ["gimbal1_roll", "joint2_yaw"]
                joints(now, header=header(now), name=names, position=position[k // 4, :2], velocity=empty, effort=empty)
                point = types["geometry_msgs/msg/Point"](*position[k // 4, :3])
                where = types["geometry_msgs/msg/Pose"](
                    point, types["geometry_msgs/msg/Quaternion"](0.1, 0.2, 0.3, 0.9)
                )
                pose(now, header=header(now), pose=where)
            if k % 5 == 0:
                command(now, angles=zeros, base_thrust=thrust[k // 5])
                state(now, data=5)
                strange(now, data="nothing")
    return Bag(path, gyro, position, thrust)
