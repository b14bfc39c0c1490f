"""Pins the gait's cycle: the paper's phases in order, the paths of torso and feet, the sequence of commands."""

from dataclasses import replace
from functools import cache
from itertools import groupby

import numpy as np
import pytest
from support.gaits import DT, EXACT, FORWARD, SPEED, WAYS, World, feet_of

from spidar_gym.control.crawl.footsteps import GaitConfig, Lift, Move, Stand, largest_stride, lying_pose
from spidar_gym.control.crawl.gait import nominal_time
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import N_LEGS, ROBOT
from spidar_gym.state import Residual

CYCLE = ["spool", "raise", "swing", "lower", "brace", "up", "forward", "down", "settle"]
ON_FEET = ("brace", "up", "forward", "down")


@cache
def crawl(name):
    """A world in which the gait has executed `WAYS[name]`, starting away from the origin."""
    world = World(start=(0.7, -0.4, 2.0))
    return world.run(*(Move(way) for way in WAYS[name]))


@pytest.mark.parametrize("name", WAYS)
def test_the_torso_ends_at_the_commanded_pose(name):
    world = crawl(name)
    assert np.all(world.missed(*WAYS[name]) < 1e-3)
    assert world.gait.memory.timeouts == 0
    assert abs(world.position[2] - ROBOT.peg_depth) < 1e-9


@pytest.mark.parametrize("name", WAYS)
def test_every_cycle_goes_through_the_papers_phases_in_order(name):
    phases = crawl(name).phases
    cycles = len(phases) // len(CYCLE)
    assert cycles >= len(WAYS[name])
    assert phases == CYCLE * cycles + ["done"]


@pytest.mark.parametrize("name", WAYS)
def test_no_joint_is_commanded_to_move_faster_than_the_joint_speed(name):
    plans = np.array([row[1] for row in crawl(name).rows])
    speeds = np.abs(np.diff(plans, axis=0)).max(axis=1) / DT
    assert speeds.max() <= SPEED * (1.0 + 1e-9)
    assert np.mean(speeds > 0.99 * SPEED) > 0.2, "the gait is as fast as it may be"


@pytest.mark.parametrize("name", WAYS)
def test_feet_stay_where_they_stand_while_the_torso_moves(name):
    assert crawl(name).slip < 0.0015


@pytest.mark.parametrize("name", WAYS)
def test_feet_are_off_the_floor_while_they_swing_and_on_it_while_the_torso_moves(name):
    swinging, standing = (
        [row[2][:, 2] - ROBOT.foot_radius for row in crawl(name).during(*p)] for p in (["swing"], ON_FEET)
    )
    assert np.min(swinging) > 0.02
    standing = np.array(standing)
    assert standing.max() < 0.0015
    assert standing.min() > -EXACT.press - 0.0015


@pytest.mark.parametrize("name", WAYS)
def test_the_torso_moves_forward_at_its_lift_height_and_rises_and_sinks_on_the_spot(name):
    world = crawl(name)
    heights = np.array([row[3] for row in world.during("forward")])
    np.testing.assert_allclose(heights, EXACT.lift_height, rtol=0, atol=1e-3)
    for phase in ("up", "down"):
        for _, rows in groupby(world.rows, key=lambda row: row[0]):
            rows = list(rows)
            if rows[0][0] == phase:
                ends = [(row[4].x, row[4].y, row[4].yaw) for row in (rows[0], rows[-1])]
                np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=2e-3)
                assert abs(abs(rows[-1][3] - rows[0][3]) - EXACT.lift_height) < 0.01


def test_each_cycle_covers_the_same_share_of_the_arc():
    way = Pose2(0.5, 0.3, 1.2)
    world = World().run(Move(way, cycles=4))
    ends = [list(rows)[-1][4] for phase, rows in groupby(world.rows, key=lambda row: row[0]) if phase == "settle"]
    assert len(ends) == 4
    for k, end in enumerate(ends, 1):
        goal = way.arc(0.25 * k)
        np.testing.assert_allclose((end.x, end.y, end.yaw), (goal.x, goal.y, goal.yaw), rtol=0, atol=1e-3)


@pytest.mark.parametrize("stride", ["centred", "home"])
def test_feet_end_a_stride_at_the_positions_of_the_scheme(stride):
    config = replace(EXACT, stride=stride)
    world = World(config).run(Move(Pose2(0.12), cycles=1))
    behind = {"centred": 0.06, "home": 0.0}[stride]
    feet_b = feet_of(world.q)
    np.testing.assert_allclose(feet_b[:, :2], config.home_b[:, :2] - (behind, 0.0), rtol=0, atol=1e-3)


