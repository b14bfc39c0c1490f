"""Tests rewards with a slope everywhere: progress adds up, doing nothing does not pay, success ends an episode."""

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.actions import TORSO
from spidar_gym.envs.registry import COURSE, CRAWL, HOVER, PATH
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.tasks.crawl import CrawlTask
from spidar_gym.tasks.sloped import PER_WH, WHOLE, SlopedSteps

CLASSICAL = {
    HOVER: {"preset": "steady"}, PATH: {"preset": "steady"},
    CRAWL: {"preset": "steady_crawl", "hold": 10, "distance": 0.4, "turn": 0.0},
    COURSE: {"action_mode": "residual", "hold": 20, "count": (0, 0), "floors": ("plain",), "horizon_s": 90.0},
}  # fmt: skip
"""The controllers by which a return is judged."""


def played(name, action, robots=2, steps=None, **options):
    """Returns of one episode each with the same action, final infos, and the vector."""
    vector = gymnasium.make_vec(name, num_envs=robots, reward="sloped", autoreset_mode="Disabled", **options)
    vector.reset(seed=5)
    returns, going = np.zeros(robots), np.ones(robots, bool)
    for _ in range(steps or 10000):
        _, rewards, ended, cut, info = vector.step(
            np.broadcast_to(action, vector.action_space.shape).astype(np.float32)
        )
        returns += rewards * going
        going &= ~(ended | cut)
        if not going.any():
            break
    return returns, {name: np.copy(values) for name, values in info.items()}, vector


@pytest.mark.slow
@pytest.mark.parametrize("name", CLASSICAL)
def test_lying_still_falling_at_once_and_a_constant_push_bring_at_most_a_tenth_of_the_best(name):
    best = played(name, 0.0, **CLASSICAL[name])[0].mean()
    own = {key: value for key, value in CLASSICAL[name].items() if key not in ("preset", "action_mode")}
    own |= {"action_mode": TORSO, "horizon_s": 20.0 if name in (HOVER, PATH) else 75.0}
    still, down, push = np.zeros(40), np.zeros(40), np.zeros(40)
    down[2:24:3], push[:24:3] = -1.0, -1.0
    own["action_scale"] = {"force": 10.0}
    for lazy in (still, down, push) if name in (CRAWL, COURSE) else (down,):
        assert played(name, lazy, **own)[0].mean() <= 0.1 * best
    if name in (HOVER, PATH):  # as the zero action of the mode, which drifts away
        assert played(name, still, **own)[0].mean() <= 0.1 * best


@pytest.mark.parametrize("autoreset", ["NextStep", "SameStep"])
def test_progress_and_energy_add_up_to_what_the_episodes_have_brought(autoreset):
    options = {"action_mode": "direct", "randomization": 1.0, "joint_speed": 0.8, "horizon_s": 1.0}
    vector = gymnasium.make_vec(CRAWL, num_envs=4, reward="sloped", autoreset_mode=autoreset, **options)
    vector.reset(seed=2)
    assert list(vector.task.reward_terms) == ["progress", "arrival", "energy"]
    fleet, rng, thrusts = vector.fleet, np.random.default_rng(3), np.r_[np.full(8, -0.6), np.zeros(32)]
    is_same, sums, ends = autoreset == "SameStep", np.zeros((4, 3)), 0
    for _ in range(120):
        way = fleet.view.initial_distance.copy()
        actions = thrusts + rng.normal(0.0, 0.05, (4, 40))
        _, _, ended, cut, _ = vector.step(actions.astype(np.float32))
        over = ended | cut
        sums += np.where(over[:, None] & is_same, fleet.final_terms, fleet.terms)
        info = (fleet.final_infos if is_same else fleet.infos)[over]
        x, y, yaw = info["goal_error"].T
        share = 1.0 - (np.hypot(x, y) + 0.5 * np.abs(yaw)) / way[over]
        np.testing.assert_allclose(sums[over, 0], WHOLE * share, atol=1e-9)
        np.testing.assert_allclose(sums[over, 2], -PER_WH * info["info"]["energy_wh"], atol=1e-12)
        sums[over] = 0.0
        ends += over.sum()
    assert ends >= 8


def test_a_success_ends_the_episode_without_a_failure():
    _, info, vector = played(CRAWL, 0.0, **CLASSICAL[CRAWL])
    assert vector.fleet.terminated.all()
    assert not vector.fleet.truncated.any()
    assert info["is_success"].all()
    assert (info["failure_code"] == -1).all()
    assert (vector.fleet.view.position_error <= 0.05).all()
    assert (info["shortfalls_code"] == 0).all(), "a success misses no criterion"


@pytest.mark.parametrize("name", [HOVER, PATH])
def test_the_terms_of_a_flight_fall_with_the_error_at_any_distance(name):
    vector = gymnasium.make_vec(name, num_envs=1, reward="sloped")
    view, errors = vector.fleet.view, np.array([0.0, 0.01, 0.1, 0.5, 1.0, 5.0])
    words, values = ("position", "attitude", "velocity", "turning", "still", "level"), []
    for error in errors:
        view.distance[0] = view.angle[0] = error
        view.error["velocity_w"][0] = view.error["omega_b"][0] = [0.0, error, 0.0]
        values.append([float(vector.task.terms(view)[word][0]) for word in words])
    drops = -np.diff(np.array(values), axis=0)
    assert (drops > 0.0).all()
    assert (drops[:, :4] / np.diff(errors)[:, None] > 0.005).all()


@pytest.mark.parametrize("terrain", ["tiles", "stairs"])
def test_the_heights_in_sight_are_those_of_the_floor_at_the_points_ahead_of_a_turned_robot(terrain):
    options = {"task": SlopedSteps, "steps": 0.05, "terrain": terrain, "action_mode": TORSO}
    env = gymnasium.make(CRAWL, **options).unwrapped
    env.reset(seed=4)
    state, seen = env.fleet.robots["episode"]["seen"][0], []
    for yaw, x, y in ((0.0, 0.0, 0.0), (0.7, 0.3, -0.4), (-2.1, -0.2, 0.6)):
        state["quat_wb"], state["position_w"][:2] = [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)], (x, y)
        ahead, left = (
            each.reshape(-1) for each in np.meshgrid(0.25 * np.arange(-2, 5), 0.25 * np.arange(-2, 3), indexing="ij")
        )
        points = np.stack(
            [x + np.cos(yaw) * ahead - np.sin(yaw) * left, y + np.sin(yaw) * ahead + np.cos(yaw) * left, 0 * ahead], 1
        )
        found = env.task.observe(env.fleet.view)["heights"][0]
        assert np.array_equal(found, np.maximum(env.plant.config.ground.height(points), 0.0))
        seen.append(found)
    assert np.ptp(seen) > 0.02


def test_a_reward_that_is_not_valid_is_refused_in_one_line():
    with pytest.raises(UnknownNameError, match="narrow, sloped"):
        gymnasium.make(HOVER, reward="wide")
    with pytest.raises(InvalidValueError, match="custom task"):
        gymnasium.make(CRAWL, reward="sloped", task=CrawlTask())
    with pytest.raises(InvalidValueError, match="arrival_position"):
        gymnasium.make(CRAWL, reward="sloped", arrival_position=-1.0)
