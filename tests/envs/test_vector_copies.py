"""Pins copies and pickles of a vector: they continue bit for bit like the original, and neither affects the other."""

import copy
import pickle
from dataclasses import dataclass
from typing import Any

import gymnasium
import jaxtyping
import numpy as np
import pytest
from support.copies import HARDEST, ROUGH, copied, pickled
from support.episodes import same

from spidar_gym.envs.registry import COURSE, CRAWL, HOVER, PATH
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import SpidarError
from spidar_gym.tasks.crawl import CrawlTask
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.task import length, tolerance

MODES = ("NextStep", "SameStep", "Disabled")


@dataclass(frozen=True)
class Circles(HoverTask):
    """A task with memory, random numbers and an option."""

    rate: float = 1.5
    """Angular frequency of the motion [rad/s]."""

    memory = (("radius", "f8"), ("gone", "f8", (2,)))
    reward_terms = {"position": (0.7, "1 / (1 + (‖position error‖ / 0.05 m)²)"), "radius": (0.3, "r")}

    def draw(self, rng):
        return {"radius": rng.uniform(0.1, 0.3)}

    def reference(self, flights):
        wanted = super().reference(flights)
        wanted["position_w"][:, 0] += flights.memory["radius"] * np.sin(self.rate * flights.time)
        return wanted

    def advance(self, flights):
        super().advance(flights)
        flights.memory["gone"] += np.abs(flights.position_error[:, :2])

    def terms(self, flights):
        off = length(flights.position_error) + 1e-3 * flights.memory["gone"].sum(axis=1)
        return {"position": tolerance(off, 0.05), "radius": flights.memory["radius"]}


class Wanders(CrawlTask):
    """A crawl task with memory."""

    memory = (("asked", "f8"),)

    def draw(self, rng):
        return {"asked": rng.uniform()}


TASKS = {HOVER: Circles(), CRAWL: Wanders()}
OWN = [
    (name, task)
    for name, task in ((HOVER, False), (PATH, False), (CRAWL, False), (COURSE, False), (HOVER, True), (CRAWL, True))
]
MANY = [pytest.param(name, task, mode, marks=pytest.mark.slow)
        for (name, task), mode in zip(OWN, (*MODES, *MODES), strict=True)]  # fmt: skip
"""Each mode occurs twice."""


def vector(name: str, robots: int, mode: str, *, own: bool = False, **options: Any) -> Any:
    """A vector with episodes of 40 steps."""
    asked: dict[str, Any] = {"max_episode_steps": 40, **ROUGH, **HARDEST[name], **options}
    if own:
        asked["task"] = copy.deepcopy(TASKS[name])
    return gymnasium.make_vec(name, num_envs=robots, autoreset_mode=mode, **asked)


def actions_for(env: Any, ticks: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.2, 0.2, (ticks, *env.action_space.shape))


def taken(env: Any, actions: np.ndarray) -> list[Any]:
    """Results of a step and, in the mode Disabled, of the reset of robots whose episode ended."""
    found = [env.step(actions)]
    over = found[0][2] | found[0][3]
    if env.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.DISABLED and over.any():
        found.append(env.reset(options={"reset_mask": over}))
    return found


def went(env: Any, actions: np.ndarray) -> list[Any]:
    return [taken(env, each) for each in actions]


def side_by_side(envs: list[Any], actions: np.ndarray) -> None:
    """Assert that vectors stepped in turn return the same."""
    for tick, each in enumerate(actions):
        first, *others = [taken(env, each) for env in envs]
        assert [same(first, other) for other in others] == [True] * len(others), tick
    first, *others = (content(env.robots) for env in envs)
    assert [first == other for other in others] == [True] * len(others)


def content(record: np.ndarray) -> bytes:
    """Bytes of a record without padding."""
    if record.dtype.names is None:
        return record.tobytes()
    return b"".join(content(record[name]) for name in record.dtype.names)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("name", "own"), OWN)
def test_copies_of_a_vector_continue_bit_for_bit_in_every_mode(name, own, mode):
    env = vector(name, 1, mode, own=own)
    early = copied(env)  # a copy of a vector that was never reset
    for each in (env, early):
        each.reset(seed=3)
        went(each, actions_for(each, 20, seed=1))
    side_by_side([env, copied(env), pickled(env), early], actions_for(env, 90, seed=2))


