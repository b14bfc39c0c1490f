"""Pins the trials: outcomes depend only on controller and seed; shared samples, the settling second, losses."""

from dataclasses import replace

import numpy as np
import pytest

from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.presets import controller_config
from spidar_gym.paper import trial
from spidar_gym.paper.trial import CONDITIONS, Trial, fly, fly_all

PAPER, TUNED = controller_config("paper"), controller_config("tuned")
PUSHED_OVER = replace(PAPER, centroidal=CentroidalConfig(attitude_gains=((-60.0, 0.0, -5.0),) * 3))
"""A controller with positive feedback of the attitude, which turns the robot over."""
TICKS = 40
"""Ticks per second."""


@pytest.fixture
def made(monkeypatch):
    """Return the list of the trials' environments, in order."""
    envs, make = [], trial.make_env
    monkeypatch.setattr(trial, "make_env", lambda *job: envs.append(make(*job)) or envs[-1])
    return envs


def errors(config, flight):
    """Compute the squared errors of every tick with the environment's public interface."""
    env = trial.make_env(config, flight)
    env.reset(seed=flight.seed)
    squares = []
    for _ in range(round(flight.seconds * TICKS)):
        info = env.step(np.zeros(env.action_space.shape))[4]
        squares.append([np.sum(info["position_error"] ** 2), np.sum(info["attitude_error"] ** 2)])
    return np.array(squares)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_errors_are_root_mean_squares_without_the_first_second(condition):
    flight = Trial(condition, 0.6, 4, 1.5)
    squares, outcome = errors(PAPER, flight), fly(PAPER, flight)
    np.testing.assert_allclose([outcome.position, outcome.attitude], np.sqrt(squares[TICKS:].mean(axis=0)), rtol=1e-12)
    assert np.abs(np.sqrt(squares.mean(axis=0)) / [outcome.position, outcome.attitude] - 1.0).max() > 0.01


def test_all_ticks_of_a_flight_shorter_than_the_settling_second_count():
    flight = Trial("nominal", 0.6, 4, 0.5)
    outcome = fly(PAPER, flight)
    expected = np.sqrt(errors(PAPER, flight).mean(axis=0))
    np.testing.assert_allclose([outcome.position, outcome.attitude], expected, rtol=1e-12)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_different_controllers_meet_the_same_forms_the_same_robot_and_the_same_start(condition, made):
    flight, met = Trial(condition, 1.0, 7, 0.1), []
    for config in (PAPER, TUNED, PUSHED_OVER):
        fly(config, flight)
        env = made[-1]
        goals = [np.concatenate([[g.start, g.deadline], g.joint_target]) for g in env.progress.goals]
        met.append((np.array(goals), np.concatenate([np.zeros(1), *map(np.ravel, env.sampled_parameters.values())])))
    for goals, draws in met[1:]:
        np.testing.assert_array_equal(goals, met[0][0])
        np.testing.assert_array_equal(draws, met[0][1])
    fly(PAPER, replace(flight, seed=8))
    assert not np.array_equal(made[-1].progress.goals[0].joint_target, met[0][0][0, 2:])


def test_conditions_are_the_nominal_robot_and_a_randomised_one_with_sensors(made):
    for condition, randomised in (("nominal", False), ("randomised", True)):
        flight = Trial(condition, 0.2, 5, 0.1)
        fly(PAPER, flight)
        env = made[-1]
        assert env.plant.config.sense == randomised
        assert bool(env.sampled_parameters) == randomised
        assert env.plant.config.aero.wake


def test_the_scenarios_joint_speed_replaces_the_controllers(made):
    speeds = {}
    for speed in (0.2, 1.0):
        flight = Trial("nominal", speed, 6, 4.0)
        fly(replace(PAPER, joint_speed=0.5), flight)
        env = made[-1]
        assert env.controller.config.joint_speed == env.task.joint_speed == env.plant.config.joint_speed == speed
        assert env.progress.current > 0
        speeds[speed] = np.abs(env.controller.last_step.joint_velocity).max()
    assert speeds[0.2] <= 0.2 * (1.0 + 1e-9)


def test_a_lost_flight_ends_early_with_a_reason_and_still_has_an_error(made):
    flown = [fly(PUSHED_OVER, Trial("nominal", 1.0, 1, 8.0)), fly(PAPER, Trial("nominal", 1.0, 1, 1.5))]
    assert flown[0].failure in ("tilt", "position", "contact")
    assert flown[0].attitude > 0.05 > flown[1].attitude
    assert flown[1].failure == ""
    assert made[-1].progress.ticks == round(1.5 * TICKS)


def test_a_calm_flight_never_softens_its_allocation_and_one_that_turns_over_does():
    calm, wild = fly(PAPER, Trial("nominal", 0.6, 3, 1.0)), fly(PUSHED_OVER, Trial("nominal", 1.0, 1, 8.0))
    assert calm.softened == 0 < wild.softened
    assert 0.5 < calm.joint_torque < 7.01


def test_slow_joints_are_late_and_the_papers_are_not():
    """Joints that ramp up over three seconds miss deadlines, since the schedule assumes full speed from the start."""
    flight = Trial("nominal", 1.0, 9, 5.0)
    slow = replace(PAPER, compensation=replace(PAPER.compensation, joint_ramp=3.0))
    assert fly(PAPER, flight).late == 0
    assert fly(slow, flight).late > 0


def test_outcomes_come_in_the_order_of_the_jobs_and_every_flight_is_counted():
    flights = [Trial("nominal", 0.6, seed, 0.2) for seed in (3, 1, 2)]
    jobs, done = [(config, flight) for flight in flights for config in (PAPER, TUNED)], []
    assert fly_all(iter(jobs), on_done=lambda: done.append(None)) == [fly(*job) for job in jobs]
    assert len(done) == len(jobs)


SHORT = [Trial("nominal", 1.0, 1, 1.5), Trial("randomised", 1.0, 1, 1.5), Trial("nominal", 1.0, 2, 1.5)]


def test_an_outcome_does_not_depend_on_earlier_flights_or_the_number_of_processes():
    alone = [fly(PAPER, trial) for trial in SHORT]
    assert [fly(PAPER, trial) for trial in reversed(SHORT)] == alone[::-1]
    assert fly_all([(PAPER, trial) for trial in SHORT], workers=2) == alone
    assert len({outcome.attitude for outcome in alone}) == len(alone)


def test_tuned_has_smaller_errors_than_paper_on_the_same_forms():
    trial = Trial("nominal", 1.0, 3, 5.0)
    paper, tuned = fly(PAPER, trial), fly(controller_config("tuned"), trial)
    assert tuned.attitude < 0.5 * paper.attitude
    assert tuned.joint_torque < 7.0 + 1e-3
    assert paper.failure == tuned.failure == ""
