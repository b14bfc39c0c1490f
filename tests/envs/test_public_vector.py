"""Compares the native vector's whole public interface with Gymnasium's vector; lists all intended differences."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode

from spidar_gym.envs.codes import Coded
from spidar_gym.envs.registry import COURSE, CRAWL, HOVER, PATH
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.tasks.hover import HoverTask

IDS = (HOVER, PATH, CRAWL, COURSE)
MODES = [*AutoresetMode]
LACKING = {
    "envs": "robots have no environment of their own",
    "env_fns": "as above",
    "call": "as above",
    "get_attr": "as above",
    "set_attr": "as above: options of make_vec and of reset",
    "copy": "every array that is handed out is a copy",
    "observation_mode": "likewise: observations are of one kind",
}
"""Attributes of Gymnasium's vector that the native vector lacks."""
ADDED = {
    "advance", "buffers", "ended", "fleet", "is_closed", "layout", "restore", "robots", "save", "set_autoreset_mode",
    "sight", "task", "turn",
}  # fmt: skip
"""Additional attributes of the native vector."""
OTHERWISE = {
    "np_random": "copies: what is drawn of them moves no robot's; Gymnasium's are the environments' own",
    "np_random_seed": "−1 before the first reset, and where nothing seeds",
    "step": "in the mode Disabled robots go on after their ends, where Gymnasium's own refuses",
    "info": "`randomization` is there where robots are drawn: an empty dictionary is no array; words are codes",
    "spec": "no kwargs of the sync vector",
    "unwrapped": "itself",
}
"""Common attributes that differ, and how."""
ACTIONS = {"reset", "step", "render", "close", "close_extras"}
"""Methods whose effects are compared below."""


def both(name, robots=2, mode=AutoresetMode.NEXT_STEP, **options):
    native = gymnasium.make_vec(name, robots, autoreset_mode=mode, **options)
    own = gymnasium.make_vec(name, robots, "sync", vector_kwargs={"autoreset_mode": mode}, **options)
    return native, own


def public(vector):
    return {name for name in dir(vector) if not name.startswith("_")}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", IDS)
def test_every_public_attribute_equals_that_of_gymnasiums_vector_or_is_listed(name, mode):
    native, own = both(name, mode=mode)
    goals = {"compute_reward", "compute_terminated", "compute_truncated"}
    for began in (False, True):
        assert public(own) - public(native) == LACKING.keys()
        assert public(native) - public(own) - goals == ADDED
        for each in public(own) & public(native) - OTHERWISE.keys() - ACTIONS:
            assert getattr(native, each) == getattr(own, each), each
        if began:
            assert native.np_random_seed == own.np_random_seed == (7, 8)
            drawn = [[rng.random() for rng in vector.np_random] for vector in (native, own)]
            assert drawn[0] == drawn[1]
        for vector in (native, own):
            vector.reset(seed=7)
    for vector in (native, own):
        vector.close()
        assert vector.closed


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", IDS)
def test_it_steps_past_the_ends_of_episodes_as_gymnasiums_vector_does(name, mode):
    own_options = {"hold": 1} if name == COURSE else {}
    native, own = both(name, mode=mode, max_episode_steps=2, **own_options)
    for vector in (native, own):
        vector.reset(seed=3)
    actions = np.zeros(native.action_space.shape, np.float32)
    for k in range(5):
        if mode is AutoresetMode.DISABLED and k in (2, 4):
            moment = native.save()
            native.step(actions)  # the intended difference: the native vector accepts another step
            native.restore(moment)
            with pytest.raises(AssertionError):
                own.step(actions)
            for vector in (native, own):
                vector.reset(options={"reset_mask": np.array([True, True])})
        found, expected = native.step(actions), own.step(actions)
        for a, b in zip(found[:4], expected[:4], strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-6)
        assert ("final_info" in found[4]) == ("final_info" in expected[4])
    native.close()
    own.close()


@pytest.mark.parametrize("drawn", [0.0, 1.0])
@pytest.mark.parametrize("name", IDS)
def test_info_has_the_keys_and_numbers_of_the_single_environment(name, drawn):
    one, native = Coded(gymnasium.make(name, randomization=drawn)), gymnasium.make_vec(name, 2, randomization=drawn)
    single, many = one.reset(seed=4)[1], native.reset(seed=4)[1]
    action = np.full(one.action_space.shape, 0.1, np.float32)
    for _ in range(3):
        names = single.keys() - ({"randomization"} if not drawn else set())
        assert names <= many.keys()
        for key in names - {"randomization"}:
            np.testing.assert_array_equal(many[key][0], single[key], err_msg=key)
        for field, value in single["randomization"].items():
            np.testing.assert_array_equal(many["randomization"][field][0], value)
        single, many = one.step(action)[4], native.step(np.stack([action] * 2))[4]
    one.close()
    native.close()


