"""Pins software in the loop: the runner flies and crawls the simulated robot, and every fault ends as specified."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from needs import marked
from test_residual import made

from spidar_gym.benchmark.artifact import write_artifact
from spidar_gym.cli import main
from spidar_gym.control.estimator import Estimator
from spidar_gym.deploy.export import FLAGS, compiler, export_files, write_files
from spidar_gym.deploy.runner import FOLDERS, INCLUDES, build_runner
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.experiments import PAPER_FLIGHT
from spidar_gym.robot import JOINT_NAMES, N_ROTORS, ROBOT
from spidar_gym.sitl.board import COMMAND_TIMEOUT, LANDING_RATE, LANDING_THRUST, Board
from spidar_gym.sitl.messages import FEEDBACK, Message
from spidar_gym.sitl.missions import crawl_mission, flight_mission, hover_mission
from spidar_gym.sitl.play import build_for, fault_figures, faults_of, make_robot, play
from spidar_gym.sitl.report import fault_table, read_runner_log
from spidar_gym.sitl.robot import Robot
from spidar_gym.sitl.stack import LANDING_FORM, State

pytestmark = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")
cross, ros = marked("cross"), marked("ros")
LEVEL, STILL = np.eye(3), np.zeros(3)


# The board


def board_at(thrust=20.0, time=0.0):
    board = Board()
    assert board.configure(0)
    board.command(np.full(N_ROTORS, thrust), time)
    return board


def tilted(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


TORQUES = np.vstack([np.tile([1.0, -1.0], 4), np.tile([1.0, 1.0, -1.0, -1.0], 2), np.repeat([0.1, -0.1], 4)])


def test_a_board_that_is_not_armed_turns_no_rotor():
    board = Board()
    board.command(np.full(N_ROTORS, 20.0), 0.0)
    assert (board.tick(0.0, 0.005, LEVEL, STILL, TORQUES) == 0.0).all()
    assert not board.configure(77)
    board = board_at()
    assert (board.tick(0.0, 0.005, LEVEL, STILL, TORQUES) == 20.0).all()
    board.configure(1)
    assert (board.tick(0.0, 0.005, LEVEL, STILL, TORQUES) == 0.0).all()


@pytest.mark.parametrize(
    ("thrust", "kept"), [(np.full(7, 10.0), 20.0), (np.full(8, np.nan), 20.0), (np.full(8, 10.0), 10.0)]
)
def test_commands_of_the_wrong_length_or_that_are_no_numbers_are_ignored(thrust, kept):
    board = board_at()
    board.command(thrust, 0.1)
    assert (board.base == kept).all()


def test_silence_a_tilt_and_a_command_force_the_landing_and_disarming_ends_it():
    silent, tipped, told = board_at(), board_at(), board_at()
    silent.tick(COMMAND_TIMEOUT, 0.005, LEVEL, STILL, TORQUES)
    assert not silent.landing
    silent.tick(COMMAND_TIMEOUT + 0.005, 0.005, LEVEL, STILL, TORQUES)
    assert (silent.landing, silent.reason) == (True, "no command for 0.5 s")
    tipped.tick(0.0, 0.005, tilted(0.99), STILL, TORQUES)
    assert not tipped.landing
    tipped.tick(0.0, 0.005, tilted(-1.01), STILL, TORQUES)
    assert tipped.landing
    told.configure(2)
    assert told.landing
    told.configure(1)
    assert not told.landing
    assert not told.armed


def test_a_forced_landing_shrinks_the_thrusts_in_proportion_at_the_boards_rate_down_to_its_floor():
    board = board_at()
    board.command(np.linspace(16.0, 24.0, N_ROTORS), 0.0)
    board.configure(2)
    for k in range(400):
        board.tick(0.005 * k, 0.005, LEVEL, STILL, TORQUES)
    assert board.base.mean() == pytest.approx(20.0 - 2.0 * LANDING_RATE, abs=1e-9)
    assert board.base / board.base.mean() == pytest.approx(np.linspace(0.8, 1.2, N_ROTORS), abs=1e-12)
    for k in range(4000):
        board.tick(2.0 + 0.005 * k, 0.005, LEVEL, STILL, TORQUES)
    assert board.base.mean() == pytest.approx(LANDING_THRUST, abs=1e-9)
    board.command(np.full(N_ROTORS, LANDING_THRUST - 1.0), 30.0)
    assert board.base.mean() == pytest.approx(LANDING_THRUST, abs=1e-9)


def test_in_a_forced_landing_the_board_turns_the_robot_back_and_stays_within_the_rotors():
    board = board_at()
    board.configure(2)
    for angle in (0.2, -0.4):
        thrust = board.tick(0.0, 0.005, tilted(angle), STILL, TORQUES)
        assert (TORQUES @ thrust)[0] * angle < 0.0
        assert thrust.min() >= 0.0
        assert thrust.max() <= ROBOT.max_thrust + 1e-9


# The robot


def run_robot(robot, seconds, each=lambda robot: None):
    said = []
    for _ in range(round(seconds / 0.005)):
        said += robot.step()
        each(robot)
    return said


def teleop(robot, word):
    robot.hear(Message(f"teleop_command/{word}", robot.time))


def test_every_topic_comes_at_its_rate_and_stamps_go_forward():
    said = run_robot(Robot(), 4.0)
    for topic in FEEDBACK:
        stamps = [message.stamp for message in said if message.topic == topic.name]
        if topic.rate:
            assert len(stamps) / 4.0 == pytest.approx(topic.rate, rel=0.1), topic.name
        assert (np.diff(stamps) > 0.0).all()


def test_the_robot_takes_off_hovers_and_lands_by_itself_and_reports_its_states_in_order():
    robot, states = make_robot(hover_mission()), []

    def watch(robot):
        if not states or states[-1] != robot.flight_state:
            states.append(robot.flight_state)
        if robot.flight_state == State.HOVER and robot.time > robot.stack.since + 2.0 and State.LAND not in states:
            heights.append(robot.state.position_w[2])
            teleop(robot, "land")

    heights = []
    teleop(robot, "takeoff")  # nothing happens: it is not armed
    run_robot(robot, 0.5, watch)
    assert states == [State.ARM_OFF]
    teleop(robot, "start")
    run_robot(robot, 0.2, watch)
    teleop(robot, "takeoff")
    run_robot(robot, 20.0, watch)
    expected = [State.ARM_OFF, State.START, State.ARM_ON, State.TAKEOFF, State.HOVER, State.LAND, State.HOVER,
                State.LAND, State.STOP, State.ARM_OFF]  # fmt: skip
    assert [s for s in expected if s in states or s in (State.START, State.STOP)] == expected
    assert [s for s in states if s not in (State.START, State.STOP)] == [
        s for s in expected if s not in (State.START, State.STOP)
    ]
    assert heights[0] == pytest.approx(1.0, abs=0.06)
    assert robot.state.position_w[2] == pytest.approx(ROBOT.peg_depth, abs=0.01)
    assert np.abs(robot.state.joint_position - LANDING_FORM).max() < 0.1


def test_the_ground_bring_up_never_takes_off_and_land_disarms_it():
    robot = make_robot(crawl_mission())
    teleop(robot, "start")
    run_robot(robot, 0.2)
    assert robot.flight_state == State.ARM_ON
    teleop(robot, "takeoff")
    run_robot(robot, 1.0)
    assert robot.flight_state == State.ARM_ON
    teleop(robot, "land")
    run_robot(robot, 0.1)
    assert robot.flight_state == State.ARM_OFF


def test_commands_count_only_in_the_state_in_which_a_runner_may_drive():
    robot = make_robot(hover_mission())
    before = robot.joints.copy()
    for state in State:
        if state in (State.HOVER, State.LOW_BATTERY, State.FORCE_LANDING):
            continue
        robot.stack.state = state
        robot.hear(Message("joints_ctrl", 0.0, {"name": JOINT_NAMES, "position": np.full(16, 0.3)}))
        assert (robot.joints == before).all()
    robot.stack.state = State.HOVER
    robot.hear(Message("joints_ctrl", 0.0, {"name": JOINT_NAMES[2:4], "position": np.array([0.1, 9.0])}))
    assert robot.joints[2] == pytest.approx(0.1)
    assert robot.joints[3] == pytest.approx(ROBOT.joint_limit)
    assert (np.delete(robot.joints, [2, 3]) == np.delete(before, [2, 3])).all()
    robot.hear(Message("joints_ctrl", 0.0, {"name": JOINT_NAMES[:3], "position": np.zeros(2)}))
    robot.hear(Message("joints_ctrl", 0.0, {"name": JOINT_NAMES, "position": np.full(16, np.nan)}))
    assert robot.joints[2] == pytest.approx(0.1)


def test_the_robots_odometry_is_that_of_the_cog():
    robot = make_robot(hover_mission())
    teleop(robot, "start")
    run_robot(robot, 0.5)
    teleop(robot, "takeoff")
    said = run_robot(robot, 5.0)
    cog = [m for m in said if m.topic == "uav/cog/odom"][-1]
    data = robot.plant.data
    assert np.linalg.norm(cog.values["position"] - data.subtree_com[1]) < 0.01
    assert isinstance(robot._estimator, Estimator)


# Missions over the socket


def sitl(*words):
    """The command line in a process of its own, without the tests' type checks: what it prints."""
    code = "import sys; from spidar_gym.cli import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", code, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "MPLBACKEND": "agg"})
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def runner():
    return build_runner()


