"""What a controller is: state in, command out, once a control period, whatever computes it.

`FlightControl` in flight, `CrawlControl` on the ground, each readable (Python: `flight/controller.py`,
`crawl/controller.py`, where it is said what the arguments mean) and compiled (the core of the robot: `native`). An
environment makes one from a configuration (`envs/controllers.py`) and never asks which.
"""

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np

from spidar_gym.arrays import JointVector, Vectoring, Wrench
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import GaitCommand
from spidar_gym.control.crawl.memory import CrawlRecord
from spidar_gym.control.crawl.observation import CrawlObservables
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.memory import ControlState, FlightRecord
from spidar_gym.control.flight.observation import FlightObservables
from spidar_gym.model.dynamics import Model
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState


@runtime_checkable
class LastCommand(Protocol):
    """What every controller remembers: the angles that it commanded last."""

    @property
    def vectoring(self) -> Vectoring:
        """(φ, θ) [rad]."""
        ...

    @property
    def joint_position(self) -> JointVector:
        """q^d [rad]."""
        ...


@runtime_checkable
class Controller(Protocol):
    """What flight and ground have in common."""

    model: Model
    """The robot as described."""

    @property
    def memory(self) -> LastCommand:
        """What is remembered from one tick to the next."""
        ...

    def set_last_command(self, command: Command) -> None:
        """Remember a command that somebody else gave."""

    def close(self) -> None:
        """Release what is held: nothing can be asked any more."""


@runtime_checkable
class FlightControl(Controller, Protocol):
    """In flight: it follows a reference."""

    config: ControllerConfig
    """Allocation, gains, limits."""

    @property
    def last_step(self) -> FlightRecord | None:
        """What the last step did; None before the first."""
        ...

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Forget everything."""

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
        """One control tick."""
        ...

    def observe(self, observables: FlightObservables, *, bound: np.ndarray) -> np.ndarray:
        """What a policy sees."""
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

    @property
    def swinging(self) -> np.ndarray:
        """Legs whose feet are on their way (4,)."""
        ...


@runtime_checkable
class CrawlControl(Controller, Protocol):
    """On the ground: it carries out the commands that it was given."""

    config: CrawlerConfig
    """Gait, allocation, limits."""

    @property
    def last_step(self) -> CrawlRecord | None:
        """What the last step did; None before the first."""
        ...

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
        """One control tick."""
        ...

    def observe(self, observables: CrawlObservables, *, bound: np.ndarray) -> np.ndarray:
        """What a policy sees."""
        ...
