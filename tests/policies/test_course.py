"""Pins policies on a course: from what they see they go where the rule goes by the map."""

import gymnasium
import numpy as np

from spidar_gym.control.course.gates import Course, Gate
from spidar_gym.control.course.target import take_target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.envs.registry import COURSE
from spidar_gym.policies.course import HERE, CoursePolicy, Sight

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
