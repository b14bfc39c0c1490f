"""Pins logs of runner, robot and simulation: their numbers in other readers, round trips, damage, the command."""

import json
import subprocess
import sys
import time

import gymnasium
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from mcap_ros1.decoder import DecoderFactory
from rosbags.rosbag1 import Writer
from support.commands import ROOT, refused
from support.logs import EPOCH, assert_same, lengthened, random_record, typestore, write_bag
from support.needs import marked

from spidar_gym.border import BorderError
from spidar_gym.cli.main import main
from spidar_gym.logs.csv_folder import write_csv
from spidar_gym.logs.describe import record_table
from spidar_gym.logs.mcap import read_mcap, write_mcap
from spidar_gym.logs.open import read_log
from spidar_gym.logs.record import Other
from spidar_gym.logs.simulation import Recorder, record_env
from spidar_gym.logs.topics import FORMATS
from spidar_gym.onboard.messages import STATE_NAMES
from spidar_gym.onboard.runner_structs import STAGES, Action, log_layouts
from spidar_gym.policies.rollout import rollout

START = log_layouts()["log_head"].itemsize + log_layouts()["mission"].itemsize
TICK = sum(log_layouts()[name].itemsize for name in ("loop_input", "loop_output", "log_clock"))


def said(messages, key):
    return np.array([np.ravel(message.values[key]) for message in messages])


# Logs of the runner


def test_a_record_of_a_run_holds_every_message_that_robot_and_runner_sent_once(flown):
    record, inputs = read_log(flown.path), flown.played.log.inputs
    assert record.kind == "run"
    assert record.warnings == ()
    for topic, columns in (
        ("imu", {"angular_velocity": "gyro", "specific_force": "acc"}),
        ("mocap/pose", {"position_w": "position", "quat_wb": "quat"}),
    ):
        sent = [m for m in flown.sent(topic) if m.stamp <= record[topic].time[-1]]
        assert record[topic].time.tolist() == [m.stamp for m in sent]
        for name, key in columns.items():
            np.testing.assert_array_equal(record[topic].values[name], said(sent, key))
    joints, sent = record["joint_states"], {m.stamp: m for m in flown.sent("joint_states")}
    assert len(np.unique(joints.time)) == len(joints) == len(np.unique(inputs["measurement"]["encoder_time"]))
    np.testing.assert_array_equal(joints.values["position"], said([sent[t] for t in joints.time], "position"))
    assert joints.names == STATE_NAMES
    for topic, column, key in (
        ("four_axes/command", "base_thrust", "thrust"), ("gimbals_ctrl", "position", "position"),
        ("joints_ctrl", "position", "position"), ("joints_torque_ctrl", "effort", "effort"),
        ("flight_config_cmd", "cmd", "cmd"),
    ):  # fmt: skip
        commands = flown.commands(topic)
        assert len(commands) > 0
        assert record[topic].time.tolist() == [message.stamp for message in commands]
        np.testing.assert_array_equal(np.ravel(record[topic].values[column]), np.ravel(said(commands, key)))
    texts = [
        f"{t:.3f} s: {text}"
        for t, text in zip(record["runner/events"].time, record["runner/events"].values["data"], strict=True)
    ]
    words = [line.removeprefix("runner: ") for line in flown.played.run.words]
    printed = [line for line in words if line.partition(" s: ")[2].partition(",")[0] in STAGES]
    assert [text for text in texts if "fault" not in text] == printed
    assert len(printed) >= 3


