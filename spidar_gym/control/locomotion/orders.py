"""What a manager of both gaits is, and what it is told: its settings, its phases, what it refuses."""

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
from spidar_gym.control.locomotion.commands import (
    FlyTo,
    LocomotionCommand,
    airborne_after,
    require_order,
)
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.errors import InvalidValueError, require_above
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import N_ROTORS
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState

PHASES = ("lie", "crawl", "spool", "climb", "hover", "form", "fly", "descend", "unload", "cut")
"""What the manager is doing."""


@dataclass(frozen=True)
class ManagerConfig:
    """Everything that can be chosen about how the gaits give way to each other."""

    flight: ControllerConfig = field(default_factory=lambda: controller_config("tuned"))
    """Who flies."""
    crawl: CrawlerConfig = field(default_factory=lambda: crawler_config("robust_overlapped"))
    """Who crawls."""
    spool_time: float = 1.5
    """Time in which the rotors take over from the floor [s]."""
    climb_speed: float = 0.4
    """Largest speed of the climb after take-off [m/s]."""
    descent_speed: float = 0.22
    """Speed at which it comes down [m/s]."""
    descent_ease: float = 0.5
    """Acceleration with which the descent begins [m/s²]."""
    unload_time: float = 1.0
    """Time in which the floor takes over from the rotors [s]."""
    touch_error: float = 0.02
    """The floor is where the robot is so far above its descent [m]; or as the next says."""
    touch_force: float = 0.2
    """The floor is where an unknown force of such a share of the weight pushes the robot up."""
    touch_speed: float = 0.3
    """For either it has to fall slower than this share of its descent."""
    touch_time: float = 0.075
    """For either it has to last so long [s]."""
    lost_fall: float = 0.12
    """What carried it is no floor where it falls faster than this while the rotors fade [m/s]."""
    most_slew: float = 5.0
    """Σλ changes by no more than this a tick where the floor is near [N]."""
    most_tilt: float = 0.4
    """A landing that tilts by more than this is broken off, and begun once more from above [rad]."""
    search: float = 0.5
    """A descent that finds no floor this far below where it is expected is broken off [m]."""
    again: float = 0.5
    """A landing that is broken off climbs by this much [m]; after the second one it stays there."""
    cut_tilt: float = 0.9
    """Tilted by more than this the rotors are cut [rad]."""
    clearance: float = 0.15
    """The lowest part of a form stays this far above the floor that it took off from [m], and from what it passes."""

    def __post_init__(self) -> None:
        """Refuse times, speeds and bounds that are not positive."""
        numbers = {name: value for name, value in vars(self).items() if isinstance(value, int | float)}
        require_above("1", **numbers)


class Orders(ABC):
    """What every manager of both gaits is told, whatever computes it."""

    config: ManagerConfig
    """Who flies, who crawls, and how they give way to each other."""
    model: Model
    """The robot as described."""

    @property
    @abstractmethod
    def phase(self) -> str:
        """One of `PHASES`."""

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether nothing is left to do."""

    @property
    @abstractmethod
    def last(self) -> LocomotionCommand | None:
        """The last of what is still to do."""

    @property
    @abstractmethod
    def floor(self) -> float:
        """Height of the centre of mass where it lay last, or is expected to lie [m]."""

    @property
    @abstractmethod
    def last_step(self) -> FlightRecord | CrawlRecord | None:
        """What the last tick of whoever controls now did; None before its first."""

    @property
    def on_ground(self) -> bool:
        """Whether the crawler controls."""
        return self.phase in ("lie", "crawl")

    @abstractmethod
    def close(self) -> None:
        """Release what is held: nothing can be asked any more."""

    @abstractmethod
    def reset(self, state: RobotState, commands: Iterable[LocomotionCommand] = ()) -> None:
        """Forget everything: the robot lies on the floor, rotors off, and has these commands before it."""

    @abstractmethod
    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL) -> Command:
        """One control tick: the command for the next control period. A state that is not finite gets the last one."""

    @abstractmethod
    def _append(self, commands: tuple[LocomotionCommand, ...]) -> None:
        """Take valid commands behind what is still to do."""

    @abstractmethod
    def _replace(self, commands: tuple[LocomotionCommand, ...]) -> None:
        """Take valid commands in its place."""

    @property
    def airborne(self) -> bool:
        """Whether it flies, or is about to."""
        return self.phase not in ("lie", "crawl", "unload", "cut")

    def command(self, commands: Iterable[LocomotionCommand]) -> None:
        """Append commands (`InvalidValueError` for what cannot be done, and nothing has changed)."""
        more = tuple(commands)
        require_order(more, self.airborne if self.last is None else airborne_after(self.last))
        for each in more:
            self._require_room(each)
        self._append(more)

    def interrupt(self, commands: Iterable[LocomotionCommand]) -> None:
        """Drop what is still to do, and do these from here on.

        In the air, and for a take-off, that is at once, whatever the robot is doing; a crawl comes to the end of its
        cycle first.

        Raises:
            InvalidValueError: For what cannot be done from here, and nothing has changed.
        """
        more = tuple(commands)
        require_order(more, self.airborne)
        for each in more:
            self._require_room(each)
        self._replace(more)

    def _require_room(self, command: LocomotionCommand) -> None:
        """Refuse a flight so low that its form touches the floor it took off from, or through what is too narrow."""
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
        """Height of the centre of mass over a floor on which the robot lies [m]."""
        snapshot = self.model.snapshot(self.lying, np.eye(3), np.zeros((N_ROTORS, 2)))
        return float(snapshot.com_b[2]) + self.model.robot.peg_depth


def form_radius(model: Model, form: JointVector) -> float:
    """Radius of the upright cylinder round the torso's axis that holds a form, propellers included [m]."""
    snapshot, robot = model.snapshot(form, np.eye(3), np.zeros((N_ROTORS, 2))), model.robot
    rotors = snapshot.rotor_c + snapshot.com_b
    reach = np.hypot(rotors[:, 0], rotors[:, 1]).max() + robot.duct_offset_y + robot.duct_radius
    feet = model.contacts(form)[0]
    return float(max(reach, np.hypot(feet[:, 0], feet[:, 1]).max() + robot.foot_radius))
