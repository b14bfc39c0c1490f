"""Pins the plug-ins of learning frameworks: the episodes of Stable-Baselines3's own vector, tensors without copies."""

import pickle
import subprocess
import sys
import zipfile
from functools import partial

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3, HerReplayBuffer
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize
from support.zips import changed, learned, packed

from spidar_gym.benchmark.track import CRAWL, HOVER
from spidar_gym.errors import InvalidValueError
from spidar_gym.plugins import AsymmetricPolicy, StablePolicy, StableVecEnv, TorchVector
from spidar_gym.policies.policy import acts_in_batches, policy_name
from spidar_gym.policies.source import PolicyError

CASES = {
    "flights that fall": (HOVER, {"action_mode": "direct", "forms": "independent"}, 60),
    "flights to the horizon": (HOVER, {"forms": "equal"}, 12),
    "crawls of randomised robots": (CRAWL, {"sensors": True, "randomization": 0.3}, 15),
}
KEYWORDS = ("failure", "energy_wh", "time_s")


def vector(case, robots=3, mode="SameStep", **options):
    env_id, own, steps = CASES[case]
    return gymnasium.make_vec(
        env_id, num_envs=robots, autoreset_mode=mode, max_episode_steps=steps, **own, **options
    )  # fmt: skip


def dummy(case, robots=3):
    env_id, own, steps = CASES[case]
    return DummyVecEnv([partial(gymnasium.make, env_id, max_episode_steps=steps, **own)] * robots)


@pytest.mark.parametrize("case", CASES)
def test_episodes_are_those_of_stable_baselines_own_vector_to_the_bit(case):
    ours, theirs = StableVecEnv(vector(case)), dummy(case)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    assert ours.seed(5) == theirs.seed(5)
    assert np.array_equal(ours.reset(), theirs.reset())
    rng, ended = np.random.default_rng(1), 0
    for _ in range(70):
        actions = rng.uniform(-1.0, 1.0, (3, *ours.action_space.shape))
        (seen, rewards, done, infos), (seen_2, rewards_2, done_2, infos_2) = ours.step(actions), theirs.step(actions)
        assert seen.dtype == seen_2.dtype
        assert np.array_equal(seen, seen_2)
        assert rewards.dtype == rewards_2.dtype
        assert np.array_equal(rewards, rewards_2)
        assert np.array_equal(done, done_2)
        for own, other in zip(infos, infos_2, strict=True):
            assert ("terminal_observation" in own) == ("terminal_observation" in other)
            if own:
                ended += 1
                assert np.array_equal(own["terminal_observation"], other["terminal_observation"])
                assert own["TimeLimit.truncated"] == other["TimeLimit.truncated"]
                assert own["is_success"] == other["is_success"]
    assert ended >= 3


DICTIONARIES = {
    "goals of crawls": (CRAWL, {"observation": "goal", "distance": 0.2}, 15),
    "flights for a critic": (HOVER, {"observation": "asymmetric", "randomization": 0.3, "sensors": True}, 12),
}


@pytest.mark.parametrize("case", DICTIONARIES)
def test_dictionaries_are_those_of_stable_baselines_own_vector_to_the_bit(case, monkeypatch):
    monkeypatch.setitem(CASES, case, DICTIONARIES[case])
    ours, theirs = StableVecEnv(vector(case)), dummy(case)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    ours.seed(5)
    theirs.seed(5)
    seen, seen_2 = ours.reset(), theirs.reset()
    rng, ended = np.random.default_rng(1), 0
    for _ in range(32):
        assert seen.keys() == seen_2.keys()
        assert all(np.array_equal(seen[part], seen_2[part]) for part in seen)
        kept = {part: rows.copy() for part, rows in seen.items()}
        actions = rng.uniform(-1.0, 1.0, (3, *ours.action_space.shape))
        before = seen
        (seen, rewards, done, infos), (seen_2, rewards_2, done_2, infos_2) = ours.step(actions), theirs.step(actions)
        assert all(np.array_equal(before[part], rows) for part, rows in kept.items())
        assert np.array_equal(rewards, rewards_2)
        assert np.array_equal(done, done_2)
        for k in np.flatnonzero(done):
            ended += 1
            last, last_2 = infos[k]["terminal_observation"], infos_2[k]["terminal_observation"]
            assert all(np.array_equal(last[part], last_2[part]) for part in last_2)
    assert ended >= 6


