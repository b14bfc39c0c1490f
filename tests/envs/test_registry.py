"""Pins the registered environments: specs that survive serialisation, and vectors that fly like single ones."""

import copy
import json
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from support.episodes import HOVER, ROUGH, actions_of, assert_same, flight, make, same

import spidar_gym
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.envs.vector import KINDS


def row_of(info, i):
    """The `info` of environment `i` from that of a vector."""
    if isinstance(info, dict):
        return {key: row_of(value, i) for key, value in info.items() if not key.startswith("_")}
    return info[i]


@pytest.mark.parametrize("options", [{}, ROUGH], ids=["plain", "rough"])
def test_vector_environments_in_one_process_and_in_several_fly_like_single_ones(options):
    n, kwargs = 2, {"forms": "equal", "joint_speed": 1.0, **options}
    envs = [gymnasium.make_vec(HOVER, n, "sync", **kwargs)]
    envs.append(gymnasium.make_vec(HOVER, n, "async", vector_kwargs={"context": "spawn"}, **kwargs))
    singles = [make(**kwargs) for _ in range(n)]
    try:
        expected = [env.reset(seed=10 + i)[0] for i, env in enumerate(singles)]
        for env in envs:
            assert np.array_equal(env.reset(seed=10)[0], expected)
        for actions in np.random.default_rng(0).uniform(-1, 1, (20, n, 6)).astype(np.float32):
            steps = [env.step(action) for env, action in zip(singles, actions, strict=True)]
            for env in envs:
                observations, rewards, terminated, truncated, infos = env.step(actions)
                assert np.array_equal(observations, [step[0] for step in steps])
                assert np.array_equal(rewards, [step[1] for step in steps])
                assert not terminated.any()
                assert not truncated.any()
                for key, value in steps[1][4].items():
                    assert same(row_of(infos.get(key, {}), 1), value), key
    finally:
        for env in envs:
            env.close()


@pytest.mark.parametrize("through", ["json", "pickle", "deepcopy"])
@pytest.mark.parametrize("options", [{}, ROUGH], ids=["plain", "rough"])
def test_a_spec_survives_serialisation_and_makes_the_same_environment(options, through):
    options = {"action_mode": "residual", "forms": "independent", "joint_speed": 0.5, **options}
    env = gymnasium.make(HOVER, **options, max_episode_steps=77)
    again = {
        "json": lambda spec: EnvSpec.from_json(json.dumps(json.loads(spec.to_json()))),
        "pickle": lambda spec: pickle.loads(pickle.dumps(spec)),
        "deepcopy": copy.deepcopy,
    }[through](env.spec)
    assert again == env.spec
    other = gymnasium.make(again)
    assert other.spec.max_episode_steps == 77
    actions = actions_of(env, 10)
    assert_same(flight(env, actions, seed=2), flight(other, actions, seed=2))


def test_importing_the_package_registers_every_environment_under_its_horizon():
    assert spidar_gym.__version__
    for name, entry in ENVIRONMENTS.items():
        assert gymnasium.spec(name).max_episode_steps == entry.horizon
        assert isinstance(gymnasium.spec(name).entry_point, str)


@pytest.mark.parametrize(
    "imports",
    ["spidar_gym, gymnasium", "gymnasium, spidar_gym", "spidar_gym.control, gymnasium.spaces",
     "spidar_gym.envs.registry, gymnasium", "spidar_gym.envs.vector, gymnasium"],
)  # fmt: skip
def test_every_environment_is_registered_for_any_order_of_imports(imports):
    code = f"import {imports}; print(*(name for name in gymnasium.registry if name.startswith('spidar_gym/')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == list(ENVIRONMENTS)


LOOKS = {
    "a look": "importlib.util.find_spec('gymnasium')",
    "looks of threads": "look = lambda _: importlib.util.find_spec('gymnasium')\n"
    "with concurrent.futures.ThreadPoolExecutor(8) as threads:\n    [*threads.map(look, range(64))]",
    "a look and a reload": "importlib.util.find_spec('gymnasium'); importlib.reload(spidar_gym)",
    "two reloads": "importlib.reload(spidar_gym); importlib.reload(spidar_gym)",
    "a package that is imported anew": "del sys.modules['spidar_gym']; import spidar_gym",
    "an import that fails": "sys.modules['gymnasium.core'] = None\ntry:\n    import gymnasium\n"
    "except ImportError:\n    [sys.modules.pop(n) for n in [*sys.modules] if n.startswith('gymnasium')]",
}
"""Events before the import of Gymnasium."""


@pytest.mark.parametrize("first", LOOKS)
def test_no_event_before_the_import_of_gymnasium_prevents_the_registration(first):
    code = (
        f"import concurrent.futures, importlib.util, sys, spidar_gym\n{LOOKS[first]}\nimport gymnasium\n"
        "print(*(name for name in gymnasium.registry if name.startswith('spidar_gym/')))\n"
        "assert not any(type(finder).__name__ == '_Registration' for finder in sys.meta_path[:1])\n"
        "assert importlib.reload(spidar_gym) and importlib.util.find_spec('gymnasium')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == list(ENVIRONMENTS)


def test_without_gymnasium_its_import_fails_as_always_and_the_package_works():
    code = (
        "import sys, spidar_gym.control\nsys.modules['gymnasium'] = None\n"
        "try:\n    import gymnasium\nexcept ImportError as error:\n    print(type(error).__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["ModuleNotFoundError"]


@pytest.mark.parametrize("control", ["core", "python", "vector"])
@pytest.mark.parametrize("name", ["Hover-v0", "Path-v0", "Crawl-v0", "Course-v0"])
def test_a_reward_term_added_to_a_task_works_in_all_environments(monkeypatch, name, control):
    """The guide's recipe for a reward term, which edits one file."""
    kind = KINDS[f"spidar_gym/{name}"].task_type
    page = next(each for each in kind.__mro__ if "terms" in vars(each))
    own = page.terms
    weights = {term: (0.9 * weight, text) for term, (weight, text) in page.reward_terms.items()}
    monkeypatch.setattr(page, "reward_terms", {**weights, "calm": (0.1, "1 / (1 + P / 1000 W)")})
    calmness = lambda robots: {"calm": 1.0 / (1.0 + robots.power / 1e3)}  # noqa: E731 - as in a task's file
    monkeypatch.setattr(page, "terms", lambda task, robots: own(task, robots) | calmness(robots))
    if control == "vector":
        vector = gymnasium.make_vec(f"spidar_gym/{name}", num_envs=2)
        vector.reset(seed=0)
        *_, info = vector.step(np.zeros(vector.action_space.shape))
        calm, power = info["reward_calm"][1], info["power_w"][1]
        assert info["term"].shape == (2, len(weights) + 1)
        vector.close()
    else:
        env = gymnasium.make(f"spidar_gym/{name}", control=control)
        env.reset(seed=0)
        _, reward, *_, info = env.step(np.zeros(env.action_space.shape))
        calm, power = info["reward_calm"], info["power_w"]
        terms = {**weights, "calm": (0.1, "")}
        assert reward == pytest.approx(sum(w * info[f"reward_{term}"] for term, (w, _) in terms.items()), abs=1e-12)
    assert calm == pytest.approx(1.0 / (1.0 + power / 1e3), abs=1e-12)
