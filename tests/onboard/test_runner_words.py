"""Pins the runner's inputs and outputs: mission file, contract with the robot, messages and figures."""

import ctypes
import re
import subprocess
import threading
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from support.needs import needs_compiler
from support.runner import CRAWL, FLIGHT, HOLD, LAND, NAMES, RATES, TOPICS, ZEROS, junk, nan_pose, read_mission, said

from spidar_gym.control.presets import CRAWL_PRESETS, FORMER_CRAWL_PRESETS, FORMER_PRESETS, PRESETS
from spidar_gym.native.constants import ONBOARD_ITERATIONS
from spidar_gym.native.structs import fill
from spidar_gym.onboard.export import EVERY
from spidar_gym.onboard.parameters import digest_of, parameters_record, parameters_text
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.onboard.runner_structs import log_layouts
from spidar_gym.onboard.topics_file import topics_file
from spidar_gym.robot import ROBOT
from spidar_gym.robot.description import model_hash
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import hover_mission

pytestmark = needs_compiler


# The mission.


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_every_kind_of_line_is_read(library, end):
    form = " ".join(f"{0.05 * k - 0.4:g}" for k in range(16))
    lines = [
        "# a flight", "", "  flight   tuned  # a comment", f"form 0 {ZEROS}", f"\tform 2.5\t{form}", "   ",
        "unrestricted 3 4.5", "unrestricted 6 7", "estimate odometry", "residual on", "fence -1 -2 -0.5 1 2 2.5",
        "ages 0.1 0.05 0.2 0.4", "settle 2", "tilt 0.5", "speed 0.7", "end 12.5",
    ]  # fmt: skip
    m = read_mission(library, end.join(lines))
    assert not isinstance(m, str), m
    assert [int(m[name]) for name in ("kind", "odometry", "residual")] == [FLIGHT, 1, 1]
    assert [int(m[f"{name}_count"]) for name in ("form", "window", "move")] == [2, 2, 0]
    np.testing.assert_array_equal(m["forms"]["start"][:2], [0.0, 2.5])
    np.testing.assert_allclose(m["forms"]["joint_target"][1], 0.05 * np.arange(16) - 0.4, atol=1e-12)
    assert m["windows"][:2].tolist() == [(3.0, 4.5), (6.0, 7.0)]
    limits = m["limits"]
    np.testing.assert_array_equal(limits["fence_low"], [-1.0, -2.0, -0.5])
    np.testing.assert_array_equal(limits["fence_high"], [1.0, 2.0, 2.5])
    ages = [float(limits[f"{name}_age"]) for name in ("pose", "imu", "joint", "state")]
    assert ages == [0.1, 0.05, 0.2, 0.4]
    assert [float(limits[name]) for name in ("settle", "tilt")] == [2.0, 0.5]
    assert [float(m["controller"]["joint_speed"]), float(m["end"])] == [0.7, 12.5]
    crawl = read_mission(library, end.join(["crawl robust", "move 0.1 -0.2 0.3 4", "move 0.2 0 0 0", "speed 0.4"]))
    assert [int(crawl["kind"]), int(crawl["move_count"])] == [CRAWL, 2]
    assert crawl["moves"][0].item()[:2] == ((0.1, -0.2, 0.3), 4)
    assert crawl["crawler"]["joint_speed"] == 0.4
    assert limits["hold_ticks"] == crawl["limits"]["hold_ticks"] == HOLD
    assert limits["landing_ticks"] == LAND


@pytest.mark.parametrize(
    ("kind", "name", "config"),
    [("flight", name, config) for name, config in (PRESETS | FORMER_PRESETS).items()]
    + [("crawl", name, config) for name, config in (CRAWL_PRESETS | FORMER_CRAWL_PRESETS).items()],
)
def test_presets_are_the_simulators_with_the_robots_iteration_cap(library, kind, name, config):
    m = read_mission(library, f"{kind} {name}\n")
    field = "crawler" if kind == "crawl" else "controller"
    expected = np.zeros((), log_layouts()[f"{field}_config"])
    fill(expected, replace(config, allocator=replace(config.allocator, max_iter=ONBOARD_ITERATIONS)))
    assert m[field].tobytes() == expected.tobytes()
    assert m[field]["allocator"]["max_iter"] == 300


