"""Pins how Gymnasium makes a native vector, and the arguments of reset: masks, seeds, values for each robot."""

import copy
import json
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import CRAWL, ENVIRONMENTS, HOVER
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.robot import FORMS

QUICK: dict[str, Any] = {"forms": "form1", "wake": False}
START = {
    "goals": [[0.0, 0.0, FORMS["form1"].tolist()], [0.1, 0.4, FORMS["form2"].tolist()]],
    "position": [0.01, 0.0, -0.02],
    "rotation": [0.0, 0.03, 0.0],
}


def make(name=HOVER, num_envs=2, *args, **options) -> Any:
    return gymnasium.make_vec(name, num_envs, *args, **options)


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("mode", [None, "vector_entry_point"])
def test_gymnasium_makes_the_native_vector(name, mode):
    env = make(name, 3, mode, num_threads=2, autoreset_mode=AutoresetMode.SAME_STEP)
    assert isinstance(env, NativeVectorEnv)
    assert env.spec is not None
    assert env.spec.id == name
    assert env.spec.max_episode_steps == ENVIRONMENTS[name].horizon
    assert env.num_envs == 3
    # In the metadata, as in Gymnasium's vectors, and as an attribute, which TorchRL reads.
    assert env.metadata["autoreset_mode"] is env.autoreset_mode is AutoresetMode.SAME_STEP
    single = gymnasium.make(name)
    assert env.single_observation_space == single.observation_space
    assert env.single_action_space == single.action_space
    assert env.reset(seed=0)[0] in env.observation_space
    env.close()


@pytest.mark.parametrize(
    ("arguments", "steps"),
    [
        ({}, 800), ({"horizon_s": 40.0}, 1600), ({"max_episode_steps": 60}, 60), ({"horizon_s": 1.5}, 60),
        ({"max_episode_steps": 1600}, 1600), ({"horizon_s": 1.5, "max_episode_steps": 800}, 60),
        ({"horizon_s": 40.0, "max_episode_steps": 800}, 800), ({"horizon_s": 40.0, "max_episode_steps": -1}, None),
    ],
)  # fmt: skip
@pytest.mark.parametrize("through", ["json", "pickle", "deepcopy"])
def test_a_vectors_spec_has_the_steps_of_its_episodes_and_makes_it_again(arguments, steps, through):
    env = make(num_envs=2, **QUICK, **arguments)
    for _ in range(2):
        assert env.spec is not None
        assert env.spec.max_episode_steps == steps
        spec = {
            "json": lambda spec: EnvSpec.from_json(json.dumps(json.loads(spec.to_json()))),
            "pickle": lambda spec: pickle.loads(pickle.dumps(spec)),
            "deepcopy": copy.deepcopy,
        }[through](env.spec)
        env.close()
        env = gymnasium.make_vec(spec)
        assert env.num_envs == 2
    env.close()


@pytest.mark.parametrize(
    "arguments", [{"max_episode_steps": 6}, {"horizon_s": 0.15}, {"horizon_s": 0.15, "max_episode_steps": 800}]
)
def test_its_episodes_end_and_are_evaluated_there(arguments):
    arguments = {**QUICK, "perturbation": 0.0, **arguments}
    env = make(**arguments)
    env.reset(seed=0)
    steps = [env.step(np.zeros((2, 6))) for _ in range(13)]
    assert [truncated.all() for *_, truncated, _ in steps] == [False] * 5 + [True] + [False] * 6 + [True]
    assert [info["is_success"].all() for *_, info in steps] == [False] * 5 + [True] + [False] * 6 + [True]
    env.close()
    env = make(**{**arguments, "horizon_s": 0.15, "max_episode_steps": -1})
    env.reset(seed=0)
    steps = [env.step(np.zeros((2, 6))) for _ in range(9)]
    assert not any(truncated.any() for *_, truncated, _ in steps)
    assert [info["is_success"].all() for *_, info in steps] == [False] * 5 + [True] * 4
    env.close()


