"""Pins training in torso axes: observation and action match those of the artifact, with and without an origin."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
import torch
from support.networks import in_torso_axes

from spidar_gym.benchmark.track import CRAWL, TRACKS
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.policies import torso
from spidar_gym.policies.artifact import LearnedPolicy, read_artifact, write_artifact
from train.lib.agent import actor_layers, set_actor
from train.lib.config import override
from train.lib.envs import ERRORS, Scaling, training_seed
from train.lib.origin import find_origin, first_layers
from train.lib.rewards import RewardConfig
from train.lib.run import Run, State
from train.lib.vector import FARTHEST, TrainingVec
from train.residual import PRESETS, Course, artifact, learn, make_agent, make_robots

pytestmark = pytest.mark.train
ARGS = override(
    PRESETS["hover-direct"], tracks=("flight-wind", "flight-forms"), first_tracks=("flight-paper",), trace_times=(0.2,),
    hidden=16, critic_hidden=16, envs=3, n_steps=8, batch_size=8, still=(), symmetric=False, action_scale=1.0,
    activation="relu",
)  # fmt: skip


@pytest.fixture
def brief(monkeypatch):
    """Shorten flights to one second."""
    for name in ("flight-wind", "flight-forms", "flight-paper"):
        monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=1.0))


def scaling_for(args):
    size, rng = len(args.env.hidden_entries()), np.random.default_rng(2)
    return Scaling(0.1 * rng.normal(size=size), rng.uniform(0.5, 1.5, size))


def test_errors_enter_larger_and_traces_as_the_errors_that_they_are_of():
    env = override(ARGS, trace_times=(0.2, 5.0)).env
    size, rng = len(env.hidden_entries()), np.random.default_rng(4)
    plain = Scaling(rng.normal(size=size), rng.uniform(0.5, 1.5, size))
    large = env.enlarge_errors(plain, 4.0)
    assert large.clip == 3.0 * plain.clip
    # Features that depend on these pieces of the observation.
    observation, before = np.zeros(torso.SHOWN), torso.features(np.zeros(torso.SHOWN))
    pieces = torso.entries(*ERRORS, "position_integral", "attitude_integral")
    observation[pieces] = 1.0
    changed = np.flatnonzero(torso.features(observation) != before)
    assert len(changed) == len(pieces)
    traces = np.arange(torso.FEATURES, size)
    np.testing.assert_array_equal(large.mean[[*changed, *traces]], 0.0)
    np.testing.assert_allclose(large.variance[changed], plain.variance[changed] / 16.0)
    np.testing.assert_array_equal(large.variance[traces], np.tile(large.variance[changed[:12]], 2))
    others = np.setdiff1d(np.arange(size), [*changed, *traces])
    np.testing.assert_array_equal(large.mean[others], plain.mean[others])
    np.testing.assert_array_equal(large.variance[others], plain.variance[others])


def loud(model):
    """Set random weights, with commands close to hovering."""
    rng = np.random.default_rng(3)
    layers = [(w, rng.normal(scale=0.05, size=b.shape)) for w, b in actor_layers(model)]
    layers[-1] = tuple(rng.normal(scale=0.02, size=part.shape) for part in layers[-1])
    set_actor(model, tuple((w.astype(np.float32), b.astype(np.float32)) for w, b in layers))
    return model


def test_observation_and_action_of_an_agent_are_those_of_its_artifact(brief):
    scaling = scaling_for(ARGS)
    robots = make_robots(ARGS, scaling)
    model = loud(make_agent(ARGS, robots))
    policy = LearnedPolicy(artifact(ARGS, actor_layers(model), scaling, State()))
    places = [(group, k, place) for group in robots._groups for k, place in enumerate(group.places)]
    policies = {place: LearnedPolicy(policy.artifact) for _, _, place in places}
    for one in policies.values():
        one.reset(0)
    robots.seed(5)
    shown, over = robots.reset(), 0
    for _ in range(60):
        said = model.predict(shown, deterministic=True)[0]
        seen = {place: group.vector.buffers["observations"][k].copy() for group, k, place in places}
        shown, _, done, _ = robots.step(said)
        for group, k, place in places:
            expected = policies[place].act(seen[place])
            if done[place]:
                policies[place].reset(0)  # and the robot has been reset
                over += 1
            else:
                given = group.vector.robots["episode"]["action"][k, : torso.ACTION]
                np.testing.assert_allclose(given, expected, atol=2e-6)
    assert over >= 3
    robots.close()


def test_the_initial_agent_hovers_without_an_origin_and_equals_the_origin_otherwise(brief, tmp_path):
    net = in_torso_axes(traced=tuple(ARGS.env.traced.astype(float)), times=(0.2,), hidden=(16, 16))
    net = replace(net, activation="relu", arguments=ARGS.env.arguments)
    write_artifact(net, tmp_path / "seed4.npz")
    args = replace(ARGS, seed=4, start=str(tmp_path / "seed{seed}.npz"))
    found = find_origin(args.start, args.seed, args.env, args.learner)
    scaling = Scaling(found.mean, found.variance, found.clip)
    robots = make_robots(args, scaling)
    model = make_agent(args, robots)
    robots.seed(1)
    shown = robots.reset()
    assert not model.predict(shown, deterministic=True)[0].any()
    set_actor(model, first_layers(found))
    again = artifact(args, actor_layers(model), scaling, State())
    for one, other in zip(
        (*net.weights, *net.biases, net.skip), (*again.weights, *again.biases, again.skip), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    seen = np.concatenate([group.vector.buffers["observations"] for group in robots._groups])
    np.testing.assert_array_equal(LearnedPolicy(net).act(seen[0]), LearnedPolicy(again).act(seen[0]))
    for other in ({"hidden": 8}, {"base": "tuned"}, {"skip": False}, {"activation": "tanh"}, {"trace_times": (0.3,)}):
        with pytest.raises(SpidarError, match="another kind of network; valid: one of") as caught:
            find_origin(args.start, 4, *(lambda a: (a.env, a.learner))(override(args, **other)))
        assert "\n" not in str(caught.value)
    robots.close()


def test_easy_tracks_come_first(brief):
    args = override(ARGS, segment=100, first_steps=200)
    course = Course(args, scaling_for(args), {})
    assert [len(course.robots(segment).vectors) for segment in range(4)] == [1, 1, 2, 2]
    assert course.robots(3) is course.robots(2)
    course.close()


def test_wind_is_drawn_for_each_robot_and_episode_and_a_seed_draws_the_same(brief):
    def winds(seed):
        robots = TrainingVec(override(ARGS, tracks=("flight-wind",)).env, RewardConfig("pose"), 3)
        robots.seed(training_seed(seed))
        robots.reset()
        found = []
        for _ in range(45):
            drawn = robots.vectors[0].robots["episode"]["disturbances"]
            found.append(np.array([drawn[name] for name in TRACKS["flight-wind"].disturbances]).copy())
            robots.step(np.zeros((3, torso.ACTION)))
        robots.close()
        return np.array(found)

    first, again, other = winds(0), winds(0), winds(1)
    np.testing.assert_array_equal(first, again)
    assert (first[0] != other[0]).all()
    assert len(np.unique(first[:, 0])) >= 6, "three robots, two episodes at least"


@pytest.mark.parametrize(
    "change", [{"hold": 2}, {"sees": ("leg_momentum",)}, {"env_id": CRAWL}, {"action_mode": "residual"}]
)
def test_what_cannot_be_in_torso_axes_is_refused(change):
    with pytest.raises(InvalidValueError, match="torso"):
        replace(ARGS.env, **change)


def test_traces_are_of_the_torsos_axes():
    with pytest.raises(InvalidValueError, match="trace_times"):
        replace(PRESETS["hover-paper-ppo"].env, trace_times=(0.2,))


def test_the_reward_of_a_flight_counts_far_errors_joints_and_changes(brief):
    reward = RewardConfig("pose", far_position=0.2, far_attitude=0.2, joint=0.1, penalty=0.0, change=1.0)
    env = replace(ARGS.env, tracks=("flight-forms",))
    plain, counted = (TrainingVec(env, one, 1) for one in (replace(reward, change=0.0), reward))
    said = np.zeros((2, 1, torso.ACTION))
    said[1] = 0.1
    for robots in (plain, counted):
        robots.seed(0)
        robots.reset()
    first, second = ([robots.step(each)[1].item() for each in said] for robots in (plain, counted))
    assert second[0] == first[0], "the first action of an episode is not a change"
    assert second[1] == pytest.approx(first[1] - 0.01, abs=1e-7)
    terms = plain._groups[0].vector.fleet.terms[0]
    info = plain._groups[0]._now()
    assert 1.0 / (1.0 + (info["joint_error"][0, 0] / 0.1) ** 2) == pytest.approx(terms[2])
    assert terms[2] < 1.0
    for robots in (plain, counted):
        robots.close()


def test_the_artifact_includes_the_action_scale(brief):
    scaling = scaling_for(ARGS)
    args = override(ARGS, action_scale=0.25)
    robots = make_robots(args, scaling)
    assert robots.action_space.high[0] == pytest.approx(FARTHEST / 0.25)
    model = loud(make_agent(args, robots))
    layers = actor_layers(model)
    assert robots.step_async(np.ones((3, 40))) is None
    np.testing.assert_array_equal(robots._actions, 0.25)
    learned = artifact(args, layers, scaling, State())
    plain = artifact(ARGS, layers, scaling, State())
    for one, other in ((learned.weights[-1], plain.weights[-1]), (learned.skip, plain.skip)):
        np.testing.assert_allclose(one, 0.25 * other, rtol=1e-6)
    np.testing.assert_array_equal(learned.weights[0], plain.weights[0])
    again = first_layers(learned, 0.25)
    for one, other in zip(layers, again, strict=True):
        for mine, its in zip(one, other, strict=True):
            np.testing.assert_allclose(mine, its, rtol=1e-6)
    robots.close()


def test_a_symmetric_agent_is_equivariant_and_stays_so_in_training(brief, tmp_path):
    args = override(ARGS, symmetric=True, seed=3, lr=3e-3, segment=48, steps=96, first_steps=0, scenarios=1, row=False)
    found = read_artifact(learn(override(args, out=tmp_path)))
    other = read_artifact(learn(override(args, symmetric=False, out=tmp_path / "free")))
    turn, seen = args.env.shown_turn(), np.random.default_rng(5).normal(size=(9, len(found.mean)))
    model = make_agent(args, make_robots(args, scaling_for(args)))

    def answers(net, shown):
        set_actor(model, first_layers(net))
        scaling = Scaling(net.mean, net.variance, net.clip)
        return model.predict(scaling(shown), deterministic=True)[0] - net.biases[-1]  # which is not tied

    assert np.abs(answers(found, seen)).max() > 0.001, "it has learned something"
    np.testing.assert_allclose(answers(found, turn(seen)), torso.SAID_TURN(answers(found, seen)), atol=1e-5)
    assert np.abs(answers(other, turn(seen)) - torso.SAID_TURN(answers(other, seen))).max() > 0.001
    values = [model.policy.predict_values(torch.tensor(each, dtype=torch.float32)) for each in (seen, turn(seen))]
    torch.testing.assert_close(*values, atol=1e-5, rtol=1e-5)


def test_symmetry_is_of_torso_axes_and_of_whole_legs():
    with pytest.raises(InvalidValueError, match="symmetric = True is not valid"):
        override(PRESETS["hover-direct-ppo"], symmetric=True)
    with pytest.raises(InvalidValueError, match="hidden = 18 is not valid; expected a multiple of 4"):
        override(ARGS, symmetric=True, hidden=18)


def test_only_the_last_layer_learns_and_exploration_fades_evenly_where_that_is_wanted(brief, tmp_path):
    args = override(
        ARGS, last_layer=True, log_std=-1.0, log_std_end=-3.0, lr=0.01, segment=48, steps=96, first_steps=0,
        scenarios=1, row=False, out=tmp_path,
    )  # fmt: skip
    found = read_artifact(learn(args))
    fresh = actor_layers(make_agent(args, make_robots(args, scaling_for(args))))
    for k, (weight, bias) in enumerate(fresh):
        assert np.allclose(found.biases[k], bias, atol=1e-6) == (k < 2)  # up to rounding in the average
        assert np.allclose(found.weights[k], weight[:, : found.weights[k].shape[1]], atol=1e-6) == (k < 2)
    run = Run.of(args, args.env.env_id, args.env.arguments)
    np.testing.assert_allclose(run.load().learner["policy/log_std"], -2.0, atol=1e-6)  # half-way in segment 2 of 2