def check_flight(ours):
    """Acceptance: the paper's figures, and those of the same flight in process."""
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


@pytest.mark.slow
def test_the_papers_flight_through_the_runner_has_the_figures_of_the_flight_in_process(runner, tmp_path):
    ours = sitl("sitl", "flight", "--link", "socket", "--out", tmp_path, "--json")["flight"]
    check_flight(ours)
    theirs = sitl("paper", "flight", "--noise", "--no-video", "--json", "--out", tmp_path / "there")["flight"]
    assert (np.array(ours["rmse_position_m"]) < np.array(theirs["rmse_position_m"]) + 0.01).all()
    assert (np.array(ours["rmse_attitude_rad"]) < np.array(theirs["rmse_attitude_rad"]) + 0.005).all()
    assert ours["tau2_form3_nm"] == pytest.approx(theirs["tau2_form3_nm"], abs=0.3)
    assert ours["sink_m"] == pytest.approx(theirs["sink_m"], abs=0.08)
    assert {"flight.json", "flight.png", "mission.txt", "run.log"} <= {p.name for p in tmp_path.iterdir()}
    # The log is the flight: replayed, it gives the same bytes.
    log, again = tmp_path / "run.log", tmp_path / "again.log"
    done = subprocess.run([runner, "replay", log, again], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert again.read_bytes() == log.read_bytes()


@cross
@pytest.mark.slow
def test_a_flight_and_a_crawl_replay_on_the_robots_processor_and_without_optimisation_byte_for_byte(runner, tmp_path):
    folder = tmp_path / "onboard"
    write_files(export_files(golden=False), folder)
    sources = [str(p) for part in FOLDERS for p in sorted((folder / part).glob("*.c"))]
    words = [*(f"-I{folder / part}" for part in INCLUDES), *sources, "-lm", "-static"]
    builds = {"there": ("aarch64-linux-gnu-gcc", *FLAGS), "plain": (compiler(), *FLAGS, "-O0")}
    for name, command in builds.items():
        subprocess.run([*command, *words, "-o", tmp_path / name], check=True)
    sitl("sitl", "flight", "--link", "socket", "--out", tmp_path / "flight", "--json", "--preset", "tuned")
    sitl("sitl", "crawl", "--link", "socket", "--out", tmp_path / "crawl", "--json", "--distance", "0.2")
    for kind in ("flight", "crawl"):
        log = tmp_path / kind / "run.log"
        for command in (["qemu-aarch64", tmp_path / "there"], [tmp_path / "plain"]):
            done = subprocess.run(
                [*command, "replay", log, tmp_path / "o"], capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stderr
            assert (tmp_path / "o").read_bytes() == log.read_bytes()


@pytest.mark.slow
def test_the_papers_crawl_through_the_runner_is_a_success(runner, tmp_path):
    check_crawl(sitl("sitl", "crawl", "--link", "socket", "--out", tmp_path, "--json")["crawl"])
    assert {"crawl.json", "crawl.png", "mission.txt", "run.log"} <= {p.name for p in tmp_path.iterdir()}
    assert "crawl published" in (tmp_path / "mission.txt").read_text()


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


def test_a_run_is_the_same_bytes_every_time(runner, tmp_path):
    for name in ("a", "b"):
        play(hover_mission(seconds=0.5), seed=3, runner=runner, log=tmp_path / name)
    one, two = (read_runner_log(tmp_path / name) for name in ("a", "b"))
    assert one.outputs.tobytes() == two.outputs.tobytes()


def check_reaction(row):
    assert row["as_specified"], fault_table([row])
    assert row["peak_tilt_rad"] < 0.1
    if row["reaction"] == "lands":
        assert row["landing_after_ms"] <= 700.0


@pytest.mark.slow
def test_every_fault_ends_as_specified(runner, tmp_path):
    rows = sitl("sitl", "faults", "--link", "socket", "--out", tmp_path, "--json")["faults"]
    assert tuple(row["fault"] for row in rows) == faults_of("socket")
    assert (tmp_path / "faults.json").is_file()
    for row in rows:
        check_reaction(row)


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
    with pytest.raises(UnknownNameError, match="as_flown"):
        flight_mission("gentle")
    with pytest.raises(InvalidValueError):
        crawl_mission(way=replace(crawl_mission().way, x=-50.0, y=1e9))
    (tmp_path / "x").write_bytes(b"nothing")
    with pytest.raises(SpidarError, match="no log of a run"):
        read_runner_log(tmp_path / "x")
    wrong = (
        ["flight", "--link", "x"], ["flight", "--preset", "x"], ["flight", "--seed", "-1"],
        ["crawl", "--distance", "-1"],
        ["faults", "--only", "gremlins"], ["faults", "--link", "socket", "--only", "master"],
    )  # fmt: skip
    for words in wrong:
        with pytest.raises(SystemExit):
            main(["sitl", *words, "--out", str(tmp_path)])
    assert capfd.readouterr().err.count("valid") + 1 >= len(wrong)


def test_a_learned_residual_flies_with_the_runner_and_off_is_as_if_it_were_not_there(runner, tmp_path):
    write_artifact(made(loud=0.3), tmp_path / "net.zip")
    with_it = build_runner(residual=tmp_path / "net.zip")
    on, off = hover_mission(seconds=1.5), hover_mission(seconds=1.5)
    on = replace(on, text=on.text.replace("flight as_flown", "flight as_flown\nresidual on"))
    flown = play(on, runner=with_it)
    action = flown.log.outputs["policy_action"][:, :6]
    assert 0.05 < np.abs(action).max() <= 1.0
    assert np.abs(np.diff(action, axis=0)).max() <= 0.25 + 1e-12
    assert flown.run.board == ""
    assert max(row.tilt for row in flown.run.rows) < 0.2
    silent, without = play(off, runner=with_it), play(off, runner=runner)
    assert silent.log.outputs.tobytes() == without.log.outputs.tobytes()
    with pytest.raises(SpidarError, match="no residual for this mission"):
        play(on, runner=runner)


# Through ROS 1, in real time: run alone, for the robot's clock is the wall's


@ros
@pytest.mark.slow
def test_the_papers_flight_through_ros_in_real_time(tmp_path):
    ours = sitl("sitl", "flight", "--link", "ros", "--out", tmp_path, "--json")["flight"]
    check_flight(ours)
    assert ours["timing"]["wait_median_us"] < 5000.0


@ros
@pytest.mark.slow
def test_the_papers_crawl_through_ros_in_real_time(tmp_path):
    check_crawl(sitl("sitl", "crawl", "--link", "ros", "--out", tmp_path, "--json")["crawl"])


@ros
@pytest.mark.slow
def test_faults_of_processes_and_network_through_ros(tmp_path):
    names = ("master", "killed", "stall", "lossy", "pose_stops")
    rows = sitl("sitl", "faults", "--link", "ros", "--only", *names, "--out", tmp_path, "--json")["faults"]
    assert [row["fault"] for row in rows] == list(names)
    for row in rows:
        check_reaction(row)


def serve(*words):
    """`spidar sitl robot` in a process of its own, and what it said first."""
    code = "import sys; from spidar_gym.cli import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", code, "sitl", "robot", "--operate", "--seconds", "11", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    return process, process.stdout.readline()


def written(mission, tmp_path):
    path = tmp_path / "mission.txt"
    path.write_text(mission.text)
    return path


@pytest.mark.slow
def test_a_robot_that_runs_alone_is_flown_by_a_runner_that_somebody_else_starts(runner, tmp_path):
    process, first = serve("--link", "socket")
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
def test_a_dry_run_hears_the_robot_and_commands_nobody(tmp_path):
    program = build_for("ros")
    process, first = serve("--link", "ros")
    where = dict(word.split("=") for word in first.split()[:2])
    command = [program, "ros1", written(hover_mission(), tmp_path), "--out", "/spidar_dry"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **where})
    said = process.communicate()[0]
    assert "driving" in done.stderr
    # The robot falls silent in the end; what the runner does about it stays under the other namespace.
    assert "forcing the landing" in done.stderr
    assert "HOVER" in said
    assert "FORCE_LANDING" not in said