def masks(info, names):
    """Masks of a vector's `info`: the robots for which each name has a value."""
    found = {}
    for name in names:
        found[name] = info[f"_{name}"].tolist() if f"_{name}" in info else None
        if isinstance(info.get(name), dict):
            inner = [key for key in ("thrust", "is_success", "position_error") if key in info[name]]
            found[name] = found[name], {key: info[name][f"_{key}"].tolist() for key in inner}
    return found


@pytest.mark.parametrize("mode", AutoresetMode)
def test_info_has_the_layout_of_gymnasiums_vector(mode):
    options = {**QUICK, "action_mode": "direct", "max_episode_steps": 12}
    native = make(num_envs=3, autoreset_mode=mode, **options)
    own = make(HOVER, 3, "sync", vector_kwargs={"autoreset_mode": mode}, **options)
    names = ["thrust", "is_success", "position_error", "final_obs", "final_info"]
    rng = np.random.default_rng(0)
    (seen, told), (expected, known) = native.reset(seed=4), own.reset(seed=4)
    for _ in range(30):
        assert masks(told, names) == masks(known, names)
        np.testing.assert_allclose(seen, expected, atol=1e-5)
        for name in names[:3]:
            np.testing.assert_allclose(told[name][told[f"_{name}"]], known[name][known[f"_{name}"]], atol=1e-9)
        if "final_obs" in known:
            for k in np.flatnonzero(known["_final_obs"]):
                np.testing.assert_allclose(told["final_obs"][k], known["final_obs"][k], atol=1e-5)
                np.testing.assert_allclose(told["final_info"]["thrust"][k], known["final_info"]["thrust"][k], atol=1e-9)
        action = np.concatenate([rng.uniform(-0.9, 0.0, (3, 8)), rng.normal(0.0, 0.1, (3, 32))], axis=1)
        action = action.astype(np.float32)
        seen, rewards, terminated, truncated, told = native.step(action)
        expected, ours, *ends, known = own.step(action)
        np.testing.assert_allclose(rewards, ours, atol=1e-9)
        assert np.array_equal([terminated, truncated], ends)
        over = terminated | truncated
        if mode is AutoresetMode.DISABLED and over.any():
            assert masks(told, names) == masks(known, names)
            seen, told = native.reset(options={"reset_mask": over})
            expected, known = own.reset(options={"reset_mask": over})
    native.close()
    own.close()


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_info_is_arrays_that_other_libraries_can_take_without_a_copy(name):
    env = make(name, 3, max_episode_steps=2, autoreset_mode="SameStep")
    infos = [env.reset(seed=0)[1]]
    infos += [env.step(np.zeros(env.action_space.shape))[4] for _ in range(2)]
    infos.append(infos[-1]["final_info"])
    for info in infos:
        for key, value in info.items():
            if key == "final_info":
                continue
            assert value.flags.c_contiguous, key  # JAX refuses views into records
            assert np.array_equal(np.from_dlpack(value), value), key
    env.close()


def test_gymnasiums_wrappers_take_it():
    env = DictInfoToList(RecordEpisodeStatistics(make(num_envs=2, max_episode_steps=3, **QUICK)))
    env.reset(seed=0)
    lengths = [[one["episode"]["l"] for one in env.step(np.zeros((2, 6)))[4] if "episode" in one] for _ in range(3)]
    assert lengths == [[], [], [3, 3]]
    env.close()


