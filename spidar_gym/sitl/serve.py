"""The simulated robot alone, in real time, for a runner that is started separately."""

import math
import time as clock
from collections.abc import Callable
from typing import Any

from spidar_gym.errors import SpidarError
from spidar_gym.onboard.messages import Message
from spidar_gym.onboard.runner_structs import FlightState
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.robot import TICK, Robot
from spidar_gym.sitl.session import bring_up


class Served:
    """A robot that is simulated in real time."""

    def __init__(self, robot: Robot, *, operate: bool, tell: Callable[[str], object]) -> None:
        """Serve a robot in its present state.

        Args:
            robot: The robot.
            operate: Whether the robot is armed and takes off automatically; otherwise on the operator's topics.
            tell: Called with a line of text at every change of the flight state.
        """
        self.robot, self._operate, self._tell = robot, operate, tell
        self._start, self._state = clock.monotonic(), -1

    def step(self) -> list[Message]:
        """Simulate 5 ms, wait until they are due, and return the messages published in them."""
        robot = self.robot
        if self._operate:
            bring_up(robot)
        messages = robot.step()
        if robot.flight_state != self._state:
            self._state = robot.flight_state
            why = f", {robot.board.reason}" if robot.board.landing else ""
            height = robot.state.position_w[2]
            self._tell(f"{robot.time:8.2f} s  {FlightState(self._state).name}{why}, torso at {height:.2f} m")
        clock.sleep(max(0.0, self._start + robot.time - clock.monotonic()))
        return messages


def serve_ros(served: Served, link: Any, seconds: float) -> None:  # noqa: ANN401 - a RosLink, whose module needs ROS
    """Run the robot behind its ROS topics for a time [s]."""
    link.appear(served.robot.time)
    while served.robot.time < seconds:
        for message in link.heard():
            served.robot.receive(message)
        for message in served.step():
            link.publish(message)


def serve_socket(make: Callable[[], Served], link: SocketLink, seconds: float, tell: Callable[[str], object]) -> None:
    """Run robots behind a socket: a new one for every runner, one after the other.

    Args:
        make: Builds a robot.
        link: Link to which the runners connect.
        seconds: Duration from the first connection on [s].
        tell: Called with a line of text when a runner is disconnected.
    """
    link.accept(patience=math.inf)
    while seconds > 0.0:
        served = make()
        _serve_runner(served, link, seconds, tell)
        seconds -= served.robot.time
        start = clock.monotonic()
        try:
            link.accept(patience=seconds)
        except SpidarError:
            return  # no runner has connected within the time
        seconds -= clock.monotonic() - start


def _serve_runner(served: Served, link: SocketLink, seconds: float, tell: Callable[[str], object]) -> None:
    """Run a robot for a time [s]; once its runner has disconnected, until the robot is disarmed or a runner waits."""
    robot, there, answers = served.robot, True, []
    while robot.time < seconds and (there or (robot.stack.state != FlightState.ARM_OFF and not link.awaited)):
        for message in answers:
            robot.receive(message)
        answers = []
        for message in served.step():
            link.publish(message)
        if robot.plant.diverged:
            tell(f"{robot.time:8.2f} s  the simulated robot's state is not finite; the robot is removed")
            link.dismiss("the simulation of its robot failed")
            return
        if there and robot.steps % TICK == 0:
            heard = link.tick(robot.time)
            there, answers = heard is not None, heard or []
            if not there:
                tell(f"{robot.time:8.2f} s  the runner has gone: {link.parting}")
