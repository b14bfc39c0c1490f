"""Compares the core with the Python controllers, state by state: commands, observations, `info` and rewards.

CI compares some of the states; `SPIDAR_STATES=10000 pytest -n0 -s tests/envs/test_controllers_agree.py` compares all
in minutes. `tests/native/test_plant.py` compares the plant itself with a Python implementation.
"""

import os
from typing import Any

import mujoco
import numpy as np
import pytest
from support.vectors import expected

from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.native.mujoco import STATE
from spidar_gym.robot import ROBOT
from spidar_gym.sim.scene import scene
from spidar_gym.tasks.crawl import CrawlTask
from spidar_gym.tasks.hover import HoverTask

pytestmark = pytest.mark.slow
STATES = int(os.environ.get("SPIDAR_STATES", "200"))
EPISODE = 400
"""Ticks after which the next episode begins."""
FLIGHT = (HoverEnv, HOVER, HoverTask.reward_terms, HoverTask.failures, 0.3)
GROUND = (CrawlEnv, CRAWL, CrawlTask.reward_terms, CrawlTask.failures, 0.2)
REAL: dict[str, Any] = {"randomization": 1.0, "sensors": True}
TORSO_AXES: dict[str, Any] = {"action_mode": "torso_forces", "hold": 2, "observation": "scaled", **REAL}
TOLERANCE = 1e-11
"""Relative to max(1, |number|)."""
KINDS = {
    "flights": (*FLIGHT, {}),
    "flights of drawn robots with sensors": (*FLIGHT, {"preset": "tuned", **REAL}),
    "flights in torso axes": (*FLIGHT, {"preset": "steady", **TORSO_AXES}),
    "crawls in torso axes": (*GROUND, TORSO_AXES),
    "crawls": (*GROUND, {"preset": "robust"}),
    "crawls of drawn robots with sensors": (*GROUND, {"preset": "robust", **REAL}),
}


@pytest.fixture
def converged():
    """Let MuJoCo's solver of contacts converge.

    With its default tolerance, a change of one unit in the last place before a tick can let the line search of an
    iteration end elsewhere: velocities 1e-12 rad/s apart, which the servos' damping turns into torques 2e-11 N·m apart.
    """
    models = [scene(visual=False, uneven=uneven, boxed=False, robot=ROBOT, free=False) for uneven in (False, True)]
    usual = [model.opt.tolerance for model in models]
    for model in models:
        model.opt.tolerance = 0.0
    yield
    for model, tolerance in zip(models, usual, strict=True):
        model.opt.tolerance = tolerance


@pytest.mark.usefixtures("converged")
@pytest.mark.parametrize("kind", KINDS)
def test_from_the_same_state_both_controllers_lead_to_the_same_next_state(kind):
    make, name, terms, failures, size, options = KINDS[kind]
    vector = NativeVectorEnv(name, 1, autoreset_mode="Disabled", **options)
    env = make(control="python", **options)
    assert env.plant.model.opt.tolerance == 0.0
    rng, worst = np.random.default_rng(8), {}

    def look(title, one, other, rounding=0.0):
        one, other = np.asarray(one, float), np.reshape(np.asarray(other, float), np.shape(one))
        apart = np.maximum(np.abs(one - other) - rounding, 0.0)
        apart = float((apart / np.maximum(1.0, np.abs(one))).max(initial=0.0))
        worst.setdefault(title, []).append(apart)

    episode, ticks = 0, EPISODE
    for _ in range(STATES):
        if ticks == EPISODE:
            (first, info), (seen, told) = env.reset(seed=episode), vector.reset(seed=episode)
            look("first observation", first, seen[0])
            episode, ticks = episode + 1, 0
        action = rng.normal(0.0, size, env.action_space.shape).astype(np.float32)
        first, reward, terminated, _, info = env.step(action)
        seen, rewards, ended, _, told = vector.step(action[None])
        truth = vector.robots[0]["plant"]["state"]
        for title in ("position_w", "quat_wb", "velocity_w", "omega_b", "joint_position", "joint_velocity", "thrust"):
            look(f"state, {title}", getattr(env.state, title), truth[title])
        # Single precision: two numbers that are almost equal may be rounded to neighbours.
        look("observation", first, seen[0], np.spacing(np.abs(first)))
        look("reward", reward, rewards[0])
        look("terminated", terminated, ended[0])
        for title, value in expected(info, terms, failures).items():
            look(title, value, told[title][0])
        ticks = EPISODE if terminated else ticks + 1
        # Both begin the next tick in the same state.
        row = vector.robots[0]["plant"]["row"][: mujoco.mj_stateSize(env.plant.model, STATE)]
        mujoco.mj_setState(env.plant.model, env.plant.data, row, STATE)
    figures = {title: (max(found), float(np.median(found))) for title, found in worst.items()}
    far = sorted(figures.items(), key=lambda item: -item[1][0])
    print(f"{kind}: {STATES} states, {episode} episodes; farthest apart:")
    for title, (most, median) in far[:4]:
        print(f"  {title}: {most:.1e}, median {median:.1e}")
    assert {title: most for title, (most, _) in figures.items() if most > TOLERANCE} == {}
    vector.close()
    env.close()
