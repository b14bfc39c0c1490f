"""The simulated robot alone, in real time, for a runner that somebody else starts."""

import math
import time as clock
from collections.abc import Callable
from typing import Any

from spidar_gym.errors import SpidarError
from spidar_gym.onboard.runner_structs import FlightState
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.messages import Message
from spidar_gym.sitl.robot import TICK, Robot
from spidar_gym.sitl.session import bring_up


class Served:
    """A robot that runs by the wall clock."""

    def __init__(self, robot: Robot, *, operate: bool, tell: Callable[[str], object]) -> None:
        """Take it as it lies there.

        Args:
            robot: It.
            operate: Whether it arms and takes off by itself; otherwise the operator's topics do.
            tell: Called with a line at every change of its state.
        """
        self.robot, self._operate, self._tell = robot, operate, tell
        self._start, self._state = clock.monotonic(), -1

    def step(self) -> list[Message]:
        """5 ms, no earlier than they are due; what is published in them."""
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
    """Run behind the robot's topics for so long [s]."""
    link.appear(served.robot.time)
    while served.robot.time < seconds:
        for message in link.heard():
            served.robot.receive(message)
        for message in served.step():
            link.publish(message)


def serve_socket(make: Callable[[], Served], link: SocketLink, seconds: float, tell: Callable[[str], object]) -> None:
    """Run behind a socket: a robot for every runner, one after the other.

    Args:
        make: Makes a robot.
        link: Where the runners come.
        seconds: How long it runs since the first has come [s].
        tell: Called with a line when a runner has gone.
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
            return  # the time is over, and nobody has come
        seconds -= clock.monotonic() - start


def _serve_runner(served: Served, link: SocketLink, seconds: float, tell: Callable[[str], object]) -> None:
    """For so long [s]; once its runner has gone, until the robot is disarmed or another runner has come."""
    robot, there, answers = served.robot, True, []
    while robot.time < seconds and (there or (robot.stack.state != FlightState.ARM_OFF and not link.awaited)):
        for message in answers:
            robot.receive(message)
        answers = []
        for message in served.step():
            link.publish(message)
        if robot.plant.diverged:
            tell(f"{robot.time:8.2f} s  the simulated robot's state is no number; it is taken away")
            link.dismiss("its robot is no more")
            return
        if there and robot.steps % TICK == 0:
            heard = link.tick(robot.time)
            there, answers = heard is not None, heard or []
            if not there:
                tell(f"{robot.time:8.2f} s  the runner has gone: {link.parting}")