OTHER_KIND = "form, end for a flight or a bench test; unrestricted for a flight; move for a crawl"
REFUSED = {
    "": "line 0; valid: flight PRESET, crawl PRESET, course FLIGHT CRAWL or bench first",
    "# nothing\n\n": "flight PRESET, crawl PRESET, course FLIGHT CRAWL or bench first",
    "end 3\nflight paper": "line 1; valid: flight PRESET, crawl PRESET, course FLIGHT CRAWL or bench first",
    "flight paper\nflight paper": "line 2; valid: one flight, crawl, course or bench",
    "flight paper\ncrawl robust": "line 2; valid: one flight, crawl, course or bench",
    "flight": "flight and one of paper, as_flown, as_flown_quasi, tuned",
    "flight robust": "line 1; valid: flight and one of paper, as_flown, as_flown_quasi, tuned",
    "crawl tuned": "crawl and one of published, overlapped, robust",
    "flight paper tuned": "flight and one of",
    "flight paper\nform 0 1 2": "line 2; valid: form SECONDS and 16 angles",
    f"flight paper\nform 0 {ZEROS} 0": "form SECONDS and 16 angles",
    f"flight paper\nform -1 {ZEROS}": "form SECONDS and 16 angles",
    f"flight paper\nform nan {ZEROS}": "form SECONDS and 16 angles",
    f"flight paper\nform 0x {ZEROS}": "form SECONDS and 16 angles",
    f"flight paper\nform 0 1.6 {ZEROS[2:]}": "form angles within ± 90 degrees",
    f"flight paper\nform 2 {ZEROS}\nform 1 {ZEROS}": "line 3; valid: at most 64 forms, in the order of their times",
    f"flight paper\n{f'form 1 {ZEROS}{chr(10)}' * 65}": "line 66; valid: at most 64 forms",
    "flight paper\n" + "unrestricted 1 2\n" * 9: "line 10; valid: at most 8 windows",
    "flight paper\nunrestricted 2 2": "unrestricted START END",
    "crawl robust\n" + "move 0.1 0 0 0\n" * 17: "line 18; valid: at most 16 moves",
    "crawl robust\nmove 0.1 0 0": "move X Y [m] YAW [rad] CYCLES",
    "crawl robust\nmove 0.1 0 0 1.5": "move X Y [m] YAW [rad] CYCLES",
    "crawl robust\nmove 0.1 0 0 -1": "move X Y [m] YAW [rad] CYCLES",
    "crawl robust\nmove inf 0 0 1": "move X Y [m] YAW [rad] CYCLES",
    "crawl robust\nmove 0.1 0 0 1e9": "move X Y [m] YAW [rad] CYCLES",
    f"crawl robust\nform 0 {ZEROS}": OTHER_KIND,
    "crawl robust\nunrestricted 1 2": OTHER_KIND,
    "flight paper\nmove 0.1 0 0 1": OTHER_KIND,
    "flight paper\nestimate": "line 2; valid: estimate mocap, or estimate odometry",
    "flight paper\nestimate gps": "estimate mocap, or estimate odometry",
    "flight paper\nresidual yes": "residual on, or residual off",
    "flight paper\nfence 1 1 1 2 2": "fence, then x y z of its low and of its high corner",
    "flight paper\nfence 1 1 1 2 1 2": "a fence whose low corner is below its high one",
    "flight paper\nages 0.1 0.1 0.1": "ages of pose, inertial unit, joints, flight state",
    "flight paper\nages 0.1 0.1 0.1 0.6": "ages within 0 … 0.5 s",
    "flight paper\nages 0.1 0 0.1 0.1": "ages within 0 … 0.5 s",
    "flight paper\nsettle": "one number after settle, tilt, deviation, torque, end",
    "flight paper\nsettle 0": "a number above 0",
    "flight paper\ntilt -1": "a number above 0",
    "flight paper\ntilt 1.01": "tilt within 0 … 1 rad",
    "flight paper\nspeed fast": "speed and one number, or a second one of a crawl [rad/s]",
    "course tuned robust\nspeed 0.5 1.7": "speed within 0 … 1.62 rad/s",
    "flight paper\nend 1 2": "one number after settle, tilt, deviation, torque, end",
    "flight paper\nhover 3": "line 2; valid: flight, crawl, course, bench, form, heading, excite, move, crawl_to,",
    "flight paper\nFORM 3": "flight, crawl, course, bench, form, heading",
    "flight paper\nend" + " 1" * 30: "line 2; valid: fewer words",
    "flight paper\n#" + "x" * 1100: "line 2; valid: a line of at most 1023 characters",
}


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_a_wrong_line_is_named_with_what_would_be_valid(library, text):
    reason = read_mission(library, text)
    assert isinstance(reason, str)
    assert re.match(r"mission, line \d+; valid: ", reason)
    assert REFUSED[text] in reason


