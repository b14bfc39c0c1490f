"""Flights that users steer: the reference and the form change during the episode."""

import math
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.path_env import PathEnv
from spidar_gym.native.plant import read_reference
from spidar_gym.native.structs import fill
from spidar_gym.state import Reference
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.path import PathTask
from spidar_gym.tasks.robots import HoverRobots
from spidar_gym.tasks.start import FormGoal, draw_start
from spidar_gym.viz.live.helm import Helm


class SteeredHoverTask(HoverTask):
    """A hover whose reference is moved by a helm."""

    helm: Any = None
    """The environment's helm."""

    def reference(self, robots: HoverRobots) -> np.ndarray:
        """Return the reference of the schedule, moved by the helm."""
        wanted = super().reference(robots)
        self.helm.advance(int(robots.ticks[0]))
        fill(wanted[0], self.helm.applied(read_reference(wanted[0])))
        return wanted


class SteeredPathTask(SteeredHoverTask, PathTask):
    """A path whose reference is moved by a helm."""


class SteeredHover(HoverEnv):
    """A hover whose reference and form a user changes in flight."""

    task_type = SteeredHoverTask

    def __init__(self, **options: Any) -> None:  # noqa: ANN401 - those of the hover
        """Build the hover; arguments and errors are those of `HoverEnv`."""
        self.helm = Helm()
        """Offset of the reference and its goal."""
        super().__init__(**options)
        object.__setattr__(self.task, "helm", self.helm)

    def _prepare(self, fleet: Any) -> None:  # noqa: ANN401 - as there
        self.helm = Helm()
        object.__setattr__(self.task, "helm", self.helm)
        super()._prepare(fleet)

    def reference_ahead(self, seconds: float) -> Reference:
        """Return the future reference; on a path it is moved by the helm's present offset."""
        ahead = super().reference_ahead(seconds)
        return ahead if self.path is None else self.helm.applied(ahead)

    def take_form(self, joint_target: JointVector) -> None:
        """Move the legs to this form from now on, in place of the scheduled forms [rad]."""
        self._go_on([FormGoal(0.0, 0.0, joint_target)])

    def take_forms(self) -> None:
        """Sample a new sequence of the task's forms and move the legs through it from now on."""
        self._go_on(list(draw_start(self.task, self.np_random).goals))

    def _go_on(self, goals: list[FormGoal]) -> None:
        """Replace the remaining schedule by other forms, starting from the planned joint angles."""
        progress = self.progress
        now, plan = progress.time, progress.plan()
        begin = now + 1.0 / CONTROL_RATE
        travel = float(np.abs(goals[0].joint_target - plan).max()) / self.task.joint_speed
        shift = begin + math.ceil(travel * CONTROL_RATE) / CONTROL_RATE
        first = FormGoal(begin, begin + travel, goals[0].joint_target)
        later = [FormGoal(goal.start + shift, goal.deadline + shift, goal.joint_target) for goal in goals[1:]]
        self.fleet.reschedule(0, [*progress.goals[: progress.current], FormGoal(now, now, plan), first, *later])
        self._now = {}


class SteeredPath(SteeredHover, PathEnv):
    """A path whose reference and form a user changes in flight."""

    task_type = SteeredPathTask
