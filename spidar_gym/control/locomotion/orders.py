"""Interface of the managers of gaits and grasp: configuration, phases, and validation of commands."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from spidar_gym.arrays import JointVector
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import lying_pose
from spidar_gym.control.crawl.memory import CrawlRecord
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.memory import FlightRecord
from spidar_gym.control.grasp.claw import require_holdable
from spidar_gym.control.grasp.phases import GraspConfig, Seen
from spidar_gym.control.locomotion.commands import FlyTo, Grasp, LocomotionCommand, require_order, situation_after
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.errors import InvalidValueError, require_above
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import N_ROTORS
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState

PHASES = ("lie", "crawl", "spool", "climb", "hover", "form", "fly", "descend", "unload", "cut", "grasp")
"""Phases of the manager; `grasp` has phases of its own."""
COURSE_PHASES = PHASES[: PHASES.index("grasp")]
"""Phases of a course."""


@dataclass(frozen=True)
class ManagerConfig:
    """Configuration of the manager: controllers of both gaits, take-off and landing, grasps."""

    flight: ControllerConfig = field(default_factory=lambda: controller_config("tuned"))
    """Configuration of the flight controller."""
    crawl: CrawlerConfig = field(default_factory=lambda: crawler_config("robust_overlapped"))
    """Configuration of the crawler."""
    grasp: GraspConfig = field(default_factory=GraspConfig)
    """Heights, speeds and thresholds of a grasp."""
    spool_time: float = 1.5
    """Time in which the load shifts from the floor to the rotors [s]."""
    climb_speed: float = 0.4
    """Largest speed of the climb after take-off [m/s]."""
    descent_speed: float = 0.22
    """Speed of the descent [m/s]."""
    descent_ease: float = 0.5
    """Acceleration at the beginning of the descent [m/s²]."""
    unload_time: float = 1.0
    """Time in which the load shifts from the rotors to the floor [s]."""
    touch_error: float = 0.02
    """The floor is detected when the robot is this far above its reference in the descent [m], or by `touch_force`."""
    touch_force: float = 0.2
    """The floor is detected when the observed upward force exceeds this share of the weight, or by `touch_error`."""
    touch_speed: float = 0.3
    """The floor is detected only while the robot falls slower than this share of `descent_speed`."""
    touch_time: float = 0.075
    """The conditions of a detected floor must hold for this time [s]."""
    lost_fall: float = 0.12
    """The descent resumes if the robot falls faster than this while the rotors fade [m/s]."""
    most_slew: float = 5.0
    """Largest change of Σλ per tick near the floor [N]."""
    most_tilt: float = 0.4
    """A landing with a larger tilt is aborted and repeated from above [rad]."""
    search: float = 0.5
    """A descent that finds no floor is aborted this far below the expected height [m]."""
    again: float = 0.5
    """Height of the climb after an aborted landing [m]; after the second one the robot stays in the air."""
    cut_tilt: float = 0.9
    """The rotors are cut at a larger tilt [rad]."""
    clearance: float = 0.15
    """Smallest distance of a form from the take-off floor and from the sides of a passage [m]."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for times, speeds and bounds that are not positive."""
        numbers = {name: value for name, value in vars(self).items() if isinstance(value, int | float)}
        require_above("1", **numbers)