def test_info_has_the_randomisation_of_an_ended_episode_and_of_randomised_robots_only():
    native, own = both(HOVER, mode=AutoresetMode.SAME_STEP, max_episode_steps=2, randomization=1.0)
    for vector in (native, own):
        vector.reset(seed=4)
    action = np.zeros(native.action_space.shape, np.float32)
    for _ in range(4):
        *_, told = native.step(action)
        *_, known = own.step(action)
        for now, then in ((told, known), (told.get("final_info", {}), known.get("final_info", {}))):
            for field, values in now.get("randomization", {}).items():
                np.testing.assert_array_equal(values, then["randomization"][field], err_msg=field)
    assert "final_info" in told
    _, told = native.reset(seed=4, options={"randomization": [0.0, 1.0]})
    assert told["_randomization"].tolist() == [False, True]
    _, told = native.reset(seed=4, options={"randomization": 0.0})
    assert not {"randomization", "_randomization"} & told.keys()
    native.close()
    own.close()


class Standing(HoverTask):
    """A task of two terms."""

    reward_terms = {"calm": (0.5, "1"), "still": (0.5, "0")}
    failures = ("diverged",)

    def terms(self, robots):
        return {"calm": np.ones(len(robots)), "still": np.zeros(len(robots))}

    def failed(self, robots):
        return {}

    def succeeded(self, robots):
        return np.ones(len(robots), bool)


def test_info_has_the_terms_of_a_task_set_by_reset():
    native = gymnasium.make_vec(HOVER, 2)
    assert "reward_position" in native.reset(seed=0)[1]
    _, told = native.reset(options={"task": Standing})
    assert [(name, told[name].tolist()) for name in told if name.startswith("reward_")] == [
        ("reward_calm", [1.0, 1.0]), ("reward_still", [0.0, 0.0]),
    ]  # fmt: skip
    native.close()


def test_a_mode_that_is_set_later_does_not_change_the_saved_bytes():
    chosen = gymnasium.make_vec(HOVER, 2, task=Standing)
    chosen.set_autoreset_mode("SameStep")
    given = gymnasium.make_vec(HOVER, 2, task=Standing, autoreset_mode="SameStep")
    for vector in (chosen, given):
        vector.reset(seed=0)
    assert chosen.save() == given.save()
    for vector in (chosen, given):
        vector.close()


@pytest.mark.parametrize("through", ["itself", "json"])
@pytest.mark.parametrize("arguments", [{}, {"max_episode_steps": 3}, {"horizon_s": 0.5}, {"max_episode_steps": -1}])
@pytest.mark.parametrize("name", IDS)
def test_the_spec_of_an_environment_makes_a_native_vector(name, arguments, through):
    spec = gymnasium.make(name, **arguments).spec
    if through == "json":
        spec = EnvSpec.from_json(spec.to_json())
    vector = gymnasium.make_vec(spec, num_envs=2)
    assert isinstance(vector, NativeVectorEnv)
    assert vector.spec.max_episode_steps == spec.max_episode_steps
    vector.close()


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("hold", [None, 3])
def test_recordings_play_in_real_time(name, hold):
    options = {} if hold is None or name != COURSE else {"hold": hold}
    one, many = gymnasium.make(name, **options), gymnasium.make_vec(name, 1, **options)
    one.reset(seed=0)
    before = one.unwrapped.state.time
    one.step(np.zeros(one.action_space.shape, np.float32))
    seconds = one.unwrapped.state.time - before
    for env in (one, many):
        assert env.metadata["render_fps"] == pytest.approx(1.0 / seconds, rel=1e-9)
        env.close()


@pytest.mark.parametrize("mode", ["rgb_array", "depth_array"])
@pytest.mark.parametrize("name", IDS)
def test_the_same_state_gives_the_same_picture_to_the_byte_after_any_other_pictures(name, mode):
    options = {"render_mode": mode, "width": 96, "height": 72}
    one, many = gymnasium.make(name, **options), gymnasium.make_vec(name, 2, **options)
    one.reset(seed=0)
    first = one.render()
    one.step(np.full(one.action_space.shape, 0.5, np.float32))
    assert not np.array_equal(one.render(), first)
    one.reset(seed=1)
    later = one.render()
    one.reset(seed=0)
    many.reset(seed=0)
    for picture in (one.render(), one.render(), many.render()[0], many.unwrapped.render([1, 0])[1]):
        assert np.array_equal(picture, first)
    assert np.array_equal(many.unwrapped.render([1])[0], later)
    one.close()
    many.close()
