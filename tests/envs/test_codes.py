"""Pins words of `info` as codes: those of the native vector, from which every word can be recovered."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from spidar_gym.envs.codes import Coded
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import COURSE, ENVIRONMENTS, HOVER
from spidar_gym.errors import InvalidValueError, UnknownNameError


@pytest.mark.parametrize("control", ["core", "python"])
@pytest.mark.parametrize("name", [name for name in ENVIRONMENTS if name != COURSE])
def test_codes_are_those_of_the_native_vector_and_lead_back_to_the_words(name, control):
    coded, plain = (gymnasium.make(name, control=control, max_episode_steps=30) for _ in range(2))
    coded, many = Coded(coded), gymnasium.make_vec(name, 1, max_episode_steps=30)
    told, known, all_told = coded.reset(seed=2)[1], plain.reset(seed=2)[1], many.reset(seed=2)[1]
    rng = np.random.default_rng(0)
    for _ in range(30):
        assert not any(isinstance(value, str) for value in told.values())
        words = {key: value for key, value in known.items() if isinstance(value, str)}
        assert told.keys() == {f"{key}_code" if key in words else key for key in known}
        for key, word in words.items():
            code = told[f"{key}_code"]
            assert code == all_told[f"{key}_code"][0]
            if key == "shortfalls":
                assert word == ", ".join(each for k, each in enumerate(coded.words[key]) if code >> k & 1)
            else:
                assert word in ((coded.words[key][code],) if code >= 0 else ("", "none"))
        action = rng.uniform(-1.0, 1.0, plain.action_space.shape).astype(np.float32)
        told, known, all_told = coded.step(action)[4], plain.step(action)[4], many.step(action[None])[4]


def test_a_failure_has_the_number_of_its_word():
    env = Coded(gymnasium.make(HOVER, action_mode="direct"))
    env.reset(seed=0)
    over = False
    while not over:
        *_, over, _, info = env.step(-np.ones(40))
    assert env.words["failure"][info["failure_code"]] in ("contact", "tilt", "position")
    env.reset(seed=0)
    env.unwrapped.plant.data.qpos[:] = np.nan
    assert env.words["failure"][env.step(np.zeros(40))[4]["failure_code"]] == "diverged"


def test_a_course_reports_its_phases_as_codes():
    env, plain = Coded(gymnasium.make(COURSE)), gymnasium.make(COURSE)
    told, known = env.reset(seed=1)[1], plain.reset(seed=1)[1]
    for _ in range(4):
        assert env.words["phase"][told["phase_code"]] == known["phase"]
        told, known = env.step(np.zeros(8))[4], plain.step(np.zeros(8))[4]


def test_everything_but_info_is_the_environments_and_a_spec_makes_it_again():
    env, plain = Coded(gymnasium.make(HOVER, max_episode_steps=5)), gymnasium.make(HOVER, max_episode_steps=5)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert isinstance(again, Coded)
    seen = [e.reset(seed=1, options={"forms": "form1"})[0] for e in (env, again, plain)]
    for _ in range(5):
        assert np.array_equal(seen[0], seen[1])
        assert np.array_equal(seen[0], seen[2])
        steps = [e.step(np.full(6, 0.1)) for e in (env, again, plain)]
        assert len({step[1:4] for step in steps}) == 1
        seen = [step[0] for step in steps]
    assert steps[0][3]


class Talking(HoverEnv):
    """An environment with additional words in `info`."""

    words = {"mood": ("calm", "cross")}
    mood = "calm"

    def tell(self, fleet, robot=0):
        """The hover's `info`, and one more word."""
        return super().tell(fleet, robot) | {"mood": self.mood}


def test_an_environment_can_have_additional_words():
    env = Coded(Talking())
    env.reset(seed=0)
    env.unwrapped.mood = "cross"
    assert env.step(np.zeros(6))[4]["mood_code"] == 1
    env.unwrapped.mood = "merry"
    with pytest.raises(UnknownNameError, match="unknown mood 'merry'; valid: calm, cross"):
        env.step(np.zeros(6))
    env.words.pop("mood")
    with pytest.raises(UnknownNameError, match="unknown word of info 'mood'; valid: qp_status, failure"):
        env.step(np.zeros(6))


def test_another_packages_environment_is_refused():
    with pytest.raises(InvalidValueError, match="an environment of spidar_gym"):
        Coded(gymnasium.make("CartPole-v1"))
