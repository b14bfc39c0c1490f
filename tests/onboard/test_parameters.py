"""Pins parameters read at start: the bits of compiled ones, in C as in Python; other files are refused in one line."""

import ctypes
import hashlib
import subprocess
from pathlib import Path

import numpy as np
import pytest
from support.needs import needs_compiler
from support.parameters import edited, with_compiled
from support.robots import LOADED, LONG, OTHER
from support.runner import DRIVING, Loop, compile_, compiled, from_file, load, read_mission, said

from spidar_gym.border import BorderError
from spidar_gym.cli.main import main
from spidar_gym.control.presets import PRESETS
from spidar_gym.errors import InvalidValueError
from spidar_gym.logs.open import read_log
from spidar_gym.logs.runner_log import read_runner_log
from spidar_gym.native.constants import ONBOARD_ITERATIONS
from spidar_gym.native.robot import robot as robot_record
from spidar_gym.onboard import fields
from spidar_gym.onboard.export import EVERY, export_files, write_files
from spidar_gym.onboard.fields import SECTIONS, fields_of
from spidar_gym.onboard.limits import Limits
from spidar_gym.onboard.parameters import (
    digest_of,
    parameters_of,
    parameters_record,
    parameters_text,
    read_parameters,
)
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.onboard.runner_structs import log_layouts
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.description import model_hash
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import hover_mission

pytestmark = needs_compiler
ROBOTS = {"nominal": ROBOT, "loaded": LOADED, "other": OTHER}
STEADY = parameters_text(parameters_record(presets=("steady",)))
"""A file of the nominal robot."""


# The same bits.


@pytest.fixture(scope="module", params=["loaded", "other"])
def custom(request, tmp_path_factory):
    """A custom robot: its specification, its file, and the library of the export that was compiled for it."""
    spec, folder = ROBOTS[request.param], tmp_path_factory.mktemp(request.param) / "onboard"
    write_files(export_files(golden=False, presets=EVERY, fragile=True, robot=spec, name="own"), folder)
    library = load(compile_(folder, folder.parent / "library.so", "-O1", "-fPIC", "-shared"))
    return spec, (folder / "parameters" / "own.txt").read_bytes(), library


def test_the_nominal_file_is_the_compiled_numbers(library, folder):
    data = (folder / "parameters" / "spidar.txt").read_bytes()
    assert from_file(library, data).tobytes() == compiled(library).tobytes()


def test_a_custom_robots_file_is_what_is_compiled_for_it(library, custom):
    spec, data, own = custom
    found = from_file(library, data)
    assert found.tobytes() == compiled(own).tobytes()
    assert found["robot"].tobytes() == robot_record(spec).tobytes()
    assert found["robot"].tobytes() != robot_record().tobytes()


def test_with_its_file_a_custom_robot_is_driven_as_by_its_own_export(library, custom, hover, crawl, course):
    """The inputs are those of the nominal robot: the states of both runs are the same, only the numbers differ."""
    _, data, own = custom
    parameters = from_file(library, data)
    for stream in (hover, crawl, course):
        missions = read_mission(library, stream.text, parameters), read_mission(own, stream.text)
        assert missions[0].tobytes() == missions[1].tobytes()
        loops = Loop.begin(library, missions[0]), Loop.begin(own, missions[1])
        if isinstance(loops[0], str):  # a move may be out of the reach of other legs
            assert loops[0] == loops[1]
            continue
        answers = [loop.run(stream.inputs) for loop in loops]
        assert answers[0].tobytes() == answers[1].tobytes()
        assert (answers[0]["stage"] == DRIVING).sum() > 40
        nominal = Loop(library, stream.mission).run(stream.inputs)
        assert answers[0]["command"].tobytes() != nominal["command"].tobytes()


@pytest.fixture(scope="module")
def long_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("parameters") / "long.txt"
    path.write_bytes(parameters_text(parameters_record(LONG, ("paper", "steady"))))
    return path