@pytest.mark.parametrize(("name", "own", "mode"), MANY)
def test_copies_pickles_and_restored_robots_on_two_threads_continue_bit_for_bit(name, own, mode):
    options = {"own": own, "num_threads": 2, "max_episode_steps": 50}
    if name == CRAWL:
        options["steps"] = 0.0  # a reset on tiles takes 70 ms for each robot
    env, other = (vector(name, 9, mode, **options) for _ in range(2))
    for each in (env, other):
        each.reset(seed=3)
    went(env, actions_for(env, 20, seed=1))
    other.restore(env.save())
    side_by_side([env, copied(env), pickled(env), other], actions_for(env, 90, seed=2))


@pytest.mark.parametrize("own", [False, True])
def test_a_copy_does_not_affect_the_original_and_closing_one_leaves_the_other_usable(own):
    env = vector(HOVER, 3, "SameStep", own=own)
    env.reset(seed=3)
    actions = actions_for(env, 30)
    expected = went(copied(env), actions)
    for way in (copied, pickled):
        wild = way(env)
        wild.reset(seed=9, options={"forms": "form1", "disturbances": {"lost_rotor": 1}})
        went(wild, actions_for(env, 5, seed=4))
        wild.close()
    left = pickled(env)
    assert same(went(env, actions), expected)
    env.close()
    assert same(went(left, actions), expected)
    with pytest.raises(SpidarError, match="is closed; valid: a new one"):
        copy.deepcopy(env)


def test_the_arrays_of_a_copy_show_its_own_robots():
    env = vector(HOVER, 2, "NextStep", own=True)
    env.reset(seed=0)
    other = copied(env)
    before = env.robots.tobytes(), {name: array.copy() for name, array in env.buffers.items()}
    other.step(actions_for(env, 1)[0])
    assert not any(np.shares_memory(env.buffers[name], other.buffers[name]) for name in env.buffers)
    assert env.robots.tobytes() == before[0] != other.robots.tobytes()
    assert all(np.array_equal(env.buffers[name], array) for name, array in before[1].items())
    assert (other.buffers["observations"] != before[1]["observations"]).any()


def test_a_copy_has_the_led_robots_and_the_options_of_each_robot():
    env: Any = NativeVectorEnv(HOVER, 2, action_mode="direct")
    env.fleet.ask_advice()
    winds = [{"wind": 1.0}, {"lost_rotor": 2, "fault_time": 0.3}]
    env.reset(seed=0, options={"disturbances": winds})
    env.robots["is_led"] = 1
    other = pickled(env)
    side_by_side([env, other], actions_for(env, 30))
    assert np.array_equal(env.robots["advice"]["thrust"], other.robots["advice"]["thrust"])
    env.reset()
    other.reset()
    side_by_side([env, other], actions_for(env, 15, seed=1))


@pytest.mark.parametrize("given", [None, "robots", 3])
def test_only_bytes_are_accepted_as_saved_robots(given, monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    env = NativeVectorEnv(HOVER, 1)
    env.reset(seed=0)
    with pytest.raises(SpidarError, match="no saved robots; valid: the bytes that save"):
        env.restore(given)


def test_a_pickle_of_64_robots_has_a_tenth_of_a_megabyte_each():
    env = vector(HOVER, 64, "NextStep")
    env.reset(seed=0)
    assert len(pickle.dumps(env)) < 64 * 0.12e6


@pytest.mark.parametrize("clone", [copied, pickled])
def test_a_vector_with_options_for_each_robot_is_copied_too(clone):
    vector: Any = gymnasium.make_vec(HOVER, num_envs=3, autoreset_mode="SameStep")
    given = {
        "joint_speed": [0.2, 0.4, 0.6],
        "randomization": {"body.total_mass": (15.5, 17.0)},
        "horizon_s": [1.0, 2.0, 3.0],
    }
    vector.reset(seed=2, options=given)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (80, 3, 6))
    for action in actions[:10]:
        vector.step(action)
    copy_ = clone(vector)
    expected = [copy_.step(action) for action in actions]
    assert same([vector.step(action) for action in actions], expected)
    assert same(vector.reset(options={"horizon_s": 1.5}), copy_.reset(options={"horizon_s": 1.5}))
    vector.close()
    copy_.close()
