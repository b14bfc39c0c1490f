"""Pins tasks of many robots: ends and successes, and that a custom task acts as defined at nearly full speed."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from support.vectors import speed_share

from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.model.dynamics import Model
from spidar_gym.native.draws import to_numpy
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.tasks import crawl
from spidar_gym.tasks.crawl import CrawlTask
from spidar_gym.tasks.hover import HoverTask, hover_height
from spidar_gym.tasks.task import length, tolerance

RATE = 2.0 * math.pi / 12.0
MODES = ("NextStep", "SameStep", "Disabled")


@pytest.mark.parametrize("mode", MODES)
def test_a_success_and_its_forms_are_those_of_the_episode_that_has_ended(mode):
    options: dict[str, Any] = {"forms": "equal", "joint_speed": 0.6, "horizon_s": 6.0, "autoreset_mode": mode}
    vector = NativeVectorEnv(HOVER, 4, **options)
    vector.reset(seed=3)
    for tick in range(240):
        *_, truncated, info = vector.step(np.zeros((4, 6)))
        assert truncated.all() == (tick == 239)
    end = info["final_info"] if mode == "SameStep" else info
    assert end["is_success"].any()
    assert not (mode == "SameStep" and info["is_success"].any())
    if mode != "SameStep":
        assert np.array_equal(info["is_success"], vector.fleet.quantities["overdue"] == 0.0)
    vector.close()


@pytest.mark.parametrize(
    ("word", "bound", "value"), [("duct", None, 0.0), ("tilt", "MAX_TILT", 0.02), ("astray", "MAX_ASTRAY", 0.0005)]
)
def test_a_crawl_ends_with_the_word_for_the_exceeded_bound(monkeypatch, word, bound, value):
    """Random joint motions without thrust, with a bound so narrow that it is exceeded first."""
    if bound:
        monkeypatch.setattr(crawl, bound, value)
    vector = NativeVectorEnv(CRAWL, 6, autoreset_mode="SameStep", max_episode_steps=80, action_mode="direct")
    vector.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (6, vector.single_action_space.shape[0]))
    actions[:, :8] = -1.0
    over = set()
    for _ in range(80):
        *_, found, _, info = vector.step(actions)
        if found.any():
            over |= {list(CrawlTask.failures)[code] for code in info["final_info"]["failure_code"][found]}
            tilts, ways = info["final_info"]["tilt_rad"][found], info["final_info"]["goal_error"][found]
            assert bound != "MAX_TILT" or (tilts > value).any()
            assert np.isfinite(ways).all()
    assert word in over
    vector.close()


STROLL_TERMS = {
    "pace": (0.7, "1 − 1 / (1 + (speed / 0.05 m/s)²)"),
    "level": (0.3, "1 / (1 + (tilt / 0.03 rad)²)"),
}
STROLL_FAILURES = {"idle": "the torso has been slower than 2 cm/s for a second", "diverged": "no longer finite"}


class Stroll(CrawlTask):
    """Keep the torso moving."""

    reward_terms, failures = STROLL_TERMS, STROLL_FAILURES
    memory = (("still", "f8"),)

    def advance(self, walks):
        """Count the time at rest."""
        speed = length(walks.state["velocity_w"])
        walks.memory["still"] = np.where(speed < 0.02, walks.memory["still"] + 0.025, 0.0)

    def terms(self, walks):
        """Pace and level."""
        speed = length(walks.state["velocity_w"])
        return {"pace": 1.0 - tolerance(speed, 0.05), "level": tolerance(walks.tilt, 0.03)}

    def failed(self, walks):
        """Robots that stand still."""
        return {"idle": walks.memory["still"] >= 1.0}

    def succeeded(self, walks):
        """Robots that still walk at the end."""
        return walks.ticks >= walks.horizon


def test_a_custom_crawl_task_rewards_and_ends_as_defined():
    vector = NativeVectorEnv(CRAWL, 3, task=Stroll(), autoreset_mode="NextStep")
    vector.reset(seed=1)
    size = vector.single_action_space.shape[0]
    ended = np.zeros(3, bool)
    for _ in range(120):
        *_, rewards, terminated, _, info = vector.step(np.zeros((3, size)))
        moving = length(vector.robots["plant"]["state"]["velocity_w"])
        if not vector.fleet.begun.any():
            pace = 1.0 - tolerance(moving, 0.05)
            level = tolerance(vector.robots["tilt"], 0.03)
            np.testing.assert_allclose(rewards, 0.7 * pace + 0.3 * level, rtol=0, atol=1e-12)
            np.testing.assert_allclose(info["term"], np.stack([pace, level], 1), rtol=0, atol=1e-12)
        assert (info["failure_code"][terminated] == 0).all()
        ended |= terminated
    assert ended.all(), "the torso rests while legs are lifted"
    vector.close()


TERMS = {
    "position": (0.5, "1 / (1 + (‖position error‖ / 0.05 m)²)"),
    "velocity": (0.5, "1 / (1 + (‖velocity error‖ / 0.1 m/s)²)"),
}
FAILURES = {
    "low": "the torso is below 0.3 m",
    "off": "the CoG is more than 0.5 m off",
    "diverged": "no longer finite",
}


class Circles(HoverTask):
    """Fly circles of random radius, one in 12 s; the episode ends if the torso is too low."""

    reward_terms, failures = TERMS, FAILURES
    memory = (("radius", "f8"), ("way_w", "f8", (3,)))

    def draw(self, rng):
        """Draw a radius [m]."""
        return {"radius": rng.uniform(0.1, 0.3)}

    def reference(self, flights):
        """The hover's reference, moved along the circle."""
        wanted, angle, radius = super().reference(flights), RATE * flights.time, flights.memory["radius"]
        wanted["position_w"][:, 0] += radius * (np.cos(angle) - 1.0)
        wanted["position_w"][:, 1] += radius * np.sin(angle)
        wanted["velocity_w"][:, 0] = -radius * RATE * np.sin(angle)
        wanted["velocity_w"][:, 1] = radius * RATE * np.cos(angle)
        return wanted

    def advance(self, flights):
        """Sum up the velocities."""
        super().advance(flights)
        flights.memory["way_w"] += flights.state["velocity_w"]

    def terms(self, flights):
        """Position and velocity."""
        return {
            "position": tolerance(length(flights.position_error), 0.05),
            "velocity": tolerance(length(flights.error["velocity_w"]), 0.1),
        }

    def failed(self, flights):
        """Robots that are too low or too far off."""
        return {
            "low": flights.state["position_w"][:, 2] < 0.3,
            "off": length(flights.position_error) > 0.5,
        }

    def succeeded(self, flights):
        """Robots that still fly at the end."""
        return flights.ticks >= flights.horizon


