"""Pins topics.toml of the export: it has the topics, fields and members of the ROS node, and suffices for a link."""

import json
import re
import signal
import subprocess
import time
import tomllib
from xmlrpc.client import ServerProxy

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.needs import marked
from support.robots import LONG

from spidar_gym.logs.runner_log import read_runner_log
from spidar_gym.onboard.message_types import COLUMNS, DEFINITIONS
from spidar_gym.onboard.runner_structs import RUNNER, Action, log_layouts
from spidar_gym.onboard.topics_file import topics_file
from spidar_gym.robot.description import model_hash
from spidar_gym.sitl.link_ros import RosLink
from spidar_gym.sitl.play import build_for

FILE = tomllib.loads(topics_file().decode())
SOURCE = (RUNNER / "ros1.cpp").read_text(encoding="utf-8")


def topics(direction):
    return [topic for topic in FILE["topic"] if topic["direction"] == direction]


def test_it_has_the_topics_and_types_of_the_ros_node_and_no_others():
    handler = r"void (on_\w+)\(const (?:ros::MessageEvent<)?(\w+::\w+?)(?:::ConstPtr| const>) &"
    handlers = dict(re.findall(handler, SOURCE))
    heard = re.findall(r'\.subscribe\("([\w/]+)", \d+, &Robot::(\w+)', SOURCE)
    sent = re.findall(r'\.advertise<(\w+::\w+)>\("([\w/]+)"', SOURCE)
    assert len(heard) == SOURCE.count(".subscribe(") == 10
    assert len(sent) == SOURCE.count(".advertise<") == 5
    found = [("in", name, handlers[handler]) for name, handler in heard] + [("out", name, kind) for kind, name in sent]
    stated = [(topic["direction"], topic["name"], topic["type"].replace("/", "::")) for topic in FILE["topic"]]
    assert sorted(stated) == sorted(found)
    assert f'getParam("{FILE["parameter"]["name"]}"' in SOURCE
    assert f'o->space = o->out = "{FILE["namespace"]}"' in (RUNNER / "main.c").read_text(encoding="utf-8")


def test_the_model_is_that_of_the_exported_robot():
    assert tomllib.loads(topics_file(LONG).decode())["parameter"]["value"] == model_hash(LONG) != model_hash()


def type_of(store, kind, path):
    """Return the type of a value of a message, by its path, from the definition as `rosbags` parsed it."""
    name, _, rest = path.partition(".")
    node, what = dict(store.fielddefs[kind][1])[name.removesuffix("[]")]
    size = {"ARRAY": f"[{what[1]}]", "SEQUENCE": "[]"}.get(node.name, "")
    inner = what[0][1] if size else what
    if rest:
        assert name.endswith("[]") == bool(size)
        return type_of(store, inner, rest)
    return (inner if isinstance(inner, str) else inner[0]) + size


def test_checksums_and_types_of_the_fields_are_those_of_an_independent_library():
    noetic, stores = get_typestore(Stores.ROS1_NOETIC), {}
    for each in FILE["type"]:
        store, kind = get_typestore(Stores.EMPTY), each["name"].replace("/", "/msg/")
        store.register(get_types_from_msg(each["definition"], kind))
        stores[each["name"], each.get("head", False)] = store
        assert each["md5"] == store.generate_msgdef(kind)[1]
        assert kind.startswith("spinal") or each["md5"] == noetic.generate_msgdef(kind)[1]
    assert {kind for kind, _ in stores} == {topic["type"] for topic in FILE["topic"]}
    for topic in FILE["topic"]:
        name = topic["type"]
        kind = name.replace("/", "/msg/")
        for field in topic["fields"]:
            assert {type_of(stores[name, False], kind, path) for path in field["paths"]} == {field["type"]}
            assert {type_of(stores[name, True], kind, path) for path in field.get("paths_head", ())} <= {field["type"]}
        if "path" in topic.get("time", {}):
            assert type_of(stores[name, False], kind, topic["time"]["path"]) == "builtin_interfaces/msg/Time"


def test_units_are_those_in_the_comments_of_the_definitions():
    """Comments are ASCII: on melodic, Python 2 generates the headers."""
    spelled = {"m/s^2": "m/s²", "us": "µs", "degC": "°C"}
    commented = re.compile(r"^# .*\[([^]\n]+)\].*\n\w+(?:\[\d*\])? (\w+)$", re.MULTILINE)
    found = {(path.stem, name): unit for path in DEFINITIONS.glob("*.msg")
             for unit, name in commented.findall(path.read_text(encoding="ascii"))}  # fmt: skip
    assert len(found) == 8
    for (kind, name), unit in found.items():
        columns = COLUMNS[f"spinal/{'ServoStates' if kind == 'ServoState' else kind}"]
        leaves = {leaf.rpartition(".")[2].partition("|")[0]: each.unit for each in columns for leaf in each.leaves}
        assert leaves[name] == spelled.get(unit, unit), (kind, name)
    for topic in FILE["topic"]:
        for field in topic["fields"]:
            assert field["unit"] or field["type"] == "string"


