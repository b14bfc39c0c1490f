"""One run of the runner against the simulated robot: operator, links, faults, and what really happened."""

import os
import signal
import subprocess
import threading
import time as clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.errors import SpidarError
from spidar_gym.onboard.runner_structs import FlightState, Stage
from spidar_gym.sim.ground import Touch
from spidar_gym.sitl.faults import LONG_STALL, STALL, Injector
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.messages import ORDERS, Message
from spidar_gym.sitl.missions import Mission
from spidar_gym.sitl.robot import DT, TICK, Robot
from spidar_gym.state import RobotState

START, TAKEOFF = 0.5, 1.0
"""When the operator arms, and has it take off [s]."""
PATIENCE = 30.0
"""How long the robot may take to take off and to land, besides the mission [s]."""
GIVE_BACK = 0.5
"""How long the robot stands disarmed before the session ends: the runner notices [s]."""
AFTER_FAULT = 6.0
"""How long is watched after a fault [s]."""
LANDED = 2.0
"""How long is watched after a forced landing has touched the floor [s]."""
OUTER = 2
"""Module whose rotor dies, the outer one of leg 1."""
LATE = 0.06
"""A robot in real time that was later than this [s] was not one: its run ends there."""


@dataclass(frozen=True)
class Row:
    """What is true at the end of a tick of the robot."""

    time: float
    """Robot's clock [s]."""
    flight_state: int
    """As reported."""
    state: RobotState
    """The true one."""
    tilt: float
    """Roll or pitch, the larger [rad]."""
    power: float
    """Electrical [W]."""
    energy_wh: float
    """Since the start [Wh]."""
    air_force: np.ndarray
    """World [N]."""
    qpos: np.ndarray
    """For pictures."""
    in_contact: bool
    """Whether anything touches the floor."""
    touch: Touch | None
    """What touches it, where the runner begins on the floor."""
    contacts: np.ndarray
    """Contact points and forces, (k, 6) [m, N], likewise."""
    hit: float
    """Largest force in this tick on anything but feet and pegs, where there are gates [N]."""


@dataclass
class Run:
    """What a session leaves behind."""

    rows: list[Row] = field(default_factory=list)
    """The truth, 40 a second."""
    first_driven: float = np.inf
    """When the runner commanded first, robot's clock [s]."""
    board: str = ""
    """Why the board landed; empty where it did not."""
    landing_at: float = np.inf
    """When the landing was forced [s]."""
    fault_at: float = np.inf
    """When the fault began [s]."""
    status: int | None = None
    """The runner's exit status; None where it was killed."""
    words: list[str] = field(default_factory=list)
    """What the runner said."""
    late: float = 0.0
    """How late the simulated robot itself was at worst, while the runner drove or waited [s]."""


STAGES = {
    "waiting": Stage.WAITING, "driving": Stage.DRIVING, "holding": Stage.HOLDING, "released": Stage.RELEASED,
    "forcing the landing": Stage.LANDING, "ending the course": Stage.ENDING, "resting": Stage.RESTING,
}  # fmt: skip
"""What the runner says of the stages."""


class Runner:
    """The runner's process; its words are read as they come."""

    def __init__(self, command: list[str], environment: dict[str, str] | None = None) -> None:
        """Start it."""
        self.words: list[str] = []
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, **(environment or {})},
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.words.append(line.rstrip())

    def said(self, words: str) -> bool:
        """Whether it has said these words."""
        return any(words in line for line in self.words)

    def last_of(self, words: Iterable[str], default: str) -> str:
        """Which of these words it has said last, as a line's first behind the time."""
        known = set(words)
        for line in reversed(self.words):
            found = line.partition(" s: ")[2].partition(",")[0]
            if found in known:
                return found
        return default

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    def signal(self, number: int) -> None:
        """Send a signal, if it still runs."""
        if self.alive:
            self._process.send_signal(number)

    def finish(self, patience: float = 5.0) -> int | None:
        """Wait for its end; its exit status, None where it had to be killed."""
        try:
            status = self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.send_signal(signal.SIGCONT)
            self._process.kill()
            self._process.wait()
            status = None
        self._reader.join(1.0)
        assert self._process.stdout is not None
        self._process.stdout.close()
        return status if status is None or status >= 0 else None


