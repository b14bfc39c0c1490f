"""Flights that people steer: reference and form change while they fly, by what every task in Python may change."""

import math
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.hover.env import HoverEnv
from spidar_gym.envs.hover.task import FormGoal
from spidar_gym.envs.path.env import PathEnv
from spidar_gym.state import Reference
from spidar_gym.viz.live.helm import Helm


class SteeredHover(HoverEnv):
    """A hover whose reference somebody moves, and whose form somebody chooses, in flight."""

    def __init__(self, **options: Any) -> None:  # noqa: ANN401 - those of the hover
        """Build the hover; arguments and errors are its own."""
        self.helm = Helm()
        """Where the reference is to go."""
        super().__init__(**options)

    def _begin(self, rng: np.random.Generator) -> None:
        self.helm = Helm()
        super()._begin(rng)

    def reference(self) -> Reference:
        """The task's reference, moved by the helm."""
        self.helm.advance(self.progress.ticks)
        return self.helm.applied(super().reference())

    def reference_ahead(self, seconds: float) -> Reference:
        """What is known of what comes: a path, moved as far as the helm has come."""
        ahead = super().reference_ahead(seconds)
        return ahead if self.path is None else self.helm.applied(ahead)

    def take_form(self, joint_target: JointVector) -> None:
        """Let the legs move to this form from now on, in place of whatever was to come [rad]."""
        self._go_on([FormGoal(0.0, 0.0, joint_target)])

    def take_forms(self) -> None:
        """Let the legs go through the forms of the task, drawn anew, from now on."""
        self._go_on(self.task.schedule(self.np_random))

    def _go_on(self, goals: list[FormGoal]) -> None:
        progress = self.progress
        now, plan = progress.time, progress.plan()
        begin = now + 1.0 / CONTROL_RATE
        travel = float(np.abs(goals[0].joint_target - plan).max()) / self.task.joint_speed
        # The legs are on their way from where the plan has them: the goals from there on are other ones.
        shift = begin + math.ceil(travel * CONTROL_RATE) / CONTROL_RATE
        first = FormGoal(begin, begin + travel, goals[0].joint_target)
        later = [FormGoal(goal.start + shift, goal.deadline + shift, goal.joint_target) for goal in goals[1:]]
        progress.goals[progress.current :] = [FormGoal(now, now, plan), first, *later]


class SteeredPath(SteeredHover, PathEnv):
    """A path whose reference somebody moves besides, and on which somebody chooses the form."""