# A robot that is written from the file alone, for the node of ROS 1

ROBOT = """
import json, os, sys, time, tomllib
import rospy
from genpy.dynamic import generate_dynamic

path, dry, values, end, out = sys.argv[1:]
file, values, heard = tomllib.load(open(path, "rb")), json.load(open(values)), {}
types = {t["name"]: generate_dynamic(t["name"], t["definition"]) for t in file["type"] if not t.get("head")}
rospy.init_node("robot", anonymous=True, disable_rosout=True, disable_rostime=True)
rospy.set_param(file["namespace"] + "/" + file["parameter"]["name"], file["parameter"]["value"])

def put(message, path, value):
    front, _, name = path.rpartition(".")
    for each in front.split(".") if front else ():
        message = getattr(message, each)
    setattr(message, name, value)

def hear(message, topic):
    fields = [getattr(message, field["paths"][0]) for field in topic["fields"]]
    heard.setdefault(topic["name"], []).append([list(getattr(message, "name", [])), fields])

plan = []
for topic in file["topic"]:
    kind = types[topic["type"]][topic["type"]]
    if topic["direction"] == "out":
        rospy.Subscriber(dry + "/" + topic["name"], kind, hear, topic)
        continue
    message = kind()
    if any("names" in field for field in topic["fields"]):
        message.name = sum(file["names"].values(), [])
    for field in topic["fields"]:
        value, first = values[topic["name"] + " " + field["paths"][0]], field["paths"][0]
        front, is_list, name = first.partition("[].")
        if is_list:
            if not getattr(message, front):
                setattr(message, front, [types[topic["type"]]["spinal/ServoState"]() for _ in value])
            for entry, each in zip(getattr(message, front), value):
                setattr(entry, name, each)
        else:
            for path, each in zip(field["paths"], value if len(field["paths"]) > 1 else [value]):
                put(message, path, each)
    publisher = rospy.Publisher(file["namespace"] + "/" + topic["name"], kind, queue_size=10, tcp_nodelay=True)
    plan.append([0.0, 1.0 / topic.get("rate", 2.0), publisher, message, topic.get("time", {}).get("path")])
print("ready", flush=True)
while not os.path.exists(end):
    now = time.monotonic()
    for row in plan:
        if now >= row[0]:
            row[0] = max(row[0] + row[1], now - row[1])
            if row[4]:
                put(row[3], row[4], rospy.Time.now())
            row[2].publish(row[3])
    time.sleep(0.001)
json.dump(heard, open(out, "w"), default=list)
"""
"""Publishes and hears every topic; arguments: file, namespace of the dry run, values, file that ends it, messages."""

SYSTEM = {"PYTHONPATH": "/usr/lib/python3/dist-packages"}
"""Variable of Debian's Python, which must not import from the virtual environment."""


def sample():
    """Return distinct values of every field that the runner reads, by topic and first path, of a robot that hovers."""
    k, quat = np.arange(32), np.array([1.0, 0.004, 0.003, 0.002])
    values = {
        "joint_states position": 0.01 + 0.002 * k, "joint_states effort": 0.1 + 0.01 * k,
        "imu acc_data": [0.11, 0.12, 9.8], "imu gyro_data": [0.011, 0.012, 0.013],
        "flight_state data": FILE["values"]["flight_state"]["HOVER"], "battery_voltage_status data": 23.5,
        "servo/states servos[].index": k, "servo/states servos[].angle": 2000 + k,
        "servo/states servos[].temp": 20 + k % 8, "servo/states servos[].load": k - 16,
        "servo/states servos[].error": 32 * (k % 2), "motor_pwms motor_value": 1000 + k[:8],
        "four_axes/command base_thrust": 15.0 + 0.5 * k[:8], "runner/orders data": "now",
        "uav/cog/odom twist.twist.linear.x": [0.01, 0.02, 0.03],
        "uav/cog/odom twist.twist.angular.x": [0.04, 0.05, 0.06],
    }  # fmt: skip
    for front in ("mocap/pose pose.", "uav/cog/odom pose.pose."):
        values |= {f"{front}position.x": [0.1, 0.2, 1.0], f"{front}orientation.w": quat / np.linalg.norm(quat)}
    return {name: np.asarray(value).tolist() for name, value in values.items()}


def member(record, path):
    for name in path.split("."):
        record = record[name]
    return record