def test_lifting_legs_raises_them_alone_by_the_angle_for_the_time_and_lowers_them():
    for legs in ((0,), (3, 1), (0, 1, 2, 3)):
        world = World().run(Lift(legs, angle=0.25, seconds=1.5))
        assert world.phases == ["spool", "raise", "hold", "lower", "settle", "done"]
        still = np.setdiff1d(np.arange(N_LEGS), legs)
        start = lying_pose(EXACT).reshape(N_LEGS, 4)
        for row in world.during("hold"):
            plan = row[1].reshape(N_LEGS, 4)
            np.testing.assert_allclose(plan[list(legs), 1], start[list(legs), 1] - 0.25, atol=1e-6)
        plans = np.array([row[1] for row in world.rows]).reshape(-1, N_LEGS, 4)
        assert np.abs(plans[:, still] - start[still]).max(initial=0.0) < 1e-9
        assert np.abs(plans[:, :, (0, 2, 3)] - start[:, (0, 2, 3)]).max() < 1e-9
        assert np.abs(plans[-1] - start).max() < 1e-3
        assert len(world.during("hold")) == pytest.approx(1.5 / DT, abs=1)


def test_standing_lifts_the_torso_to_the_height_holds_it_for_the_time_and_puts_it_down():
    world = World().run(Stand(height=0.14, seconds=1.5))
    assert world.phases == ["brace", "up", "hold", "down", "settle", "done"]
    heights = np.array([row[3] for row in world.during("hold")])
    np.testing.assert_allclose(heights, 0.14, rtol=0, atol=1e-3)
    assert len(heights) == pytest.approx(1.5 / DT, abs=1)
    assert max(row[3] for row in world.rows) < 0.141
    assert np.all(world.missed() < 1e-3)
    assert abs(world.position[2] - ROBOT.peg_depth) < 1e-9


def test_commands_are_carried_out_one_after_the_other_also_if_they_come_later():
    world = World()
    world.run(Stand(seconds=0.1), Move(Pose2(0.1, 0.0, 0.3)), Lift((2,), seconds=0.1))
    first = world.phases
    assert first == [
        "brace",
        "up",
        "hold",
        "down",
        "settle",
        *CYCLE,
        "spool",
        "raise",
        "hold",
        "lower",
        "settle",
        "done",
    ]
    world.run(Move(Pose2(-0.05, 0.1)))
    assert world.phases == [*first, *CYCLE, "done"]
    assert np.all(world.missed(Pose2(0.1, 0.0, 0.3), Pose2(-0.05, 0.1)) < 1e-3)


def test_a_command_that_arrives_during_a_crawl_is_queued():
    world = World()
    world.gait.command([Move(Pose2(0.1))])
    for _ in range(200):
        world.tick()
    assert world.gait.memory.phase != "done"
    world.run(Move(Pose2(0.0, 0.1)))
    assert world.phases == [*CYCLE, *CYCLE, "done"]
    assert np.all(world.missed(Pose2(0.1), Pose2(0.0, 0.1)) < 1e-3)


def test_thrust_has_longer_to_come_from_rest_than_from_another_mode_and_time_to_fade():
    config = replace(EXACT, start_time=0.8, spool_time=0.3, settle_time=0.6)
    moves, stand = World(config).run(Move(Pose2(0.1), cycles=2)), World(config).run(Stand(seconds=0.1))
    for world, phase, seconds in (
        (moves, "spool", 2 * 0.8),
        (moves, "brace", 2 * 0.3),
        (moves, "settle", 2 * 0.6),
        (stand, "brace", 0.8),
    ):
        assert len(world.during(phase)) * DT == pytest.approx(seconds, abs=2 * DT)
    restless = World(replace(config, settle_time=0.0)).run(Move(Pose2(0.1), cycles=2))
    assert len(restless.during("spool")) * DT == pytest.approx(0.8 + 0.3, abs=2 * DT)


