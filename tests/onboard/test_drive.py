"""Pins whole drives: the runner flies and crawls the simulated robot, replays, and every fault ends as specified."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from support.needs import marked, needs_compiler
from support.networks import made

from spidar_gym.benchmark.track import CRAWL
from spidar_gym.cli.main import main
from spidar_gym.control.locomotion.commands import Land
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.logs.runner_log import read_runner_log
from spidar_gym.native.compiler import compiler
from spidar_gym.native.recipe import FLAGS
from spidar_gym.onboard.build import arguments, build_runner
from spidar_gym.onboard.export import EVERY, EXPORTED, export_files, write_files
from spidar_gym.onboard.parameters import parameters_record, parameters_text
from spidar_gym.onboard.runner_structs import log_layouts
from spidar_gym.paper.flight import PAPER_FLIGHT
from spidar_gym.policies.artifact import write_artifact
from spidar_gym.sitl import course_faults
from spidar_gym.sitl.course_drive import driven_course
from spidar_gym.sitl.course_faults import (
    course_fault_figures,
    course_fault_lines,
    pairs_of,
    phase_mission,
    play_course_faults,
)
from spidar_gym.sitl.faults import course_reaction
from spidar_gym.sitl.missions import course_mission, crawl_mission, flight_mission, hover_mission
from spidar_gym.sitl.play import build_for, fault_figures, faults_of, play
from spidar_gym.sitl.report import fault_table
from spidar_gym.sitl.session import Run
from spidar_gym.tasks.course import SUCCESS_POSITION, SUCCESS_YAW

pytestmark = needs_compiler
cross, ros = marked("cross"), marked("ros")


# Missions over the socket


def command_line(*words):
    """Run the command line in a separate process, without the tests' type checks."""
    code = "import sys; from spidar_gym.cli.main import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "MPLBACKEND": "agg"})


def sitl(*words):
    """Run the command line and return the JSON that it prints."""
    done = command_line(*words)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def runner():
    return build_runner()


def check_flight(ours):
    """Check a flight against the paper's figures."""
    for key in ("rmse_position_m", "rmse_attitude_rad"):
        assert (np.array(ours[key]) < PAPER_FLIGHT[key]).all()
    assert ours["theta_form3_rad"] == pytest.approx([-0.4] * 4, abs=0.02)
    assert ours["phi_form3_rad"] == pytest.approx([0.0] * 4, abs=0.02)
    assert ours["tau2_form3_nm"] == pytest.approx(2.0, abs=0.5)
    assert all(0.1 < sink < 0.5 for sink in ours["sink_m"])
    assert all(t is not None and t < 2.5 for t in ours["recovery_s"])
    assert ours["qp"]["unsolved"] == 0


def check_crawl(ours):
    assert ours["is_success"]
    assert np.abs(ours["final_position_error_m"]).max() < 0.010
    assert abs(ours["yaw_final_rad"]) < 0.02
    assert ours["thrust_fraction_mean"] < 0.5
    assert ours["timeouts"] == ours["qp"]["unsolved"] == 0


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Run the paper's flight and crawl and a course through the runner; return figures and folders with the logs."""
    folders = {kind: tmp_path_factory.mktemp(kind) for kind in ("flight", "crawl", "course")}
    return {k: (sitl("sitl", k, "--link", "socket", "--out", out, "--json")[k], out) for k, out in folders.items()}


def check_course(ours):
    """Check that a course lands softly at its target, with figures in the range of the same courses in process."""
    assert all(ours["within_spread"].values()), ours
    assert ours["touchdown_m_s"] < 0.35
    assert ours["largest_step_n"] <= 5.0 + 1e-9
    assert max(ours["rmse_position_m"]) < 0.02
    assert ours["largest_tilt_rad"] < 0.05
    assert np.abs(ours["landing_error_m"]).max() < 0.02
    assert np.abs(ours["final_error_m"]).max() < 0.02
    assert ours["unsolved"] == 0


