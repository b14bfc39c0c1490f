"""Pins policies on a course: from observations they reproduce the rule, with its parameters or learned ones."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from spidar_gym.control.course.gates import Course, Gate
from spidar_gym.control.course.rule import PRESENT, course_rule
from spidar_gym.control.course.target import ACTION, take_target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.envs.registry import COURSE, CRAWL
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.artifact import Artifact, LearnedPolicy, read_artifact, write_artifact
from spidar_gym.policies.course import HERE, RANGES, CoursePolicy, Sight, rule_numbers
from spidar_gym.robot import FORMS

SHORT = Course((Gate("wall", 2.3, 2.5, 0.6), Gate("platform", 4.4, 7.9, 0.2)), Pose2(6.1, 0.1, 0.1))


def test_what_is_seen_is_the_map_from_where_the_robot_is():
    env = gymnasium.make(COURSE, course=SHORT, disable_env_checker=True).unwrapped
    observation, _ = env.reset(seed=0)
    for _ in range(24):
        observation, *_ = env.step(env.rule().action(env.course, env.seen.position_w))
    sight, x = Sight(observation), float(env.seen.position_w[0])
    assert x > 0.1
    assert sight.phase == env.controller.phase
    assert [gate.kind for gate in sight.course.gates] == [gate.kind for gate in SHORT.gates]
    for seen, gate in zip(sight.course.gates, SHORT.gates, strict=True):
        np.testing.assert_allclose(
            (seen.begin - HERE, seen.end - HERE, seen.size), (gate.begin - x, gate.end - x, gate.size), atol=1e-5
        )
    goal = sight.course.goal
    np.testing.assert_allclose((goal.x - HERE, goal.y, goal.yaw), (SHORT.goal.x - x, 0.1, 0.1), atol=1e-5)
    np.testing.assert_allclose(sight.floor, 0.2, atol=1e-5)


def test_it_goes_where_the_rule_goes():
    env = gymnasium.make(COURSE, course=SHORT, disable_env_checker=True).unwrapped
    observation, _ = env.reset(seed=0)
    policy = CoursePolicy()
    for _ in range(80):
        action, rule, here = policy.act(observation), env.rule(), env.seen.position_w
        told = take_target(action, SHORT, here)
        wanted = take_target(rule.action(SHORT, here), SHORT, here)
        assert told.flies == wanted.flies
        np.testing.assert_allclose((told.x, told.y, told.z), (wanted.x, wanted.y, wanted.z), atol=1e-4)
        observation, _, over, _, info = env.step(action)
        if over or info["is_success"]:
            break
    assert info["is_success"]
    np.testing.assert_array_equal(policy.act_batch(observation[None])[0], policy.act(observation))


# ---- the rule with learned parameters ----

WHOLE = Course(
    (Gate("wall", 2.3, 2.5, 0.6), Gate("beam", 6.6, 7.0, 0.6), Gate("slot", 10.1, 10.4, 1.5, 0.3)),
    Pose2(14.0, 0.1, 0.1),
)


def says(numbers, env_id=COURSE):
    """Build an artifact with these parameters as constant output."""
    size = 193
    return Artifact(
        "numbers", "learned", "Numbers.", env_id, {"action_mode": "waypoint"},
        (np.zeros((len(numbers), size), np.float32),), (np.asarray(numbers, np.float32),), np.zeros(size),
        np.ones(size), output="rule",
    )  # fmt: skip


def test_an_artifact_of_zeros_acts_as_the_rule_bit_for_bit_and_others_otherwise(tmp_path):
    write_artifact(says(np.zeros(len(RANGES))), tmp_path / "zeros.npz")
    rule, zeros = CoursePolicy(), LearnedPolicy(read_artifact(tmp_path / "zeros.npz"))
    faster = LearnedPolicy(says([0.5 * name.endswith("speed") for name in RANGES]))
    env = gymnasium.make(COURSE, course=SHORT, sensors=True, disable_env_checker=True).unwrapped
    observation, _ = env.reset(seed=0)
    seen, others = [], 0
    for _ in range(30):
        seen.append(observation)
        action = rule.act(observation)
        np.testing.assert_array_equal(zeros.act(observation), action)
        others += not np.array_equal(faster.act(observation), action)
        observation, *_ = env.step(action)
    assert others > 20
    together = faster.act_batch(np.array(seen))
    assert together.shape == (30, len(ACTION))
    for row, one in zip(together, seen, strict=True):
        np.testing.assert_array_equal(row, faster.act(one))


def test_every_number_is_the_rules_at_zero_and_a_bound_at_one():
    assert rule_numbers(np.zeros(len(RANGES))) == PRESENT
    assert {name for name, _ in zip(RANGES, PRESENT.__slots__, strict=True)} == {*PRESENT.__slots__}
    low, high = rule_numbers(-np.ones(len(RANGES))), rule_numbers(np.ones(len(RANGES)))
    for name, bounds in RANGES.items():
        assert (getattr(low, name), getattr(high, name)) == pytest.approx(bounds)
        assert bounds[0] < getattr(PRESENT, name) < bounds[1]


def test_every_number_decides_something():
    places = [
        (x, y, z, q, phase)
        for x in np.arange(0.0, 14.0, 0.1)
        for y, z, q, phase in (
            (0.0, 0.15, FORMS["form1"], "lie"), (0.0, 1.5, FORMS["form1"], "fly"), (0.28, 1.4, FORMS["form3"], "fly"),
            (0.3, 1.4, FORMS["form3"] + 0.1, "fly"),
        )
    ]  # fmt: skip

    def goes(numbers):
        return [course_rule(WHOLE, np.array([x, y, z]), q, phase, numbers=numbers) for x, y, z, q, phase in places]

    present = goes(PRESENT)
    for name, bounds in RANGES.items():
        assert any(goes(replace(PRESENT, **{name: bound})) != present for bound in bounds), name


def test_within_their_bounds_no_numbers_have_it_wait_for_ever():
    for name in ("wall_beyond", "slot_beyond", "beam_beyond"):
        assert RANGES[name][0] > 0.0
    assert RANGES["beam_before"][1] + RANGES["near"][1] < RANGES["beam_crawls"][0]
    assert RANGES["near"][1] < RANGES["goal_crawls"][0]


def test_numbers_of_another_environment_or_of_another_rule_are_refused():
    with pytest.raises(InvalidValueError, match="network"):
        says(np.zeros(len(RANGES)), CRAWL)
    with pytest.raises(InvalidValueError, match="network"):
        says(np.zeros(len(ACTION)))
