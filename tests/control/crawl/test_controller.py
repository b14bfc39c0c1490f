"""Pins the crawler's tick: a function of the states alone, residuals, non-finite states, refused settings."""

import copy
from dataclasses import fields, replace

import numpy as np
import pytest
from support.crawls import ALL, OPTIMAL, STAND, STEP, attitude, by_mujoco, engine, ride
from support.states import resting

from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.control.crawl.controller import Crawler, CrawlerConfig
from spidar_gym.control.crawl.footsteps import GaitConfig, Lift, lying_pose
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import ROBOT
from spidar_gym.state import NO_RESIDUAL, Command, Residual


def follow(crawl, residuals=None, crawler=None):
    """Commands of `crawler`, by default a new one, for the recorded states of a crawl."""
    if crawler is None:
        crawler = Crawler()
        crawler.reset(crawl.states[0], [STEP])
    states = crawl.states[: len(crawl.ticks)]
    residuals = [NO_RESIDUAL] * len(states) if residuals is None else residuals
    return [crawler.step(state, residual) for state, residual in zip(states, residuals, strict=True)]


def same(a: Command, b: Command) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))


def test_a_crawl_depends_on_the_states_alone_bit_for_bit():
    crawl = ride(STEP)
    crawler = Crawler()
    crawler.reset(crawl.states[0], [STAND])
    for state in crawl.states[:40]:
        crawler.step(state)
    crawler.reset(crawl.states[0], [STEP])
    assert all(map(same, follow(crawl, crawler=crawler), crawl.commands))


@pytest.mark.parametrize("tick", [60, 240])
def test_both_memories_are_the_complete_state_of_a_crawler(tick):
    crawl, crawler = ride(STEP), Crawler()
    crawler.reset(crawl.states[0], [STEP])
    for state in crawl.states[:tick]:
        crawler.step(state)
    other = Crawler()
    other.memory, other.gait.memory = copy.deepcopy((crawler.memory, crawler.gait.memory))
    for state, command in zip(crawl.states[tick : tick + 50], crawl.commands[tick : tick + 50], strict=True):
        assert same(other.step(state), command)


def test_a_residual_of_zeros_or_one_that_is_not_finite_changes_no_bit():
    crawl = ride(STEP)
    nothing = Residual(np.zeros(6), np.zeros(16), 1.0, np.zeros((8, 3)), np.zeros((4, 3)))
    lost = [Residual(leg_forces_b=np.full((4, 3), np.nan)), Residual(forces_l=np.full((8, 3), np.inf))]
    lost += [Residual(wrench=np.full(6, np.nan)), Residual(stride_scale=np.nan), Residual(lift_scale=np.inf)]
    kinds = [nothing, *lost]
    commands = follow(crawl, [kinds[k % len(kinds)] for k in range(len(crawl.ticks))])
    assert all(map(same, commands, crawl.commands))


def test_a_residual_joint_offset_is_added_to_the_setpoints_within_the_joints_range():
    crawl, rng = ride(STEP), np.random.default_rng(8)
    offsets = rng.uniform(-0.5, 0.5, (len(crawl.ticks), 16))
    commands = follow(crawl, [Residual(joint_offset=offset) for offset in offsets])
    for command, plain, offset in zip(commands, crawl.commands, offsets, strict=True):
        moved = np.clip(plain.joint_position + offset, -np.pi / 2, np.pi / 2)
        np.testing.assert_allclose(command.joint_position, moved, atol=1e-12)
        np.testing.assert_array_equal(command.thrust, plain.thrust)
    assert np.abs([command.joint_position for command in commands]).max() == np.pi / 2


@pytest.mark.parametrize(("by", "size"), [("forces_l", 60.0), ("leg_forces_b", 3.0)])
def test_residual_forces_stay_within_the_sphere_and_the_joint_torque_of_the_servos(by, size):
    crawl, rng, shape = ride(STEP), np.random.default_rng(9), {"forces_l": (8, 3), "leg_forces_b": (4, 3)}
    crawler, changed, short = Crawler(), 0.0, 0
    crawler.reset(crawl.states[0], [STEP])
    for k, (state, plain) in enumerate(zip(crawl.states[:180], crawl.commands, strict=False)):
        command = crawler.step(state, Residual(**{by: rng.uniform(-size, size, shape[by])}))
        tick, allocation = crawler.last_step, crawler.last_step.allocation
        assert max(command.thrust.max(), allocation.thrust.max()) <= ROBOT.max_thrust + 1e-9
        changed = max(changed, np.abs(command.thrust - plain.thrust).max())
        assert allocation.status in OPTIMAL
        if k % 4:
            continue
        pose = state.joint_position, attitude(state), crawler.gait.memory.floor_R, state.vectoring
        _, torque = by_mujoco(pose, tick.demand, allocation.forces_l, allocation.foot_forces_f)
        up = np.repeat(tick.demand.lifted, 4)
        assert not up.any() or np.abs(torque[up]).max() <= ROBOT.max_joint_torque + 1e-3
        short += bool(up.any() and np.abs(torque[up]).max() > 5.1)
    assert changed > 0.5
    assert short > 0, "the policy may use what the allocation keeps in reserve"