def test_allocation_modes_and_lifted_legs_follow_the_phases():
    world = World().run(Move(Pose2(0.05)), Lift((1,), seconds=0.1), Stand(seconds=0.1))
    phases, modes = [row[0] for row in world.rows], [row[5] for row in world.rows]
    steps = [mode for mode, _ in groupby(modes)]
    assert steps == ["legs", "stance", "rest", "leg", "rest", "stance", "rest"]
    for phase, mode, lifted in zip(phases, modes, (row[6] for row in world.rows), strict=True):
        assert (mode == "stance") >= (phase in ON_FEET)
        assert (mode == "rest") == (phase in ("settle", "done"))
        expected = {"legs": [1, 1, 1, 1], "stance": [1, 1, 1, 1], "leg": [0, 1, 0, 0], "rest": [0, 0, 0, 0]}[mode]
        np.testing.assert_array_equal(lifted, np.array(expected, bool))


def test_without_a_settling_time_cycles_follow_each_other_without_a_rest():
    world = World(replace(EXACT, settle_time=0.0)).run(Move(Pose2(0.3), cycles=2))
    assert world.phases == [*CYCLE[:-1], *CYCLE, "done"]
    assert np.all(world.missed(Pose2(0.3)) < 1e-3)


def test_residuals_scale_stride_height_raise_and_speed():
    half = World().run(FORWARD, residual=Residual(stride_scale=0.5))
    np.testing.assert_allclose((half.planar.x, half.planar.y), (0.1, 0.0), rtol=0, atol=1e-3)
    behind = EXACT.home_b[:, :2] - (0.05, 0.0)
    np.testing.assert_allclose(feet_of(half.q)[:, :2], behind, rtol=0, atol=1e-3)
    low = World().run(FORWARD, residual=Residual(lift_scale=0.5))
    assert max(row[3] for row in low.rows) == pytest.approx(0.5 * EXACT.lift_height, abs=1e-3)
    slow = World().run(FORWARD, residual=Residual(joint_speed_scale=0.5))
    assert np.abs(np.diff([row[1] for row in slow.rows], axis=0)).max() <= 0.5 * SPEED * DT * (1.0 + 1e-9)
    raised = [World().run(FORWARD, residual=Residual(raise_scale=scale)) for scale in (1.0, 2.0)]
    inner = [min(row[1][1::4].min() for row in world.during("raise", "swing")) for world in raised]
    assert inner[0] - inner[1] == pytest.approx(EXACT.raise_angle, abs=1e-6)


@pytest.mark.parametrize("name", ["forward", "turn", "path"])
def test_the_nominal_time_is_what_a_perfect_world_takes(name):
    moves = [Move(way) for way in WAYS[name]]
    time = nominal_time(EXACT, moves, joint_speed=SPEED, dt=DT)
    assert time == pytest.approx(len(crawl(name).rows) * DT, abs=0.02 * len(crawl(name).rows) * DT)


def test_phases_that_overlap_take_less_time_and_end_in_the_same_place():
    overlapped = replace(
        EXACT, swing_at=0.5, lower_at=0.2, forward_at=0.5, down_at=0.6, settle_time=0.0, spool_time=0.1
    )
    moves = [Move(Pose2(0.3, 0.1), cycles=2)]
    times = [nominal_time(config, moves, joint_speed=SPEED, dt=DT) for config in (overlapped, EXACT)]
    assert times[0] < 0.85 * times[1]
    world = World(overlapped).run(*moves)
    assert np.all(world.missed(moves[0].way) < 1e-3)
    assert world.slip < 0.0015
    assert nominal_time(EXACT, moves, joint_speed=2.0 * SPEED, dt=DT) < 0.8 * times[1]


@pytest.mark.parametrize(("lift", "least"), [(0.1, 24.0), (0.025, 21.0)])
def test_one_phase_after_the_other_takes_longer_than_the_papers_20_s_whatever_the_start_pose(lift, least):
    """At the paper's joint speed of 0.2 rad/s, with the longest strides in reach and no waiting."""
    times = []
    for inner in (-0.8, -0.65, -0.55, -0.4):
        for outer in (1.1, 1.2, 1.25, 1.3, 1.4):
            try:
                config = GaitConfig(
                    inner=inner, outer=outer, lift_height=lift, max_distance=0.4, spool_time=0.0, start_time=0.12,
                    settle_time=0.0, leg_touch_time=0.1, torso_touch_time=0.1, arrival=0.01,
                )  # fmt: skip
            except InvalidValueError:
                continue
            if largest_stride(config, Pose2(0.6)) >= 0.5:  # two strides
                times.append(nominal_time(config, [Move(Pose2(0.6))], joint_speed=0.2, dt=DT))
    assert len(times) > 3
    assert least < min(times) < least + 1.0
