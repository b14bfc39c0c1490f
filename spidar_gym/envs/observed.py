"""What an environment shows of its robots, one or many, where that is a dictionary; and the reward of a goal."""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from spidar_gym.control.flight.observation import Field
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.goals import REWARDS, Goal
from spidar_gym.envs.observations import OBSERVATIONS, AsymmetricSight, GoalSight, Robots, Sight
from spidar_gym.envs.turns import in_turn
from spidar_gym.envs.view import View
from spidar_gym.errors import InvalidValueError, NoGoalError, closed, require_name
from spidar_gym.native.plant import Plant


class Rewarding:
    """The public functions of an environment with a goal, as in `gymnasium_robotics`; others have none."""

    sight: Sight | None
    """What is shown in place of the flat numbers, if anything."""
    is_closed: bool
    """Whether `close` was called."""

    @property
    def compute_reward(self) -> Callable[[Any, Any, Any], Any]:
        """`Goal.compute_reward` (`NoGoalError` where there is no goal)."""
        return self._goal("compute_reward").compute_reward

    @property
    def compute_terminated(self) -> Callable[[Any, Any, Any], Any]:
        """`Goal.compute_terminated` (`NoGoalError` where there is no goal)."""
        return self._goal("compute_terminated").compute_terminated

    @property
    def compute_truncated(self) -> Callable[[Any, Any, Any], Any]:
        """`Goal.compute_truncated` (`NoGoalError` where there is no goal)."""
        return self._goal("compute_truncated").compute_truncated

    def _goal(self, name: str) -> Goal:
        if self.is_closed:
            raise closed()
        if not isinstance(self.sight, GoalSight):
            raise NoGoalError(f"there is no {name} without a goal; valid: observation='goal'")
        return self.sight.goal


class Observed(Rewarding):
    """An environment of one robot."""

    goal_type: ClassVar[type[Goal] | None] = None
    """What there is to reach."""
    no_goal: ClassVar[str] = ""
    """Why there is nothing that hindsight could put in its place."""
    true_fields: ClassVar[tuple[Field, ...]] = ()
    """What of `info` only a critic may know, with its scale."""
    fleet: Fleet
    plant: Plant
    view: View
    task: Any

    def _choose_sight(
        self, observation: str, goal_reward: str, flat: spaces.Box, layout: Sequence[Field]
    ) -> Sight | None:
        """What is shown in place of the flat numbers."""
        require_name("observation", observation, OBSERVATIONS)
        require_name("goal_reward", goal_reward, REWARDS)
        if observation == "goal":
            if self.goal_type is None:
                raise InvalidValueError("observation", observation, f"vector or asymmetric: {self.no_goal}")
            if self.task.is_own:
                raise InvalidValueError("observation", observation, "vector or asymmetric: a task of one's own rewards")
            return GoalSight(flat, layout, self.goal_type(goal_reward))
        if goal_reward != "sparse":
            raise InvalidValueError("goal_reward", goal_reward, "none, or observation='goal', which has a goal")
        return AsymmetricSight(flat, self.true_fields) if observation == "asymmetric" else None

    def _show(self, flat: np.ndarray) -> Any:  # noqa: ANN401 - an array, or a dictionary of them
        """What a client is shown, of the flat numbers (size,), which are handed out."""
        if self.sight is None:
            return flat
        shown = self.sight.look(flat[None], robots_of(self.sight, self.fleet))
        return {name: rows[0].copy() for name, rows in shown.items()}

    @in_turn
    def render(self) -> Any:  # noqa: ANN401 - an array or None, as Gymnasium has it
        """Picture (height, width, 3) uint8, distances (height, width) [m], or None in the mode `human`."""
        return self.view.draw(self.plant.data.qpos, self.plant.config.ground, self.plant.period)

    def _judged(self, shown: Any, reward: float) -> float:  # noqa: ANN401 - as above
        """The reward of what is shown: that of its goal, if it has one."""
        if not isinstance(self.sight, GoalSight):
            return reward
        return float(self.sight.goal.reward(shown["achieved_goal"], shown["desired_goal"]))


def robots_of(sight: Sight, fleet: Fleet) -> Robots:
    """Robots in the engine."""
    wanted = sight.goal.wanted(fleet) if isinstance(sight, GoalSight) else None
    return Robots(fleet.robots, lambda name: fleet.infos[name], wanted)


class Shown:
    """What a vector shows of its robots; its arrays are written anew at every tick."""

    def __init__(self, sight: Sight, robots: int, *, same_step: bool) -> None:
        """Make room.

        Args:
            sight: What is shown.
            robots: Of how many.
            same_step: Whether an episode begins in the step in which the last one ends. The engine leaves that to this
                class: what its end looked like is read of robots that are still there.
        """
        self._sight, self._same_step = sight, same_step
        self.now, self.final = (
            {name: np.zeros((robots, *(space.shape or ())), np.float32) for name, space in sight.space.items()}
            for _ in range(2)
        )

    def look(self, fleet: Fleet, flat: np.ndarray) -> None:
        """Write what is now, of robots and their flat numbers."""
        for name, rows in self._sight.look(flat, robots_of(self._sight, fleet)).items():
            self.now[name][...] = rows

    def conclude(self, fleet: Fleet, ids: np.ndarray | None) -> None:
        """Go on where robots have moved: rewards of their goals, and the next episode of those at an end.

        Args:
            fleet: The robots.
            ids: Which ones have moved, all if not given.
        """
        self.look(fleet, fleet.observations)
        if isinstance(self._sight, GoalSight):
            rewards = self._sight.goal.reward(self.now["achieved_goal"], self.now["desired_goal"])
            fleet.rewards[:] = np.where(fleet.begun, 0.0, rewards)
        over = fleet.terminated | fleet.truncated
        if ids is not None:
            over[np.setdiff1d(np.arange(len(over)), ids)] = False
        if not (self._same_step and over.any()):
            return
        ended = np.flatnonzero(over)
        for name, rows in self.now.items():
            self.final[name][ended] = rows[ended]
        fleet.final_infos[ended], fleet.final_terms[ended] = fleet.infos[ended], fleet.terms[ended]
        kept = {name: getattr(fleet, name)[ended] for name in ("rewards", "terminated", "truncated")}
        fleet.reset(ended)
        for name, values in kept.items():
            getattr(fleet, name)[ended] = values
        self.look(fleet, fleet.observations)
