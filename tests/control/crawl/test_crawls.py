"""Pins whole crawls in the simulator: the torso's final pose, smooth thrust, loads of floor and servos."""

import numpy as np
import pytest
from support.crawls import ALL, OPTIMAL, ROTOR_LEG, STAND, STEP, attitude, engine, ride

from spidar_gym.control.crawl.controller import Crawler, CrawlerConfig
from spidar_gym.control.crawl.footsteps import Lift, Stand
from spidar_gym.robot import ROBOT

JOURNEYS = pytest.mark.parametrize("command", [STEP, STAND, ALL, Lift((0,))], ids=["move", "stand", "lift", "lift one"])


def test_one_cycle_moves_the_torso_where_it_was_sent():
    states = ride(STEP).states
    np.testing.assert_allclose(states[-1].position_w - states[0].position_w, [0.1, 0.0, 0.0], atol=0.005)
    assert abs(states[-1].quat_wb[0]) > 1.0 - 1e-4


@JOURNEYS
def test_thrust_comes_and_goes_without_a_jolt_and_is_off_at_the_end(command):
    crawl = ride(command)
    assert crawl.over
    thrust = np.array([np.zeros(8), *(command.thrust for command in crawl.commands)])
    assert np.abs(np.diff(thrust.sum(axis=1))).max() <= 5.0
    assert thrust.max() <= ROBOT.max_thrust
    assert thrust.sum(axis=1).max() > 15.0
    assert not thrust[-1].any()
    forces = np.array([np.zeros((8, 3)), *(tick.forces_l for tick in crawl.ticks)])
    np.testing.assert_allclose(np.linalg.norm(forces, axis=2), thrust, atol=1e-9)
    assert np.linalg.norm(np.diff(forces, axis=0), axis=2).max() <= 1.0


@JOURNEYS
def test_every_tick_of_a_crawl_is_answered_with_an_optimum(command):
    assert {tick.allocation.status for tick in ride(command).ticks} <= set(OPTIMAL)


def test_without_blending_forces_would_jump_when_the_mode_changes():
    forces = np.array([tick.forces_l for tick in ride(Stand(0.05, seconds=0.0), blend_time=0.0).ticks])
    assert np.linalg.norm(np.diff(forces, axis=0), axis=2).max() > 5.0


@pytest.mark.parametrize("leg", range(4))
def test_lifting_a_leg_raises_its_foot_alone_by_its_own_rotors_within_the_joint_torque(leg):
    crawl = ride(Lift((leg,), seconds=0.2))
    others = np.arange(4) != leg
    assert np.array(crawl.heights)[crawl.during("hold"), leg].min() > 0.1
    assert not any(crawl.touches[k].feet[leg] for k in crawl.during("hold"))
    assert crawl.touches[-1].feet.all()
    for command, tick, touch, heights in zip(crawl.commands, crawl.ticks, crawl.touches, crawl.heights, strict=True):
        assert touch.feet[others].all()
        assert not touch.ducts
        assert np.abs(heights[4:]).max() < 1e-4, "pegs"
        assert not command.thrust[others[ROTOR_LEG]].any()
        if tick.mode == "leg":
            assert np.abs(tick.allocation.joint_torques[4 * leg : 4 * leg + 4]).max() <= 5.0 + 1e-4
    assert np.abs([s.joint_torque for s in crawl.states]).max() < ROBOT.max_joint_torque


@pytest.mark.parametrize("command", [STAND, ALL, Lift((0,))], ids=["stand", "lift", "lift one"])
def test_floor_carries_what_the_commanded_forces_leave_of_the_weight(command):
    crawl = ride(command)
    last = crawl.during("hold")[-1]
    tick, force_w = crawl.ticks[last], np.array([0.0, 0.0, -ROBOT.weight])
    engine().move(crawl.states[last].joint_position, attitude(crawl.states[last]), crawl.states[last].vectoring)
    for link, force in zip(engine().rotors()[1], tick.forces_l, strict=True):
        force_w += engine().attitude(link) @ force
    np.testing.assert_allclose(crawl.contacts[last][:, 3:].sum(axis=0), -force_w, atol=0.1)
    assert crawl.commands[last].thrust.sum() > 15.0


@pytest.mark.parametrize("command", [ALL, Lift((0,))], ids=["all", "one"])
def test_servos_of_a_leg_held_in_the_air_bear_what_was_allocated_to_them(command):
    crawl = ride(command)
    last = crawl.during("hold")[-1]
    up = np.repeat(crawl.ticks[last].demand.lifted, 4)
    allocated = crawl.ticks[last].allocation.joint_torques
    np.testing.assert_allclose(crawl.states[last + 1].joint_torque[up], allocated[up], atol=0.05)
    assert np.abs(allocated[up]).max() > 4.9


def test_feet_of_a_standing_robot_press_as_they_were_allocated():
    crawl = ride(STAND)
    last = crawl.during("hold")[-1]
    points, forces = crawl.contacts[last][:, :3], crawl.contacts[last][:, 3:]
    assert len(points) == 4
    turn = np.arctan2(*(points - crawl.states[last].position_w)[:, 1::-1].T) % (2.0 * np.pi)
    by_leg = forces[np.argsort(turn)]
    allocated = crawl.ticks[last].allocation.foot_forces_f
    np.testing.assert_allclose(by_leg[:, 2], allocated[:, 2], atol=0.2)
    assert crawl.touches[last].feet.all()
    assert not crawl.touches[last].pegs.any()


def test_setpoints_lead_the_plan_by_the_torque_fed_forward_or_not_at_all():
    lying = ride(STAND).states[0]
    for share in (0.0, 0.5, 1.0):
        crawler = Crawler(CrawlerConfig(feed_forward=share, blend_time=0.0))
        crawler.reset(lying, [STAND])
        for state in ride(STAND).states[:50]:
            command = crawler.step(state)
            lead = ROBOT.joint_kp * (command.joint_position - crawler.gait.memory.plan)
            np.testing.assert_allclose(lead, share * crawler.last_step.allocation.joint_torques, atol=1e-9)
    assert np.abs(crawler.last_step.allocation.joint_torques).max() > 4.9
