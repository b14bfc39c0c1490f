"""Environments in their hardest configuration, comparisons of their copies, and control laws with state."""

import copy
import pickle
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any

import gymnasium
import numpy as np
from support.episodes import same

from spidar_gym.control.allocation.allocator import Allocator
from spidar_gym.control.crawl.controller import Crawler
from spidar_gym.control.crawl.gait import Gait
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import COURSE, CRAWL, GRASP, HOVER, PATH
from spidar_gym.state import Command

ROUGH: dict[str, Any] = {"sensors": True, "randomization": 1.0, "battery": True}
WEATHER = {"wind": 2.0, "push": 30.0}
STUCK = {**WEATHER, "lost_rotor": 6, "fault": "vectoring", "fault_time": 1.4}
HARDEST: dict[str, dict[str, Any]] = {
    HOVER: {"preset": "tuned", "forms": "narrow", "joint_speed": 1.0, "action_mode": "residual",
            "disturbances": STUCK},
    PATH: {"preset": "retuned", "forms": "independent", "action_mode": "residual_force",
           "disturbances": {**WEATHER, "lost_rotor": 3, "fault_time": 1.4}},
    CRAWL: {"preset": "robust", "steps": 0.01, "slope": 0.1, "action_mode": "residual_gait_force",
            "disturbances": WEATHER},
    COURSE: {"hold": 1, "disturbances": WEATHER},
    GRASP: {"disturbances": WEATHER, "shapes": ("box", "ball")},
}  # fmt: skip
"""By id; `hardest` adds `ROUGH`."""
CONTROLS = ("core", "python")
STEPS = 150
"""Length of an episode, short enough that a copy ends one episode and begins the next."""


def hardest(name: str, control: str, **options: Any) -> Any:
    """Make an environment in its hardest configuration, with gymnasium's wrappers."""
    asked = {"max_episode_steps": STEPS, **ROUGH, **HARDEST[name], **options}
    return gymnasium.make(name, control=control, **asked)


def actions_for(env: Any, ticks: int, seed: int = 0) -> np.ndarray:
    """Small random actions, with which a robot keeps flying."""
    shape = ticks, *env.action_space.shape
    return np.random.default_rng(seed).uniform(-0.2, 0.2, shape).astype(np.float32)


def taken(env: Any, action: np.ndarray) -> list[Any]:
    """Results of a step and, if it ends the episode, of the reset after it."""
    found = [env.step(action)]
    return [*found, env.reset()] if found[0][2] or found[0][3] else found


def went(env: Any, actions: np.ndarray) -> list[Any]:
    """Results of all steps, and the final state of the environment's generator."""
    steps = [taken(env, action) for action in actions]
    rng = env.unwrapped.np_random
    return [*steps, rng.bit_generator.state, rng.spawn(1)[0].bit_generator.state]


def copied(env: Any) -> Any:
    """Copy by `copy.deepcopy`."""
    return copy.deepcopy(env)


def pickled(env: Any) -> Any:
    """Copy by a pickle."""
    return pickle.loads(pickle.dumps(env))


def assert_side_by_side(envs: list[Any], actions: np.ndarray) -> None:
    """Assert that environments stepped in turn return the same."""
    for tick, action in enumerate(actions):
        first, *others = [taken(env, action) for env in envs]
        assert [same(first, other) for other in others] == [True] * len(others), tick
    first, *others = [went(env, actions[:0]) for env in envs]
    assert [same(first, other) for other in others] == [True] * len(others)


# ---- control laws and environments with additional state ----


class Braced(FlightController):
    """The control law of the guide: from its first tick on it stores an array in an attribute of the subclass."""

    def compute_wrench(self, state, reference, control_state, joints):
        wrench, integrals, compensation = super().compute_wrench(state, reference, control_state, joints)
        h = control_state.snapshot.momentum_map[3:] @ ((joints - self.memory.joint_position) / self.dt)
        if self.last_step is not None:
            wrench[3:] += (h - self.before) / self.dt
        self.before = h
        return wrench, integrals, compensation


@dataclass
class Habits:
    """State of `Restless`."""

    wrenches: deque = field(default_factory=lambda: deque(maxlen=5))
    by_name: dict = field(default_factory=dict)
    ticks: int = 0


class Restless(FlightController):
    """A control law with a custom dataclass and a generator, which reads the preview of the reference."""

    def reset(self, state, joint_position=None, trim=None):
        super().reset(state, joint_position, trim)
        self.habits, self.rng, self.odd = Habits(), np.random.default_rng(5), np.nan

    def compute_wrench(self, state, reference, control_state, joints):
        wrench, integrals, compensation = super().compute_wrench(state, reference, control_state, joints)
        habits = self.habits
        assert self.preview is not None
        later = self.preview(0.5).joint_target
        habits.ticks += 1
        habits.by_name["turn", habits.ticks % 3] = float(np.abs(later - joints).max())
        habits.wrenches.append(wrench + self.rng.normal(0.0, 0.2, 6))
        more = np.mean(list(habits.wrenches), axis=0) - wrench
        return wrench + 0.1 * more + 1e-3 * sum(habits.by_name.values()), integrals, compensation


class Reluctant(Allocator):
    """An allocator that mixes its previous answer into the next."""

    before = None

    def allocate(self, demand, mode, previous_l, guess=None):
        found = super().allocate(demand, mode, previous_l, guess)
        before = found.forces_l if self.before is None else self.before
        self.before = 0.9 * found.forces_l + 0.1 * before
        forces = self.before.copy()
        return replace(found, forces_l=forces, thrust=np.linalg.norm(forces, axis=1))


class Hurried(Gait):
    """A gait that counts its calls."""

    asked = 0

    def step(self, position_w, R_wb, q, residual=None):
        self.asked += 1
        return super().step(position_w, R_wb, q + 1e-6 * (self.asked % 7))


class Hurrying(Crawler):
    """A crawler with a custom gait."""

    gait_type = Hurried


class Filtered(FlightController):
    """A control law that stores a lambda, which cannot be saved."""

    def reset(self, state, joint_position=None, trim=None):
        super().reset(state, joint_position, trim)
        self.weigh = lambda error: 2.0 * error


class ClimbEnv(HoverEnv):
    """The guide's custom task with a stored drift: the core flies, the reference is computed in Python."""

    def reference(self):
        hover = super().reference()
        way = np.array([0.0, 0.0, 0.05])
        return replace(hover, position_w=hover.position_w + self.progress.time * way + self.drift, velocity_w=way)

    def _begin(self, rng):
        self.drift = np.zeros(3)
        super()._begin(rng)

    def _act(self, action) -> Command:
        self.drift = self.drift + 1e-4 * self.np_random.normal(size=3)
        return super()._act(action)