def entries(field):
    """Return the slice of a message's named entries that a field's member has."""
    start = 16 if field.get("names") == "gimbals" else 0
    return slice(start, start + 16) if "names" in field else slice(None)


def check_inputs(inputs, values, absent):
    """Check that the values of every field came to its member, its times rose, and its count counted."""
    for topic in topics("in"):
        if topic["name"] == absent:
            continue
        for field in topic["fields"]:
            if "member" not in field:
                continue
            sent, got = values[f"{topic['name']} {field['paths'][0]}"], member(inputs, field["member"])
            if field["type"] == "string":
                assert sent in {row.tobytes().partition(b"\0")[0].decode() for row in got}
                continue
            flat = np.ravel(sent)[entries(field)]
            rows = got.reshape(len(got), -1)[:, : len(flat)]
            assert np.isclose(rows, flat, rtol=1e-6, atol=0.0).all(axis=1).any(), (topic["name"], field)
        if "count" in topic:
            assert member(inputs, topic["count"]["member"]).max() >= 1, topic
        if "member" in topic.get("time", {}):
            times = member(inputs, topic["time"]["member"]).reshape(len(inputs), -1)[:, 0]
            assert 0.0 < times[-1] <= inputs["time"][-1] + 0.05, topic
            assert times[-1] - times[5] > 1.0, topic


def check_outputs(outputs, heard):
    """Check that every message that the runner published has the values of the members in one of its ticks."""
    for topic in topics("out"):
        rows = outputs[outputs["action"] == Action[topic["action"]]]
        assert heard[topic["name"]], topic
        for names, fields in heard[topic["name"]]:
            for field, got in zip(topic["fields"], fields, strict=True):
                if "value" in field:
                    assert np.ravel(got) == pytest.approx(field["value"])
                    continue
                expected = member(rows, field["member"]).reshape(len(rows), -1)
                assert np.isclose(expected, got, rtol=1e-6, atol=1e-9).all(axis=1).any(), (topic["name"], field)
                assert names == FILE["names"].get(field.get("names"), [])


@marked("ros")
@pytest.mark.slow
@pytest.mark.parametrize("estimate", ["mocap", "odometry"])
def test_a_robot_written_from_the_file_alone_fills_every_member_and_hears_every_command(tmp_path, estimate):
    (tmp_path / "topics.toml").write_bytes(topics_file())
    (tmp_path / "values.json").write_text(json.dumps(sample()))
    (tmp_path / "mission.txt").write_text(f"flight paper\nestimate {estimate}\nsettle 0.5\n")
    absent = "uav/cog/odom" if estimate == "mocap" else "mocap/pose"
    paths = [str(tmp_path / name) for name in ("topics.toml", "values.json", "end", "heard.json")]
    words = [paths[0], "/spidar_dry", *paths[1:]]
    program, log, types = build_for("ros"), tmp_path / "run.log", log_layouts()
    front = sum(types[name].itemsize for name in ("log_head", "mission"))
    tick = sum(types[name].itemsize for name in ("loop_input", "loop_output", "log_clock"))
    command = [program, "ros1", tmp_path / "mission.txt", "--out", "/spidar_dry", "--log", log]
    link, deadline = RosLink(), time.monotonic() + 60.0
    talker = ["/usr/bin/python3", "-c", ROBOT, *words]
    robot = subprocess.Popen(talker, env=link.environment() | SYSTEM, stdout=subprocess.PIPE, text=True)
    started = [robot]
    try:
        assert robot.stdout is not None
        assert robot.stdout.readline() == "ready\n"
        runner = subprocess.Popen(command, env=link.environment(), stderr=subprocess.PIPE, text=True)
        started.append(runner)
        while not (log.is_file() and log.stat().st_size > front + 160 * tick):  # four seconds
            assert runner.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.1)
        with ServerProxy(link.uri) as master:
            _, _, (published, subscribed, _) = master.getSystemState("/test")
        runner.send_signal(signal.SIGINT)
        said = runner.communicate(timeout=20)[1]
        (tmp_path / "end").touch()
        robot.communicate(timeout=20)
        assert robot.returncode == 0
    finally:
        for process in started:
            process.kill()
        link.close()
    assert "driving" in said, said
    for direction, listed, front in (("in", subscribed, "/spidar/"), ("out", published, "/spidar_dry/")):
        used = {name.removeprefix(front) for name, nodes in listed if any("spidar_runner" in node for node in nodes)}
        assert used == {topic["name"] for topic in topics(direction)} - {absent}
    found = read_runner_log(log)
    check_inputs(found.inputs, sample(), absent)
    check_outputs(found.outputs, json.loads((tmp_path / "heard.json").read_text()))
