"""One run of the runner with the simulated robot: operator, links, faults, and the record of the true state."""

import os
import signal
import subprocess
import threading
import time as clock
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.errors import SpidarError
from spidar_gym.onboard.messages import ORDERS, Message
from spidar_gym.onboard.parameters import read_parameters, text_of
from spidar_gym.onboard.runner_structs import STAGES, FlightState, Stage
from spidar_gym.robot.description import model_hash
from spidar_gym.sim.ground import Touch
from spidar_gym.sitl.faults import LONG_STALL, STALL, Injector
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import Mission
from spidar_gym.sitl.robot import DT, TICK, Robot
from spidar_gym.state import RobotState

START, TAKEOFF = 0.5, 1.0
"""Times at which the operator arms the robot and commands the take-off [s]."""
PATIENCE = 30.0
"""Time limit for take-off and landing, in addition to the mission [s]."""
GIVE_BACK = 0.5
"""Time for which the robot stays disarmed before the session ends, so that the runner receives the state [s]."""
AFTER_FAULT = 6.0
"""Time simulated after a fault [s]."""
LANDED = 2.0
"""Time simulated after the touchdown of a forced landing, or after the robot has come to rest [s]."""
OUTER = 2
"""Module whose rotor dies, the outer one of leg 1."""
LATE = 0.06
"""Largest delay of the robot in real time; a run with a larger one is aborted [s]."""


@dataclass(frozen=True)
class Row:
    """True quantities at the end of a tick of the robot."""

    time: float
    """Time by the robot's clock [s]."""
    flight_state: int
    """Flight state as reported."""
    state: RobotState
    """True state."""
    tilt: float
    """Angle between the torso's axis and the vertical [rad]."""
    power: float
    """Electrical power [W]."""
    energy_wh: float
    """Energy since the start [Wh]."""
    air_force: np.ndarray
    """Force of the air, world axes [N]."""
    qpos: np.ndarray
    """MuJoCo's positions, for rendering."""
    in_contact: bool
    """Whether anything touches the floor."""
    touch: Touch | None
    """Contacts with the floor; None where the runner begins in the air."""
    contacts: np.ndarray
    """Contact points and forces, (k, 6) [m, N]; empty where the runner begins in the air."""
    hit: float
    """Largest force in this tick on anything but feet and pegs, where there are gates [N]."""


@dataclass
class Run:
    """Result of a session."""

    rows: list[Row] = field(default_factory=list)
    """True quantities at 40 Hz."""
    first_driven: float = np.inf
    """Time of the runner's first command, robot's clock [s]."""
    board: str = ""
    """Why the board landed; empty where it did not."""
    landing_at: float = np.inf
    """Time at which the landing was forced [s]."""
    fault_at: float = np.inf
    """Time at which the fault began [s]."""
    status: int | None = None
    """The runner's exit status; None where it was killed."""
    words: list[str] = field(default_factory=list)
    """Lines that the runner printed."""
    late: float = 0.0
    """Largest delay of the simulated robot relative to real time [s]."""


class Runner:
    """The runner's process, whose output is read as it is printed."""

    def __init__(self, command: list[str], environment: dict[str, str] | None = None) -> None:
        """Start the process."""
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
        """Return whether the runner has printed these words."""
        return any(words in line for line in self.words)

    def last_of(self, words: Iterable[str], default: str) -> str:
        """Return the last of these words that the runner has printed at the start of a line, after the time."""
        known = set(words)
        for line in reversed(self.words):
            found = line.partition(" s: ")[2].partition(",")[0]
            if found in known:
                return found
        return default

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def signal(self, number: int) -> None:
        """Send a signal if the process still runs."""
        if self.alive:
            self._process.send_signal(number)

    def finish(self, patience: float = 5.0) -> int | None:
        """Wait for the process to end; return its exit status, None where it was killed."""
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
    """Send the operator's initial commands: arm and take off; a robot that starts for the ground ignores the latter."""
    for word, due in (("start", START), ("takeoff", TAKEOFF)):
        if abs(robot.time - due) < 0.5 * DT:
            robot.receive(Message(f"teleop_command/{word}", robot.time))