def test_every_robot_has_its_own_disturbances_forms_and_start():
    env = make(num_envs=4, **QUICK)
    winds: list[Any] = [{"wind": 3.0}, None, {"lost_rotor": 3, "fault_time": 0.05}, {}]
    chosen: dict[str, Any] = {
        "disturbances": winds, "forms": ["form1", "form2", "mixed", "form3"], "start": [None, None, None, START]
    }  # fmt: skip
    env.reset(seed=3, options=chosen)
    singles: list[Any] = []
    for k in range(4):
        single = HoverEnv(control="core", **QUICK)
        single.reset(seed=3 + k, options={name: values[k] for name, values in chosen.items()})
        singles.append(single)
    rng = np.random.default_rng(1)

    def fly(ticks):
        for _ in range(ticks):
            actions = rng.normal(0.0, 0.2, (4, 6)).astype(np.float32)
            seen, rewards, *_, info = env.step(actions)
            for k, single in enumerate(singles):
                observation, reward, _, _, told = single.step(actions[k])
                np.testing.assert_allclose(seen[k], observation, atol=1e-5)
                np.testing.assert_allclose(info["thrust"][k], told["thrust"], atol=1e-8)
                assert rewards[k] == pytest.approx(reward, abs=1e-9)

    fly(20)
    # A robot keeps its options until they are replaced, and a masked reset leaves the other robots alone.
    mask = np.array([True, False, False, True])
    env.reset(options={"reset_mask": mask, "forms": "form2", "disturbances": {"push": 5.0}})
    for k in np.flatnonzero(mask):
        singles[k].reset(options={"forms": "form2", "disturbances": {"push": 5.0}})
    fly(10)
    env.reset(options={"start": None})
    for single in singles:
        single.reset(options={"start": None})
    fly(5)
    env.close()


def test_a_start_may_have_more_forms_than_a_sampled_episode():
    env = make(num_envs=2, horizon_s=1.0, wake=False)
    env.reset(seed=0)
    q = FORMS["form1"].tolist()
    goals = [[0.1 * k, 0.1 * k, q] for k in range(30)]
    env.reset(seed=0, options={"start": [None, {**START, "goals": goals}]})
    assert env.robots["goals"][1] == 30
    for _ in range(41):
        env.step(np.zeros((2, 6)))
    env.close()


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "an unknown option": ({"options": {"form": "form1"}}, "did you mean forms"),
    "a mask of another length": ({"options": {"reset_mask": np.ones(2, bool)}}, "3 flags"),
    "a mask of numbers": ({"options": {"reset_mask": np.ones(3)}}, "3 flags"),
    "an empty mask": ({"options": {"reset_mask": [False] * 3}}, "at least one of them"),
    "too few disturbances": ({"options": {"disturbances": [{}, {}]}}, "a list of 3"),
    "one bad wind": ({"options": {"disturbances": [{}, {"wind": -1.0}, {}]}}, "at least 0"),
    "too many forms": ({"options": {"forms": ["form1"] * 4}}, "a list of 3"),
    "an unknown form": ({"options": {"forms": ["form1", "form9", "form1"]}}, "unknown form sequence"),
    "a start without goals": ({"options": {"start": {"position": [0, 0, 0]}}}, "goals"),
    "one bad start": ({"options": {"start": [None, {**START, "position": [99, 0, 0]}, None]}}, "within"),
    "a good value before a bad one": ({"options": {"disturbances": {"wind": 1.0}, "forms": "form9"}}, "form sequence"),
    "too few seeds": ({"seed": [1, 2]}, "or 3 of them"),
    "a negative seed": ({"seed": -1, "options": {"disturbances": {"wind": 1.0}}}, "from 0 on"),
    "one negative seed": ({"seed": [0, -1, 2]}, "from 0 on"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_reset_that_is_refused_changes_nothing(case):
    arguments, words = BAD[case]
    env = make(num_envs=3, **QUICK)
    env.reset(seed=1)
    env.step(np.zeros((3, 6)))
    before = env.robots.tobytes()
    with pytest.raises((InvalidValueError, UnknownNameError), match=words) as error:
        env.reset(**arguments)
    assert "\n" not in str(error.value)
    assert env.robots.tobytes() == before
    env.close()


def test_a_crawl_has_no_forms_and_invalid_arguments_are_refused_in_one_line():
    env = make(CRAWL, 2)
    with pytest.raises(UnknownNameError, match="valid: reset_mask, disturbances"):
        env.reset(options={"forms": "form1"})
    env.close()
    with pytest.raises(InvalidValueError, match="NextStep, SameStep, Disabled"):
        make(autoreset_mode="never")
    for steps in (0, -2):
        with pytest.raises(SpidarError, match="max_episode_steps"):
            make(max_episode_steps=steps)
