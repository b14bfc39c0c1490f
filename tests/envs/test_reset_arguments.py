"""Pins curricula: the task's arguments and the randomisation as options of reset, for one and for each of many."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from support.episodes import assert_same, flight, make, same

from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, GRASP, HOVER, PATH
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.tasks.hover import HoverTask

OTHERS: dict[str, dict[str, Any]] = {
    HOVER: {"forms": "equal", "joint_speed": 1.0, "perturbation": 0.5, "unrestricted": ((0.2, 0.4),)},
    PATH: {"forms": "independent", "path": "lemniscate", "speed": 0.5},
    CRAWL: {"distance": 0.3, "direction": 0.5, "turn": 0.2, "friction": 0.6, "steps": 0.02, "schedule": "overlapped"},
    COURSE: {"gates": ("wall",), "floors": ("plain",), "count": (1, 1), "joint_speed": 0.5},
    GRASP: {"shapes": ("cylinder",), "half_width": (0.2, 0.25), "mass": (0.5, 1.0), "joint_speed": 0.3},
}
"""Arguments of each environment's task other than the defaults."""
RANGES = {"body.total_mass": (16.5, 17.0), "strength": 0.5}


def zeros(env, n=20):
    return np.zeros((n, *env.action_space.shape))


@pytest.mark.parametrize("control", ["core", "python"])
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_an_episode_with_options_is_that_of_the_environment_made_with_them(name, control):
    options = OTHERS[name] | {"randomization": RANGES, "horizon_s": 10.0}
    n = 3 if control == "python" and name == COURSE else 20
    made = make(name, control=control, sensors=True, **options)
    asked = make(name, control=control, sensors=True)
    flight(asked, zeros(asked, 2), seed=8)
    expected = flight(made, zeros(made, n), seed=1) + flight(made, zeros(made, n))
    assert_same(flight(asked, zeros(asked, n), seed=1, options=options) + flight(asked, zeros(asked, n)), expected)
    assert asked.horizon == made.horizon
    assert 16.5 <= asked.sampled_parameters["body.total_mass"] <= 17.0


def test_options_of_reset_stay_until_they_are_replaced():
    env = make()
    env.reset(seed=0, options={"forms": "form2", "disturbances": {"wind": 2.0}})
    env.reset(options={"joint_speed": 1.0})
    assert (env.task.forms, env.task.joint_speed) == ("form2", 1.0)
    start = {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.02, 0.0, 0.0], "rotation": [0.0] * 3}
    env.reset(options={"start": start, "perturbation": 0.0})
    _, info = env.reset(options={"forms": "form1", "randomization": 0.3})
    assert (env.task.forms, env.task.joint_speed) == ("form1", 1.0)
    assert info["position_error"][0] == pytest.approx(-0.02, abs=2e-3)  # the CoG of a randomised robot is slightly off
    made = make(forms="form1", joint_speed=1.0, perturbation=0.0, randomization=0.3, disturbances={"wind": 2.0})
    options = {"start": start}
    assert_same(flight(env, zeros(env), seed=4), flight(made, zeros(made), seed=4, options=options))


def test_an_episode_ends_at_its_own_horizon():
    env = gymnasium.make(HOVER, forms="form1", wake=False)
    env.reset(seed=0)
    assert env.spec is not None
    for horizon_s, steps in ((0.5, 20), (1.0, 40)):
        env.reset(options={"horizon_s": horizon_s})
        ends = [env.step(np.zeros(6))[3] for _ in range(steps)]
        assert ends == [False] * (steps - 1) + [True]
        assert env.spec.max_episode_steps == steps
    capped = gymnasium.make(HOVER, forms="form1", max_episode_steps=10)
    capped.reset(seed=0, options={"horizon_s": 1.0})
    assert [capped.step(np.zeros(6))[3] for _ in range(10)] == [False] * 9 + [True]


REFUSED = [
    ({"joint_speed": -1.0}, InvalidValueError, "joint_speed"),
    ({"joint_speed": 1.0, "forms": "form4"}, UnknownNameError, "form4.*valid: paper, form1"),
    ({"joint_speed": 1.0, "disturbances": {"wind": -1.0}}, InvalidValueError, "wind"),
    ({"joint_speed": 1.0, "start": {"goals": []}}, SpidarError, "goals"),
    ({"joint_speed": 1.0, "randomization": 2.0}, InvalidValueError, "a strength within 0 … 1, ranges by field"),
    ({"randomization": {"body.mass": (1, 2)}}, UnknownNameError, "body.mass.*did you mean body.link_mass"),
    ({"randomization": {"body.total_mass": (17, 16)}}, InvalidValueError, r"a range \(low, high\) \[kg\]"),
    ({"randomization": {"body.total_mass": "heavy"}}, InvalidValueError, r"a range \(low, high\) \[kg\]"),
    ({"randomization": {"body.total_mass": (-1.0, 16.0)}}, InvalidValueError, "values of a robot: total_mass"),
    ({"randomization": "none.toml"}, SpidarError, "none.toml cannot be read.*valid: a TOML file"),
    ({"preset": "tuned"}, UnknownNameError, "reset option 'preset'; valid: forms, start, disturbances, joint_speed"),
]


@pytest.mark.parametrize(("options", "kind", "words"), REFUSED, ids=range(len(REFUSED)))
def test_invalid_options_are_refused_in_one_line_and_the_episode_continues(options, kind, words):
    flights = []
    for asked in (False, True):
        env = make(forms="form1")
        begun = flight(env, zeros(env, 2), seed=3)
        if asked:
            with pytest.raises(kind, match=words) as refusal:
                env.reset(seed=99, options=options)
            assert "\n" not in str(refusal.value)
        begun += [(o, r, t, i) for o, r, t, _, i in (env.step(action) for action in zeros(env, 2))]
        flights.append(begun + flight(env, zeros(env, 2)))
    assert_same(*flights)