@pytest.mark.slow
def test_the_papers_flight_through_the_runner_has_the_figures_of_the_flight_in_process(driven, tmp_path):
    ours, folder = driven["flight"]
    check_flight(ours)
    theirs = sitl("paper", "flight", "--noise", "--no-video", "--json", "--out", tmp_path)["flight"]
    assert (np.array(ours["rmse_position_m"]) < np.array(theirs["rmse_position_m"]) + 0.01).all()
    assert (np.array(ours["rmse_attitude_rad"]) < np.array(theirs["rmse_attitude_rad"]) + 0.005).all()
    assert ours["tau2_form3_nm"] == pytest.approx(theirs["tau2_form3_nm"], abs=0.3)
    assert ours["sink_m"] == pytest.approx(theirs["sink_m"], abs=0.08)
    assert {p.name for p in folder.iterdir()} == {"flight.json", "flight.png", "mission.txt", "run.log"}


@pytest.mark.slow
def test_the_papers_crawl_through_the_runner_is_a_success(driven):
    ours, folder = driven["crawl"]
    check_crawl(ours)
    assert {p.name for p in folder.iterdir()} == {"crawl.json", "crawl.png", "mission.txt", "run.log"}
    assert "crawl published" in (folder / "mission.txt").read_text()


@pytest.mark.slow
def test_a_course_through_the_runner_is_among_the_same_courses_in_process(driven):
    ours, folder = driven["course"]
    check_course(ours)
    assert len(ours["in_process"]) == 16
    assert {p.name for p in folder.iterdir()} == {"course.json", "mission.txt", "run.log"}


def check_gates(ours):
    """Check that a course touches no gate, lands softly, and ends within the tolerances of Course-v0."""
    assert ours["largest_hit_n"] == 0.0
    assert ours["touchdown_m_s"] < 0.35
    assert ours["largest_step_n"] <= 5.0 + 1e-9
    assert np.hypot(*ours["final_error_m"]) <= SUCCESS_POSITION
    assert abs(ours["final_yaw_rad"]) <= SUCCESS_YAW
    assert ours["unsolved"] == 0


@pytest.mark.slow
def test_a_course_through_gates_is_driven_by_the_runner_alone(runner, tmp_path):
    words = ("--gates", "1", "--seed", "2", "--robots", "1", "--link", "socket", "--out", tmp_path, "--json")
    check_gates(sitl("sitl", "course", *words)["course_gates"])
    assert {p.name for p in tmp_path.iterdir()} == {"course_gates.json", "mission.txt", "run.log"}
    assert "gate slot" in (tmp_path / "mission.txt").read_text()
    done = subprocess.run(
        [runner, "replay", tmp_path / "run.log", tmp_path / "again"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "again").read_bytes() == (tmp_path / "run.log").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["flight", "crawl", "course"])