def test_another_library_reads_the_numbers_of_the_log_in_mcap(flown, tmp_path, capfd):
    main(["log", "convert", str(flown.path), "--out", str(tmp_path / "run.mcap")])
    log = flown.played.log
    found = {}
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((schema.name, channel, message, decoded))
        facts = {each.name: each.metadata for each in reader.iter_metadata()}["spidar_gym"]
        mission = {each.name: json.loads(each.data) for each in reader.iter_attachments()}["mission.json"]
    assert facts["property.interface"].encode() == flown.path.read_bytes()[8:40]
    assert mission["end"] == float(log.mission["end"])

    def values(topic, name):
        return np.array([getattr(decoded, name) for *_, decoded in found[f"/spidar/{topic}"]])

    rows = log.outputs["action"] == Action.PUBLISH
    thrust = log.outputs["command"]["thrust"][rows].astype(np.float32)
    np.testing.assert_array_equal(values("four_axes/command", "base_thrust").astype(np.float32), thrust)
    np.testing.assert_array_equal(values("runner/allocation", "forces_l"), log.outputs["forces_l"][rows])
    np.testing.assert_array_equal(values("runner/timing", "compute_us"), log.clock["compute_us"])
    assert values("runner/status", "stage").tolist() == log.outputs["stage"].tolist()
    kinds = {int(stage): text for text, stage in STAGES.items()}
    assert values("runner/status", "stage_text").tolist() == [kinds[k] for k in log.outputs["stage"].tolist()]
    seen = log.outputs["state"]["quat_wb"].any(axis=1)
    np.testing.assert_array_equal(values("runner/estimate", "position_w"), log.outputs["state"]["position_w"][seen])
    gyro = said(flown.sent("imu"), "gyro").astype(np.float32)
    np.testing.assert_array_equal(values("imu", "gyro_data").astype(np.float32), gyro[: len(found["/spidar/imu"])])
    name, channel, message, pose = found["/spidar/mocap/pose"][100]
    sent = flown.sent("mocap/pose")[100]
    assert name == "geometry_msgs/PoseStamped"
    assert channel.metadata["unit.position_w"].startswith("m; ")
    assert pose.header.frame_id == "world"
    assert pose.header.stamp.to_sec() == pytest.approx(sent.stamp, abs=1e-9)
    assert [pose.pose.orientation.w, pose.pose.orientation.x] == sent.values["quat"][:2].tolist()
    assert message.log_time >= pose.header.stamp.to_nsec() - 1
    joints = found["/spidar/joint_states"][0][3]
    assert tuple(joints.name) == STATE_NAMES


def test_records_survive_mcap_with_every_topic_and_the_same_record_gives_the_same_bytes(flown, tmp_path):
    for k, record in enumerate((random_record(), read_log(flown.path))):
        paths = [tmp_path / f"{k}{each}.mcap" for each in "ab"]
        for path in paths:
            assert write_mcap(record, path, namespace="/other") == ()
        assert paths[0].read_bytes() == paths[1].read_bytes()
        back = read_log(paths[0])
        assert list(back.series) == list(record.series)
        assert (back.kind, back.epoch, back.properties, back.warnings, back.attachments) == (
            record.kind, record.epoch, record.properties, record.warnings, record.attachments
        )  # fmt: skip
        for topic, series in record.series.items():
            spinal = series.format.kind.startswith("spinal")
            values = {n: v.astype(np.float32).astype(float) if spinal and v.dtype == float else v
                      for n, v in series.values.items()}  # fmt: skip
            assert_same(type(series)(topic, series.time, series.received, values, series.names), back[topic])


def test_stamps_that_ros_cannot_hold_are_written_as_zero_with_a_warning(tmp_path):
    record = random_record()
    record["imu"].time[:2] = np.nan, -1e12
    warnings = write_mcap(record, tmp_path / "x.mcap")
    assert warnings == ("2 stamps of imu are no times of ROS: written as 0",)


def test_a_log_of_another_interface_or_kind_is_refused_in_one_line(flown, tmp_path):
    data = bytearray(flown.path.read_bytes()[: START + TICK])
    path = tmp_path / "run.log"
    data[8:12] = b"ffff"
    path.write_bytes(data)
    with pytest.raises(BorderError, match=r"interface 'ffff.*valid: conversion with the version"):
        read_log(path)
    data = bytearray(flown.path.read_bytes()[:START])
    data[log_layouts()["log_head"].fields["kind"][1]] = 0
    path.write_bytes(data)
    with pytest.raises(BorderError, match="no log of a run"):
        read_log(path)