def vector(name=HOVER, n=4, **options):
    return gymnasium.make_vec(name, n, autoreset_mode="Disabled", **options).unwrapped


@pytest.mark.parametrize("name", [HOVER, PATH, CRAWL, COURSE])
def test_each_robot_of_a_vector_has_the_episode_of_its_own_arguments(name):
    own = [dict(zip(OTHERS[name], values, strict=True)) for values in zip(*each_of(name), strict=True)]
    masses = [{"body.total_mass": (15.5 + 0.2 * k, 15.6 + 0.2 * k)} for k in range(4)]
    env = vector(name, sensors=True)
    env.reset(seed=99)
    options = {key: [each[key] for each in own] for key in own[0]} | {"randomization": masses}
    observations, _ = env.reset(seed=10, options=options)
    zero = np.zeros((4, *env.single_action_space.shape))
    steps = [env.step(zero) for _ in range(4 if name == COURSE else 30)]
    for k in range(4):
        single = make(name, sensors=True, randomization=masses[k], **own[k])
        assert np.array_equal(single.reset(seed=10 + k)[0], observations[k])
        for step in steps:
            observation, reward, terminated, *_ = single.step(zero[k])
            assert np.array_equal(observation, step[0][k])
            assert (reward, terminated) == (step[1][k], step[2][k])


def each_of(name):
    """Values of four robots for each argument, alternating between another value and the default."""
    usual = make(name).task
    for key, value in OTHERS[name].items():
        if key in ("steps", "floors"):
            yield [value] * 4  # all floors of a vector are of one kind
        else:
            yield [value, getattr(usual, key), value, getattr(usual, key)]


def test_a_masked_reset_with_options_does_not_affect_the_other_robots():
    zero = np.zeros((4, 6))
    flights = []
    for asked in (False, True):
        env = vector()
        env.reset(seed=0, options={"joint_speed": [0.2, 0.4, 0.6, 0.8]})
        for _ in range(10):
            env.step(zero)
        if asked:
            mask = np.array([True, False, False, True])
            env.reset(options={"reset_mask": mask, "perturbation": 0.0, "horizon_s": 30.0})
        flights.append([env.step(zero)[0][1:3] for _ in range(10)])
    assert np.array_equal(*flights)


def test_the_buffers_of_a_vector_stay_the_same_objects():
    env = vector(n=2)
    before = env.buffers
    env.reset(seed=0)
    env.reset(options={"joint_speed": [0.2, 1.0], "disturbances": {"wind": 1.0}})
    env.step(np.zeros((2, 6)))
    assert all(env.buffers[name] is array for name, array in before.items())
    assert (env.robots["episode"]["disturbances"]["wind"] == 1.0).all()


def test_earlier_options_of_a_vector_stay():
    env = vector(n=2)
    env.reset(seed=0, options={"disturbances": [{"wind": 1.0}, {"wind": 2.0}], "forms": ["form1", "form2"]})
    env.reset(seed=3, options={"joint_speed": [0.5, 1.0]})
    steps = [env.step(np.zeros((2, 6)))[0] for _ in range(10)]
    for k, (wind, forms, speed) in enumerate(((1.0, "form1", 0.5), (2.0, "form2", 1.0))):
        single = make(forms=forms, joint_speed=speed, disturbances={"wind": wind})
        single.reset(seed=3 + k)
        assert all(np.array_equal(single.step(np.zeros(6))[0], step[k]) for step in steps)


class Still(HoverTask):
    """The hover as a custom task."""


def test_a_vector_refuses_invalid_options_in_one_line_and_continues():
    env, zero = vector(), np.zeros((4, 6))
    env.reset(seed=0)
    before = env.save()
    mask = np.array([True, False, False, False])
    for options, words in (
        ({"reset_mask": mask, "joint_speed": 1.0}, "all robots, as joint_speed were not given before"),
        ({"joint_speed": [1.0, 2.0]}, "one for all robots, or a list of 4"),
        ({"joint_speed": [1.0, 2.0, 3.0, -4.0]}, "joint_speed = -4.0"),
        ({"randomization": [0.0, 0.5, 1.0, 2.0]}, "a strength within 0 … 1"),
    ):
        with pytest.raises(InvalidValueError, match=words):
            env.reset(options=options)
    assert env.save() == before
    judged = vector(task=Still())
    judged.reset(seed=0, options={"joint_speed": 1.0})
    with pytest.raises(InvalidValueError, match="one value for all robots with a custom task"):
        judged.reset(options={"joint_speed": [1.0, 2.0, 3.0, 4.0]})
    plain = vector(joint_speed=1.0)
    assert np.array_equal(judged.reset(seed=5)[0], plain.reset(seed=5)[0])
    assert all(same(judged.step(zero)[0], plain.step(zero)[0]) for _ in range(10))


def test_a_saved_robot_is_restored_only_into_robots_with_the_same_arguments():
    env, zero = vector(n=3), np.zeros((3, 6))
    env.reset(seed=0, options={"joint_speed": [0.5, 1.0, 0.5], "forms": "independent"})
    env.step(zero)
    saved = env.save([0])
    with pytest.raises(SpidarError, match="saved robots are of another set of options"):
        env.restore(saved, [1])
    env.restore(saved, [2])
    for _ in range(20):
        observations, *_ = env.step(zero)
        assert np.array_equal(observations[0], observations[2])