@pytest.mark.parametrize(
    "text",
    [
        "flight paper\n#" + "x" * 1022,
        "flight paper\n" + f"form 1 {ZEROS}\n" * 64,
        "flight paper\n" + "unrestricted 1 2\n" * 8,
        "crawl robust\n" + "move 0.1 0 0 0\n" * 16,
        f"flight paper\nform 1 {ZEROS}\nform 1 {ZEROS}",
        f"flight paper\nform 0 1.5708 -1.5708 {ZEROS[4:]}",
        "\n\n#\n  crawl published",
        "flight\tpaper",
    ],
    ids=range(8),
)
def test_what_is_just_valid_is_read(library, text):
    m = read_mission(library, text)
    assert not isinstance(m, str), m
    assert np.abs(m["forms"]["joint_target"]).max() <= ROBOT.joint_limit


def test_junk_is_read_or_refused(library):
    rng, kinds = np.random.default_rng(5), set()
    for _ in range(1500):
        answer = read_mission(library, junk(rng).replace(b"\0", b""))
        kinds.add(type(answer))
        if isinstance(answer, str):
            assert re.match(r"mission, line \d+; valid: ", answer)
        else:
            assert answer["limits"]["tilt"] <= 1.0
            assert np.isfinite(answer["forms"]["joint_target"]).all()
    assert len(kinds) == 2


@pytest.mark.slow
def test_sanitizers_find_nothing_in_junk(checked, tmp_path):
    rng = np.random.default_rng(6)
    for _ in range(60):
        (tmp_path / "mission").write_bytes(junk(rng))
        done = said(checked, "sim", "127.0.0.1:1", tmp_path / "mission")
        assert done.returncode == 2
        assert done.stderr.startswith("runner: ")
        assert done.stderr.count("\n") == 1


def test_a_move_out_of_reach_is_refused_before_connecting(runner, tmp_path):
    (tmp_path / "mission").write_text("crawl published\nmove 5 0 0 1\n")
    done = said(runner, "sim", "127.0.0.1:1", tmp_path / "mission")
    assert (done.returncode, done.stderr) == (2, "runner: a move of the mission is out of reach; valid: shorter ones\n")


@pytest.mark.parametrize("size", [70_000, 200_000])
def test_a_mission_that_is_too_long_is_not_cut(runner, tmp_path, size):
    text = "flight paper\n" + ("#" + "x" * 998 + "\n") * (size // 1000) + "nonsense\n"
    (tmp_path / "mission").write_text(text)
    done = said(runner, "sim", "127.0.0.1:1", tmp_path / "mission")
    assert done.returncode == 2
    assert "mission" in done.stderr, "not that there is no simulator"


# The contract.


class Robot(ctypes.Structure):
    """sp_found."""

    _fields_ = [
        ("model", ctypes.c_char_p), ("name_count", ctypes.c_int32), ("names", ctypes.POINTER(ctypes.c_char_p)),
        ("rates", ctypes.c_double * 5),
    ]  # fmt: skip


def agree(library, odometry=0, model=None, names=NAMES, **rates):
    """Return the contract's reason against a robot; empty for the right one."""
    found = (ctypes.c_double * 5)(*(rates.get(t, rate) for t, rate in zip(TOPICS, RATES, strict=True)))
    words = (ctypes.c_char_p * len(names))(*(name.encode() for name in names))
    robot, reason = Robot((model or model_hash()).encode(), len(names), words, found), ctypes.create_string_buffer(256)
    ok = library.sp_agree(ctypes.byref(robot), model_hash().encode(), odometry, reason, ctypes.c_size_t(256))
    assert bool(ok) == (not reason.value)
    return reason.value.decode()


@pytest.mark.parametrize("odometry", [0, 1])
def test_the_right_robot_is_accepted(library, odometry):
    assert agree(library, odometry) == ""
    unused = ["imu", "mocap/pose"] if odometry else ["uav/cog/odom"]
    assert agree(library, odometry, **dict.fromkeys(unused, 0.0)) == "", "topics that are not used"
    for factor in (0.75, 1.25):
        rates = {t: factor * rate for t, rate in zip(TOPICS, RATES, strict=True)}
        assert agree(library, odometry, **rates) == ""
    assert agree(library, odometry, flight_state=3.0) == "", "the rate of flight_state is not checked"


@pytest.mark.parametrize("odometry", [0, 1])
@pytest.mark.parametrize("topic", TOPICS)
def test_each_topic_and_its_rate_is_required(library, odometry, topic):
    if topic in (("imu", "mocap/pose") if odometry else ("uav/cog/odom",)):
        return
    for rate in (0.0, np.nan, -1.0):
        assert agree(library, odometry, **{topic: rate}).startswith(f"nothing comes on {topic}; valid: ")
    if topic != "flight_state":
        due = RATES[TOPICS.index(topic)]
        for rate in (0.69 * due, 1.31 * due, np.inf):
            words = agree(library, odometry, **{topic: rate})
            assert words == f"{topic} comes at {rate:.0f} Hz; valid: {0.7 * due:.0f} … {1.3 * due:.0f}"


@pytest.mark.parametrize("estimate", ["mocap", "odometry"])
def test_the_file_of_topics_states_what_is_required_and_accepted(library, estimate):
    odometry, checked = int(estimate == "odometry"), []
    for topic in tomllib.loads(topics_file().decode())["topic"]:
        name = topic["name"]
        if name not in TOPICS:
            assert topic.get("required", "never") == "never"
            continue
        required = topic["required"] in ("always", f"estimate {estimate}")
        assert (agree(library, odometry, **{name: 0.0}) != "") == required, name
        for edge, inwards in zip(topic.get("accepted", ()), (1.001, 0.999), strict=False):
            assert agree(library, odometry, **{name: edge * inwards}) == "", name
            assert (agree(library, odometry, **{name: edge / inwards}) != "") == required, name
        if "accepted" not in topic:
            assert agree(library, odometry, **{name: 1.0}) == agree(library, odometry, **{name: 1000.0}) == "", name
        checked.append(name)
    assert sorted(checked) == sorted(TOPICS)


def swapped(a, b):
    names = list(NAMES)
    names[a], names[b] = names[b], names[a]
    return tuple(names)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (NAMES[:-1], "joint_states names 31 angles; valid: 16 joints, then 16 gimbals"),
        ((), "joint_states names 0 angles"),
        ((*NAMES, "tail"), "joint_states names 33 angles"),
        (swapped(3, 4), f"joint_states has {NAMES[4]} in place 4; valid: {NAMES[3]}"),
        (swapped(15, 16), f"joint_states has {NAMES[16]} in place 16; valid: {NAMES[15]}"),
        ((*NAMES[:-1], "other"), f"joint_states has other in place 32; valid: {NAMES[-1]}"),
    ],
    ids=["missing", "none", "one more", "permuted", "across", "other"],
)
def test_other_joints_are_refused(library, runner, tmp_path, names, words):
    assert agree(library, names=names).startswith(words)
    refused(runner, tmp_path, words, names=names)