@pytest.mark.parametrize("robots", [1, 4])
def test_hindsight_learns_from_rewards_that_the_vector_computes(robots):
    options = {"observation": "goal", "distance": 0.2, "max_episode_steps": 20}
    if robots == 1:
        env = gymnasium.make(CRAWL, **options)
    else:
        env = StableVecEnv(gymnasium.make_vec(CRAWL, robots, autoreset_mode="SameStep", **options))
    model = SAC(
        "MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, learning_starts=81, batch_size=32, seed=0,
        policy_kwargs={"net_arch": [16]}, device="cpu",
    )  # fmt: skip
    model.learn(120)
    assert model._n_updates > 0
    batch = model.replay_buffer.sample(200)
    pair = (batch.next_observations[part].numpy() for part in ("achieved_goal", "desired_goal"))
    expected = model.get_env().env_method("compute_reward", *pair, {}, indices=[0])[0]
    assert np.array_equal(batch.rewards.numpy()[:, 0], expected.astype(np.float32))
    assert {-1.0, 0.0} == {*batch.rewards.numpy()[:, 0].tolist()}


def test_the_critic_of_an_asymmetric_policy_observes_more_than_the_actor(tmp_path):
    many = gymnasium.make_vec(HOVER, 4, autoreset_mode="SameStep", observation="asymmetric", max_episode_steps=30)
    env = StableVecEnv(many)
    model = PPO(AsymmetricPolicy, env, n_steps=16, batch_size=16, n_epochs=1, seed=0, device="cpu")
    model.learn(128)
    seen = env.reset()
    other = {**seen, "privileged": seen["privileged"] + 1.0}
    tensors, others = (model.policy.obs_to_tensor(each)[0] for each in (seen, other))
    with torch.no_grad():
        assert torch.equal(model.policy.get_distribution(tensors).mode(), model.policy.get_distribution(others).mode())
        assert not torch.allclose(model.policy.predict_values(tensors), model.policy.predict_values(others))
        assert torch.equal(model.policy(tensors, deterministic=True)[0], model.policy(others, deterministic=True)[0])
    path = tmp_path / "model.zip"
    model.save(path)
    policy = StablePolicy(path)
    one = {part: rows[0] for part, rows in seen.items()}
    assert np.array_equal(policy.act(one), model.predict(one, deterministic=True)[0])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_tensors_of_a_dictionary_share_its_memory(mode):
    many = gymnasium.make_vec(
        HOVER, 3, autoreset_mode=mode, observation="asymmetric", max_episode_steps=4, randomization=1.0
    )
    robots = TorchVector(many)
    robots.reset(seed=0)
    held = robots.observations
    for _ in range(9):
        before = {part: rows.clone() for part, rows in held.items()}
        robots.step(torch.zeros(3, 6))
        assert not any(torch.equal(before[part], rows) for part, rows in held.items())
        for part, rows in many.buffers["observations"].items():
            assert np.array_equal(held[part].numpy(), rows)
    assert (mode == "SameStep") == bool(robots.final_observations["privileged"].any())


def test_a_returned_observation_does_not_change_afterwards():
    env = StableVecEnv(vector("flights that fall"))
    before = env.reset()
    kept = before.copy()
    env.step(np.zeros((3, *env.action_space.shape)))
    assert np.array_equal(before, kept)


def test_wrappers_evaluation_and_a_learner_of_stable_baselines_run_on_it():
    env = VecNormalize(VecMonitor(StableVecEnv(vector("flights that fall", 4))))
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=0, device="cpu")
    model.learn(256)
    assert model.num_timesteps == 256
    assert len(model.ep_info_buffer) > 0
    rewards, lengths = evaluate_policy(model, env, n_eval_episodes=3, return_episode_rewards=True)
    assert len(rewards) == len(lengths) == 3
    assert all(0 < length <= 60 for length in lengths)


def test_options_of_the_reset_are_those_of_the_vector_and_are_used_once():
    env = StableVecEnv(vector("flights to the horizon"))
    env.seed(2)
    calm = env.reset()
    env.seed(2)
    env.set_options([{"disturbances": {"lost_rotor": k + 1, "fault_time": 0.0}} for k in range(3)])
    env.reset()
    for _ in range(3):
        faulty = env.step(np.zeros((3, *env.action_space.shape)))[0]
    assert env.vector.robots["episode"]["disturbances"]["lost_rotor"].tolist() == [1, 2, 3]
    assert not np.array_equal(calm, faulty)
    env.set_options([{"forms": "form1"}, {}, {}])
    with pytest.raises(InvalidValueError, match="an option that all robots have"):
        env.reset()


def test_there_is_no_environment_of_each_robot_to_be_called():
    env = StableVecEnv(vector("flights to the horizon", render_mode="rgb_array", width=64, height=48))
    env.reset()
    assert env.get_attr("num_envs") == [3, 3, 3]
    assert env.get_attr("render_mode", [0]) == ["rgb_array"]
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * 3
    assert [picture.shape for picture in env.get_images()] == [(48, 64, 3)] * 3
    assert env.env_method("render", indices=[1])[0].shape == (48, 64, 3)
    with pytest.raises(AttributeError):
        env.get_attr("nothing")
    with pytest.raises(InvalidValueError, match="expected render"):
        env.env_method("restart")
    with pytest.raises(InvalidValueError, match="robots of a vector are alike"):
        env.set_attr("task", None)
    env.close()
    env.close()