@pytest.mark.parametrize("control", ["core", "python"])
def test_a_custom_task_is_flown_alike_by_many_robots_by_one_and_by_a_python_controller(control):
    options: dict[str, Any] = {"forms": "independent", "disturbances": {"lost_rotor": 3, "fault_time": 0.5}}
    vector: Any = gymnasium.make_vec(HOVER, num_envs=3, task=Circles(), **options)
    singles: list[Any] = [HoverEnv(control=control, task=Circles, **options) for _ in range(3)]
    seen, _ = vector.reset(seed=5)
    exact = {"rtol": 0, "atol": 0.0 if control == "core" else 1e-9}
    for k, single in enumerate(singles):
        np.testing.assert_allclose(single.reset(seed=5 + k)[0], seen[k], rtol=0, atol=exact["atol"] and 1e-6)
        radius = single.fleet.memory["radius"][0]
        assert radius == vector.fleet.memory["radius"][k]
        assert 0.1 <= radius <= 0.3
        drawn = to_numpy(vector.robots[k]["episode"]["generator"])
        assert drawn.bit_generator.state == single.np_random.bit_generator.state
    rng, hover = np.random.default_rng(0), hover_height()
    for tick in range(1, 61):
        actions = rng.normal(0.0, 0.3, (3, 6)).astype(np.float32)
        seen, rewards, *_, info = vector.step(actions)
        for k, single in enumerate(singles):
            _, reward, *_, told = single.step(actions[k])
            np.testing.assert_allclose(info["position_error"][k], told["position_error"], **exact)
            np.testing.assert_allclose(rewards[k], reward, **exact)
            # The present error by hand: the point on the circle minus the CoG by the description.
            radius, angle = single.fleet.memory["radius"][0], RATE * tick / 40.0
            place = np.array([radius * (math.cos(angle) - 1.0), radius * math.sin(angle), hover])
            state, R_wb = single.state, quat_to_matrix(single.state.quat_wb)
            com_w = state.position_w + R_wb @ Model().snapshot(state.joint_position, R_wb, state.vectoring).com_b
            np.testing.assert_allclose(told["position_error"], place - com_w, rtol=0, atol=1e-9)
            near = 1.0 / (1.0 + (np.linalg.norm(told["position_error"]) / 0.05) ** 2)
            assert told["reward_position"] == pytest.approx(near, abs=1e-12)
            assert reward == 0.5 * told["reward_position"] + 0.5 * told["reward_velocity"]
    vector.close()


