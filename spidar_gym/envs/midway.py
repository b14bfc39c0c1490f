"""What can be changed in the middle of an episode: what happens to the robot from outside."""

from collections.abc import Mapping
from typing import Any

from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.remade import Remade
from spidar_gym.envs.turns import in_turn
from spidar_gym.errors import SpidarError, require_within
from spidar_gym.native.plant import Plant
from spidar_gym.sim.disturbances import Disturbances


class Disturbable(Remade):
    """An environment whose weather and faults change while it flies or crawls."""

    plant: Plant
    """The simulated robot."""
    fleet: Fleet | None
    """Its robot in the engine, where that does all of it."""
    _disturbances: Disturbances
    _began: bool

    @in_turn
    def disturb(self, disturbances: Mapping[str, Any] | Disturbances | None, towards: float = 0.0) -> None:
        """Let something else happen to the robot from now on, without a reset, and in the episodes after this one.

        Args:
            disturbances: As at `reset`; a `fault_time` that is past is now. Pushes begin with one at once.
            towards: Where the wind of this episode blows to, 0 along x, π/2 along y [rad].

        Raises:
            UnknownNameError: For a name that does not exist, and nothing has changed.
            InvalidValueError: For a value that is not valid, and nothing has changed.
            SpidarError: When `reset` was never called.
        """
        chosen = Disturbances.parse(disturbances)
        require_within(-1e6, 1e6, "rad", towards=towards)
        if not self._began:
            raise SpidarError("there is no episode to disturb before reset(); valid: call reset() first")
        self._disturbances = chosen
        self._choices = self._choices | {"disturbances": chosen}  # who is made anew at reset, or restored, keeps them
        if self.fleet is not None:
            self.fleet.disturb(0, chosen)
        self.plant.disturb(chosen, towards)