class Session:
    """A robot, its operator, an optional fault, and the recorded rows."""

    def __init__(
        self, robot: Robot, mission: Mission, injector: Injector | None, on_tick: Callable[[], object] = lambda: None,
        *, silent: Collection[str] = (),
    ) -> None:  # fmt: skip
        """Start a session with a robot in its present state.

        Args:
            robot: The robot.
            mission: Mission of the runner.
            injector: The fault, or None.
            on_tick: Called 40 times per simulated second, for progress.
            silent: Topics that this robot does not publish.
        """
        self.robot, self.mission, self.injector, self._on_tick = robot, mission, injector, on_tick
        self.run, self.silent = Run(), tuple(silent)
        """Result, and topics that this robot does not publish."""
        self.phase, self.stage = PHASES[0], Stage.WAITING
        """Phase and stage that the runner last reported."""
        self._landing_asked = self._touched = self._rested = np.inf
        self._hit = 0.0
        self._orders = list(mission.orders)

    def operate(self, *, finished: bool) -> None:
        """Send the operator's commands that are due.

        Args:
            finished: Whether the runner reports that its mission is over.
        """
        robot, t = self.robot, self.robot.time
        bring_up(robot)
        over = finished or t > self.run.first_driven + self.mission.seconds
        if self.mission.is_course:  # in ARM_ON `land` disarms, so it is sent only while the robot lies
            over = finished and self.phase == "lie"
        over = over and (self.injector is None or not self.mission.is_course)
        if over and self._landing_asked == np.inf and not robot.board.landing:
            self._landing_asked = t
            robot.receive(Message("teleop_command/land", t))

    def step(self) -> list[Message]:
        """Simulate 5 ms of the robot; return the messages that reach the runner."""
        robot, run = self.robot, self.run
        messages = [message for message in robot.step() if message.topic not in self.silent]
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
        """Return the effect on the processes that is due now; a dead rotor is applied here."""
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
        """Whether the session has ended (`SpidarError` where the simulation diverged)."""
        robot, run, t = self.robot, self.run, self.robot.time
        if robot.plant.diverged:
            raise SpidarError(f"the simulated robot's state is not finite after {t:.2f} s")
        if robot.stack.state == FlightState.ARM_OFF and t > START + 1.0:
            return t > robot.stack.since + GIVE_BACK
        if t > min(run.first_driven, PATIENCE) + self.mission.seconds + PATIENCE:
            return True
        ends = Stage.ENDING if self.mission.is_course else Stage.RESTING
        if self.stage in (ends, Stage.RESTING) and run.landing_at == np.inf:  # it brings the robot to rest
            return t > self._rested + LANDED
        if run.landing_at == np.inf and t > run.fault_at + AFTER_FAULT:
            return True
        return run.landing_at < np.inf and t > self._touched + LANDED


def tilt_of(state: RobotState) -> float:
    """Return the angle between the torso's axis and the vertical [rad]."""
    _, x, y, _ = state.quat_wb
    return float(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))


def _reading(parameters: Path | None) -> list[str]:
    """Return the runner's arguments that make it read a parameter file."""
    return [] if parameters is None else ["--parameters", str(parameters)]


def _model_of(parameters: Path | None) -> str:
    """Return the hash of the model that a parameter file describes; that of the nominal robot without a file."""
    return model_hash() if parameters is None else text_of(read_parameters(parameters)["model"])


def socket_session(
    session: Session, runner_path: Path, mission_path: Path, log: Path, *,
    link: SocketLink | None = None, parameters: Path | None = None,
) -> Run:  # fmt: skip
    """Run over the socket in lock-step, as fast as possible; a stalled runner receives no input.

    With `parameters`, a file, the runner reads them, and the robot reports their model's hash.
    """
    link = link or SocketLink(silent=session.silent, model=_model_of(parameters))
    command = [str(runner_path), "sim", link.place, str(mission_path), "--log", str(log)]
    runner = Runner([*command, *_reading(parameters)])
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
    *,
    parameters: Path | None = None,
) -> Run:
    """Run through ROS 1 in real time, with robot and runner in separate processes with separate clocks.

    `parameters` is as for `socket_session`.
    """
    command = [str(runner_path), "ros1", str(mission_path), "--log", str(log), *_reading(parameters)]
    robot, wake = session.robot, np.inf
    link.appear(robot.time, _model_of(parameters))
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
