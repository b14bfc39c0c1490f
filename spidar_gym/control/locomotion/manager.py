"""Manager of gaits and grasp: commands → phases, each executed by flight controller or crawler, with hand-overs.

The robot takes off in its lying attitude and lands in the start pose of a crawl. Both use the allocation of flight: the
floor carries a share of the weight (`Reference.support`), which fades in a take-off and grows in a landing. There is no
touch sensor: the floor is detected when the robot no longer follows its descent.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.crawl.controller import Crawler
from spidar_gym.control.crawl.footsteps import BISECTIONS, Move
from spidar_gym.control.crawl.memory import CrawlRecord
from spidar_gym.control.crawl.pose2 import torso_pose2
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.flight.memory import FlightRecord
from spidar_gym.control.flight.path import EASE, TURN_RATE, Path, ease, from_motion, legs, wrap
from spidar_gym.control.grasp.grip import Grip
from spidar_gym.control.grasp.phases import LEAVING, Grasper, Seen
from spidar_gym.control.locomotion.commands import (
    CarryTo,
    CrawlTo,
    FlyTo,
    Grasp,
    Land,
    LocomotionCommand,
    Place,
    Release,
    TakeOff,
    heading,
)
from spidar_gym.control.locomotion.orders import ManagerConfig, Orders
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import N_ROTORS
from spidar_gym.so3 import exp, log, matrix_to_quat, quat_to_matrix
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState, valid_state

LEVEL_FROM, LEVEL_TO = 0.05, 0.35
"""Heights above the lying position between which a robot from a slope becomes level [m]."""
NEAR_FLOOR = 0.1
"""Height of the reference above the expected floor below which a descent expects a contact [m]."""
ASIDE = 2.0
"""Least distance from an object at which an ended mission lands: legs that lie, and the widest object's corner [m]."""
ENDS_AFTER = 1.0
"""Time for which an ended mission holds an object before it is put down [s]: the torso's error of height, which tells
the floor, is a mean over half a second."""
LEAST_WAY = 0.05
"""A shorter displacement does not define a heading [m]."""
ARRIVED, PATIENCE = 0.05, 2.0
"""A form is taken when every joint is this close [rad], or after this time with the full command [s]."""
_STILL = np.zeros(3)


