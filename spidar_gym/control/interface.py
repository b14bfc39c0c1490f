"""What a controller is: state in, command out, once a control period, whatever computes it.

In flight `FlightController` (readable) and `CoreFlightController` (compiled for the robot) are a `FlightControl`, on
the ground `Crawler` and `CoreCrawler` a `CrawlControl`. An environment holds one of these and never asks which.
"""

from collections.abc import Iterable
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from spidar_gym.arrays import JointVector, RotorVector, Vectoring, Wrench
from spidar_gym.control.allocation.allocator import Allocation
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import GaitCommand
from spidar_gym.control.crawl.memory import CrawlRecord
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.memory import ControlState, FlightRecord
from spidar_gym.control.flight.observation import LegMomentum, Preview
from spidar_gym.model.dynamics import Model
from spidar_gym.model.interference import Interference
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState


@runtime_checkable
class Settings(Protocol):
    """What every controller's configuration says."""

    @property
    def joint_speed(self) -> float:
        """Speed of the planned joint motion [rad/s]."""
        ...


@runtime_checkable
class LastCommand(Protocol):
    """What every controller remembers of its last command."""

    @property
    def vectoring(self) -> Vectoring:
        """(φ, θ) [rad]."""
        ...

    @property
    def joint_position(self) -> JointVector:
        """q^d [rad]."""
        ...


@runtime_checkable
class LastStep(Protocol):
    """What every controller tells of its last step."""

    @property
    def allocation(self) -> Allocation:
        """The answer of the allocation."""
        ...


ConfigT = TypeVar("ConfigT", bound=Settings, covariant=True)
MemoryT = TypeVar("MemoryT", bound=LastCommand, covariant=True)
RecordT = TypeVar("RecordT", bound=LastStep, covariant=True)


@runtime_checkable
class Controller(Protocol[ConfigT, MemoryT, RecordT]):
    """What flight and crawl share."""

    model: Model
    """The robot as described."""

    @property
    def config(self) -> ConfigT:
        """Everything that was chosen about it."""
        ...

    @property
    def memory(self) -> MemoryT:
        """What is remembered from one tick to the next."""
        ...

    @property
    def last_step(self) -> RecordT | None:
        """What the last step did; None before the first."""
        ...

    def set_last_command(self, command: Command) -> None:
        """Remember a command that somebody else gave."""

    def close(self) -> None:
        """Release what is held: nothing can be asked any more."""


@runtime_checkable
class FlightMemoryView(LastCommand, Protocol):
    """What a flight controller remembers besides."""

    @property
    def interference(self) -> Interference:
        """Restricted rotors and chosen sides."""
        ...


@runtime_checkable
class FlightControl(Controller[ControllerConfig, FlightMemoryView, FlightRecord], Protocol):
    """A controller in flight: it follows a reference."""

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Forget everything; see `FlightController.reset`."""

    def rest_vectoring(self, q: JointVector) -> Vectoring:
        """(φ, θ) that a hover in the form q comes to rest near [rad]."""
        ...

    def compute_state(self, state: RobotState, reference: Reference) -> ControlState:
        """Model quantities and errors; valid until the next call but one."""
        ...

    def step(
        self,
        state: RobotState,
        reference: Reference,
        residual: Residual = NO_RESIDUAL,
        control_state: ControlState | None = None,
    ) -> Command:
        """One control tick; see `FlightController.step`."""
        ...

    def observe(
        self,
        state: RobotState,
        control_state: ControlState,
        thrust_command: RotorVector,
        joint_velocity: JointVector,
        legs: LegMomentum,
        preview: Preview,
        previous_action: np.ndarray,
        *,
        bound: np.ndarray,
    ) -> np.ndarray:
        """What a policy sees; see `control.flight.observation`."""
        ...


@runtime_checkable
class GaitProgress(Protocol):
    """What a gait is doing."""

    @property
    def phase(self) -> str:
        """One of `control.crawl.phases.PHASES`."""
        ...

    @property
    def timeouts(self) -> int:
        """Phases that ended by time-out."""
        ...


@runtime_checkable
class CrawlMemoryView(LastCommand, Protocol):
    """What a crawler remembers besides."""

    @property
    def mode(self) -> str:
        """Allocation mode of the last tick."""
        ...


@runtime_checkable
class CrawlControl(Controller[CrawlerConfig, CrawlMemoryView, CrawlRecord], Protocol):
    """A controller on the ground: it carries out the commands that it was given."""

    @property
    def gait(self) -> GaitProgress:
        """Where the gait is."""
        ...

    @property
    def done(self) -> bool:
        """Whether every command is carried out and the forces of the last mode have faded."""
        ...

    def reset(self, state: RobotState, commands: Iterable[GaitCommand] = ()) -> None:
        """Forget everything: the robot lies on the floor, rotors off, and has these commands before it."""

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL) -> Command:
        """One control tick; see `Crawler.step`."""
        ...

    def observe(
        self, state: RobotState, goal: Pose2, thrust_command: RotorVector, previous_action: np.ndarray, *,
        bound: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """What a policy sees; see `control.crawl.observation`."""
        ...