def test_a_message_that_stays_the_newest_is_in_the_record_once_and_ticks_with_two_times_are_damaged(flown, tmp_path):
    path, types = tmp_path / "run.log", log_layouts()
    data = bytearray(flown.path.read_bytes()[: START + 40 * TICK])
    inputs = [np.frombuffer(data, types["loop_input"], 1, START + k * TICK)[0] for k in range(40)]
    for record in inputs[10:20]:  # the servos and the flight stack are silent
        record["measurement"]["encoder_time"] = inputs[9]["measurement"]["encoder_time"]
        record["flight_state_time"] = inputs[9]["flight_state_time"]
    path.write_bytes(data)
    record = read_log(path)
    assert [len(record[topic]) for topic in ("joint_states", "flight_state", "runner/status")] == [30, 30, 40]
    inputs[20]["time"], inputs[21]["time"] = np.nan, inputs[21]["time"] + 1.0
    path.write_bytes(data)
    record = read_log(path)
    assert ticks_of(record) == 38
    assert record.warnings[0].startswith("2 of 40 ticks are damaged")


def test_a_log_of_ten_minutes_is_converted_in_less_than_twenty_seconds(flown, tmp_path, capfd):
    ticks = 24_000
    lengthened(flown.path, tmp_path / "long.log", ticks)
    begun = time.process_time()
    main(["log", "convert", str(tmp_path / "long.log")])
    assert time.process_time() - begun < 20.0
    with (tmp_path / "long.mcap").open("rb") as file:
        counts = make_reader(file).get_summary().statistics.channel_message_counts
    assert sum(counts.values()) > 18 * ticks


# Damage


def ticks_of(record):
    return len(record["runner/timing"]) if "runner/timing" in record else 0