def episodes(robots, seeds, mode, threads=1, ticks=60):
    """Observations and terms of robots with these seeds, by episode, with actions from each robot's seed."""
    options: dict[str, Any] = {"action_mode": "direct", "forms": "form1", "max_episode_steps": 25}
    env = NativeVectorEnv(HOVER, robots, num_threads=threads, task=Circles(), autoreset_mode=mode, **options)
    seen, _ = env.reset(seed=seeds)
    visited = [[[row.tobytes()]] for row in seen]
    generators = [np.random.default_rng(s) for s in seeds]
    actions, taken, over = np.zeros((robots, 40)), np.zeros(robots, int), np.zeros(robots, bool)
    words = set()
    while taken.min() < ticks:
        begins = over & (mode == "NextStep")
        for k in np.flatnonzero(~begins):
            rng = generators[k]
            actions[k] = np.concatenate([rng.uniform(-0.6, 0.0, 8), rng.normal(0.0, 0.1, 32)])
        taken += ~begins
        seen, rewards, terminated, truncated, info = env.step(actions)
        over = terminated | truncated
        words |= {*info["failure_code"][over].tolist()}
        for k in range(robots):
            if begins[k]:
                assert rewards[k] == 0.0
                assert not over[k]
                visited[k].append([seen[k].tobytes()])
            elif over[k] and mode == "SameStep":
                visited[k][-1].append(info["final_obs"][k].tobytes() + info["final_info"]["term"][k].tobytes())
                visited[k].append([seen[k].tobytes()])
            else:
                visited[k][-1].append(seen[k].tobytes() + info["term"][k].tobytes())
        if mode == "Disabled" and over.any():
            seen, _ = env.reset(options={"reset_mask": over})
            for k in np.flatnonzero(over):
                visited[k].append([seen[k].tobytes()])
    env.close()
    return {s: visited[k][:2] for k, s in enumerate(seeds)}


def test_a_custom_task_gives_the_same_bits_beside_any_robots_and_in_every_autoreset_mode():
    whole = episodes(9, list(range(9)), "NextStep")
    assert all(len(visited) == 2 for visited in whole.values())
    for mode in MODES:
        assert episodes(9, [8, 0, 3, 7, 1, 2, 6, 5, 4], mode, threads=2) == whole
        assert episodes(1, [4], mode) == {4: whole[4]}


def test_a_custom_tasks_memory_is_saved_with_the_robot_and_needs_the_same_task():
    one, other = (NativeVectorEnv(HOVER, n, task=Circles(), max_episode_steps=20) for n in (2, 3))
    one.reset(seed=1)
    other.reset(seed=9)
    for _ in range(7):
        one.step(np.zeros((2, 6)))
    saved = one.save([1])
    other.restore(saved, [2])
    for _ in range(30):
        seen, rewards, *_, info = one.step(np.zeros((2, 6)))
        shown, others, *_, told = other.step(np.zeros((3, 6)))
        assert np.array_equal(seen[1], shown[2])
        assert rewards[1] == others[2]
        assert np.array_equal(info["term"][1], told["term"][2])
    built_in = NativeVectorEnv(HOVER, 1, max_episode_steps=20)
    built_in.reset()
    with pytest.raises(SpidarError, match=r"another task: '.*Circles'; valid here: spidar_gym.tasks.hover.HoverTask"):
        built_in.restore(saved, [0])
    for vector in (one, other, built_in):
        vector.close()


def test_a_diverged_robot_has_the_code_for_divergence_in_the_tasks_table():
    env = NativeVectorEnv(HOVER, 2, task=Circles(), autoreset_mode="Disabled")
    env.reset(seed=0)
    env.robots["plant"]["row"][1, 40:78] = 1e30
    seen, rewards, terminated, _, info = env.step(np.zeros((2, 6)))
    assert terminated.tolist() == [False, True]
    assert info["failure_code"].tolist() == [-1, 2]
    assert rewards[1] == 0.0
    assert not info["term"][1].any()
    assert not seen[1].any()
    env.close()


class Unweighted(Circles):
    """A task whose weights add up to more than 1."""

    reward_terms = TERMS | {"position": (0.7, "")}


class Speechless(Circles):
    """A task without the engine's word for divergence."""

    failures = dict.fromkeys(("low", "off"), "")


class Forgetful(Circles):
    """A task which does not compute a term of its table."""

    def terms(self, flights):
        """One of two terms."""
        return {"position": super().terms(flights)["position"]}


class Misshapen(Circles):
    """A task with one number for all robots."""

    def terms(self, flights):
        """A mean instead of an entry for every robot."""
        terms = super().terms(flights)
        return {**terms, "velocity": terms["velocity"].mean()}


def test_a_task_that_does_not_fit_is_refused_in_one_line():
    for task, words in ((Unweighted(), "add up to 1"), (Speechless(), "failures with diverged")):
        with pytest.raises(InvalidValueError, match=words):
            NativeVectorEnv(HOVER, 1, task=task)
    given: list[tuple[Circles, str]] = [
        (Forgetful(), "an array for each of position, velocity"), (Misshapen(), r"velocity = .* of shape \(2,\)")
    ]  # fmt: skip
    for task, words in given:
        env = NativeVectorEnv(HOVER, 2, task=task)
        with pytest.raises(InvalidValueError, match=words) as error:
            env.reset(seed=0)
        assert "\n" not in str(error.value)
        env.close()
    with pytest.raises(InvalidValueError, match="CrawlTask"):
        NativeVectorEnv(CRAWL, 1, task=Circles())


@pytest.mark.slow
def test_a_custom_task_runs_at_four_fifths_of_the_speed_of_the_built_in_task():
    built_in, own = (NativeVectorEnv(HOVER, 64, task=task) for task in (None, Circles()))
    assert speed_share(built_in, own) >= 0.8