@pytest.mark.parametrize("mode", ["NextStep", "Disabled", "SameStep"])
def test_a_vector_of_any_mode_is_one_whose_episodes_begin_in_the_step_of_the_end(mode):
    vector = gymnasium.make_vec(HOVER, 2, autoreset_mode=mode, max_episode_steps=3)
    env = VecMonitor(StableVecEnv(vector), None, KEYWORDS)
    env.reset()
    lengths = []
    for _ in range(7):
        *_, done, infos = env.step(np.zeros((2, 6)))
        for info in infos:
            lengths += [info["episode"]["l"]] if "episode" in info else []
        if done.all():
            assert infos[0]["episode"]["failure"] == ""
            assert infos[0]["episode"]["time_s"] == pytest.approx(0.075)
            assert infos[0]["episode"]["energy_wh"] > 0.0
    assert lengths == [3] * 4
    env.close()


def test_the_word_that_an_episode_ended_with_reaches_the_monitor():
    options = {"action_mode": "direct", "forms": "form1"}
    env = VecMonitor(StableVecEnv(gymnasium.make_vec(HOVER, 2, **options)), None, ("failure",))
    env.reset()
    actions, words = np.random.default_rng(0).normal(0.0, 0.7, (200, 2, 40)), set()
    for each in actions:
        words |= {info["episode"]["failure"] for info in env.step(each)[3] if "episode" in info}
    assert words <= {"contact", "tilt", "position"}
    assert words
    env.close()


@pytest.mark.parametrize("mode", ["SameStep", "NextStep", "Disabled"])
def test_tensors_share_the_memory_of_the_robots_and_hold_what_step_returns(mode):
    robots, usual = TorchVector(vector("flights that fall", mode=mode)), vector("flights that fall", mode=mode)
    where = robots.observations.data_ptr()
    robots.reset(seed=3)
    assert np.array_equal(robots.observations.numpy(), usual.reset(seed=3)[0])
    generator = torch.Generator().manual_seed(0)
    for _ in range(10):
        actions = torch.rand((3, *usual.single_action_space.shape), generator=generator) * 2.0 - 1.0
        robots.step(actions.requires_grad_())
        observations, rewards, terminated, truncated, _ = usual.step(actions.detach().numpy())
        assert np.array_equal(robots.observations.numpy(), observations)
        assert np.array_equal(robots.rewards.numpy(), rewards)
        assert np.array_equal(robots.terminated.numpy(), terminated)
        assert np.array_equal(robots.truncated.numpy(), truncated)
    assert robots.observations.data_ptr() == where == robots.vector.buffers["observations"].ctypes.data
    with pytest.raises(InvalidValueError, match="actions"):
        robots.step(torch.zeros(2, 2))
    robots.close()


ALGORITHMS = {
    "PPO": (PPO, {}), "PPO with gSDE": (PPO, {"use_sde": True}), "A2C": (A2C, {}),
    "PPO of another shape": (PPO, {"policy_kwargs": {"net_arch": [8], "activation_fn": torch.nn.ReLU}}),
    "SAC": (SAC, {"buffer_size": 10}), "SAC with gSDE": (SAC, {"buffer_size": 10, "use_sde": True}),
    "TD3": (TD3, {"buffer_size": 10}), "DDPG": (DDPG, {"buffer_size": 10}),
}  # fmt: skip


@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_policy_of_a_zip_acts_as_its_model_does_without_noise(name, tmp_path):
    algorithm, options = ALGORITHMS[name]
    model = algorithm("MlpPolicy", HOVER, seed=1, device="cpu", **options)
    model.save(tmp_path / "my best.zip")
    policy = StablePolicy(tmp_path / "my best.zip")
    assert (policy.observation_space, policy.action_space) == (model.observation_space, model.action_space)
    assert policy_name(policy) == "my_best"
    policy.reset(0)
    for seen in np.random.default_rng(2).normal(size=(3, *model.observation_space.shape)).astype(np.float32):
        action = policy.act(seen)
        assert action.any()
        assert np.array_equal(action, model.predict(seen, deterministic=True)[0])
    assert not acts_in_batches(policy)  # torch does not guarantee equal bits for batches