def test_another_model_is_refused(library, runner, tmp_path):
    words = f"the robot's model is {'0' * 12}; valid: {model_hash()[:12]}, that of these parameters"
    assert agree(library, model="0" * 64).startswith(words)
    assert agree(library, model=model_hash()[:-1] + "x").startswith("the robot's model is")
    robot = Robot(None, 32, (ctypes.c_char_p * 32)(*(name.encode() for name in NAMES)), (ctypes.c_double * 5)(*RATES))
    reason = ctypes.create_string_buffer(256)
    assert not library.sp_agree(ctypes.byref(robot), model_hash().encode(), 0, reason, ctypes.c_size_t(256))
    assert b"not set" in reason.value
    refused(runner, tmp_path, words, model="0" * 64)


def refused(runner, tmp_path, words, **robot):
    """Check end to end that the runner refuses a robot with one line and status 2."""
    (tmp_path / "mission").write_text("flight paper\n")
    link = SocketLink(**robot)

    def greet():
        link.accept()
        link.close()  # so that a runner which accepts the robot does not wait

    robot_side = threading.Thread(target=greet)
    robot_side.start()
    done = said(runner, "sim", link.place, tmp_path / "mission")
    robot_side.join()
    assert done.returncode == 2
    assert done.stderr.startswith(f"runner: {words}")
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def ask(runner, tmp_path, inputs, hello=None, log=None, seconds=3.0):
    """Send inputs over the socket; return the runner's answers, exit status and output."""
    (tmp_path / "mission").write_text(hover_mission(seconds=seconds).text)
    link = SocketLink()
    if hello is not None:
        link._hello[...] = hello(link._hello)
    program = subprocess.Popen(
        [str(runner), "sim", link.place, str(tmp_path / "mission"), *(["--log", str(log)] if log else [])],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    link.accept()
    answers = []
    for record in inputs:
        link._peer.sendall(record.tobytes())
        data = b""
        while part := link._peer.recv(link.answer.dtype.itemsize - len(data)):
            data += part
            if len(data) == link.answer.dtype.itemsize:
                break
        answers.append(data)
    link.close()
    out, words = program.communicate(timeout=20)
    return answers, program.returncode, out, words


def test_a_simulator_with_another_interface_is_refused(runner, tmp_path):
    def other(hello):
        hello["interface"][3] ^= 1
        return hello

    _, status, _, words = ask(runner, tmp_path, [], other)
    assert (status, words) == (2, "runner: the simulator has another interface; valid: one of this export\n")


@pytest.mark.parametrize(("field", "count"), [("pose_count", 10**6), ("imu_count", 9), ("pose_count", -3)])
def test_counts_over_the_socket_that_no_link_makes_read_no_memory(checked, hover, tmp_path, field, count):
    inputs = hover.inputs[:10].copy()
    inputs["measurement"][field][5] = count
    _, status, _, words = ask(checked, tmp_path, inputs[:6])
    assert status in (0, 2), words[-2000:]
    assert "Sanitizer" not in words
    assert "runtime error" not in words


# Words and figures.


def test_the_deadline_statistics_add_up(runner, hover, tmp_path):
    answers, status, out, words = ask(runner, tmp_path, hover.inputs, log=tmp_path / "log")
    assert answers == hover.answers
    assert status == 0
    line = re.search(r"computing a tick +(\d+) +median < +(\d+) +p99 < +(\d+) +worst +([\d.]+) us", out)
    assert int(line[1]) == len(answers)
    assert 0 < int(line[2]) <= int(line[3]) <= 4000
    assert "tick after its due time" not in out, "lock-step has no due time"
    assert f"{len(answers)} ticks, 0 later than a period; released; last fault: none\n" in out
    assert re.search(r"^runner: [\d.]+ s: driving$", words, re.M)
    assert (tmp_path / "log").stat().st_size == hover.path.stat().st_size


def test_a_fault_that_lands_is_named_and_is_the_exit_status(runner, hover, tmp_path):
    inputs = hover.inputs[: hover.drives + 60].copy()
    for record in inputs[hover.drives + 30 :]:
        nan_pose(record, 0)
    _, status, out, words = ask(runner, tmp_path, inputs, seconds=0.5)
    assert status == 1
    assert re.search(r"^runner: [\d.]+ s: the mission is over$", words, re.M)
    assert "released; landing forced: a sample is not finite\n" in out
    stages = re.findall(r"s: ([a-z ]+)(?:, a sample is not finite)?$", words, re.M)
    assert stages == ["driving", "the mission is over", "holding", "forcing the landing", "released"]


@pytest.mark.parametrize(
    "words",
    [
        [], ["fly"], ["replay", "a"], ["replay", "a", "b", "c"], ["compare", "a"], ["bench"], ["about", "x"], ["sim"],
        ["sim", "127.0.0.1:1"], ["sim", "127.0.0.1:1", "m", "--log"], ["sim", "127.0.0.1:1", "m", "--colour"], ["ros1"],
        ["sim", "127.0.0.1:1", "m", "extra"], ["-h"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_wrong_words_are_answered_with_the_usage(runner, words):
    done = said(runner, *words)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("usage: runner replay IN OUT | compare")


def test_what_cannot_be_read_written_or_reached_is_refused_in_one_line(runner, tmp_path):
    mission, sim = tmp_path / "mission", ("sim", "127.0.0.1:1")
    mission.write_text("flight paper\n")
    for words, expected in (
        (
            (*sim, tmp_path / "none"),
            f"{tmp_path / 'none'}: no mission; valid: a text file of at most 65535 characters, see README.md",
        ),
        ((*sim, tmp_path), "valid: "),
        ((*sim, mission, "--log", tmp_path / "no" / "log"), f"{tmp_path / 'no' / 'log'}: cannot be written; valid: "),
        ((*sim, mission, "--log", tmp_path), f"{tmp_path}: cannot be written; valid: "),
        ((*sim, mission, "--log", "/dev/full"), "/dev/full: cannot be written; valid: "),
        ((*sim, mission), "no simulator there; valid: "),
        (("sim", "nowhere", mission), "no simulator there; valid: "),
        (("sim", "a" * 300 + ":1", mission), "no simulator there; valid: "),
        (("ros1", mission), "compiled without ROS 1; valid: "),
        (("replay", tmp_path / "none", tmp_path / "out"), "no log; valid: "),
        (("replay", mission, tmp_path / "out"), "no log; valid: "),
    ):
        done = said(runner, *words)
        assert done.returncode == 2, words
        assert done.stderr.startswith("runner: "), words
        assert expected in done.stderr
        assert done.stderr.count("\n") == 1
        assert done.stdout == ""


def test_about_says_what_it_was_compiled_for(runner):
    parameters = digest_of(parameters_text(parameters_record(ROBOT, EVERY)))
    assert said(runner, "about").stdout == f"interface {runner_hash()}\nmodel {model_hash()}\nparameters {parameters}\n"