def test_residual_forces_do_not_start_the_rotors_of_legs_that_stand():
    crawl, crawler = ride(Lift((0,))), Crawler()
    crawler.reset(crawl.states[0], [Lift((0,))])
    for state in crawl.states[: crawl.during("hold")[0]]:
        command = crawler.step(state, Residual(leg_forces_b=np.full((4, 3), 5.0)))
        assert crawler.last_step.mode == "leg"
        assert not command.thrust[2:].any()
    assert command.thrust[:2].min() > 0.0


def test_valid_residual_forces_by_leg_are_shared_by_its_two_rotors():
    crawl, found = ride(STAND), 0
    crawler = Crawler(CrawlerConfig(blend_time=0.0))
    crawler.reset(crawl.states[0], [STAND])
    wish = np.random.default_rng(10).uniform(-0.2, 0.2, (4, 3))
    for state in crawl.states[:100]:
        saved = copy.deepcopy((crawler.memory, crawler.gait.memory))
        plain = crawler.step(state)
        before = crawler.last_step
        crawler.memory, crawler.gait.memory = saved
        crawler.step(state, Residual(leg_forces_b=wish))
        if before.demand.locked.any() or np.abs(plain.thrust).max() > 40.0:
            continue
        found += 1
        engine().move(state.joint_position, attitude(state), state.vectoring)
        more = crawler.last_step.forces_l - before.forces_l
        for i, link in enumerate(engine().links):
            given_b = attitude(state).T @ engine().attitude(link.id) @ more[i]
            np.testing.assert_allclose(given_b, 0.5 * wish[i // 2], atol=1e-6)
    assert found > 50


NUMBERS = (
    "position_w", "quat_wb", "velocity_w", "omega_b", "joint_position", "joint_velocity", "vectoring",
)  # fmt: skip


def test_a_state_that_is_not_finite_is_answered_with_the_last_command_and_forgotten():
    crawl, crawler = ride(STEP), Crawler()
    crawler.reset(crawl.states[0], [STEP])
    for k, state in enumerate(crawl.states[:-1]):
        for name in NUMBERS if k % 40 == 30 else ():
            for value in (np.nan, np.inf, -np.inf):
                bad = getattr(state, name).copy()
                bad.flat[1] = value
                held = crawler.step(replace(state, **{name: bad}))
                assert crawler.last_step.allocation.status == AllocationStatus.HELD
                np.testing.assert_allclose(held.thrust, crawl.commands[k - 1].thrust, rtol=1e-12)
                for part in ("vectoring", "joint_position", "joint_torque_limit"):
                    np.testing.assert_array_equal(getattr(held, part), getattr(crawl.commands[k - 1], part))
        assert same(crawler.step(state), crawl.commands[k])
        assert crawler.last_step.allocation.status in OPTIMAL


def test_a_lost_pose_on_the_first_tick_is_answered_with_a_robot_that_lies_still():
    lying = resting(lying_pose(GaitConfig()))
    crawler = Crawler()
    crawler.reset(lying, [STEP])
    command = crawler.step(replace(lying, quat_wb=np.zeros(4)))
    assert not command.thrust.any()
    np.testing.assert_array_equal(command.joint_position, lying.joint_position)
    np.testing.assert_array_equal(command.vectoring, lying.vectoring)


def test_a_crawler_with_nothing_to_do_lies_still_with_its_rotors_off():
    crawler, state = Crawler(), resting(lying_pose(GaitConfig()))
    crawler.reset(state)
    for _ in range(20):
        command = crawler.step(state)
        assert not command.thrust.any()
        np.testing.assert_allclose(command.joint_position, state.joint_position, atol=1e-12)
        np.testing.assert_array_equal(command.joint_torque_limit, ROBOT.max_joint_torque)
    assert crawler.gait.done


@pytest.mark.parametrize(
    ("gain", "disturbed"), [("leg_stiffness", "joint_position"), ("leg_damping", "joint_velocity")]
)
def test_thrust_of_a_lifted_leg_pushes_against_its_error_or_its_rate(gain, disturbed):
    crawl, rng, crawler = ride(ALL), np.random.default_rng(11), Crawler()
    crawler.reset(crawl.states[0], [ALL])
    last = crawl.during("hold")[-1]
    for state in crawl.states[:last]:
        crawler.step(state)
    crawlers = Crawler(), Crawler(CrawlerConfig(**{gain: 20.0}))
    for _ in range(10):
        error, state, torques = rng.uniform(-0.05, 0.05, 16), crawl.states[last], []
        for other in crawlers:
            other.memory, other.gait.memory = copy.deepcopy((crawler.memory, crawler.gait.memory))
            other.step(replace(state, **{disturbed: getattr(state, disturbed) + error}))
            torques.append(other.last_step.demand.torque_map @ other.last_step.allocation.forces_l.reshape(-1))
        assert error @ (torques[1] - torques[0]) < 0.0


@pytest.mark.parametrize("name", ["joint_speed", "rate_hz", "torque_limit", "foot_friction", "peg_friction"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_crawler_without_a_positive_limit_is_refused(name, value):
    with pytest.raises(InvalidValueError, match=f"{name}.*expected"):
        CrawlerConfig(**{name: value})


@pytest.mark.parametrize("name", ["blend_time", "min_normal", "torque_weight", "feed_forward", "leg_stiffness"])
def test_a_crawler_with_a_negative_gain_or_time_is_refused_but_zero_is_a_choice(name):
    with pytest.raises(InvalidValueError, match=f"{name}.*expected"):
        CrawlerConfig(**{name: -0.1})
    assert getattr(CrawlerConfig(**{name: 0.0}), name) == 0.0