class Counting(ActorCriticPolicy):
    """A recurrent policy that counts its actions."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        count = 1 if state is None else state[0] + 1
        return np.full(self.action_space.shape, count), (count,)


def test_the_state_of_a_policy_lasts_until_the_reset(tmp_path):
    PPO(Counting, HOVER, device="cpu").save(tmp_path / "model.zip")
    policy = StablePolicy(tmp_path / "model.zip")
    counts = []
    for _ in range(2):
        policy.reset(0)
        counts += [policy.act(np.zeros(3))[0] for _ in range(3)]
    assert counts == [1, 2, 3, 1, 2, 3]


def test_a_model_trained_with_normalisation_needs_the_statistics_and_applies_them(tmp_path):
    env = VecNormalize(StableVecEnv(vector("flights that fall", 4)))
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=0, device="cpu")
    model.learn(64)
    path, statistics = tmp_path / "model.zip", tmp_path / "vecnormalize.pkl"
    model.save(path)
    with pytest.raises(PolicyError, match=r"vecnormalize\.pkl: cannot be read .* valid: the statistics"):
        StablePolicy(path)
    statistics.write_bytes(pickle.dumps({}))
    with pytest.raises(PolicyError, match="it holds a dict"):
        StablePolicy(path)
    env.save(str(statistics))
    seen = np.random.default_rng(3).normal(size=env.observation_space.shape).astype(np.float32)
    action = StablePolicy(path).act(seen)
    assert np.array_equal(action, model.predict(env.normalize_obs(seen), deterministic=True)[0])
    assert not np.array_equal(action, model.predict(seen, deterministic=True)[0])


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Bytes of a saved model's zip."""
    return learned(tmp_path_factory.mktemp("zips") / "model.zip").read_bytes()


def test_statistics_are_not_read_for_a_model_trained_without_normalisation(saved, tmp_path):
    (tmp_path / "model.zip").write_bytes(saved)
    (tmp_path / "vecnormalize.pkl").write_bytes(b"of another model")
    StablePolicy(tmp_path / "model.zip")


def test_only_the_policy_of_an_algorithm_is_unpickled(saved, tmp_path):
    path = tmp_path / "model.zip"
    path.write_bytes(changed(saved, lr_schedule={":serialized:": "of another Python"}))
    assert StablePolicy(path).act(np.zeros(StablePolicy(path).observation_space.shape, np.float32)).any()


def flipped(data: bytes) -> bytes:
    """The zip with one byte of its weights changed."""
    k = data.index(b"policy.pth") + 2000
    return data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :]


DAMAGE = {
    "missing": (None, "FileNotFoundError"),
    "empty": (lambda data: b"", "BadZipFile"),
    "no zip": (lambda data: b"weights" * 100, "BadZipFile"),
    "cut off": (lambda data: data[:1000], "BadZipFile"),
    "a byte": (flipped, "BadZipFile('policy.pth is damaged')"),
    "another program's": (None, "no item named"),
    "no JSON": (None, "JSONDecodeError"),
    "no spaces": (lambda data: changed(data, action_space=None), "NoneType"),
    "no pickle": (lambda data: changed(data, policy_class={":serialized:": "abcd"}), "UnpicklingError"),
    "of a package that is not here": (
        lambda data: changed(data, policy_class={":serialized:": "Y25vd2hlcmUKTmV0Ci4="}), "No module named 'nowhere'",
    ),
    "of a class that is not here": (
        lambda data: changed(data, policy_class={":serialized:": "Y3RvcmNoCk5vTmV0Ci4="}), "Could not deserialize",
    ),
    "weights of another network": (lambda data: changed(data, policy_kwargs={"net_arch": [3]}), "loading state_dict"),
    "ends the process": (lambda data: changed(data, policy_class=packed(Leaving())), "SystemExit"),
}  # fmt: skip


class Leaving:
    """An object that ends the process while it is unpickled."""

    def __reduce__(self):
        return sys.exit, (0,)


@pytest.mark.parametrize("how", DAMAGE)
def test_a_damaged_zip_is_refused_in_one_line(how, saved, tmp_path):
    path, (damage, words) = tmp_path / "model.zip", DAMAGE[how]
    if damage is not None:
        path.write_bytes(damage(saved))
    elif how != "missing":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("data" if how == "no JSON" else "other", "no JSON")
    with pytest.raises(PolicyError) as refusal:
        StablePolicy(path)
    message = str(refusal.value)
    assert words in message
    assert message.endswith("valid: what `model.save` of Stable-Baselines3 wrote")
    assert "\n" not in message


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3"])
def test_without_the_extra_importing_plugins_is_a_one_line_error_and_all_else_works(missing):
    code = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        "import gymnasium, spidar_gym\n"
        f"gymnasium.make_vec({HOVER!r}, num_envs=2).reset(seed=0)\n"
        "try:\n    import spidar_gym.plugins\n"
        "except spidar_gym.errors.MissingDependencyError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.count("\n") == 1
    assert "pip install 'spidar-gym[train]'" in done.stdout


def test_the_package_imports_no_framework():
    code = "import sys, spidar_gym, spidar_gym.cli.main, spidar_gym.envs.vector; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
