"""Pins Gymnasium's conversions to torch and JAX: every number becomes a tensor and no text is lost, also in vectors."""

from importlib.util import find_spec

import gymnasium
import numpy as np
import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

from spidar_gym.envs.codes import Coded
from spidar_gym.envs.registry import CRAWL, ENVIRONMENTS, HOVER

pytestmark = needs("array_api_compat", "torch")
MODES = list(gymnasium.vector.AutoresetMode)
JAX = pytest.param("jax", marks=pytest.mark.skipif(find_spec("jax") is None, reason="JAX is not installed"))


def library(name):
    """Return the array functions of a library."""
    return __import__("jax.numpy", fromlist=["zeros"]) if name == "jax" else __import__(name)


def converted(env, name, kind):
    """Wrap an environment so that its arrays are those of a library."""
    wrappers = gymnasium.wrappers if kind == "one" else gymnasium.wrappers.vector
    if name == "torch":
        return wrappers.NumpyToTorch(env)
    return wrappers.ArrayConversion(env, env_xp=np, target_xp=library(name))


def others(told, kind):
    """Return the names of all entries of another type, including nested dictionaries."""
    found = []
    for name, value in told.items():
        if isinstance(value, dict):
            found += others(value, kind)
        elif not isinstance(value, kind):
            found.append(name)
    return found


def numbers(told):
    """Convert `info` back to NumPy."""
    return {name: numbers(value) if isinstance(value, dict) else np.asarray(value) for name, value in told.items()}


@pytest.mark.parametrize("name", ["torch", JAX])
@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_all_numbers_of_a_single_environment_are_tensors(env_id, name):
    options = {"max_episode_steps": 4, "randomization": 0.5}
    one, plain = converted(Coded(gymnasium.make(env_id, **options)), name, "one"), gymnasium.make(env_id, **options)
    xp = library(name)
    (seen, told), (expected, known) = one.reset(seed=1), plain.reset(seed=1)
    for _ in range(4):
        assert type(seen) is type(xp.zeros(1))
        assert others(told, type(xp.zeros(1))) == []
        np.testing.assert_array_equal(np.asarray(seen), expected)
        assert_tells_the_same(numbers(told), known, one.get_wrapper_attr("words"))
        seen, reward, _, truncated, told = one.step(xp.zeros(plain.action_space.shape))
        expected, right, _, over, known = plain.step(np.zeros(plain.action_space.shape))
        assert (reward, truncated) == (pytest.approx(right), over)
    assert truncated


def assert_tells_the_same(told, known, words):
    """Assert that numbers equal those of the plain environment, and codes those of its texts."""
    for name, value in known.items():
        if isinstance(value, dict):
            assert_tells_the_same(told[name], value, words)
        elif not isinstance(value, str):
            np.testing.assert_allclose(told[name], value, rtol=1e-6, atol=1e-6, err_msg=name)  # JAX uses 32 bits
        elif name == "shortfalls":
            bits = int(told["shortfalls_code"])
            assert value == ", ".join(word for k, word in enumerate(words[name]) if bits >> k & 1)
        else:
            code = int(told[f"{name}_code"])
            assert value in (words[name][code],) if code >= 0 else ("", "none")


@pytest.mark.parametrize("name", ["torch", JAX])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
@pytest.mark.parametrize("kind", ["native", "sync"])
@pytest.mark.parametrize("env_id", [HOVER, CRAWL])
def test_vectors_return_tensors_through_the_end_of_an_episode(env_id, kind, mode, name):
    if (kind, mode.value) == ("sync", "SameStep"):
        pytest.skip("Gymnasium cannot convert the objects in `final_obs` of its own vectors, whatever the environment")
    if kind == "native":
        envs = gymnasium.make_vec(env_id, 2, max_episode_steps=3, autoreset_mode=mode)
    else:
        own = {"autoreset_mode": mode}
        envs = gymnasium.make_vec(env_id, 2, kind, max_episode_steps=3, vector_kwargs=own, wrappers=[Coded])
    envs, xp = converted(envs, name, kind), library(name)
    seen, told = envs.reset(seed=0)
    for k in range(3):
        seen, reward, terminated, truncated, told = envs.step(xp.zeros(envs.action_space.shape))
        for value in (seen, reward, terminated, truncated):
            assert type(value) is type(xp.zeros(1))
        assert others(told, type(xp.zeros(1))) == []
        assert bool(truncated.all()) == (k == 2)
    assert np.asarray(told["failure_code"]).shape == (2,)
    if mode.value == "SameStep":
        assert np.asarray(told["final_obs"]).shape == np.asarray(seen).shape


def test_what_the_guide_shows_reports_success_at_the_end_of_the_episodes():
    import torch

    native = run_shown("converters native")
    assert {type(native[name]) for name in ("observations", "rewards", "terminated", "truncated")} == {torch.Tensor}
    assert others(native["info"], torch.Tensor) == []
    steps = [native["many"].step(torch.zeros(3, 6)) for _ in range(STEPS - 1)]
    assert steps[-1][-1]["is_success"].tolist() == [True] * 3
    made = run_shown("converters")
    steps = [made["one"].step(torch.zeros(6)) for _ in range(STEPS)]
    assert_judged_at_the_end([bool(info["is_success"]) for *_, info in steps])
    made["sync"].reset(seed=0)
    told = made["sync"].step(np.zeros((3, 6)))[-1]
    assert told["failure_code"].tolist() == [-1] * 3


def test_gymnasium_itself_has_no_tensor_for_a_word():
    """The reason for `Coded`: if this test fails, Gymnasium supports it, and the wrapper is obsolete."""
    from gymnasium.wrappers.numpy_to_torch import numpy_to_torch

    assert numpy_to_torch({"failure": "tilt"})["failure"] != "tilt"
    with pytest.raises(BufferError):
        numpy_to_torch({"failure": np.array(["tilt"], object)})


def test_gymnasium_itself_cannot_convert_the_ends_of_its_own_vectors():
    """The reason for the exception in the guide's table: if this test fails, Gymnasium supports it."""
    import torch

    own = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    envs = gymnasium.make_vec("CartPole-v1", 2, "sync", max_episode_steps=1, vector_kwargs=own)
    envs = gymnasium.wrappers.vector.NumpyToTorch(envs)
    envs.reset(seed=0)
    with pytest.raises(BufferError):
        envs.step(torch.zeros(2, dtype=torch.int64))
