"""Pins artifacts as policies: interface, washout, traces and digest."""

import math
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from support.artifacts import flier

from spidar_gym.benchmark.track import HOVER
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.artifact import ArtifactError, LearnedPolicy, read_artifact, write_artifact
from spidar_gym.policies.filters import Traces, Washout
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import Policy, defined_on, policy_digest, policy_doc, policy_kind


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_learned_policy_is_defined_on_its_own_environment_only(tmp_path, env_id):
    write_artifact(flier(env_id, arguments={"preset": "tuned"} if env_id == HOVER else {}), tmp_path / "net.npz")
    policy = LearnedPolicy(read_artifact(tmp_path / "net.npz"))
    assert defined_on(policy) == [env_id]
    assert policy.arguments(env_id) == ({"preset": "tuned"} if env_id == HOVER else {})


def test_a_path_is_a_policy_with_the_name_kind_and_words_of_its_artifact(tmp_path):
    path = tmp_path / "some.npz"
    write_artifact(flier(name="ppo", kind="residual", doc="Adds to it."), path)
    policy = load_policy(str(path))
    assert isinstance(policy, LearnedPolicy)
    assert isinstance(policy, Policy)
    assert (policy.name, policy_kind(policy), policy_doc(policy)) == ("ppo", "residual", "Adds to it.")
    assert policy.training["seed"] == 3
    observation = np.random.default_rng(6).normal(size=207)
    policy.reset(0)
    np.testing.assert_array_equal(policy.act(observation), flier().act(observation))
    with pytest.raises(ArtifactError, match=r"none\.npz"):
        load_policy(str(tmp_path / "none.npz"))


def test_the_digest_of_a_learned_policy_is_that_of_its_file(written, tmp_path):
    digest = policy_digest(load_policy(str(written)))
    copy = tmp_path / "copy.npz"
    copy.write_bytes(written.read_bytes())
    assert policy_digest(load_policy(str(copy))) == digest
    write_artifact(flier(seed=1), copy)
    assert policy_digest(load_policy(str(copy))) != digest


@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_an_artifact_whose_last_layer_is_zero_is_the_controller_itself(tmp_path, output):
    net = flier(output=output)
    net = replace(
        net, weights=(*net.weights[:-1], 0.0 * net.weights[-1]), biases=(*net.biases[:-1], 0.0 * net.biases[-1])
    )
    write_artifact(net, tmp_path / "net.npz")
    policy = LearnedPolicy(read_artifact(tmp_path / "net.npz"))
    seen = []
    for act in (policy.act, lambda _: np.zeros(6)):
        env = gymnasium.make(HOVER, **(policy.arguments(HOVER) or {})).unwrapped
        observation, _ = env.reset(seed=0)
        for _ in range(4):
            action = act(observation)
            assert not np.any(action)
            observation = env.step(action)[0]
        seen.append(observation)
        env.close()
    np.testing.assert_array_equal(seen[0], seen[1])


def test_a_constant_answer_is_washed_out():
    """It decays to 1/e within one time constant, and soon after to zero."""
    washout, action = Washout(np.array([0.5, 0.2])), np.array([0.8, -1.0], np.float32)
    found = np.array([washout(action) for _ in range(400)])
    time = np.arange(1, 401)[:, None] / CONTROL_RATE
    np.testing.assert_allclose(found, action * np.exp(-time / [0.5, 0.2]), atol=1e-7)
    assert found[19, 0] == pytest.approx(0.8 / math.e)


def test_a_washout_lets_pass_what_is_fast_and_stays_within_bounds():
    rng, washout = np.random.default_rng(0), Washout(np.full(3, 1e6))
    actions = rng.uniform(-1.0, 1.0, (200, 3))
    np.testing.assert_allclose([washout(action) for action in actions], actions, atol=1e-5)
    turned = Washout(np.array([0.1]))
    found = np.array([turned(np.array([1.0 if k < 40 else -1.0])) for k in range(80)])
    assert found[40] == -1.0, "from the bound to the other one is 2"
    assert np.abs(found).max() == 1.0


def test_entries_without_a_washout_pass_untouched():
    rng, some = np.random.default_rng(1), Washout(np.array([0.0, 0.3, 0.0]))
    for dtype in (np.float32, np.float64):
        for action in rng.normal(scale=5.0, size=(50, 3)).astype(dtype):
            found = some(action)
            assert found.dtype == dtype
            assert found[[0, 2]].tobytes() == action[[0, 2]].tobytes()
            assert found[1] != action[1]
            for none in (Washout(np.zeros(0)), Washout(np.zeros(3))):
                assert none(action).tobytes() == action.tobytes()


def test_a_silent_policy_stays_silent_through_a_washout():
    washout = Washout(np.array([0.5, 0.0]))
    assert not any(washout(np.zeros(2, np.float32)).any() for _ in range(100))


def test_an_action_is_left_as_it_was_by_a_washout():
    washout, action = Washout(np.array([0.5, 0.0])), np.array([0.3, 0.4])
    washout(action)
    assert action.tolist() == [0.3, 0.4]


@pytest.mark.parametrize("time", [-0.1, np.nan, np.inf])
def test_a_washout_of_no_time_is_refused(time):
    with pytest.raises(InvalidValueError, match=r"washout = .* at least 0"):
        Washout(np.array([0.5, time]))


def test_a_learned_policy_washes_out_and_forgets_at_a_reset(tmp_path):
    times = np.array([0.5, 0.5, 0.5, 0.0, 0.0, 0.0])
    write_artifact(flier(washout=times), tmp_path / "net.npz")
    policy, washout = LearnedPolicy(read_artifact(tmp_path / "net.npz")), Washout(times)
    observations = np.random.default_rng(7).normal(size=(30, 207))
    expected = [washout(flier().act(observation)) for observation in observations]
    for seed in (0, 1):
        policy.reset(seed)
        np.testing.assert_array_equal([policy.act(observation) for observation in observations], expected)
    assert np.abs(policy.act(observations[0]) - expected[0]).max() > 0.01, "without a reset it remembers"


def test_a_trace_of_what_stays_comes_to_it_to_a_part_in_e_in_one_time_constant():
    traces, seen = Traces(np.array([1.0, 2.0]), np.array([0.5, 2.0])), np.array([9.0, 1.0, -3.0])
    for _ in range(round(0.5 * CONTROL_RATE)):
        shown = traces(seen)
    np.testing.assert_array_equal(shown[:3], seen)
    grown = 1.0 - math.exp(-1.0), 1.0 - math.exp(-0.25)
    np.testing.assert_allclose(shown[3:], [grown[0], -3.0 * grown[0], grown[1], -3.0 * grown[1]], rtol=1e-9)
    traces.reset()
    np.testing.assert_allclose(traces(0.0 * seen)[3:], 0.0)


def test_traces_of_many_robots_are_those_of_each_alone_and_none_show_nothing():
    rng = np.random.default_rng(0)
    seen = rng.normal(size=(20, 3, 4))
    entries, times = np.array([3.0, 0.0]), np.array([0.1, 1.0])
    together = Traces(entries, times)
    together.reset(3)
    shown = np.stack([together(now) for now in seen])
    for robot in range(3):
        alone = Traces(entries, times)
        np.testing.assert_array_equal(np.stack([alone(now) for now in seen[:, robot]]), shown[:, robot])
    np.testing.assert_array_equal(Traces(np.zeros(0), np.zeros(0))(seen[0]), seen[0])