def test_cut_and_damaged_logs_of_the_runner_keep_their_whole_ticks(flown, tmp_path):
    data, rng, path = flown.path.read_bytes()[: START + 40 * TICK], np.random.default_rng(7), tmp_path / "run.log"
    whole = read_log(flown.path)
    for cut in (*range(0, len(data), len(data) // 30), *(START + k * TICK + 10 for k in range(1, 5)), len(data)):
        path.write_bytes(data[:cut])
        if cut < START:
            with pytest.raises(BorderError, match="valid"):
                read_log(path)
            continue
        record, (ticks, rest) = read_log(path), divmod(cut - START, TICK)
        assert ticks_of(record) == ticks
        assert len(record.warnings) == (rest > 0)
    for _ in range(80):
        damaged = bytearray(data)
        at = sorted(rng.integers(START, len(data), 3).tolist())
        for place in at:
            damaged[place] = int(rng.integers(256))
        path.write_bytes(damaged)
        record, before = read_log(path), (at[0] - START) // TICK
        assert 37 <= ticks_of(record) <= 40
        for name, values in record["runner/timing"].values.items():
            np.testing.assert_array_equal(values[:before], whole["runner/timing"].values[name][:before])
        record_table(record)
    path.write_bytes(data[: START + 5 * TICK] + bytes(3 * TICK) + data[START + 8 * TICK + 100 :])
    record = read_log(path)
    assert ticks_of(record) == 5
    assert "damaged, the first at byte" in record.warnings[0]


def check_front(record, whole):
    """Assert that every series of a record is the front of another record's."""
    for topic, series in record.series.items():
        np.testing.assert_array_equal(series.time, whole[topic].time[: len(series)])
        for name, values in series.values.items():
            np.testing.assert_array_equal(values, whole[topic].values[name][: len(series)])


def test_cut_and_damaged_files_of_mcap_keep_what_is_whole(flown, tmp_path):
    record = read_log(flown.path)
    path, rng = tmp_path / "x.mcap", np.random.default_rng(8)
    write_mcap(record, path)
    data = path.read_bytes()
    whole = read_log(path)
    assert len(data) > 500_000  # several chunks
    for cut in range(9, len(data), len(data) // 10):
        path.write_bytes(data[:cut])
        found = read_log(path)
        assert any("cut or damaged" in warning for warning in found.warnings)
        check_front(found, whole)
    assert len(found["imu"]) > 0.5 * len(record["imu"])
    small = tmp_path / "small.mcap"
    write_mcap(random_record(), small)
    data, refusals = small.read_bytes(), 0
    for k in range(300):
        damaged = bytearray(data[: rng.integers(1, len(data))] if k % 3 == 0 else data)
        for place in rng.integers(0, len(damaged), 2):
            damaged[place] = int(rng.integers(256))
        small.write_bytes(damaged)
        try:
            record_table(read_log(small))
        except BorderError:
            refusals += 1
    assert refusals < 30
    # A chunk in the middle is lost, and the others are read.
    write_mcap(record, path)
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 255
    path.write_bytes(data)
    found = read_log(path)
    assert found.warnings == ("damaged or cut parts of the file, left out: 1",)
    assert 0.2 * len(record["imu"]) < len(found["imu"]) < len(record["imu"])
    assert found["imu"].time[-1] == whole["imu"].time[-1]


@pytest.mark.parametrize("compression", [None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def test_cut_and_damaged_bags_keep_what_is_whole(compression, tmp_path):
    bag, path, rng = (
        write_bag(tmp_path / "a.bag", compression=compression),
        tmp_path / "b.bag",
        np.random.default_rng(9),
    )
    data, whole = bag.path.read_bytes(), read_log(bag.path)
    for cut in range(13, len(data), len(data) // 20):
        path.write_bytes(data[:cut])
        found = read_log(path)
        assert "damaged or unindexed" in found.warnings[0]
        if found.epoch == whole.epoch:
            check_front(found, whole)
    assert compression or len(found["imu"]) > 0.8 * len(whole["imu"])
    for _ in range(60):
        damaged = bytearray(data)
        for place in rng.integers(13, len(data), 3):
            damaged[place] = int(rng.integers(256))
        path.write_bytes(damaged)
        record_table(read_log(path))
    unindexed = bytearray(data)
    at = data.index(b"index_pos=") + 10
    unindexed[at : at + 8] = bytes(8)
    path.write_bytes(unindexed)
    found = read_log(path)
    assert len(found["imu"]) == len(whole["imu"])
    assert "not indexed" in found.warnings[0]


# Bags of the robot


@pytest.mark.parametrize("head", [False, True])
def test_a_bag_of_the_robot_is_read_with_both_spellings_of_its_inertial_unit(head, tmp_path):
    bag = write_bag(tmp_path / "robot.bag", head=head)
    record = read_log(bag.path)
    imu = record["imu"]
    np.testing.assert_array_equal(imu.values["angular_velocity"], bag.gyro.astype(float))
    np.testing.assert_array_equal(imu.values["specific_force"], 2.0 * bag.gyro.astype(float))
    assert ("quat_wb" in imu.values) == head
    if head:
        np.testing.assert_allclose(imu.values["quat_wb"][0], [0.9, 0.1, 0.2, 0.3], rtol=1e-6)
    assert record.epoch == EPOCH
    np.testing.assert_allclose(imu.time, 0.005 * np.arange(len(imu)), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(imu.received - imu.time, 0.003, rtol=0.0, atol=1e-9)
    assert imu.unit("angular_velocity") == "rad/s"
    joints = record["joint_states"]
    assert joints.names == ("joint1_yaw", "joint1_pitch", "joint2_yaw", "gimbal1_roll")
    np.testing.assert_array_equal(joints.values["position"][1::2, 0], bag.position[1::2, 1])
    np.testing.assert_array_equal(joints.values["position"][::2, 3], bag.position[::2, 0])
    assert np.isnan(joints.values["position"][::2, 0]).all()
    np.testing.assert_array_equal(record["four_axes/command"].values["base_thrust"], bag.thrust.astype(float))
    np.testing.assert_array_equal(record["mocap/pose"].values["position_w"], bag.position[:, :3])
    assert record["flight_state"].values["data"].tolist() == [5] * len(bag.thrust)
    assert {topic: (o.kind, o.count) for topic, o in record.others.items()} == {
        "/spidar/rpy/gain": ("std_msgs/String", len(bag.thrust))
    }
    write_mcap(record, tmp_path / "robot.mcap")
    assert_same(imu, read_mcap(tmp_path / "robot.mcap")["imu"])
    assert read_log(bag.path, namespace="/elsewhere").series == {}


ROSBAG = """
import sys, rosbag, rospy
from std_msgs.msg import UInt8
from geometry_msgs.msg import PoseStamped
with rosbag.Bag(sys.argv[1], "w", chunk_threshold=5000) as bag:
    for k in range(500):
        pose, time = PoseStamped(), rospy.Time(100, 10**7 * k)
        pose.header.stamp, pose.pose.position.x = time, 0.5 * k
        bag.write("/spidar/mocap/pose", pose, time)
        bag.write("/spidar/flight_state", UInt8(k % 7), time)
"""
"""Writes a bag with ROS's own library."""


@marked("ros")
def test_a_bag_of_ross_own_library_is_read_whole_and_cut(tmp_path):
    path = tmp_path / "ros.bag"
    subprocess.run(["/usr/bin/python3", "-c", ROSBAG, str(path)], check=True, env={"PATH": "/usr/bin:/bin"})
    record = read_log(path)
    assert record["mocap/pose"].values["position_w"][:, 0].tolist() == [0.5 * k for k in range(500)]
    np.testing.assert_allclose(record["mocap/pose"].time, 0.01 * np.arange(500), rtol=0.0, atol=1e-9)
    assert record["flight_state"].values["data"].tolist() == [k % 7 for k in range(500)]
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    check_front(read_log(path), record)
    damaged = bytearray(data)
    at = data.index(b"compression=", len(data) // 3) - 40
    damaged[at : at + 60] = bytes(60)  # the front of a chunk
    path.write_bytes(damaged)
    found = read_log(path)
    assert 450 < len(found["mocap/pose"]) < 500
    assert found["mocap/pose"].time[-1] == record["mocap/pose"].time[-1]


def test_commands_of_two_nodes_are_one_series_in_the_order_of_receipt(tmp_path):
    store, path = typestore(), tmp_path / "two.bag"
    kind = "spinal/msg/FourAxisCommand"
    with Writer(path) as writer:
        nodes = [writer.add_connection("/spidar/four_axes/command", kind, typestore=store, callerid=n) for n in "ab"]
        for k in range(6):
            thrust = np.full(8 - k % 2, k, np.float32)
            command = store.types[kind](angles=np.zeros(3, np.float32), base_thrust=thrust)
            writer.write(nodes[k % 2], 10**9 * k, store.serialize_ros1(command, kind))
    series = read_log(path)["four_axes/command"]
    assert series.time.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert series.values["base_thrust"][:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert np.isnan(series.values["base_thrust"][1::2, 7]).all()


def test_topics_with_messages_of_another_kind_are_named_and_not_read(tmp_path):
    path = tmp_path / "json.mcap"
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start("ros2")
        schema = writer.register_schema("sensor_msgs/msg/Imu", "jsonschema", b"{}")
        channel = writer.register_channel("/spidar/imu", "json", schema)
        writer.add_message(channel, 2**64 - 1, b"{}", 0)
        writer.finish()
    record = read_log(path)
    assert record.series == {}
    assert record.others == {"/spidar/imu": Other("sensor_msgs/msg/Imu", 1)}
    assert "not read" in record_table(record)


# Simulation


def test_an_episode_is_recorded_with_its_true_states_commands_and_samples(tmp_path):
    arguments = {"sensors": True, "wake": False}
    with gymnasium.make("spidar_gym/Hover-v0", **arguments) as env:
        record = record_env(env, seed=3, ticks=80)
        inner, states, commands = env.unwrapped, [], []
        for _ in rollout(env, seed=3, ticks=80):
            states.append(inner.state)
            commands.append(inner.command)
    truth = record["truth/state"]
    np.testing.assert_array_equal(truth.values["position_w"][1:], [state.position_w for state in states])
    np.testing.assert_allclose(truth.time, 0.025 * np.arange(81), atol=1e-12)
    np.testing.assert_array_equal(record["gimbals_ctrl"].values["position"], [np.ravel(c.vectoring) for c in commands])
    imu, gyro = record["imu"], record["imu"].values["angular_velocity"]
    np.testing.assert_allclose(imu.time, 0.005 * np.arange(401), atol=1e-9)
    assert np.abs(gyro[::5] - truth.values["omega_b"]).max() < 0.06
    joints = record["joint_states"]
    assert np.abs(np.diff(joints.time) - np.array([0.02, 0.04])[:, None]).min(axis=0).max() < 1e-9
    at = np.searchsorted(truth.time, joints.time[::2])
    assert 150 <= len(record["mocap/pose"]) <= 200
    assert len(at) > 30
    write_mcap(record, tmp_path / "episode.mcap")
    assert_same(truth, read_log(tmp_path / "episode.mcap")["truth/state"])
    with pytest.raises(ValueError, match="SpidarEnv"):
        Recorder(gymnasium.make("CartPole-v1"))


# The guide


def test_the_guide_lists_every_topic_with_its_type_and_the_columns_with_their_units():
    page = (ROOT / "docs" / "onboard" / "logs.md").read_text(encoding="utf-8")
    for form in FORMATS.values():
        columns = (f"`{c.name}`" + (f" [{c.unit}]" if c.unit not in ("", "1") else "") for c in form.columns)
        assert f"| `{form.topic}` | `{form.kind}` | {', '.join(columns) or '–'} |" in page


# The command


def test_the_command_describes_and_converts_logs(flown, tmp_path, capfd):
    main(["log", "info", str(flown.path)])
    text = capfd.readouterr().out
    for words in ("kind run", "spinal/Imu", "200.0", "angular_velocity [rad/s]", "forcing the landing"):
        assert words in text
    cut = tmp_path / "cut.log"
    cut.write_bytes(flown.path.read_bytes()[:-7])
    main(["log", "info", str(cut), "--json"])
    facts = json.loads(capfd.readouterr().out)
    assert facts["topics"]["runner/timing"]["columns"] == {"wait_us": "µs", "compute_us": "µs"}
    assert "cut" in facts["warnings"][0]
    main(["log", "convert", str(cut), "--csv", str(tmp_path / "csv")])
    out, err = capfd.readouterr()
    assert "topics" in out
    assert "spidar: warning: " in err
    lines = (tmp_path / "csv" / "imu.csv").read_text().splitlines()
    assert lines[0].startswith("time [s],received [s],specific_force.x [m/s²]")
    assert float(lines[1].split(",")[5]) == read_log(cut)["imu"].values["angular_velocity"][0, 0]
    assert not (tmp_path / "cut.mcap").exists()
    main(["log", "convert", str(cut)])
    assert ticks_of(read_log(tmp_path / "cut.mcap")) == ticks_of(read_log(cut))
    main(["run", "--seconds", "0.2", "--log", str(tmp_path / "episode.mcap")])
    assert len(read_log(tmp_path / "episode.mcap")["truth/state"]) == 9
    assert (
        sorted(p.name for p in write_csv(read_log(tmp_path / "episode.mcap"), tmp_path / "two"))[0]
        == "four_axes.command.csv"
    )


def test_bad_words_of_the_command_are_refused_in_one_line(tmp_path, capfd, monkeypatch):
    foreign, mcap, bag = tmp_path / "foreign.log", tmp_path / "x.mcap", tmp_path / "x.bag"
    foreign.write_text("nothing")
    write_mcap(random_record(), mcap)
    bag.write_bytes(b"#ROSBAG V1.2\n")
    for words in (
        ("info", foreign), ("info", tmp_path / "none"), ("info", tmp_path), ("convert", mcap), ("info", bag),
        ("info", mcap, "--namespace", "spidar"), ("convert", foreign, "--csv", tmp_path / "csv"),
        ("convert", mcap, "--out", foreign / "x.mcap"),
    ):  # fmt: skip
        assert "valid" in refused(capfd, "log", *map(str, words)) if words[0] == "info" else True
        if words[0] == "convert":
            with pytest.raises(SystemExit) as stop:
                main(["log", *map(str, words)])
            assert stop.value.code == 2
            assert "valid" in capfd.readouterr().err.splitlines()[-1]
    with pytest.raises(SystemExit):
        main(["log", "convert", str(write_bag(tmp_path / "y.bag", namespace="/dragon").path)])
    assert "valid: a log with some, or --namespace /dragon" in capfd.readouterr().err
    assert "one episode" in refused(capfd, "run", "--episodes", "2", "--log", "x.mcap")
    monkeypatch.setitem(sys.modules, "mcap.data_stream", None)
    assert "spidar-gym[log]" in refused(capfd, "log", "info", str(mcap))