def drive(runner, log, *words, model, inputs, seconds=3.0):
    """Drive a robot that sends these inputs; return answers, exit status and the runner's lines."""
    mission = log.with_suffix(".mission")
    mission.write_text(hover_mission("paper", seconds=seconds).text)
    link, answers = SocketLink(model=model), b""
    words = [runner, "sim", link.place, mission, "--log", log, *words]
    program = subprocess.Popen([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        link.accept()
        for record in inputs:
            link._peer.sendall(record.tobytes())
            if not (part := link._peer.recv(link.answer.dtype.itemsize, 256)):  # MSG_WAITALL
                break
            answers += part
    except ConnectionError:
        pass
    finally:
        link.close()
    _, lines = program.communicate(timeout=20)
    return np.frombuffer(answers, link.answer.dtype), program.returncode, lines


def test_a_run_with_a_file_is_of_its_robot_and_its_log_replays_without_it(library, runner, hover, long_file, tmp_path):
    option, log, inputs = ("--parameters", long_file), tmp_path / "log", hover.inputs[: hover.drives + 40]
    _, status, lines = drive(runner, tmp_path / "none", model=model_hash(LONG), inputs=inputs)
    assert status == 2
    assert lines.startswith(f"runner: the robot's model is {model_hash(LONG)[:12]}; valid: {model_hash()[:12]}")
    answers, status, lines = drive(runner, log, *option, model=model_hash(LONG), inputs=inputs)
    assert status == 0, lines
    mission = read_mission(library, (tmp_path / "log.mission").read_text(), from_file(library, long_file.read_bytes()))
    assert answers.tobytes() == Loop(library, mission).run(inputs).tobytes()
    assert (answers["stage"] == DRIVING).sum() == 40

    done = said(runner, "replay", log, tmp_path / "again")
    assert (done.returncode, done.stdout) == (0, f"{len(inputs)} ticks of a run, 0 with other answers\n"), done.stderr
    assert (tmp_path / "again").read_bytes() == log.read_bytes()
    assert said(runner, "replay", log, tmp_path / "again", *option).returncode == 0
    (tmp_path / "other.txt").write_bytes(STEADY)
    done = said(runner, "replay", log, tmp_path / "again", "--parameters", tmp_path / "other.txt")
    assert done.stderr == (
        "runner: the run had other parameters; valid: no --parameters, as the log of a run has its own\n"
    )
    read = read_runner_log(log)
    assert read.mission["robot"].tobytes() == robot_record(LONG).tobytes()
    assert read.mission["controller"].tobytes() == mission["controller"].tobytes()
    assert (read.model, read.parameters) == (model_hash(LONG), digest_of(long_file.read_bytes()))
    assert read_log(log).properties["parameters"] == hashlib.sha256(long_file.read_bytes()[:-72]).hexdigest()


def outputs_of(stream, count):
    """The first outputs of a recorded run."""
    return np.frombuffer(b"".join(stream.answers[:count]), log_layouts()["loop_output"])


def test_a_log_with_an_impossible_robot_is_refused(hover, checked, tmp_path):
    mission = hover.mission.copy()
    mission["robot"]["tree"]["parent"][3] = 2**30
    hover.write(tmp_path / "log", hover.inputs[:20], outputs_of(hover, 20), mission)
    done = said(checked, "replay", tmp_path / "log", tmp_path / "out")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr[-2000:]
    assert "the log needs what this export lacks" in done.stderr


# Gains and limits.


def test_the_files_preset_has_precedence_and_others_stay(library):
    data = edited(STEADY, rb"(flight.steady.joint_speed rad/s) .*", rb"\1 0.123")
    data = edited(data, rb"(limits.tilt rad) .*", rb"\1 0.456")
    parameters = from_file(library, data)
    mission = read_mission(library, "flight steady", parameters)
    assert (mission["controller"]["joint_speed"], mission["limits"]["tilt"]) == (0.123, 0.456)
    expected = compiled(library)["flights"][EVERY.index("retuned")]["config"]
    assert read_mission(library, "flight retuned", parameters)["controller"].tobytes() == expected.tobytes()
    renamed = from_file(library, edited(STEADY, rb"flight\.steady\.", rb"flight.mine."))
    expected = read_mission(library, "flight steady", from_file(library, STEADY))["controller"]
    assert read_mission(library, "flight mine", renamed)["controller"].tobytes() == expected.tobytes()
    why = read_mission(library, "flight yours", renamed)
    assert why == f"mission, line 1; valid: flight and one of mine, {', '.join(EVERY)}"


def test_the_iteration_cap_is_the_robots(library):
    found = parameters_record(presets=tuple(PRESETS))["flights"]["config"]["allocator"]["max_iter"]
    assert found[: len(PRESETS)].tolist() == [ONBOARD_ITERATIONS] * len(PRESETS)


def test_numbers_beyond_the_runners_range_are_not_written():
    with pytest.raises(InvalidValueError, match=r"limits\.tilt = \[1\.2\] .* expected 1 numbers within 0\.001 … 1"):
        parameters_record(limits=Limits(tilt=1.2))
    with pytest.raises(InvalidValueError, match="at most 16 flight presets"):
        parameters_record(presets=tuple(PRESETS) * 3)
    weak = RobotSpec(max_thrust=25.0)
    assert parameters_record(weak)["robot"]["max_thrust"] == 25.0


# The round trip.


@pytest.mark.parametrize("name", ROBOTS)
def test_python_reads_back_what_it_wrote_and_c_the_same(library, name, tmp_path):
    record = parameters_record(ROBOTS[name], ("steady", "tuned"))
    text = parameters_text(record)
    (tmp_path / "file").write_bytes(text)
    back = read_parameters(tmp_path / "file")
    assert parameters_text(back) == text
    assert from_file(library, text).tobytes() == with_compiled(back, compiled(library)).tobytes()


def test_any_number_is_read_back_bit_for_bit(library):
    """Shortest decimals of random doubles of every exponent, subnormal ones included: `strtod` rounds correctly."""
    rng = np.random.default_rng(3)
    record = parameters_record(presets=("steady",))
    config = record["flights"][0]["config"]
    for _ in range(30):
        for field in fields_of("controller_config"):
            if field.whole or field.least == field.most:
                continue
            exponent = rng.integers(1023 - 1080, 1023 + 16, field.count)
            wild = np.ldexp(rng.integers(2**52, 2**53, field.count).astype(float), exponent - 1023 - 52 - 300)
            field.put(config, np.clip(wild, field.least, field.most).tolist())
        text = parameters_text(record)
        back = parameters_of(text)
        assert back["flights"].tobytes() == record["flights"].tobytes()
        assert from_file(library, text)["flights"][0].tobytes() == record["flights"][0].tobytes()


def test_the_hash_is_sha256(library):
    rng = np.random.default_rng(1)
    for size in (*range(200), 4095, 4096, 100_001):
        data, hexed = rng.bytes(size), ctypes.create_string_buffer(65)
        library.sp_sha256(data, ctypes.c_size_t(size), hexed)
        assert hexed.value.decode() == hashlib.sha256(data).hexdigest()


# Refusals.

EDITED = "the parameters were edited; valid: a file as `spidar parameters` wrote it"
CUT = "the parameters are cut; valid: a whole file, with its sha256 in the last line"
FOREIGN = "no parameters; valid: a file that `spidar parameters` wrote, with spidar_parameters 1 in line 1"
THRUST = "robot.max_thrust N and 1 numbers within 1e-12 … 1e+06"
PRESET = "the first field of a new flight or crawl preset, or the end"
IMPOSSIBLE = "the parameters describe no possible robot; valid: "
REFUSED = {
    "empty": (b"", FOREIGN),
    "foreign": (b"flight paper\n", FOREIGN),
    "another version of the format": (edited(STEADY, rb"parameters 1", rb"parameters 2"), FOREIGN),
    "another interface": (
        edited(STEADY, runner_hash().encode(), b"0" * 32),
        f"the parameters are of another interface; valid: {runner_hash()}, that of this ",
    ),
    "cut": (STEADY[:-200], CUT),
    "cut in the hash": (STEADY[:-1], CUT),
    "edited": (STEADY.replace(b"max_thrust N 42.0", b"max_thrust N 43.0"), EDITED),
    "another hash": (STEADY[:-3] + b"00\n", EDITED),
    "unknown field": (edited(STEADY, rb"robot\.max_thrust N", rb"robot.most_thrust N"), THRUST),
    "missing field": (edited(STEADY, rb"robot\.max_thrust N .*\n", rb""), THRUST),
    "double field": (
        edited(STEADY, rb"(robot\.max_thrust N .*\n)", rb"\1\1"),
        "robot.max_joint_torque Nm and 1 numbers within 1e-12 … 1e+06",
    ),
    "other unit": (edited(STEADY, rb"robot\.max_thrust N", rb"robot.max_thrust kN"), THRUST),
    "too few": (edited(STEADY, rb"(robot\.max_thrust N) .*", rb"\1"), THRUST),
    "too many": (edited(STEADY, rb"(robot\.max_thrust N .*)", rb"\1 1.0"), THRUST),
    **{
        f"{value.decode()} for a number": (edited(STEADY, rb"(robot\.max_thrust N) .*", rb"\1 " + value), THRUST)
        for value in (b"nan", b"inf", b"1e400", b"-1.0", b"1e7", b"0x10", b"4_2", b"42,0", b"many", b"1e")
    },
    "half a tick": (
        edited(STEADY, rb"(limits\.hold_ticks 1) .*", rb"\1 3.5"), "limits.hold_ticks 1 and 1 numbers within 0 … 4"
    ),
    "held too long": (
        edited(STEADY, rb"(limits\.hold_ticks 1) .*", rb"\1 5"), "limits.hold_ticks 1 and 1 numbers within 0 … 4"
    ),
    "unknown word": (
        edited(STEADY, rb"(flight\.steady\.motion word) .*", rb"\1 whole"),
        "flight.steady.motion word and one of complete, quasi_static, observed",
    ),
    "another rate": (
        edited(STEADY, rb"(flight\.steady\.rate_hz Hz) .*", rb"\1 50.0"),
        "flight.steady.rate_hz Hz and 1 numbers within 40 … 40",
    ),
    "double preset": (edited(STEADY, rb"((?:flight\.steady\..*\n)+)", rb"\1\1"), PRESET),
    "preset without a name": (edited(STEADY, rb"flight\.steady\.", rb"flight.."), PRESET),
    "preset with a long name": (edited(STEADY, rb"flight\.steady\.", b"flight." + b"a" * 32 + b"."), PRESET),
    "section that does not exist": (edited(STEADY, rb"flight\.steady\.", rb"swim.steady."), PRESET),
    "half a preset": (
        edited(STEADY, rb"flight\.steady\.lock\.most .*\n(?:.*\n)*", rb""),
        "flight.steady.lock.most rad and 1 numbers within 0 … 6.28319",
    ),
    "no model": (
        edited(STEADY, rb"robot\.model sha256 .*", rb"robot.model sha256 x"), "robot.model sha256 and 64 digits"
    ),
    "long line": (edited(STEADY, rb"(robot\.max_thrust N .*)", rb"\1 #" + b"x" * 1100), THRUST),
    "negative mass": (
        edited(STEADY, rb"(robot\.tree\[4\]\.mass kg) ", rb"\1 -"),
        "robot.tree[4].mass kg and 1 numbers within 1e-09 … 1e+06",
    ),
    "indefinite inertia": (
        edited(STEADY, rb"(robot\.tree\[4\]\.inertia [^ ]+) .*", rb"\1 1.0 2.0 0.0 2.0 1.0 0.0 0.0 0.0 1.0"),
        IMPOSSIBLE + "a symmetric, positive definite inertia of every body",
    ),
    "crooked rotation": (
        edited(STEADY, rb"(robot\.tree\[3\]\.rotation 1) .*", rb"\1 1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 -1.0"),
        IMPOSSIBLE + "attitudes of joints that are rotations",
    ),
    "short axis": (
        edited(STEADY, rb"(robot\.tree\[3\]\.axis 1) .*", rb"\1 0.5 0.0 0.0"), IMPOSSIBLE + "axes of joints of length 1"
    ),
    "another weight": (
        edited(STEADY, rb"(robot\.weight N) .*", rb"\1 150.0"),
        IMPOSSIBLE + "a weight, and a thrust in a hover, of the bodies' masses",
    ),
    "too weak": (
        edited(STEADY, rb"(robot\.max_thrust N) .*", rb"\1 10.0"),
        IMPOSSIBLE + "a weight below the thrust of its rotors",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_other_files_are_refused_with_what_would_be_valid_in_c_as_in_python(library, what):
    data, valid = REFUSED[what]
    assert data != STEADY
    why = from_file(library, data)
    assert isinstance(why, str)
    assert valid in why
    assert "\n" not in why
    with pytest.raises(BorderError) as error:
        parameters_of(data)
    assert str(error.value).removesuffix("version") == why.removesuffix("runner")


def test_files_are_refused_before_anything_else_in_one_line(runner, tmp_path):
    whole, binary, large, mission = (tmp_path / name for name in ("whole", "binary", "large", "mission"))
    whole.write_bytes(STEADY)
    binary.write_bytes(STEADY[:100] + b"\0" + STEADY[100:])
    large.write_bytes(STEADY + b"#" * 2**20)
    mission.write_text("flight steady\n")
    unread = "no parameters; valid: a text file of at most 1 MiB that `spidar parameters` wrote"
    for words, expected in (
        (("about", "--parameters", tmp_path / "none"), f"{tmp_path / 'none'}: {unread}"),
        (("about", "--parameters", tmp_path), f"{tmp_path}: {unread}"),
        (("about", "--parameters", binary), f"{binary}: {unread}"),
        (("about", "--parameters", large), f"{large}: {unread}"),
        (("sim", "127.0.0.1:1", mission, "--parameters", mission), FOREIGN),
        (("replay", whole, tmp_path / "out", "--parameters", mission), FOREIGN),
        (("bench", whole, "--parameters", mission), FOREIGN),
        (("sim", "127.0.0.1:1", mission, "--parameters", whole), "no simulator there; valid: "),
    ):
        done = said(runner, *words)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), words
        assert done.stderr.startswith(f"runner: {expected}")
    for words in (("about", "--parameters"), ("compare", whole, whole, "--parameters", whole)):
        assert said(runner, *words).stderr.startswith("usage: runner replay IN OUT"), words
    done = said(runner, "about", "--parameters", whole)
    assert done.stdout == f"interface {runner_hash()}\nmodel {model_hash()}\nparameters {digest_of(STEADY)}\n"


def test_the_command_writes_the_file_of_an_export(tmp_path, capfd):
    path = tmp_path / "steady.txt"
    main(["parameters", "--out", str(path), "--presets", "steady"])
    assert path.read_bytes() == STEADY
    assert capfd.readouterr().out == f"{path}: parameters {digest_of(STEADY)} of the robot {model_hash()}\n"
    with pytest.raises(SystemExit):
        main(["parameters", "--out", str(tmp_path / "no.txt"), "--presets", "retuned"])
    assert "margin" in capfd.readouterr().err
    assert not (tmp_path / "no.txt").exists()


def test_what_a_search_has_found_is_a_preset_of_the_file(tmp_path):
    path = tmp_path / "own.txt"
    log = Path(__file__).resolve().parents[2] / "baselines" / "searches" / "steady.json"
    main(["parameters", "--out", str(path), "--presets", "steady", "--tuned", str(log), "--fragile"])
    lines = path.read_text(encoding="utf-8").splitlines()
    own = {line.replace("tuned_here", "steady") for line in lines if "tuned_here" in line}
    assert own == {line for line in lines if "steady" in line and "steady_crawl" not in line}
    assert len(own) > 20
    parameters_of(path.read_bytes())


# The table.


def test_every_number_has_a_unit_or_is_known_to_have_none():
    """A unit that the table does not know would be taken for none."""
    for struct in (*SECTIONS.values(), *fields.PRESETS.values()):
        for row in fields._tables()[struct].rows:
            brackets = fields.re.findall(r"\[([^\[\]]+)\]", row[3])
            unknown = [each for each in brackets if each not in fields.UNITS and each.isascii() and "/" in each]
            assert unknown == [], row


@pytest.mark.parametrize("name", ROBOTS)
def test_python_and_the_runner_take_the_same_structure_of_bodies(name):
    record, nominal = robot_record(ROBOTS[name]), robot_record()
    for struct, member in fields.STRUCTURE:
        ours, theirs = (each if struct == "robot" else each["tree"] for each in (record, nominal))
        assert ours[member].tobytes() == theirs[member].tobytes()
