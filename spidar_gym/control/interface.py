"""Interface of controllers: state in, command out, once per control period.

`FlightControl` is the interface in flight, `CrawlControl` on the ground. Each has a Python implementation
(`flight/controller.py`, `crawl/controller.py`, which document the arguments) and a compiled one (the core of the robot:
`native`). An environment creates a controller from a configuration (`envs/controllers.py`) and uses this interface.
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
from spidar_gym.control.grasp.grip import Grip
from spidar_gym.model.dynamics import Model
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState


@runtime_checkable
class LastCommand(Protocol):
    """Part of the memory that every controller has: the angles commanded last."""

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
    """Common interface of the controllers in flight and on the ground."""

    model: Model
    """Model of the robot with nominal parameters."""

    @property
    def memory(self) -> LastCommand:
        """State kept from one tick to the next."""
        ...

    @property
    def thrust_limit(self) -> float:
        """λ̄ at the battery's voltage where it is below the robot's [N]: an input; infinite by default."""
        ...

    @thrust_limit.setter
    def thrust_limit(self, newtons: float) -> None: ...

    def set_last_command(self, command: Command) -> None:
        """Store the command of another controller as the last command."""

    def close(self) -> None:
        """Release all resources; the controller cannot be used afterwards."""


@runtime_checkable
class FlightControl(Controller, Protocol):
    """Flight controller, which follows a reference."""

    config: ControllerConfig
    """Allocation, gains, limits."""

    @property
    def last_step(self) -> FlightRecord | None:
        """Record of the last step; None before the first."""
        ...

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Clear the memory."""

    def rest_vectoring(self, q: JointVector) -> Vectoring:
        """Compute (φ, θ) near which a hover in the form q settles [rad]."""
        ...

    def compute_state(self, state: RobotState, reference: Reference) -> ControlState:
        """Compute model quantities and errors; the second call after this one may overwrite them."""
        ...

    def step(
        self,
        state: RobotState,
        reference: Reference,
        residual: Residual = NO_RESIDUAL,
        control_state: ControlState | None = None,
        grip: Grip | None = None,
    ) -> Command:
        """Compute the command of one control tick; `grip`: an object near the robot, and what the legs do with it."""
        ...

    def observe(self, observables: FlightObservables, *, bound: np.ndarray) -> np.ndarray:
        """Compute the observation of a policy."""
        ...


@runtime_checkable
class GaitProgress(Protocol):
    """Progress of a gait."""

    @property
    def phase(self) -> str:
        """One of `control.crawl.phases.PHASES`."""
        ...

    @property
    def timeouts(self) -> int:
        """Number of phases that ended by time-out."""
        ...

    @property
    def swinging(self) -> np.ndarray:
        """Legs whose feet are in the air (4,)."""
        ...


@runtime_checkable
class CrawlControl(Controller, Protocol):
    """Crawl controller, which executes gait commands."""

    config: CrawlerConfig
    """Gait, allocation, limits."""

    @property
    def last_step(self) -> CrawlRecord | None:
        """Record of the last step; None before the first."""
        ...

    @property
    def gait(self) -> GaitProgress:
        """Progress of the gait."""
        ...

    @property
    def done(self) -> bool:
        """Whether every command is executed and the forces of the last mode have faded."""
        ...

    def reset(self, state: RobotState, commands: Iterable[GaitCommand] = ()) -> None:
        """Clear the memory and queue these commands; the robot lies on the floor with its rotors off."""

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL) -> Command:
        """Compute the command of one control tick."""
        ...

    def observe(self, observables: CrawlObservables, *, bound: np.ndarray) -> np.ndarray:
        """Compute the observation of a policy."""
        ...
