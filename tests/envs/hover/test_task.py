"""Pins the hover task: schedules of forms, the initial offset, height, words of failure, its options as arguments."""

from dataclasses import fields
from itertools import pairwise

import numpy as np
from support.episodes import make
from support.page_robots import robots_with

from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.tasks.hover import SEQUENCES, HoverTask
from spidar_gym.tasks.robots import HoverRobots
from spidar_gym.tasks.start import draw_start


def test_the_feet_of_form_3_hover_half_a_metre_above_the_floor():
    env = make(forms="form3", perturbation=0.0)
    env.reset(seed=0)
    feet = [env.plant.data.site(f"foot{leg}").xpos[2] - ROBOT.foot_radius for leg in range(1, 5)]
    np.testing.assert_allclose(feet, 0.5, rtol=0, atol=1e-3)


def test_the_schedule_moves_at_the_joint_speed_and_its_first_goal_is_the_start():
    for forms in SEQUENCES:
        for speed in (0.2, 0.7):
            goals = draw_start(HoverTask(forms=forms, joint_speed=speed), np.random.default_rng(3)).goals
            assert (goals[0].start, goals[0].deadline) == (0.0, 0.0)
            for before, after in pairwise(goals):
                assert after.start >= before.deadline - 1e-9
                fastest = np.abs(after.joint_target - before.joint_target).max() / (after.deadline - after.start)
                assert abs(fastest - speed) < 1e-9
            assert len(goals) == 1 if forms in FORMS else len(goals) >= 3


def test_the_papers_sequence_leaves_form_1_at_4_seconds_and_passes_form_2_without_a_stop():
    goals = draw_start(HoverTask(forms="paper", horizon_s=40.0), np.random.default_rng(0)).goals
    for goal, form in zip(goals, ("form1", "form2", "form3"), strict=True):
        assert np.array_equal(goal.joint_target, FORMS[form])
    assert goals[1].start == 4.0
    assert 0.0 <= goals[2].start - goals[1].deadline <= 0.025
    assert abs(goals[2].deadline - 11.85) < 0.1


def test_legs_are_equal_in_equal_forms_and_move_separately_with_yaw_in_independent_ones():
    rng = np.random.default_rng(0)
    for forms, spread in (("equal", False), ("independent", True)):
        goals = draw_start(HoverTask(forms=forms, horizon_s=60.0), rng).goals
        legs = np.array([goal.joint_target.reshape(4, 4) for goal in goals])
        assert (np.ptp(legs, axis=1).max() > 0.1) == spread
        assert np.ptp(legs[:, :, (0, 2)]) > 0.5


def test_the_initial_offset_grows_with_the_perturbation_and_is_none_at_zero():
    for scale in (0.0, 1.0, 3.0):
        env, offsets = make(forms="form1", perturbation=scale), []
        for seed in range(20):
            info = env.reset(seed=seed)[1]
            offsets.append(np.abs(np.concatenate([info["position_error"], info["attitude_error"]])))
            assert not env.state.velocity_w.any()
            assert not env.state.omega_b.any()
        most = np.max(offsets, axis=0)
        assert np.all(most <= scale * np.array([0.03] * 3 + [0.051] * 3) + 1e-12)
        assert np.all(most >= 0.5 * scale * np.array([0.03] * 3 + [0.05] * 3))


def test_the_words_of_failure_are_the_documented_ones_and_each_has_its_limit():
    task = HoverTask()

    def words(**quantities):
        robots = robots_with(HoverRobots, **{"in_contact": 0, "tilt": 0, "distance": 0} | quantities)
        return [word for word, is_so in task.failed(robots).items() if is_so[0]]

    assert words() == words(tilt=0.99, distance=0.99) == []
    found = {*words(in_contact=1), *words(tilt=1.01), *words(distance=1.01)}
    assert found | {"diverged"} == set(HoverTask.failures)


def test_every_option_of_the_task_is_an_argument_of_the_environment():
    for field in fields(HoverTask):
        env = make(**{field.name: getattr(HoverTask(), field.name)})
        assert env.task == HoverTask()
