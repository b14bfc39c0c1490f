"""Tests the suite: ids, episodes on the evaluation's seeds, the scale of the returns, policies with a controller."""

import gymnasium
import numpy as np
import pytest

from spidar_gym.benchmark.suite import METRICS, SEED, RandomPolicy, anchoring, find_task, options_for, play
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.suite import CLASSICAL, LAZY, SUITE, SUITE_IDS, read_anchors
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.presets import OwnController


class Table:
    """Plays a table of actions; every robot the same."""

    def __init__(self, rows):
        self.rows = rows

    def reset(self, seed):
        self.step = -1

    def act(self, observation):
        self.step += 1
        return self.rows[self.step]


class Batch(Table):
    """The same for many robots."""

    def reset_batch(self, seeds):
        self.reset(0)

    def act_batch(self, observations):
        return np.tile(self.act(None), (len(observations), 1))


@pytest.mark.parametrize("name", SUITE)
def test_every_id_is_made_without_arguments_and_is_one_robot_of_its_vector(name):
    task = SUITE[name]
    env = gymnasium.make(task.id)
    observation, info = env.reset(seed=0)
    assert SUITE_IDS[task.id] == name
    assert observation in env.observation_space
    assert not info["is_success"]
    assert env.spec.max_episode_steps == round(task.seconds * CONTROL_RATE / task.hold)
    assert env.unwrapped.hold == task.hold
    vector = gymnasium.make_vec(task.id, num_envs=2)
    assert vector.single_observation_space == env.observation_space
    first, _ = vector.reset(seed=[5, 0])
    assert first[1].tobytes() == observation.tobytes()


def test_episodes_are_those_of_a_single_environment_with_the_seeds_of_the_evaluation():
    rows = np.random.default_rng(0).uniform(-0.3, 0.3, (400, 24))
    together, alone = play("Hover", Batch(rows), 3, threads=2), play("Hover", Table(rows), 3)
    for k in range(3):
        env = gymnasium.make(SUITE["Hover"].id)
        env.reset(seed=SEED + k)
        total, over, step = 0.0, False, 0
        while not over:
            _, reward, terminated, truncated, info = env.step(rows[step])
            total, over, step = total + reward, terminated or truncated, step + 1
        for found in (together, alone):
            assert found.returns[k] == pytest.approx(total, rel=1e-12)
            assert found.seconds[k] == pytest.approx(step / CONTROL_RATE)
            assert found.failed[k] == bool(info["failure"])
            assert found.success[k] == info["is_success"]
    for found in (together, alone):
        assert sum(found.terms.values()) == pytest.approx(found.returns)
        assert [*found.means] == [*METRICS]
    for name, part in together.terms.items():
        assert part == pytest.approx(alone.terms[name])


def test_random_actions_depend_on_the_episode_alone():
    policy = RandomPolicy()
    policy.begin(3)
    policy.reset_batch([4, 5])
    both = [policy.act_batch(np.zeros((2, 1))) for _ in range(3)]
    policy.reset(5)
    alone = [policy.act(np.zeros(1)) for _ in range(3)]
    assert np.array(alone).tolist() == np.array(both)[:, 1].tolist()
    assert np.ptp(both) > 0.5


@pytest.mark.parametrize("name", ["Hover", "Crawl"])
def test_the_classical_controller_is_one_and_doing_nothing_zero_on_the_committed_scale(name):
    task, policies = SUITE[name], anchoring(name)
    best = play(name, policies[CLASSICAL], 4)
    assert best.success.all()
    assert task.normalised(best.returns.mean()) == pytest.approx(1.0, abs=0.03)
    assert max(task.normalised(play(name, policies[lazy], 4).returns.mean()) for lazy in LAZY) < 0.05


class Away(OwnController):
    """Pushes away from where the robot should be: `where` are the entries of the way there, torso axes."""

    name = "away"

    def __init__(self, where):
        super().__init__({})
        self.where = where

    def act_batch(self, observations):
        found = np.zeros((len(observations), self._size))
        for axis, entry in enumerate(self.where):
            found[:, axis:24:3] = -np.sign(observations[:, entry])[:, None]
        return found


@pytest.mark.parametrize(("name", "where"), [("Hover", (0, 1, 2)), ("Path", (0, 1, 2)), ("Crawl", (0, 1))])
def test_doing_the_opposite_is_worth_a_tenth_of_the_classical_controller_at_most(name, where):
    found = play(name, Away(where), 6)
    assert not found.success.any()
    assert found.returns.mean() <= 0.1 * SUITE[name].anchors[1]


@pytest.mark.parametrize("name", SUITE)
def test_the_committed_scale_is_that_of_the_terms_and_orders_the_policies(name):
    found = read_anchors()[name]
    for row in found.values():
        assert sum(row["terms"].values()) == pytest.approx(row["return"], abs=0.01)
    zero, one = SUITE[name].anchors
    assert zero < one
    assert found[CLASSICAL]["return"] == one
    assert max(found[lazy]["return"] for lazy in LAZY) == zero
    if name != "HoverResidual":  # whose zero action is a controller
        assert zero <= 0.1 * one, "doing nothing, falling at once and ending early are worth a tenth at most"


def test_a_policy_with_a_controller_replaces_the_interface_and_nothing_of_the_task():
    task = SUITE["CrawlCalibrated"]
    assert options_for(task, RandomPolicy()) == dict(task.options)
    chosen = options_for(task, anchoring(task.name)[CLASSICAL])
    assert chosen["preset"] == "steady_crawl"
    assert not {"action_mode", "action_scale", "hold", "observation"} & set(chosen)
    kept = {"distance", "direction", "turn", "joint_speed", "horizon_s", "randomization", "reward"}
    assert {name: chosen[name] for name in kept} == {name: task.options[name] for name in kept}


def test_tasks_and_policies_that_do_not_fit_are_refused_with_the_valid_ones():
    with pytest.raises(UnknownNameError, match="HoverResidual, Hover, Path"):
        play("Swim", OwnController({}))
    with pytest.raises(InvalidValueError, match="defined on spidar_gym/Course-v0"):
        options_for(find_task("Course"), anchoring("Hover")[CLASSICAL])
