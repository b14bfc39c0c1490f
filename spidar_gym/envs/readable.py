"""An environment's tick in Python: controller and task as a user may change them, over the engine's robot."""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np

from spidar_gym.control.estimator import Estimator
from spidar_gym.envs import single
from spidar_gym.native.plant import Plant
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.randomize import Randomization, randomize
from spidar_gym.state import Command, RobotState


class Readable(ABC):
    """Controller and task in Python."""

    plant: Plant
    estimator: Estimator
    controller: Any
    sampled_parameters: dict[str, np.ndarray]
    untouchable: tuple[str, ...]
    """Parts that had better touch nothing, of `VIOLATIONS`."""
    _nominal: PlantConfig
    _randomization: Randomization
    _disturbances: Disturbances
    _now: dict[str, Any]
    _action: np.ndarray
    _command: Command | None

    @property
    @abstractmethod
    def state(self) -> RobotState:
        """The true state of the robot."""

    @property
    def is_drawn(self) -> bool:
        """Whether robots are drawn."""
        return self._randomization.draws

    def _control_period(self) -> str:
        """Control and simulate one period; why the episode is over."""
        self._command = command = self._act(self._action)
        self._now["state"] = self.plant.step(command)
        if self.plant.diverged:
            return "diverged"
        if self._nominal.sense:
            self._now["seen"] = self.estimator.update(self.plant.measure(), command.thrust)
        return self._advance()

    def _draw_robot(self, rng: np.random.Generator) -> None:
        """Become the robot of this episode, where robots are drawn."""
        if self.is_drawn:
            config, self.sampled_parameters = randomize(self._nominal, rng, self._randomization)
            self.plant.configure(config)

    def _place(
        self, rng: np.random.Generator, *pose: np.ndarray, spent_wh: float = 0.0, motion: np.ndarray | None = None
    ) -> None:
        """Put the robot where an episode starts; pose, energy and motion are those of `Plant.reset`."""
        # A generator of its own, so that what the weather draws does not change what the next episode is.
        own = {"disturbances": self._disturbances, "rng": rng.spawn(1)[0], "spent_wh": spent_wh}
        self._now["state"] = self.plant.reset(*pose, **own, motion=motion)

    def _sense(self) -> None:
        """What is seen of the first state."""
        if self._nominal.sense:
            first = self.plant.measure()
            indicated = {"joint_position": first.joint_position, "vectoring": first.vectoring}
            self.estimator.reset(replace(self.state, **indicated))
            self._now["seen"] = self.estimator.update(first, self.state.thrust)

    @abstractmethod
    def _begin(self, rng: np.random.Generator) -> None:
        """Put the robot, the controller and the task at the start of an episode."""

    @abstractmethod
    def _act(self, action: np.ndarray) -> Command:
        """The command of this tick."""

    @abstractmethod
    def _advance(self) -> str:
        """Take note of the new state; why the episode is over, empty while it goes on."""

    @abstractmethod
    def _observation(self) -> np.ndarray:
        """What a policy sees, in the order of `layout`."""

    @abstractmethod
    def _task_info(self, failure: str) -> dict[str, Any]:
        """What the task adds to `info`: errors, reward terms, `is_success`."""

    def _info(self, failure: str) -> dict[str, Any]:
        """The same keys and shapes at every step and at reset; nothing in it is written or handed out again."""
        return {
            **single.readable_info(self.state, self._command, self.controller, self.plant, self.untouchable),
            "randomization": {name: draw.copy() for name, draw in self.sampled_parameters.items()},
            **self._task_info(failure),
            "failure": failure,
        }