def test_a_drive_replays_byte_for_byte(driven, runner, kind, tmp_path):
    log = driven[kind][1] / "run.log"
    done = subprocess.run([runner, "replay", log, tmp_path / "o"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "o").read_bytes() == log.read_bytes()


@cross
@pytest.mark.slow
def test_a_drive_replays_on_the_robots_processor_and_without_optimisation_byte_for_byte(driven, tmp_path):
    folder = tmp_path / "onboard"
    write_files(export_files(golden=False, presets=EVERY, fragile=True), folder)
    words = [*arguments(folder), "-static"]
    builds = {"there": ("aarch64-linux-gnu-gcc", *FLAGS), "plain": (*compiler(), *FLAGS, "-O0")}
    for name, command in builds.items():
        subprocess.run([*command, *words, "-o", tmp_path / name], check=True)
    for _, out in driven.values():
        for command in (["qemu-aarch64", tmp_path / "there"], [tmp_path / "plain"]):
            words = [*command, "replay", out / "run.log", tmp_path / "o"]
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            assert (tmp_path / "o").read_bytes() == (out / "run.log").read_bytes()


def test_the_runner_flies_on_the_robots_own_estimate_too(runner):
    played = play(hover_mission(seconds=2.0, odometry=True), runner=runner)
    outputs, last = played.log.outputs, played.run.rows
    end = played.run.first_driven + 1.9
    row = min(last, key=lambda row: abs(row.time - end))
    tick = np.searchsorted(played.log.inputs["time"], end)
    assert outputs["stage"].max() >= 1
    assert np.linalg.norm(outputs["state"]["position_w"][tick] - row.state.position_w) < 0.02
    assert row.tilt < 0.02
    assert abs(row.state.position_w[2] - 1.0) < 0.1


def answers(path):
    """Return the inputs and outputs of a run's log, without the clock."""
    types, data = log_layouts(), path.read_bytes()
    start = types["log_head"].itemsize + types["mission"].itemsize
    tick, timed = types["loop_input"].itemsize + types["loop_output"].itemsize, types["log_clock"].itemsize
    return [data[at : at + tick] for at in range(start, len(data), tick + timed)]


@pytest.mark.slow
def test_a_run_is_the_same_bytes_every_time_and_with_the_compiled_parameters_in_a_file(tmp_path):
    words = ("sitl", "crawl", "--link", "socket", "--distance", "0.1", "--seed", 3, "--json")
    own = {"a": (), "b": (), "file": ("--parameters", nominal(tmp_path))}
    for name, more in own.items():
        sitl(*words, *more, "--out", tmp_path / name)
    one, *others = (answers(tmp_path / name / "run.log") for name in own)
    assert len(one) > 300
    assert others == [one, one]


def nominal(folder):
    """Write the nominal robot's parameters; return the file."""
    path = folder / "nominal.txt"
    path.write_bytes(parameters_text(parameters_record(presets=EXPORTED)))
    return path


def check_reaction(row):
    assert row["as_specified"], fault_table([row])
    assert row["peak_tilt_rad"] < 0.1
    assert row["touchdown_speed_m_s"] is None or row["touchdown_speed_m_s"] < 1.6
    if row["reaction"] == "lands":
        assert row["landing_after_ms"] <= 700.0


@pytest.mark.slow
def test_every_fault_ends_as_specified(runner, tmp_path):
    rows = sitl("sitl", "faults", "--link", "socket", "--out", tmp_path, "--json")["faults"]
    assert tuple(row["fault"] for row in rows) == faults_of("socket")
    assert (tmp_path / "faults.json").is_file()
    for row in rows:
        check_reaction(row)


@pytest.mark.slow
def test_faults_in_phases_of_a_course_end_as_specified(runner, tmp_path):
    """Some of the pairs; `spidar sitl faults --course` runs all faults in every phase."""
    names, phases = ("pose_stops", "low_battery", "killed", "stall"), ("crawl", "climb", "unload")
    words = ("--link", "socket", "--only", *names, "--phases", *phases, "--out", tmp_path, "--json")
    rows = sitl("sitl", "faults", *words)["course_faults"]
    assert {(row["fault"], row["phase"]) for row in rows} == {(n, p) for n in names for p in phases}
    for row in rows:
        assert row["as_specified"], row
        assert row["peak_tilt_rad"] < 0.2


def test_a_sample_of_faults_and_phases_has_every_fault_and_a_larger_one_begins_with_it():
    faults, phases = ("none", "stall", "killed", "lossy"), ("lie", "fly", "unload")
    one, two, all_ = (pairs_of(faults, phases, sample) for sample in (1, 2, 0))
    assert one == [("none", "lie"), ("stall", "fly"), ("killed", "unload"), ("lossy", "lie")]
    assert two[:4] == one
    assert len(set(two)) == 8
    assert set(all_) == set(pairs_of(faults, phases, 9)) == {(f, p) for f in faults for p in phases}


def test_faults_in_phases_resume_after_an_interruption(monkeypatch, tmp_path):
    played = []

    def play_put(put):
        if len(played) == 2 and not stopped:
            stopped.append(put)
            raise KeyboardInterrupt
        played.append((put.fault, put.phase))
        return {
            "fault": put.fault,
            "phase": put.phase,
            "happened": "rests",
            "touchdown_m_s": None,
            "as_specified": True,
        }

    stopped, pairs = [], pairs_of(("pose_stops", "imu_stops"), ("lie", "crawl"))
    play_put.__qualname__ = "play_put"
    monkeypatch.setattr(course_faults, "play_put", play_put)
    with pytest.raises(KeyboardInterrupt):
        play_course_faults("socket", pairs, folder=tmp_path)
    rows = play_course_faults("socket", pairs, folder=tmp_path)
    assert played == pairs
    lines = course_fault_lines(rows)
    assert lines[0][2:] == ["lie", "crawl"]
    assert lines[1][2:] == ["rests", "rests"]


def test_what_is_specified_for_a_course_depends_on_what_is_seen_and_on_the_floor():
    assert course_reaction("pose_stops", "fly") == "forced landing"
    assert course_reaction("pose_stops", "crawl") == course_reaction("low_battery", "spool") == "rests"
    assert course_reaction("low_battery", "fly") == course_reaction("state_stops", "climb") == "lands"
    assert course_reaction("killed", "lie") == "board lands"
    assert course_reaction("contended", "lie") == "forced landing"
    assert course_reaction("lossy", "unload") == "goes on"


def test_a_wrong_report_of_a_course_would_be_noticed(runner):
    played = play(phase_mission("spool"), fault="low_battery", phase="spool", runner=runner)
    assert course_fault_figures("low_battery", "spool", played.run, played.log)["as_specified"]
    assert not course_fault_figures("none", "spool", played.run, played.log)["as_specified"]
    assert not course_fault_figures("low_battery", "climb", played.run, played.log)["as_specified"]
    with pytest.raises(SpidarError, match="stall never began: fly did not come"):
        course_fault_figures("stall", "fly", Run(), played.log)
    with pytest.raises(SpidarError, match="the course ended"):
        driven_course(played.run, played.log)


def test_a_wrong_report_would_be_noticed(runner):
    played = play(hover_mission(seconds=60.0), fault="none", runner=runner)
    assert fault_figures("none", played.run, played.log)["as_specified"]
    assert not fault_figures("pose_stops", played.run, played.log)["as_specified"]
    for name, value in (("thrust", 50.0), ("joint_position", 2.0), ("thrust", np.nan)):
        log = replace(played.log, outputs=played.log.outputs.copy())
        log.outputs["command"][name][-5] = value
        assert not fault_figures("none", played.run, log)["as_specified"]


def test_bad_words_are_refused(tmp_path, capfd):
    with pytest.raises(UnknownNameError, match="ros, socket"):
        play(hover_mission(), "carrier pigeon")
    with pytest.raises(UnknownNameError, match="pose_stops"):
        play(hover_mission(), fault="gremlins")
    with pytest.raises(UnknownNameError, match="descend"):
        play(hover_mission(), fault="none", phase="nap")
    with pytest.raises(UnknownNameError, match="as_flown"):
        play(flight_mission("gentle"))
    with pytest.raises(InvalidValueError, match="TakeOff first"):
        course_mission([Land()])
    with pytest.raises(InvalidValueError):
        crawl_mission(way=replace(crawl_mission().way, x=-50.0, y=1e9))
    (tmp_path / "x").write_bytes(b"nothing")
    with pytest.raises(SpidarError, match="no log of a run"):
        read_runner_log(tmp_path / "x")
    wrong = (
        ["flight", "--link", "x"], ["flight", "--preset", "x"], ["flight", "--seed", "-1"],
        ["crawl", "--distance", "-1"],
        ["faults", "--only", "gremlins"], ["faults", "--link", "socket", "--only", "master"],
        ["faults", "--only", "low_battery"], ["faults", "--phases", "nap"], ["faults", "--sample", "-1"],
        ["faults", "--sample", "1", "--workers", "2"], ["course", "--gates", "-1"], ["course", "--gates", "9"],
        ["course", "--robots", "0"], ["course", "--residual", "net.zip"],
    )  # fmt: skip
    for words in wrong:
        with pytest.raises(SystemExit):
            main(["sitl", *words, "--out", str(tmp_path)])
    assert capfd.readouterr().err.count("valid") + 1 >= len(wrong)


@pytest.mark.slow
def test_a_learned_residual_drives_with_the_runner_and_off_is_as_if_it_were_not_there(driven, tmp_path):
    net = tmp_path / "net.zip"
    write_artifact(made(CRAWL, "residual_gait_force", loud=0.3), net)
    words = ("--link", "socket", "--distance", "0.1", "--residual", net, "--out", tmp_path / "on", "--json")
    assert sitl("sitl", "crawl", *words)["crawl"]["timeouts"] == 0
    action = read_runner_log(tmp_path / "on" / "run.log").outputs["policy_action"][:, :16]
    assert 0.05 < np.abs(action).max() <= 1.0
    assert np.abs(np.diff(action, axis=0)).max() <= 0.25 + 1e-12
    # A mission without a residual gives the same bytes on a runner that has one and on a runner that has none.
    log, again = driven["crawl"][1] / "run.log", tmp_path / "again"
    done = subprocess.run(
        [build_runner(residual=net), "replay", log, again], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert again.read_bytes() == log.read_bytes()
    with pytest.raises(SpidarError, match="no residual for this mission"):
        play(crawl_mission(residual=True), runner=build_runner())


# Through ROS 1, in real time: run alone, because the robot's clock is wall time


def sitl_in_real_time(*words):
    """Return the JSON that the command line prints; skip on machines too slow to run the robot in real time."""
    done = command_line("sitl", *words, "--link", "ros", "--json")
    if "cannot run the robot in real time" in done.stderr:
        pytest.skip(done.stderr.splitlines()[-1])
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


@ros
@pytest.mark.slow
def test_a_course_through_ros_in_real_time(tmp_path):
    """A course uses both gaits and orders, so that messages are sent on every topic; parameters come from a file."""
    ours = sitl_in_real_time("course", "--parameters", nominal(tmp_path), "--out", tmp_path)["course"]
    check_course(ours)
    assert ours["timing"]["wait_median_us"] < 5000.0


@pytest.fixture
def whole(request):
    """Skip without `--whole`: three more minutes in real time, of missions that CI runs over the socket."""
    if not request.config.getoption("--whole"):
        pytest.skip("another minute in real time: --whole")


@ros
@pytest.mark.slow
def test_the_papers_flight_through_ros_in_real_time(whole, tmp_path):
    ours = sitl_in_real_time("flight", "--out", tmp_path)["flight"]
    check_flight(ours)
    assert ours["timing"]["wait_median_us"] < 5000.0


@ros
@pytest.mark.slow
def test_the_papers_crawl_through_ros_in_real_time(whole, tmp_path):
    check_crawl(sitl_in_real_time("crawl", "--out", tmp_path)["crawl"])


@ros
@pytest.mark.slow
def test_a_course_through_gates_through_ros_in_real_time(whole, tmp_path):
    words = ("course", "--gates", "1", "--seed", "2", "--robots", "1", "--out", tmp_path)
    check_gates(sitl_in_real_time(*words)["course_gates"])


@ros
@pytest.mark.slow
def test_faults_of_processes_and_network_through_ros(tmp_path):
    names = ("master", "killed", "stall", "lossy")
    rows = sitl_in_real_time("faults", "--only", *names, "--out", tmp_path)["faults"]
    assert [row["fault"] for row in rows] == list(names)
    for row in rows:
        check_reaction(row)


def serve(*words, seconds):
    """Start `spidar sitl robot` in a separate process for a time [s]; return it and its first line."""
    code = "import sys; from spidar_gym.cli.main import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", code, "sitl", "robot", "--operate", "--seconds", str(seconds), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    return process, process.stdout.readline()


def written(mission, tmp_path):
    path = tmp_path / "mission.txt"
    path.write_text(mission.text)
    return path


@pytest.mark.slow
def test_a_robot_that_runs_alone_is_flown_by_a_runner_that_is_started_separately(runner, tmp_path):
    process, first = serve("--link", "socket", seconds=11)
    command = [runner, "sim", first.split()[2], written(hover_mission(), tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    said = process.communicate()[0]
    assert done.returncode == 0
    assert "driving" in done.stderr
    states = [line.split()[2].rstrip(",") for line in said.splitlines()]
    assert states == ["ARM_OFF", "ARM_ON", "TAKEOFF", "HOVER"]
    assert process.returncode == 0


@ros
@pytest.mark.slow
def test_a_dry_run_receives_the_robots_messages_and_commands_nothing(tmp_path):
    program = build_for("ros")
    process, first = serve("--link", "ros", seconds=20)
    where = dict(word.split("=") for word in first.split()[:2])
    command = [program, "ros1", written(hover_mission(), tmp_path), "--out", "/spidar_dry"]
    # A runner that has missed the robot waits for the next one.
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **where}, timeout=60)
    said = process.communicate()[0]
    assert "driving" in done.stderr
    # The robot's messages stop at the end; the runner's reaction stays under the other namespace.
    assert "forcing the landing" in done.stderr
    assert "HOVER" in said
    assert "FORCE_LANDING" not in said