@dataclass(slots=True)
class ManagerMemory:
    """Complete state of the manager between ticks."""

    phase: str = "lie"
    """One of `PHASES`."""
    time: float = 0.0
    """Time in the phase [s]."""
    begin_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Position of the centre of mass at the beginning of the phase, or its reference in a descent [m]."""
    quat_wb: np.ndarray = field(default_factory=lambda: heading(0.0))
    """Desired attitude at the beginning of the phase."""
    yaw: float = 0.0
    """Heading in flight [rad]."""
    form: JointVector = field(default_factory=lambda: np.zeros(16))
    """Desired joint angles [rad]."""
    floor: float = 0.0
    """Height of the centre of mass when the robot lay last, or is expected to lie [m]."""
    velocity: float = 0.0
    """Rate of the descent [m/s]."""
    believed: float = 0.0
    """Time for which the conditions of a floor have held, or for which a form has been commanded in full [s]."""
    thrust: float = 0.0
    """Σλ of the last tick [N]."""
    failures: int = 0
    """Number of aborted landings in a row."""
    rises: bool = False
    """Whether the robot takes off at the next tick from any phase on the floor."""
    begun: bool = False
    """Whether the present command of a grasp has begun."""
    ends: bool = False
    """Whether the mission was ended: an object that finds no floor is let go of."""


class Manager(Orders):
    """Executes commands to crawl, take off, fly, land and grasp; owns a crawler, a flight controller and a grasper."""

    def __init__(self, config: ManagerConfig | None = None, model: Model | None = None) -> None:
        """Build both controllers."""
        self.config = config or ManagerConfig()
        self.model = model or Model(self.config.crawl.gait.robot)
        self.flight = FlightController(self.config.flight, self.model)
        self.crawler = Crawler(self.config.crawl, self.model)
        self.grasper = Grasper(self.config.grasp, self.model.robot, self.config.flight.joint_speed)
        self.dt = self.flight.dt
        self.memory = ManagerMemory()
        self.grip = Grip(np.zeros(3), 0.0, 0.0)
        """Grip of the last tick."""
        self.commands: list[LocomotionCommand] = []
        """Pending commands, the present one first."""
        self.path: Path | None = None
        """Path of the present flight; its time begins with the phase."""

    # ---- commands ----

    def reset(self, state: RobotState, commands: Iterable[LocomotionCommand] = ()) -> None:
        """Clear the memory and queue these commands; the robot lies on the floor with its rotors off."""
        self.flight.reset(state, state.joint_position)
        self.crawler.reset(state)
        self.memory = ManagerMemory(form=self.lying, begin_w=self._com(state))
        self.memory.floor = float(self.memory.begin_w[2])
        self.commands, self.path = [], None
        self.grasper.reset()
        self.command(commands)

    def begin_in_air(self, state: RobotState) -> None:
        """Hover where the robot is; call it after a reset."""
        R_wb, memory = quat_to_matrix(state.quat_wb), self.memory
        memory.yaw, memory.form = math.atan2(R_wb[1, 0], R_wb[0, 0]), state.joint_position.copy()
        memory.floor = self._lying_height
        pose = np.append(self._com(state), memory.yaw)
        self.path = Path(np.zeros(1), pose[None], np.zeros((1, 4)), np.zeros((1, 4)))
        self._enter("hover")

    def steer(self, target: Grasp, action: np.ndarray, state: RobotState, seconds: float) -> None:
        """Let a policy lead torso, legs and grip, as `Grasper.steer`; in the air."""
        pose = np.zeros(4)
        if self.memory.phase != "grasp":
            assert self.path is not None
            pose = self.path.pose_w[-1].copy()
            pose[:3] -= quat_to_matrix(heading(float(pose[3]))) @ self._com_b(state)
            self._enter("grasp")
        self.grasper.steer(target, action, pose, self.flight.memory.joint_position, seconds)

    def end(self) -> None:
        """End the mission: come to rest on the floor from any phase.

        A crawl cycle is completed, a flight ends with a landing where the robot is. An object that hangs is put down,
        before the end of its lift where it stood, else on the floor of the take-off; where there is none, it falls.
        Then the robot flies to where it hovered before the grasp, at least `ASIDE` from the object, and lands there.
        """
        memory, grasper = self.memory, self.grasper
        if self.commands and isinstance(self.commands[0], Land):
            self.commands = self.commands[:1]
            return
        floor = memory.floor - self._lying_height
        if memory.phase != "grasp":
            self._replace((Land(floor),) if self.airborne else ())
            return
        assert self.path is not None
        surface, situation = grasper.put_down(), self.situation
        put = () if surface is None else (Place(floor if math.isinf(surface) else surface),)
        where = self.grip.position_w if situation == "air" else grasper.memory.end.pose_w
        x, y, z, yaw = self.path.pose_w[-1].tolist()
        dx, dy = x - float(where[0]), y - float(where[1])
        far = math.hypot(dx, dy)
        if far < 1e-3:
            dx, dy, far = -math.cos(yaw), -math.sin(yaw), 1.0
        share = max(far, ASIDE) / far
        aside = FlyTo((float(where[0]) + share * dx, float(where[1]) + share * dy, z))
        self._replace((*put, *((Release(),) if situation != "air" else ()), aside, Land(floor)))
        memory.ends = True

    def _append(self, commands: tuple[LocomotionCommand, ...]) -> None:
        self.commands += commands

    def _replace(self, commands: tuple[LocomotionCommand, ...]) -> None:
        phase, rises = self.memory.phase, bool(commands) and isinstance(commands[0], TakeOff)
        self.memory.ends = False
        # A crawl cycle and a landing are completed, and a flight starts only when the legs are clear of the floor.
        is_low = phase == "climb" and self._moving()[0][2] < self.memory.floor + LEVEL_TO
        ends = phase in ("crawl", "unload") and not rises
        ends = ends or (is_low and bool(commands) and isinstance(commands[0], FlyTo))
        self.commands = [*(self.commands[:1] if ends else []), *commands]
        if phase == "crawl":
            self.crawler.gait.memory.steps = self.crawler.gait.memory.steps[:1]
        if phase == "spool" and (not commands or isinstance(commands[0], Land)):
            self.commands = [*commands] or [Land()]
            self.memory.floor, self.memory.velocity = float(self.memory.begin_w[2]), 0.0
            self._enter("unload")
        elif phase in ("fly", "form", "climb", "hover", "descend") and not ends:
            first = commands[0] if commands else None
            self._steer(first) if isinstance(first, FlyTo) and first.at_once else self._hover()
        elif phase == "grasp":
            self._regrasp()
        self.memory.rises = rises and phase in ("crawl", "unload")

    @property
    def grasp_phase(self) -> str:
        """Phase of the grasp, one of `GRASP_PHASES`."""
        return self.grasper.memory.phase

    @property
    def situation(self) -> str:
        """Where the robot is before a command that interrupts, one of `SITUATIONS`."""
        grasp = self.grasper.memory
        if self.memory.phase == "grasp" and self.grasper.holds and grasp.phase not in LEAVING:
            return "placed" if grasp.placed else "grip"
        return "air" if self.airborne else "floor"

    @property
    def last(self) -> LocomotionCommand | None:
        """The last pending command, or None."""
        return self.commands[-1] if self.commands else None

    @property
    def floor(self) -> float:
        """Height of the centre of mass when the robot lay last, or is expected to lie [m]."""
        return self.memory.floor

    @property
    def phase(self) -> str:
        """One of `PHASES`."""
        return self.memory.phase

    @property
    def last_step(self) -> FlightRecord | CrawlRecord | None:
        """Record of the last tick of the active controller; None before its first."""
        return (self.crawler if self.on_ground else self.flight).last_step

    def close(self) -> None:
        """Do nothing: the Python controllers hold no resources."""

    @property
    def done(self) -> bool:
        """Whether all commands are executed."""
        if self.commands or self.memory.phase not in ("lie", "hover", "cut", "grasp"):
            return False
        if self.memory.phase == "grasp":
            return self.grasper.waits
        return self.memory.phase != "hover" or self.path is None or self.memory.time >= self.path.seconds

    # ---- a tick ----

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL, seen: Seen | None = None) -> Command:
        """Compute the command of one control tick; as `Orders.step`."""
        memory = self.memory
        self._seen = seen
        if valid_state(state):
            self._next(state)
            memory.time += self.dt
        if self.on_ground:
            command = self.crawler.step(state, residual)
        elif memory.phase == "cut":
            command = replace(self._last(), thrust=np.zeros(N_ROTORS))
        elif memory.phase == "grasp":
            reference, self.grip = self._grip(state)
            command = self.flight.step(state, reference, residual, grip=self.grip)
        else:
            command = self._limited(self.flight.step(state, self.reference(state), residual))
        memory.thrust = float(command.thrust.sum())
        return command

    def reference(self, state: RobotState) -> Reference:
        """Compute the reference of the flight controller in the present phase."""
        memory, config, t = self.memory, self.config, self.memory.time
        if memory.phase == "spool":
            support = 1.0 - ease(t / config.spool_time)
            return Reference(memory.begin_w, memory.quat_wb, _STILL, _STILL, memory.form, support=support)
        if memory.phase == "unload":
            left, support = 1.0 - ease(t / (0.5 * config.unload_time)), max(ease(t / config.unload_time), 1e-3)
            fading = left * np.array([0.0, 0.0, -memory.velocity])
            aim = memory.begin_w + left * np.array([0.0, 0.0, memory.floor - memory.begin_w[2]])
            return Reference(aim, state.quat_wb, fading, _STILL, memory.form, support=support)
        if memory.phase == "descend":
            aim, rate = memory.begin_w, np.array([0.0, 0.0, -memory.velocity])
            return Reference(aim, heading(memory.yaw), rate, _STILL, memory.form)
        assert self.path is not None
        reference = self.path.reference(t, memory.form)
        if memory.phase == "climb":  # from the floor's attitude to level
            risen = float(reference.position_w[2]) - memory.floor
            share = ease((risen - LEVEL_FROM) / (LEVEL_TO - LEVEL_FROM))
            R_wb = quat_to_matrix(memory.quat_wb)
            turn = log(R_wb.T @ quat_to_matrix(reference.quat_wb))
            return replace(reference, quat_wb=matrix_to_quat(R_wb @ exp(share * turn)))
        return reference

    # ---- transitions between phases ----

    def _next(self, state: RobotState) -> None:
        """Enter the next phase if the present one has ended."""
        memory, config = self.memory, self.config
        R_wb = quat_to_matrix(state.quat_wb)
        if memory.rises:
            memory.rises = False
            self._begin_spool(state)
        if memory.phase not in ("lie", "crawl", "cut") and math.acos(max(-1.0, min(1.0, R_wb[2, 2]))) > config.cut_tilt:
            self._enter("cut")
            self.commands = []
            return
        {
            "lie": self._lie, "crawl": self._crawl, "spool": self._spool, "climb": self._climb, "hover": self._wait,
            "form": self._take_form, "fly": self._fly, "descend": self._descend, "unload": self._unload,
            "cut": lambda _: None, "grasp": self._grasp,
        }[memory.phase](state)  # fmt: skip

    def _lie(self, state: RobotState) -> None:
        if not self.commands:
            return
        command = self.commands[0]
        if isinstance(command, CrawlTo):
            self._enter("crawl")
            here = torso_pose2(state.position_w, quat_to_matrix(state.quat_wb))
            self.crawler.reset(state)
            self.crawler.set_last_command(self._last())
            self.crawler.gait.command([Move(here.inverse() @ command.pose)])
        else:
            self._begin_spool(state)

    def _begin_spool(self, state: RobotState) -> None:
        """Begin to shift the load from the floor to the rotors, starting from the rotors' present share."""
        R_wb, memory, last = quat_to_matrix(state.quat_wb), self.memory, self._last()
        share = min(1.0, memory.thrust / self.model.robot.weight)
        memory.begin_w, memory.quat_wb = self._com(state), state.quat_wb.copy()
        memory.floor, memory.yaw = float(memory.begin_w[2]), math.atan2(R_wb[1, 0], R_wb[0, 0])
        memory.form = last.joint_position.copy()  # keep the joints still, so that feet on the floor do not push
        self.flight.resume(state, last)
        self._enter("spool")
        memory.time = self.config.spool_time * _inverse_ease(share)

    def _crawl(self, state: RobotState) -> None:
        del state
        if self.crawler.done:
            self.commands.pop(0)
            self._enter("lie")

    def _spool(self, state: RobotState) -> None:
        del state
        if self.memory.time < self.config.spool_time:
            return
        command = self.commands[0]
        assert isinstance(command, TakeOff)
        x, y, z = self.memory.begin_w.tolist()
        self.path = legs([(x, y, z), (x, y, z + command.height)], self.config.climb_speed, yaw=self.memory.yaw)
        self._enter("climb")

    def _climb(self, state: RobotState) -> None:
        if self._com(state)[2] > self.memory.floor + LEVEL_TO:
            self.memory.form = self.lying
        self._fly(state)

    def _fly(self, state: RobotState) -> None:
        del state
        assert self.path is not None
        if self.memory.time >= self.path.seconds:
            if not (self.memory.phase == "fly" and isinstance(self.commands[0], Land)):  # that climb repeats a landing
                self.commands.pop(0)
            self._hover()

    def _wait(self, state: RobotState) -> None:
        assert self.path is not None
        if not self.commands or self.memory.time < self.path.seconds:
            return
        command = self.commands[0]
        if isinstance(command, FlyTo) and command.at_once:
            self._steer(command)
            return
        if isinstance(command, Grasp):
            self._begin_grasp(command, state)
            return
        wanted = self.lying if isinstance(command, Land) else command.form if isinstance(command, FlyTo) else None
        if wanted is not None:
            self.memory.form = wanted
        # The time restarts with the phase, so the path is replaced by its end, where the robot hovers.
        self.path = Path(np.zeros(1), self.path.pose_w[-1:], np.zeros((1, 4)), np.zeros((1, 4)))
        self._enter("form")

    def _take_form(self, state: RobotState) -> None:
        memory = self.memory
        if np.abs(self.flight.memory.joint_position - memory.form).max() > 1e-6:
            return
        memory.believed += self.dt
        if np.abs(state.joint_position - memory.form).max() > ARRIVED and memory.believed < PATIENCE:
            return
        command = self.commands[0]
        assert self.path is not None
        here = self.path.at(memory.time)[0]
        if isinstance(command, FlyTo):
            start = (float(here[0]), float(here[1]), float(here[2]))
            if math.dist(start, command.position_w) < 1e-6:
                self.commands.pop(0)
                self._hover()
                return
            self.path = legs([start, command.position_w], command.speed, along=command.along, yaw=memory.yaw)
            memory.yaw = float(self.path.pose_w[-1, 3])
            self._enter("fly")
        else:
            assert isinstance(command, Land)
            memory.begin_w, memory.velocity = here[:3].copy(), 0.0
            memory.floor = command.floor + self._lying_height
            self._enter("descend")

    # ---- grasps ----

    def _begin_grasp(self, command: Grasp, state: RobotState) -> None:
        """Begin to grasp as soon as the object is seen."""
        if self._seen is None:
            return
        assert self.path is not None
        pose = self.path.pose_w[-1].copy()
        pose[:3] -= quat_to_matrix(heading(float(pose[3]))) @ self._com_b(state)
        self.grasper.begin(command, self._seen, pose, self.flight.memory.joint_position)
        self._enter("grasp")
        self.memory.begun = True

    def _grasp(self, state: RobotState) -> None:
        """Begin the next command of a grasp when the one before it is executed."""
        memory, grasper = self.memory, self.grasper
        if memory.begun and grasper.waits:
            memory.begun = False
            command = self.commands.pop(0) if self.commands else None
            failed = isinstance(command, Place) and not grasper.memory.placed and not memory.ends  # there was no floor
            if failed or (grasper.memory.phase == "none" and not isinstance(command, Release)):
                self.commands = []  # the object was lost, or is too heavy
        if grasper.memory.phase == "none":
            self._leave_grasp(state)
        elif (
            self.commands
            and grasper.waits
            and not memory.begun
            and (not memory.ends or grasper.memory.time >= ENDS_AFTER)
        ):
            command, memory.begun = self.commands[0], True
            if isinstance(command, CarryTo):
                grasper.carry(np.array(command.position_w), command.yaw, command.speed)
            elif isinstance(command, Place):
                grasper.place(command.floor)
            else:
                assert isinstance(command, Release)
                grasper.release()

    def _regrasp(self) -> None:
        """Stop the present command of a grasp; without an object held, leave it."""
        memory, grasper = self.memory, self.grasper
        if grasper.holds and grasper.memory.phase not in LEAVING:
            grasper.stop()
        else:
            self.grasper.abandon()
            self.commands = [Release(), *self.commands]  # the way out is completed
            memory.begun = True
            return
        memory.begun = grasper.memory.phase != "hold"
        if memory.begun:  # a grip that is not tested yet is completed
            self.commands = [Grasp(), *self.commands]

    def _leave_grasp(self, state: RobotState) -> None:
        """Hover where the grasp ended."""
        end = self.grasper.memory.end
        pose = end.pose_w.copy()
        pose[:3] += quat_to_matrix(heading(float(pose[3]))) @ self._com_b(state)
        self.memory.yaw, self.memory.form = float(pose[3]), end.form
        self.path = Path(np.zeros(1), pose[None], np.zeros((1, 4)), np.zeros((1, 4)))
        self._enter("hover")

    def _grip(self, state: RobotState) -> tuple[Reference, Grip]:
        """Compute the reference and the grip of a tick."""
        R_wb = quat_to_matrix(state.quat_wb)
        yaw = math.atan2(R_wb[1, 0], R_wb[0, 0])
        last = self.flight.last_step
        lift = self.model.robot.weight if last is None else float(R_wb[2] @ last.wrench_desired[:3])
        aim = self.grasper.step(state.position_w, yaw, state.joint_position, lift, self._seen, self.dt)
        snapshot = self.model.snapshot(state.joint_position, R_wb, state.vectoring)
        # The joints' motion moves the CoG, not the torso.
        velocity = aim.velocity_w + R_wb @ (snapshot.momentum_map[:3] @ state.joint_velocity) / snapshot.mass
        reference = Reference(
            aim.position_w + R_wb @ snapshot.com_b, heading(aim.yaw), velocity, np.array([0.0, 0.0, aim.turning]),
            aim.form,
        )  # fmt: skip
        return reference, aim.grip

    def _descend(self, state: RobotState) -> None:
        memory, config, dt = self.memory, self.config, self.dt
        memory.velocity = min(config.descent_speed, memory.velocity + config.descent_ease * dt)
        memory.begin_w = memory.begin_w - np.array([0.0, 0.0, memory.velocity * dt])
        above = float(self._com(state)[2] - memory.begin_w[2])
        pushed = float(self.flight.memory.compensation.external_w[2]) > config.touch_force * self.model.robot.weight
        slow = state.velocity_w[2] > -config.touch_speed * config.descent_speed
        is_on_its_way = memory.velocity >= config.descent_speed
        is_like_a_floor = is_on_its_way and slow and (above > config.touch_error or pushed)
        memory.believed = memory.believed + dt if is_like_a_floor else 0.0
        if memory.believed >= config.touch_time:
            memory.floor, memory.begin_w = float(memory.begin_w[2]), self._com(state)
            self._enter("unload")
        elif memory.begin_w[2] < memory.floor - config.search:
            self._break_off()

    def _unload(self, state: RobotState) -> None:
        memory, config = self.memory, self.config
        if memory.time < 0.5 * config.unload_time and state.velocity_w[2] < -config.lost_fall:
            memory.begin_w = np.array([*memory.begin_w[:2], memory.floor])
            self._enter("descend")  # a gust was mistaken for the floor
            memory.velocity = config.descent_speed
            return
        tilt = math.acos(max(-1.0, min(1.0, quat_to_matrix(state.quat_wb)[2, 2])))
        if tilt > config.most_tilt and memory.failures == 0:
            self._break_off()
            return
        if memory.time >= config.unload_time:
            memory.failures = 0
            memory.floor = float(self._com(state)[2])
            self.commands.pop(0)
            self.crawler.reset(state)
            self.crawler.set_last_command(replace(self._last(), thrust=np.zeros(N_ROTORS)))
            self._enter("lie")

    def _break_off(self) -> None:
        """Abort a landing and climb; after the second abort in a row drop all commands and hover."""
        memory = self.memory
        memory.failures += 1
        x, y, z = memory.begin_w.tolist()
        self.path = legs([(x, y, z), (x, y, z + self.config.again)], self.config.climb_speed, yaw=memory.yaw)
        memory.quat_wb = heading(memory.yaw)
        if memory.failures > 1:
            self.commands = []
        self._enter("fly" if self.commands else "hover")

    def _hover(self) -> None:
        """Build a path that brings the present motion to rest."""
        memory, (pose, rate, acceleration) = self.memory, self._moving()
        brake = max(math.sqrt(float(rate[:3] @ rate[:3])) / EASE, abs(float(rate[3])) / TURN_RATE)
        end = pose + 0.5 * brake * rate
        memory.yaw = float(end[3])
        rows = (pose, end) if brake > 1e-6 else (end,)
        still = np.zeros((len(rows), 4))
        self.path = Path(np.array([0.0, brake])[: len(rows)], np.array(rows), still.copy(), still)
        if brake > 1e-6:
            self.path.rate_w[0], self.path.acceleration_w[0] = rate, acceleration
        self._enter("hover")

    def _steer(self, command: FlyTo) -> None:
        """Build a path from the present motion to the position of a command."""
        memory, (pose, rate, acceleration) = self.memory, self._moving()
        way, turn = np.array(command.position_w) - pose[:3], 0.0
        if command.along and math.hypot(way[0], way[1]) > LEAST_WAY:
            turn = wrap(math.atan2(way[1], way[0]) - float(pose[3]))
        end = np.array([*command.position_w, float(pose[3]) + turn])
        self.path = from_motion(pose, rate, acceleration, end, command.speed)
        memory.yaw, memory.form = float(end[3]), memory.form if command.form is None else command.form
        self._enter("fly")

    def _moving(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return pose, rate and acceleration (4,) of the present reference in the air."""
        memory = self.memory
        if memory.phase == "descend":
            return np.array([*memory.begin_w, memory.yaw]), np.array([0.0, 0.0, -memory.velocity, 0.0]), np.zeros(4)
        assert self.path is not None
        return self.path.at(memory.time)

    def _enter(self, phase: str) -> None:
        self.memory.phase, self.memory.time, self.memory.believed = phase, 0.0, 0.0

    # ---- helpers ----

    def _com(self, state: RobotState) -> Vector3:
        return state.position_w + quat_to_matrix(state.quat_wb) @ self._com_b(state)

    def _com_b(self, state: RobotState) -> Vector3:
        """Return the CoG from the torso's origin, torso axes [m]."""
        return self.model.snapshot(state.joint_position, quat_to_matrix(state.quat_wb), state.vectoring).com_b

    def _last(self) -> Command:
        """Return the last command."""
        controller = self.crawler if self.on_ground else self.flight
        memory = controller.memory
        thrust = np.linalg.norm(memory.forces_l, axis=1)
        limit = self.config.flight.joint_torque_limit
        return Command(thrust, memory.vectoring, memory.joint_position, np.full(16, limit))

    def _expects_floor(self) -> bool:
        """Whether a descent is near the floor of its command, not of a mistaken touch, or sees signs of a floor."""
        memory, command = self.memory, self.commands[0]
        assert isinstance(command, Land)
        above = memory.begin_w[2] - (command.floor + self._lying_height)
        return bool(above < NEAR_FLOOR) or memory.believed > 0.0

    def _limited(self, command: Command) -> Command:
        """Limit the rate of Σλ near the floor and into the climb, so that contacts of the feet cause no jumps.

        In free air the limit makes the loop of the height oscillate where joints are badly damped. With observed motion
        a descent is therefore limited only near the expected floor or at signs of one; older presets keep their rows.
        """
        memory, total = self.memory, float(command.thrust.sum())
        lifts = memory.phase == "climb" and memory.time <= self.dt
        falls = memory.phase == "descend" and (self.config.flight.motion != "observed" or self._expects_floor())
        if not (memory.phase in ("spool", "unload") or falls or lifts) or total <= 0.0:
            return command
        slew, before = self.config.most_slew, memory.thrust
        share = min(max(total, before - slew), before + slew) / total
        self.flight.note_scaled(share)
        most = min(self.model.robot.max_thrust, self.flight.thrust_limit)
        return replace(command, thrust=np.minimum(most, command.thrust * share))


def _inverse_ease(share: float) -> float:
    """Compute the argument at which `ease` equals a share."""
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ease(middle) < share else (low, middle)
    return low