def bring_up(robot: Robot) -> None:
    """What the operator does at the beginning: arm, and have it take off, which on the ground does nothing."""
    for word, due in (("start", START), ("takeoff", TAKEOFF)):
        if abs(robot.time - due) < 0.5 * DT:
            robot.receive(Message(f"teleop_command/{word}", robot.time))


class Session:
    """A robot, its operator, a fault perhaps, and the rows of what happened."""

    def __init__(
        self, robot: Robot, mission: Mission, injector: Injector | None, on_tick: Callable[[], object] = lambda: None
    ) -> None:
        """Take the robot as it lies there.

        Args:
            robot: It.
            mission: What the runner was told.
            injector: The fault.
            on_tick: Called 40 times a second, for progress.
        """
        self.robot, self.mission, self.injector, self._on_tick = robot, mission, injector, on_tick
        self.run = Run()
        self.phase, self.stage = PHASES[0], Stage.WAITING
        """What the runner says of itself, as far as it has been heard."""
        self._landing_asked = self._touched = self._rested = np.inf
        self._hit = 0.0
        self._orders = list(mission.orders)

    def operate(self, *, finished: bool) -> None:
        """What the operator does now.

        Args:
            finished: Whether the runner says that its mission is over.
        """
        robot, t = self.robot, self.robot.time
        bring_up(robot)
        over = finished or t > self.run.first_driven + self.mission.seconds
        if self.mission.is_course:  # in ARM_ON `land` disarms: only where the robot lies
            over = finished and self.phase == "lie"
        over = over and (self.injector is None or not self.mission.is_course)
        if over and self._landing_asked == np.inf and not robot.board.landing:
            self._landing_asked = t
            robot.receive(Message("teleop_command/land", t))

    def step(self) -> list[Message]:
        """5 ms of the robot; what reaches the runner of what it says."""
        robot, run = self.robot, self.run
        messages = robot.step()
        self._hit = max(self._hit, robot.plant.hit)
        run.first_driven = min(run.first_driven, robot.first_driven)
        fault, driven = self.injector, robot.time > run.first_driven
        if fault is not None and driven and run.fault_at == np.inf and fault.phase in ("", self.phase):
            run.fault_at = fault.start = (robot.time if fault.phase else run.first_driven) + fault.after
        if self.stage == Stage.RESTING:
            self._rested = min(self._rested, robot.time)
        if self._orders and robot.time > run.first_driven + self._orders[0][0]:
            messages.append(Message(ORDERS.name, robot.time, {"data": self._orders.pop(0)[1]}))
        if robot.board.landing and run.landing_at == np.inf:
            run.landing_at, run.board = robot.time, robot.board.reason
        if robot.steps % TICK == 0:
            self._record()
            self._on_tick()
        return messages if self.injector is None else self.injector.apply(messages, robot.time)

    def due(self) -> str:
        """What happens to the processes now."""
        what = "" if self.injector is None else self.injector.due(self.robot.time)
        if what == "rotor":
            self.robot.dead_rotor, what = OUTER, ""
        return what

    def _record(self) -> None:
        robot, plant = self.robot, self.robot.plant
        crawls = self.mission.from_floor
        if plant.in_contact and robot.time > self.run.landing_at:
            self._touched = min(self._touched, robot.time)
        self.run.rows.append(
            Row(
                robot.time, robot.flight_state, robot.state, tilt_of(robot.state),
                plant.power, plant.energy_wh, plant.air_force, plant.data.qpos.copy(), plant.in_contact,
                plant.touch() if crawls else None, plant.contact_forces() if crawls else np.zeros((0, 6)), self._hit,
            )
        )  # fmt: skip
        self._hit = 0.0

    @property
    def over(self) -> bool:
        """Whether there is nothing more to see."""
        robot, run, t = self.robot, self.run, self.robot.time
        if robot.plant.diverged:
            raise SpidarError(f"the simulated robot's state is no number after {t:.2f} s")
        if robot.stack.state == FlightState.ARM_OFF and t > START + 1.0:
            return t > robot.stack.since + GIVE_BACK
        if t > min(run.first_driven, PATIENCE) + self.mission.seconds + PATIENCE:
            return True
        if self.stage in (Stage.ENDING, Stage.RESTING) and run.landing_at == np.inf:  # it brings the robot to rest
            return t > self._rested + LANDED
        if run.landing_at == np.inf and t > run.fault_at + AFTER_FAULT:
            return True
        return run.landing_at < np.inf and t > self._touched + LANDED


