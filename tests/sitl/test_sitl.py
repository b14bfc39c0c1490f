"""Pins the simulated robot behind the real one's interface: board, flight stack, topics, accepted commands."""

import numpy as np
import pytest
from support.needs import needs_compiler

from spidar_gym.control.estimator import Estimator
from spidar_gym.onboard.messages import FEEDBACK, Message
from spidar_gym.onboard.runner_structs import FlightState as State
from spidar_gym.robot import JOINT_NAMES, N_ROTORS, ROBOT
from spidar_gym.sitl.board import COMMAND_TIMEOUT, LANDING_RATE, LANDING_THRUST, Board
from spidar_gym.sitl.missions import crawl_mission, hover_mission
from spidar_gym.sitl.play import make_robot
from spidar_gym.sitl.robot import Robot
from spidar_gym.sitl.stack import LANDING_FORM

pytestmark = needs_compiler
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


TORQUES = np.vstack([np.tile([1.0, -1.0], 4), np.tile([1.0, 1.0, -1.0, -1.0], 2)])


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
    robot.receive(Message(f"teleop_command/{word}", robot.time))


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
    teleop(robot, "takeoff")  # ignored: the robot is not armed
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
        robot.receive(Message("joints_ctrl", 0.0, {"name": JOINT_NAMES, "position": np.full(16, 0.3)}))
        assert (robot.joints == before).all()
    robot.stack.state = State.HOVER
    robot.receive(Message("joints_ctrl", 0.0, {"name": JOINT_NAMES[2:4], "position": np.array([0.1, 9.0])}))
    assert robot.joints[2] == pytest.approx(0.1)
    assert robot.joints[3] == pytest.approx(ROBOT.joint_limit)
    assert (np.delete(robot.joints, [2, 3]) == np.delete(before, [2, 3])).all()
    robot.receive(Message("joints_ctrl", 0.0, {"name": JOINT_NAMES[:3], "position": np.zeros(2)}))
    robot.receive(Message("joints_ctrl", 0.0, {"name": JOINT_NAMES, "position": np.full(16, np.nan)}))
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