class Orders(ABC):
    """Interface of the managers of both gaits, in Python and compiled."""

    config: ManagerConfig
    """Configuration of the manager and of both controllers."""
    model: Model
    """Model of the robot with nominal parameters."""

    @property
    @abstractmethod
    def phase(self) -> str:
        """One of `PHASES`."""

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether all commands are executed."""

    @property
    @abstractmethod
    def grasp_phase(self) -> str:
        """Phase of the grasp, one of `GRASP_PHASES`."""

    @property
    @abstractmethod
    def situation(self) -> str:
        """Where the robot is before a command that interrupts, one of `SITUATIONS`."""

    @property
    @abstractmethod
    def last(self) -> LocomotionCommand | None:
        """The last pending command, or None."""

    @property
    @abstractmethod
    def floor(self) -> float:
        """Height of the centre of mass when the robot lay last, or is expected to lie [m]."""

    @property
    @abstractmethod
    def last_step(self) -> FlightRecord | CrawlRecord | None:
        """Record of the last tick of the active controller; None before its first."""

    @property
    def on_ground(self) -> bool:
        """Whether the crawler controls."""
        return self.phase in ("lie", "crawl")

    @abstractmethod
    def close(self) -> None:
        """Release all resources; the manager cannot be used afterwards."""

    @abstractmethod
    def reset(self, state: RobotState, commands: Iterable[LocomotionCommand] = ()) -> None:
        """Clear the memory and queue these commands; the robot lies on the floor with its rotors off."""

    @abstractmethod
    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL, seen: Seen | None = None) -> Command:
        """Compute the command of one control tick; if the state is not finite, repeat the last command.

        Args:
            state: State of the robot.
            residual: Additions of a policy.
            seen: Object to grasp, or None while motion capture does not see it.
        """

    @abstractmethod
    def _append(self, commands: tuple[LocomotionCommand, ...]) -> None:
        """Append valid commands to the pending ones."""

    @abstractmethod
    def _replace(self, commands: tuple[LocomotionCommand, ...]) -> None:
        """Replace the pending commands by valid commands."""

    @abstractmethod
    def end(self) -> None:
        """End the mission: come to rest on the floor from any phase, without an object."""

    @property
    def airborne(self) -> bool:
        """Whether the robot flies or is about to take off."""
        return self.phase not in ("lie", "crawl", "unload", "cut")

    def command(self, commands: Iterable[LocomotionCommand]) -> None:
        """Append commands; if one is invalid, raise `InvalidValueError` and change nothing."""
        more = tuple(commands)
        require_order(more, self.situation if self.last is None else situation_after(self.last))
        for each in more:
            self._require_room(each)
        self._append(more)

    def interrupt(self, commands: Iterable[LocomotionCommand]) -> None:
        """Drop the pending commands and execute these instead.

        In the air, and for a take-off, they start immediately; otherwise a crawl completes its cycle first.

        Raises:
            InvalidValueError: If a command is invalid in the present phase; nothing is changed then.
        """
        more = tuple(commands)
        require_order(more, self.situation)
        for each in more:
            self._require_room(each)
        self._replace(more)

    def _require_room(self, command: LocomotionCommand) -> None:
        """Raise `InvalidValueError` for what does not fit.

        A flight may be too low above the take-off floor or too wide for its room, an object too wide for the legs.
        """
        if isinstance(command, Grasp):
            require_holdable(command.shape, command.half_size, self.model.robot)
        if not isinstance(command, FlyTo):
            return
        form, robot = self.lying if command.form is None else command.form, self.model.robot
        if (np.abs(form) > robot.joint_limit + 1e-9).any():
            raise InvalidValueError("form", form.tolist(), f"angles within ± {robot.joint_limit:.4g} rad")
        snapshot = self.model.snapshot(form, np.eye(3), np.zeros((N_ROTORS, 2)))
        feet = self.model.contacts(form)[0]
        lowest = float(feet[:, 2].min()) - float(snapshot.com_b[2]) - robot.foot_radius
        least = self.floor - self._lying_height - lowest + self.config.clearance
        if command.position_w[2] < least:
            raise InvalidValueError("z", command.position_w[2], f"at least {least:.2f} m in this form")
        wide = 2.0 * (form_radius(self.model, form) + self.config.clearance)
        if command.room is not None and command.room < wide:
            raise InvalidValueError("room", command.room, f"at least {wide:.2f} m for this form with its clearance")

    @cached_property
    def lying(self) -> JointVector:
        """Joint angles on the floor [rad]."""
        return lying_pose(self.config.crawl.gait)

    @cached_property
    def _lying_height(self) -> float:
        """Height of the centre of mass of the lying robot above the floor [m]."""
        snapshot = self.model.snapshot(self.lying, np.eye(3), np.zeros((N_ROTORS, 2)))
        return float(snapshot.com_b[2]) + self.model.robot.peg_depth


def form_radius(model: Model, form: JointVector) -> float:
    """Compute the radius of the upright cylinder about the torso's axis that encloses a form, ducts included [m]."""
    snapshot, robot = model.snapshot(form, np.eye(3), np.zeros((N_ROTORS, 2))), model.robot
    rotors = snapshot.rotor_c + snapshot.com_b
    reach = np.hypot(rotors[:, 0], rotors[:, 1]).max() + robot.duct_offset_y + robot.duct_radius
    feet = model.contacts(form)[0]
    return float(max(reach, np.hypot(feet[:, 0], feet[:, 1]).max() + robot.foot_radius))