def tilt_of(state: RobotState) -> float:
    """Angle between the torso's axis and the vertical [rad]."""
    _, x, y, _ = state.quat_wb
    return float(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))


def socket_session(
    session: Session, runner_path: Path, mission_path: Path, log: Path, *, link: SocketLink | None = None
) -> Run:  # fmt: skip
    """Run over the socket, in lock-step, as fast as it goes; a stalled runner is one that is not asked."""
    link = link or SocketLink()
    command = [str(runner_path), "sim", link.place, str(mission_path), "--log", str(log)]
    runner = Runner(command)
    robot, asleep, answers = session.robot, 0.0, []
    try:
        try:
            link.accept(lambda: runner.alive)
        except SpidarError as error:
            runner.finish()
            raise SpidarError(f"the runner refused: {' '.join(runner.words[-1:]) or error}") from error
        while not session.over:
            session.operate(finished=bool(link.answer["finished"]))
            for message in answers:
                robot.receive(message)
            answers = []
            for message in session.step():
                link.publish(message)
            what = session.due()
            if what == "kill":
                runner.signal(signal.SIGKILL)
            elif what:
                asleep = robot.time + (LONG_STALL if what == "long_stall" else STALL)
            if robot.steps % TICK == 0 and robot.time >= asleep - 1e-9:
                answers = link.tick(robot.time) or []
                session.phase = PHASES[link.answer["manager_phase"]]
                session.stage = Stage(link.answer["stage"])
    finally:
        link.close()
        session.run.status = runner.finish()
        session.run.words = runner.words
    return session.run


def ros_session(
    session: Session,
    runner_path: Path,
    mission_path: Path,
    log: Path,
    link: Any,  # noqa: ANN401 - a RosLink, whose module needs ROS
) -> Run:
    """Run through ROS 1 in real time: two clocks, two processes and whatever the machine does in between."""
    command = [str(runner_path), "ros1", str(mission_path), "--log", str(log)]
    robot, wake = session.robot, np.inf
    link.appear(robot.time)
    start = clock.monotonic() - robot.time
    runner = Runner(command, link.environment())
    try:
        while not session.over:
            session.operate(finished=runner.said("the mission is over"))
            for message in link.heard():
                robot.receive(message)
            for message in session.step():
                link.publish(message)
            what = session.due()
            if what == "kill":
                runner.signal(signal.SIGKILL)
            elif what == "master":
                link.kill_master()
            elif what:
                runner.signal(signal.SIGSTOP)
                wake = robot.time + (LONG_STALL if what == "long_stall" else STALL)
            if robot.time >= wake:
                runner.signal(signal.SIGCONT)
                wake = np.inf
            session.phase = runner.last_of(PHASES, PHASES[0])
            session.stage = STAGES[runner.last_of(STAGES, "waiting")]
            if not runner.alive and session.run.first_driven == np.inf:
                raise SpidarError(f"the runner refused: {' '.join(runner.words[-1:])}")
            ahead = start + robot.time - clock.monotonic()
            session.run.late = max(session.run.late, -ahead)
            if session.run.late > LATE:
                break
            clock.sleep(max(0.0, ahead))
    finally:
        runner.signal(signal.SIGCONT)
        runner.signal(signal.SIGTERM)
        session.run.status = runner.finish()
        session.run.words = runner.words
        link.close()
    return session.run
